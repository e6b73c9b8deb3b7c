// Episodes step by step: by buttons, by a slider, by keys, or by themselves.

const TICK = 700; // milliseconds a step when playing at usual speed
const SPEEDS = { "½×": 0.5, "1×": 1, "2×": 2, "4×": 4 };

const ICONS = { // shapes, because not every font has these signs
  first: "M5 5h2.5v14H5zM19 5v14L9 12z", back: "M15.6 4.6L17.5 6.5 12 12l5.5 5.5-1.9 1.9L8.2 12z",
  play: "M7 4v16l13-8z", pause: "M6 5h4v14H6zM14 5h4v14h-4z",
  forward: "M8.4 4.6L6.5 6.5 12 12l-5.5 5.5 1.9 1.9L15.8 12z", last: "M16.5 5H19v14h-2.5zM5 5v14l10-7z",
};

const icon = (shape) => draw("svg", { viewBox: "0 0 24 24", class: "icon", "aria-hidden": "true" }, draw("path", { d: shape }));

function player(place) {
  const { domain, policies } = dataOf(place);
  for (const episode of policies.flatMap((policy) => policy.episodes)) unpack(episode, domain);
  const board = picture(domain);
  const parts = controls(policies);
  const [bars, program, truth] = [beliefBars(domain), programLines(), hiddenState(domain)];
  const log = make("ol", { start: 0 });
  const steps = make("details", {}, make("summary", {}, "All steps as text"), log);
  // On a phone the controls come right below the map; the beliefs stand beside both, or after them.
  const scene = make("div", { class: "scene" });
  const keys = make("p", { class: "keys" }, "Keys: ← → a step, Space plays and pauses, Home and End.");
  const legend = board ? [beliefLegend(domain)] : [];
  const told = make("div", { class: "told" }, parts.line, parts.sum, parts.buttons, parts.slider, ...legend, keys);
  if (board) scene.append(board.svg);
  scene.append(told);
  const beside = make("div", { class: "beside" }, program.element);
  if (domain.features.length > 0) beside.append(bars.element);
  if (domain.factors.length > 0) beside.append(truth.element);
  scene.append(beside);
  place.append(parts.choice, scene, steps);
  place.setAttribute("tabindex", "0");
  place.setAttribute("role", "group");
  place.setAttribute("aria-label", `Replay of episodes on ${domain.name}`);

  let [episode, k, timer] = [null, 0, 0];
  const last = () => episode.action.length - 1;
  const show = (to) => {
    k = clamp(to, 0, last());
    parts.line.textContent = sentence(domain, episode, k);
    parts.sum.textContent = sum(domain, episode, k);
    parts.slider.value = k;
    parts.slider.setAttribute("aria-valuetext", `step ${k} of ${last()}`);
    for (const name of ["first", "back"]) parts[name].disabled = k === 0;
    for (const name of ["forward", "last"]) parts[name].disabled = k === last();
    board?.show(episode, k);
    bars.show(policies[parts.policy.selectedIndex], episode, k);
    program.show(episode, k);
    truth.show(episode, k === last());
    log.querySelector("[aria-current]")?.removeAttribute("aria-current");
    log.children[k].setAttribute("aria-current", "step");
  };
  const playing = (on) => {
    clearInterval(timer);
    timer = 0;
    if (on) {
      if (k === last()) show(0);
      timer = setInterval(() => (k < last() ? show(k + 1) : playing(false)), TICK / SPEEDS[parts.speed.value]);
    }
    // Not read out while it runs by itself: a screen reader could not keep up.
    parts.line.setAttribute("aria-live", on ? "off" : "polite");
    parts.play.replaceChildren(icon(on ? ICONS.pause : ICONS.play));
    parts.play.setAttribute("aria-label", on ? "Pause" : "Play");
    parts.play.title = on ? "Pause" : "Play";
  };
  const go = (to) => { playing(false); show(to); };
  const choose = () => {
    const policy = policies[parts.policy.selectedIndex];
    episode = policy.episodes[parts.episode.selectedIndex];
    program.choose(policy.program);
    parts.slider.max = last();
    log.replaceChildren(...episode.action.map((_, i) => make("li", {}, sentence(domain, episode, i))));
    go(0);
  };

  parts.first.addEventListener("click", () => go(0));
  parts.back.addEventListener("click", () => go(k - 1));
  parts.play.addEventListener("click", () => playing(!timer));
  parts.forward.addEventListener("click", () => go(k + 1));
  parts.last.addEventListener("click", () => go(last()));
  parts.speed.addEventListener("change", () => { if (timer) playing(true); });
  parts.slider.addEventListener("input", () => go(Number(parts.slider.value)));
  parts.episode.addEventListener("change", choose);
  parts.policy.addEventListener("change", () => { listEpisodes(parts, policies); choose(); });
  place.addEventListener("keydown", (event) => {
    if (event.altKey || event.ctrlKey || event.metaKey || !keysAreOurs(event)) return;
    const action = {
      ArrowRight: () => go(k + 1), ArrowLeft: () => go(k - 1), Home: () => go(0), End: () => go(last()),
      " ": () => playing(!timer),
    }[event.key];
    if (action) {
      event.preventDefault();
      action();
    }
  });
  listEpisodes(parts, policies);
  choose();
}

/** Selects keep their keys, and a button or a summary its space bar. */
function keysAreOurs({ key, target }) {
  if (target.closest("select")) return false;
  return key !== " " || !target.closest("button, summary");
}

/** Beliefs come as changes from step to step. */
function unpack(episode, domain) {
  let now = new Array(domain.features.length).fill(0);
  episode.beliefs = episode.belief.map((changes) => {
    now = [...now];
    for (let i = 0; i < changes.length; i += 2) now[changes[i]] = changes[i + 1];
    return now;
  });
}

function controls(policies) {
  const button = (label, shape) => make("button", { type: "button", "aria-label": label, title: label }, icon(shape));
  const select = (label, options) => {
    const element = make("select", {}, ...options.map((name) => make("option", {}, name)));
    return [element, make("label", {}, make("span", {}, label), element)];
  };
  const [policy, policyLabel] = select("Policy", policies.map((each) => each.name));
  const [episode, episodeLabel] = select("Episode", []);
  const [speed, speedLabel] = select("Speed", Object.keys(SPEEDS));
  speed.value = "1×";
  const parts = {
    policy, episode, episodeLabel, speed,
    choice: make("div", { class: "choice" }, policyLabel, episodeLabel),
    first: button("First step", ICONS.first), back: button("Step back", ICONS.back), play: button("Play", ICONS.play),
    forward: button("Step forward", ICONS.forward), last: button("Last step", ICONS.last),
    slider: make("input", { type: "range", min: 0, value: 0, step: 1, "aria-label": "Step" }),
    line: make("p", { class: "happened", "aria-live": "polite" }),
    sum: make("p", { class: "sum" }),
  };
  parts.buttons = make("div", { class: "buttons" }, parts.first, parts.back, parts.play, parts.forward, parts.last, speedLabel);
  return parts;
}

function listEpisodes({ policy, episode, episodeLabel }, policies) {
  const { seed, episodes } = policies[policy.selectedIndex];
  episodeLabel.firstChild.textContent = `Episode of seed ${seed}`;
  episode.replaceChildren(...episodes.map((each) => make("option", {},
    `${each.episode}: return ${text(each.reward.reduce((a, b) => a + b, 0))}, ${each.action.length - 1} steps`)));
}

/** What happened in a step, in the words of `harness show`. */
function sentence(domain, episode, k) {
  const read = episode.reading[k] < 0 ? "" : `, reading ${domain.observations[episode.reading[k]]}`;
  if (k === 0) return `start${read}`;
  const total = episode.reward.slice(0, k + 1).reduce((a, b) => a + b, 0);
  const action = domain.actions[episode.action[k]];
  return `step ${k}: ${action}${read}, reward ${signed(episode.reward[k])}, return ${text(total)}`;
}

/** The reward so far, and in the end how the episode ended. */
function sum(domain, episode, k) {
  const steps = episode.action.length - 1;
  const rewards = episode.reward.slice(1, k + 1);
  const total = rewards.reduce((a, b) => a + b, 0);
  const discounted = rewards.reduce((a, b, i) => a + b * domain.discount ** i, 0);
  const end = k === steps ? ` The episode ${episode.ending}.` : "";
  return `Step ${k} of ${steps}. Reward so far ${text(total)}, discounted ${discounted.toFixed(2)}.${end}`;
}

/** A bar for every belief feature; of many, the likeliest few. */
function beliefBars(domain) {
  const list = make("ul", { class: "bars" });
  const remark = make("p", { class: "remark" });
  const element = make("div", { class: "beliefs" }, make("h4", {}, "Belief"), list, remark);
  const rows = domain.features.map((name) => {
    const bar = make("span", { class: "bar" });
    const value = make("span", { class: "value" });
    return { item: make("li", {}, make("span", { class: "name" }, name), make("span", { class: "track" }, bar), value), bar, value };
  });
  return { element, show(policy, episode, k) {
    const over = episode.terminated && k > 0 && k === episode.action.length - 1;
    const beliefs = episode.beliefs[over ? k - 1 : k]; // of a terminal state there is nothing to believe
    let shown = rows.map((_, i) => i);
    if (rows.length > domain.many) {
      shown = shown.filter((i) => beliefs[i] > 0).sort((a, b) => beliefs[b] - beliefs[a] || a - b).slice(0, 6);
    }
    for (const i of shown) {
      rows[i].bar.style.width = `${beliefs[i] / 10}%`;
      rows[i].value.textContent = (beliefs[i] / 1000).toFixed(2);
    }
    list.replaceChildren(...shown.map((i) => rows[i].item));
    remark.textContent = policy.uses_belief ? "" : "This policy does not look at the belief.";
  } };
}

/** The program's lines, the one that the step's action came from marked, and in view. */
function programLines() {
  const list = make("ol", { class: "lines", tabindex: 0, "aria-label": "Program" });
  const element = make("div", { class: "running" }, make("h4", {}, "Program"), list);
  return { element, choose(lines) {
    element.hidden = !lines;
    list.replaceChildren(...(lines ?? []).map((line) => make("li", {}, make("code", {}, line))));
  }, show(episode, k) {
    if (element.hidden) return;
    list.querySelector("[aria-current]")?.removeAttribute("aria-current");
    const now = list.children[episode.line[k]];
    now?.setAttribute("aria-current", "true");
    list.scrollTop = now ? now.offsetTop - (list.clientHeight - now.offsetHeight) / 2 : 0;
  } };
}

/** What was true all along: shown when the episode is over, for no policy ever sees it. */
function hiddenState(domain) {
  const cell = (name, content) => make(name, name === "th" ? { scope: "row" } : {}, content);
  const head = make("tr", {}, ...["", "at the start", "at the end"].map((word) => make("th", { scope: "col" }, word)));
  const rows = make("tbody");
  const table = make("table", {}, make("caption", {}, "What was true. The policy never saw this."), make("thead", {}, head), rows);
  const before = make("p", { class: "remark" }, "It is shown at the last step. The policy never sees it.");
  const element = make("div", { class: "truth" }, make("h4", {}, "True hidden state"), before, table);
  return { element, show({ hidden }, over) {
    table.hidden = !over;
    before.hidden = over;
    rows.replaceChildren(...domain.factors.map((factor, i) => make("tr", {},
      cell("th", factor), cell("td", hidden.start[i]), cell("td", hidden.end[i]))));
  } };
}
