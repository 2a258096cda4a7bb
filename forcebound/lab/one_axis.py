"""One axis in one compiled loop: hand, plant, encoder, environment, network and law.

No physics is defined here. The plant's step, the encoder, the environments, the low-pass of the
velocity and the law are the functions of the graph, compiled. Here is only their order in a tick,
which :mod:`forcebound.nodes.device` fixes: move to the sample, read, query; move to the write,
read, saturate, bound, write. Sweeps, the audit of laws and the fit of the paper's table are users.

What does not depend on forces comes from outside (:class:`Course`): when the ticks are, where the
hand wants to be, and which earlier tick's answer each force is. So delays, jitter and losses are
indices here; :mod:`forcebound.lab.runs` takes them from the links of the graph::

    config = fb.Graph.read("stiff_wall", law="none")
    timing = timing_of(config)
    trace = np.zeros((timing.seq.size, len(TRACE)))
    device = LAWS["none"].device(dissipation_of(config.only.device, config.only.servo))
    loop("none")(system_of(config), device, course_of(config, timing), trace, NO_MOTION)
"""

import math
from collections.abc import Callable
from functools import cache
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from forcebound.compiled import allow_in_kernels, jit
from forcebound.haptics.devices.plant import Axis, Moving, advance_extended, quantise
from forcebound.haptics.environments.walls import (
    active_wall_force,
    damped_wall_force,
    damper_force,
    power_law_force,
    time_varying_force,
    wall_force,
)
from forcebound.haptics.laws import LAWS, DeviceConstants
from forcebound.haptics.laws.one_axis import one_axis
from forcebound.haptics.laws.sample import NO_MEMORY, NO_WRITE, start_axis
from forcebound.nodes.velocity import low_pass, low_pass_gain

Floats: TypeAlias = NDArray[np.float64]
Integers: TypeAlias = NDArray[np.int64]

#: Columns of a trace, one row a tick, SI units; named as in a run's telemetry.
TRACE = (
    "position",
    "commanded_force",
    "applied_force",
    "force_limit",
    "estimated_energy",
    "true_energy",
    "true_position",
    "hand_force",
    "velocity",
)
#: Columns of a motion, one row a piece of a move, SI units; ``motor_force`` is held in it.
MOTION = ("duration", "motor_force", "x", "v", "work")
NO_MOTION: Floats = np.zeros((0, len(MOTION)))

WALL, DAMPED_WALL, TIME_VARYING_WALL, POWER_LAW_WALL, DAMPER = range(5)
ACTIVE_WALL, RANDOM_FORCE, PUSHER, SPRING = range(5, 9)
#: Environments of launch files: number, and the fields that :func:`answer` takes, in order.
ENVIRONMENTS: dict[str, tuple[int, tuple[str, ...]]] = {
    "wall": (WALL, ("stiffness", "position")),
    "damped_wall": (DAMPED_WALL, ("stiffness", "damping", "position")),
    "time_varying_wall": (TIME_VARYING_WALL, ("stiffness", "stiffness_rate", "position")),
    "power_law_wall": (POWER_LAW_WALL, ("stiffness", "exponent", "reference", "position")),
    "damper": (DAMPER, ("damping",)),
}
ENCODER, NOISY, LEADING = range(3)  # sensors


class System(NamedTuple):
    """Device, hand and environment of a run."""

    axis: Axis
    hand_mass: float  # kg
    substep: float  # longest integration step, s
    pieces: int  # of a move, each a row of the motion
    resolution: float  # m
    saturation: float  # N
    hold_ns: int  # after which the device drops a force
    largest_speed: float  # m/s; a faster reading ends the run
    cutoff: float  # Hz, of the low-pass of the velocity
    environment: int
    numbers: tuple[float, float, float, float]  # of the environment
    sensor: int = ENCODER


class Course(NamedTuple):
    """Inputs of a run that no force changes; ``n`` ticks of two instants each: sample and write."""

    instants_ns: Integers  # (2n,)
    targets: Floats  # (2n,), m, of the hand
    answered: Integers  # (n,), entry of ``answers`` that is the force of this tick; -1: none
    engagement: Floats  # (n,), 0 to 1
    answers: Floats  # (m,), m >= n, N; a tick fills its own entry, others may be given
    chances: Floats  # (n,), -1 to 1, of random forces
    errors: Floats  # (n,), -1 to 1, of the sensor; at most half a resolution


class Body(NamedTuple):
    """State of the plant, and its time."""

    moving: Moving
    hand_force: float  # N, mean of the last step
    target: float  # m
    time_ns: int
    row: int  # of the motion, written next


Loop: TypeAlias = Callable[[System, DeviceConstants, Course, Floats, Floats], int]


def pushing_force(velocity: float, magnitude: float, threshold: float) -> float:
    """Return a force of ``magnitude``, in N, that pushes along a ``velocity`` above a threshold."""
    if abs(velocity) <= threshold:
        return 0.0
    return -magnitude if velocity > 0.0 else magnitude


def answer(system: System, x: float, v: float, elapsed: float, chance: float) -> float:
    """Return the force of the environment, in N."""
    kind, (a, b, c, d) = system.environment, system.numbers
    if kind == WALL:
        return wall_force(x, a, b)
    if kind == DAMPED_WALL:
        return damped_wall_force(x, v, a, b, c)
    if kind == TIME_VARYING_WALL:
        return time_varying_force(x, elapsed, a, b, c)
    if kind == POWER_LAW_WALL:
        return power_law_force(x, a, b, c, d)
    if kind == DAMPER:
        return damper_force(v, a)
    if kind == ACTIVE_WALL:
        return active_wall_force(x, v, a, b, c)
    if kind == RANDOM_FORCE:
        return a * chance
    if kind == PUSHER:
        return pushing_force(v, a, b)
    return a * (x - b)


def read(system: System, moving: Moving, error: float) -> float:
    """Return a reading, in m, at most half a resolution from the truth."""
    if system.sensor == ENCODER:
        return quantise(moving.x, system.resolution)
    if system.sensor == LEADING:
        error = math.copysign(error, moving.v)
    return moving.x + 0.5 * system.resolution * error


def store(table: Floats, row: int, values: tuple[float, ...]) -> None:
    """Fill a row of a table."""
    for column, value in enumerate(values):
        table[row, column] = value


def move(
    system: System, body: Body, time_ns: int, end: float, force: float, motion: Floats
) -> Body:
    """Move until ``time_ns``, when the hand's target is ``end``, under one ``force``, in N."""
    if time_ns <= body.time_ns:
        return body
    moving, hand_force, row = body.moving, body.hand_force, body.row
    duration = (time_ns - body.time_ns) * 1e-9 / system.pieces
    first = body.target
    for i in range(1, system.pieces + 1):
        last = end if i == system.pieces else body.target + (end - body.target) * i / system.pieces
        moving, hand_force = advance_extended(
            moving, system.axis, first, last, duration, system.substep, force
        )
        first = last
        if motion.shape[0] > 0:
            store(motion, row, (duration, force, moving.x, moving.v, moving.work))
            row += 1
    return Body(moving, hand_force, end, time_ns, row)


def move_on(
    system: System, body: Body, time_ns: int, end: float, force: float, cut_ns: int, motion: Floats
) -> Body:
    """Move until ``time_ns`` under a ``force`` that the watchdog drops at ``cut_ns``."""
    if body.time_ns < cut_ns < time_ns:
        share = (cut_ns - body.time_ns) / (time_ns - body.time_ns)
        middle = body.target + share * (end - body.target)
        body = move(system, body, cut_ns, middle, force, motion)
    return move(system, body, time_ns, end, force if body.time_ns < cut_ns else 0.0, motion)


@cache
def loop(law: str) -> Loop:
    """Return the compiled loop of a law, a key of :data:`forcebound.haptics.laws.LAWS`.

    It is called with the system, ``LAWS[law].device`` of what the law relies on, the course, the
    trace to be filled, of shape ``(n, len(TRACE))``, and the motion to be filled, or an array
    without rows. It returns the number of ticks: less than ``n`` if a reading was faster than the
    device.
    """
    start, settle, energy = LAWS[law].start, LAWS[law].settle, LAWS[law].energy
    bound = one_axis(LAWS[law])

    def run(
        system: System, device: DeviceConstants, course: Course, trace: Floats, motion: Floats
    ) -> int:
        instants, targets, answered, engagement, answers, chances, errors = course
        body = Body(Moving(targets[0], 0.0, 0.0, 0.0, 0.0), 0.0, targets[0], instants[0], 0)
        sample, velocity = read(system, body.moving, errors[0]), 0.0
        axis, memory, state = start_axis(sample), NO_MEMORY, start(device)
        sampled_ns = written_ns = instants[0]
        for k in range(answered.size):
            sample_ns, write_ns = instants[2 * k], instants[2 * k + 1]
            cut_ns = written_ns + system.hold_ns
            body = move_on(system, body, sample_ns, targets[2 * k], axis.force, cut_ns, motion)
            reading = read(system, body.moving, errors[k])
            dt = (sample_ns - sampled_ns) * 1e-9
            if k > 0:
                gain = low_pass_gain(system.cutoff, dt)
                velocity = low_pass(velocity, (reading - sample) / dt, gain)
            sample, sampled_ns = reading, sample_ns
            elapsed = (sample_ns - instants[0]) * 1e-9
            answers[k] = answer(system, sample, velocity, elapsed, chances[k])
            body = move_on(system, body, write_ns, targets[2 * k + 1], axis.force, cut_ns, motion)
            reading = read(system, body.moving, errors[k])
            entry, share = answered[k], engagement[k]
            commanded = share * answers[entry] if entry >= 0 else 0.0
            demand, largest, limit = commanded, share * system.saturation, 0.0
            if abs(demand) > largest:
                demand = largest / abs(demand) * demand
            if k == 0:
                axis, write = start_axis(reading), NO_WRITE
                state = settle(state, write, device)
            else:
                dt = (write_ns - written_ns) / 1e9
                if abs(reading - axis.reading) > system.largest_speed * dt + system.resolution:
                    return k
                axis, memory, state, write, limit = bound(
                    axis, memory, state, reading, demand, system.saturation, dt, device
                )
            written_ns = write_ns
            x, v, work, _, _ = body.moving
            estimated, true = energy(state, write, device), work - 0.5 * system.hand_mass * v * v
            forces = (commanded, axis.force, limit)
            store(trace, k, (reading, *forces, estimated, true, x, body.hand_force, velocity))
        return answered.size

    allow_in_kernels([start, settle, energy, bound])
    return jit(run)
