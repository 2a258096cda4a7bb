"""One run of an audit: plant, hand, adversary, bad clock and law, compiled.

The order within a sample is that of :class:`forcebound.bounding.ForceBounder` for one axis; tests
compare the two bit by bit.
"""

import math
from collections.abc import Callable
from functools import cache
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from forcebound.audit.cases import PERIOD, Case, case_of, dissipation_of
from forcebound.bounding import (
    ANCHOR_SAMPLES,
    LAWS,
    clear_square,
    least_viscous_path,
    play,
)
from forcebound.compiled import allow_in_kernels, jit
from forcebound.devices.plant import advance, quantise
from forcebound.errors import ConfigError

ENERGY_TOLERANCE = 1e-9  # J; rounding of sums that reach some 10 J in a run
SUBSTEPS = 8  # plant steps in a hold
EARNED = 1e-5  # J; a run that has not earned this much says nothing about how much was given back

Floats: TypeAlias = NDArray[np.float64]


class Result(NamedTuple):
    """What a run showed."""

    law: str
    energy_min: float  # J, lowest energy of the hand
    loss_and_work_min: float  # J, lowest loss plus motor work
    balance_min: float  # J, lowest balance of a plant step: the integrator's error
    share_left: float  # lowest share left of what had been lost and worked; 1 if it was nothing
    time_of_min: float  # s, when loss plus work was lowest
    peak_force: float  # N
    case: Case

    @property
    def lowest(self) -> float:
        """The lower of the two energies, in J."""
        return min(self.energy_min, self.loss_and_work_min)

    @property
    def is_passive(self) -> bool:
        """Whether no energy ever fell below zero by more than rounding."""
        return self.lowest >= -ENERGY_TOLERANCE


#: Columns of a trace, SI units; ``energy`` and ``loss_and_work`` are the lowest since the last row.
TRACE_COLUMNS = (
    "time",
    "position",
    "reading",
    "asked",
    "force",
    "energy",
    "loss_and_work",
    "balance",
)

Kernel: TypeAlias = Callable[
    [Case, tuple[float, ...], NDArray[np.int64], Floats, Floats, NDArray[np.int64], Floats], None
]


def attack(law: str, case: Case) -> tuple[Result, Floats]:
    """Run one case.

    Args:
        law: A key of :data:`forcebound.bounding.LAWS`.
        case: What to run.

    Returns:
        The result, and a trace of shape ``(samples, len(TRACE_COLUMNS))``.

    Raises:
        ConfigError: If the law is not known.
    """
    if law not in LAWS:
        raise ConfigError(f"no bounding law {law!r}; known are {', '.join(sorted(LAWS))}")
    chance = np.random.default_rng(case.seed).random((case.samples, 6))
    periods = PERIOD * (1.0 + case.jitter * (1.7 * chance[:, 0] - 0.7))
    periods[chance[:, 1] < case.overruns] *= 1.0 + 5.0 * chance[chance[:, 1] < case.overruns, 0]
    periods_ns = np.maximum(np.rint(periods * 1e9), 1.0).astype(np.int64)
    noise = 2.0 * chance[:, 5] - 1.0
    faults = np.zeros(case.samples, dtype=np.int64)
    faults[chance[:, 2] < case.loss] = LOST
    faults[chance[:, 3] < case.corruption] = CORRUPTED
    trace = np.zeros((case.samples, len(TRACE_COLUMNS)))
    parameters = LAWS[law].parameters(dissipation_of(case))
    _kernel_of(law)(case, parameters, periods_ns, 2.0 * chance[:, 4] - 1.0, noise, faults, trace)
    lost = trace[:, 6]
    earned = np.maximum.accumulate(lost)
    lowest = int(np.argmin(lost))
    result = Result(
        law=law,
        energy_min=float(trace[:, 5].min()),
        loss_and_work_min=float(lost[lowest]),
        balance_min=float(trace[:, 7].min()),
        share_left=float(
            np.divide(lost, earned, where=earned > EARNED, out=np.ones_like(lost)).min()
        ),
        time_of_min=float(trace[lowest, 0]),
        peak_force=float(np.abs(trace[:, 4]).max()),
        case=case,
    )
    return result, trace


def replay(law: str, name: str | int, seconds: float) -> tuple[Result, Floats]:
    """Run a case again by its name; see :func:`attack` and :func:`forcebound.audit.case_of`.

    Another length of the same name is the same run, cut.
    """
    return attack(law, case_of(name, seconds))


def read(sensor: int, x: float, v: float, resolution: float, noise: float) -> float:
    """Return a reading at most half a ``resolution`` from ``x``, in m; ``noise`` is in [-1, 1]."""
    if sensor == 1:
        return x + 0.5 * resolution * noise
    if sensor == 2:
        return x + 0.5 * resolution * math.copysign(1.0, noise)
    if sensor == 3:
        return x + 0.5 * resolution * math.copysign(1.0, v)
    return quantise(x, resolution)


LOST = 1  # the force of this sample did not arrive: the old one is asked for again
CORRUPTED = 2  # a random force arrived in its place


def ask(
    adversary: int,
    reading: float,
    velocity: float,
    chance: float,
    stiffness: float,
    damping: float,
    magnitude: float,
    surface: float,
) -> float:
    """Return the force that the adversary asks for, in N; ``chance`` is random in [-1, 1]."""
    depth = max(reading - surface, 0.0)
    if adversary == 0:
        return stiffness * depth
    if adversary == 1:
        return stiffness * depth - damping * velocity if depth > 0.0 else 0.0
    if adversary == 2:
        return -damping * velocity
    if adversary == 3:
        return magnitude * chance
    if adversary == 4:
        return -magnitude if velocity > 0.0 else (magnitude if velocity < 0.0 else 0.0)
    return stiffness * (reading - surface)


@cache
def _kernel_of(law: str) -> Kernel:
    """Return the compiled run of one law."""
    chosen = LAWS[law]
    start, limit, settle = chosen.start, chosen.limit, chosen.settle
    allow_in_kernels([start, limit, settle])
    _allow_common()

    def run(
        case: Case,
        parameters: tuple[float, ...],
        periods_ns: NDArray[np.int64],
        chances: Floats,
        noise: Floats,
        faults: NDArray[np.int64],
        trace: Floats,
    ) -> None:
        half_resolution = 0.5 * case.resolution
        total_mass = case.mass + case.hand_mass
        x = v = work = loss = time = 0.0
        target = reading = playing = path = 0.0
        older = younger = older_age = younger_age = viscous = between = 0.0
        since_anchor = 0
        force = asked = 0.0
        state = start(*parameters)
        history = np.zeros((case.delay + 1, 2))  # reading and velocity, as a ring
        for n in range(case.samples):
            # Hold: the plant moves, and the watchdog drops a force that gets too old.
            elapsed = periods_ns[n] / 1e9
            held_for = min(elapsed, case.hold_limit)
            time += elapsed
            slow = 1.0 - math.cos(2.0 * math.pi * case.slow * time)
            fast = 1.0 - math.cos(2.0 * math.pi * case.fast * time)
            target_before = target
            target = case.amplitude * (0.5 * slow + 0.1 * fast)
            target_velocity = (target - target_before) / elapsed
            lowest_energy = lowest_loss = lowest_balance = math.inf
            for part in range(2):
                duration = held_for if part == 0 else elapsed - held_for
                if duration <= 0.0:
                    continue
                motor = force if part == 0 else 0.0
                began = target_before if part == 0 else target_before + target_velocity * held_for
                h = duration / SUBSTEPS
                for i in range(SUBSTEPS):
                    x_before, v_before, work_before = x, v, work
                    x, v, work, _ = advance(
                        x,
                        v,
                        work,
                        began + target_velocity * h * i,
                        began + target_velocity * h * (i + 1),
                        h,
                        h,
                        motor,
                        total_mass,
                        case.damping,
                        case.friction,
                        case.hand_stiffness,
                        case.hand_damping,
                    )
                    dx = x - x_before
                    spent = case.damping * dx * dx / h + case.friction * abs(dx) + motor * dx
                    kinetic = 0.5 * total_mass * (v * v - v_before * v_before)
                    loss += spent
                    energy = work - 0.5 * case.hand_mass * v * v
                    lowest_energy = min(lowest_energy, energy)
                    lowest_loss = min(lowest_loss, loss)
                    lowest_balance = min(lowest_balance, work - work_before - kinetic - spent)
            # Sample: as ForceBounder.bound does for one axis (tests compare the two bit by bit).
            reading_before = reading
            reading = read(case.sensor, x, v, case.resolution, noise[n])
            move = reading - reading_before
            older_age += elapsed
            younger_age += elapsed
            viscous_before = viscous
            viscous = least_viscous_path(
                viscous,
                clear_square(reading, reading_before, half_resolution),
                elapsed,
                clear_square(reading, older, half_resolution),
                older_age,
                clear_square(reading, younger, half_resolution),
                younger_age,
                between,
            )
            playing_before = playing
            playing = play(reading, playing, half_resolution)
            path_before = path
            path += abs(playing - playing_before)
            # Environment: sees readings, late; its answer may get lost or corrupted.
            slot = n % (case.delay + 1)
            history[slot, 0] = reading
            history[slot, 1] = move / elapsed
            seen = (n + 1) % (case.delay + 1)
            answer = ask(
                case.adversary,
                history[seen, 0],
                history[seen, 1],
                chances[n],
                case.stiffness,
                case.environment_damping,
                case.magnitude,
                case.surface,
            )
            if faults[n] == CORRUPTED:
                answer = 1e3 * chances[n]
            if faults[n] != LOST:
                asked = max(-case.saturation, min(case.saturation, answer))
            # Law.
            held = abs(force)
            state, largest, added = limit(
                state,
                abs(asked),
                elapsed,
                abs(move),
                viscous - viscous_before,
                path - path_before,
                force * move,
                held,
                held,
                *parameters,
            )
            if elapsed > case.hold_limit:
                force = 0.0
                playing = older = younger = reading
                path = older_age = younger_age = viscous = between = 0.0
                since_anchor = 0
            else:
                since_anchor += 1
                if since_anchor == ANCHOR_SAMPLES:
                    older, older_age, younger, younger_age = younger, younger_age, reading, 0.0
                    viscous -= between
                    between = viscous
                    since_anchor = 0
            largest = min(largest, case.saturation)
            wanted = asked + added / elapsed * move if added > 0.0 else asked
            bounded = max(-largest, min(largest, wanted))
            state = settle(state, abs(bounded), abs(bounded - force), abs(force), *parameters)
            force = bounded
            row = (time, x, reading, asked, force, lowest_energy, lowest_loss, lowest_balance)
            for column, value in enumerate(row):
                trace[n, column] = value

    return jit(run)


@cache
def _allow_common() -> None:
    allow_in_kernels([advance, quantise, read, play, ask, clear_square, least_viscous_path])
