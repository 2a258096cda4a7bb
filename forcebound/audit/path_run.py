"""One attack on a certificate: the live bounder on a chosen path, against the ground truth.

The law is that of the device node, :class:`forcebound.bounding.ForceBounder` itself.
"""

import math
from typing import NamedTuple

import numpy as np

from forcebound.audit import truth
from forcebound.audit.paths import SAMPLES, PathCase, path_case_of
from forcebound.audit.plan import axes_of, device_of, dissipation_of, plan_of
from forcebound.audit.run import EARNED, TRACE_COLUMNS
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


class Lists(NamedTuple):
    """Times of a plan, in ns, as numbers of Python."""

    read_ns: list[int]
    write_ns: list[int]
    hold_ns: list[int]


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
    walk, state = jit(truth.walk), truth.start(axes)
    readings, force = np.zeros((2, axes)), np.zeros(axes)
    rows = [(0.0,) * len(TRACE_COLUMNS)]
    informs_of_cuts = case.certificate.watchdog == "reporting"
    changes_hold_limit = "hold_change" in case.numbers
    lists = Lists(*(one.tolist() for one in (plan.read_ns, plan.write_ns, plan.punctual_ns)))
    first = device.half_resolution * plan.error[0] * (case.sensor > 0)
    bounder.start(0, tuple(first.tolist()))
    reserve = math.inf
    for n in range(1, SAMPLES):
        energy, lowest, fall, cut_ns = walk(n, case.sensor, plan, device, force, *state, readings)
        reading = tuple((readings[0] + plan.glitch[n]).tolist())
        commanded = tuple(plan.commanded[n].tolist())
        if changes_hold_limit:
            bounder.set_hold_limit(lists.hold_ns[n] * 1e-9)
        if informs_of_cuts and cut_ns > 0:
            bounder.report_cut(cut_ns, tuple(readings[1].tolist()))
        np.multiply(bounder.bound(lists.read_ns[n], reading, commanded), plan.applied[n], out=force)
        bounder.settle(tuple(force.tolist()), lists.write_ns[n])
        reserve = min(reserve, energy - bounder.estimated_energy)
        rows.append(
            (
                lists.read_ns[n] * 1e-9,
                float(state.axes[truth.POSITION, 0]),
                reading[0],
                commanded[0],
                float(force[0]),
                energy,
                lowest,
                fall,
            )
        )
    trace = np.array(rows)
    return _result_of(law, case, trace, reserve), trace


def _result_of(law: str, case: PathCase, trace: Floats, reserve: float) -> PathResult:
    columns = dict(zip(TRACE_COLUMNS, trace.T, strict=True))
    lost = columns["loss_and_work"]
    earned = np.maximum.accumulate(columns["energy"])
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
