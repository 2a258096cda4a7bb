"""Benchmark of the live page: ``python -m benchmarks.live_page [--turns 5] [--json]``.

A graph runs, with its page in a real browser, Debian's Chromium without a graphics card.

* *Hand*: somebody drags it in one page, with a mouse of 125 events a second. From the event in the
  browser until the device takes the place, and until the page has heard of that. Targets: p99 of
  the way there below 20 ms, 30 places a second, 30 pictures a second.
* *Servo*: lateness and loop delay in turns: without a page, with three programs that read what
  pages are told and draw nothing, with three pages, and with three pages in a browser that stays
  off the core of the nodes. The servo must not notice: less than 5 % difference. The readers show
  what the server costs, the pages in addition what browsers cost.
"""

import asyncio
import json
import os
import tempfile
import time
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, closing, contextmanager, nullcontext, suppress
from pathlib import Path
from typing import Any

import click
import numpy as np
from tornado.websocket import websocket_connect

from benchmarks.live_browser import Mouse, browser, graph, open_page
from benchmarks.turns import ALONE, Figures, Graph, Turn, servo, told
from forcebound.launch.run_directory import RunDocument
from forcebound.realtime import on_cores

VIEWERS = 3
READERS, PAGES = f"{VIEWERS} readers", f"{VIEWERS} pages"
APART = f"{PAGES} off the core of the nodes"
STEPS = 125  # events of a drag
WARM_UP = 5.0  # s for what browsers do when they have started
SETTLE = 1.0  # s at the begin of a turn that do not count: something opens, something closes
TARGET_MS, TARGET_RATE = 20.0, 30.0

WATCH = """
window.taken = [];
window.pictures = 0;
document.addEventListener("taken", ({ detail }) => window.taken.push([detail.there, detail.back]));
const context = document.getElementById("scene").getContext("2d"), clear = context.clearRect;
context.clearRect = (...place) => { window.pictures += 1; clear.apply(context, place); };
"""


@click.command()
@click.option("--turns", default=5, help="Turns of each kind.")
@click.option("--seconds", default=4.0, help="Of each turn.")
@click.option("--drags", default=20, help="Each of one second.")
@click.option("--json", "as_json", is_flag=True)
def main(turns: int, seconds: float, drags: int, as_json: bool) -> None:
    """Measure the hand, then the servo without pages, with readers and with pages."""
    with tempfile.TemporaryDirectory(prefix="fb-", ignore_cleanup_errors=True) as folder:
        record = Path(folder) / "run.mcap"
        with (
            graph(folder, "pointer_wall", "--record", str(record)) as running,
            browsers(folder, running) as drivers,
        ):
            hand = measure_hand(drivers[PAGES], running, drags)
            taken = take_turns(drivers, running, turns, seconds)
        figures, load = servo(record, taken), os.getloadavg()[0]
    if as_json:
        click.echo(json.dumps({"hand": hand, "servo": figures, "load": load}, indent=2))
    else:
        show(hand, figures, load)


def show(hand: Mapping[str, float], figures: Figures, load: float) -> None:
    """Print the figures, beside their targets."""
    for way, words in (("there", "pointer to device"), ("back", "and back to the page")):
        click.echo(
            f"{words}: p50 {hand[f'{way}_p50_ms']:.1f} ms, p99 {hand[f'{way}_p99_ms']:.1f} ms"
            + (f" (target {TARGET_MS:g} ms)" if way == "there" else "")
        )
    click.echo(
        f"{hand['places_per_second']:.0f} places, {hand['pictures_per_second']:.0f} pictures a"
        f" second (target {TARGET_RATE:g} of both), of {hand['events_per_second']:.0f} events"
    )
    for line in told(figures):
        click.echo(line)
    click.echo(f"load of the machine at the end: {load:.1f}")


@contextmanager
def browsers(folder: str, running: Graph) -> Iterator[dict[str, Any]]:
    """Give a browser that runs anywhere, and one that stays off the core of the nodes."""
    others = os.sched_getaffinity(0) - {RunDocument.read(running.run_dir).core}
    with ExitStack() as opened:
        anywhere = opened.enter_context(browser(folder))
        with on_cores(others):
            apart = opened.enter_context(browser(folder))
        yield {PAGES: anywhere, APART: apart}


def measure_hand(driver: Any, running: Graph, drags: int) -> dict[str, float]:
    """Drag the hand to and fro; return percentiles and rates."""
    open_page(driver, running.address)
    running.run_for(WARM_UP)
    driver.execute_script(WATCH)
    scene = driver.find_element("id", "scene").rect
    x, y = scene["x"] + scene["width"] / 2, scene["y"] + scene["height"] / 2
    ways = np.linspace(0.0, 0.15 * scene["width"], STEPS)
    begin = time.monotonic()
    with closing(Mouse(driver)) as mouse:
        for drag in range(drags):
            offsets = ways[::-1] if drag % 2 else ways
            mouse.drag([(x + offset, y) for offset in offsets.tolist()])
    passed = time.monotonic() - begin
    taken, pictures = driver.execute_script("return [window.taken, window.pictures]")
    percentiles = np.percentile(np.array(taken), (50, 99), axis=0)
    names = ("there_p50_ms", "back_p50_ms", "there_p99_ms", "back_p99_ms")
    return {
        **dict(zip(names, percentiles.ravel().tolist(), strict=True)),
        "events_per_second": drags * (STEPS - 1) / passed,
        "places_per_second": len(taken) / passed,
        "pictures_per_second": pictures / passed,
    }


def take_turns(
    drivers: Mapping[str, Any], running: Graph, turns: int, seconds: float
) -> list[Turn]:
    """Let turns without viewers, with readers and with the pages of each browser follow."""
    drivers[PAGES].get("about:blank")
    taken = []
    for _ in range(turns):
        for viewers in (ALONE, READERS, *drivers):
            driver = drivers.get(viewers)
            with nullcontext() if driver is None else open_windows(driver, running.address):
                begin_ns = time.monotonic_ns()
                if viewers == READERS:
                    asyncio.run(read_pages(running.address, SETTLE + seconds))
                else:
                    running.run_for(SETTLE + seconds)
                taken.append(Turn(viewers, begin_ns + round(SETTLE * 1e9), time.monotonic_ns()))
    return taken


@contextmanager
def open_windows(driver: Any, address: str) -> Iterator[None]:
    """Keep pages open in a browser, each in a window of its own."""
    own = driver.current_window_handle
    for _ in range(VIEWERS):
        driver.switch_to.new_window("window")
        open_page(driver, address)
    yield
    for handle in set(driver.window_handles) - {own}:
        driver.switch_to.window(handle)
        driver.close()
    driver.switch_to.window(own)


async def read_pages(address: str, seconds: float) -> None:
    """Read for a time what pages are told."""

    async def listen() -> None:
        socket = await websocket_connect(address.replace("http:", "ws:").replace("/?", "/live?"))
        with closing(socket):
            while await socket.read_message() is not None:
                pass

    with suppress(TimeoutError):
        async with asyncio.timeout(seconds), asyncio.TaskGroup() as group:
            for _ in range(VIEWERS):
                group.create_task(listen())


if __name__ == "__main__":
    main()
