"""The rig: a device that is read and written at a steady rate, within limits."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

from forcebound.devices import Device
from forcebound.errors import DeviceError
from forcebound.identification.clock import Clock
from forcebound.messages.packets import Vector

Floats: TypeAlias = "np.ndarray[Any, np.dtype[np.float64]]"

#: Force of a tick, from the time since the start of the run, in s, and the reading.
Controller: TypeAlias = Callable[[float, Vector], Vector]

LATE = 1.25  # periods; beyond, a watchdog may have dropped the force
STALLED = 0.01  # s; a force that was meant for a tick moves an axis far meanwhile
BUSY_NS = 2_000_000  # what a tick this late has begun ...
AFTERMATH_NS = 100_000_000  # ... may break a limit within this time
SPEED_TICKS = 8  # over which the speed is watched
PATIENCE = 3.0  # s, for a device that comes to rest
STILL_TICKS, STILL = 60, 0.005  # share of the reach within these ticks


class StallError(DeviceError):
    """The machine was late while a force was on: what was done then may be repeated."""


@dataclass(frozen=True)
class Limits:
    """What a device may be made to do, in its coordinates.

    Attributes:
        force: Largest force of an axis, in N (joints: N m).
        speed: A faster axis stops the identification, in m/s (rad/s).
        reach: So does one that is farther from where it began, in m (rad).
    """

    force: float
    speed: float
    reach: float


@dataclass(frozen=True)
class Trace:
    """What happened in a run: a row for each tick.

    Attributes:
        read: When readings were latched, in s.
        effect: When forces began to act, in s.
        readings: Of each axis, in m (rad).
        forces: Of each axis, in N (N m), positive against positive motion.
        late: Intervals after which a watchdog may have dropped the force.
    """

    read: Floats
    effect: Floats
    readings: Floats
    forces: Floats
    late: "np.ndarray[Any, np.dtype[np.bool_]]"


class Rig:
    """A device, read and written once in each period.

    Args:
        device: Open.
        clock: Real or virtual.
        period: In s.
        limits: Of force, speed and reach.
        holds: Whether the device holds a force until the next one, however late that is.
        bring_back: Lets somebody bring the device back to where it began.

    Attributes:
        first: Where the device began.
        start: From where the reach counts.
        longest_wait: By which a tick with a force on was late, in s.
        repetitions: Of movements, because of stalls.
    """

    def __init__(
        self,
        device: Device,
        clock: Clock,
        period: float,
        limits: Limits,
        holds: bool,
        bring_back: Callable[[], object] = lambda: None,
    ) -> None:
        self.limits = limits
        self.period = period
        self.axes = device.axes
        self.bring_back = bring_back
        self._device, self._clock, self._holds = device, clock, holds
        self._period_ns = round(period * 1e9)
        self._stamps = device.stamps
        self._zero: Vector = (0.0,) * self.axes
        self._begun_ns = self._next_ns = clock.now()
        self.engage()
        self.first: Vector = device.read(self._next_ns)
        self.start = self.first
        self._past = [(self._next_ns, self.start)]
        self._written_ns, self._held = self._next_ns, self._zero
        self._aftermath_ns = self._next_ns
        self.longest_wait, self.repetitions = 0.0, 0
        self.intervals: list[float] = []
        self.delays: list[float] = []

    @property
    def elapsed(self) -> float:
        """Time since the rig was made, in s."""
        return (self._clock.now() - self._begun_ns) * 1e-9

    def run(
        self,
        seconds: float,
        controller: Controller,
        until: Callable[[Vector], bool] = lambda reading: False,
        stalled: float = STALLED,
    ) -> Trace:
        """Return what happens under the forces of a controller.

        Args:
            seconds: How long.
            controller: Is asked in each tick.
            until: Ends the run early, at this reading.
            stalled: Time by which a force may be on for longer than a period, in s.

        Raises:
            StallError: If the machine was late; the force is zero then.
            DeviceError: If the device fails, is too fast or too far; its force is zero then.
        """
        rows: list[tuple[int, int, Vector, Vector]] = []
        start_ns = self._next_ns = max(self._next_ns, self._clock.now())
        end_ns = start_ns + round(1e9 * seconds) - self._period_ns // 2
        try:
            while True:
                rows.append(self._tick(start_ns, controller, stalled))
                if until(rows[-1][2]) or self._next_ns >= end_ns:
                    break
        except BaseException:
            self.release()
            raise
        return self._trace(rows)

    def engage(self) -> None:
        """Let go of the device, if a simulated hand has it."""
        self._device.engage(self._clock.now())

    def release(self) -> None:
        """Write zero force."""
        self._held = self._zero
        self._device.write(self._clock.now(), self._zero)

    def _tick(
        self, start_ns: int, controller: Controller, stalled: float
    ) -> tuple[int, int, Vector, Vector]:
        clock, device = self._clock, self._device
        clock.wait_until(self._next_ns)
        read_ns = clock.now()
        reading = device.read(read_ns)
        self._check(clock.now(), reading, stalled)  # a late reply is of a later place
        wanted, largest = controller((read_ns - start_ns) * 1e-9, reading), self.limits.force
        force = tuple([min(max(one, -largest), largest) for one in wanted])
        self._written_ns = clock.now()
        self._held = device.write(self._written_ns, force)
        effect_ns = clock.now()
        stamps = self._stamps()
        if stamps is not None:
            read_ns, effect_ns = stamps
        self.delays.append((effect_ns - read_ns) * 1e-9)
        self._next_ns = max(self._next_ns + self._period_ns, clock.now())
        return read_ns, effect_ns, reading, self._held

    def _check(self, time_ns: int, reading: Vector, stalled: float) -> None:
        """Check that the last force was not held for too long, and speed and reach."""
        late_ns = time_ns - self._written_ns - self._period_ns if any(self._held) else 0
        self.longest_wait = max(self.longest_wait, late_ns * 1e-9)
        if late_ns > BUSY_NS:
            self._aftermath_ns = time_ns + AFTERMATH_NS
        broken = self._broken(time_ns, reading)
        if late_ns > 1e9 * stalled or (broken and time_ns < self._aftermath_ns):
            raise StallError(broken or f"a force was on for {1e-6 * late_ns:.0f} ms too long")
        if broken:
            raise DeviceError(broken)

    def _broken(self, time_ns: int, reading: Vector) -> str:
        """Return which limit is broken, in words; empty: none."""
        limits = self.limits
        before_ns, before = self._past[0]
        self._past = [*self._past[1 - SPEED_TICKS :], (time_ns, reading)]
        seconds = max((time_ns - before_ns) * 1e-9, self.period)
        for axis, (now, then, start) in enumerate(zip(reading, before, self.start, strict=True)):
            speed = abs(now - then) / seconds
            if not speed <= limits.speed:
                return (
                    f"axis {axis + 1} moves at {speed:.3g} per second, more than the limit of"
                    f" {limits.speed:.3g}: is it held, or does something push it? Let go of it"
                )
            if not abs(now - start) <= limits.reach:
                return (
                    f"axis {axis + 1} is {abs(now - start):.3g} away from where it began, more than"
                    f" the limit of {limits.reach:.3g}: let go of it, start in the middle of the"
                    " workspace, or choose a larger --reach"
                )
        return ""

    def _trace(self, rows: list[tuple[int, int, Vector, Vector]]) -> Trace:
        read = 1e-9 * (np.array([row[0] for row in rows]) - self._begun_ns)
        effect = 1e-9 * (np.array([row[1] for row in rows]) - self._begun_ns)
        gaps = np.diff(effect)
        self.intervals += gaps.tolist()
        late = np.append(gaps > LATE * self.period, False)
        return Trace(
            read,
            effect,
            np.array([row[2] for row in rows], dtype=float),
            np.array([row[3] for row in rows], dtype=float),
            late & (not self._holds),
        )


def rest(
    rig: Rig, seconds: float = 0.3, until: Callable[[Vector], bool] = lambda reading: False
) -> Trace:
    """Return the readings of the device that is left alone."""
    zero = (0.0,) * rig.axes
    return rig.run(seconds, lambda elapsed, reading: zero, until)


def come_to_rest(rig: Rig, reach: float) -> Floats:
    """Wait until the device that is left alone does not move; return its readings.

    Args:
        rig: With the device.
        reach: Of which a small share counts as no motion, in m (rad).
    """
    seen: list[Vector] = []

    def is_still(reading: Vector) -> bool:
        seen.append(reading)
        past = seen[-1 - STILL_TICKS] if len(seen) > STILL_TICKS else None
        return past is not None and math.dist(reading, past) < STILL * reach

    return np.array(rest(rig, PATIENCE, is_still).readings[-1])
