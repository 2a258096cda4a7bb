"""One run of an audit: plant, hand, adversary, bad clock and law.

The run goes through the loop of sweeps (:mod:`forcebound.lab.one_axis`), so plant, adversaries,
sample and law are those of the graph. Bad clocks, late, lost and corrupted forces are its course;
energies are computed here from the motion.
"""

import math
from typing import TypeAlias

import numpy as np

from forcebound.haptics.devices.plant import Axis
from forcebound.haptics.laws import LAWS, check_law
from forcebound.lab import one_axis
from forcebound.lab.one_axis import MOTION, TRACE, Course, Integers, System, loop
from forcebound_proofs.attack import Outcome
from forcebound_proofs.cases import LEAST_PEAK
from forcebound_proofs.law_cases import ADVERSARIES, PERIOD, Scenario, dissipation_of

Floats: TypeAlias = one_axis.Floats

SECONDS = 2.0  # length of a run
PIECES = 8  # plant steps in a hold, or in the part of it before or after the watchdog's cut
UNFILTERED = 1e30  # Hz, cutoff of an adversary's velocity


#: Columns of a trace, SI units; ``energy`` and ``loss_and_work`` are the lowest since the last row.
TRACE_COLUMNS = (
    "time",
    "position",
    "reading",
    "commanded",
    "force",
    "energy",
    "loss_and_work",
)


def run_law(law: str, case: Scenario) -> Outcome:
    """Run one case; its trace has :data:`TRACE_COLUMNS`, each of shape ``(samples,)``.

    Raises:
        ConfigError: If the law is not known.
    """
    check_law(law)
    system, course = _system(case), _course(case)
    times_ns = course.instants_ns[::2]
    pieces = PIECES * (1 + (np.diff(times_ns) > system.hold_ns))  # of each sample: more with a cut
    rows, motion = np.empty((times_ns.size, len(TRACE))), np.empty((pieces.sum(), len(MOTION)))
    loop(law)(system, LAWS[law].device(dissipation_of(case)), course, rows, motion)
    columns = dict(zip(TRACE, rows[1:].T, strict=True))
    magnitude = np.abs(columns["commanded_force"])
    commanded = np.where(
        magnitude > case.saturation,
        case.saturation / np.maximum(magnitude, case.saturation) * columns["commanded_force"],
        columns["commanded_force"],
    )
    force = columns["applied_force"]
    energy, lost, balance = _energies(case, motion, np.cumsum(pieces) - pieces)
    times = np.multiply(times_ns[1:], 1e-9, dtype=np.float64)
    earned = np.maximum.accumulate(lost)
    left = np.divide(lost, earned, where=earned > LEAST_PEAK, out=np.ones_like(lost))
    every = (times, columns["true_position"], columns["position"], commanded, force, energy, lost)
    details = {
        "energy_min_j": float(energy.min()),
        "balance_min_j": float(balance.min()),  # of a plant step: the integrator's error
        "time_of_min_s": float(times[int(np.argmin(lost))]),
        "peak_force_n": float(np.abs(force).max()),
    }
    margin = min(float(lost.min()), details["energy_min_j"])
    trace: dict[str, Floats] = dict(zip(TRACE_COLUMNS, every, strict=True))
    return Outcome(margin, float(left.min()), details, trace)


def _system(case: Scenario) -> System:
    environment, numbers = list(ADVERSARIES.values())[case.adversary]
    a, b, c, d = (*numbers(case), 0.0, 0.0, 0.0)[:4]
    total, hand = case.mass + case.hand_mass, (case.hand_stiffness, case.hand_damping)
    return System(
        Axis(total, case.damping, case.friction, 0.0, 0.0, 0.0, *hand),
        hand_mass=case.hand_mass,
        substep=math.inf,
        pieces=PIECES,
        resolution=case.resolution,
        saturation=case.saturation,
        hold_ns=round(case.hold_limit * 1e9),
        largest_speed=math.inf,
        cutoff=UNFILTERED,
        environment=environment,
        numbers=(a, b, c, d),
        sensor=(one_axis.ENCODER, one_axis.NOISY, one_axis.NOISY, one_axis.LEADING)[case.sensor],
    )


def _course(case: Scenario) -> Course:
    """Return clock, hand and faults; tick 0 begins at rest, and the samples follow."""
    chance = np.random.default_rng(case.seed).random((case.samples, 6))
    periods = PERIOD * (1.0 + case.jitter * (1.7 * chance[:, 0] - 0.7))
    periods[chance[:, 1] < case.overruns] *= 1.0 + 5.0 * chance[chance[:, 1] < case.overruns, 0]
    times_ns = np.zeros(case.samples + 1, dtype=np.int64)
    np.cumsum(np.maximum(np.rint(periods * 1e9), 1.0), out=times_ns[1:])
    ticks = np.arange(times_ns.size)
    chances = np.concatenate(([0.0], 2.0 * chance[:, 4] - 1.0))
    noise = np.concatenate(([0.0], 2.0 * chance[:, 5] - 1.0))
    errors = (noise, noise, np.sign(noise), np.abs(np.sign(noise)))[case.sensor]
    # A late force answers an earlier tick, a corrupted one is random, a lost one stays the old one.
    is_random = case.adversary == list(ADVERSARIES).index("random_force")
    answered = ticks.copy() if is_random else np.maximum(ticks - case.delay, 0)
    lost, corrupted = chance[:, 2] < case.loss, chance[:, 3] < case.corruption
    answered[1:][corrupted] = ticks.size + ticks[1:][corrupted]
    arrived = np.concatenate(([True], ~lost | corrupted))
    answered[0] = -1  # no force yet
    return Course(
        np.repeat(times_ns, 2),
        np.repeat(_targets(case, np.multiply(times_ns, 1e-9, dtype=np.float64)), 2),
        answered[np.maximum.accumulate(np.where(arrived, ticks, 0))],
        np.ones(ticks.size),
        answers=np.concatenate((np.zeros(ticks.size), 1e3 * chances)),
        chances=chances,
        errors=errors,
    )


def _targets(case: Scenario, times: Floats) -> Floats:
    """Return the targets of the hand, in m."""
    slow = 1.0 - np.cos(2.0 * np.pi * case.slow * times)
    fast = 1.0 - np.cos(2.0 * np.pi * case.fast * times)
    targets: Floats = case.amplitude * (0.5 * slow + 0.1 * fast)
    return targets


def _energies(case: Scenario, motion: Floats, starts: Integers) -> list[Floats]:
    """Return the last three columns of a trace; ``starts``: first row of each sample's motion."""
    duration, force, x, v, work = motion.T
    dx = np.diff(x, prepend=0.0)
    spent = case.damping * dx * dx / duration + case.friction * np.abs(dx) + force * dx
    squares = v * v
    kinetic = 0.5 * (case.mass + case.hand_mass) * np.diff(squares, prepend=0.0)
    columns = (
        work - 0.5 * case.hand_mass * squares,
        np.cumsum(spent),
        np.diff(work, prepend=0.0) - kinetic - spent,
    )
    return [np.minimum.reduceat(column, starts) for column in columns]
