"""Pictures of the live page, for README and docs: ``python -m experiments.live_pictures [FOLDER]``.

Debian's Chromium shows a graph that runs; somebody drags its hand, breaks it and makes it safe. The
numbers in a picture are those of this machine: take it idle.
"""

import tempfile
from contextlib import closing
from pathlib import Path
from typing import Any

import click
import numpy as np

from benchmarks.live_browser import Mouse, browser, open_page, page, until
from benchmarks.turns import Graph, graph

STEPS = 60  # moves of a drag
IS_TOUCHING = """[...document.querySelectorAll("#figures > div")].some(
  ({ firstChild, lastChild }) =>
    firstChild.textContent === "applied" && parseFloat(lastChild.textContent) > 0.1)"""


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


def drag(driver: Any, right: float, down: float) -> None:
    """Drag the hand from the middle of the scene, in pixels."""
    scene = driver.find_element("id", "scene").rect
    x, y = scene["x"] + scene["width"] / 2, scene["y"] + scene["height"] / 2
    ways = np.linspace(0.0, 1.0, STEPS).tolist()
    with closing(Mouse(driver)) as mouse:
        mouse.drag([(x + way * right, y + way * down) for way in ways])


def save(driver: Any, picture: Path) -> None:
    """Write what the browser shows."""
    driver.save_screenshot(str(picture))
    click.echo(f"wrote {picture}")


if __name__ == "__main__":
    main()
