"""A graph and its live page in Debian's Chromium, for the benchmark and the pictures."""

import importlib
import json
import os
import shutil
import signal
import subprocess
import sys
import time
import urllib.request
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

from benchmarks.turns import END_TIMEOUT_S, Graph
from forcebound.realtime import wait_until

MOUSE_NS = 8_000_000  # between two events of a mouse: 125 a second, as over USB
QUIET = (
    "--headless=new", "--no-sandbox", "--disable-gpu", "--disable-background-networking",
    "--disable-component-update", "--no-first-run", "--window-size=1400,1000",
)  # fmt: skip


def selenium(name: str) -> Any:
    """Return a module of selenium, which is in an extra of its own."""
    return importlib.import_module(f"selenium.{name}")


@contextmanager
def page(running: Graph) -> Iterator[Graph]:
    """Serve the page of a graph."""
    command = [sys.executable, "-u", "-m", "forcebound", "view", "--no-open"]
    command += ["--launcher", str(running.launcher.pid)]
    server = subprocess.Popen(command, env=running.variables, stdout=subprocess.PIPE, text=True)
    assert server.stdout is not None
    try:
        yield replace(running, address=server.stdout.readline().split()[-1])
    finally:
        server.send_signal(signal.SIGINT)
        server.wait(END_TIMEOUT_S)
        server.stdout.close()


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
    until(driver, "document.getElementById('state').textContent === 'running'")


def until(driver: Any, condition: str) -> None:
    """Wait until an expression holds in the page."""
    wait = selenium("webdriver.support.ui").WebDriverWait(driver, END_TIMEOUT_S, 0.1)
    wait.until(lambda _: driver.execute_script(f"return {condition}"))


class Mouse:
    """The mouse of a browser; it does not wait until the page has dealt with an event.

    Args:
        driver: Of the browser, with the page in front.
    """

    def __init__(self, driver: Any) -> None:
        where = driver.capabilities["goog:chromeOptions"]["debuggerAddress"]
        with urllib.request.urlopen(f"http://{where}/json") as answer:  # of this machine
            pages = json.load(answer)
        [url] = [
            page["webSocketDebuggerUrl"] for page in pages if page["url"] == driver.current_url
        ]
        self._line = importlib.import_module("websocket").create_connection(
            url, suppress_origin=True
        )
        self._sent = 0

    def drag(self, places: Sequence[tuple[float, float]]) -> None:
        """Press the button at the first place, in pixels, move through all others, let it go."""
        start_ns = time.monotonic_ns()
        kinds = ["mousePressed", *["mouseMoved"] * (len(places) - 1), "mouseReleased"]
        for step, (kind, place) in enumerate(zip(kinds, (*places, places[-1]), strict=True)):
            wait_until(start_ns + step * MOUSE_NS, 0)
            self._send(kind, place)

    def close(self) -> None:
        """Leave the browser."""
        self._line.close()

    def _send(self, kind: str, place: tuple[float, float]) -> None:
        x, y = place
        event = {"type": kind, "x": x, "y": y, "button": "left", "buttons": 1, "clickCount": 1}
        self._sent += 1
        command = {"id": self._sent, "method": "Input.dispatchMouseEvent", "params": event}
        self._line.send(json.dumps(command))
