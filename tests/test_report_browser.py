"""The report in a real browser: a headless Chromium that selenium drives."""

from __future__ import annotations

import json
import shutil

import pandas as pd
import pytest

import harness
from harness import policy
from harness.report.replays import episode
from harness.show import replay as show

webdriver = pytest.importorskip("selenium.webdriver", reason="no selenium: pip install -e '.[browser]'")

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
BROWSER = next(filter(None, map(shutil.which, BROWSERS)), None)
DRIVER = shutil.which("chromedriver")
if not (BROWSER and DRIVER):
    pytest.skip("no Chromium with its chromedriver here", allow_module_level=True)

from selenium.webdriver.common.keys import Keys  # noqa: E402  (only where there is selenium)
from selenium.webdriver.support.ui import Select, WebDriverWait  # noqa: E402

WIDE, PHONE = (1000, 800), (360, 740)
HOSTILE = "</script><script>window.hacked = 1</script><img src=x onerror='window.hacked = 1'>"

# Longer than the player shows at a time; its first number is there to be tuned.
PROGRAM = "check(4)\nif(belief(4) > 0.02) {\n" + "    right()\n" * 6 + "    sample()\n}\n"
PROGRAM += "if(belief(5) > 0.5 and belief(6) > 0.5 or belief(7) > 0.5) check(1)\n" + "up()\n" * 3 + "right()\n" * 7
TUNED = 6  # its player's place on the page

# WCAG 2 contrast of every text on the page with what lies behind it: of HTML the nearest background, of text in a
# drawing the shape that it stands on.
CONTRASTS = """
const canvas = new OffscreenCanvas(1, 1).getContext('2d', { willReadFrequently: true });
const rgba = (css) => {
  canvas.clearRect(0, 0, 1, 1);
  canvas.fillStyle = css;
  canvas.fillRect(0, 0, 1, 1);
  const [r, g, b, a] = canvas.getImageData(0, 0, 1, 1).data;
  return [r, g, b, a / 255];
};
const over = (top, below) => [0, 1, 2].map((k) => top[k] * top[3] + below[k] * (1 - top[3])).concat(1);
const luminance = (c) => [0.2126, 0.7152, 0.0722].reduce((sum, w, k) => {
  const v = c[k] / 255;
  return sum + w * (v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4);
}, 0);
const behind = (element) => {
  for (let e = element; e; e = e.parentElement) {
    const colour = rgba(getComputedStyle(e).backgroundColor);
    if (colour[3] > 0) return colour[3] === 1 ? colour : over(colour, behind(e.parentElement));
  }
  return rgba('white');
};
const shape = (text) => {
  const own = text.parentElement.matches('.rock, .robot') && !text.matches('.tag')
    ? text.parentElement.querySelector('circle, rect')
    : text.matches('.probability') ? text.previousElementSibling : null;
  const base = behind(text);
  if (!own) return base;
  const style = getComputedStyle(own);
  const fill = rgba(style.fill);
  return over([fill[0], fill[1], fill[2], fill[3] * Number(style.fillOpacity)], base);
};
const found = [];
const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
while (walker.nextNode()) {
  const [node, element] = [walker.currentNode, walker.currentNode.parentElement];
  if (!node.data.trim() || element.closest('script, noscript, :disabled') || !element.checkVisibility()) continue;
  const style = getComputedStyle(element);
  const drawn = element instanceof SVGElement;
  const below = drawn ? shape(element) : behind(element);
  const ink = over(rgba(drawn ? style.fill : style.color), below);
  const [high, low] = [luminance(ink), luminance(below)].sort((a, b) => b - a);
  found.push([(high + 0.05) / (low + 0.05), node.data.trim().slice(0, 40), element.getAttribute('class') ?? '']);
}
return found;
"""


@pytest.fixture(scope="module")
def driver():
    options = webdriver.ChromeOptions()
    options.binary_location = BROWSER
    for argument in ("--headless=new", "--no-sandbox", "--disable-dev-shm-usage"):
        options.add_argument(argument)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    made = webdriver.Chrome(options=options, service=webdriver.ChromeService(DRIVER))
    yield made
    made.quit()


@pytest.fixture(scope="module")
def address(report_inputs, tmp_path_factory):
    """A page of everything, with a policy whose name is markup."""
    folder = tmp_path_factory.mktemp("browser")
    table = pd.DataFrame(json.loads(report_inputs["rocks.json"].read_text()))
    hostile = table.iloc[[2]].assign(policy=HOSTILE)
    pd.concat([table, hostile]).to_json(folder / "rocks.json", orient="records")
    kinds = ("border.csv", "hidden.csv", "run", "runs", "tuning", "sweep")
    sweep = pd.read_csv(report_inputs["sweep"] / "sweep.csv").rename(columns={"threshold": HOSTILE})
    sweep.to_csv(folder / "sweep.csv", index=False)
    few = {"episodes": 20, "validation_episodes": 100, "final_episodes": 100, "engine": "tables"}
    harness.tune("rocksample-7x8", PROGRAM, method="lines", out=folder / "tuned", **few)
    sources = [folder / "rocks.json", *(report_inputs[kind] for kind in kinds), folder / "sweep.csv", folder / "tuned"]
    path = harness.write_report(sources, folder, episodes=2)
    return path.as_uri()


@pytest.fixture
def page(driver, address):
    """The page, freshly loaded in a wide window and a light scheme; afterwards nothing may be on the console."""
    look(driver)
    for kind in ("browser", "performance"):
        driver.get_log(kind)
    driver.get(address)
    yield driver
    assert driver.get_log("browser") == []


def look(driver, size=WIDE, scheme="light", motion="no-preference"):
    width, height = size
    metrics = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 500}
    driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
    features = {"prefers-color-scheme": scheme, "prefers-reduced-motion": motion}
    media = [{"name": name, "value": value} for name, value in features.items()]
    driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": media})


def find(where, selector):
    return where.find_elements("css selector", selector)


def texts(where, selector):
    """Of all elements that match, in one call to the browser."""
    script = "return [...arguments[0].querySelectorAll(arguments[1])].map((e) => e.textContent)"
    return where.parent.execute_script(script, where, selector)


def player(page, k=0):
    """The k-th player, in view and with the focus."""
    place = find(page, ".player")[k]
    page.execute_script("arguments[0].scrollIntoView({block: 'center'}); arguments[0].focus()", place)
    return place


def line(place):
    return find(place, ".happened")[0].text


def press(page, *keys):
    webdriver.ActionChains(page).send_keys(*keys).perform()


def click(place, label):
    find(place, f'button[aria-label="{label}"]')[0].click()


def sentences(name, spec, seed=4, episode=0):
    """What the player should say, step by step, from the text replay's own source."""
    known = harness.load(name)
    made = policy.make(spec, known)[1]
    return [step.sentence for step in show.steps(known, made, "tables", seed, episode, 50)]


class TestLoading:
    def test_nothing_is_requested_and_nothing_injected_runs(self, page):
        requests = [json.loads(entry["message"])["message"] for entry in page.get_log("performance")]
        urls = [r["params"]["request"]["url"] for r in requests if r["method"] == "Network.requestWillBeSent"]
        assert urls[0] == page.current_url
        assert [url for url in urls[1:] if not url.startswith("data:")] == []
        assert page.execute_script("return window.hacked") is None
        assert any(HOSTILE in cell.text for cell in find(page, "tbody th"))

    def test_everything_is_drawn(self, page):
        assert len(find(page, ".chart svg[tabindex]")) == len(find(page, ".chart")) == 12
        assert len(find(page, ".comparison .levels")) == len(find(page, ".comparison")) == 6
        assert len(find(page, ".player .buttons")) == 7
        assert len(find(page, ".player .board")) == 7

    def test_it_adds_no_globals(self, page):
        page.execute_script("window.before = null; document.body.append(document.createElement('iframe'))")
        own = "const plain = new Set(Object.getOwnPropertyNames(frames[0]));"
        names = page.execute_script(own + "return Object.getOwnPropertyNames(window).filter((n) => !plain.has(n))")
        assert "before" in names  # the list does find what was added
        assert not {"make", "draw", "player", "chart", "sortable", "dataOf", "CELL"} & set(names)

    @pytest.mark.parametrize("scheme", ["light", "dark"])
    def test_a_phone_scrolls_down_only(self, page, scheme):
        look(page, PHONE, scheme)
        page.refresh()
        page.execute_script("document.querySelectorAll('details').forEach((each) => { each.open = true; })")
        sizes = page.execute_script("return [document.scrollingElement.scrollWidth, innerWidth]")
        assert sizes == [360, 360]
        widths = page.execute_script("return [...document.querySelectorAll('.canvas')].map((c) => c.clientWidth)")
        assert all(0 < width < 360 for width in widths)
        drawn = page.execute_script("return [...document.querySelectorAll('.canvas > svg')].map((s) => s.clientWidth)")
        assert drawn == widths  # drawn for this width, not shrunk

    @pytest.mark.parametrize("width", [320, 390])
    def test_on_a_phone_nothing_is_cut_off(self, page, width):
        """Nothing sticks out, or has to be scrolled sideways, also with names of 90 characters in it."""
        look(page, (width, 844))
        page.refresh()
        page.execute_script("document.querySelectorAll('details').forEach((each) => { each.open = true; })")
        for k in range(7):
            player(page, k)
            press(page, Keys.END)
        cut = """return [...document.querySelectorAll('main *')].filter((e) => e.checkVisibility() && !e.closest('svg'))
            .filter((e) => e.getBoundingClientRect().right > innerWidth
                || (getComputedStyle(e).overflowX !== 'visible' && e.scrollWidth > e.clientWidth))
            .map((e) => e.outerHTML.slice(0, 80))"""
        assert page.execute_script(cut) == []
        (table,) = find(page, "table.sortable")[:1]
        row = find(table, "tbody tr")[1]
        names = page.execute_script("return [...arguments[0].cells].map((c) => c.dataset.name)", row)
        assert names == ["policy", "return", "discounted", "of optimum", "published", "steps", "success", "episodes"]
        find(table, "thead button")[1].click()
        assert texts(table, "tbody tr > :first-child")[0] == "mdp (upper bound)"

    @pytest.mark.parametrize("scheme", ["light", "dark"])
    def test_text_can_be_read_in_both_schemes(self, page, scheme):
        look(page, WIDE, scheme)
        page.refresh()
        page.execute_script("document.querySelectorAll('details').forEach((each) => { each.open = true; })")
        for k in range(3):  # some way into an episode there are beliefs of all kinds
            player(page, k)
            press(page, *[Keys.ARROW_RIGHT] * 9)
        contrasts = page.execute_script(CONTRASTS)
        assert len(contrasts) > 500
        assert {"name", "value", "probability"} <= {kind for _, _, kind in contrasts}
        assert [each for each in contrasts if each[0] < 4.5] == []
        background = page.execute_script("return getComputedStyle(document.body).backgroundColor")
        assert (background == "rgb(16, 19, 23)") == (scheme == "dark")


class TestTable:
    def column(self, page, k=0):
        return texts(find(page, "table.sortable")[0], f"tbody tr > :nth-child({k + 1})")

    def sort_states(self, page):
        return [h.get_attribute("aria-sort") for h in find(find(page, "table.sortable")[0], "thead th")]

    def test_by_click(self, page):
        buttons = find(find(page, "table.sortable")[0], "thead button")
        assert self.sort_states(page) == [None] * 8
        buttons[1].click()  # return: the best first
        assert self.column(page)[0] == "mdp (upper bound)"
        values = [float(text.split()[0]) for text in self.column(page, 1)]
        assert values == sorted(values, reverse=True)
        assert self.sort_states(page) == [None, "descending", *[None] * 6]
        buttons[1].click()
        values = [float(text.split()[0]) for text in self.column(page, 1)]
        assert values == sorted(values)
        assert self.sort_states(page)[1] == "ascending"
        buttons[0].click()
        assert self.sort_states(page) == ["ascending", *[None] * 7]
        assert self.column(page)[1:] == ["belief:0.84", "exit", "mdp (upper bound)", "sarsop"]

    def test_what_has_no_value_comes_last_either_way(self, page):
        button = find(find(page, "table.sortable")[0], "thead button")[4]
        for _ in range(2):
            button.click()
            assert self.column(page, 4) == ["21.39", "", "", "", ""]

    def test_by_keyboard(self, page):
        region = find(page, ".scroll")[0]
        page.execute_script("arguments[0].focus()", region)
        press(page, Keys.TAB, Keys.TAB, Keys.ENTER)
        assert self.sort_states(page)[1] == "descending"
        press(page, Keys.SPACE)
        assert self.sort_states(page)[1] == "ascending"
        assert page.switch_to.active_element.text.startswith("return")
        assert page.execute_script("return getComputedStyle(document.activeElement).outlineStyle") == "solid"

    def test_numbers_stand_to_the_right_and_bounds_are_marked(self, page):
        table = find(page, "table.sortable")[0]
        assert {cell.value_of_css_property("text-align") for cell in find(table, "tbody td")} == {"right"}
        (bound,) = find(table, "tr.bound td:nth-child(2)")
        usual = find(table, "tbody tr:first-child td")[0]
        assert bound.value_of_css_property("background-color") != usual.value_of_css_property("background-color")


class TestBars:
    def test_they_are_as_long_as_the_returns(self, page, report_inputs):
        table = pd.read_csv(report_inputs["rocks.csv"])
        figure = find(page, ".comparison")[0]
        assert texts(figure, ".name") == [*table["policy"][:3], "mdp (upper bound)", HOSTILE]
        widths = "return [...arguments[0].querySelectorAll(arguments[1])].map((e) => e.getBoundingClientRect().width)"
        long = page.execute_script(widths, figure, ".length")
        per_unit = long[0] / table["mean"][0]
        assert long[:4] == pytest.approx([per_unit * x for x in table["mean"]], rel=1e-3)
        intervals = page.execute_script(widths, figure, ".interval")
        half = 1.959964 * table["sem"][table["sem"] > 0]
        assert intervals == pytest.approx([2 * per_unit * x for x in half], rel=1e-3)
        assert texts(figure, ".value")[:1] == [f"{table['mean'][0]:.2f} ± {table['sem'][0]:.2f}"]

    def test_they_are_read_as_a_list(self, page):
        labels = [element.get_attribute("aria-label") for element in find(page, ".levels")]
        assert labels[:2] == ["Return, undiscounted return (reward)", "Discounted return, discounted return (reward)"]
        assert {level.get_attribute("aria-hidden") for level in find(page, ".level")} == {"true"}


class TestPlayer:
    def test_keys_tell_the_whole_episode(self, page):
        place = player(page)
        told = sentences("rocksample-7x8", "belief:0.84")
        assert line(place) == told[0]
        for sentence in told[1:]:
            place.send_keys(Keys.ARROW_RIGHT)
            assert line(place) == sentence
        press(page, Keys.ARROW_RIGHT)
        assert line(place) == told[-1]
        assert find(place, ".sum")[0].text.endswith("The episode reached a terminal state.")
        press(page, Keys.ARROW_LEFT)
        assert line(place) == told[-2]
        press(page, Keys.HOME)
        assert line(place) == told[0]
        press(page, Keys.END)
        assert line(place) == told[-1]

    def test_buttons(self, page):
        place = player(page)
        told = sentences("rocksample-7x8", "belief:0.84")
        for label, k in (
            ("Step forward", 1),
            ("Step forward", 2),
            ("Step back", 1),
            ("Last step", -1),
            ("First step", 0),
        ):
            click(place, label)
            assert line(place) == told[k]
        assert not find(place, 'button[aria-label="Step back"]')[0].is_enabled()
        assert all(button.get_attribute("aria-label") for button in find(place, ".buttons button"))

    def test_the_slider(self, page):
        place = player(page)
        slider = find(place, "input[type=range]")[0]
        told = sentences("rocksample-7x8", "belief:0.84")
        page.execute_script("arguments[0].focus()", slider)
        press(page, Keys.ARROW_RIGHT, Keys.ARROW_RIGHT)
        assert line(place) == told[2]
        press(page, Keys.END)
        assert line(place) == told[-1]
        assert slider.get_attribute("aria-valuetext") == f"step {len(told) - 1} of {len(told) - 1}"

    def test_playing_and_pausing(self, page):
        place = player(page)
        told = sentences("rocksample-7x8", "belief:0.84")
        press(page, Keys.SPACE)
        assert find(place, ".happened")[0].get_attribute("aria-live") == "off"
        WebDriverWait(page, 20).until(lambda _: line(place) == told[2])
        click(place, "Pause")
        assert find(place, ".happened")[0].get_attribute("aria-live") == "polite"
        assert line(place) in told[2:]
        press(page, Keys.END, Keys.ARROW_LEFT)
        click(place, "Play")  # at the end it stops by itself
        WebDriverWait(page, 20).until(lambda _: find(place, 'button[aria-label="Play"]'))
        assert line(place) == told[-1]

    def test_speed(self, page):
        place = player(page)
        page.execute_script(
            "window.setInterval = (tick, wait) => { window.wait = wait; window.tick = tick; return 1; }"
        )
        speed = Select(next(s for s in find(place, "select") if "½×" in s.text))
        assert [option.text for option in speed.options] == ["½×", "1×", "2×", "4×"]
        waits = []
        for name in (None, "4×", "½×"):
            if name:
                speed.select_by_visible_text(name)  # while it plays
            else:
                click(place, "Play")
            waits.append(page.execute_script("return window.wait"))
        assert waits == [700, 175, 1400]
        page.execute_script("window.tick()")
        assert line(place) == sentences("rocksample-7x8", "belief:0.84")[1]
        click(place, "Pause")
        page.execute_script("window.wait = null")
        speed.select_by_visible_text("1×")
        assert page.execute_script("return window.wait") is None  # does not start it

    def test_the_line_of_a_program(self, page):
        place = player(page, TUNED)
        lines = texts(place, ".lines li")
        assert lines[:1] == ["check(4)"]
        assert len(lines) == PROGRAM.count("\n")
        assert texts(place, '.lines [aria-current="true"]') == []
        for k in range(1, 1 + int(find(place, "input[type=range]")[0].get_attribute("max"))):
            place.send_keys(Keys.ARROW_RIGHT)
            (now,) = find(place, '.lines [aria-current="true"]')
            assert line(place).startswith(f"step {k}: {now.text.split()[-1]}")
            inside = """const [line, box] = [...arguments].map((e) => e.getBoundingClientRect());
                return line.top >= box.top - 1 && line.bottom <= box.bottom + 1"""
            assert page.execute_script(inside, now, find(place, ".lines")[0])
        policies = Select(find(place, "select")[0])
        assert [option.text for option in policies.options] == ["the result", "the start"]
        policies.select_by_visible_text("the start")
        assert "if(belief(4) > 0.02) {" in texts(place, ".lines li")

    def test_other_policies_have_no_lines(self, page):
        assert not find(player(page), ".running")[0].is_displayed()

    def test_what_was_true_is_shown_at_the_end_only(self, page):
        place = player(page)
        (truth,) = find(place, ".truth")
        for key, shown in ((Keys.HOME, False), (Keys.ARROW_RIGHT, False), (Keys.END, True), (Keys.ARROW_LEFT, False)):
            press(page, key)
            assert find(truth, "table")[0].is_displayed() == shown
            assert "policy never" in truth.text
        press(page, Keys.END)
        rows = [row.text.split() for row in find(truth, "tbody tr")]
        assert [row[:2] for row in rows] == [["rock", str(i)] for i in range(1, 9)]
        known = harness.load("rocksample-7x8")
        true = episode(known, policy.make("belief:0.84", known)[1], 4, 0, 50)["hidden"]
        assert [row[2:] for row in rows] == [list(pair) for pair in zip(true["start"], true["end"], strict=True)]
        assert len(find(player(page, 1), ".truth")) == 0  # nothing is hidden there
        press(page, Keys.END)

    def test_choosing_policy_and_episode(self, page):
        place = player(page)
        policies, episodes = (Select(element) for element in find(place, ".choice select"))
        assert [option.text for option in policies.options] == ["belief:0.84", "sarsop", "exit"]
        policies.select_by_visible_text("sarsop")
        episodes.select_by_index(1)
        told = sentences("rocksample-7x8", "sarsop", episode=1)
        assert find(place, "label span")[1].text == "Episode of seed 4"
        player(page)
        press(page, Keys.END)
        assert line(place) == told[-1]
        find(place, "summary")[0].click()
        assert texts(place, "ol li") == told
        assert texts(place, '[aria-current="step"]') == told[-1:]

    def test_rocks_show_their_beliefs_in_colour_and_number(self, page):
        place = player(page)
        colours = {}
        for _ in range(12):
            values = texts(place, ".rock .value")
            style = "return [...arguments[0].querySelectorAll('.rock circle')].map((e) => getComputedStyle(e).fill)"
            fills = page.execute_script(style, place)
            assert texts(place, ".rock .name") == [str(i) for i in range(1, 9)]
            assert values == texts(place, ".bars .value")
            colours |= dict(zip(values, fills, strict=True))
            place.send_keys(Keys.ARROW_RIGHT)
        assert len(set(colours.values())) > 3
        assert colours["0.50"] == "rgb(225, 225, 225)"
        assert texts(place, ".swatch") == ["0.00", "0.25", "0.50", "0.75", "1.00"]

    def test_the_robot_goes_where_the_episode_goes(self, page):
        place = player(page)
        Select(find(place, "select")[0]).select_by_visible_text("exit")
        player(page)
        xs = []
        for _ in range(8):
            xs.append(page.execute_script("return arguments[0].style.transform", find(place, ".robot")[0]))
            place.send_keys(Keys.ARROW_RIGHT)
        at = [float(x.split("(")[1].split("px")[0]) for x in xs]
        assert [x - 24 for x in at[:6]] == [0, 48, 96, 144, 192, 240]
        assert at[7] - 24 == 7 * 48  # in the exit's column

    def test_border_cross_has_both_robots_and_hidden_ones_as_heat(self, page):
        both, hidden = player(page, 1), player(page, 2)
        assert sorted(text.text for text in find(both, ".robot text")) == ["1", "2"]
        assert len(find(both, ".wall")) == len(find(both, ".board .exit")) == 7
        assert [text.text for text in find(hidden, ".robot text")] == ["1"]
        cells = find(hidden, ".heat")
        assert len(cells) == 42
        opacity = [float(cell.get_attribute("style").split(":")[1].strip(" ;")) ** 2 for cell in cells]
        assert sum(opacity) == pytest.approx(1, abs=0.03)
        press(page, Keys.END)
        assert line(hidden) == sentences("bordercross-7x8-random", "sarsop")[-1]

    def test_less_motion_where_it_is_asked_for(self, page):
        robot = find(player(page), ".robot")[0]
        assert robot.value_of_css_property("transition-duration") == "0.25s"
        look(page, motion="reduce")
        assert robot.value_of_css_property("transition-duration") == "0s"


class TestCharts:
    def chart(self, page, title):
        figure = next(f for f in find(page, ".chart") if find(f, "figcaption")[0].text == title)
        page.execute_script("arguments[0].scrollIntoView({block: 'center'})", figure)
        return figure, find(figure, ".canvas svg")[0], find(figure, ".readout")[0]

    def test_values_are_read_by_keyboard(self, page, report_inputs):
        history = pd.read_csv(report_inputs["run"] / "history.csv")
        _, svg, readout = self.chart(page, "Learning curve")
        page.execute_script("arguments[0].focus()", svg)
        press(page, Keys.HOME, Keys.ARROW_RIGHT)
        assert readout.text.startswith("generation 1: fitness of the best, as selection saw it ")
        for column in ("best", "test"):
            assert f" {history[column][1]:.2f}" in readout.text
        press(page, Keys.END)
        assert readout.text.startswith("generation 3: ")

    def test_values_are_read_by_pointer(self, page, report_inputs):
        sweep = pd.read_csv(report_inputs["sweep"] / "sweep.csv")
        _, svg, readout = self.chart(page, "Return")
        best = sweep.iloc[sweep["mean"].idxmax()]
        assert readout.text.startswith(f"Highest: threshold (no unit) {best['threshold']:g}")
        left = -svg.size["width"] // 2 + 70
        webdriver.ActionChains(page).move_to_element_with_offset(svg, left, 0).perform()
        assert readout.text.startswith("threshold (no unit) 0.5: mean")
        assert f"{sweep['mean'][0]:.2f}" in readout.text
        assert len(find(svg, ".cursor circle")) == 1

    def test_axes_have_labels_and_numbers(self, page):
        for figure in find(page, ".chart"):
            words = texts(figure, ".canvas text")
            assert len([word for word in words if word.replace(".", "").replace("-", "").isdigit()]) >= 5
            assert [word for word in words if "return (reward)" in word or "(no unit)" in word]

    def test_every_place_is_a_number(self, page):
        for svg in find(page, ".canvas > svg"):
            drawing = svg.get_attribute("outerHTML")
            assert "<polyline" in drawing or 'class="dot"' in drawing
            assert "NaN" not in drawing


def test_a_program_is_copied(page, report_inputs):
    page.execute_cdp_cmd("Browser.grantPermissions", {"permissions": ["clipboardReadWrite", "clipboardSanitizedWrite"]})
    place = find(page, ".program")[0]
    button = find(place, "button")[0]
    page.execute_script("arguments[0].scrollIntoView({block: 'center'})", button)
    button.click()
    WebDriverWait(page, 20).until(lambda _: button.text in ("Copied", "Selected"))
    selected = page.execute_script("return getSelection().toString()")
    copied = page.execute_async_script("navigator.clipboard.readText().then(arguments[0], () => arguments[0](null))")
    text = (report_inputs["run"] / "best.txt").read_text().rstrip("\n")
    assert text == (copied if button.text == "Copied" else selected)
