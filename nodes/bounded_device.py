"""A device behind its bounder: reading, hold limit, bounding, writing, in one call.

At each write the bounder hears what really happened since the last one, before it decides:

1. *When.* The time of the reading, and later the time from which the written force acts: from the
   device's stamps; else from the clock, before the read and after the write, so that the time
   between them is never taken for shorter than it is; else the time of the tick. The same distance
   over a longer time dissipates less, so adding the uncertainty of a stamp to the interval is safe.
   The bounder's clock runs ahead by it.
2. *Cuts.* Where and when a guarding or reporting watchdog has dropped a force.
3. *The hold limit* of the force to come. The device is given it before the write, and the bounder
   plans with the limit that the device returns.

With one reading in a tick the bounder takes that of the state. Its true time counts, so for the
ledger the write comes later after its reading, by as much as the device must state. Where it would
come later still, since a tick is late, there is a second reading after all.

An arm (a device with ``kinematics``) is bounded in its joints: its readings are angles, its forces
torques, and the command becomes the torques of that force at the tip. Saturation and law scale the
vector of torques, so what is applied is the same part of the commanded force at the tip, unless the
law adds damping or the motors have steps.
"""

import math
from collections.abc import Callable
from dataclasses import replace

from msgspec import Struct

from forcebound.haptics.devices import Device
from forcebound.haptics.devices.kinematics import tip_force
from forcebound.haptics.laws import Dissipation, ForceBounder
from forcebound.haptics.laws.bounder import saturated, shorten
from forcebound.haptics.laws.hold_limit import FIXED, HoldLimit
from forcebound.haptics.laws.ledger import SETTLED
from forcebound.haptics.parts import overridden
from forcebound.messages.control import BounderReport
from forcebound.messages.packets import Vector


class Written(Struct, frozen=True, gc=False):
    """Result of one write, at the tip."""

    position: Vector  # m, of the reading that the bounder used
    applied: Vector  # N
    limit: float  # N, largest magnitude that law and saturation allowed in this direction
    read_ns: int  # device's clock, when the position was read
    write_ns: int  # likewise, from when on the force acts
    joints: Vector | None  # rad, reading of an arm
    torques: Vector | None  # N m, that were applied by an arm
    cut: tuple[int, Vector] | None  # of the force before: when, in ns, and the reading then
    ahead_ns: int | None  # by how much the bounder's clock is ahead; None: its device is certain
    given: float  # J, to the ledger of another hand


class BoundedDevice:
    """A device, open, whose every force is bounded, and zero before :meth:`begin`.

    The hold limit ``learns`` the lateness of the ticks, if that is possible. ``clock`` returns the
    time, in ns; None: everything in a tick happens at the time of the tick. ``exchanges``: energy
    with the ledger of another hand. ``reads_once``: the reading of the state is the bounder's, too.

    Attributes:
        busy_ns: Time in reads and writes of the device so far, by the clock.
    """

    def __init__(
        self,
        device: Device,
        law: str,
        dissipation: Dissipation,
        learns: bool,
        clock: Callable[[], int] | None = None,
        exchanges: bool = False,
        reads_once: bool = False,
    ) -> None:
        self._device = device
        self._reads_once = reads_once
        self._newest: tuple[int, Vector] | None = None  # reading of this tick, and its time
        self._write_delay_ns = round(dissipation.write_delay * 1e9)
        self.busy_ns = self._writing_ns = 0  # so far; in the last write
        self._exchanges = exchanges
        self._clock = clock
        self._kinematics = device.kinematics
        self._stamps, methods = device.stamps, overridden(device, Device)
        self._jitter = device.latch_jitter if "latch_jitter" in methods else None
        self._fresh_reading = device.fresh_reading if "fresh_reading" in methods else None
        self._ahead_ns = 0  # of the bounder's clock
        self._reports_cuts = dissipation.watchdog in ("guarding", "reporting")
        self.takes_limit = device.set_hold_limit(dissipation.hold_limit) is not None
        self.learns = learns and (self.takes_limit or dissipation.watchdog == "none")
        self._hold_limit = HoldLimit(round(dissipation.period * 1e9), dissipation.watchdog)
        self._is_fixed = learns and not self.learns
        if self._is_fixed:
            dissipation = replace(dissipation, hold_limit=FIXED * dissipation.period)
        self._dissipation = dissipation
        self._use_limit = dissipation.hold_limit
        self._zero: Vector = (0.0,) * device.axes
        # Whether the last force was zero, and since when the motors have none. Live, a process
        # before this one may have left some.
        self._is_zero, self._gone_ns = clock is None, 0
        self._read_ns = 0
        self._has_begun = False
        self._write_ns: int | None = None
        self._begin_ledger(law)
        self._start_counting()

    def begin(self) -> None:
        """Count and learn from now on: the force engages, and the ledger begins."""
        self._has_begun, self._write_ns = True, None
        self._restart_learning()
        self._start_counting()

    def _start_counting(self) -> None:
        # Of the bounders of earlier laws.
        self._before = BounderReport(hold_limit=0.0, longest_hold_limit=0.0)
        self._longest_delay_ns = 0
        self._writes, self._held = 0, 0.0
        self._busy_before_ns = self.busy_ns
        self._longest = 0.0

    def change_law(self, law: str) -> None:
        """Begin a new ledger under another law; only while :attr:`holds_force` is false.

        What it gives depends on nothing before, so a recording can be verified from here on.
        """
        self._before = self.report()
        self._begin_ledger(law)

    def _begin_ledger(self, law: str) -> None:
        self.law = law
        self.bounder = ForceBounder(law, self._dissipation, len(self._zero), self._exchanges)
        self._write_ns = None
        self._restart_learning()

    def _restart_learning(self) -> None:
        self._hold_limit.restart()
        self._change_limit()

    @property
    def holds_force(self) -> bool:
        """True if the motors may have a force at the next reading.

        One that was written and does not act yet, or what an amplifier with a lag has left of it.
        """
        return not self._is_zero or self._read_ns < self._gone_ns

    @property
    def refused_readings(self) -> int:
        """Readings that were rejected since :meth:`begin`."""
        return self._before.refused_readings + self.bounder.refused_readings

    def read(self, time_ns: int) -> Vector:
        """Return the position of the tip, in m, for a state."""
        reading = None if self._fresh_reading is None else self._fresh_reading()
        if reading is None:
            self._newest = self._read(time_ns)
            reading = self._newest[1]
        return reading if self._kinematics is None else self._kinematics.position(reading)

    def _read(self, time_ns: int) -> tuple[int, Vector]:
        """Return a new reading, and before it the time of which it is at the earliest."""
        if self._clock is None:
            return time_ns, self._device.read(time_ns)
        read_ns = self._clock()
        reading = self._device.read(time_ns)
        self.busy_ns += self._clock() - read_ns
        return read_ns, reading

    def _reading(self, time_ns: int) -> tuple[int, Vector]:
        """Return the bounder's reading: the state's, unless a force would be too late for it."""
        newest, self._newest = self._newest, None
        now_ns = time_ns if self._clock is None else self._clock()
        latest_ns = now_ns + self._writing_ns - self._write_delay_ns
        if newest is None or not self._reads_once or newest[0] < latest_ns:
            return self._read(time_ns)
        return newest

    def write(
        self,
        time_ns: int,
        commanded: Vector,
        engagement: float,
        credit: float = 0.0,
        offer: Callable[[float], float] | None = None,
    ) -> Written:
        """Read, bound, write.

        ``commanded`` is the force at the tip, in N, before saturation; ``engagement`` the factor of
        the engage ramp that it contains, 0 to 1. ``credit`` has come from another hand; ``offer``
        returns how much may be given to it of what the force leaves (negative: lacks); both in J.
        """
        device, bounder, kinematics = self._device, self.bounder, self._kinematics
        read_ns, reading = self._reading(time_ns)
        if (stamps := self._stamps()) is not None:
            read_ns = stamps[0]
        before_ns = ahead_ns = self._ahead_ns  # at the last reading, and so at a cut since
        jitter_ns = None if self._jitter is None else self._jitter()
        if jitter_ns is not None:
            self._ahead_ns = ahead_ns = before_ns + jitter_ns
        read_ns += ahead_ns
        position, asked, cut, given = reading, commanded, None, 0.0
        if kinematics is not None:
            position = kinematics.position(reading)
            asked = kinematics.torque(reading, commanded)
        if self._write_ns is None:  # the ledger begins here, with no force held
            bounder.start(read_ns, reading)
            bounded = self._zero
        else:
            if self._reports_cuts:
                cut = device.cut()
            if cut is not None:
                bounder.report_cut(cut[0] + before_ns, cut[1])
            if credit:
                bounder.credit(credit)
            asked_for = saturated(asked, self._dissipation.saturation * engagement)
            bounded = bounder.bound(read_ns, reading, asked_for, jitter_ns or 0)
            if offer is not None:
                given = bounder.debit(offer(bounder.spare(asked_for)))
                bounded = shorten(bounded, math.hypot(*bounded), bounder.limit)
        began_ns = time_ns if self._clock is None else self._clock()
        applied = device.write(time_ns, bounded)
        write_ns = time_ns if self._clock is None else self._clock()
        self._writing_ns = write_ns - began_ns
        if (stamps := self._stamps()) is not None:
            write_ns = stamps[1]
        write_ns += ahead_ns
        bounder.settle(applied, write_ns)
        self._note(applied, read_ns, write_ns)
        tip, limit, joints, torques = applied, bounder.limit, None, None
        if kinematics is not None:
            joints, torques = reading, applied
            tip = tip_force(kinematics, reading, applied, commanded, asked)
            limit *= math.hypot(*commanded) / (math.hypot(*asked) or math.inf)
        read_ns, write_ns = read_ns - ahead_ns, write_ns - ahead_ns
        ahead = None if jitter_ns is None else ahead_ns
        return Written(position, tip, limit, read_ns, write_ns, joints, torques, cut, ahead, given)

    def _note(self, applied: Vector, read_ns: int, write_ns: int) -> None:
        self._read_ns = read_ns - self._ahead_ns
        self.busy_ns += self._writing_ns
        if applied != self._zero:
            self._is_zero = False
        elif not self._is_zero:
            settling_ns = round(SETTLED * self._dissipation.lag * 1e9)
            self._is_zero, self._gone_ns = True, write_ns - self._ahead_ns + settling_ns
        if write_ns - read_ns > self._longest_delay_ns:
            self._longest_delay_ns = write_ns - read_ns
        use_limit = self._use_limit
        self._writes += 1
        self._held += use_limit
        if use_limit > self._longest:
            self._longest = use_limit
        interval_ns = 0 if self._write_ns is None else write_ns - self._write_ns
        if self._has_begun:
            self._write_ns = write_ns
        if self.learns and self._hold_limit.observe(interval_ns):
            self._change_limit()

    def describe(self) -> str:
        """Return how long a force is held, and what ends it, in words."""
        dissipation = self._dissipation
        limit = f"hold limit {self._use_limit * 1e3:.3g} ms"
        if self.learns:
            limit += " or longer, as late as ticks are"
        elif self._is_fixed:
            limit += ", which this device cannot change (no set_hold_limit)"
        if dissipation.watchdog != "none":
            return f"{limit}; {dissipation.watchdog} watchdog"
        last = f"no watchdog until {dissipation.watchdog_limit * 1e3:.3g} ms"
        if dissipation.allowance:
            return f"{limit}; {last}: late holds may leak {dissipation.allowance:.2g} J"
        return f"{limit}; {last}: strict, so every force is planned for that time"

    def report(self) -> BounderReport:
        """Return what the bounder has met since :meth:`begin`."""
        before, bounder = self._before, self.bounder
        return BounderReport(
            overruns=before.overruns + bounder.overruns,
            refused_readings=self.refused_readings,
            late_writes=before.late_writes + bounder.late_writes,
            crowded_writes=before.crowded_writes + bounder.crowded_writes,
            largest_allowance=max(before.largest_allowance, bounder.largest_allowance),
            allowance_repaid=before.allowance_repaid and bounder.allowance_repaid,
            fast_holds=before.fast_holds + bounder.fast_holds,
            speed_leak=before.speed_leak + bounder.speed_leak,
            hold_limit=self._held / self._writes if self._writes else self._use_limit,
            longest_hold_limit=self._longest or self._use_limit,
            longest_write_delay=self._longest_delay_ns * 1e-9,
            device_time=1e-9 * (self.busy_ns - self._busy_before_ns) / max(self._writes, 1),
        )

    def _change_limit(self) -> None:
        """Use the limit that is stated, or learned: more where the watchdog may cut before it."""
        seconds = self._dissipation.hold_limit
        if self.learns:
            certain = 1.0 - self._dissipation.watchdog_tolerance
            seconds = self._hold_limit.limit_ns * 1e-9 / certain
        set_limit = self._device.set_hold_limit(seconds)
        self._use_limit = seconds if set_limit is None else set_limit
        self.bounder.set_hold_limit(self._use_limit)
