"""Pictures of the live page, for README and docs.

Debian's Chromium shows a graph that runs; somebody drags its hand, breaks it and makes it safe. The
numbers in a picture are those of this machine: take it idle. The moving picture shows the same.
"""

import base64
import importlib
import io
import os
import shutil
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path
from typing import Any

import click
from PIL import Image

from benchmarks.observers import END_TIMEOUT_S, Graph, graph, page

STEPS = 30  # moves of a drag
PHONE = {"width": 390, "height": 844, "deviceScaleFactor": 1.5, "mobile": True}
FILM = {"width": 1120, "height": 680, "deviceScaleFactor": 1, "mobile": False}
SHOWN = 0.8  # scale of the moving picture
FRAME = 0.1  # s between two of its frames, at least
QUALITY = 75  # of its compression
LARGEST = 2_000_000  # B
#: Takes the browser's own software for a graphics card, which this machine need not have.
AS_CARD = """
const plain = WebGL2RenderingContext.prototype.getParameter;
WebGL2RenderingContext.prototype.getParameter = function (name) {
  const value = plain.call(this, name);
  return typeof value === "string" ? "card" : value;
};
"""
IS_TOUCHING = "parseFloat(document.getElementById('force').textContent) > 0.1"
BOTH_TOUCH = (
    "[...document.querySelectorAll('#each small')].every((one) => / N/.test(one.textContent))"
)

QUIET = (
    "--headless=new", "--no-sandbox", "--disable-gpu", "--disable-background-networking",
    "--disable-component-update", "--disable-renderer-backgrounding", "--no-first-run",
    "--window-size=1400,1000",
)  # fmt: skip


def selenium(name: str) -> Any:
    """Return a module of selenium, which is in an extra of its own."""
    return importlib.import_module(f"selenium.{name}")


@contextmanager
def browser(folder: str) -> Iterator[Any]:
    """Give a browser without a window and without a graphics card."""
    webdriver = selenium("webdriver")
    options = webdriver.ChromeOptions()
    options.binary_location = str(shutil.which("chromium"))
    for word in QUIET:
        options.add_argument(word)
    variables = {**os.environ, "HOME": folder, "TMPDIR": folder}
    driver_file = shutil.which("chromedriver")
    driver = webdriver.Chrome(options, webdriver.ChromeService(driver_file, env=variables))
    try:
        yield driver
    finally:
        driver.quit()


def open_page(driver: Any, address: str) -> None:
    """Open a page, until it shows a running graph."""
    driver.get(address)
    until(driver, "document.body.dataset.state === 'passive'")


def until(driver: Any, condition: str) -> None:
    """Wait until an expression holds in the page."""
    wait = selenium("webdriver.support.ui").WebDriverWait(driver, END_TIMEOUT_S, 0.1)
    wait.until(lambda _: driver.execute_script(f"return {condition}"))


def drag(driver: Any, right: float, down: float) -> None:
    """Drag the hand from the middle of the scene, in pixels."""
    actions = selenium("webdriver").ActionChains(driver, duration=round(1e3 / STEPS))
    actions.click_and_hold(driver.find_element("id", "scene"))
    for _ in range(STEPS):
        actions.move_by_offset(round(right / STEPS), round(down / STEPS))
    actions.release().perform()


@click.command()
@click.argument("folder", default="docs", type=click.Path(exists=True, path_type=Path))
def main(folder: Path) -> None:
    """Write the four pictures and the moving one into a folder, docs by default."""
    with (
        tempfile.TemporaryDirectory(prefix="fb-", ignore_cleanup_errors=True) as own,
        browser(own) as driver,
    ):
        with graph(own, "pointer_wall") as launched, page(launched) as running:
            show_wall(driver, running, folder / "live-page.png")
            driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", PHONE)
            running.run_for(1.0)  # it is laid out
            save(driver, folder / "live-page-phone.png")
            driver.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})
            film_wall(driver, running, folder / "live-page.webp")
        with graph(own, "pointer_rabbit") as launched, page(launched) as running:
            show_touch(driver, running, folder / "live-page-touch.png")
        with graph(own, "pointer_two_hands") as launched, page(launched) as running:
            driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": []})
            show_two_hands(driver, running, folder / "two-hands-page.png")


def show_wall(driver: Any, running: Graph, picture: Path) -> None:
    """Press into the wall, break it for six seconds, make it safe for three."""
    open_page(driver, running.address)
    drag(driver, 330.0, 0.0)
    until(driver, IS_TOUCHING)
    for button, seconds in (("break", 6.0), ("safe", 3.0)):
        driver.find_element("id", button).click()
        until(driver, f"document.getElementById('{button}').ariaPressed === 'true'")
        running.run_for(seconds)
    save(driver, picture)


def film_wall(driver: Any, running: Graph, picture: Path) -> None:
    """Drag the hand out of the wall and into it, break it, make it safe: as a moving picture."""
    driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", FILM)
    open_page(driver, running.address)
    frames: list[tuple[float, Image.Image]] = []
    scene = driver.find_element("id", "scene").rect
    x, y = scene["x"] + scene["width"] / 2, scene["y"] + scene["height"] / 2

    def mouse(kind: str, right: float) -> None:
        event = {"type": kind, "x": x + right, "y": y, "button": "left", "buttons": 1}
        driver.execute_cdp_cmd("Input.dispatchMouseEvent", event | {"clickCount": 1})

    mouse("mousePressed", 0.0)
    mouse("mouseMoved", -330.0)
    running.run_for(11.0)  # the plots show what was before no more
    for right in range(-330, 170, 1000 // STEPS):
        mouse("mouseMoved", right)
        frames.append(taken(driver))
    mouse("mouseReleased", right)
    for button, seconds in (("", 2.0), ("break", 5.0), ("safe", 5.0)):
        if button:
            driver.find_element("id", button).click()
            until(driver, f"document.getElementById('{button}').ariaPressed === 'true'")
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            frames.append(taken(driver))
    driver.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})
    times = [at for at, _ in frames] + [frames[-1][0] + 2.0]
    (_, first), *others = frames
    lengths = [round(1e3 * (after - at)) for at, after in pairwise(times)]
    more = [image for _, image in others]
    first.save(
        picture, save_all=True, append_images=more, duration=lengths, loop=0, quality=QUALITY
    )
    if picture.stat().st_size > LARGEST:
        raise click.ClickException(f"{picture} has {picture.stat().st_size} B")
    click.echo(f"wrote {picture}")


def taken(driver: Any) -> tuple[float, Image.Image]:
    """Return when a frame of the moving picture was taken, and what the browser showed then."""
    at = time.monotonic()
    shot = driver.execute_cdp_cmd("Page.captureScreenshot", {"optimizeForSpeed": True})
    image = Image.open(io.BytesIO(base64.b64decode(shot["data"]))).convert("RGB")
    time.sleep(max(0.0, at + FRAME - time.monotonic()))
    return at, image.resize([round(SHOWN * side) for side in image.size], Image.Resampling.LANCZOS)


def show_touch(driver: Any, running: Graph, picture: Path) -> None:
    """Touch the mesh, in the dark."""
    dark = {"features": [{"name": "prefers-color-scheme", "value": "dark"}]}
    driver.execute_cdp_cmd("Emulation.setEmulatedMedia", dark)
    driver.execute_cdp_cmd("Page.addScriptToEvaluateOnNewDocument", {"source": AS_CARD})
    open_page(driver, running.address)
    running.run_for(6.0)  # the mesh comes, and time to see that the hand was free
    drag(driver, 90.0, 0.0)  # into its back
    until(driver, IS_TOUCHING)
    running.run_for(3.0)
    save(driver, picture)


def show_two_hands(driver: Any, running: Graph, picture: Path) -> None:
    """Press the box from both sides, the right hand more than the left one."""
    for hand, right in (("left", 170.0), ("right", -230.0)):
        open_page(driver, f"{running.address}&hand={hand}")
        drag(driver, right, 0.0)
    driver.find_element("css selector", "#hands button").click()  # all hands
    until(driver, BOTH_TOUCH)
    running.run_for(3.0)
    save(driver, picture)


def save(driver: Any, picture: Path) -> None:
    """Write what the browser shows."""
    driver.save_screenshot(str(picture))
    click.echo(f"wrote {picture}")
