"""The bounder of one axis as one function, to be compiled into sweeps, audits and fits.

It does what :class:`forcebound.haptics.laws.ForceBounder` does, for a device that reads and writes
at one instant, drops a force exactly at the hold limit, and has none of the numbers that are off by
default.
"""

from collections.abc import Callable
from functools import cache
from typing import TypeAlias

from forcebound.haptics.laws.hold_cost import rigid_cost, rigid_force
from forcebound.haptics.laws.law import BoundingLaw, State
from forcebound.haptics.laws.sample import (
    NO_MOTION,
    AxisConstants,
    AxisMemory,
    DeviceConstants,
    Memory,
    Write,
    observe,
    observe_axis,
)
from forcebound.haptics.laws.waveform import step_penalty

Step: TypeAlias = Callable[
    [AxisMemory, Memory, State, float, float, float, float, DeviceConstants],
    tuple[AxisMemory, Memory, State, Write, float],
]
"""``step(axis, memory, state, reading, commanded, saturation, dt, device) -> (axis, memory, state,
write, limit)``: one sample, from the reading, in m, and the commanded force, in N, to the force
written, which is then ``axis.force``, and the largest that was allowed, in N."""


@cache
def one_axis(law: BoundingLaw) -> Step:
    """Return what the bounder does at a sample of one axis; the device applies what it returns."""
    limit, settle, energy = law.limit, law.settle, law.energy
    limits_holds = law.limits_holds

    def step(
        axis: AxisMemory,
        memory: Memory,
        state: State,
        reading: float,
        commanded: float,
        saturation: float,
        dt: float,
        device: DeviceConstants,
    ) -> tuple[AxisMemory, Memory, State, Write, float]:
        r, friction = device.half_resolution, device.friction
        reach = device.hand_speed * device.hold_limit + 4.0 * r
        constants = AxisConstants(device.damping, friction, r, r, 0.0, 0.0, 0.0)
        move = reading - axis.reading
        mean, cost = axis.force, 0.0
        if dt > device.hold_limit:
            first = axis.force * device.hold_limit  # the force steps to zero at the hold limit
            second = axis.force * axis.force * device.hold_limit
            mean, deviation = first / dt, max(second - first * first / dt, 0.0)
            cost = step_penalty(axis.force, deviation, 1.0, move, constants)
        change = r * abs(mean - axis.mean_force)
        axis, motion = observe_axis(axis, memory, reading, mean, NO_MOTION, constants)
        saturated = min(abs(commanded), saturation)
        memory, sample = observe(memory, motion, cost, change, saturated, dt, device)
        state, largest, added_damping = limit(state, sample, device)
        price, available = sample.held_price, 0.0
        if limits_holds:
            available = energy(state, Write(0.0, price, 0.0), device)
            most = rigid_force(available, friction, device.damping, device.hold_limit, reach)
            largest = min(largest, most)
        largest = min(largest, saturation)
        asked = commanded
        if added_damping > 0.0:
            if largest < saturation:  # the law's limit is of the commanded force
                asked, largest = min(max(asked, -largest), largest), saturation
            asked += added_damping / dt * move
        force = min(max(asked, -largest), largest)
        axis = AxisMemory(
            reading, force, axis.mean_force, axis.play, axis.path, axis.older, axis.younger
        )
        surplus = available
        if limits_holds:
            surplus -= rigid_cost(abs(force), friction, device.damping, device.hold_limit, reach)
        write = Write(force * force, price, surplus)
        return axis, memory, settle(state, write, device), write, largest

    return step
