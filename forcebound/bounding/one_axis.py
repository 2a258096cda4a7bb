"""The bounder of one axis as one function, to be compiled into sweeps, audits and fits."""

from collections.abc import Callable
from functools import cache
from typing import TypeAlias

from forcebound.bounding.law import BoundingLaw, State
from forcebound.bounding.sample import (
    NO_MOTION,
    NO_WRITE,
    AxisMemory,
    DeviceConstants,
    Memory,
    Write,
    observe,
    observe_axis,
    write_axis,
)

Step: TypeAlias = Callable[
    [AxisMemory, Memory, State, float, float, float, float, DeviceConstants],
    tuple[AxisMemory, Memory, State, Write],
]
"""``step(axis, memory, state, reading, commanded, saturation, dt, device) -> (axis, memory, state,
write)``: one sample, from the reading, in m, and the commanded force, in N, to the force written,
which is then ``axis.force``."""


@cache
def one_axis(law: BoundingLaw) -> Step:
    """Return what :class:`forcebound.bounding.ForceBounder` does at a sample, for one axis.

    A device is taken to apply what the bounder returns.
    """
    limit, settle = law.limit, law.settle

    def step(
        axis: AxisMemory,
        memory: Memory,
        state: State,
        reading: float,
        commanded: float,
        saturation: float,
        dt: float,
        device: DeviceConstants,
    ) -> tuple[AxisMemory, Memory, State, Write]:
        move = reading - axis.reading
        axis, motion = observe_axis(axis, memory, reading, NO_MOTION, dt, device)
        memory, sample = observe(memory, motion, min(abs(commanded), saturation), dt, device)
        state, largest, added_damping = limit(state, sample, device)
        largest = min(largest, saturation)
        wanted = commanded + added_damping / dt * move if added_damping > 0.0 else commanded
        axis, write = write_axis(axis, min(max(wanted, -largest), largest), NO_WRITE)
        return axis, memory, settle(state, write, device), write

    return step
