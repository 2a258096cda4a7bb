"""Fit of the hand of ``forcebound reproduce table1``.

Eight numbers are sought: mass, stiffness, damping and tremor of the hand, its way to the wall and
its target behind it, and its speed at each of the two. What differs from trial to trial is not
fitted: where the wall lies between two steps of the encoder, the start, the phase of the tremor.

The cost is the root mean square, over eleven of the 20 cells, of the mean distance of our trials
from the paper's, by logarithm: it is least where the paper's trial is our median, and where ours
differ little. The other nine no hand can change: four are 2B, and five are the rate-hardness of a
wall that nothing bounds yet, anything from 0 to 10 N/mm by the place of the wall between two steps.

The search is CMA-ES from the middle of all ranges, over a few trials that the table does not have;
what it prints of a hand is over those of the table, all cells. The result is the mean of the last
generations, not the best point seen, which would be the luckiest. ``--without LAW`` leaves a law's
cells out of the cost, from the same beginning: the hand then predicts them.

The runs go through the compiled loop of sweeps (:mod:`forcebound.lab.one_axis`), with a wall that
answers at once; those of the search integrate in five times longer steps. The last line is what
belongs into ``paper/setup.py``, whose hands ``forcebound reproduce`` then takes through the launch
file.
"""

import math
from collections.abc import Sequence
from dataclasses import astuple

import click
import numpy as np
from numpy.typing import NDArray

from forcebound.haptics.devices.phantom import PhantomPremium15
from forcebound.haptics.devices.plant import Axis
from forcebound.haptics.laws import LAWS, Dissipation
from forcebound.lab.one_axis import NO_MOTION, TRACE, WALL, Course, System, loop
from forcebound.results.contact import displayed_stiffness, initial_rate_hardness
from forcebound_proofs.cases import minimise
from forcebound_proofs.paper.setup import (
    PAPER_LAWS,
    SURFACE,
    TRIALS,
    Hand,
    Trial,
    trials,
)
from forcebound_proofs.paper.table1 import PAPER

Floats = NDArray[np.float64]

DEVICE = PhantomPremium15()
TRUE = DEVICE.true_numbers()  # as stated
DAMPING, FRICTION, RESOLUTION = TRUE.damping[0], TRUE.friction[0], TRUE.resolution[0]
PERIOD, PERIOD_NS = 1e-3, 1_000_000  # s, ns
STIFFNESS = 10_000.0  # N/m, of the wall
FREQUENCY = 10.0  # Hz, of the tremor
SAMPLES = 5001  # 2 to 5 s count for the displayed stiffness
TIMES = PERIOD * np.arange(SAMPLES, dtype=np.float64)  # s
RELIED_ON = Dissipation(
    damping=DAMPING,
    friction=FRICTION,
    resolution=RESOLUTION,
    period=PERIOD,
    hold_limit=PERIOD,
    saturation=DEVICE.saturation,
)
SYSTEM = System(
    Axis(DEVICE.mass, DAMPING, FRICTION, 0.0, 0.0, 0.0, 0.0, 0.0),
    hand_mass=0.0,  # of no account: nothing here looks at the energy
    substep=DEVICE.substep,
    pieces=1,
    resolution=RESOLUTION,
    saturation=DEVICE.saturation,
    hold_ns=PERIOD_NS,
    largest_speed=math.inf,
    cutoff=100.0,  # likewise: the wall has no damping
    environment=WALL,
    numbers=(0.0, 0.0, 0.0, 0.0),
)
COARSE = SYSTEM._replace(substep=5.0 * DEVICE.substep)  # of the search
CONSTANTS = {law: LAWS[law].device(RELIED_ON) for law in PAPER_LAWS}
FAILED = 3.0  # logarithmic error of a cell that has no value
POPULATION = 14  # hands of a generation
TRIED = trials(12, first=1000)
AVERAGED = 10  # last generations
WIDTH = 0.08  # of the search at its begin, of the unit cube
FREE = {  # cells that depend on the hand, in the order of the paper's table
    "less_conservative_viscous": (True, True, False, True),
    "less_conservative": (False, True, False, True),
    "aol": (False, True, False, True),
    "more_conservative": (True, True, True, True),
}
DIGITS = 3  # significant ones, as printed

# As the fields of Hand, with the device's own mass here and without it in what decode returns.
# A soft grip; the middles of the two speeds are near those of the paper's user study (section 5.2).
#                  kg    N/m    N s/m N     m      m      m/s   m/s
LOWEST = np.array([0.15, 5.0, 0.01, 0.05, 0.002, 0.005, 0.05, 0.01])
HIGHEST = np.array([1.2, 500.0, 3.0, 1.00, 0.100, 0.400, 0.50, 0.10])


def decode(unit: Floats) -> Hand:
    """Return the hand of a point in the unit cube, by logarithm, rounded as it is printed."""
    numbers = LOWEST * (HIGHEST / LOWEST) ** np.clip(unit, 0.0, 1.0)
    numbers[0] -= DEVICE.mass
    return Hand(*(float(f"{number:.{DIGITS}g}") for number in numbers))


def course(hand: Hand, speed: float, trial: Trial) -> Course:
    """Return the hand's motion and the ticks, the same for all laws."""
    surface = SURFACE - trial.offset
    begin, end = surface - hand.way - trial.lead, surface + hand.target
    phase = 2.0 * np.pi * FREQUENCY * TIMES + trial.phase
    targets = np.minimum(begin + speed * TIMES, end)
    targets += hand.tremor / hand.stiffness * np.sin(phase)
    instants, every, nothing = np.arange(SAMPLES) * PERIOD_NS, np.arange(SAMPLES), np.zeros(SAMPLES)
    return Course(
        np.repeat(instants, 2), np.repeat(targets, 2), every,
        np.ones(SAMPLES), np.zeros(SAMPLES), nothing, nothing,
    )  # fmt: skip


def contact(law: str, system: System, motion: Course) -> tuple[float, float]:
    """Return H_R and S_D of one law's contact, in N/mm; 0 without."""
    trace = np.empty((SAMPLES, len(TRACE)))
    loop(law)(system, CONSTANTS[law], motion, trace, NO_MOTION)
    surface = system.numbers[1]
    readings, forces = (trace[:, TRACE.index(name)] for name in ("position", "applied_force"))
    hardness = initial_rate_hardness(forces, readings - surface)
    shown = displayed_stiffness(TIMES, forces, readings - surface)
    return (hardness or 0.0) * 1e-3, (shown or 0.0) * 1e-3


def evaluate(
    hand: Hand, laws: Sequence[str], tried: Sequence[Trial], system: System = SYSTEM
) -> Floats:
    """Return H_R and S_D, in N/mm, shape ``(trials, laws, 4)``, in the paper's layout."""
    mass = DEVICE.mass + hand.mass
    axis = system.axis._replace(mass=mass, hand_stiffness=hand.stiffness, hand_damping=hand.damping)
    each = []
    for trial in tried:
        numbers = (STIFFNESS, SURFACE - trial.offset, 0.0, 0.0)
        held = system._replace(axis=axis, numbers=numbers)
        motions = [course(hand, speed, trial) for speed in (hand.high, hand.low)]
        each.append([[contact(law, held, motion) for motion in motions] for law in laws])
    return np.array(each).reshape(len(tried), len(laws), 4)


def errors(contacts: Floats, laws: Sequence[str]) -> Floats:
    """Return the logarithm of ours over the paper's of cells, shape ``(..., laws, 4)``."""
    with np.errstate(divide="ignore"):
        logarithms = np.log(contacts / np.array([PAPER[law] for law in laws]))
    return np.where(np.isfinite(logarithms), logarithms, FAILED)


def rms(values: Floats) -> float:
    """Return the root mean square."""
    return math.sqrt(float(np.mean(values**2)))


def cost(hand: Hand, laws: Sequence[str]) -> float:
    """Return what the search makes small."""
    distances = np.abs(errors(evaluate(hand, laws, TRIED, COARSE), laws)).mean(axis=0)
    return rms(distances[np.array([FREE[law] for law in laws])])


def fit(laws: Sequence[str], generations: int, seed: int) -> Hand:
    """Search the hand for some laws."""

    def outside_too(point: Floats) -> float:
        return cost(decode(point), laws) + float(np.abs(point - np.clip(point, 0.0, 1.0)).sum())

    first, runs = np.full(LOWEST.size, 0.5), POPULATION * generations
    middles = minimise(outside_too, first, WIDTH, POPULATION, runs, seed)
    return decode(np.mean(middles[-AVERAGED:], axis=0))


def print_hand(hand: Hand, left_out: str | None) -> None:
    """Print a hand and the errors of its medians over the trials of the table.

    Fitted are the cells of the search, predicted those that ``left_out`` would have added.
    """
    medians = np.median(evaluate(hand, list(PAPER_LAWS), TRIALS), axis=0)
    table = errors(medians, list(PAPER_LAWS))
    free = {law: table[list(PAPER_LAWS).index(law)][list(cells)] for law, cells in FREE.items()}
    predicted = f"  predicted {rms(free.pop(left_out)):.3f}" if left_out else ""
    fitted = rms(np.concatenate(list(free.values())))
    click.echo(f"all cells {rms(table):.3f}  fitted {fitted:.3f}{predicted}")
    click.echo(", ".join(f"{number:g}" for number in astuple(hand)))


@click.command()
@click.option("--without", type=click.Choice(list(FREE)), help="Law to predict.")
@click.option("--generations", default=50, show_default=True, help="Of the search.")
@click.option("--seed", default=1, show_default=True, help="Of the search.")
def main(without: str | None, generations: int, seed: int) -> None:
    """Fit the hand of the paper's Table 1."""
    print_hand(fit([law for law in FREE if law != without], generations, seed), without)
