// Line charts. They are drawn anew when their width changes, so that their text keeps its size on a phone.

const MARGIN = { top: 12, right: 14, bottom: 44, left: 56 };

function chart(figure) {
  const record = dataOf(figure);
  const canvas = make("div", { class: "canvas" });
  const readout = make("p", { class: "readout", "aria-live": "polite" });
  const legend = make("ul", { class: "legend" }, ...record.series.map((series, k) => legendEntry(series, tone(record, k))));
  figure.querySelector("figcaption").after(legend, canvas, readout);
  readout.textContent = hint(record);
  let width = 0;
  const redraw = () => {
    const now = Math.round(canvas.clientWidth);
    if (now > 0 && now !== width) {
      width = now;
      canvas.replaceChildren(plot(record, width, readout));
    }
  };
  redraw();
  new ResizeObserver(redraw).observe(canvas);
}

/** The only line is blue; of several the first, which is the less sure one, is not. */
function tone(record, k) {
  return record.series.length === 1 ? 1 : k % 5;
}

function legendEntry(series, tone) {
  const key = draw("svg", { width: 28, height: 12, "aria-hidden": "true", class: `tone-${tone}` });
  if (series.points) key.append(draw("line", { x1: 14, x2: 14, y1: 0, y2: 12, class: "bar" }));
  else if (series.low) key.append(draw("rect", { width: 28, height: 12, class: "band" }));
  key.append(series.points
    ? draw("circle", { cx: 14, cy: 6, r: 3.5, class: "dot" })
    : draw("line", { x1: 0, y1: 6, x2: 28, y2: 6, class: "line" }));
  return make("li", {}, key, series.name);
}

function hint(record) {
  if (!record.best) return "Point at the chart, or focus it and use the arrow keys, to read values.";
  return `Highest: ${reading(record, highest(record.series[0].y))}`;
}

function highest(values) {
  return values.reduce((best, value, i) => (value !== null && (best < 0 || value > values[best]) ? i : best), -1);
}

/** What the chart shows at one place, in words. */
function reading(record, i) {
  const parts = record.series.filter((series) => series.y[i] !== null).map((series) => {
    const interval = series.low && series.low[i] !== null
      ? ` (${series.low[i].toFixed(2)} to ${series.high[i].toFixed(2)})` : "";
    const value = record.y.label.startsWith("value") ? text(series.y[i]) : series.y[i].toFixed(2);
    return `${series.name} ${value}${interval}`;
  });
  return `${record.x.label} ${text(record.x.values[i])}: ${parts.join("; ")}`;
}

/** Round steps of about the wanted number between two ends. */
function ticks(low, high, wanted, whole = false) {
  const rough = (high - low) / wanted || 1;
  const power = 10 ** Math.floor(Math.log10(rough));
  let step = [1, 2, 5, 10].map((factor) => factor * power).find((each) => each >= rough * 0.999);
  if (whole) step = Math.max(1, step);
  const found = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k += 1) found.push(k * step);
  return found;
}

/** The ends of an axis that holds all values, with a little room. */
function range(values, bottom = null) {
  const finite = values.filter((value) => value !== null && value !== undefined);
  let low = bottom === null ? Math.min(...finite) : bottom;
  let high = Math.max(...finite);
  if (high - low < 1e-9) [low, high] = [low - 1, high + 1];
  const room = 0.06 * (high - low);
  return [bottom === null ? low - room : low, high + room];
}

function plot(record, width, readout) {
  const height = clamp(Math.round(0.5 * width), 220, 340);
  const [left, right, top, bottom] = [MARGIN.left, width - MARGIN.right, MARGIN.top, height - MARGIN.bottom];
  const all = record.series.flatMap((series) => [...series.y, ...(series.low ?? []), ...(series.high ?? [])]);
  const xs = record.x.values;
  const [x0, x1] = xs.length > 1 && Math.min(...xs) < Math.max(...xs)
    ? [Math.min(...xs), Math.max(...xs)] : [xs[0] - 1, xs[0] + 1];
  const [y0, y1] = range(all, record.y.bottom);
  const scale = {
    x: (value) => left + 4 + ((value - x0) / (x1 - x0)) * (right - left - 8),
    y: (value) => bottom - ((value - y0) / (y1 - y0)) * (bottom - top),
  };
  const clip = `clip-${chartCount += 1}`;
  const svg = draw("svg", {
    viewBox: `0 0 ${width} ${height}`, width, height, tabindex: 0, role: "group",
    "aria-label": `${record.title}: ${record.y.label} over ${record.x.label}. Arrow keys read the values.`,
  });
  svg.append(draw("clipPath", { id: clip },
    draw("rect", { x: left, y: top - 6, width: right - left, height: bottom - top + 6 })));
  axes(svg, record, scale, { left, right, top, bottom, x0, x1, y0, y1 });
  const lines = draw("g", { "clip-path": `url(#${clip})` });
  record.series.forEach((series, k) => lines.append(curve(series, xs, scale, tone(record, k))));
  if (record.best) {
    const i = highest(record.series[0].y);
    lines.append(draw("circle", { cx: scale.x(xs[i]), cy: scale.y(record.series[0].y[i]), r: 5, class: "best" }));
  }
  svg.append(lines);
  pointer(svg, record, scale, { top, bottom }, readout);
  return svg;
}

let chartCount = 0;

function axes(svg, record, scale, { left, right, top, bottom, x0, x1, y0, y1 }) {
  for (const value of ticks(y0, y1, 5)) {
    const y = scale.y(value);
    svg.append(draw("line", { x1: left, x2: right, y1: y, y2: y, class: "grid" }),
      draw("text", { x: left - 7, y: y + 4, "text-anchor": "end" }, text(value)));
  }
  for (const value of ticks(x0, x1, clamp(Math.round((right - left) / 80), 3, 10), record.x.whole)) {
    const x = scale.x(value);
    svg.append(draw("line", { x1: x, x2: x, y1: bottom, y2: bottom + 5, class: "axis" }),
      draw("text", { x, y: bottom + 19, "text-anchor": "middle" }, text(value)));
  }
  const middle = (top + bottom) / 2;
  svg.append(draw("line", { x1: left, x2: right, y1: bottom, y2: bottom, class: "axis" }),
    draw("text", { x: (left + right) / 2, y: bottom + 38, "text-anchor": "middle", class: "label" }, record.x.label),
    draw("text", { transform: `translate(13 ${middle}) rotate(-90)`, "text-anchor": "middle", class: "label" },
      record.y.label));
}

/** A series: a line with its band, or points with bars. Values that are missing leave a gap. */
function curve(series, xs, scale, tone) {
  const group = draw("g", { class: `tone-${tone}` });
  const known = (column) => xs.map((x, i) => i).filter((i) => column[i] !== null);
  const at = (column) => (i) => `${scale.x(xs[i]).toFixed(1)},${scale.y(column[i]).toFixed(1)}`;
  if (series.points) {
    for (const i of known(series.y)) {
      const x = scale.x(xs[i]);
      group.append(draw("line", { x1: x, x2: x, y1: scale.y(series.low[i]), y2: scale.y(series.high[i]), class: "bar" }),
        draw("circle", { cx: x, cy: scale.y(series.y[i]), r: 3, class: "dot" }));
    }
    return group;
  }
  if (series.low) {
    const inside = known(series.low);
    const outline = [...inside.map(at(series.high)), ...inside.reverse().map(at(series.low))];
    group.append(draw("polygon", { points: outline.join(" "), class: "band" }));
  }
  group.append(draw("polyline", { points: known(series.y).map(at(series.y)).join(" "), class: "line" }));
  return group;
}

/** The read-out: by pointer or by arrow keys, the values nearest to it are said below the chart. */
function pointer(svg, record, scale, { top, bottom }, readout) {
  const xs = record.x.values;
  const cursor = draw("g", { class: "cursor" });
  svg.append(cursor);
  let at = -1;
  const show = (i) => {
    at = clamp(i, 0, xs.length - 1);
    const x = scale.x(xs[at]);
    const dots = record.series.filter((series) => series.y[at] !== null && scale.y(series.y[at]) <= bottom)
      .map((series) => draw("circle", { cx: x, cy: scale.y(series.y[at]), r: 4.5 }));
    cursor.replaceChildren(draw("line", { x1: x, x2: x, y1: top, y2: bottom }), ...dots);
    readout.textContent = reading(record, at);
  };
  const clear = () => {
    cursor.replaceChildren();
    readout.textContent = hint(record);
    at = -1;
  };
  svg.addEventListener("pointermove", (event) => {
    const box = svg.getBoundingClientRect();
    const [px, py] = [event.clientX - box.left, event.clientY - box.top];
    // Points may share an x: then the height decides.
    const distance = (i) => 8 * Math.abs(scale.x(xs[i]) - px) + Math.abs(scale.y(record.series[0].y[i] ?? 0) - py) / 8;
    show(xs.reduce((best, _, i) => (distance(i) < distance(best) ? i : best), 0));
  });
  svg.addEventListener("pointerleave", clear);
  svg.addEventListener("focus", () => show(record.best ? highest(record.series[0].y) : xs.length - 1));
  svg.addEventListener("blur", clear);
  svg.addEventListener("keydown", (event) => {
    const goal = { ArrowLeft: at - 1, ArrowRight: at + 1, Home: 0, End: xs.length - 1 }[event.key];
    if (goal === undefined || event.altKey || event.ctrlKey || event.metaKey) return;
    event.preventDefault();
    show(goal);
  });
}
