"""Benchmark of the live page: ``python benchmarks/live_page.py [--turns 5] [--json]``.

A graph runs, with its page in a real browser, Debian's Chromium without a graphics card.

* *Hand*: somebody drags it in one page. From the event in the browser until the page has heard that
  the device took the place; the way back is in it. Targets: p99 below 20 ms, 30 frames a second.
* *Servo*: lateness and loop delay in turns without a page and with three. The servo must not
  notice: less than 5 % difference.
"""

import importlib
import json
import os
import shutil
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import click
import numpy as np

from forcebound.recording import read

PATIENCE = 60.0  # s
PAGES = 3
STEPS = 20  # moves of a drag
TARGET_MS, TARGET_FRAMES, TARGET_SHARE = 20.0, 30.0, 0.05

WATCH = """
window.taken = [];
window.frames = 0;
document.addEventListener("taken", (event) => window.taken.push(event.detail));
const count = () => { window.frames += 1; requestAnimationFrame(count); };
requestAnimationFrame(count);
"""


@click.command()
@click.option("--turns", default=5, help="Turns without and with pages.")
@click.option("--seconds", default=4.0, help="Of each turn.")
@click.option("--drags", default=10, help="Each of twenty moves.")
@click.option("--json", "as_json", is_flag=True)
def main(turns: int, seconds: float, drags: int, as_json: bool) -> None:
    """Measure the hand, then the servo without and with three pages."""
    with tempfile.TemporaryDirectory(prefix="fb-") as folder:
        record = Path(folder) / "run.mcap"
        with graph(folder, record) as address, browser(folder) as driver:
            hand = measure_hand(driver, address, drags)
            spans = take_turns(driver, address, turns, seconds)
        found: dict[str, Any] = {"hand": hand, "servo": servo(record, spans)}
        found["load"] = os.getloadavg()[0]
    if as_json:
        click.echo(json.dumps(found, indent=2))
        return
    click.echo(
        f"pointer to device and back: p50 {hand['p50_ms']:.1f} ms, p99 {hand['p99_ms']:.1f} ms of"
        f" {hand['places']} places (target {TARGET_MS:g} ms)"
    )
    click.echo(
        f"{hand['places_per_second']:.0f} places a second, {hand['frames_per_second']:.0f} frames a"
        f" second (target {TARGET_FRAMES:g})"
    )
    for name, (without, with_pages, change) in found["servo"].items():
        click.echo(
            f"{name}: {without:.1f} us without, {with_pages:.1f} us with {PAGES} pages,"
            f" {change:+.1%} (target {TARGET_SHARE:.0%})"
        )
    click.echo(f"load of the machine at the end: {found['load']:.1f}")


@contextmanager
def graph(folder: str, record: Path) -> Iterator[str]:
    """Run a graph and its page; give the address."""
    variables = {**os.environ, "XDG_RUNTIME_DIR": folder}
    forcebound = [sys.executable, "-u", "-m", "forcebound"]
    launch = [*forcebound, "launch", "pointer_wall", "--record", str(record)]
    quiet = subprocess.DEVNULL
    running = subprocess.Popen(launch, env=variables, stdout=quiet, stderr=quiet)
    view = [*forcebound, "view", "--no-open", "--launcher", str(running.pid)]
    page = subprocess.Popen(view, env=variables, stdout=subprocess.PIPE, text=True)
    assert page.stdout is not None
    try:
        yield page.stdout.readline().split()[-1]
    finally:
        running.send_signal(signal.SIGINT)
        running.wait(PATIENCE)
        page.wait(PATIENCE)


@contextmanager
def browser(folder: str) -> Iterator[Any]:
    """Give a browser without a window."""
    webdriver = selenium("webdriver")

    options = webdriver.ChromeOptions()
    options.binary_location = str(shutil.which("chromium"))
    for word in ("--headless=new", "--no-sandbox", "--disable-gpu", "--window-size=1400,1000"):
        options.add_argument(word)
    variables = {**os.environ, "HOME": folder, "TMPDIR": folder}
    driver_file = shutil.which("chromedriver")
    driver = webdriver.Chrome(options, webdriver.ChromeService(driver_file, env=variables))
    try:
        yield driver
    finally:
        driver.quit()


def measure_hand(driver: Any, address: str, drags: int) -> dict[str, float]:
    """Drag the hand to and fro; return percentiles and rates."""
    open_page(driver, address)
    driver.execute_script(WATCH)
    width = driver.find_element("id", "scene").size["width"]
    begin = time.monotonic()
    for drag in range(drags):
        drag_once(driver, width * (0.15 if drag % 2 else -0.15))
    passed = time.monotonic() - begin
    taken, frames = driver.execute_script("return [window.taken, window.frames]")
    p50, p99 = np.percentile(taken, (50, 99))
    return {
        "places": len(taken),
        "p50_ms": float(p50),
        "p99_ms": float(p99),
        "places_per_second": len(taken) / passed,
        "frames_per_second": frames / passed,
    }


def drag_once(driver: Any, way: float) -> None:
    """Drag the hand to a side in small moves, one each 16 ms, as a mouse does."""
    chain = selenium("webdriver").ActionChains(driver, duration=16)
    chain.move_to_element(driver.find_element("id", "scene")).click_and_hold()
    for _ in range(STEPS):
        chain.move_by_offset(round(way / STEPS), 0)
    chain.release().perform()


def selenium(name: str) -> Any:
    """Return a module of selenium, which is in an extra of its own."""
    return importlib.import_module(f"selenium.{name}")


def open_page(driver: Any, address: str) -> None:
    """Open a page, until it shows a running graph."""
    driver.get(address)
    is_running = "return document.getElementById('state').textContent === 'running'"
    selenium("webdriver.support.ui").WebDriverWait(driver, PATIENCE).until(
        lambda _: driver.execute_script(is_running)
    )


def take_turns(
    driver: Any, address: str, turns: int, seconds: float
) -> list[tuple[int, tuple[int, int]]]:
    """Let turns without and with pages follow each other; return pages and time, in ns, of each."""
    driver.get("about:blank")
    own = driver.current_window_handle
    spans = []
    for turn in range(2 * turns):
        pages = PAGES * (turn % 2)
        opened = []
        for _ in range(pages):
            driver.switch_to.new_window("window")
            opened.append(driver.current_window_handle)
            open_page(driver, address)
        time.sleep(1.0)  # opening and closing is not what is measured
        begin_ns = time.monotonic_ns()
        time.sleep(seconds)
        spans.append((pages, (begin_ns, time.monotonic_ns())))
        for handle in opened:
            driver.switch_to.window(handle)
            driver.close()
        driver.switch_to.window(own)
    return spans


def lateness(time_ns: Any, period_ns: float) -> Any:
    """Return how much later than the earliest of its turn each write is in its period, in us."""
    angle = 2.0 * np.pi * (((time_ns - time_ns[0]) / period_ns) % 1.0)
    middle = np.angle(np.exp(1j * angle).mean())
    phase = np.angle(np.exp(1j * (angle - middle))) / (2.0 * np.pi) * period_ns / 1e3
    return phase - np.percentile(phase, 1)


def servo(
    record: Path, spans: list[tuple[int, tuple[int, int]]]
) -> dict[str, tuple[float, float, float]]:
    """Return the median of the turns without and with pages, in us, and the relative change."""
    recording = read(record)
    columns, period_ns = recording.telemetry, 1e9 / recording.launch["device"]["rate"]
    figures: dict[str, tuple[list[float], list[float]]] = {
        "lateness of the write, p50": ([], []),
        "lateness of the write, p99": ([], []),
        "loop delay, p50": ([], []),
        "loop delay, p99": ([], []),
    }
    for pages, (begin_ns, end_ns) in spans:
        here = (columns.time_ns >= begin_ns) & (columns.time_ns < end_ns)
        late = lateness(columns.time_ns[here], period_ns)
        delay = columns.loop_delay[here]
        delay = delay[np.isfinite(delay)] * 1e6
        values = [*np.percentile(late, (50, 99)), *np.percentile(delay, (50, 99))]
        for kept, value in zip(figures.values(), values, strict=True):
            kept[pages > 0].append(float(value))
    return {
        name: (a := statistics.median(kept[0]), b := statistics.median(kept[1]), b / a - 1.0)
        for name, kept in figures.items()
    }


if __name__ == "__main__":
    main()
