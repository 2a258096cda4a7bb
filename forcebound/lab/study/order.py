"""Order of a participant's trials: a function of the study, their number and the answers so far.

So nothing but the answers has to be kept: a session that goes on computes the same order again.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from random import Random
from typing import Literal, TypeAlias

from forcebound.lab.engine import Row
from forcebound.lab.study.plan import Staircase, Stimulus, StudyFile, same_unit
from forcebound.units import split_quantity

_Pair: TypeAlias = tuple[Stimulus, Stimulus]


@dataclass(frozen=True)
class Trial:
    """Two stimuli that are compared."""

    number: int  # from 1, training included
    block: str
    phase: Literal["training", "main"]
    counted: Stimulus  # how often it is chosen is counted
    other: Stimulus
    counted_first: bool
    seed: int

    @property
    def stimuli(self) -> tuple[Stimulus, Stimulus]:
        """Both, in the order in which they are presented."""
        one, other = self.counted, self.other
        return (one, other) if self.counted_first else (other, one)

    @property
    def columns(self) -> Row:
        """Columns of a row of this trial before its touches."""
        shown = enumerate(self.stimuli, start=1)
        return {
            "trial": str(self.number),
            "block": self.block,
            "phase": self.phase,
            "counted": self.counted.condition,
            "counted_level": self.counted.columns["level"],
            "other": self.other.condition,
            "other_level": self.other.columns["level"],
            "counted_interval": "1" if self.counted_first else "2",
        } | {f"{key}_{i}": text for i, one in shown for key, text in one.columns.items()}


def blocks_of(study: StudyFile, number: int) -> list[str]:
    """Return the blocks of participant ``number`` (from 0) in their order.

    Counterbalanced: rows of a balanced Latin square, so that over as many participants as it has
    rows each block stands in each place, and after each other one, equally often.

    Source: Williams, Experimental designs balanced for the estimation of residual effects of
    treatments, Australian Journal of Scientific Research 2, 1949.
    """
    names, count = list(study.blocks), len(study.blocks)
    if study.order.blocks == "fixed":
        return names
    zigzag = [(place + 1) // 2 if place % 2 else -place // 2 for place in range(count)]
    row = [names[(step + number) % count] for step in zigzag]
    return row[::-1] if count % 2 and number // count % 2 else row


def next_trial(study: StudyFile, number: int, rows: Sequence[Row]) -> Trial | None:
    """Return the trial of participant ``number`` that follows the answered ones; None: no more."""
    for block in blocks_of(study, number):
        own = [row for row in rows if row["block"] == block]
        listed, drills, seed = _listed(study, number, block)
        count = len(own)
        if count < len(listed):
            pair, is_first = listed[count]
        elif isinstance(study.method, Staircase):
            chosen = _climbed(study, number, own, Random(f"{seed}/{count}"))
            if chosen is None:
                continue
            pair, is_first = chosen
        else:
            continue
        phase: Literal["training", "main"] = "training" if count < drills else "main"
        return Trial(len(rows) + 1, block, phase, *pair, is_first, seed + count)
    return None


def total(study: StudyFile) -> int | None:
    """Return the number of a participant's trials, training included; None of staircases."""
    if isinstance(study.method, Staircase):
        return None
    repetitions = study.training.repetitions + study.method.repetitions
    return len(study.blocks) * len(study.pairs) * repetitions


@lru_cache(maxsize=64)
def _listed(study: StudyFile, number: int, block: str) -> tuple[list[tuple[_Pair, bool]], int, int]:
    """Return the trials of a block that no answer decides, the number of drills, and a seed."""
    random = Random(f"{study.order.seed}/{number}/{block}")
    drills = _shuffled(study.pairs, study.training.repetitions, number, random)
    repetitions = 0 if isinstance(study.method, Staircase) else study.method.repetitions
    mains = _shuffled(study.pairs, repetitions, number, random)
    return drills + mains, len(drills), random.randrange(2**31)


def _shuffled(
    pairs: Sequence[_Pair], repetitions: int, number: int, random: Random
) -> list[tuple[_Pair, bool]]:
    """Return the trials in random order; in half of those of a pair the counted one is first."""
    order = [(pair, (i + number) % 2 == 0) for pair in pairs for i in range(repetitions)]
    random.shuffle(order)
    return order


def _climbed(
    study: StudyFile, number: int, rows: Sequence[Row], random: Random
) -> tuple[_Pair, bool] | None:
    """Return the next pair of a staircase that has not ended, one for each condition."""
    method = study.method
    assert isinstance(method, Staircase)
    found = []
    for condition in study.conditions:
        own = [
            row["chose_counted"] == "1"
            for row in rows
            if row["phase"] == "main" and row["counted"] == condition
        ]
        level, reversals = staircase(method, own)
        if len(reversals) < method.reversals and len(own) < method.most:
            found.append((condition, level))
    if not found:
        return None
    condition, level = random.choice(found)
    counted = Stimulus(condition, f"{level:.12g} {split_quantity(method.standard)[1]}".strip())
    return (counted, Stimulus(condition, method.standard)), random.random() < 0.5


def staircase(method: Staircase, answers: Sequence[bool]) -> tuple[float, list[float]]:
    """Return the next level, in the unit of the standard, and the levels of reversals so far."""
    standard, level, step = same_unit(method, method.start, method.step)
    run, direction, reversals = 0, 0, list[float]()
    for is_right in answers:
        run = run + 1 if is_right else 0
        if is_right and run < 2:
            continue
        turn = -1 if is_right else 1
        if direction not in (0, turn):
            reversals.append(level)
        run, direction = 0, turn
        size = step if len(reversals) < method.coarse else step / 2.0
        level = max(level + turn * size, standard + step / 2.0)
    return level, reversals
