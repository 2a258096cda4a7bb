"""One run of the independent attack: a case, genes, the bounder by its public calls, the truth."""

import math
from dataclasses import dataclass

import numpy as np

from experiments.independent_attack.paths import (
    APPLIED,
    AT_CUT,
    CUT,
    CUT_AFTER,
    CUT_TIME,
    DURATION,
    ENERGY,
    FALLEN,
    LATE_STRUCK,
    LEFT,
    LOWEST,
    MISREAD,
    PEAK,
    RECORD,
    SEEN_ROWS,
    SHARE,
    SPLIT,
    STRUCK,
    WRITE,
    Manner,
    plan_of,
    tick,
)
from experiments.independent_attack.truth import (
    AXES,
    BODY_ROWS,
    BRISTLE,
    COMPENSATION,
    DROP,
    ERROR,
    FASTEST,
    OUTPUT,
    PRESLIDING,
    TARGET,
    Floats,
    stored_energy,
)
from forcebound.bounding import Dissipation, ForceBounder

Vector = tuple[float, ...]


@dataclass(frozen=True)
class Case:
    """A device as it is, as it is described to the bounder, and how the attack reads its genes.

    Attributes:
        law: A key of :data:`forcebound.bounding.LAWS`.
        stated: What the bounder is given.
        axes: Number of axes, 1 to 3.
        device: Properties, rows of ``truth.DEVICE_ROWS``.
        numbers: Other numbers, ``truth.NUMBERS``.
        manner: How genes are read.
        watchdog: What the device does with a force that is too old.
        tolerance: Of a silent watchdog.
        late: Hold of a late tick, s; 0: none is tried.
        allowance: Energy that a late hold may leak, J.
        hold_limits: Among which the hold limit changes, s.
        ledger_only: What the law believes is compared with the truth, and nothing else: for a
            weight that acts after a cut, which no law can prevent.
        refused: Share of readings that are wrong by more than r.
        glitch: Largest speed, m/s; such readings imply more. 0: they are not finite.
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
            beyond the allowance that the bounder tells.
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


def run(case: Case, genes: Floats, bounder: ForceBounder, start: Floats) -> Outcome:
    """Attack once.

    Args:
        case: The device.
        genes: Shape ``(rows, COLUMNS)``.
        bounder: Of the case; it is started anew.
        start: Bristle at the start, shares of the presliding, shape ``(3,)``.
    """
    stated, axes = case.stated, case.axes
    way = np.maximum(case.device[ERROR] + case.device[PRESLIDING], 1e-7)
    limits = _hold_limits(case, genes)
    plan = plan_of(genes, case.manner, stated.period, limits, case.write_delay, way)
    body = np.zeros((BODY_ROWS, AXES))
    body[BRISTLE] = _bristle(case, start)
    body[TARGET] = body[OUTPUT] = -case.device[COMPENSATION]
    record, seen = np.zeros(RECORD), np.zeros((SEEN_ROWS, AXES))
    record[SHARE] = record[LEFT] = record[CUT_AFTER] = math.inf
    record[CUT_TIME] = -1.0
    record[ENERGY] = stored_energy(body, case.device)  # a hand may have that back
    modes = np.array([case.manner.reading, case.manner.command], dtype=float)
    reading: Vector = tuple((case.device[ERROR] * plan[0, MISREAD : MISREAD + AXES])[:axes])
    command: Vector = (0.0,) * axes
    bounder.start(0, reading)
    watch = _Watch(case, plan, limits, bounder)
    watch.believed(0, reading)
    applied = plan[:, APPLIED].tolist()
    force: Vector = (0.0,) * axes
    holds = np.array([math.inf, stated.hold_limit, 0.0])
    padding = (0.0,) * (AXES - axes)
    time_ns, excess, hidden, before = 0, -math.inf, 0.0, 0.0
    for index in range(len(plan)):
        if index > 0:
            watch.before(index, time_ns, record, seen)
            shown = watch.shown(index, time_ns, reading)
            force = bounder.bound(time_ns, shown, command)
            if applied[index] < 1.0:
                force = tuple([applied[index] * f for f in force])
            watch.settle(index, time_ns, force)
            # Known once the late force has been replaced, which may be after the next reading.
            hidden = min(hidden, before + bounder.largest_allowance)
            before = float(record[LOWEST])
            if watch.is_taken:
                excess = max(excess, bounder.estimated_energy - float(record[ENERGY]))
            watch.set_holds(index, holds)
        found = tick(
            body, case.device, case.numbers, plan, index, modes, holds, record, seen,
            *force, *padding,
        )  # fmt: skip
        time_ns += watch.durations[index]
        reading, command = found[:axes], found[3 : 3 + axes]
    lowest = min(float(record[STRUCK]), float(record[LOWEST]))
    late = case.late > 0.0  # then any hold so far may have been late
    return Outcome(
        0.0 if case.ledger_only else min(float(record[FALLEN]), hidden) if late else lowest,
        min(float(record[LATE_STRUCK]), lowest) + case.allowance if late else math.inf,
        float(record[PEAK]),
        float(record[SHARE]),
        float(record[LEFT]),
        excess,
        len(plan),
    )


def _hold_limits(case: Case, genes: Floats) -> Floats:
    """Return the hold limit of the force of each row, s."""
    limits = np.full(len(genes), case.stated.hold_limit)
    if case.hold_limits:
        choice = np.abs(genes[:, CUT] * 7.0).astype(int) % (len(case.hold_limits) + 1)
        limits = np.array([case.stated.hold_limit, *case.hold_limits])[choice]
    return limits


class _Watch:
    """The calls to the bounder besides ``bound``, and the readings that it must refuse."""

    def __init__(self, case: Case, plan: Floats, limits: Floats, bounder: ForceBounder) -> None:
        self.case, self.bounder = case, bounder
        self.durations = plan[:, DURATION].astype(int).tolist()
        self.writes = plan[:, WRITE].astype(int).tolist()
        self.cuts = plan[:, CUT].tolist()
        self.limits = limits.tolist()
        # A random number for each row that depends on its genes alone, so that a run repeats.
        self.chances = (np.abs(plan[:, SPLIT] * 1e6 + plan[:, CUT] * 1e5) % 1.0).tolist()

    def believed(self, time_ns: int, reading: Vector) -> None:
        """Remember the last reading that the bounder can have believed."""
        self.good_ns, self.good = time_ns, reading
        self.side = 1.0

    def before(self, index: int, time_ns: int, record: Floats, seen: Floats) -> None:
        """Report a cut in the interval that has just ended; set the hold limit of the next."""
        case = self.case
        if case.watchdog in ("guarding", "reporting") and record[CUT_TIME] >= 0.0:
            error = case.device[ERROR] * np.clip(self.cuts[index] * 2.0, -1.0, 1.0)
            at = tuple((seen[AT_CUT] + error)[: case.axes].tolist())
            start_ns = time_ns - self.durations[index - 1]
            self.bounder.report_cut(start_ns + round(record[CUT_TIME] * 1e9), at)
        if case.hold_limits:
            self.bounder.set_hold_limit(self.limits[index])

    def shown(self, index: int, time_ns: int, reading: Vector) -> Vector:
        """Return what the encoder shows: the reading, or a glitch that must be refused."""
        case = self.case
        is_good = self.chances[index] >= case.refused
        # With a delay, the law waits with readings of which it does not know what force acted.
        # A hand faster than stated has true readings refused.
        self.is_taken = is_good and not (case.write_delay > 0.0 and case.is_unsure)
        self.is_taken &= case.numbers[FASTEST] <= case.stated.largest_speed
        if is_good:
            self.believed(time_ns, reading)
            return reading
        kind = int(self.chances[index] / case.refused * 1e4) % 8
        if case.glitch == 0.0 or kind == 0:
            value = (math.nan, math.inf, -math.inf, 1e200)[kind % 4]
            return (value, *reading[1:])
        elapsed = (time_ns - self.good_ns) / 1e9
        gate = case.glitch * elapsed + 2.0 * float(np.linalg.norm(case.device[ERROR]))
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
        watched = case.watchdog != "none"
        holds[0] = limit * (1.0 + case.tolerance * self.cuts[index])
        if case.watchdog == "guarding":
            holds[0] = round(holds[0], 9)  # its report is in ns: no error of a stamp is meant here
        if not watched:
            holds[0] = case.stated.watchdog_limit
        holds[1] = limit * (1.0 + case.tolerance) + case.numbers[DROP]
        holds[2] = case.late


def _bristle(case: Case, start: Floats) -> Floats:
    """Return a bristle that is as far bent as it can be, at most."""
    bent = np.clip(start, -1.0, 1.0)
    bent[case.axes :] = 0.0
    size = math.sqrt(float(bent @ bent))
    if case.numbers[1] > 0.0 and size > 1.0:
        bent /= size
    return np.asarray(case.device[PRESLIDING] * bent)
