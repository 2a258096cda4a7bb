"""How long a device takes to read and to write, and what its tick can then be.

A tick of two readings has the state's, and one right before the write. Where they do not fit into a
period, the bounder takes the state's reading (``readings_per_tick``): then the force acts later
after it, by ``reply_wait``, which ``write_delay`` has to cover (docs/theory.md, section 3.1).
"""

import logging
import math
from collections.abc import Callable, Iterator
from dataclasses import replace

from msgspec import Struct

from forcebound.axes import Axis
from forcebound.errors import ConfigError
from forcebound.graph.servo import ServoSettings, check_delay, stated_delay
from forcebound.haptics.devices import Device, DeviceModel
from forcebound.hardware.driven import DrivenModel
from forcebound.messages.packets import Vector

OPENING_CALLS = 20
QUICKEST = 0.0  # by which a bus is judged then: before the loop the process is not punctual
FULL = 0.9  # of a period: two readings and the write must not take more
RARE = 0.01  # share of the calls; what is longer then is not stated, but counted in a run

_logger = logging.getLogger(__name__)


class TickTimes(Struct, frozen=True):
    """Times of a device's read and write, in s; ``reads``: how many of them a tick has.

    ``longest``: of a read and the write after it, but for one in a hundred; ``reading``: the last.
    """

    read: float
    write: float
    reads: int
    longest: float = 0.0
    reading: Vector = ()

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
    reading: Vector = ()
    while len(times) < calls and (began := clock()) < end_ns:
        reading = device.read(began)
        between = clock()
        device.write(between, zero)
        times.append((between - began, clock() - between))
        reads = 2 if device.fresh_reading() is None else 1
    if not times:
        return None
    read, write = (1e-9 * sorted(one)[int(share * len(one))] for one in zip(*times, strict=True))
    both = sorted(map(sum, times))
    longest = both[len(both) - 1 - math.floor(RARE * len(both))]
    return TickTimes(read, write, reads, 1e-9 * longest, reading)


def reads_once(
    device: Device, model: DeviceModel, servo: ServoSettings, clock: Callable[[], int] | None
) -> bool:
    """Return whether a tick has one reading: as the settings say, or since two do not fit.

    Live, an open device is asked how long it takes. ConfigError if a tick is too short even so, or
    the ``write_delay`` for one reading.
    """
    times, period = None, servo.period_ns * 1e-9
    is_real = device.truth() is None and not device.is_exchange
    if clock is not None and is_real and servo.readings_per_tick != 2:
        times = time_ticks(device, clock, OPENING_CALLS, share=QUICKEST)
    if times is not None and (doubt := doubted_unit(times, model)):
        _logger.warning("%s", doubt)
    if times is None or not _needs_one(times, servo):
        return servo.readings_per_tick == 1
    both = f"a read and a write of the device take {_ms(times.of(1))}"
    if fits := _rate_that_fits(times, servo):
        rate = f"lower device.rate to {fits} Hz or less"
        raise ConfigError(f"{both}, a tick {_ms(period)}: {rate}", field="rate")
    try:
        check_delay(model, times.delay(servo))
    except ConfigError as error:
        rate = f"or lower device.rate to {_rate(times.of(2))} Hz, for two readings"
        raise ConfigError(f"{both}: {error}; {rate}", field="write_delay") from None
    remedy = "`forcebound feel` says how much"
    if servo.energy_partner or isinstance(model, DrivenModel):  # coupled, or no operator
        remedy = "state 1.5 times what `forcebound check device` says"
    _logger.info(
        "one reading in a tick (two and a write take %s of %s): its force acts %s after it, and"
        " device.write_delay of %s costs stiffness; %s",
        *map(_ms, (times.of(2), period, times.delay(servo), model.write_delay)),
        remedy,
    )
    return True


def described(times: TickTimes, servo: ServoSettings | None) -> Iterator[str]:
    """Yield what times of a tick permit; ``servo``: the settings of a launch file."""
    took, delay, words = times.of(times.reads), times.longest, "a read and a write"
    yield (
        f"a read takes {_ms(times.read)}, a write {_ms(times.write)}:"
        f" {('a read', 'two reads')[times.reads - 1]} and a write take {_ms(took)}, at most"
        f" {_rate(took)} Hz; with one reading in a tick {_rate(times.of(1))} Hz"
    )
    start = "state"
    if servo is not None and _needs_one(times, servo):
        if fits := _rate_that_fits(times, servo):
            start = f"{servo.rate:g} Hz does not fit: state device.rate: {fits} Hz and"
            servo = replace(servo, rate=float(fits))
        delay += times.delay(servo) - times.of(1)
        words = f"one reading in a tick at {servo.rate:g} Hz, reply_wait {servo.reply_wait:g}"
    yield (
        f"{start} device.write_delay: {stated_delay(delay):g} ms, for {words} (half take"
        f" {_ms(times.of(1))} or less, 99 of 100 {_ms(times.longest)})"
    )


def doubted_unit(times: TickTimes, model: DeviceModel) -> str:
    """Return a warning about joints beyond one turn in rad: their unit may be missing; or ""."""
    if not isinstance(model, DrivenModel) or getattr(model, "positions", "rad") != "rad":
        return ""
    joints = zip(model.named_axes, times.reading, strict=False)
    far = [f"{axis.name} is at {at:.4g} rad" for axis, at in joints if _is_far(axis, at)]
    advice = "more than one turn: does the class count degrees or turns (positions: deg)?"
    return f"{', '.join(far)}, {advice}" if far else ""


def _is_far(axis: Axis, at: float) -> bool:
    return axis.kind == "angle" and abs(at) > math.tau


def _needs_one(times: TickTimes, servo: ServoSettings) -> bool:
    if servo.readings_per_tick != "auto":
        return servo.readings_per_tick == 1
    return times.reads == 2 and times.of(2) > FULL * servo.period_ns * 1e-9


def _rate_that_fits(times: TickTimes, servo: ServoSettings) -> int:
    """Return the highest rate, in Hz, for a tick too short even for one reading; 0: it fits."""
    once = times.of(1)
    return _rate(once) if once > servo.period_ns * 1e-9 else 0


def _rate(seconds: float) -> int:
    """Return the highest rate, in Hz, rounded down to tens above 100."""
    rate = math.floor(1.0 / max(seconds, 1e-9))
    return rate // 10 * 10 if rate > 100 else rate


def _ms(seconds: float) -> str:
    return f"{1e3 * seconds:.2g} ms"
