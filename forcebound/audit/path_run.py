"""One attack on a certificate: the live bounder on a chosen path, against the ground truth.

The law is that of the device node, :class:`forcebound.bounding.ForceBounder` itself.
"""

import math
from operator import add
from typing import Any, NamedTuple

import numpy as np

from forcebound.audit import truth
from forcebound.audit.paths import PathCase, path_case_of
from forcebound.audit.plan import axes_of, device_of, dissipation_of, plan_of
from forcebound.audit.run import EARNED, TRACE_COLUMNS
from forcebound.audit.search import objective
from forcebound.audit.truth import Floats
from forcebound.bounding import ENERGY_TOLERANCE, ForceBounder
from forcebound.compiled import jit


class PathResult(NamedTuple):
    """Result of an attack."""

    law: str
    loss_and_work_min: float  # J, lowest loss plus motor work, and energy stored in presliding
    margin: float  # J, least of it above what is promised: 0, in late holds minus the allowance
    share_left: float  # lowest share left of the loss plus work so far; 1 if there was none
    reserve_min: float  # J, least of the true energy above that which the law believes in
    time_of_min: float  # s
    peak_force: float  # N
    case: PathCase

    @property
    def is_passive(self) -> bool:
        """Whether the promise was never broken by more than rounding."""
        return self.margin >= -ENERGY_TOLERANCE

    @property
    def objective(self) -> float:
        """Value that a search minimises: a leak, else belief in too much, else the share left."""
        return objective(min(self.margin, 0.5 * self.reserve_min), self.share_left)


def attack_path(law: str, case: PathCase) -> tuple[PathResult, Floats]:
    """Run one case.

    Args:
        law: A key of :data:`forcebound.bounding.LAWS`.
        case: The case to run.

    Returns:
        The result, and a trace of shape ``(samples, len(TRACE_COLUMNS))``: positions, readings
        and forces are those of the first axis; in place of the balance, the most by which a
        punctual hold has brought the energy below zero and below what it was.

    Raises:
        ConfigError: If the law is not known, or cannot be informed of what the case is about.
    """
    device, plan, axes = device_of(case), plan_of(case), axes_of(case)
    bounder = ForceBounder(law, dissipation_of(case), axes)
    walk, motion = jit(truth.walk), truth.start(axes, device)
    readings, force = np.zeros((3, axes)), np.zeros(axes)
    state, events = motion.state, motion.times
    written: Any = force.data  # numpy takes longer to set a number
    place = state[truth.POSITION].data
    reports_cuts = case.certificate.watchdog in ("guarding", "reporting")
    changes_hold_limit = case.is_stated and "hold_change" in case.numbers
    truth.read(0, axes, plan.choices, device, state, readings[0])
    bounder.start(0, tuple(readings[0].tolist()))
    rows = [(0.0,) * len(TRACE_COLUMNS)]
    reserve = math.inf
    for n in range(1, case.samples):
        energy, lowest, fall, cut_ns = walk(
            n, axes, plan.times, plan.choices, device, force, state, events, readings
        )
        reading, at_cut = map(tuple, readings[:2].tolist())
        if n in plan.glitch:
            reading = tuple(map(add, reading, plan.glitch[n]))
        if changes_hold_limit:
            bounder.set_hold_limit(plan.hold_limit[n])
        if reports_cuts and cut_ns > 0:
            bounder.report_cut(cut_ns, at_cut)
        applied = bounder.bound(plan.stamp_ns[n], reading, plan.commanded[n])
        if plan.applied[n] != 1.0:
            applied = tuple([plan.applied[n] * one for one in applied])
        bounder.settle(applied, plan.write_stamp_ns[n])
        for axis, one in enumerate(applied):
            written[axis] = one
        reserve = min(reserve, energy - bounder.estimated_energy)
        time = plan.stamp_ns[n] * 1e-9
        shown = reading[0], plan.commanded[n][0], applied[0]
        rows.append((time, place[0], *shown, energy, lowest, fall))
    trace = np.array(rows)
    return _result_of(law, case, trace, reserve), trace


def _result_of(law: str, case: PathCase, trace: Floats, reserve: float) -> PathResult:
    columns = dict(zip(TRACE_COLUMNS, trace.T, strict=True))
    lost = columns["loss_and_work"]
    earned = np.maximum.accumulate(np.append(0.0, columns["energy"][:-1]))
    lowest = int(np.argmin(lost))
    share = np.divide(lost, earned, where=earned > EARNED, out=np.ones_like(lost))
    allowance = case.numbers.get("allowance", 0.0) if case.is_stated else 0.0
    margin = lost[lowest] + allowance
    if case.certificate.watchdog == "none":
        margin = min(margin, columns["balance"].min())
    return PathResult(
        law=law,
        loss_and_work_min=float(lost[lowest]),
        margin=float(margin),
        share_left=float(share.min()),
        reserve_min=float(reserve),
        time_of_min=float(trace[lowest, 0]),
        peak_force=float(np.abs(columns["force"]).max()),
        case=case,
    )


def replay_path(law: str, name: str) -> tuple[PathResult, Floats]:
    """Run a case again by its name; see :func:`attack_path` and :mod:`forcebound.audit.paths`."""
    return attack_path(law, path_case_of(name))
