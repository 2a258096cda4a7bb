"""The search of the independent attack: programs of rows, drawn at random or improved by CMA-ES.

A *program* is a few rows of genes and the order in which they are walked: a prefix that stores
energy, and a cycle that is repeated. So a leak of a nanojoule a cycle adds up, and a cycle of 8 or
16 rows is locked to the anchors of the certified law.
"""

import math
import warnings
from dataclasses import dataclass

import numpy as np

from experiments.independent_attack.engine import Case, Outcome, run
from experiments.independent_attack.paths import (
    COLUMNS,
    COMMAND,
    LARGE_PEAK,
    MICRO,
    MISREAD,
    SPEED,
    STRIKE,
)
from experiments.independent_attack.truth import AXES, Floats
from forcebound.bounding import ENERGY_TOLERANCE, ForceBounder

NEAR = 1e-6  # J; a restart that ends nearer to zero than this is tight


@dataclass(frozen=True)
class Program:
    """Rows and their order.

    Attributes:
        rows: Number of rows of genes.
        order: Row of each interval.
        columns: Columns that have genes; the others are zero.
    """

    rows: int
    order: tuple[int, ...]
    columns: tuple[int, ...]

    @property
    def size(self) -> int:
        """Number of genes: of the rows, and three for the bristles at the start."""
        return self.rows * len(self.columns) + AXES

    def genes(self, vector: Floats) -> tuple[Floats, Floats]:
        """Return the genes of each interval, and the bristles at the start."""
        rows = np.zeros((self.rows, COLUMNS))
        rows[:, self.columns] = vector[AXES:].reshape(self.rows, len(self.columns))
        return rows[list(self.order)], vector[:AXES]


@dataclass
class Restart:
    """What one restart has found.

    Attributes:
        runs: Number of runs.
        steps: Samples of all runs.
        lowest: Lowest punctual energy, J.
        late_margin: Lowest energy of late holds plus the allowance, J.
        left: Lowest energy after a peak of 0.1 mJ, J.
        excess: Most that the law believed in beyond the truth, J.
    """

    runs: int = 0
    steps: int = 0
    lowest: float = math.inf
    late_margin: float = math.inf
    left: float = math.inf
    excess: float = -math.inf

    def add(self, outcome: Outcome, to_zero: bool = False) -> float:
        """Count a run; return what the search minimises.

        Without a leak that is the share of the peak that was left or, ``to_zero``, the energy that
        was left after a peak of 0.1 mJ.
        """
        self.runs += 1
        self.steps += outcome.steps
        self.lowest = min(self.lowest, outcome.lowest)
        self.late_margin = min(self.late_margin, outcome.late_margin)
        self.excess = max(self.excess, outcome.excess)
        self.left = min(self.left, outcome.left)
        lowest = min(outcome.lowest, outcome.late_margin, -outcome.excess)
        if lowest < -ENERGY_TOLERANCE / 10.0:
            return lowest / 1e-6
        if to_zero and outcome.left < math.inf:
            return outcome.left / LARGE_PEAK
        return min(outcome.share, 1.0) + (NEAR / (outcome.peak + NEAR) if to_zero else 0.0)

    @property
    def worst(self) -> float:
        """Lowest energy, J; of late holds above the allowance, of the truth above the ledger."""
        return min(self.lowest, self.late_margin, -self.excess)

    @property
    def is_tight(self) -> bool:
        """Whether a run came back to zero, or nearly, after the energy was at least 0.1 mJ."""
        return self.left < NEAR


def draw_program(random: np.random.Generator, axes: int, longest: int) -> Program:
    """Return a random program of at most ``longest`` intervals for a device with ``axes`` axes."""
    columns = list(range(MICRO))
    for first in (MICRO, SPEED, MISREAD, COMMAND):
        columns += range(first, first + axes)
    used = [c for c in columns if random.random() < 0.8 or c >= COMMAND]
    cycle = int(random.choice([1, 2, 3, 4, 5, 8, 16], p=[0.1, 0.2, 0.2, 0.2, 0.1, 0.15, 0.05]))
    prefix = int(random.integers(0, 4))
    order: list[int] = []
    for row in range(prefix):
        order += [row] * int(random.integers(1, 9))
    repeats = max(int((longest - len(order)) * random.random() ** 2) // cycle, 1)
    order += [prefix + row for row in range(cycle)] * repeats
    order.append(prefix + cycle)  # a last interval of its own
    return Program(prefix + cycle + 1, tuple(order), tuple(used))


def attack_at_random(
    case: Case, random: np.random.Generator, runs: int, longest: int = 120
) -> Restart:
    """Attack with random programs."""
    bounder = ForceBounder(case.law, case.stated, case.axes)
    found = Restart()
    for _ in range(runs):
        program = draw_program(random, case.axes, longest)
        vector = random.normal(size=program.size) * 10.0 ** random.uniform(-1.0, 0.3)
        genes, start = program.genes(vector)
        found.add(run(case, genes, bounder, start))
    return found


def attack_with_cma(
    case: Case, random: np.random.Generator, runs: int, longest: int = 60
) -> Restart:
    """Attack with programs that CMA-ES (N. Hansen) improves, one after the other, for ``runs``."""
    found = Restart()
    bounder = ForceBounder(case.law, case.stated, case.axes)
    while found.runs < runs:
        program = draw_program(random, case.axes, longest)
        _improve(case, program, random, bounder, found, runs)
    return found


def _improve(
    case: Case,
    program: Program,
    random: np.random.Generator,
    bounder: ForceBounder,
    found: Restart,
    runs: int,
) -> None:
    import cma

    options = {
        "seed": int(random.integers(1, 2**31)),
        "verbose": -9,
        "popsize": 16,
        "CMA_diagonal": program.size > 60,
        "tolfun": 1e-12,
        "tolflatfitness": 20,
    }
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        to_zero = bool(random.random() < 0.5)
        search = cma.CMAEvolutionStrategy(first_guess(program, case.axes, random), 0.4, options)
        while not search.stop() and found.runs < runs:
            vectors = search.ask()
            values = []
            for vector in vectors:
                genes, start = program.genes(np.asarray(vector))
                values.append(found.add(run(case, genes, bounder, start), to_zero))
            search.tell(vectors, values)


def first_guess(program: Program, axes: int, random: np.random.Generator) -> Floats:
    """Return genes of a hand that moves freely first and is then pushed, with much chance."""
    rows = random.normal(size=(program.rows, COLUMNS)) * 0.5
    if random.random() < 0.7:
        moving, pushed = rows[: -len(rows) // 2], rows[-len(rows) // 2 :]
        moving[:, SPEED : SPEED + axes] += 0.8
        moving[:, COMMAND : COMMAND + axes] *= 0.1
        pushed[:, COMMAND : COMMAND + axes] += random.choice([-0.7, 0.7], axes)
        pushed[:, STRIKE] += random.choice([0.0, 0.5, 1.0])
    vector = np.zeros(program.size)
    vector[:AXES] = random.normal(size=AXES)
    vector[AXES:] = rows[:, program.columns].ravel()
    return vector
