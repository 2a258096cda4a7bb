"""Pictures of the live page, for README and docs: ``python -m experiments.live_pictures [FOLDER]``.

Debian's Chromium shows a graph that runs; somebody drags its hand, breaks it and makes it safe. The
numbers in a picture are those of this machine: take it idle.
"""

import importlib
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import click

from benchmarks.onlookers import END_TIMEOUT_S, Graph, graph, page

STEPS = 30  # moves of a drag
IS_TOUCHING = "parseFloat(document.getElementById('force').textContent) > 0.1"


QUIET = (
    "--headless=new", "--no-sandbox", "--disable-gpu", "--disable-background-networking",
    "--disable-component-update", "--no-first-run", "--window-size=1400,1000",
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
    """Write live-page.png and live-page-touch.png into a folder, docs by default."""
    with (
        tempfile.TemporaryDirectory(prefix="fb-", ignore_cleanup_errors=True) as own,
        browser(own) as driver,
    ):
        with graph(own, "pointer_wall") as launched, page(launched) as running:
            show_wall(driver, running, folder / "live-page.png")
        with graph(own, "pointer_touch") as launched, page(launched) as running:
            show_touch(driver, running, folder / "live-page-touch.png")


def show_wall(driver: Any, running: Graph, picture: Path) -> None:
    """Press into the wall, break it for six seconds, make it safe for three."""
    open_page(driver, running.address)
    drag(driver, 120.0, 0.0)
    until(driver, IS_TOUCHING)
    for button, seconds in (("break", 6.0), ("safe", 3.0)):
        driver.find_element("id", button).click()
        until(driver, f"document.getElementById('{button}').ariaPressed === 'true'")
        running.run_for(seconds)
    save(driver, picture)


def show_touch(driver: Any, running: Graph, picture: Path) -> None:
    """Touch the mesh, in the dark."""
    dark = {"features": [{"name": "prefers-color-scheme", "value": "dark"}]}
    driver.execute_cdp_cmd("Emulation.setEmulatedMedia", dark)
    open_page(driver, running.address)
    running.run_for(6.0)  # the mesh comes, and time to see that the hand was free
    drag(driver, 90.0, -10.0)
    until(driver, IS_TOUCHING)
    running.run_for(3.0)
    save(driver, picture)


def save(driver: Any, picture: Path) -> None:
    """Write what the browser shows."""
    driver.save_screenshot(str(picture))
    click.echo(f"wrote {picture}")


if __name__ == "__main__":
    main()
