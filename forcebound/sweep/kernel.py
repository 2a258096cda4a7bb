"""Compiled kernel: ``WIDTH`` simulations in parallel, with the functions of the nodes.

No physics is defined here. The plant's step, the encoder, the targets of hands, the environments,
the low-pass of the velocity, the sample and the laws are the function objects that the nodes call,
compiled. Here is only their order in a tick, which :mod:`forcebound.nodes.device` fixes: move
to the sample, read, query; move to the write, read, saturate, ramp, bound, write, settle. The
timing of answers is computed before (:mod:`forcebound.sweep.timing`).

Layout. One array holds a row of ``WIDTH`` numbers for each quantity, and every loop over the lanes
is an inner one, so that the compiler fills its vector registers with lanes. ``WIDTH`` is a constant
and all rows lie in one array, since only then can the compiler prove that a row that is written is
none of those that are read. Rows of the traces are ``WIDTH`` numbers too, by tick and column.

One axis, and no jitter of the clock.
"""

from collections.abc import Callable
from functools import cache
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from forcebound.bounding import LAWS
from forcebound.bounding.one_axis import one_axis
from forcebound.bounding.sample import NO_MEMORY, NO_WRITE, start_axis
from forcebound.compiled import allow_in_kernels, jit
from forcebound.devices.plant import count_steps, quantise, step, step_impedance
from forcebound.environments.walls import (
    damped_wall_force,
    damper_force,
    power_law_force,
    time_varying_force,
    wall_force,
)
from forcebound.nodes.velocity import low_pass, low_pass_gain
from forcebound.operators.hands import pressing_target, sinusoidal_target
from forcebound.sweep.lanes import (
    AXIS_ROWS,
    DEVICE_ROWS,
    MEMORY_ROWS,
    load_axis,
    load_device,
    load_memory,
    store_axis,
    store_memory,
)

WIDTH = 32  # lanes: rows of one tick stay in the nearest cache; a multiple of any vector register

#: Columns of the traces, per tick and lane, SI units.
TRACES = (
    "reading",
    "commanded_force",
    "applied_force",
    "estimated_energy",
    "true_energy",
    "true_position",
)

Floats: TypeAlias = NDArray[np.float64]
Integers: TypeAlias = NDArray[np.int64]

# Rows of the table of constants, given by the caller ...
MASS, HAND_MASS, DAMPING, FRICTION, RESOLUTION, SATURATION = range(6)
HAND_STIFFNESS, HAND_DAMPING = 6, 7
LAW = 8  # rows: forcebound.bounding.DeviceConstants
ENVIRONMENT = LAW + DEVICE_ROWS  # four rows: parameters of the environment
OPERATOR = ENVIRONMENT + 4  # three rows: parameters of the hand's path
CONSTANTS = OPERATOR + 3
# ... and variables of the kernel in the same array.
INERTIA, IMPEDANCE = CONSTANTS, CONSTANTS + 1  # of the steps on the way
X, V, WORK, TARGET, TARGET_VELOCITY, SAMPLE, VELOCITY, STATE, ENERGY = range(
    CONSTANTS + 2, CONSTANTS + 11
)
AXIS = CONSTANTS + 11  # rows: forcebound.bounding.sample.AxisMemory
READING, FORCE = AXIS, AXIS + 1
MEMORY = AXIS + AXIS_ROWS  # rows: forcebound.bounding.sample.Memory
WANTED = MEMORY + MEMORY_ROWS  # N, what the law gets
ROWS = WANTED + 1

# Kinds of paths of hands; any other operator is given as a table.
PRESSING, SINUSOIDAL, TABLE = range(3)

KernelArguments: TypeAlias = tuple[
    int, int, int, float, float, int, Floats, Integers, Floats, Floats, Floats, Floats
]
Kernel: TypeAlias = Callable[
    [int, int, int, float, float, int, Floats, Integers, Floats, Floats, Floats, Floats], None
]
"""``kernel(ticks, period_ns, wait_ns, substep, cutoff, path, targets, answered, engagement,
rows, answers, traces)``:

* ``substep``: longest integration step, s; ``cutoff``: of the velocity's low-pass, Hz
* ``path``, ``targets``: kind of path; for ``TABLE`` the targets at samples and writes, m, shape
  ``(2 * ticks, WIDTH)``
* ``answered``, ``engagement``: of :class:`forcebound.sweep.timing.Timing`, shape
  ``(ticks, WIDTH)``; where nothing is answered, any tick and engagement 0
* ``rows``: shape ``(ROWS, WIDTH)``, the first ``CONSTANTS`` filled
* ``answers``: a ring for the environment's answers, shape ``(m, WIDTH)`` with m a power of two
  above the largest distance between a tick and the one that it answers
* ``traces``: filled, shape ``(ticks, len(TRACES), WIDTH)``

All arrays are flat.
"""


def _wall(x: float, v: float, time: float, a: float, b: float, c: float, d: float) -> float:
    return wall_force(x, a, b)


def _damped_wall(x: float, v: float, time: float, a: float, b: float, c: float, d: float) -> float:
    return damped_wall_force(x, v, a, b, c)


def _time_varying(x: float, v: float, time: float, a: float, b: float, c: float, d: float) -> float:
    return time_varying_force(x, time, a, b, c)


def _power_law(x: float, v: float, time: float, a: float, b: float, c: float, d: float) -> float:
    return power_law_force(x, a, b, c, d)


def _damper(x: float, v: float, time: float, a: float, b: float, c: float, d: float) -> float:
    return damper_force(v, a)


#: Environments of the kernel: function, and the fields that are its arguments a to d.
ENVIRONMENTS: dict[str, tuple[Callable[..., float], tuple[str, ...]]] = {
    "wall": (_wall, ("stiffness", "position")),
    "damped_wall": (_damped_wall, ("stiffness", "damping", "position")),
    "time_varying_wall": (_time_varying, ("stiffness", "stiffness_rate", "position")),
    "power_law_wall": (_power_law, ("stiffness", "exponent", "reference", "position")),
    "damper": (_damper, ("damping",)),
}


def aim(
    s: Floats, instant: int, duration: float, elapsed: float, path: int, targets: Floats
) -> None:
    """Set the velocity of every lane's target for the next ``duration``, in s."""
    if path == PRESSING:
        for i in range(WIDTH):
            end = pressing_target(
                elapsed,
                s[OPERATOR * WIDTH + i],
                s[(OPERATOR + 1) * WIDTH + i],
                s[(OPERATOR + 2) * WIDTH + i],
            )
            s[TARGET_VELOCITY * WIDTH + i] = (end - s[TARGET * WIDTH + i]) / duration
    elif path == SINUSOIDAL:
        for i in range(WIDTH):
            end = sinusoidal_target(
                elapsed,
                s[OPERATOR * WIDTH + i],
                s[(OPERATOR + 1) * WIDTH + i],
                s[(OPERATOR + 2) * WIDTH + i],
            )
            s[TARGET_VELOCITY * WIDTH + i] = (end - s[TARGET * WIDTH + i]) / duration
    else:
        for i in range(WIDTH):
            end = targets[instant * WIDTH + i]
            s[TARGET_VELOCITY * WIDTH + i] = (end - s[TARGET * WIDTH + i]) / duration


def move(
    s: Floats,
    instant: int,
    duration: float,
    steps: int,
    elapsed: float,
    path: int,
    targets: Floats,
) -> None:
    """Integrate every lane over ``duration`` to ``elapsed``; ``instant`` counts both instants."""
    aim(s, instant, duration, elapsed, path, targets)
    h = duration / steps
    for i in range(WIDTH):
        inertia = 2.0 * s[MASS * WIDTH + i] / h
        s[INERTIA * WIDTH + i] = inertia
        s[IMPEDANCE * WIDTH + i] = step_impedance(
            inertia,
            s[DAMPING * WIDTH + i],
            s[HAND_DAMPING * WIDTH + i],
            h,
            s[HAND_STIFFNESS * WIDTH + i],
        )
    for n in range(steps):
        middle = n + 0.5
        for i in range(WIDTH):
            target_velocity = s[TARGET_VELOCITY * WIDTH + i]
            x, v, work, _ = step(
                s[X * WIDTH + i],
                s[V * WIDTH + i],
                s[WORK * WIDTH + i],
                s[TARGET * WIDTH + i] + target_velocity * middle * h,
                target_velocity,
                h,
                s[FORCE * WIDTH + i],
                s[INERTIA * WIDTH + i],
                s[IMPEDANCE * WIDTH + i],
                s[FRICTION * WIDTH + i],
                s[HAND_STIFFNESS * WIDTH + i],
                s[HAND_DAMPING * WIDTH + i],
            )
            s[X * WIDTH + i] = x
            s[V * WIDTH + i] = v
            s[WORK * WIDTH + i] = work
    for i in range(WIDTH):
        s[TARGET * WIDTH + i] += s[TARGET_VELOCITY * WIDTH + i] * duration


def begin(s: Floats, path: int, targets: Floats) -> None:
    """Put every lane at rest at its first target."""
    for i in range(WIDTH):
        for row in range(CONSTANTS, ROWS):
            s[row * WIDTH + i] = 0.0
        a = s[OPERATOR * WIDTH + i]
        b = s[(OPERATOR + 1) * WIDTH + i]
        c = s[(OPERATOR + 2) * WIDTH + i]
        if path == PRESSING:
            target = pressing_target(0.0, a, b, c)
        elif path == SINUSOIDAL:
            target = sinusoidal_target(0.0, a, b, c)
        else:
            target = targets[i]
        s[TARGET * WIDTH + i] = target
        s[X * WIDTH + i] = target
        s[SAMPLE * WIDTH + i] = quantise(target, s[RESOLUTION * WIDTH + i])


def command(
    s: Floats, k: int, answered: Integers, engagement: Floats, answers: Floats, commanded: Floats
) -> None:
    """Scale the answer of tick ``k`` by the engage ramp, and saturate it for the law."""
    last = answers.size // WIDTH - 1
    for i in range(WIDTH):
        answer = answers[(answered[k * WIDTH + i] & last) * WIDTH + i]
        force = answer * engagement[k * WIDTH + i]
        largest = s[SATURATION * WIDTH + i] * engagement[k * WIDTH + i]
        magnitude = abs(force)
        commanded[i] = force
        s[WANTED * WIDTH + i] = largest / magnitude * force if magnitude > largest else force


def record(s: Floats, trace: Floats) -> None:
    """Write a tick to its rows of the traces, except the commanded force."""
    for i in range(WIDTH):
        v = s[V * WIDTH + i]
        trace[i] = s[READING * WIDTH + i]
        trace[2 * WIDTH + i] = s[FORCE * WIDTH + i]
        trace[3 * WIDTH + i] = s[ENERGY * WIDTH + i]
        trace[4 * WIDTH + i] = s[WORK * WIDTH + i] - 0.5 * s[HAND_MASS * WIDTH + i] * v * v
        trace[5 * WIDTH + i] = s[X * WIDTH + i]


def _querier(environment: str) -> Callable[..., None]:
    """Return the function that reads, estimates velocity and queries, for every lane."""
    answer = ENVIRONMENTS[environment][0]

    def query(s: Floats, time: float, since_sample: float, gain: float, answers: Floats) -> None:
        for i in range(WIDTH):
            before = s[SAMPLE * WIDTH + i]
            sample = quantise(s[X * WIDTH + i], s[RESOLUTION * WIDTH + i])
            velocity = low_pass(s[VELOCITY * WIDTH + i], (sample - before) / since_sample, gain)
            s[SAMPLE * WIDTH + i] = sample
            s[VELOCITY * WIDTH + i] = velocity
            answers[i] = answer(
                sample,
                velocity,
                time,
                s[ENVIRONMENT * WIDTH + i],
                s[(ENVIRONMENT + 1) * WIDTH + i],
                s[(ENVIRONMENT + 2) * WIDTH + i],
                s[(ENVIRONMENT + 3) * WIDTH + i],
            )

    return query


def _starter(law: str) -> Callable[..., None]:
    """Return the function that starts ``law`` without force, for every lane."""
    start, settle, energy = LAWS[law].start, LAWS[law].settle, LAWS[law].energy

    def start_law(s: Floats) -> None:
        for i in range(WIDTH):
            device = load_device(s, LAW * WIDTH + i, WIDTH)
            axis = start_axis(quantise(s[X * WIDTH + i], s[RESOLUTION * WIDTH + i]))
            state = settle(start(device), NO_WRITE, device)
            store_axis(s, AXIS * WIDTH + i, WIDTH, axis)
            store_memory(s, MEMORY * WIDTH + i, WIDTH, NO_MEMORY)
            s[STATE * WIDTH + i] = state
            s[ENERGY * WIDTH + i] = energy(state, NO_WRITE, device)

    return start_law


def _bounder(law: str) -> Callable[..., None]:
    """Return the function that reads, bounds and writes, for every lane."""
    bound, energy = one_axis(LAWS[law], overruns=False), LAWS[law].energy

    def bound_lanes(s: Floats, dt: float) -> None:
        for i in range(WIDTH):
            device = load_device(s, LAW * WIDTH + i, WIDTH)
            axis, memory, state, write = bound(
                load_axis(s, AXIS * WIDTH + i, WIDTH),
                load_memory(s, MEMORY * WIDTH + i, WIDTH),
                s[STATE * WIDTH + i],
                quantise(s[X * WIDTH + i], s[RESOLUTION * WIDTH + i]),
                s[WANTED * WIDTH + i],
                s[SATURATION * WIDTH + i],
                dt,
                device,
            )
            store_axis(s, AXIS * WIDTH + i, WIDTH, axis)
            store_memory(s, MEMORY * WIDTH + i, WIDTH, memory)
            s[STATE * WIDTH + i] = state
            s[ENERGY * WIDTH + i] = energy(state, write, device)

    return bound_lanes


@cache
def kernel(law: str, environment: str) -> Kernel:
    """Return the compiled kernel of a law and an environment, keys of the two tables."""
    query, start_law, bound = _querier(environment), _starter(law), _bounder(law)

    def run(
        ticks: int,
        period_ns: int,
        wait_ns: int,
        substep: float,
        cutoff: float,
        path: int,
        targets: Floats,
        answered: Integers,
        engagement: Floats,
        s: Floats,
        answers: Floats,
        traces: Floats,
    ) -> None:
        to_sample = (period_ns - wait_ns) * 1e-9
        to_write = wait_ns * 1e-9
        steps_to_sample = count_steps(to_sample, substep)
        steps_to_write = count_steps(to_write, substep)
        since_sample = period_ns * 1e-9
        gain = low_pass_gain(cutoff, since_sample)
        last = answers.size // WIDTH - 1
        columns = traces.size // (ticks * WIDTH)
        begin(s, path, targets)
        for k in range(ticks):
            if k > 0:
                time = k * period_ns * 1e-9
                move(s, 2 * k, to_sample, steps_to_sample, time, path, targets)
            slot = (k & last) * WIDTH
            query(s, k * period_ns * 1e-9, since_sample, gain, answers[slot : slot + WIDTH])
            if wait_ns > 0:
                time = (k * period_ns + wait_ns) * 1e-9
                move(s, 2 * k + 1, to_write, steps_to_write, time, path, targets)
            trace = traces[k * columns * WIDTH : (k + 1) * columns * WIDTH]
            commanded = trace[WIDTH : 2 * WIDTH]
            command(s, k, answered, engagement, answers, commanded)
            if k == 0:
                start_law(s)
            else:
                bound(s, period_ns / 1e9)
            record(s, trace)

    allow_in_kernels([query, start_law, bound])
    return jit(run)
