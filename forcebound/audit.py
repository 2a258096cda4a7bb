r"""Does a bounding law hold? Ground-truth energy under environments that try to break it.

A run draws a device, a hand, an adversary and a bad clock from its seed, and integrates them with
the same plant step (:func:`forcebound.devices.plant.advance`) and the same law functions
(:data:`forcebound.bounding.LAWS`) as everything else, compiled. Along the way it keeps, at every
sub-step and out of sight of the law,

* the *hand's energy* :math:`\int F_h v\,dt`: what the paper's Eq. 1 asks to be non-negative;
* the *loss plus work*: viscous loss, friction loss and work against the motor. It is the hand's
  energy less the device's kinetic energy, so it is the sharper test, and the certified laws promise
  it too;
* the *balance* of the plant: work of the hand less the growth of kinetic energy, losses and motor
  work. Below zero by more than rounding, the integrator would make energy, and the audit be void.

The device dissipates exactly what the law is told, so no law has a hidden reserve. One axis.

``python -m forcebound.audit`` runs a campaign; its status is 1 if a certified law does not hold.
"""

import argparse
import math
import random
import sys
from collections.abc import Callable, Iterable, Sequence
from functools import cache
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from forcebound.bounding import (
    ANCHOR_SAMPLES,
    LAWS,
    Dissipation,
    clear_square,
    least_viscous_path,
    play,
)
from forcebound.compiled import allow_in_kernels, jit
from forcebound.devices.plant import advance, quantise
from forcebound.errors import ConfigError

ENERGY_TOLERANCE = 1e-9  # J; rounding of sums that reach some 10 J in a run

PERIOD = 1e-3  # s, nominal sampling period T
SUBSTEPS = 8  # plant steps in a hold

ADVERSARIES = (
    "late_wall",
    "active_wall",
    "negative_damper",
    "random_force",
    "velocity_pusher",
    "late_spring",
)

#: How a reading may differ from the position: by half the resolution, in any way.
SENSORS = ("quantised", "noisy", "chattering", "leading")

Floats: TypeAlias = NDArray[np.float64]


class Case(NamedTuple):
    """All that defines a run besides its law; drawn from ``seed`` by :func:`draw_case`."""

    seed: int
    samples: int
    # device
    mass: float  # kg
    damping: float  # N s/m
    friction: float  # N
    resolution: float  # m
    sensor: int  # index in SENSORS
    saturation: float  # N
    hold_limit: float  # s, after which the device drops the force
    # hand
    hand_mass: float  # kg
    hand_stiffness: float  # N/m
    hand_damping: float  # N s/m
    amplitude: float  # m, of the target's motion
    slow: float  # Hz, of its slow part
    fast: float  # Hz, of its fast part
    # environment
    adversary: int  # index in ADVERSARIES
    stiffness: float  # N/m
    environment_damping: float  # N s/m, magnitude of what the adversary gives
    magnitude: float  # N, of its forces that do not depend on position
    surface: float  # m
    delay: int  # samples from reading to force
    loss: float  # share of forces that do not arrive
    corruption: float  # share of forces that are replaced by a random one
    # clock
    jitter: float  # of the period, in periods: 0 to 1 gives T(1 - 0.7 j) to T(1 + j)
    overruns: float  # share of periods that are up to 6 times as long


class Result(NamedTuple):
    """What a run showed."""

    law: str
    seed: int
    energy_min: float  # J, lowest energy of the hand
    loss_and_work_min: float  # J, lowest loss plus motor work
    balance_min: float  # J, lowest balance of a plant step: the integrator's error
    time_of_min: float  # s, when energy_min was reached
    peak_force: float  # N
    case: Case

    @property
    def is_passive(self) -> bool:
        """Whether the hand's energy never fell below zero by more than rounding."""
        return self.energy_min >= -ENERGY_TOLERANCE


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


def draw_case(seed: int, seconds: float) -> Case:
    """Return the run of ``seed``, of about ``seconds`` s."""
    draw = random.Random(seed)

    def logarithmic(low: float, high: float) -> float:
        return math.exp(draw.uniform(math.log(low), math.log(high)))

    return Case(
        seed=seed,
        samples=max(2, round(seconds / PERIOD)),
        mass=logarithmic(0.02, 0.5),
        damping=logarithmic(0.01, 3.0),
        friction=logarithmic(0.003, 1.0),
        resolution=draw.choice((0.0, 1e-6, logarithmic(1e-6, 2e-4), 3e-5, 2e-4)),
        sensor=draw.choice((0, 0, 1, 2, 3)),
        saturation=draw.uniform(3.0, 30.0),
        hold_limit=round(PERIOD * draw.choice((1.0, 1.25, draw.uniform(1.0, 2.5))) * 1e9) / 1e9,
        hand_mass=logarithmic(0.01, 1.0),
        hand_stiffness=logarithmic(10.0, 2000.0),
        hand_damping=draw.choice((0.0, logarithmic(0.1, 10.0))),
        amplitude=logarithmic(1e-5, 0.05),
        slow=logarithmic(0.2, 3.0),
        fast=logarithmic(3.0, 30.0),
        adversary=draw.randrange(len(ADVERSARIES)),
        stiffness=logarithmic(100.0, 30_000.0),
        environment_damping=logarithmic(1.0, 100.0),
        magnitude=draw.uniform(0.5, 30.0),
        surface=draw.uniform(-0.01, 0.02),
        delay=draw.choice((0, 0, 1, draw.randrange(61), draw.randrange(61))),
        loss=draw.choice((0.0, draw.uniform(0.0, 0.5))),
        corruption=draw.choice((0.0, 0.0, draw.uniform(0.0, 0.1))),
        jitter=draw.choice((0.0, draw.uniform(0.0, 1.0))),
        overruns=draw.choice((0.0, 0.0, draw.uniform(0.0, 0.2))),
    )


def dissipation_of(case: Case) -> Dissipation:
    """Return what the law of a run is told: exactly what the device does."""
    return Dissipation(
        damping=case.damping,
        friction=case.friction,
        resolution=case.resolution,
        period=PERIOD,
        hold_limit=case.hold_limit,
        saturation=case.saturation,
    )


def replay(law: str, seed: int, seconds: float) -> tuple[Result, Floats]:
    """Return one run again, with its trace.

    Args:
        law: A key of :data:`forcebound.bounding.LAWS`.
        seed: Of the run.
        seconds: Length of the run, in s; another length of the same seed is the same run, cut.

    Returns:
        The result, and an array of shape ``(samples, len(TRACE_COLUMNS))``.

    Raises:
        ConfigError: If the law is not known.
    """
    if law not in LAWS:
        raise ConfigError(f"no bounding law {law!r}; known are {', '.join(sorted(LAWS))}")
    case = draw_case(seed, seconds)
    chance = np.random.default_rng(seed).random((case.samples, 6))
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
    lowest = int(np.argmin(trace[:, 5]))
    result = Result(
        law=law,
        seed=seed,
        energy_min=float(trace[lowest, 5]),
        loss_and_work_min=float(trace[:, 6].min()),
        balance_min=float(trace[:, 7].min()),
        time_of_min=float(trace[lowest, 0]),
        peak_force=float(np.abs(trace[:, 4]).max()),
        case=case,
    )
    return result, trace


def audit(laws: Iterable[str], runs: int, seed: int, seconds: float = 2.0) -> list[Result]:
    """Return the worst run of each law: the one whose hand got the most energy out.

    Args:
        laws: Keys of :data:`forcebound.bounding.LAWS`.
        runs: Runs of each law; they have the seeds ``seed``, ``seed + 1``, ...
        seed: Seed of the first run.
        seconds: Length of each run, in s.

    Returns:
        One result for each law, in their order; :func:`replay` shows it again by its seed.

    Raises:
        ConfigError: If a law is not known or there is no run.
    """
    if runs < 1:
        raise ConfigError(f"runs must be >= 1, got {runs}")
    return [
        min(
            (replay(law, seed + run, seconds)[0] for run in range(runs)),
            key=lambda result: min(result.energy_min, result.loss_and_work_min),
        )
        for law in laws
    ]


def run_campaign(
    runs: int, laws: Sequence[str], seed: int, seconds_each: float
) -> list[dict[str, Any]]:
    """Audit ``laws`` and return a table with one row each.

    Args:
        runs: Runs of each law.
        laws: Keys of :data:`forcebound.bounding.LAWS`.
        seed: Seed of the first run.
        seconds_each: Length of a run, in s.

    Returns:
        Rows with ``law``, ``runs``, ``energy_min_j``, ``loss_and_work_min_j``, ``worst_seed``,
        ``worst_adversary``, ``worst_sensor``, ``balance_min_j`` (all of the worst run),
        ``is_certified`` and ``holds``: whether the law did what it promises (a law that promises
        nothing holds).

    Raises:
        ConfigError: As :func:`audit`.
    """
    rows: list[dict[str, Any]] = []
    for law in laws:
        (worst,) = audit([law], runs, seed, seconds_each)
        certified = LAWS[law].is_certified
        rows.append(
            {
                "law": law,
                "runs": runs,
                "energy_min_j": worst.energy_min,
                "loss_and_work_min_j": worst.loss_and_work_min,
                "worst_seed": worst.seed,
                "worst_adversary": ADVERSARIES[worst.case.adversary],
                "worst_sensor": SENSORS[worst.case.sensor],
                "balance_min_j": worst.balance_min,
                "is_certified": certified,
                "holds": not certified or worst.loss_and_work_min >= -ENERGY_TOLERANCE,
            }
        )
    return rows


def read(sensor: int, x: float, v: float, resolution: float, noise: float) -> float:
    """Return a reading at most half a ``resolution`` from ``x``, in m; ``noise`` is in [-1, 1]."""
    if sensor == 1:
        return x + 0.5 * resolution * noise
    if sensor == 2:
        return x + 0.5 * resolution * math.copysign(1.0, noise)
    if sensor == 3:
        return x + 0.5 * resolution * math.copysign(1.0, v)
    return quantise(x, resolution)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a campaign, print its table, and return 1 if a law broke its promise, else 0."""
    parser = argparse.ArgumentParser(
        prog="python -m forcebound.audit", description="Audit bounding laws."
    )
    parser.add_argument("--runs", type=int, default=1000, help="runs of each law")
    parser.add_argument("--seconds", type=float, default=2.0, help="length of a run, s")
    parser.add_argument("--seed", type=int, default=1, help="seed of the first run")
    parser.add_argument(
        "--law", action="append", choices=sorted(LAWS), help="only this; repeatable"
    )
    chosen = parser.parse_args(arguments)
    line = "{:<26}{:>14}{:>22}{:>12}  {:<17}{:<11}{}\n"
    heading = (
        "law",
        "energy min, J",
        "loss and work min, J",
        "worst seed",
        "adversary",
        "sensor",
        "",
    )
    sys.stdout.write(line.format(*heading))
    holds = True
    for law in chosen.law or LAWS:
        (row,) = run_campaign(chosen.runs, [law], chosen.seed, chosen.seconds)
        holds = holds and row["holds"]
        verdict = (
            ("holds" if row["holds"] else "BROKEN") if row["is_certified"] else "not certified"
        )
        energies = (f"{row[name]:.3g}" for name in ("energy_min_j", "loss_and_work_min_j"))
        worst = (row["worst_seed"], row["worst_adversary"], row["worst_sensor"])
        sys.stdout.write(line.format(law, *energies, *worst, verdict))
        sys.stdout.flush()
    return 0 if holds else 1


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


if __name__ == "__main__":
    # Not the functions of this copy: numba's cache on disk refers to their module by name.
    from forcebound.audit import main as campaign

    sys.exit(campaign())
