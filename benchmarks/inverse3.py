"""The loop with a Haply Inverse3 by its driver, against a bare client of the service.

The service is emulated, one process for all; nobody holds the device. `driver`: a force and its
state, with all checks, the guardian and the channel of events. `client`: the same message and reply
by `websockets` as most clients use it, nothing checked. `tick`: a tick of the device node, a
reading and one write. A tick that takes longer than its period is missed.
"""

import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path

from msgspec import json
from websockets.sync.client import connect

from benchmarks.device import REPLY_WAIT, TIMEOUT, await_port, read
from benchmarks.harness import Result, alternate, at, chain, compare, missed
from benchmarks.servo import answer_states, ticks
from forcebound.hardware.haply_inverse3 import HaplyInverse3
from forcebound.hardware.inverse_messages import to_device
from forcebound.observe.measure import Round, Timing, apart, serving
from forcebound.realtime import Settings

DURATION = 12.0
ASKED = "the loop with a Haply Inverse3 (emulated service) by its driver"


def run(duration: float, rate: float) -> Result:
    """Run the benchmark."""
    settings = chain()
    with tempfile.TemporaryDirectory(prefix="forcebound-") as folder:
        link = Path(folder) / "inverse3"
        with _emulator(link):
            contestants = {
                "driver": partial(apart, read, driver_exchange, str(link), settings),
                "client": partial(apart, read, bare_exchange, str(link), settings),
                "tick": partial(_tick, str(link), Path(folder), settings),
            }
            found = alternate(duration, rate, contestants)
    driver, client, tick = found
    return found, [
        at(driver, "p50", is_shown=True),
        at(driver, "p99"),
        compare(driver, client, "p50", 1.3, "bare websockets"),
        compare(driver, client, "p99"),
        at(tick, "p50"),
        at(tick, "p99"),
        missed(tick, None),
    ]


@contextmanager
def _emulator(link: Path) -> Iterator[None]:
    command = [sys.executable, "-m", "forcebound", "emulate", "haply_inverse3", "--port", "0"]
    process = subprocess.Popen(
        [*command, "--link", str(link), "--no-hand"], stdout=subprocess.DEVNULL
    )
    try:
        await_port(link)
        yield
    finally:
        process.kill()
        process.wait()


def _model(link: str) -> HaplyInverse3:
    return HaplyInverse3(port=link, watchdog_limit=2.0 * TIMEOUT)  # a round may be disturbed


def _tick(link: str, folder: Path, settings: Settings, timing: Timing) -> Round:
    with ExitStack() as stack:
        run_dir = Path(stack.enter_context(tempfile.TemporaryDirectory(dir=folder)))
        stack.enter_context(serving(answer_states, run_dir, settings))
        return apart(ticks, _model(link), None, run_dir, settings, REPLY_WAIT, timing)


def driver_exchange(link: str) -> Callable[[], object]:
    """Return a reading by the driver."""
    return partial(_model(link).open(None, TIMEOUT).read, 0)


def bare_exchange(link: str) -> Callable[[], object]:
    """Return the same message, and its reply, of a client that checks nothing."""
    connection = connect(os.readlink(link), compression=None)
    connection.recv()  # the inventory
    commands = {"set_cursor_force": {"vector": {"x": 0.0, "y": 0.0, "z": 0.0}}}
    message = json.encode(to_device("049D", (), commands=commands)).decode()

    def exchange() -> object:
        connection.send(message)
        return connection.recv(TIMEOUT)

    return exchange
