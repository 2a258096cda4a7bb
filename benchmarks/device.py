"""A reading from a device on a serial port by its driver, against a bare pyserial loop.

The board is an emulated ODrive at rest, one process for all. `driver`: request, reply, checksums,
checks, guardian. `pyserial`: the same bytes, nothing checked. `terminal`: the same bytes through a
pseudo-terminal with nothing behind it, in the class and on the core of an emulator: what the kernel
alone takes. `tick`: a tick of the device node, a reading and one write that is acknowledged.
"""

import os
import subprocess
import sys
import tempfile
import time
import tty
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path

import serial

from benchmarks.harness import (
    Figure,
    Measured,
    Result,
    alternate,
    at,
    chain,
    compare,
    missed,
    timed,
)
from benchmarks.servo import answer_states, ticks
from forcebound.errors import RunError
from forcebound.hardware.emulators.program import be_punctual
from forcebound.hardware.odrive import ODrive
from forcebound.hardware.odrive_lines import request
from forcebound.observe.measure import Round, Timing, apart, pace, serving
from forcebound.realtime import Settings, enter, freeze_garbage

DURATION = 16.0
ASKED = "reading from a serial device (emulated ODrive) by its driver"
START = 60.0  # s, for a process that may have to compile
LATE_NS = 300_000  # an exchange that takes longer is late
TIMEOUT = 1.0  # s
CHUNK = 4096  # bytes; more than a pseudo-terminal keeps
REPLY_WAIT = 0.8  # of the launch files of serial devices


def run(duration: float, rate: float) -> Result:
    """Run the benchmark."""
    settings = chain()
    with tempfile.TemporaryDirectory(prefix="forcebound-") as folder:
        port = Path(folder) / "odrive"
        with _emulator(port):
            contestants = {
                "driver": partial(apart, read, driver_exchange, str(port), settings),
                "pyserial": partial(apart, read, bare_exchange, str(port), settings),
                "terminal": partial(_terminal, Path(folder) / "echo", settings),
                "tick": partial(_tick, str(port), Path(folder), settings),
            }
            found = alternate(duration, rate, contestants)
    driver, bare, line, tick = found
    return found, [
        at(driver, "p50", is_shown=True),
        compare(driver, bare, "p50", 1.2, "bare pyserial"),
        compare(driver, bare, "p99"),
        compare(driver, line, "p99"),
        *map(_late, (driver, bare, line)),
        at(tick, "p99"),
        missed(tick),
    ]


def _late(one: Measured) -> Figure:
    times_ns = [time_ns for each in one.rounds for time_ns in each.times_ns]
    share = sum(time_ns > LATE_NS for time_ns in times_ns) / len(times_ns)
    return Figure(f"{one.label}, later than {LATE_NS / 1e6:g} ms", share, "%")


@contextmanager
def _emulator(port: Path) -> Iterator[None]:
    command = [sys.executable, "-m", "forcebound", "emulate", "odrive", "--link", str(port)]
    process = subprocess.Popen([*command, "--no-hand"], stdout=subprocess.DEVNULL)
    try:
        await_port(port)
        yield
    finally:
        process.kill()
        process.wait()


def await_port(port: Path) -> None:
    """Wait until somebody serves a port."""
    end = time.monotonic() + START
    while not port.is_symlink():
        if time.monotonic() > end:
            raise RunError(f"nobody serves {port}")
        time.sleep(0.05)


def _terminal(port: Path, settings: Settings, timing: Timing) -> Round:
    port.unlink(missing_ok=True)
    with serving(echo, str(port)):
        await_port(port)
        return apart(read, line_exchange, str(port), settings, timing)


def _tick(port: str, folder: Path, settings: Settings, timing: Timing) -> Round:
    model = ODrive(port=port, watchdog_limit=2.0 * TIMEOUT)  # a round may be disturbed
    with ExitStack() as stack:
        run_dir = Path(stack.enter_context(tempfile.TemporaryDirectory(dir=folder)))
        stack.enter_context(serving(answer_states, run_dir, settings))
        return apart(ticks, model, None, run_dir, settings, REPLY_WAIT, timing)


def read(
    make: Callable[[str], Callable[[], object]], port: str, settings: Settings, timing: Timing
) -> Round:
    """Measure exchanges at a port."""
    exchange = make(port)
    enter(settings, "device")
    freeze_garbage()
    return pace(lambda _: timed(exchange), settings, timing)


def driver_exchange(port: str) -> Callable[[], object]:
    """Return a reading by the driver."""
    device = ODrive(port=port, watchdog_limit=2.0 * TIMEOUT).open(None, TIMEOUT)
    return partial(device.read, 0)


def bare_exchange(port: str) -> Callable[[], object]:
    """Return an exchange with pyserial alone; the reply is one of a device at rest."""
    line = serial.Serial(port, timeout=TIMEOUT, write_timeout=TIMEOUT, exclusive=True)
    line.write(b"\n")  # ends what was cut short
    time.sleep(0.1)
    line.reset_input_buffer()
    message = request("f 0")
    line.write(message)
    size = len(line.read_until(b"\n"))

    def exchange() -> None:
        line.write(message)
        reply: bytes = line.read(size)
        assert reply.endswith(b"\n"), reply

    return exchange


def line_exchange(port: str) -> Callable[[], object]:
    """Return an exchange of the same bytes with an :func:`echo`."""
    descriptor, message = os.open(port, os.O_RDWR | os.O_NOCTTY), request("f 0")

    def exchange() -> bytes:
        os.write(descriptor, message)
        return os.read(descriptor, CHUNK)

    return exchange


def echo(port: str) -> None:
    """Send the bytes that come through a pseudo-terminal at ``port`` back at once, until killed."""
    be_punctual()
    descriptor, end = os.openpty()
    tty.setraw(end)
    os.symlink(os.ttyname(end), port)
    while True:
        os.write(descriptor, os.read(descriptor, CHUNK))
