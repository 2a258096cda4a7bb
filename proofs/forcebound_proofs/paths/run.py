"""One attack along a path: a device, genes, the live bounder by its public calls, the truth."""

import math
from dataclasses import dataclass
from functools import cache
from typing import Any, NamedTuple, Protocol

import numpy as np

from forcebound.compiled import jit, new_records
from forcebound.haptics.laws import Dissipation, ForceBounder
from forcebound.haptics.laws.bounder import shorten
from forcebound_proofs.paths import interval
from forcebound_proofs.paths.path import PLACES, Account, Manner, plan_of
from forcebound_proofs.paths.truth import Floats

Vector = tuple[float, ...]

SHORTEST_NS = 1000  # a law takes no reading that comes sooner after the last
WORST_STAMP_NS = 2_000_000  # error of a stamp that is wrong
WRONG_BY = 0.01  # m, of a reading that is wrong

#: Columns of a trace, SI units, of the first axis; ``lowest``: so far, ends of holds included.
TRACE_COLUMNS = ("time", "position", "reading", "commanded", "force", "energy", "lowest")


@dataclass(frozen=True)
class AttackedDevice:
    """A device as it is, as it is described to the bounder, and how the attack reads its genes."""

    law: str  # key of forcebound.haptics.laws.LAWS
    stated: Dissipation  # to the bounder
    devices: Any  # of ``truth``: the device at rest, and its copies
    manner: Manner
    watchdog: str = "silent"  # what the device does with a force that is too old
    tolerance: float = 0.0  # of a silent watchdog
    late: float = 0.0  # s, hold of a late tick; 0: none is tried
    allowance: float = 0.0  # J, that a late hold may leak
    write_delay: float = 0.0  # s, largest time from reading to writing
    hold_limits: tuple[float, ...] = ()  # s, among which the hold limit changes
    owes: bool = False  # writes are later than stated: the bounder says what they can have given
    owes_speed: bool = False  # the hand is faster than stated: the same
    #: The estimate of the law is compared with the truth, and nothing else: for a weight that acts
    #: after a cut, which no law can prevent.
    ledger_only: bool = False
    refused: float = 0.0  # share of readings that are wrong by more than r
    glitch: float = 0.0  # m/s, largest speed: such readings imply more; 0: they are not finite
    wrong_readings: float = 0.0  # share of readings that are wrong by 10 mm
    late_stamps: float = 0.0  # share of the stamps that are up to 2 ms late
    lost_writes: float = 0.0  # share of the writes that do not arrive, unknown to the law

    @property
    def axes(self) -> int:
        """Number of axes, 1 to 3."""
        return int(self.devices[0].axes)


class PathResult(NamedTuple):
    """What a run has found."""

    #: Lowest energy, the worst end of each hold included. If holds may be late: the most that it
    #: fell in a punctual hold while it was below zero, or that it was below zero beyond the
    #: allowance that the bounder reports.
    lowest_j: float
    late_margin_j: float  # lowest energy within late holds, plus the allowance
    peak_j: float  # largest energy
    share_left: float  # lowest energy over the peak before it, once that exceeds LEAST_PEAK
    left_j: float  # lowest energy after a peak of LARGE_PEAK
    excess_j: float  # largest estimate above the truth, at a reading that the law took
    samples: int

    @property
    def worst(self) -> float:
        """Lowest energy, J; of late holds above the allowance, of the truth above the ledger."""
        return min(self.lowest_j, self.late_margin_j, -self.excess_j)


class Transfers(Protocol):
    """What goes on between the ledgers of two hands, as one of them sees it."""

    def begins(self, index: int, time_ns: int) -> bool:
        """Return whether another ledger begins at a sample; no force has been held before it."""
        ...

    def ends(self, index: int) -> bool:
        """Return whether the ledger ends with the interval, which then has no force."""
        ...

    def credit(self, bounder: ForceBounder, time_ns: int) -> float:
        """Credit to a ledger what has come for it, in J; return it."""
        ...

    def debit(self, bounder: ForceBounder, time_ns: int, commanded: Vector) -> float:
        """Let a ledger give energy, in J; return it."""
        ...


@cache
def _tick() -> Any:
    return jit(interval.tick)


def run(
    case: AttackedDevice,
    genes: Floats,
    bounder: ForceBounder,
    start: Floats,
    trace: list[Vector] | None = None,
) -> PathResult:
    """Attack once.

    Args:
        case: The device.
        genes: Shape ``(rows, COLUMNS)``.
        bounder: Of the case; it is started again.
        start: Bristle at the start, shares of the presliding, shape ``(3,)``.
        trace: Gets a row of ``TRACE_COLUMNS`` for each sample.
    """
    walk = Walk(case, genes, bounder, start, trace)
    for index in range(len(walk.plan)):
        walk.step(index)
    return walk.result()


class Walk:
    """One attack, interval by interval.

    With ``transfers`` the energies here are those of the hand and of what was credited to it, less
    what its ledger has given: what the law keeps above zero.
    """

    def __init__(
        self,
        case: AttackedDevice,
        genes: Floats,
        bounder: ForceBounder,
        start: Floats,
        trace: list[Vector] | None = None,
        transfers: "Transfers | None" = None,
    ) -> None:
        stated, device = case.stated, case.devices[0]
        self.case, self.bounder, self._trace, self._transfers = case, bounder, trace, transfers
        self._devices, self._accounts = case.devices.copy(), new_records(Account)
        self.account: Any = self._accounts[0]
        way = np.maximum(device.error + device.presliding, 1e-7)
        limits = _hold_limits(case, genes)
        self.plan = plan_of(genes, case.manner, stated.period, limits, case.write_delay, way)
        _begin(case, self._devices[0], self.account, start)
        self.account.reading[:] = device.error * self.plan["misread"][0]
        reading = self._vector(self.account.reading)
        bounder.start(0, reading)
        self._calls = _Calls(case, self.plan, limits, bounder, reading)
        self._zero = self._force = (0.0,) * case.axes
        self.time_ns, self._excess, self._hidden, self._before = 0, -math.inf, 0.0, 0.0

    def _vector(self, vector: Floats) -> Vector:
        return tuple(vector[: self.case.axes].tolist())

    def step(self, index: int) -> None:
        """Go through the sample at the beginning of an interval, then through the interval."""
        if index > 0:
            self._sample(index)
        self.account.force[: self.case.axes] = self._force
        _tick()(self._devices, self._accounts, self.plan, index)
        self.time_ns += self._calls.durations[index]

    def _sample(self, index: int) -> None:
        case, bounder, calls, account = self.case, self.bounder, self._calls, self.account
        time_ns, transfers = self.time_ns, self._transfers
        reading, command = self._vector(account.reading), self._vector(account.commanded)
        calls.before(index, time_ns, account)
        if transfers is not None and transfers.begins(index, time_ns):
            calls.begin(time_ns, reading)
            shown, force = reading, self._zero
        else:
            shown = calls.shown(index, time_ns, reading)
            if transfers is not None:
                account.energy += transfers.credit(bounder, time_ns)
            force = bounder.bound(time_ns + calls.late_ns[index], shown, command)
            if transfers is not None:
                account.energy -= transfers.debit(bounder, time_ns, command)
                force = shorten(force, math.hypot(*force), bounder.limit)
                force = self._zero if transfers.ends(index) else force
        if calls.applied[index] < 1.0:
            force = tuple([calls.applied[index] * f for f in force])
        calls.settle(index, time_ns, force)
        if case.late > 0.0 and not case.owes_speed:
            # Known once the late force is replaced, which may be after the next reading.
            self._hidden = min(self._hidden, self._before + bounder.largest_allowance)
            self._before = float(account.lowest)
        if case.owes:
            self._hidden = min(self._hidden, float(account.lowest) + bounder.largest_allowance)
        if case.owes_speed:
            most = max(bounder.speed_leak, bounder.largest_allowance)
            self._hidden = min(self._hidden, self._before + most)
            self._before = float(min(account.lowest, account.lowest_end))
        if calls.is_taken:
            self._excess = max(self._excess, bounder.estimated_energy - float(account.energy))
        calls.set_holds(index, account)
        if self._trace is not None:
            energies = float(account.energy), float(min(account.lowest_end, account.lowest))
            place = float(self._devices[0].position[0])
            row = (time_ns / 1e9, place, shown[0], command[0], force[0], *energies)
            self._trace.append(row)
        self._force = force

    def result(self) -> PathResult:
        """Return what the attack has found."""
        return _result(self.case, self.account, self._hidden, self._excess, len(self.plan))


def _result(
    case: AttackedDevice, account: Any, hidden: float, excess: float, samples: int
) -> PathResult:
    lowest = min(float(account.lowest_end), float(account.lowest))
    if case.owes or case.owes_speed:
        lowest = hidden
    # Then any hold so far may have been late.
    late = case.late > 0.0 and not case.owes_speed
    counted = min(float(account.fallen), hidden) if late else lowest
    return PathResult(
        0.0 if case.ledger_only else counted,
        min(float(account.lowest_late_end), lowest) + case.allowance if late else math.inf,
        float(account.peak),
        float(account.share),
        float(account.left),
        excess,
        samples,
    )


def _begin(case: AttackedDevice, device: Any, account: Any, start: Floats) -> None:
    """Set the state before the first sample; a bristle is as far bent as it can be, at most."""
    bent = np.clip(start, -1.0, 1.0)
    bent[device.axes :] = 0.0
    size = math.sqrt(float(bent @ bent))
    if device.is_along_path and size > 1.0:
        bent /= size
    device.bristle[:] = device.presliding * bent
    device.target[:] = device.output[:] = -device.compensation
    # A hand may have what the bristles give until they carry the error of the weight.
    widths, friction = np.maximum(device.presliding, 1e-300), np.maximum(device.friction, 1e-300)
    error = device.weight - device.gain * device.compensation
    away = device.bristle + error / friction * widths
    account.energy = float(np.sum(device.friction / widths * away**2) / 2.0)
    account.share = account.left = account.cut_after = math.inf
    account.cut_time = -1.0
    account.hold, account.longest_hold = math.inf, case.stated.hold_limit
    account.reading_mode, account.command_mode = case.manner.reading, case.manner.command


def _hold_limits(case: AttackedDevice, genes: Floats) -> Floats:
    """Return the hold limit of the force of each row, s."""
    limits = np.full(len(genes), case.stated.hold_limit)
    if case.hold_limits:
        choice = np.abs(genes[:, PLACES["cut"]] * 7.0).astype(int)
        every = np.array([case.stated.hold_limit, *case.hold_limits])
        limits = every[choice % len(every)]
    return limits


class _Calls:
    """The calls to the bounder besides ``bound``, and the readings that it must refuse."""

    def __init__(
        self,
        case: AttackedDevice,
        plan: Any,
        limits: Floats,
        bounder: ForceBounder,
        reading: Vector,
    ) -> None:
        self.case, self.bounder = case, bounder
        # A random number for each row that depends on its genes alone, so that a run repeats.
        chances = np.abs(plan["split"] * 1e6 + plan["cut"] * 1e5) % 1.0
        self.durations = plan["duration"].astype(int).tolist()
        self.writes = plan["write"].astype(int).tolist()
        self.applied, self.cuts = plan["applied"].tolist(), plan["cut"].tolist()
        self.limits, self.chances = limits.tolist(), chances.tolist()
        late = np.where(chances < case.late_stamps, chances * 1e4 % 1.0 * WORST_STAMP_NS, 0)
        self.late_ns = late.astype(int).tolist()
        plan["write"][chances < case.lost_writes] = math.inf
        self.is_wrong = (chances < case.wrong_readings).tolist()
        self.slack = 2.0 * float(np.linalg.norm(case.devices[0].error))
        # With a delay or a lag, the law waits with readings if it does not know what force acted.
        is_unsure = case.watchdog == "reporting" or case.tolerance > 0.0
        self.waits = is_unsure and (case.write_delay > 0.0 or case.stated.lag > 0.0)
        self._take(0, reading)

    def _take(self, time_ns: int, reading: Vector) -> None:
        """Remember the last reading that the bounder can have taken in."""
        self.good_ns, self.good = time_ns, reading

    def begin(self, time_ns: int, reading: Vector) -> None:
        """Begin another ledger, with no force held."""
        self.bounder.start(time_ns, reading)
        self._take(time_ns, reading)
        self.is_taken = True

    def before(self, index: int, time_ns: int, account: Any) -> None:
        """Report a cut in the interval that has just ended; set the hold limit of the next."""
        case = self.case
        if case.watchdog in ("guarding", "reporting") and account.cut_time >= 0.0:
            error = case.devices[0].error * np.clip(self.cuts[index] * 2.0, -1.0, 1.0)
            at = tuple((account.at_cut + error)[: case.axes].tolist())
            cut_ns = time_ns - self.durations[index - 1] + round(account.cut_time * 1e9)
            self.bounder.report_cut(cut_ns, at)
            if cut_ns - self.good_ns >= SHORTEST_NS and self._is_near(cut_ns, at):
                self._take(cut_ns, at)
        if case.hold_limits:
            self.bounder.set_hold_limit(self.limits[index])

    def shown(self, index: int, time_ns: int, reading: Vector) -> Vector:
        """Return what the encoder shows: the reading, or a glitch that must be refused."""
        case, chance = self.case, self.chances[index]
        if self.is_wrong[index]:
            self.is_taken = False
            return (reading[0] + math.copysign(WRONG_BY, self.cuts[index]), *reading[1:])
        is_good = chance >= case.refused
        # A hand faster than stated has true readings refused.
        is_near = self._is_near(time_ns, reading)
        self.is_taken = is_good and is_near and not self.waits
        if is_good:
            if is_near:
                self._take(time_ns, reading)
            return reading
        kind = int(chance / case.refused * 1e4) % 8
        if case.glitch == 0.0 or kind == 0 or self.waits:
            value = (math.nan, math.inf, -math.inf, 1e200)[kind % 4]
            return (value, *reading[1:])
        gate = case.glitch * (time_ns - self.good_ns) / 1e9 + self.slack
        jump = gate * (1.0 + 1e-6 + (0.0, 0.0, 0.01, 0.1, 1.0, 10.0, 100.0, 1e3)[kind])
        side = 1 - 2 * (int(chance / case.refused * 1e5) % 2)
        return (self.good[0] + side * jump, *self.good[1:])

    def _is_near(self, time_ns: int, reading: Vector) -> bool:
        """Return whether a reading implies at most the largest speed that is stated."""
        reach = self.case.stated.largest_speed * (time_ns - self.good_ns) / 1e9 + self.slack
        return math.dist(reading, self.good) < reach * (1.0 - 1e-9)

    def settle(self, index: int, time_ns: int, force: Vector) -> None:
        """Settle, with the time of the write if it differs from that of the reading."""
        if self.case.stated.write_delay > 0.0 or self.case.owes:
            self.bounder.settle(force, time_ns + self.writes[index])
        else:
            self.bounder.settle(force)

    def set_holds(self, index: int, account: Any) -> None:
        """Set how long the device holds this force, and with which hold its worst end is sought."""
        case, limit = self.case, self.limits[index]
        account.hold = limit * (1.0 + case.tolerance * self.cuts[index])
        if case.watchdog == "guarding":
            account.hold = round(float(account.hold), 9)  # its report is in ns, without an error
        if case.watchdog == "none":
            account.hold = case.stated.watchdog_limit
        account.longest_hold = limit * (1.0 + case.tolerance) + case.devices[0].drop
        account.late_hold = case.late
