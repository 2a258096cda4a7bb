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
    share_left: float  # lowest share left of the loss plus work so far; 1 if there was none
    reserve_min: float  # J, least of the true energy above that which the law believes in
    time_of_min: float  # s
    peak_force: float  # N
    case: PathCase

    @property
    def is_passive(self) -> bool:
        """Whether the energy never fell below zero by more than rounding."""
        return self.loss_and_work_min >= -ENERGY_TOLERANCE


def attack_path(law: str, case: PathCase) -> tuple[PathResult, Floats]:
    """Run one case.

    Args:
        law: A key of :data:`forcebound.bounding.LAWS`.
        case: The case to run.

    Returns:
        The result, and a trace of shape ``(samples, len(TRACE_COLUMNS))``: positions, readings
        and forces are those of the first axis.

    Raises:
        ConfigError: If the law is not known, or cannot be informed of what the case is about.
    """
    count, device, plan = axes_of(case), device_of(case), plan_of(case)
    bounder = ForceBounder(law, dissipation_of(case), count)
    walk = jit(truth.walk)
    axes, energies = np.zeros((4, count)), np.zeros(4)
    times = np.zeros(4, dtype=np.int64)
    times[:] = truth.NEVER
    readings, force = np.zeros((2, count)), np.zeros(count)
    rows = [(0.0,) * len(TRACE_COLUMNS)]
    read_ns, write_ns = plan.read_ns.tolist(), plan.write_ns.tolist()
    commanded = [tuple(vector) for vector in plan.commanded.tolist()]
    first = device.half_resolution * plan.error[0] * (case.sensor > 0)
    bounder.start(0, tuple(first.tolist()))
    reserve = math.inf
    for n in range(1, SAMPLES):
        energy, lowest, fall = walk(
            n, case.sensor, plan, device, force, axes, energies, times, readings
        )
        reading = tuple(readings[0].tolist())
        applied = bounder.bound(read_ns[n], reading, commanded[n])
        bounder.settle(applied)
        reserve = min(reserve, energy - bounder.estimated_energy)
        force[:] = applied
        place = axes[truth.POSITION, 0]
        time = read_ns[n] * 1e-9
        rows.append((time, place, reading[0], commanded[n][0], applied[0], energy, lowest, fall))
    trace = np.array(rows)
    return _result_of(law, case, trace, reserve), trace


def _result_of(law: str, case: PathCase, trace: Floats, reserve: float) -> PathResult:
    lost = trace[:, TRACE_COLUMNS.index("loss_and_work")]
    earned = np.maximum.accumulate(trace[:, TRACE_COLUMNS.index("energy")])
    lowest = int(np.argmin(lost))
    share = np.divide(lost, earned, where=earned > EARNED, out=np.ones_like(lost))
    return PathResult(
        law=law,
        loss_and_work_min=float(lost[lowest]),
        share_left=float(share.min()),
        reserve_min=float(reserve),
        time_of_min=float(trace[lowest, 0]),
        peak_force=float(np.abs(trace[:, TRACE_COLUMNS.index("force")]).max()),
        case=case,
    )


def replay_path(law: str, name: str) -> tuple[PathResult, Floats]:
    """Run a case again by its name; see :func:`attack_path` and :mod:`forcebound.audit.paths`."""
    return attack_path(law, path_case_of(name))
