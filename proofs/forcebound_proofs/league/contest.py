"""One method on one device: tuned, played in every place, attacked in the worst one."""

import json
import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cache, partial
from typing import Any, NamedTuple
from zlib import crc32

import numpy as np

from forcebound.errors import ForceboundError, RunError
from forcebound.graph.loader import build, read_template
from forcebound.graph.tree import Value
from forcebound.haptics.laws import ENERGY_TOLERANCE
from forcebound.lab.engine import Row
from forcebound.lab.runs import run_all
from forcebound.run.results import RunResult
from forcebound_proofs.attack import RANDOM, SEARCH, Outcome, objective
from forcebound_proofs.cases import GENERATION, LEAST_PEAK, NOISES, SPREAD, encode, minimise, search
from forcebound_proofs.league.methods import Method
from forcebound_proofs.league.places import (
    ATTACKER,
    CARRIED,
    CARRIER,
    LONG,
    PERSONS,
    TUNED_AT,
    WALL,
    Place,
    Words,
)

TUNING, CELL = "tuning", "cell"  # kinds of rows, beside RANDOM and SEARCH
#: Figures of a run that its row has, as a summary names them.
FIGURES = (
    "displayed_stiffness_n_per_m",
    "displayed_stiffness_share",
    "rate_hardness_n_per_m",
    "extended_rate_hardness_n_per_m",
    "force_error_rms_n",
    "wall_error_rms_n",
    "peak_force_n",
    "contact_bounces",
    "at_rest",
    "vibration_above_threshold_db",
    "transparency_bandwidth_hz",
)
ENERGY = "energy_j"  # lowest true energy of the hand; below zero, it was given some
MASS = "felt_mass_kg"  # that a carrier feels of a cart with a pendulum
SHARE = "displayed_stiffness_share"
FAILED = 10.0  # cost of a run that cannot be


class Budget(NamedTuple):
    """What each method gets on each device."""

    tuning: int = 40  # evaluations, each of all hands of the place
    attacks: tuple[int, int] = (80, 240)  # runs of attacking hands: random, learned
    seconds: float = 6.0  # of a run
    long: float = 20.0  # s, of one by the shaker or the carrier
    attacked: float = 3.0  # s, of an attack
    seed: int = 1


class Contest(NamedTuple):
    """A method on a device, in some places; a case of the league's campaign."""

    name: str
    method: Method
    places: tuple[Place, ...]  # all of one device
    budget: Budget

    @property
    def tuned_in(self) -> Place:
        """Where the method is tuned."""
        return self.places[0]._replace(world=WALL, network=TUNED_AT)

    @property
    def runs(self) -> int:
        """Number of simulations."""
        tuned = self.budget.tuning * len(self.tuned_in.hands) if self.method.numbers else 0
        played = sum(len(place.hands) for place in self.places)
        return tuned + played + sum(self.budget.attacks)

    def rows(self) -> list[Row]:
        """Play; a row for each evaluation of the tuning, and for each run after it."""
        tuning = list(self._tune())
        best = min(tuning, key=lambda row: float(row["cost"]), default={"numbers": "{}"})
        numbers = {} if is_level(tuning) else json.loads(best["numbers"])
        words = self.method.with_numbers(numbers)
        cells = [
            self._row(CELL, place, words, hand=hand, numbers=json.dumps(numbers))
            for place in self.places
            for hand in place.hands
        ]
        played = [row for row in cells if row[ENERGY] is not None]
        attacks: list[Row] = []
        if played:
            worst = min(played, key=lambda row: (min(row[ENERGY], 0.0), row["share_left"]))
            place = Place(*(worst[key] for key in Place._fields))
            attacks = list(self._attack(place, words))
        return [*tuning, *cells, *attacks]

    def _tune(self) -> Iterator[Row]:
        """Search for the numbers that show the stiffest wall among those that give no energy."""
        ranges, rows = self.method.numbers, list[Row]()

        def cost(point: Any) -> float:
            pairs = zip(ranges.items(), point, strict=True)
            numbers = {name: float(f"{one.at(u):.4g}") for (name, one), u in pairs}
            words, place = self.method.with_numbers(numbers), self.tuned_in
            runs = [self._row(TUNING, place, words, hand=hand) for hand in place.hands]
            row = {**runs[0], "hand": None, "command": None, "numbers": json.dumps(numbers)}
            rows.append({key: row[key] for key in row if key not in FIGURES} | _judged(runs))
            return float(rows[-1]["cost"])

        random = np.random.default_rng(self.budget.seed)
        while ranges and len(rows) < self.budget.tuning:  # after convergence it begins elsewhere
            first, left = random.uniform(0.2, 0.8, len(ranges)), self.budget.tuning - len(rows)
            minimise(cost, first, SPREAD, GENERATION, left, random, bounds=[0.0, 1.0])
        return iter(rows)

    def _attack(self, place: Place, words: Words) -> Iterator[Row]:
        """Attack the method in a place: by hands at random, then by a search."""
        random = np.random.default_rng((self.budget.seed, crc32(place.label.encode())))
        at_random, searched = self.budget.attacks
        for _ in range(at_random):
            yield self._attacked(RANDOM, place, words, _code(random))[0]
        attack = partial(self._attacked, SEARCH, place, words)
        yield from search(attack, (), len(ATTACKER), searched, random)

    def _attacked(self, kind: str, place: Place, words: Words, code: str) -> tuple[Row, float]:
        row = self._row(kind, place, words, case=code)
        if row[ENERGY] is None:
            return row, FAILED
        return row, objective(Outcome(row[ENERGY], row["share_left"], {}, {}))

    def _row(
        self, kind: str, place: Place, words: Words, hand: str = "", case: str = "", **others: Any
    ) -> Row:
        """Run once, and return its row."""
        file, *own = place.by_attack(case) if case else place.by_hand(hand)
        budget, every = self.budget, (*words, *own)
        seconds = budget.attacked if case else budget.long if hand in LONG else budget.seconds
        row: Row = {
            "method": self.name,
            **place._asdict(),
            "kind": kind,
            "hand": hand or None,
            "case": case or None,
            "command": command(file, every, seconds),
            "error": None,
            ENERGY: None,
            "share_left": None,
            **others,
        }
        try:
            result, fastest = played(file, every, seconds)
        except ForceboundError as error:
            return row | {"error": f"{type(error).__name__}: {error}"}
        energy, left = energies(result, fastest)
        row |= {ENERGY: energy, "share_left": left}
        if case:
            return row
        return row | figures(result) | ({MASS: felt_mass(result)} if hand == CARRIER else {})


def _code(random: np.random.Generator) -> str:
    return encode((int(random.integers(NOISES)),), random.random(len(ATTACKER)).tolist())


def is_level(tuning: Sequence[Row]) -> bool:
    """Return whether all evaluations cost the same, to 0.1 %: nothing to choose by."""
    return len({round(float(row["cost"]), 3) for row in tuning}) == 1


def _judged(runs: list[Row]) -> Row:
    """Return the cost of a choice of numbers, and its lowest energy.

    Without energy given: minus the mean share of the stiffness that persons felt, where one whose
    hand does not come to rest felt none. Else, above any of these, what was given, in J.
    """
    error = next((row["error"] for row in runs if row["error"]), None)
    if error is not None:
        return {"error": error, "cost": FAILED, ENERGY: None, "share_left": None}
    lowest = min(row[ENERGY] for row in runs)
    found = {ENERGY: lowest, "share_left": min(row["share_left"] for row in runs)}
    if lowest < -ENERGY_TOLERANCE:
        return found | {"cost": 1.0 - lowest}
    persons = [row for row in runs if row["hand"] in PERSONS]
    felt = [min(row[SHARE] or 0.0, 1.0) * bool(row["at_rest"]) for row in persons]
    return found | {"cost": -sum(felt) / len(felt)}


@cache
def _template(file: str) -> Value:
    return read_template(file)


def command(file: str, words: Words, seconds: float) -> str:
    """Return the command that repeats a run."""
    pairs = (word.partition(":=") for word in words)
    quoted = (
        f'{name}:="{value}"' if " " in value else name + is_set + value
        for name, is_set, value in pairs
    )
    return f"forcebound simulate {file} {' '.join(quoted)} --duration {seconds:g}s"


def played(file: str, words: Words, seconds: float) -> tuple[RunResult, float]:
    """Run a launch file; return the result, and the largest speed that the device states.

    Raises:
        ForceboundError: If it cannot be run.
    """
    config = replace(build(_template(file), words), duration=seconds)
    (ran,) = run_all([config])
    if ran.result is None:
        assert ran.error is not None
        raise ran.error if isinstance(ran.error, ForceboundError) else RunError(str(ran.error))
    if ran.result.failed:
        raise RunError(ran.result.failed)
    return replace(ran.result, explains=False), config.only.device.hand_speed or math.inf


def energies(result: RunResult, fastest: float) -> tuple[float, float]:
    """Return the lowest true energy of the hand, in J, and the lowest share left of it.

    They end where the device moves faster than ``fastest``, in m/s (of joints rad/s): what the
    launch file states of the hand is then no longer true.
    """
    columns = result.columns
    is_arm = np.isfinite(columns.joints).all()
    reading = columns.joints if is_arm else columns.true_position
    speed = np.abs(np.diff(reading, axis=0)).max(axis=1) / np.diff(columns.time)
    kept = np.cumsum(np.concatenate(([0.0], speed)) > fastest) == 0
    energy = columns.true_energy[kept]
    highest = np.maximum.accumulate(energy)
    left = np.divide(energy, highest, where=highest > LEAST_PEAK, out=np.ones_like(energy))
    return float(min(energy.min(), 0.0)), float(left.min())


def figures(result: RunResult) -> Row:
    """Return the figures of a run; of one by the shaker also the impedance by frequency."""
    summary = result.summary
    shaken = summary["displayed_impedance"] or {}
    return {key: summary[key] for key in FIGURES} | {
        f"impedance.{name}": shaken.get(name)
        for name in ("frequency_hz", "stiffness_n_per_m", "damping_n_s_per_m")
    }


def felt_mass(result: RunResult) -> list[float]:
    """Return real and imaginary part of force over acceleration, in kg, of a hand that swings.

    Of whole swings in the second half of the run.
    """
    columns = result.columns
    rate = 1.0 / float(np.median(np.diff(columns.time)))
    count = round(int(columns.time[-1] / 2.0 * CARRIED) * rate / CARRIED)
    wave = np.exp(-2j * math.pi * CARRIED * columns.time[-count:])
    force, position = (
        (one[-count:, 0] * wave).sum() for one in (columns.applied_force, columns.true_position)
    )
    mass = -force / position / (2.0 * math.pi * CARRIED) ** 2
    return [float(mass.real), float(mass.imag)]
