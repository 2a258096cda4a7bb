"""The compiled kernel: ``WIDTH`` simulations side by side, with the definitions of the nodes.

Nothing is defined here. The plant's step, the encoder, the targets of hands, the environments, the
low-pass of the device node and the bounding laws are the very function objects that the nodes call,
compiled. Here is only their order in a tick, which :mod:`forcebound.nodes.device` fixes: move to
the sample, read, ask; move to the write, read, saturate, ramp, bound, write, settle. When which
answer arrives is known before (:mod:`forcebound.sweep.timing`).

Layout. One array holds a row of ``WIDTH`` numbers for each quantity, and every loop over the lanes
is an inner one, so that the compiler fills its vector registers with lanes. ``WIDTH`` is a constant
and all rows lie in one array, since only then can the compiler prove that a row that is written is
none of those that are read. Rows of the traces are ``WIDTH`` numbers too, by tick and column.

One axis. No jitter of the clock, so the hold limit is never exceeded; what the bounder does then is
not repeated here.
"""

from collections.abc import Callable
from functools import cache
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from forcebound.bounding import ANCHOR_SAMPLES, LAWS, clear_square, least_viscous_path, play
from forcebound.compiled import allow_in_kernels, jit
from forcebound.devices.plant import count_steps, impede, quantise, step
from forcebound.environments.damped_wall import damped_wall_force
from forcebound.environments.power_law_wall import power_law_force
from forcebound.environments.time_varying_wall import time_varying_force
from forcebound.environments.wall import wall_force
from forcebound.nodes.device import follow, low_pass_share
from forcebound.operators.pressing import pressing_target
from forcebound.operators.sinusoidal import sinusoidal_target

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
LAW = 8  # six rows: forcebound.bounding.law.Parameters
ENVIRONMENT = 14  # four rows: parameters of the environment
OPERATOR = 18  # three rows: parameters of the hand's path
CONSTANTS = 21
# ... and those that the kernel keeps in the same array.
INERTIA, IMPEDANCE = 21, 22  # of the steps on the way
X, V, WORK, TARGET, TARGET_VELOCITY, READING, SAMPLE, VELOCITY, PLAY, PATH, FORCE, STATE = range(
    23, 35
)
OLDER, YOUNGER, VISCOUS, BETWEEN = range(35, 39)  # anchors: ForceBounder, least_viscous_path
ROWS = 39

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
    return a * v


#: Environments that the kernel knows: its function, and the fields that are its arguments a to d.
ENVIRONMENTS: dict[str, tuple[Callable[..., float], tuple[str, ...]]] = {
    "wall": (_wall, ("stiffness", "position")),
    "damped_wall": (_damped_wall, ("stiffness", "damping", "position")),
    "time_varying_wall": (_time_varying, ("stiffness", "stiffness_rate", "position")),
    "power_law_wall": (_power_law, ("stiffness", "exponent", "reference", "position")),
    "damper": (_damper, ("damping",)),
}


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
    h = duration / steps
    for i in range(WIDTH):
        inertia = 2.0 * s[MASS * WIDTH + i] / h
        s[INERTIA * WIDTH + i] = inertia
        s[IMPEDANCE * WIDTH + i] = impede(
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


@cache
def kernel(law: str, environment: str) -> Kernel:
    """Return the compiled kernel of a law and an environment, keys of the two tables."""
    chosen = LAWS[law]
    start, limit, settle, energy = chosen.start, chosen.limit, chosen.settle, chosen.energy
    answer = ENVIRONMENTS[environment][0]

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
        begin(s, path, targets)
        since_sample = period_ns * 1e-9
        share = low_pass_share(cutoff, since_sample)
        elapsed = period_ns / 1e9
        last = answers.size // WIDTH - 1
        columns = traces.size // (ticks * WIDTH)
        older_age = younger_age = 0.0  # of the anchors; the clock of all lanes is the same
        since_anchor = 0
        for k in range(ticks):
            # The sample: read, estimate the velocity, ask the environment.
            time = k * period_ns * 1e-9
            if k > 0:
                move(s, 2 * k, to_sample, steps_to_sample, time, path, targets)
            slot = (k & last) * WIDTH
            for i in range(WIDTH):
                before = s[SAMPLE * WIDTH + i]
                sample = quantise(s[X * WIDTH + i], s[RESOLUTION * WIDTH + i])
                velocity = follow(s[VELOCITY * WIDTH + i], (sample - before) / since_sample, share)
                s[SAMPLE * WIDTH + i] = sample
                s[VELOCITY * WIDTH + i] = velocity
                answers[slot + i] = answer(
                    sample,
                    velocity,
                    time,
                    s[ENVIRONMENT * WIDTH + i],
                    s[(ENVIRONMENT + 1) * WIDTH + i],
                    s[(ENVIRONMENT + 2) * WIDTH + i],
                    s[(ENVIRONMENT + 3) * WIDTH + i],
                )
            # The write: read again, take the answer that has come, bound it.
            if wait_ns > 0:
                time = (k * period_ns + wait_ns) * 1e-9
                move(s, 2 * k + 1, to_write, steps_to_write, time, path, targets)
            out = k * columns * WIDTH
            for i in range(WIDTH):
                asked = answers[(answered[k * WIDTH + i] & last) * WIDTH + i]
                saturation = s[SATURATION * WIDTH + i]
                scale = engagement[k * WIDTH + i]
                magnitude = abs(asked)
                if magnitude > saturation:
                    scale *= saturation / magnitude
                traces[out + WIDTH + i] = asked * scale
            if k > 0:
                older_age += elapsed
                younger_age += elapsed
                since_anchor += 1
            moves_anchors = since_anchor == ANCHOR_SAMPLES
            for i in range(WIDTH):
                asked = traces[out + WIDTH + i]
                saturation = s[SATURATION * WIDTH + i]
                damping = s[LAW * WIDTH + i]
                friction = s[(LAW + 1) * WIDTH + i]
                half_resolution = s[(LAW + 2) * WIDTH + i]
                period = s[(LAW + 3) * WIDTH + i]
                hold_limit = s[(LAW + 4) * WIDTH + i]
                axes = s[(LAW + 5) * WIDTH + i]
                reading = quantise(s[X * WIDTH + i], s[RESOLUTION * WIDTH + i])
                held = s[FORCE * WIDTH + i]
                magnitude = abs(held)
                if k == 0:
                    state = start(damping, friction, half_resolution, period, hold_limit, axes)
                    playing, gone, force = reading, 0.0, 0.0
                    s[OLDER * WIDTH + i] = reading
                    s[YOUNGER * WIDTH + i] = reading
                else:
                    # As ForceBounder.bound does for one axis.
                    moved = reading - s[READING * WIDTH + i]
                    distance = abs(moved)
                    between = s[BETWEEN * WIDTH + i]
                    viscous = least_viscous_path(
                        s[VISCOUS * WIDTH + i],
                        clear_square(reading, s[READING * WIDTH + i], half_resolution),
                        elapsed,
                        clear_square(reading, s[OLDER * WIDTH + i], half_resolution),
                        older_age,
                        clear_square(reading, s[YOUNGER * WIDTH + i], half_resolution),
                        younger_age,
                        between,
                    )
                    playing = play(reading, s[PLAY * WIDTH + i], half_resolution)
                    gone = s[PATH * WIDTH + i] + abs(playing - s[PLAY * WIDTH + i])
                    state, largest, added = limit(
                        s[STATE * WIDTH + i],
                        min(abs(asked), saturation),
                        elapsed,
                        distance,
                        viscous - s[VISCOUS * WIDTH + i],
                        gone - s[PATH * WIDTH + i],
                        held * moved,
                        magnitude,
                        magnitude,
                        damping,
                        friction,
                        half_resolution,
                        period,
                        hold_limit,
                        axes,
                    )
                    largest = min(largest, saturation)
                    wanted = asked + added / elapsed * moved if added > 0.0 else asked
                    force = min(max(wanted, -largest), largest)
                    if moves_anchors:
                        s[OLDER * WIDTH + i] = s[YOUNGER * WIDTH + i]
                        s[YOUNGER * WIDTH + i] = reading
                        viscous -= between
                        s[BETWEEN * WIDTH + i] = viscous
                    s[VISCOUS * WIDTH + i] = viscous
                state = settle(
                    state,
                    abs(force),
                    abs(force - held),
                    magnitude,
                    damping,
                    friction,
                    half_resolution,
                    period,
                    hold_limit,
                    axes,
                )
                s[READING * WIDTH + i] = reading
                s[PLAY * WIDTH + i] = playing
                s[PATH * WIDTH + i] = gone
                s[STATE * WIDTH + i] = state
                s[FORCE * WIDTH + i] = force
            if moves_anchors:
                older_age, younger_age = younger_age, 0.0
                since_anchor = 0
            for i in range(WIDTH):
                force = s[FORCE * WIDTH + i]
                v = s[V * WIDTH + i]
                traces[out + i] = s[READING * WIDTH + i]
                traces[out + 2 * WIDTH + i] = force
                traces[out + 3 * WIDTH + i] = energy(
                    s[STATE * WIDTH + i],
                    abs(force),
                    abs(force),
                    s[LAW * WIDTH + i],
                    s[(LAW + 1) * WIDTH + i],
                    s[(LAW + 2) * WIDTH + i],
                    s[(LAW + 3) * WIDTH + i],
                    s[(LAW + 4) * WIDTH + i],
                    s[(LAW + 5) * WIDTH + i],
                )
                traces[out + 4 * WIDTH + i] = (
                    s[WORK * WIDTH + i] - 0.5 * s[HAND_MASS * WIDTH + i] * v * v
                )
                traces[out + 5 * WIDTH + i] = s[X * WIDTH + i]

    allow_in_kernels([start, limit, settle, energy, answer])
    _allow_common()
    return jit(run)


@cache
def _allow_common() -> None:
    shared: list[Any] = [move, begin, play, quantise, follow, low_pass_share, count_steps]
    shared += [clear_square, least_viscous_path]
    allow_in_kernels(shared)
