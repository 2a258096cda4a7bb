"""Search of attacks along a path: programs of rows, drawn at random or improved by CMA-ES.

A *program* is a few rows of genes and the order in which they are walked: a prefix that stores
energy, and a cycle that is repeated. So a leak of a nanojoule a cycle adds up, and a cycle of 8 or
16 rows is locked to the anchors of the certified law.
"""

import math
from dataclasses import dataclass, field
from typing import ClassVar, NamedTuple

import numpy as np

from forcebound.haptics.laws import ENERGY_TOLERANCE, ForceBounder
from forcebound_proofs.cases import minimise
from forcebound_proofs.paths.path import COLUMNS, LARGE_PEAK, PLACES, VECTORS, Command
from forcebound_proofs.paths.run import AttackedDevice, PathResult, Vector, run
from forcebound_proofs.paths.truth import AXES, Floats

GENERATION, SPREAD = 16, 0.4  # runs, and standard deviation of genes, of a search
LARGE = 60  # genes, of which a search adapts the variances alone
NEAR = 1e-6  # J; a restart that ends nearer to zero than this is tight


class Program(NamedTuple):
    """Rows of genes and their order."""

    rows: int
    order: tuple[int, ...]  # row of each interval
    columns: tuple[int, ...]  # that have genes; the others are zero

    @property
    def size(self) -> int:
        """Number of genes of a hand: of the rows, and three for the bristles at the start."""
        return self.rows * len(self.columns) + AXES

    def genes(self, vector: Floats, hand: int = 0) -> tuple[Floats, Floats]:
        """Return the genes of each interval of a hand, and its bristles at the start."""
        vector = vector[hand * self.size : (hand + 1) * self.size]
        rows = np.zeros((self.rows, COLUMNS))
        rows[:, self.columns] = vector[AXES:].reshape(self.rows, len(self.columns))
        return rows[list(self.order)], vector[:AXES]


class Attempt(NamedTuple):
    """A run of a restart, to be repeated; its number counts from 0."""

    number: int
    program: "Program"
    vector: Floats
    result: PathResult


@dataclass
class Restart:
    """A device and a series of attacks on it."""

    hands: ClassVar[int] = 1  # that a run moves
    case: AttackedDevice
    longest: int = 60  # samples of a run, at most
    energy_alone: bool = False  # the law's estimate may be above the truth
    runs: int = 0
    left: float = math.inf  # J, lowest energy after a peak of 0.1 mJ
    worst: Attempt | None = None  # the run with the lowest margin
    last: Attempt | None = None
    bounder: ForceBounder = field(init=False)

    def __post_init__(self) -> None:
        self.bounder = ForceBounder(self.case.law, self.case.stated, self.case.axes)

    @property
    def is_tight(self) -> bool:
        """Whether a run came back to zero, or nearly, after the energy was at least 0.1 mJ."""
        return self.left < NEAR

    def margin(self, result: PathResult) -> float:
        """Return the energy that a law keeps at or above zero, in J."""
        return result.lowest_j if self.energy_alone else result.worst

    def run(
        self, program: Program, vector: Floats, trace: list[Vector] | None = None
    ) -> PathResult:
        """Run once; ``trace`` as of :func:`forcebound_proofs.paths.run.run`."""
        genes, start = program.genes(vector)
        return run(self.case, genes, self.bounder, start, trace)

    def attack(self, program: Program, vector: Floats, to_zero: bool = False) -> float:
        """Run once; return what the search minimises.

        Without a leak that is the share of the peak that was left or, ``to_zero``, the energy that
        was left after a peak of 0.1 mJ.
        """
        self.last = Attempt(self.runs, program, vector, self.run(program, vector))
        result = self.last.result
        if self.worst is None or self.margin(result) < self.margin(self.worst.result):
            self.worst = self.last
        self.runs += 1
        self.left = min(self.left, result.left_j)
        if result.worst < -ENERGY_TOLERANCE / 10.0:
            return result.worst / 1e-6
        if to_zero and result.left_j < math.inf:
            return result.left_j / LARGE_PEAK
        return min(result.share_left, 1.0) + (NEAR / (result.peak_j + NEAR) if to_zero else 0.0)

    def at_random(self, random: np.random.Generator, runs: int) -> None:
        """Attack with random programs."""
        for _ in range(runs):
            program = draw_program(random, self.case.axes, self.longest)
            vector = random.normal(size=self.hands * program.size)
            self.attack(program, vector * 10 ** random.uniform(-1, 0.3))

    def search(self, random: np.random.Generator, runs: int) -> None:
        """Attack with programs that a search improves, one after the other."""
        end = self.runs + runs
        while self.runs < end:
            self._improve(draw_program(random, self.case.axes, self.longest), random, end)

    def _improve(self, program: Program, random: np.random.Generator, end: int) -> None:
        seed, to_zero = int(random.integers(1, 2**31)), bool(random.random() < 0.5)
        is_large = program.size > LARGE
        every = [first_guess(program, self.case.axes, random) for _ in range(self.hands)]
        first = np.concatenate(every)
        if self.case.manner.command == Command.SLOWLY:
            program, first = from_axis_to_axis(random)
        minimise(
            lambda vector: self.attack(program, vector, to_zero),
            *(first, SPREAD, GENERATION, end - self.runs, seed),
            CMA_diagonal=is_large,
            tolfun=1e-12,
            tolflatfitness=20,
        )


def draw_program(random: np.random.Generator, axes: int, longest: int) -> Program:
    """Return a random program of at most ``longest`` intervals for a device with ``axes`` axes."""
    columns = list(range(PLACES[VECTORS[0]]))
    for name in VECTORS:
        columns += range(PLACES[name], PLACES[name] + axes)
    used = [c for c in columns if random.random() < 0.8 or c >= PLACES["command"]]
    cycle = int(random.choice([1, 2, 3, 4, 5, 8, 16], p=[0.1, 0.2, 0.2, 0.2, 0.1, 0.15, 0.05]))
    prefix = int(random.integers(0, 4))
    order: list[int] = []
    for row in range(prefix):
        order += [row] * int(random.integers(1, 9))
    repeats = max(int((longest - len(order)) * random.random() ** 2) // cycle, 1)
    order += [prefix + row for row in range(cycle)] * repeats
    order.append(prefix + cycle)  # a last interval of its own
    return Program(prefix + cycle + 1, tuple(order), tuple(used))


def from_axis_to_axis(random: np.random.Generator) -> tuple[Program, Floats]:
    """Return a program, and genes, of a hand that works on one axis, then rests under another."""
    program = Program(3, (0,) * 25 + (1,) * 15 + (2,) * 20, tuple(range(COLUMNS)))
    rows = random.normal(size=(3, COLUMNS)) * 0.1
    speed, command = PLACES["speed"], PLACES["command"]
    rows[:, PLACES["write"]] += 1.0  # as late as stated
    rows[0, [speed, command]] += 0.8
    rows[2, command + 1] += 0.8
    return program, np.concatenate([np.zeros(AXES), rows.ravel()])


def first_guess(program: Program, axes: int, random: np.random.Generator) -> Floats:
    """Return genes of a hand that moves freely first and is then pushed, with much chance."""
    rows = random.normal(size=(program.rows, COLUMNS)) * 0.5
    if random.random() < 0.7:
        moving, pushed = rows[: -len(rows) // 2], rows[-len(rows) // 2 :]
        speed, command = (slice(PLACES[name], PLACES[name] + axes) for name in ("speed", "command"))
        moving[:, speed] += 0.8
        moving[:, command] *= 0.1
        pushed[:, command] += random.choice([-0.7, 0.7], axes)
        pushed[:, PLACES["share_held"]] += random.choice([0.0, 0.5, 1.0])
    vector = np.zeros(program.size)
    vector[:AXES] = random.normal(size=AXES)
    vector[AXES:] = rows[:, program.columns].ravel()
    return vector
