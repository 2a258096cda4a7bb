"""How long a device takes to read and to write, and what its tick can then be.

A tick of two readings has the state's, and one right before the write. Where they do not fit into a
period, the bounder takes the state's reading (``readings_per_tick``): then the force acts later
after it, by ``reply_wait``, which ``write_delay`` has to cover (docs/theory.md, section 3.1).
"""

import logging
import math
from collections.abc import Callable, Iterator

from msgspec import Struct

from forcebound.errors import ConfigError
from forcebound.graph.servo import ServoSettings, check_delay, stated_delay
from forcebound.haptics.devices import Device, DeviceModel

OPENING_CALLS = 20
QUICKEST = 0.0  # by which a bus is judged then: before the loop the process is not punctual
FULL = 0.9  # of a period: two readings and the write must not take more
RARE = 0.01  # share of the calls; what is longer then is not stated, but counted in a run

_logger = logging.getLogger(__name__)


class TickTimes(Struct, frozen=True):
    """Times of a device's read and write, in s; ``reads``: how many of them a tick has.

    ``longest``: of a read and the write after it, but for one in a hundred.
    """

    read: float
    write: float
    reads: int
    longest: float = 0.0

    def of(self, reads: int) -> float:
        """Return what so many reads and a write take, in s."""
        return reads * self.read + self.write

    def delay(self, servo: ServoSettings) -> float:
        """Return how late after the only reading of a tick its force acts at least, in s."""
        return max(servo.reply_wait_ns * 1e-9, self.read) + self.write


def time_ticks(
    device: Device,
    clock: Callable[[], int],
    calls: int,
    seconds: float = math.inf,
    share: float = 0.5,
) -> TickTimes | None:
    """Return the times that a ``share`` of some ticks without force have kept; None without any."""
    times: list[tuple[int, int]] = []
    reads, zero, end_ns = 2, (0.0,) * device.axes, clock() + min(seconds, 1e9) * 1e9
    while len(times) < calls and (began := clock()) < end_ns:
        device.read(began)
        between = clock()
        device.write(between, zero)
        times.append((between - began, clock() - between))
        reads = 2 if device.fresh_reading() is None else 1
    if not times:
        return None
    read, write = (1e-9 * sorted(one)[int(share * len(one))] for one in zip(*times, strict=True))
    both = sorted(map(sum, times))
    longest = both[len(both) - 1 - math.floor(RARE * len(both))]
    return TickTimes(read, write, reads, 1e-9 * longest)


def reads_once(
    device: Device, model: DeviceModel, servo: ServoSettings, clock: Callable[[], int] | None
) -> bool:
    """Return whether a tick has one reading: as the settings say, or since two do not fit.

    Live, an open device is asked how long it takes. ConfigError if a tick is too short even so, or
    the ``write_delay`` for one reading.
    """
    asked = servo.readings_per_tick
    is_real = clock is not None and device.truth() is None and not device.is_exchange
    times = None
    if clock and is_real and asked != 2:
        times = time_ticks(device, clock, OPENING_CALLS, share=QUICKEST)
    period = servo.period_ns * 1e-9
    if times is None or (asked == "auto" and times.of(2) <= FULL * period):
        return asked == 1
    if times.of(1) > period:
        raise ConfigError(
            f"a read and a write of the device take {_ms(times.of(1))}, a tick {_ms(period)}: lower"
            f" device.rate to {_rate(times.of(1)):.0f} Hz or less",
            field="rate",
        )
    try:
        check_delay(model, times.delay(servo))
    except ConfigError as error:
        rate = _rate(times.of(2))
        raise ConfigError(
            f"two reads and a write of the device take {_ms(times.of(2))}, a tick {_ms(period)}:"
            f" {error}; or lower device.rate to {rate:.0f} Hz",
            field="write_delay",
        ) from None
    _logger.info(
        "one reading in a tick (%s for two and the write, of %s): its force acts %s after it, and"
        " device.write_delay of %s costs stiffness; `forcebound feel` says how much",
        *map(_ms, (times.of(2), period, times.delay(servo), model.write_delay)),
    )
    return True


def described(times: TickTimes, servo: ServoSettings | None) -> Iterator[str]:
    """Yield what times of a tick permit; ``servo``: the settings of a launch file."""
    reads = ("a read", "two reads")[times.reads - 1]
    line = f"a read takes {_us(times.read)}, a write {_us(times.write)}: {reads} and a write take"
    yield f"{line} {_us(times.of(times.reads))}, at most {_rate(times.of(times.reads)):.0f} Hz"
    delay = times.longest
    words = f"a read and a write (half take {_us(times.of(1))} or less, 99 of 100 {_us(delay)})"
    if times.reads == 2 and times.of(2) > 1e-3:
        once = _rate(times.of(1))
        yield f"with one reading in a tick (device.readings_per_tick: 1) at most {once:.0f} Hz"
    if servo is not None and (
        servo.readings_per_tick == 1
        or (
            servo.readings_per_tick == "auto"
            and times.of(times.reads) > FULL * servo.period_ns / 1e9
        )
    ):
        delay += times.delay(servo) - times.of(1)
        words += f"; one reading in a tick at {servo.rate:g} Hz, reply_wait {servo.reply_wait:g}"
    yield f"state device.write_delay: {stated_delay(delay):g} ms or more, for {words}"


def _rate(seconds: float) -> float:
    """Return the highest rate, rounded down to tens above 100 Hz."""
    rate = 1.0 / max(seconds, 1e-9)
    return math.floor(rate / 10.0) * 10.0 if rate > 100.0 else math.floor(rate)


def _ms(seconds: float) -> str:
    return f"{1e3 * seconds:.2g} ms"


def _us(seconds: float) -> str:
    return f"{1e6 * seconds:.1f} us" if seconds < 1e-3 else f"{1e3 * seconds:.3g} ms"
