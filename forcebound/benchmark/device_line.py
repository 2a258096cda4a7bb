"""Contestants of the device benchmark: round trips and ticks at the port of an emulated ODrive.

``driver`` asks the driver for a reading; ``bare`` does what is least with pyserial: it writes the
same bytes and reads as many as the reply has; ``tick`` runs ticks of the device node, which is
answered as in :mod:`forcebound.benchmark.servo_tick`::

    python -m forcebound.benchmark.device_line ROLE PORT FOLDER CORE POLICY PERIOD_NS COUNT
"""

import os
import sys
import time
from collections.abc import Callable
from pathlib import Path

import serial

from forcebound.benchmark.servo_tick import measure
from forcebound.benchmark.workers import WARMUP, Stopwatch, enter_contestant
from forcebound.hardware.odrive import ODrive
from forcebound.hardware.odrive_lines import request
from forcebound.realtime import Settings, enter, freeze_garbage, wait_until

TIMEOUT = 1.0  # s


def pace(exchange: Callable[[], object], spin_ns: int, period_ns: int, count: int) -> None:
    """Measure ``count`` exchanges, one a period, and write them to standard output."""
    times_ns: list[int] = []
    missed, watch = 0, Stopwatch()
    next_ns = time.monotonic_ns() + period_ns
    for index in range(-WARMUP, count):
        if index == 0:
            times_ns.clear()
            missed, watch = 0, Stopwatch()
        begun_ns = wait_until(next_ns, spin_ns)
        exchange()
        ended_ns = time.monotonic_ns()
        times_ns.append(ended_ns - begun_ns)
        late = max(ended_ns - next_ns, 0) // period_ns
        missed += late
        next_ns += period_ns * (1 + late)
    watch.write_times(times_ns, missed)


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


def main(role: str, port: str, folder: Path, settings: Settings, timing: tuple[int, int]) -> None:
    """Run one contestant; ``timing``: period, in ns, and number of exchanges."""
    enter_contestant()
    model = ODrive(port=port, watchdog_limit=2.0 * TIMEOUT)  # a round may be disturbed
    if role == "tick":
        measure(model, None, folder, settings, *timing)
        os._exit(0)  # without waiting for the sockets
    if role == "bare":
        exchange: Callable[[], object] = bare_exchange(port)
    else:
        device = model.open(None, TIMEOUT)

        def exchange() -> object:
            return device.read(0)

    enter(settings, "device")
    freeze_garbage()
    pace(exchange, settings.spin_ns, *timing)
    if role == "driver":
        device.close()


if __name__ == "__main__":
    _role, _port, _folder, _core, _policy, _period_ns, _count = sys.argv[1:]
    _settings = Settings(policy=_policy, core=int(_core))
    main(_role, _port, Path(_folder), _settings, (int(_period_ns), int(_count)))
