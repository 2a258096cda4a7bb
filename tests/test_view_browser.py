"""The page in a real browser: one drags the hand into the wall, breaks it, and makes it safe."""

import os
import re
import shutil
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from live_page import TWO_HANDS, pointed
from selenium import webdriver
from selenium.webdriver import Keys
from selenium.webdriver.support import ui
from waiting import TIMEOUT

import forcebound as fb

CHROMIUM, DRIVER = shutil.which("chromium"), shutil.which("chromedriver")
QUIET = (
    "--headless=new", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
    "--disable-background-networking", "--disable-component-update", "--disable-sync",
    "--disable-renderer-backgrounding",
    "--window-size=1400,1000",
)  # fmt: skip

KEEP_SOCKETS = """
window.sockets = [];
const Plain = WebSocket;
window.WebSocket = class extends Plain {
  constructor(...words) { super(...words); window.sockets.push(this); }
};
"""

RUNNING = ("passive", "late")  # states of a graph that runs under a law

LOSE_FETCHES = """
window.lost = 0;
window.isLost = true;
const plain = window.fetch;
window.fetch = (...words) => {
  if (!window.isLost) return plain(...words);
  window.lost += 1;
  return Promise.reject(new TypeError("lost"));
};
"""

pytestmark = [
    pytest.mark.live,
    pytest.mark.xdist_group("processes"),
    pytest.mark.skipif(not (CHROMIUM and DRIVER), reason="needs Debian's chromium-driver"),
]


@contextmanager
def browser() -> Iterator[Any]:
    options = webdriver.ChromeOptions()
    options.binary_location = str(CHROMIUM)
    for word in QUIET:
        options.add_argument(word)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    with tempfile.TemporaryDirectory(prefix="fb-", dir="/tmp", ignore_cleanup_errors=True) as own:
        variables = {**os.environ, "TMPDIR": own, "XDG_RUNTIME_DIR": own, "HOME": own}
        service = webdriver.ChromeService(DRIVER, env=variables)
        driver = webdriver.Chrome(options=options, service=service)
        try:
            yield driver
        finally:
            driver.quit()


class Visitor:
    """Somebody in front of a browser."""

    def __init__(self, driver: Any) -> None:
        self.driver = driver

    def figure(self, name: str) -> float:
        """A figure as the page shows it; nan: there is none."""
        pairs = self.driver.execute_script(
            "return [...document.querySelectorAll('#figures > div')]"
            ".map((pair) => [...pair.children].map((one) => one.textContent))"
        )
        words = dict(pairs).get(name, "nan").split()[0]
        return float("nan") if words == "–" else float(words)

    def text(self, name: str) -> str:
        text: str = self.driver.find_element("id", name).text
        return text

    @property
    def state(self) -> str:
        """The kind of the state that the page shows."""
        state: str = self.driver.execute_script("return document.body.dataset.state")
        return state

    @property
    def energies(self) -> tuple[float, float]:
        """The range of the plot of the energy, in mJ."""
        plot = "import('./app.js').then(({ plots: [, , energy] }) => [energy.low, energy.high])"
        low, high = self.driver.execute_script(f"return {plot}")
        return low, high

    def drag(self, way: float) -> None:
        """Drag the hand to the right, by a share of the width of the scene."""
        scene = self.driver.find_element("id", "scene")
        pixels = round(way * scene.rect["width"] / 2)
        drag = webdriver.ActionChains(self.driver).move_to_element(scene).click_and_hold()
        drag.move_by_offset(pixels, 0).move_by_offset(pixels, 0).release().perform()

    def mouse(self, kind: str, way: float = 0.0) -> None:
        """Send a mouse event to the scene, some share of its width right of its middle."""
        scene = self.driver.find_element("id", "scene").rect
        x, y = scene["x"] + (0.5 + way) * scene["width"], scene["y"] + scene["height"] / 2
        event = {"type": kind, "x": x, "y": y, "button": "left", "buttons": 1, "clickCount": 1}
        self.driver.execute_cdp_cmd("Input.dispatchMouseEvent", event)

    def until(self, happened: Callable[[], object]) -> None:
        ui.WebDriverWait(self.driver, TIMEOUT, 0.1).until(lambda _: happened())

    def open(self, address: str) -> None:
        self.driver.get(address)
        self.until(lambda: self.state in RUNNING)

    def open_beside(self, address: str) -> None:
        self.driver.switch_to.new_window("window")
        self.open(address)

    def value(self, name: str) -> str:
        value: str = self.driver.find_element("name", name).get_property("value")
        return value

    def enter(self, name: str, value: str) -> None:
        """Write a value into the field of a parameter."""
        field = self.driver.find_element("name", name)
        field.clear()
        field.send_keys(value + Keys.TAB)

    def slide(self, name: str, shown: str) -> None:
        """Move the slider of a parameter by one step, until the page shows the new value."""
        self.driver.find_element("id", f"s-{name}").send_keys(Keys.ARROW_RIGHT)
        self.until(lambda: self.value(name) == shown)

    def touch(self, way: float) -> None:
        """Draw a finger over the scene, some pixels to the right."""
        scene = self.driver.find_element("id", "scene").rect
        x, y = scene["x"] + scene["width"] / 2, scene["y"] + scene["height"] / 2
        places = [x + way * step / 5 for step in range(6)]
        kinds = ["touchStart", *["touchMove"] * 5]
        for kind, place in zip(kinds, places, strict=True):
            points = [{"x": place, "y": y}]
            event = {"type": kind, "touchPoints": points}
            self.driver.execute_cdp_cmd("Input.dispatchTouchEvent", event)
        event = {"type": "touchEnd", "touchPoints": []}
        self.driver.execute_cdp_cmd("Input.dispatchTouchEvent", event)

    def errors(self) -> list[Any]:
        return [line for line in self.driver.get_log("browser") if line["level"] == "SEVERE"]


def test_one_drags_the_hand_into_the_wall_breaks_it_and_makes_it_safe() -> None:
    with pointed() as (graph, (address, _)):
        with browser() as driver:
            visitor = Visitor(driver)
            visitor.open(address)
            visitor.until(lambda: visitor.figure("position") < 0.0)
            visitor.drag(0.35)
            visitor.until(
                lambda: visitor.figure("position") > 10.0 and visitor.figure("applied") > 0.5
            )
            visitor.until(lambda: re.search(r"commands: \w", visitor.text("why")))  # the cause

            driver.find_element("id", "break").click()
            graph.until(lambda: "law: none from now on" in graph.log, "the law to go")
            graph.wait(2.0)
            visitor.until(lambda: visitor.figure("true energy, this law") < -200.0)
            visitor.until(lambda: visitor.state == "not_passive" and visitor.energies[0] < -200.0)
            assert re.search(r"received up to [\d.]+ m?J", visitor.text("why"))
            driver.find_element("id", "safe").click()
            graph.until(lambda: "law: certified from now on" in graph.log, "the law to come back")
            graph.wait(2.0)
            visitor.until(lambda: visitor.state in RUNNING)
            visitor.until(lambda: visitor.energies[0] > -1.0)  # not the scale of the law before
            assert visitor.figure("true energy, this law") >= 0.0
            assert "under none the hand has received" in visitor.text("events")
            laws = driver.find_element("css selector", ".law select")
            assert [one.text for one in laws.find_elements("tag name", "option")] == [
                "certified", "none", "more laws …",
            ]  # fmt: skip
            ui.Select(laws).select_by_value("")
            assert len(laws.find_elements("tag name", "option")) > 5
            assert laws.get_property("value") == "certified"
            visitor.slide("environment.stiffness", "11 N/mm")
            visitor.slide("links.environment_query.delay", "0.5 ms")
            assert visitor.errors() == []
        ended = graph.end()
        columns = ended.columns
        (broken,) = [e for e in ended.events("law_changed") if e.data["law"] == "none"]
        (safe,) = [e for e in ended.events("law_changed") if e.data["law"] == "certified"]

    def swing(start_ns: int, end_ns: int) -> float:
        seen = (columns.time_ns > start_ns) & (columns.time_ns < end_ns)
        return float(np.ptp(columns.true_position[seen, 0]))

    second = 1_000_000_000
    assert swing(broken.time_ns + second, broken.time_ns + 2 * second) > 1e-3  # it bounces
    starts = range(safe.time_ns, int(columns.time_ns[-1]) - second // 2, second // 2)
    # It rests. On a busy machine a late tick drops the force now and then, and it moves.
    assert min(swing(start, start + second // 2) for start in starts) < 2e-4


def is_at_start(visitor: Visitor) -> bool:
    return abs(visitor.figure("position") + 5.0) < 0.2  # mm


def test_two_people_drag_two_hands_at_once(tmp_path: Path) -> None:
    file = tmp_path / "two.yaml"
    file.write_text(TWO_HANDS)
    with pointed(str(file)) as (_, (address, _)), browser() as one, browser() as other:
        left, right = Visitor(one), Visitor(other)
        for visitor, hand in ((left, "left"), (right, "right")):
            visitor.open(f"{address}&hand={hand}")
            visitor.until(partial(is_at_start, visitor))
            visitor.mouse("mousePressed")
        left.mouse("mouseMoved", -0.2)
        left.until(lambda: left.figure("position") < -10.0)
        assert is_at_start(right)
        right.mouse("mouseMoved", 0.2)
        right.until(lambda: right.figure("position") > 5.0)
        assert left.figure("position") < -10.0
        left.mouse("mouseMoved", 0.0)
        right.mouse("mouseMoved", -0.1)
        left.until(lambda: left.figure("position") > -10.0)
        right.until(lambda: right.figure("position") < -5.0)
        assert {line.split()[0] for line in left.text("each").split("\n")} >= {"left", "right"}
        assert left.errors() == right.errors() == []


@pytest.mark.slow  # runs in `make browser`
def test_two_pages_keys_fingers_wrong_values_and_a_lost_connection() -> None:
    with pointed() as (graph, (address, watching)), browser() as driver:
        driver.execute_cdp_cmd("Page.addScriptToEvaluateOnNewDocument", {"source": KEEP_SOCKETS})
        visitor = Visitor(driver)
        visitor.open(address)
        first = driver.current_window_handle

        # A key moves the hand by 1 mm, a finger further; the figures are rounded.
        visitor.until(lambda: abs(visitor.figure("position") + 5.0) < 0.2)
        scene = driver.find_element("id", "scene")
        scene.send_keys(Keys.ARROW_RIGHT * 2)
        visitor.until(lambda: abs(visitor.figure("position") + 3.0) < 0.3)

        # A mouse that has lost its capture, from whatever cause, drags no more.
        webdriver.ActionChains(driver).move_to_element(scene).click_and_hold().perform()
        driver.execute_script("document.getElementById('scene').releasePointerCapture(1)")
        webdriver.ActionChains(driver).move_by_offset(-100, 0).release().perform()
        visitor.touch(300.0)
        visitor.until(lambda: visitor.figure("position") > 5.0)

        # An error is shown beside the field; a valid value is taken, with its unit.
        visitor.enter("environment.stiffness", "-1 N/mm")
        fault = "f-environment.stiffness"
        visitor.until(lambda: "must be >= 0 N/m" in visitor.text(fault))
        visitor.enter("environment.stiffness", "3 N/mm")
        visitor.until(lambda: visitor.text(fault) == "" and "stiffness = 3 N/mm" in graph.log)

        # A page for an audience shows the change, and can change nothing.
        visitor.open_beside(watching)
        visitor.until(lambda: visitor.value("environment.stiffness") == "3 N/mm")
        enabled = "return document.querySelectorAll('.changes :enabled').length"
        assert driver.execute_script(enabled) == 0
        assert driver.execute_script(
            "return document.querySelectorAll('.changes :disabled').length"
        )
        driver.close()
        driver.switch_to.window(first)

        # A page whose connection is lost says so, and comes back by itself.
        driver.find_element("tag name", "summary").click()
        driver.execute_script("window.sockets.at(-1).close()")
        visitor.until(lambda: driver.execute_script("return window.sockets.length") == 2)
        visitor.until(lambda: visitor.state in RUNNING)
        assert driver.execute_script(enabled) > 0
        assert driver.execute_script("return document.querySelector('details').open")  # as it was

        # A node stops and starts from the page, by the keyboard.
        driver.execute_script("document.querySelectorAll('details').forEach((d) => d.open = true)")
        visitor.until(lambda: visitor.text("node-environment") == "stop")
        driver.find_element("id", "node-environment").send_keys(Keys.ENTER)
        visitor.until(lambda: visitor.text("node-environment") == "start")
        driver.find_element("id", "node-environment").send_keys(Keys.ENTER)
        visitor.until(lambda: visitor.text("node-environment") == "stop")
        assert visitor.errors() == []
        graph.end()
        visitor.until(lambda: visitor.state == "away")
        assert driver.execute_script(enabled) == 0


@pytest.mark.slow  # runs in `make browser`
def test_a_mesh_that_does_not_come_is_fetched_again_and_until_then_the_page_says_so() -> None:
    with pointed("pointer_rabbit") as (graph, (address, _)), browser() as driver:
        driver.execute_cdp_cmd("Page.addScriptToEvaluateOnNewDocument", {"source": LOSE_FETCHES})
        visitor = Visitor(driver)
        visitor.open(address)
        visitor.until(lambda: "loading" in visitor.text("note"))
        visitor.until(lambda: driver.execute_script("return window.lost") > 1)
        assert "loading" in visitor.text("note")
        driver.execute_script("window.isLost = false")
        visitor.until(lambda: "loading" not in visitor.text("note"))
        graph.end()


# What draws a scene that stands still, without a graph: the pixel of a place in the view.
PAINT = """
const { Scene } = await import("./scene.js");
const stage = document.querySelector(".stage");
stage.style.cssText = "position: fixed; left: 0; top: 0; width: 400px; height: 400px";
const canvas = document.createElement("canvas");
canvas.id = "scene";
stage.replaceChildren(canvas);
const scene = new Scene(canvas, () => {});
scene.begin({ axes: 3, hands: [{ name: "hand", pointer: null }] });
Object.assign(scene, { isCentred: true, centre: [0.01, 0.02, 0.03], wall: null, objects: [
  { shape: "sphere", size: [0.02], position: [0.03, 0, 0.04], is_fixed: true },
  { shape: "box", size: [0.01, 0.01, 0.01], position: [-0.02, 0.03, 0.02], is_fixed: true }] });
scene.draw(true);
const is = (place) => {
  const [x, y] = scene.project(place), ratio = canvas.width / canvas.getBoundingClientRect().width;
  return canvas.getContext("2d").getImageData(x * ratio, y * ratio, 1, 1).data[3] > 128;
};
const { right, up } = scene.basis, ends = [right, up].flatMap((way) => [way, way.map((x) => -x)]);
const along = (way, far) => way.map((x, i) => [0.03, 0, 0.04][i] + far * x);
return { isCarded: scene.isCarded, box: is([-0.02, 0.03, 0.02]),
  inside: ends.map((way) => is(along(way, 0.0185))),
  outside: ends.map((way) => is(along(way, 0.0215))) };
"""
AS_CARD = """
const plain = WebGL2RenderingContext.prototype.getParameter;
WebGL2RenderingContext.prototype.getParameter = function (name) {
  const value = plain.call(this, name);
  return typeof value === "string" ? "card" : value;
};
"""


@pytest.mark.slow  # runs in `make browser`
@pytest.mark.parametrize("is_carded", [True, False])
def test_an_object_is_drawn_where_its_packet_says_with_a_graphics_card_and_without(
    is_carded: bool,
) -> None:
    with pointed() as (graph, (address, _)), browser() as driver:
        if is_carded:  # the software of the browser in its place, which the page would not use
            driver.execute_cdp_cmd("Page.addScriptToEvaluateOnNewDocument", {"source": AS_CARD})
        visitor = Visitor(driver)
        visitor.open(address)
        seen = driver.execute_script(PAINT)
        assert seen["isCarded"] is is_carded
        assert seen["box"]
        assert all(seen["inside"])
        assert not any(seen["outside"])
        graph.end()


SAVED = "HTMLAnchorElement.prototype.click = function () { window.saved = this.href; };"
LATEST = "return Number(document.getElementById('scrub').max)"
BACK = """
const scrub = document.getElementById("scrub");
scrub.value = Number(scrub.min) + arguments[0] * (Number(scrub.max) - Number(scrub.min));
scrub.dispatchEvent(new Event("input"));
"""


@pytest.mark.slow  # runs in `make browser`
def test_one_looks_back_saves_a_picture_and_shares_the_layout() -> None:
    with pointed() as (graph, (address, _)), browser() as driver:
        driver.execute_cdp_cmd("Page.addScriptToEvaluateOnNewDocument", {"source": SAVED})
        visitor = Visitor(driver)
        visitor.open(address)
        visitor.until(partial(is_at_start, visitor))
        graph.wait(1.0)
        visitor.drag(0.35)
        visitor.until(lambda: visitor.figure("position") > 10.0)

        def shown() -> Any:
            return driver.execute_script(
                "return import('./app.js').then(({ scene }) => scene.asOf(scene.hands[0]).tip[0])"
            )

        visitor.until(lambda: shown() > 0.010)
        driver.execute_script(BACK, 0.1)
        assert abs(shown() + 0.005) < 2e-4  # where it was at first
        visitor.until(lambda: "s ago" in visitor.text("note"))
        assert visitor.figure("position") > 10.0  # the run goes on
        visitor.until(lambda: driver.execute_script(LATEST) > 10.5)
        driver.execute_script(BACK, 9.5 / driver.execute_script(LATEST))  # as texts 9 is after 10
        visitor.until(lambda: "s ago" in visitor.text("note"))
        driver.execute_script(BACK, 1.0)
        visitor.until(lambda: shown() > 0.010 and "s ago" not in visitor.text("note"))

        driver.find_element("id", "picture").click()
        saved = driver.execute_script("return window.saved")
        assert saved.startswith("data:image/png;base64,")
        assert len(saved) > 10_000

        layout = "return import('./app.js').then(({ scene }) => [scene.half, ...scene.centre])"
        driver.find_element("id", "nearer").click()
        driver.find_element("css selector", "#environment > summary").click()
        visitor.until(lambda: "view=" in driver.current_url)
        visitor.until(lambda: "open=1" in driver.current_url)
        half, centre, *_ = driver.execute_script(layout)
        visitor.open(driver.current_url)
        assert driver.execute_script(layout)[:2] == pytest.approx([half, centre], rel=1e-3)
        assert driver.execute_script("return document.getElementById('environment').open")
        assert visitor.errors() == []


@pytest.mark.slow  # runs in `make browser`
def test_a_cell_of_a_notebook_shows_the_page(tmp_path: Path) -> None:
    with fb.launch("pointer_wall") as graph, browser() as driver:
        cell = tmp_path / "cell.html"
        cell.write_text(f"<!doctype html><title>cell</title>{graph.page()._repr_html_()}")
        visitor = Visitor(driver)
        driver.get(cell.as_uri())
        driver.switch_to.frame(driver.find_element("tag name", "iframe"))
        visitor.until(lambda: visitor.state in RUNNING)
        assert visitor.errors() == []
