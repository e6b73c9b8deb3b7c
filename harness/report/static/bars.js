// Bars of a comparison. They are HTML, so that names of any length wrap, and places are shares of the width.

function comparison(figure) {
  const record = dataOf(figure);
  const place = (value) => 100 * (clamp(value, record.low, record.high) - record.low) / (record.high - record.low);
  const list = make("ul", { class: "levels", "aria-label": `${record.title}, ${record.label}` },
    ...record.bars.map((bar) => make("li", {},
      make("span", { class: "name" }, bar.name), make("span", { class: "value" }, bar.text), level(bar, record, place))));
  const scale = make("div", { class: "scale", "aria-hidden": "true" }, ...ticks(record.low, record.high, 4).map((value) => {
    const tick = make("span", {}, text(value));
    tick.style.left = `${place(value)}%`;
    return tick;
  }));
  figure.querySelector("figcaption").after(list, scale, make("p", { class: "unit" }, record.label));
}

/** A bar from zero, and over it the interval. What is beyond the scale fades out. */
function level(bar, record, place) {
  const part = (kind, from, to) => {
    const element = make("span", { class: kind });
    element.style.left = `${place(from)}%`;
    element.style.width = `${place(to) - place(from)}%`;
    return element;
  };
  const kind = `length${bar.bound ? " bound" : ""}${bar.y < record.low ? " beyond" : ""}`;
  const parts = [part(kind, Math.min(0, bar.y), Math.max(0, bar.y)), part("zero", 0, 0)];
  if (bar.low !== null && bar.high > record.low && bar.high > bar.low) parts.push(part("interval", bar.low, bar.high));
  return make("span", { class: "level", "aria-hidden": "true" }, ...parts);
}
