"""One attack along a path: a device, genes, the live bounder by its public calls, the truth."""

import math
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from forcebound.compiled import jit
from forcebound.haptics.laws import Dissipation, ForceBounder
from forcebound.lab.paths import path, truth
from forcebound.lab.paths.path import Manner, plan_of
from forcebound.lab.paths.truth import AXES, Floats, stored_energy

Vector = tuple[float, ...]

WORST_STAMP_NS = 2_000_000  # error of a stamp that is wrong
WRONG_BY = 0.01  # m, of a reading that is wrong

#: Columns of a trace, SI units, of the first axis.
TRACE_COLUMNS = ("time", "position", "reading", "commanded", "force", "energy", "loss_and_work")


@dataclass(frozen=True)
class Case:
    """A device as it is, as it is described to the bounder, and how the attack reads its genes.

    Attributes:
        law: A key of :data:`forcebound.haptics.laws.LAWS`.
        stated: What the bounder is given.
        axes: Number of axes, 1 to 3.
        device: Properties, rows of ``truth.DEVICE_ROWS``.
        numbers: Other numbers, ``truth.NUMBERS``.
        manner: How genes are read.
        watchdog: What the device does with a force that is too old.
        tolerance: Of a silent watchdog.
        late: Hold of a late tick, s; 0: none is tried.
        allowance: Energy that a late hold may leak, J.
        write_delay: Largest time from reading to writing, s.
        hold_limits: Among which the hold limit changes, s.
        ledger_only: What the law believes is compared with the truth, and nothing else: for a
            weight that acts after a cut, which no law can prevent.
        refused: Share of readings that are wrong by more than r.
        glitch: Largest speed, m/s; such readings imply more. 0: they are not finite.
        wrong_readings: Share of readings that are wrong by 10 mm.
        late_stamps: Share of the stamps that are up to 2 ms late.
        lost_writes: Share of the writes that do not arrive; the law does not know.
    """

    law: str
    stated: Dissipation
    axes: int
    device: Floats
    numbers: Floats
    manner: Manner
    watchdog: str = "silent"
    tolerance: float = 0.0
    late: float = 0.0
    allowance: float = 0.0
    write_delay: float = 0.0
    hold_limits: tuple[float, ...] = ()
    ledger_only: bool = False
    refused: float = 0.0
    glitch: float = 0.0
    wrong_readings: float = 0.0
    late_stamps: float = 0.0
    lost_writes: float = 0.0

    @property
    def is_unsure(self) -> bool:
        """Whether it may not be known when the watchdog has dropped a force."""
        return self.watchdog == "reporting" or self.tolerance > 0.0


@dataclass
class Outcome:
    """What a run has found.

    Attributes:
        lowest: Lowest energy, J, the worst end of each hold included. If holds may be late: most
            that it fell in a punctual hold while it was below zero, or that it was below zero
            beyond the allowance that the bounder reports.
        late_margin: Lowest energy within late holds, plus the allowance, J.
        peak: Largest energy, J.
        share: Lowest energy over the peak before it, once that exceeds ``SMALLEST_PEAK``.
        left: Lowest energy after a peak of ``LARGE_PEAK``, J.
        excess: Most that the law believed in beyond the truth, at a reading that it took, J.
        steps: Samples.
    """

    lowest: float
    late_margin: float
    peak: float
    share: float
    left: float
    excess: float
    steps: int

    @property
    def worst(self) -> float:
        """Lowest energy, J; of late holds above the allowance, of the truth above the ledger."""
        return min(self.lowest, self.late_margin, -self.excess)


@cache
def _tick() -> Any:
    return jit(path.tick)


def _at_start(case: Case, start: Floats) -> tuple[Floats, Floats, Floats]:
    """Return state, record and readings before the first sample."""
    body = np.zeros((truth.BODY_ROWS, AXES))
    body[truth.BRISTLE] = _bristle(case, start)
    body[truth.TARGET] = body[truth.OUTPUT] = -case.device[truth.COMPENSATION]
    record, seen = np.zeros(path.RECORD), np.zeros((path.SEEN_ROWS, AXES))
    record[path.SHARE] = record[path.LEFT] = record[path.CUT_AFTER] = math.inf
    record[path.CUT_TIME] = -1.0
    record[path.ENERGY] = stored_energy(body, case.device)  # a hand may have that back
    return body, record, seen


def run(
    case: Case,
    genes: Floats,
    bounder: ForceBounder,
    start: Floats,
    trace: list[Vector] | None = None,
) -> Outcome:
    """Attack once.

    Args:
        case: The device.
        genes: Shape ``(rows, COLUMNS)``.
        bounder: Of the case; it is started again.
        start: Bristle at the start, shares of the presliding, shape ``(3,)``.
        trace: Gets a row of ``TRACE_COLUMNS`` for each sample.
    """
    stated, axes, tick = case.stated, case.axes, _tick()
    way = np.maximum(case.device[truth.ERROR] + case.device[truth.PRESLIDING], 1e-7)
    limits = _hold_limits(case, genes)
    plan = plan_of(genes, case.manner, stated.period, limits, case.write_delay, way)
    body, record, seen = _at_start(case, start)
    modes = np.array([case.manner.reading, case.manner.command], dtype=float)
    seen[path.READING] = case.device[truth.ERROR] * plan[0, path.MISREAD : path.MISREAD + AXES]
    reading: Vector = tuple(seen[path.READING, :axes].tolist())
    bounder.start(0, reading)
    watch = _Watch(case, plan, limits, bounder, reading)
    applied = plan[:, path.APPLIED].tolist()
    force, padding = (0.0,) * axes, (0.0,) * (AXES - axes)
    holds = np.array([math.inf, stated.hold_limit, 0.0])
    time_ns, excess, hidden, before = 0, -math.inf, 0.0, 0.0
    for index in range(len(plan)):
        if index > 0:
            reading, command = map(tuple, seen[: path.COMMANDED + 1, :axes].tolist())
            watch.before(index, time_ns, record, seen)
            shown = watch.shown(index, time_ns, reading)
            force = bounder.bound(time_ns + watch.late_ns[index], shown, command)
            if applied[index] < 1.0:
                force = tuple([applied[index] * f for f in force])
            watch.settle(index, time_ns, force)
            if case.late > 0.0:
                # Known once the late force is replaced, which may be after the next reading.
                hidden = min(hidden, before + bounder.largest_allowance)
                before = float(record[path.LOWEST])
            if watch.is_taken:
                excess = max(excess, bounder.estimated_energy - float(record[path.ENERGY]))
            watch.set_holds(index, holds)
            if trace is not None:
                energies = (
                    float(record[path.ENERGY]),
                    float(min(record[path.STRUCK], record[path.LOWEST])),
                )
                place = float(body[truth.POSITION, 0])
                trace.append((time_ns / 1e9, place, shown[0], command[0], force[0], *energies))
        written = np.array((*force, *padding))
        tick(body, case.device, case.numbers, plan, index, modes, holds, record, seen, written)
        time_ns += watch.durations[index]
    return _outcome(case, record, hidden, excess, len(plan))


def _outcome(case: Case, record: Floats, hidden: float, excess: float, steps: int) -> Outcome:
    lowest = min(float(record[path.STRUCK]), float(record[path.LOWEST]))
    late = case.late > 0.0  # then any hold so far may have been late
    return Outcome(
        0.0 if case.ledger_only else min(float(record[path.FALLEN]), hidden) if late else lowest,
        min(float(record[path.LATE_STRUCK]), lowest) + case.allowance if late else math.inf,
        float(record[path.PEAK]),
        float(record[path.SHARE]),
        float(record[path.LEFT]),
        excess,
        steps,
    )


def _hold_limits(case: Case, genes: Floats) -> Floats:
    """Return the hold limit of the force of each row, s."""
    limits = np.full(len(genes), case.stated.hold_limit)
    if case.hold_limits:
        choice = np.abs(genes[:, path.CUT] * 7.0).astype(int) % (len(case.hold_limits) + 1)
        limits = np.array([case.stated.hold_limit, *case.hold_limits])[choice]
    return limits


class _Watch:
    """The calls to the bounder besides ``bound``, and the readings that it must refuse."""

    def __init__(
        self, case: Case, plan: Floats, limits: Floats, bounder: ForceBounder, reading: Vector
    ) -> None:
        self.case, self.bounder = case, bounder
        # A random number for each row that depends on its genes alone, so that a run repeats.
        chances = np.abs(plan[:, path.SPLIT] * 1e6 + plan[:, path.CUT] * 1e5) % 1.0
        self.durations = plan[:, path.DURATION].astype(int).tolist()
        self.writes = plan[:, path.WRITE].astype(int).tolist()
        self.cuts = plan[:, path.CUT].tolist()
        self.limits = limits.tolist()
        self.chances = chances.tolist()
        late = np.where(chances < case.late_stamps, chances * 1e4 % 1.0 * WORST_STAMP_NS, 0)
        self.late_ns = late.astype(int).tolist()
        plan[chances < case.lost_writes, path.WRITE] = math.inf
        self.is_wrong = (chances < case.wrong_readings).tolist()
        self._believed(0, reading)

    def _believed(self, time_ns: int, reading: Vector) -> None:
        """Remember the last reading that the bounder can have believed."""
        self.good_ns, self.good = time_ns, reading
        self.side = 1.0

    def before(self, index: int, time_ns: int, record: Floats, seen: Floats) -> None:
        """Report a cut in the interval that has just ended; set the hold limit of the next."""
        case = self.case
        if case.watchdog in ("guarding", "reporting") and record[path.CUT_TIME] >= 0.0:
            error = case.device[truth.ERROR] * np.clip(self.cuts[index] * 2.0, -1.0, 1.0)
            at = tuple((seen[path.AT_CUT] + error)[: case.axes].tolist())
            start_ns = time_ns - self.durations[index - 1]
            self.bounder.report_cut(start_ns + round(record[path.CUT_TIME] * 1e9), at)
        if case.hold_limits:
            self.bounder.set_hold_limit(self.limits[index])

    def shown(self, index: int, time_ns: int, reading: Vector) -> Vector:
        """Return what the encoder shows: the reading, or a glitch that must be refused."""
        case = self.case
        if self.is_wrong[index]:
            self.is_taken = False
            return (reading[0] + math.copysign(WRONG_BY, self.cuts[index]), *reading[1:])
        is_good = self.chances[index] >= case.refused
        # With a delay, the law waits with readings of which it does not know what force acted.
        # A hand faster than stated has true readings refused.
        self.is_taken = is_good and not (case.write_delay > 0.0 and case.is_unsure)
        self.is_taken &= case.numbers[truth.FASTEST] <= case.stated.largest_speed
        if is_good:
            self._believed(time_ns, reading)
            return reading
        kind = int(self.chances[index] / case.refused * 1e4) % 8
        if case.glitch == 0.0 or kind == 0:
            value = (math.nan, math.inf, -math.inf, 1e200)[kind % 4]
            return (value, *reading[1:])
        elapsed = (time_ns - self.good_ns) / 1e9
        gate = case.glitch * elapsed + 2.0 * float(np.linalg.norm(case.device[truth.ERROR]))
        jump = gate * (1.0 + 1e-6 + (0.0, 0.0, 0.01, 0.1, 1.0, 10.0, 100.0, 1e3)[kind])
        self.side = -self.side  # two glitches in a row that agree are believed
        return (self.good[0] + self.side * jump, *self.good[1:])

    def settle(self, index: int, time_ns: int, force: Vector) -> None:
        """Settle, with the time of the write if it differs from that of the reading."""
        if self.case.stated.write_delay > 0.0:
            self.bounder.settle(force, time_ns + self.writes[index])
        else:
            self.bounder.settle(force)

    def set_holds(self, index: int, holds: Floats) -> None:
        """Say how long the device holds this force, and how long it is struck."""
        case, limit = self.case, self.limits[index]
        holds[0] = limit * (1.0 + case.tolerance * self.cuts[index])
        if case.watchdog == "guarding":
            holds[0] = round(holds[0], 9)  # its report is in ns: no error of a stamp is meant here
        if case.watchdog == "none":
            holds[0] = case.stated.watchdog_limit
        holds[1] = limit * (1.0 + case.tolerance) + case.numbers[truth.DROP]
        holds[2] = case.late


def _bristle(case: Case, start: Floats) -> Floats:
    """Return a bristle that is as far bent as it can be, at most."""
    bent = np.clip(start, -1.0, 1.0)
    bent[case.axes :] = 0.0
    size = math.sqrt(float(bent @ bent))
    if case.numbers[truth.ALONG_PATH] > 0.0 and size > 1.0:
        bent /= size
    return np.asarray(case.device[truth.PRESLIDING] * bent)
