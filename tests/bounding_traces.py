"""Traces of positions and commanded forces, and the applied forces of a bounder."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple, TypeAlias

from builders import MS

from forcebound.haptics.laws import Dissipation, ForceBounder
from forcebound.messages.packets import Vector

PHANTOM = Dissipation(
    damping=0.27, friction=0.12, resolution=3e-5, period=1e-3, hold_limit=1.25e-3, saturation=8.5
)
EXACT = replace(PHANTOM, resolution=0.0, hold_limit=1e-3)
B = 270.0  # N/m, b / T of the PHANToM; also b / T_max of EXACT
#: (elapsed in ns, positions in m, forces asked for in N) of each sample.
Trace: TypeAlias = Sequence[tuple[int, Vector, Vector]]


class Row(NamedTuple):
    """What happened in one sample."""

    asked: Vector
    force: Vector
    limit: float
    energy: float


def run(
    law: str,
    dissipation: Dissipation,
    trace: Trace,
    axes: int = 1,
    applied: Callable[[Vector], Vector] = lambda force: force,
) -> list[Row]:
    """Return what the bounder did; ``applied`` turns its force into the one that is written."""
    bounder = ForceBounder(law, dissipation, axes)
    bounder.start(0, (0.0,) * axes)
    time_ns = 0
    rows: list[Row] = []
    for elapsed_ns, position, asked in trace:
        time_ns += elapsed_ns
        force = bounder.bound(time_ns, position[:axes], asked[:axes])
        bounder.settle(applied(force))
        rows.append(Row(asked[:axes], force, bounder.limit, bounder.estimated_energy))
    return rows


def steady(positions: Sequence[float], asked: Sequence[float]) -> Trace:
    """Return a trace of one axis at 1 kHz."""
    return [(MS, (x,), (f,)) for x, f in zip(positions, asked, strict=True)]


def forces(rows: Sequence[Row]) -> list[float]:
    """Return the force on the first axis."""
    return [row.force[0] for row in rows]
