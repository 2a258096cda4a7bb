"""The rig: a device that is read and written at a steady rate, within limits."""

import math
import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from forcebound import realtime
from forcebound.errors import DeviceError
from forcebound.haptics.devices import Device
from forcebound.messages.packets import Vector

Floats: TypeAlias = NDArray[np.float64]

#: Force of a tick, from the time since the start of the run, in s, and the reading.
Controller: TypeAlias = Callable[[float, Vector], Vector]

SPIN_NS = 30_000
LATE = 1.25  # periods; beyond, a watchdog may have dropped the force
STALL = 0.01  # s; a force that is held longer by this moves an axis far
SPEED_TICKS = 8  # over which the speed is watched
REST_TIMEOUT = 3.0  # s, for a device that comes to rest
STILL_TICKS, STILL = 60, 0.005  # share of the reach within these ticks


@dataclass(frozen=True)
class Limits:
    """Limits of what the rig does with a device, in its coordinates."""

    force: float  # N (joints: N m), largest of an axis
    speed: float  # m/s (rad/s); a faster axis stops the identification
    reach: float  # m (rad); so does one that is farther from where it began


class Trace(NamedTuple):
    """Trace of a run: a row for each tick."""

    read: Floats  # s, when readings were latched
    effect: Floats  # s, when forces began to act
    readings: Floats  # m (rad), of each axis
    forces: Floats  # N (N m), of each axis, positive against positive motion
    late: NDArray[np.bool_]  # intervals in which a watchdog may have acted


class Clock:
    """The monotonic clock of this machine, in ns."""

    def now(self) -> int:
        """Return the time."""
        return time.monotonic_ns()

    def wait_until(self, time_ns: int) -> None:
        """Return at this time, or at once if it has passed."""
        realtime.wait_until(time_ns, SPIN_NS)


class VirtualClock(Clock):
    """The time of a simulated device: it passes while somebody waits."""

    def __init__(self) -> None:
        self._now_ns = 0

    def now(self) -> int:
        """Return the time."""
        return self._now_ns

    def wait_until(self, time_ns: int) -> None:
        """Let the time pass."""
        self._now_ns = max(self._now_ns, time_ns)


class Rig:
    """A device, read and written once in each period.

    Args:
        device: Open.
        clock: Real or virtual.
        period: In s.
        limits: Of force, speed and reach.
        holds: Whether the device holds a force until the next one, however late that is.

    Attributes:
        start: From where the reach counts; where the device began, until it is set.
        intervals: Between two writes, in s.
        delays: From a reading to the effect of the write, in s.
    """

    def __init__(
        self, device: Device, clock: Clock, period: float, limits: Limits, holds: bool
    ) -> None:
        self.limits, self.period, self.axes = limits, period, device.axes
        self._device, self._clock, self._holds = device, clock, holds
        self._period_ns = round(period * 1e9)
        self._zero: Vector = (0.0,) * self.axes
        self._begun_ns = self._next_ns = clock.now()
        device.engage(self._begun_ns)
        self.start: Vector = device.read(self._next_ns)
        self._past = [(self._next_ns, self.start)]
        self._written_ns, self._held = self._next_ns, self._zero
        self.intervals: list[float] = []
        self.delays: list[float] = []

    def run(
        self,
        seconds: float,
        controller: Controller,
        until: Callable[[Vector], bool] = lambda reading: False,
    ) -> Trace:
        """Return the trace of a run under the forces of a controller.

        Args:
            seconds: How long.
            controller: Is asked in each tick.
            until: Ends the run early, at this reading.

        Raises:
            DeviceError: If the device fails, is too fast or too far, or this machine was late; the
                force is zero then.
        """
        rows: list[tuple[int, int, Vector, Vector]] = []
        start_ns = self._next_ns = max(self._next_ns, self._clock.now())
        end_ns = start_ns + round(1e9 * seconds) - self._period_ns // 2
        try:
            while True:
                rows.append(self._tick(start_ns, controller))
                if until(rows[-1][2]) or self._next_ns >= end_ns:
                    break
        except BaseException:
            self.release()
            raise
        return self._trace(rows)

    def release(self) -> None:
        """Write zero force."""
        self._held = self._zero
        self._device.write(self._clock.now(), self._zero)

    def _tick(self, start_ns: int, controller: Controller) -> tuple[int, int, Vector, Vector]:
        clock, device = self._clock, self._device
        clock.wait_until(self._next_ns)
        read_ns = clock.now()
        reading = device.read(read_ns)
        self._check(clock.now(), reading)  # a late reply is of a later place
        pushed, largest = controller((read_ns - start_ns) * 1e-9, reading), self.limits.force
        force = tuple([min(max(one, -largest), largest) for one in pushed])
        self._written_ns = clock.now()
        self._held = device.write(self._written_ns, force)
        effect_ns = clock.now()
        stamps = device.stamps()
        if stamps is not None:
            read_ns, effect_ns = stamps
        self.delays.append((effect_ns - read_ns) * 1e-9)
        self._next_ns = max(self._next_ns + self._period_ns, clock.now())
        return read_ns, effect_ns, reading, self._held

    def _check(self, time_ns: int, reading: Vector) -> None:
        """Check that the last force was not held for too long, and speed and reach."""
        late = 1e-9 * (time_ns - self._written_ns) - self.period if any(self._held) else 0.0
        if late > STALL:
            raise DeviceError(
                f"this machine was late by {1e3 * late:.0f} ms while a force was on; its load is"
                f" {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores: end other programs, see"
                " `forcebound doctor`, and identify again"
            )
        limits = self.limits
        before_ns, before = self._past[0]
        self._past = [*self._past[1 - SPEED_TICKS :], (time_ns, reading)]
        seconds = max((time_ns - before_ns) * 1e-9, self.period)
        for axis, (now, then, start) in enumerate(zip(reading, before, self.start, strict=True)):
            speed = abs(now - then) / seconds
            if not speed <= limits.speed:
                raise DeviceError(
                    f"axis {axis + 1} moves at {speed:.3g} per second, more than the limit of"
                    f" {limits.speed:.3g}: is it held, or does something push it? Let go of it"
                )
            if not abs(now - start) <= limits.reach:
                raise DeviceError(
                    f"axis {axis + 1} is {abs(now - start):.3g} away from where it began, more than"
                    f" the limit of {limits.reach:.3g}: let go of it, start in the middle of the"
                    " workspace, or choose a larger --reach"
                )

    def _trace(self, rows: list[tuple[int, int, Vector, Vector]]) -> Trace:
        read, effect, readings, forces = (np.array(column) for column in zip(*rows, strict=True))
        begin = 1e-9 * (effect - self._begun_ns)
        gaps = np.diff(begin)
        self.intervals += gaps.tolist()
        late = np.append(gaps > LATE * self.period, False) & (not self._holds)
        return Trace(1e-9 * (read - self._begun_ns), begin, readings, forces, late)


def rest(
    rig: Rig, seconds: float = 0.3, until: Callable[[Vector], bool] = lambda reading: False
) -> Trace:
    """Return the readings of the device that is left alone."""
    zero = (0.0,) * rig.axes
    return rig.run(seconds, lambda elapsed, reading: zero, until)


def come_to_rest(rig: Rig) -> Floats:
    """Wait until the device that is left alone does not move; return its readings."""
    seen: list[Vector] = []

    def is_still(reading: Vector) -> bool:
        seen.append(reading)
        past = seen[-1 - STILL_TICKS] if len(seen) > STILL_TICKS else None
        return past is not None and math.dist(reading, past) < STILL * rig.limits.reach

    return np.array(rest(rig, REST_TIMEOUT, is_still).readings[-1])
