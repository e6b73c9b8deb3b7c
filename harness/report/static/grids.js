// The picture of a domain: what stays is drawn once, and a function moves the rest to any step of an episode.

const CELL = 48;

/** Blue for 0, grey for one half, orange for 1: told apart with any kind of colour vision, and the number is beside it. */
function shade(belief) {
  const ends = belief < 0.5 ? [[27, 94, 162], [225, 225, 225]] : [[225, 225, 225], [230, 126, 20]];
  const share = belief < 0.5 ? 2 * belief : 2 * belief - 1;
  const rgb = ends[0].map((from, k) => Math.round(from + share * (ends[1][k] - from)));
  const light = rgb.map((c) => (c / 255 <= 0.04045 ? c / 255 / 12.92 : ((c / 255 + 0.055) / 1.055) ** 2.4));
  const luminance = 0.2126 * light[0] + 0.7152 * light[1] + 0.0722 * light[2];
  return { fill: `rgb(${rgb.join(" ")})`, ink: luminance > 0.179 ? "#000" : "#fff" };
}

/** Where the middle of cell (column, row) is drawn. */
function placing(layout) {
  const up = layout.rows_grow === "up";
  return (column, row) => [
    (column - 0.5) * CELL, ((up ? layout.rows - row : row - 1) + 0.5) * CELL,
  ];
}

/** The empty board: cells, exit and wall, numbers of columns and rows. */
function board(layout, label) {
  const columns = layout.exit_column ?? layout.columns;
  const walls = new Set((layout.walls ?? []).map((cell) => cell.join()));
  const at = placing(layout);
  const svg = draw("svg", {
    // On large boards the cells are small: their text is larger, and the beliefs' numbers are in the bars only.
    class: columns > 10 ? "board large" : "board", role: "img", "aria-label": label,
    viewBox: `-22 -4 ${columns * CELL + 26} ${layout.rows * CELL + 26}`,
  });
  for (let row = 1; row <= layout.rows; row += 1) {
    for (let column = 1; column <= columns; column += 1) {
      const [x, y] = at(column, row);
      const walled = column === layout.wall_column || walls.has(`${column},${row}`);
      const kind = column === layout.exit_column ? "exit" : walled ? "wall" : "cell";
      svg.append(draw("rect", { x: x - CELL / 2, y: y - CELL / 2, width: CELL, height: CELL, class: kind }));
      if (kind === "exit") svg.append(draw("path", { d: `M${x - 5} ${y - 8}l8 8l-8 8`, class: "arrow" }));
      if (kind === "wall") svg.append(draw("path", { d: `M${x - 14} ${y + 14}L${x + 14} ${y - 14}`, class: "hatch" }));
    }
    svg.append(draw("text", { x: -12, y: at(1, row)[1] + 5, class: "number" }, String(row)));
  }
  for (let column = 1; column <= columns; column += 1) {
    const name = column === layout.exit_column ? "exit" : column === layout.wall_column ? "wall" : String(column);
    svg.append(draw("text", { x: at(column, 1)[0], y: layout.rows * CELL + 17, class: "number" }, name));
  }
  return svg;
}

/** A robot's body around (0, 0), with a mark that tells it from others without colour. */
function robot(mark, tone) {
  const body = mark === "2"
    ? draw("rect", { x: -13, y: -13, width: 26, height: 26, rx: 4 })
    : draw("circle", { r: 14 });
  return draw("g", { class: `robot robot-${tone}` }, body, draw("text", { y: 5.5 }, mark));
}

function rockSample(domain) {
  const { layout } = domain;
  const at = placing(layout);
  const svg = board(layout, `Map of ${domain.name}`);
  const beam = draw("line", { class: "beam" });
  const trail = draw("polyline", { class: "trail" });
  const rocks = layout.rocks.map(([column, row], i) => {
    const [x, y] = at(column, row);
    const parts = { disc: draw("circle", { r: 19 }), name: draw("text", { y: -3, class: "name" }, String(i + 1)),
      value: draw("text", { y: 11, class: "value" }), tag: draw("text", { y: -24, class: "tag" }) };
    const group = draw("g", { transform: `translate(${x} ${y})`, class: "rock" },
      parts.disc, parts.name, parts.value, parts.tag);
    return { ...parts, group };
  });
  const agent = robot("R", 1);
  const here = draw("rect", { x: 1.5 - CELL / 2, y: 1.5 - CELL / 2, width: CELL - 3, height: CELL - 3, class: "here" });
  svg.append(here, trail, beam, ...rocks.map((rock) => rock.group), agent);
  const taken = new Map(rocks.map((_, i) => [layout.rocks[i].join(), i]));

  return { svg, show(episode, k) {
    const places = path(episode, k, domain);
    const [column, row] = places[places.length - 1];
    const [x, y] = at(column, row);
    const onRock = taken.has(`${column},${row}`);
    here.style.transform = `translate(${x}px, ${y}px)`;
    const aside = onRock ? 18 : 0; // in the corner of the cell, where it hides none of the rock's numbers
    agent.style.transform = `translate(${x + aside}px, ${y + aside}px) scale(${onRock ? 0.55 : 1})`;
    trail.setAttribute("points", places.map((place) => at(...place).join()).join(" "));
    const { checked, words } = read(domain, episode, k);
    rocks.forEach((rock, i) => {
      const belief = episode.beliefs[k][i] / 1000;
      const { fill, ink } = shade(belief);
      rock.disc.style.fill = fill;
      for (const part of [rock.name, rock.value]) part.style.fill = ink;
      rock.value.textContent = belief.toFixed(2);
      rock.tag.textContent = words[i] ?? "";
      rock.group.classList.toggle("checked", i === checked);
    });
    beam.style.display = checked < 0 ? "none" : "";
    if (checked >= 0) {
      const [bx, by] = at(...layout.rocks[checked]);
      for (const [name, value] of Object.entries({ x1: x, y1: y, x2: bx, y2: by })) beam.setAttribute(name, value);
    }
  } };
}

/** Cells the robot has been in up to step k. After the end there is no cell any more: it has left by the exit. */
function path(episode, k, domain) {
  const places = episode.visible.slice(0, k + 1).map((visible) => visible.slice(0, 2));
  if (episode.terminated && k === episode.action.length - 1 && k > 0) {
    places[k] = [domain.layout.exit_column, places[k - 1][1]];
  }
  return places;
}

/** Which rock the step has checked, −1 for none, and what was read of the rocks, by number. */
function read(domain, episode, k) {
  if (episode.reading[k] < 0) return { checked: -1, words: {} };
  if (domain.sensors.length) return { checked: -1, words: sensed(domain, episode.reading[k]) };
  const found = /^check\((\d+)\)$/.exec(domain.actions[episode.action[k]] ?? "");
  if (!found) return { checked: -1, words: {} };
  const checked = Number(found[1]) - 1;
  return { checked, words: { [checked]: domain.observations[episode.reading[k]] } };
}

/** The label that each sensor read; the last one runs fastest in the number of a reading. */
function sensed(domain, reading) {
  const words = {};
  for (let [j, rest] = [domain.sensors.length - 1, reading]; j >= 0; j -= 1) {
    const labels = domain.sensors[j];
    words[j] = labels[rest % labels.length];
    rest = Math.floor(rest / labels.length);
  }
  return words;
}

/** Cells coloured by the belief that what is hidden is there: `cells` has one for every feature, some may share one. */
function heatMap(cells, at, svg) {
  const features = new Map();
  cells.forEach((cell, i) => features.set(cell.join(), [...(features.get(cell.join()) ?? []), i]));
  const drawn = [...features].map(([place, about]) => {
    const [row, column] = place.split(",").map(Number);
    const [x, y] = at(column, row);
    const cell = draw("rect", { x: x - CELL / 2, y: y - CELL / 2, width: CELL, height: CELL, class: "heat" });
    const value = draw("text", { x, y: y + CELL / 2 - 4, class: "probability" });
    svg.append(cell, value);
    return { cell, value, about };
  });
  return (beliefs) => drawn.forEach(({ cell, value, about }) => {
    const belief = about.reduce((sum, i) => sum + (beliefs?.[i] ?? 0), 0) / 1000;
    cell.style.fillOpacity = Math.sqrt(Math.min(belief, 1));
    value.textContent = belief >= 0.01 ? belief.toFixed(2).replace(/^0/, "") : "";
  });
}

/** A map with walls and signs: a robot where one is seen, and where what is hidden may be. */
function gridWorld(domain) {
  const { layout } = domain;
  const at = placing(layout);
  const svg = board(layout, `Map of ${domain.name}`);
  const heat = heatMap(layout.hidden_cells.length ? domain.cells : [], at, svg);
  for (const [sign, column, row] of layout.signs) {
    const [x, y] = at(column, row);
    svg.append(draw("text", { x, y: y + 5 }, sign));
  }
  const columns = ["x", "y"].map((name) => domain.visible.indexOf(name));
  const agent = columns[0] < 0 ? null : robot("R", 1);
  if (agent) svg.append(agent);

  return { svg, show(episode, k) {
    const over = episode.terminated && k === episode.action.length - 1 && k > 0;
    const values = episode.visible[over ? k - 1 : k];
    if (agent) {
      const [x, y] = at(...columns.map((i) => values[i]));
      agent.style.transform = `translate(${x}px, ${y - 5}px)`;
    }
    heat(over ? null : episode.beliefs[k]);
  } };
}

function borderCross(domain) {
  const { layout } = domain;
  const at = placing(layout);
  const svg = board(layout, `Map of ${domain.name}`);
  const hidden = domain.visible.length === 2;
  const heat = heatMap(hidden ? domain.cells : [], at, svg);
  const robots = [robot("1", 1), ...(hidden ? [] : [robot("2", 2)])];
  svg.append(...[...robots].reverse());

  return { svg, show(episode, k) {
    const over = episode.terminated && k === episode.action.length - 1 && k > 0;
    const values = episode.visible[over ? k - 1 : k];
    const cells = robots.map((_, r) => [over ? layout.exit_column : values[2 * r + 1], values[2 * r]]);
    const together = cells.length > 1 && cells[0].join() === cells[1].join();
    robots.forEach((each, r) => {
      const [x, y] = at(...cells[r]);
      const aside = together ? (r ? 10 : -10) : 0;
      each.style.transform = `translate(${x + aside}px, ${y - (hidden ? 5 : 0)}px)`;
    });
    heat(over ? null : episode.beliefs[k]);
  } };
}

/** What the colours of a picture mean, in numbers and words. */
function beliefLegend(domain) {
  const legend = make("p", { class: "key" });
  if (domain.layout.kind === "rocksample") {
    const words = { 0: "bad", 0.5: "unknown", 1: "good" };
    const swatches = [0, 0.25, 0.5, 0.75, 1].map((belief) => {
      const { fill, ink } = shade(belief);
      const swatch = make("span", { class: "swatch" }, belief.toFixed(2));
      swatch.style.background = fill;
      swatch.style.color = ink;
      return make("span", {}, swatch, words[belief] ? ` ${words[belief]}` : "");
    });
    legend.append("Belief that a rock is good: ", ...swatches);
  } else if (domain.layout.kind === "grid") {
    const robots = domain.visible.includes("x") ? "Round, R: the robot. " : "";
    const heat = domain.layout.hidden_cells.length
      ? "Coloured cells: where what is hidden may be, the number is the belief (.34 of 1). " : "";
    legend.append(`${robots}${heat}Striped: walls.`);
  } else if (domain.features.length > 0) {
    legend.append("Round, 1: robot 1. Coloured cells: where robot 2 may be, the number is the belief (.34 of 1).");
  } else {
    legend.append("Round, 1: robot 1. Square, 2: robot 2. Striped: the wall.");
  }
  return legend;
}

/** The picture for a domain; null for those whose layout nobody has described. */
function picture(domain) {
  const kinds = { rocksample: rockSample, bordercross: borderCross, grid: gridWorld };
  return kinds[domain.layout.kind]?.(domain) ?? null;
}
