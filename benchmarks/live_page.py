"""The live page of a running graph in a real browser, Debian's Chromium without a graphics card.

*Hand*: somebody drags it in one page, with a mouse of 125 events a second: from the event in the
browser until the device takes the place, and until the page has received that. *Servo*: lateness
and loop delay in turns: without a page, with three programs that read what pages receive and draw
nothing, with three pages, and with three pages in a browser that stays off the core of the nodes.
The readers show what the server costs, the pages in addition what browsers cost.
"""

import asyncio
import importlib
import os
import tempfile
import time
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, closing, contextmanager, nullcontext, suppress
from pathlib import Path
from typing import Any

import numpy as np
from tornado.websocket import websocket_connect

from benchmarks.harness import Figure, Measured, Result, at
from benchmarks.live_browser import Mouse, browser, open_page, page
from benchmarks.turns import ALONE, Graph, Turn, graph, servo
from forcebound.launch.run_directory import RunDocument
from forcebound.monitor.measure import Round
from forcebound.realtime import on_cores

VIEWERS = 3
READERS, PAGES = f"{VIEWERS} readers", f"{VIEWERS} pages"
APART = f"{PAGES} off the core of the nodes"
STEPS = 125  # events of a drag
WARM_UP = 5.0  # s for what browsers do when they have started
DURATION = 90.0
SECONDS = 4.0  # of a turn
SETTLE = 1.0  # s at the begin of a turn that do not count: something opens, something closes

WATCH = """
window.taken = [];
window.pictures = 0;
document.addEventListener("taken", ({ detail }) => window.taken.push([detail.there, detail.back]));
const context = document.getElementById("scene").getContext("2d"), clear = context.clearRect;
context.clearRect = (...place) => { window.pictures += 1; clear.apply(context, place); };
"""


def run(duration: float, rate: float) -> Result:
    """Run the benchmark, a third of it with the hand."""
    importlib.import_module("selenium")
    turns = max(2, int(duration / (SETTLE + SECONDS) / 6))
    with tempfile.TemporaryDirectory(prefix="fb-", ignore_cleanup_errors=True) as folder:
        record = Path(folder) / "run.mcap"
        words = ("pointer_wall", "--duration", "30min", "--record", str(record))
        with (
            graph(folder, *words) as launched,
            page(launched) as running,
            browsers(folder, running) as drivers,
        ):
            hand, figures = measure_hand(drivers[PAGES], running, max(2, int(duration / 3)))
            taken = take_turns(drivers, running, turns)
        contestants, of_servo = servo(record, taken)
    return [*hand, *contestants], [*figures, *of_servo]


@contextmanager
def browsers(folder: str, running: Graph) -> Iterator[dict[str, Any]]:
    """Give a browser that runs anywhere, and one that stays off the core of the nodes."""
    others = os.sched_getaffinity(0) - {RunDocument.read(running.run_dir).core}
    with ExitStack() as opened:
        anywhere = opened.enter_context(browser(folder))
        with on_cores(others):
            apart = opened.enter_context(browser(folder))
        yield {PAGES: anywhere, APART: apart}


def measure_hand(driver: Any, running: Graph, drags: int) -> tuple[list[Measured], list[Figure]]:
    """Drag the hand to and fro."""
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
    there, back = (np.array(taken).T * 1e6).astype(int).tolist()
    hand = [
        Measured("pointer to device", [Round(there)]),
        Measured("and back to the page", [Round(back)]),
    ]
    return hand, [
        at(hand[0], "p99", 20e3),
        Figure("places a second", len(taken) / passed, "", 30.0, True),
        Figure("pictures a second", pictures / passed, "", 30.0, True),
    ]


def take_turns(drivers: Mapping[str, Any], running: Graph, turns: int) -> list[Turn]:
    """Let turns without viewers, with readers and with the pages of each browser follow."""
    drivers[PAGES].get("about:blank")
    taken = []
    for _ in range(turns):
        for viewers in (ALONE, READERS, *drivers):
            driver = drivers.get(viewers)
            with nullcontext() if driver is None else open_windows(driver, running.address):
                begin_ns = time.monotonic_ns()
                if viewers == READERS:
                    asyncio.run(read_pages(running.address, SETTLE + SECONDS))
                else:
                    running.run_for(SETTLE + SECONDS)
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
    """Read for a time what pages receive."""

    async def listen() -> None:
        socket = await websocket_connect(address.replace("http:", "ws:").replace("/?", "/live?"))
        with closing(socket):
            while await socket.read_message() is not None:
                pass

    with suppress(TimeoutError):
        async with asyncio.timeout(seconds), asyncio.TaskGroup() as group:
            for _ in range(VIEWERS):
                group.create_task(listen())
