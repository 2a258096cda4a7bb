"""Where the parts of the live page are, from a phone to a large screen, with one to four hands."""

from collections.abc import Iterator
from itertools import combinations
from pathlib import Path
from typing import Any

import pytest
from live_page import pointed
from test_view_browser import CHROMIUM, DRIVER, KEEP_SOCKETS, Visitor, browser

FOUR_HANDS = """
forcebound: 1
description: Four hands that follow pointers, in front of one wall.
duration: 3600 s
seed: 1
hands:
  default: { device: { rate: 100 Hz } }
  left: { include: pointer_wall.yaml }
  right: { include: pointer_wall.yaml }
  upper: { include: pointer_wall.yaml }
  lower: { include: pointer_wall.yaml }
environment: { kind: wall, stiffness: 10 N/mm, position: 10 mm }
realtime: { policy: other } # two cores are full with a browser and the nodes of four hands
"""

HALF = 993, 760  # a window beside another one
SIZES = [(360, 640), (640, 360), (768, 1024), HALF, (1366, 768), (2560, 1440)]
PHONE = 800  # pixels; narrower screens are touched

#: Long states of all hands and all of their forces; then where each part and each label is.
MEASURED = """
const [{ scene }, done] = [await import("./app.js"), arguments[0]];
const state = { kind: "uncovered", head: "Not covered by the certificate. In contact.", force: "20.9 N",
  energy: "-13.6 mJ", cause: "", paid: "8%", more: "The hand gets 2.58 N of the 87.5 N that the environment commands: "
    + "a force acts 3.2 ms after its reading. 9 ticks were missed in this contact: let go, and press again." };
const calm = { ...state, kind: "passive", head: "Passive. Moving freely.", more: "No contact.", paid: "" };
const show = (one) => {
  const each = Object.fromEntries(scene.hands.map(({ name }) => [name, one]));
  window.sockets.at(-1).dispatchEvent(new MessageEvent("message", { data: JSON.stringify({ type: "state", hands: each }) }));
};
const box = ({ left, top, right, bottom }) => [left, top, right, bottom], place = () => box(scene.canvas.getBoundingClientRect());
for (const hand of scene.hands) hand.target = null;
show(calm);
const before = place();
for (const hand of scene.hands) hand.target = [0.02, 0, 0];
show(state);
const after = place();
document.getElementById("note").textContent = "Ticks are missed: only 15 pictures a second.";
scene.hands.forEach((hand, i) => Object.assign(hand, { tip: [0.012 + 1e-3 * i], commanded: [87.5], applied: [2.58] }));
scene.draw();
const words = (one) => { const range = document.createRange(); range.selectNodeContents(one); return range.getBoundingClientRect(); };
const parts = {};
for (const place of ["#hands", "#break", "#safe", "#state", "#why", "#paid", "#note", ".gauges > div", "#each > li > :not(small)", "#each small", "canvas#scene", ".legend > li", ".bar", ".scene .buttons > button"]) {
  [...document.querySelectorAll(place)].filter((one) => one.checkVisibility()).forEach((one, i) => {
    const isWhole = ["#hands", "#why", "canvas#scene", "#each small", ".bar"].includes(place) || one.tagName === "BUTTON";
    const { width, height } = one.getBoundingClientRect();
    if (width * height) parts[`${place} ${i}`] = box(isWhole ? one.getBoundingClientRect() : words(one));
  });
}
const labels = scene.labels.placed.map(({ words: what, x, y, wide, high }) => [what, [x - wide / 2, y - high / 2, x + wide / 2, y + high / 2]]);
const { clientWidth, clientHeight } = scene.canvas, { scrollWidth } = document.documentElement;
done({ parts, before, after, names: scene.hands.map(({ name }) => name), labels: Object.fromEntries(labels), page: [innerWidth, innerHeight], scrollWidth, scene: [clientWidth, clientHeight],
  note: [parseFloat(getComputedStyle(document.getElementById("note")).fontSize), parseFloat(getComputedStyle(document.body).fontSize)] });
"""  # noqa: E501
#: A script may not wait by itself.
MEASURE = f"(async function () {{ {MEASURED} }}).apply(null, arguments)"
LINES = "return document.querySelectorAll('#each li').length"
FOOT = (".legend", ".bar", ".scene .buttons")  # below the scene; one may scroll to it
LEAST = 120  # pixels of height of the scene

Box = tuple[float, float, float, float]

pytestmark = [
    pytest.mark.live,
    pytest.mark.slow,  # runs in `make browser`
    pytest.mark.xdist_group("processes"),
    pytest.mark.skipif(not (CHROMIUM and DRIVER), reason="needs Debian's chromium-driver"),
]


def meeting(boxes: dict[str, Box]) -> Iterator[tuple[str, str]]:
    """Pairs of boxes that have more than an edge in common."""
    for (one, a), (other, b) in combinations(boxes.items(), 2):
        wide, high = min(a[2], b[2]) - max(a[0], b[0]), min(a[3], b[3]) - max(a[1], b[1])
        if wide > 1.0 and high > 1.0:
            yield one, other


def outside(boxes: dict[str, Box], width: float, height: float) -> list[str]:
    """Boxes that are not within a width and a height from zero."""
    return [
        name
        for name, (left, top, right, bottom) in boxes.items()
        if left < -1.0 or top < -1.0 or right > width + 1.0 or bottom > height + 1.0
    ]


@pytest.mark.parametrize("count", [1, 2, 4])
def test_states_and_labels_are_beside_the_scene_and_beside_each_other(
    count: int, tmp_path: Path
) -> None:
    file = tmp_path / "four_hands.yaml"
    file.write_text(FOUR_HANDS)
    launch = {1: "pointer_wall", 2: "pointer_two_hands", 4: str(file)}[count]
    with pointed(launch) as (_, (address, _)), browser() as driver:
        driver.execute_cdp_cmd("Page.addScriptToEvaluateOnNewDocument", {"source": KEEP_SOCKETS})
        visitor = Visitor(driver)
        for width, height in SIZES:
            if count > 2 and (width, height) == HALF:
                continue  # the states of four hands scroll there
            is_phone = width < PHONE
            size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": is_phone}
            driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
            driver.execute_cdp_cmd("Emulation.setTouchEmulationEnabled", {"enabled": is_phone})
            visitor.open(address)
            visitor.until(lambda: driver.execute_script(LINES) == (count if count > 1 else 0))
            seen: dict[str, Any] = driver.execute_async_script(MEASURE)
            parts = seen["parts"]
            assert seen["page"] == [width, height]
            assert seen["scrollWidth"] <= width
            assert list(meeting(parts)) == [], (width, height)
            first = {name: box for name, box in parts.items() if not name.startswith(FOOT)}
            assert outside(first, width, height) == [], (width, height)
            named = {words.split()[0].strip(",") for words in seen["labels"]}
            assert named >= set(seen["names"]) if count > 1 else named
            assert list(meeting(seen["labels"])) == [], (width, height)
            assert outside(seen["labels"], *seen["scene"]) == [], (width, height)
            assert seen["scene"][1] >= LEAST
            assert seen["before"] == seen["after"], (width, height)  # a cause moves nothing
            small, normal = seen["note"]
            assert small < normal
        assert visitor.errors() == []


#: Where the tip and the middle of the sphere are, in pixels of the page; null: not drawn yet.
PLACES = """
const done = arguments[0];
import("./app.js").then(({ scene }) => {
  const sphere = scene.objects.find(({ shape }) => shape === "sphere"), hand = scene.hand;
  if (!sphere || !hand || !scene.isCentred) return done(null);
  const { left, top } = scene.canvas.getBoundingClientRect();
  const seen = [hand.tip, sphere.position].map((place) => scene.project(place));
  done(seen.map(([x, y]) => [left + x, top + y]));
});
"""
TIP_SIZES = [*SIZES, (1920, 1080)]


def test_the_first_drag_from_the_tip_to_the_sphere_touches_it_on_every_screen() -> None:
    with pointed("pointer_touch") as (_, (address, _)), browser() as driver:
        visitor = Visitor(driver)
        for width, height in TIP_SIZES:
            is_phone = min(width, height) < 500
            size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": is_phone}
            driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
            driver.execute_cdp_cmd("Emulation.setTouchEmulationEnabled", {"enabled": is_phone})
            visitor.open(address)
            visitor.until(lambda: driver.execute_async_script(PLACES))
            tip, middle = driver.execute_async_script(PLACES)
            assert 0 <= tip[0] <= width, (width, height)
            assert 0 <= tip[1] <= height, (width, height)
            assert visitor.figure("commanded") == 0.0
            for kind, at in (("Pressed", tip), ("Moved", middle)):
                drag(driver, kind, at, is_phone=is_phone)
            visitor.until(
                lambda: visitor.figure("commanded") > 0.0 and visitor.figure("applied") > 0.0
            )
            drag(driver, "Moved", tip, is_phone=is_phone)
            visitor.until(lambda: visitor.figure("commanded") == 0.0)
            drag(driver, "Released", tip, is_phone=is_phone)
        assert visitor.errors() == []


def drag(driver: Any, kind: str, at: tuple[float, float], *, is_phone: bool) -> None:
    """Press, move or release a mouse or, on a phone, a finger."""
    x, y = at
    if is_phone:
        name = {"Pressed": "touchStart", "Moved": "touchMove", "Released": "touchEnd"}[kind]
        points = [] if kind == "Released" else [{"x": x, "y": y}]
        driver.execute_cdp_cmd("Input.dispatchTouchEvent", {"type": name, "touchPoints": points})
    else:
        event = {
            "type": f"mouse{kind}",
            "x": x,
            "y": y,
            "button": "left",
            "buttons": 1,
            "clickCount": 1,
        }
        driver.execute_cdp_cmd("Input.dispatchMouseEvent", event)
