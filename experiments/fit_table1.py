"""Fit of the hand of ``forcebound reproduce table1``: python experiments/fit_table1.py.

Twelve numbers are sought: mass, stiffness, damping and tremor (force, frequency) of the one hand;
where the wall lies between two steps of the encoder; approach speed, way to the wall and target
depth for each of the two speeds. The cost is the root-mean-square logarithm of ours over the
paper's cell, over the chosen half of Table 1 only, plus penalties: where the less conservative law
does not turn at least twice more than the more conservative one in the first half second of
contact, as the paper describes it; where the entering sample moves by a number of encoder steps
that the speed of the hand makes unlikely, since rate-hardness would then be luck; and, of the
chosen half, where two laws stand in another order than in the paper or 2B is off by more than
0.8 %. CMA-ES, started again from the best of random draws until the time is up.

The runs go through the compiled loop of sweeps (:mod:`forcebound.lab.one_axis`), some hundred
times faster than the graph, with a wall that answers at once; the last line of each result is what
belongs into ``forcebound/lab/paper/setup.py``, whose numbers ``forcebound reproduce`` then takes
through the nodes. Needs the extra ``lab``: pip install -e '.[lab]'.
"""

import argparse
import math
import sys
import time
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from forcebound.haptics.devices.phantom import PhantomPremium15
from forcebound.haptics.devices.plant import Axis
from forcebound.haptics.devices.true_values import per_axis
from forcebound.haptics.laws import LAWS, Dissipation
from forcebound.lab.one_axis import NO_MOTION, TRACE, WALL, Course, System, loop
from forcebound.lab.paper.setup import (
    EARLY_SAMPLES,
    HAND,
    HIGH,
    LOW,
    PAPER_LAWS,
    PAPER_SURFACE,
    SURFACE,
)
from forcebound.lab.paper.table1 import COLUMNS, PAPER, is_fitted
from forcebound.results.contact import (
    count_bounces,
    displayed_stiffness,
    initial_rate_hardness,
)

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]

DEVICE = PhantomPremium15()
DAMPING, FRICTION, RESOLUTION = (
    per_axis(value, 1)[0] for value in (DEVICE.damping, DEVICE.friction, DEVICE.resolution)
)
PERIOD, PERIOD_NS = 1e-3, 1_000_000  # s, ns
STIFFNESS = 10_000.0  # N/m, of the wall
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
FAILED = 3.0  # logarithmic error of a cell that has no value
LAW_ROWS = {law: row for row, law in enumerate(PAPER_LAWS)}
CELLS = np.array([PAPER[law] for law in PAPER_LAWS])
TURNS_MORE = 2  # of the less than of the more conservative law, at least
TURN_WEIGHT, ORDER_WEIGHT, EXACT_WEIGHT, LUCK_WEIGHT = 0.02, 0.2, 2.0, 0.2
NEAR, FAR = 0.003, 0.15  # width of the search, of the unit cube
LUCK = 0.3  # encoder steps
ENTRY_SAMPLES = 10  # before contact, over which the speed of entry is taken
EXACT = 0.008  # relative error allowed for 2B

NAMES = (
    "mass", "stiffness", "damping", "tremor", "frequency", "offset",
    "speed", "way", "target", "speed", "way", "target",
)  # fmt: skip
# With the device's own mass here; without it in what decode returns.
#                  kg    N/m    N s/m  N     Hz    m       m/s   m      m
LOWEST = np.array([0.15, 10.0, 0.01, 0.05, 5.0, 3.5e-6, *(0.02, 0.002, 0.005) * 2])
HIGHEST = np.array([1.2, 1500.0, 3.0, 1.00, 12.0, 6.0e-6, *(1.00, 0.150, 0.400) * 2])
DIGITS = 3  # significant ones; the cost is so rugged that rounding afterwards would change it
LINEAR = np.isin(NAMES, ("tremor", "frequency", "offset"))  # the others: by logarithm


def decode(unit: Floats) -> Floats:
    """Return the twelve numbers of a point in the unit cube, rounded as they are printed."""
    unit = np.clip(unit, 0.0, 1.0)
    straight = LOWEST + (HIGHEST - LOWEST) * unit
    numbers = np.where(LINEAR, straight, LOWEST * (HIGHEST / LOWEST) ** unit)
    numbers[0] -= DEVICE.mass
    rounded: Floats = np.array([float(f"{number:.{DIGITS}g}") for number in numbers])
    return rounded


def shipped() -> Floats:
    """Return the point of the unit cube of the hand in ``forcebound/lab/paper/setup.py``."""
    numbers = np.array(
        [
            HAND.mass + DEVICE.mass, HAND.stiffness, HAND.damping, HAND.tremor,
            HAND.tremor_frequency, PAPER_SURFACE - SURFACE,
            *(number for one in (HIGH, LOW) for number in (one.speed, one.way, one.target)),
        ]
    )  # fmt: skip
    logarithmic = np.log(numbers / LOWEST) / np.log(HIGHEST / LOWEST)
    unit: Floats = np.where(LINEAR, (numbers - LOWEST) / (HIGHEST - LOWEST), logarithmic)
    return unit


@dataclass(frozen=True)
class Touch:
    """Measures of one contact."""

    hardness: float  # N/mm; NaN without
    stiffness: float  # N/mm; NaN without
    turns: int  # in the first half second of contact
    luck: (
        float  # steps by which the reading of the entering sample moved more or less than the hand
    )
    depth: float  # mm, mean from 2 s on
    force: float  # N, mean from 2 s on


def contact(law: str, numbers: Floats, approach: Floats) -> Touch:
    """Return the measures of one law's contact."""
    speed, way, behind = approach.tolist()
    mass, stiffness, damping, tremor, frequency, offset = numbers[:6].tolist()
    surface = PAPER_SURFACE - offset
    begin, end = surface - way, surface + behind
    travel, phase = speed * TIMES, 2.0 * np.pi * frequency * TIMES
    targets = np.where(travel >= abs(end - begin), end, begin + travel)
    targets += tremor / stiffness * np.sin(phase)
    system = SYSTEM._replace(
        axis=SYSTEM.axis._replace(
            mass=DEVICE.mass + mass, hand_stiffness=stiffness, hand_damping=damping
        ),
        numbers=(STIFFNESS, surface, 0.0, 0.0),
    )
    course = Course(
        np.repeat(np.arange(SAMPLES) * PERIOD_NS, 2), np.repeat(targets, 2), np.arange(SAMPLES),
        np.ones(SAMPLES), np.zeros(SAMPLES), np.zeros(SAMPLES), np.zeros(SAMPLES),
    )  # fmt: skip
    trace = np.empty((SAMPLES, len(TRACE)))
    loop(law)(system, LAWS[law].device(RELIED_ON), course, trace, NO_MOTION)
    readings, forces = (trace[:, TRACE.index(name)] for name in ("position", "applied_force"))
    depth = readings - surface
    hardness = initial_rate_hardness(forces, depth)
    shown = displayed_stiffness(TIMES, forces, depth)
    first = int(np.argmax(depth > 0.0))
    return Touch(
        math.nan if hardness is None else hardness * 1e-3,
        math.nan if shown is None else shown * 1e-3,
        count_bounces(readings[first : first + EARLY_SAMPLES]),
        luck_of(readings[max(first - ENTRY_SAMPLES, 0) : first + 1]),
        float(depth[2000:].mean()) * 1e3,
        float(forces[2000:].mean()),
    )


def luck_of(readings: Floats) -> float:
    """Return by how many steps the last reading moved more or less than the hand's speed says."""
    steps = np.diff(readings) / RESOLUTION
    return abs(float(steps[-1]) - max(float(steps.mean()), 1.0)) if steps.size else 1.0


def evaluate(numbers: Floats) -> list[list[Touch]]:
    """Return the contacts of every law, at high and at low speed."""
    return [
        [contact(law, numbers, approach) for law in PAPER_LAWS]
        for approach in (numbers[6:9], numbers[9:12])
    ]


def cells(touches: list[list[Touch]]) -> Floats:
    """Return the table, in N/mm, in the paper's layout."""
    return np.array(
        [
            [value for touch in both for value in (touch.hardness, touch.stiffness)]
            for both in zip(*touches, strict=True)
        ]
    )


def errors_of(table: Floats) -> Floats:
    """Return the logarithm of ours over the paper's of every cell."""
    with np.errstate(all="ignore"):
        errors = np.log(table / CELLS)
    return np.where(np.isfinite(errors), errors, FAILED)


def penalty(touches: list[list[Touch]], table: Floats, half: Mask) -> float:
    """Return the penalties: turns, luck; of the chosen half also order of the laws and 2B."""
    missing = sum(
        max(0, of[LAW_ROWS["more_conservative"]].turns + TURNS_MORE
            - of[LAW_ROWS["less_conservative"]].turns)
        for of in touches
    )  # fmt: skip
    exchanged = 0.0
    for ours, paper, chosen in zip(table.T, CELLS.T, half.T, strict=True):
        for soft in np.flatnonzero(chosen):
            for stiff in np.flatnonzero(chosen & (paper > 1.05 * paper[soft])):
                excess = ours[soft] / ours[stiff] - 1.0
                exchanged += min(max(excess, 0.0), 1.0) if math.isfinite(excess) else 1.0
    row = LAW_ROWS["more_conservative_viscous"]
    off = np.maximum(np.abs(errors_of(table)[row][half[row]]) - EXACT, 0.0).sum()
    luck = sum(max(touch.luck - LUCK, 0.0) for of in touches for touch in of) / len(PAPER_LAWS)
    return (
        LUCK_WEIGHT * luck
        + TURN_WEIGHT * missing
        + ORDER_WEIGHT * exchanged
        + EXACT_WEIGHT * float(off)
    )


def rms(errors: Floats) -> float:
    """Return the root mean square; NaN of nothing."""
    return math.sqrt(float(np.mean(errors**2))) if errors.size else math.nan


def fit(half: Mask, seconds: float, seed: int, near: bool) -> None:
    """Search and print every result."""
    import cma

    random = np.random.default_rng(seed)
    end = time.monotonic() + seconds

    def cost(unit: Any) -> float:
        point = np.asarray(unit)
        outside = float(np.sum(np.maximum(0.0, -point) + np.maximum(0.0, point - 1.0)))
        touches = evaluate(decode(point))
        table = cells(touches)
        return rms(errors_of(table)[half]) + penalty(touches, table, half) + outside

    while time.monotonic() < end:
        draws = random.random((150, len(NAMES)))
        if near:
            draws = shipped() + NEAR * (2.0 * draws - 1.0)
        start = min(draws, key=cost)
        options = {
            "popsize": 16,
            "maxiter": 150,
            "verbose": -9,
            "seed": int(random.integers(1, 2**31)),
        }
        strategy = cma.CMAEvolutionStrategy(start, NEAR if near else FAR, options)
        while not strategy.stop():
            points = strategy.ask()
            strategy.tell(points, [cost(point) for point in points])
            if time.monotonic() >= end:
                break
        print_hand(decode(np.asarray(strategy.result.xbest)), half)


def print_hand(numbers: Floats, half: Mask) -> None:
    """Print one result."""
    touches = evaluate(numbers)
    table = cells(touches)
    errors = errors_of(table)
    print(
        f"all {rms(errors):.3f}  fitted {rms(errors[half]):.3f}  "
        f"predicted {rms(errors[~half]):.3f}  penalty {penalty(touches, table, half):.3f}"
    )
    print("  " + "; ".join(" ".join(f"{cell:.2f}" for cell in row) for row in table))
    row = LAW_ROWS["more_conservative"]
    for name, of in zip(("high", "low"), touches, strict=True):
        turns = " ".join(str(touch.turns) for touch in of)
        print(
            f"  {name}: turns {turns}; more_conservative rests at {of[row].depth:.2f} mm, "
            f"{of[row].force:.2f} N"
        )
    mass, stiffness, damping, tremor, frequency, offset = numbers[:6].tolist()
    print(
        f"  hand {mass:g} kg, {stiffness:g} N/m, {damping:g} N s/m, tremor {tremor:g} N at "
        f"{frequency:g} Hz; offset {offset * 1e6:g} um;",
        end=" ",
    )
    for name, (speed, way, target) in (("high", numbers[6:9]), ("low", numbers[9:12])):
        print(
            f"{name} {speed * 1e3:g} mm/s, way {way * 1e3:g} mm, target {target * 1e3:g} mm;",
            end=" ",
        )
    print(flush=True)


def main() -> int:
    """Fit; return the exit status."""
    parser = argparse.ArgumentParser(description=str(__doc__).partition("\n")[0])
    parser.add_argument("--half", choices=("first", "second", "all"), default="first")
    parser.add_argument("--seconds", type=float, default=600.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--near", action="store_true", help="start at the hand of setup.py")
    arguments = parser.parse_args()
    first = np.array(
        [[is_fitted(law, cell) for cell in range(len(COLUMNS))] for law in range(len(PAPER_LAWS))]
    )
    halves = {"first": first, "second": ~first, "all": first | ~first}
    fit(halves[arguments.half], arguments.seconds, arguments.seed, arguments.near)
    return 0


if __name__ == "__main__":
    sys.exit(main())
