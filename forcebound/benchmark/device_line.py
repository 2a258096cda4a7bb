"""Contestants of the device benchmark: round trips and ticks at the port of an emulated ODrive.

``driver`` asks the driver for a reading; ``bare`` does what is least with pyserial: it writes the
same bytes and reads as many as the reply has; ``line`` sends them to ``echo``, a pseudo-terminal
with nothing behind it that returns them at once, in the class and on the core of an emulator;
``tick`` runs ticks of the device node, which is answered as in
:mod:`forcebound.benchmark.servo_tick`::

    python -m forcebound.benchmark.device_line ROLE PORT FOLDER CORE POLICY PERIOD_NS COUNT
"""

import os
import sys
import time
import tty
from collections.abc import Callable
from pathlib import Path

import serial

from forcebound.benchmark.paced import pace, timed
from forcebound.benchmark.servo_tick import measure
from forcebound.benchmark.workers import enter_contestant
from forcebound.emulators.program import be_punctual
from forcebound.hardware.odrive import ODrive
from forcebound.hardware.odrive_lines import request
from forcebound.realtime import Settings, enter, freeze_garbage

TIMEOUT = 1.0  # s
CHUNK = 4096  # bytes; more than a pseudo-terminal keeps
REPLY_WAIT = 0.8  # of the launch files of serial devices


def bare_exchange(port: str) -> Callable[[], bytes]:
    """Return an exchange with pyserial alone; the reply is one of a device at rest."""
    line = serial.Serial(port, timeout=TIMEOUT, write_timeout=TIMEOUT, exclusive=True)
    message = b"\n" + request("f 0")  # the first ends what was cut short
    line.write(message)
    time.sleep(0.1)
    line.reset_input_buffer()
    message = request("f 0")
    line.write(message)
    size = len(line.read_until(b"\n"))

    def exchange() -> bytes:
        line.write(message)
        reply: bytes = line.read(size)
        assert reply.endswith(b"\n"), reply
        return reply

    return exchange


def line_exchange(port: str) -> Callable[[], bytes]:
    """Return an exchange of the same bytes with an :func:`echo`."""
    descriptor, message = os.open(port, os.O_RDWR | os.O_NOCTTY), request("f 0")

    def exchange() -> bytes:
        os.write(descriptor, message)
        return os.read(descriptor, CHUNK)

    return exchange


def echo(port: str) -> None:
    """Return what comes through a pseudo-terminal at ``port``, at once, until killed."""
    be_punctual()
    descriptor, end = os.openpty()
    tty.setraw(end)
    os.symlink(os.ttyname(end), port)
    while True:
        os.write(descriptor, os.read(descriptor, CHUNK))


def main(role: str, port: str, folder: Path, settings: Settings, timing: tuple[int, int]) -> None:
    """Run one contestant; ``timing``: period, in ns, and number of exchanges."""
    enter_contestant()
    if role == "echo":
        echo(port)
    model = ODrive(port=port, watchdog_limit=2.0 * TIMEOUT)  # a round may be disturbed
    if role == "tick":
        measure(model, None, folder, settings, *timing, REPLY_WAIT)
        os._exit(0)  # without waiting for the sockets
    if role == "driver":
        device = model.open(None, TIMEOUT)

        def exchange() -> object:
            return device.read(0)
    else:
        exchange = {"bare": bare_exchange, "line": line_exchange}[role](port)
    enter(settings, "device")
    freeze_garbage()
    pace(timed(exchange), settings.spin_ns, *timing)
    if role == "driver":
        device.close()


if __name__ == "__main__":
    _role, _port, _folder, _core, _policy, _period_ns, _count = sys.argv[1:]
    _settings = Settings(policy=_policy, core=int(_core))
    main(_role, _port, Path(_folder), _settings, (int(_period_ns), int(_count)))
