"""Three readings of the certified ledger, one axis, a term at a time: can a hand get energy?

The solver chooses the moves of the hand, the readings, and forces that the ledger allows. The model
works on numbers, too, and a test holds it against the bounder; its names are those of the code:
``all_axes.py`` (``observe_axes``), ``waveform.py`` (``run``, ``penalty``), ``timeline.py``
(``cost_before``) and ``allowance.py`` (``may_be_held``, ``cost``). Time goes in half periods, in
units of b = 1 and T = 1.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from types import SimpleNamespace
from typing import Any

import z3

from forcebound_proofs.lemmas.terms import (
    clear_square,
    either,
    hold_cost,
    lagging_cost,
    larger,
    play,
    size,
    step_penalty,
    viscous_loss,
)

HALF = Fraction(1, 2)  # T


@dataclass(frozen=True)
class Stated:
    """What a device states and how it is sampled, and the ``omitted`` term of its ledger."""

    half_resolution: Any = 0
    friction: Any = 0
    presliding: Any = 0  # z_m
    gain: Any = 0  # its largest error
    lag: Any = 0  # T
    left: Any = 0  # exp(-half a period / lag)
    delay: int = 0  # half periods, from a reading to the effect of its force
    hold_limit: int = 2  # half periods
    intervals: tuple[int, ...] = (2, 2)  # half periods between the readings
    choice: tuple[int, ...] = ()  # forces that can be commanded; none: every force
    omitted: str = ""

    def acting(self, forces: Sequence[Any], half: int, is_known: bool = True) -> Any:
        """The force of a half period: the last one that has taken effect, until it is cut.

        ``is_known``: in truth; else as a ledger believes it that leaves something out.
        """
        acting, reading = 0, 0
        for k, force in enumerate(forces):
            effect = reading + self.delay
            reading += self.intervals[k] if k < len(self.intervals) else 2
            is_left_out = self.omitted == "forces on their way" and effect >= reading
            if effect <= half and (is_known or not is_left_out):
                is_held = half < effect + self.hold_limit
                acting = force if is_held or (self.omitted == "cut" and not is_known) else 0
        return acting

    def run(self, actual: Any, target: Any) -> tuple[Any, Any, Any]:
        """The motor's force after half a period, and the integrals of it and of its square."""
        if not self.lag:
            return target, target * HALF, target * target * HALF
        away, left = actual - target, self.left
        mean = self.lag * (1 - left)
        first = target * HALF + away * mean
        second = target * target * HALF + 2 * target * away * mean
        second = second + away * away * self.lag * (1 - left * left) / 2
        return target + away * left, first, second

    def cost(self, force: Any, halves: int) -> Any:
        """The cost of a hold of the magnitude of a force, without lag."""
        if not self.friction:
            return force * force * halves * HALF / 4
        play = 2 * self.presliding
        return hold_cost(size(force), self.friction, play, 1, halves * HALF)


class Ledger:
    """The ledger of a device, with a gain at one end of its range."""

    def __init__(self, stated: Stated, reading: Any, gain: Any = 1, earned: Any = 0) -> None:
        self.stated, self.gain = stated, gain
        foot = stated.half_resolution + stated.presliding * Fraction(3, 2)
        self.state = earned - stated.friction * foot
        self.reading = self.anchor = self.play = reading
        self.mean: Any = 0
        self.loss: Any = 0
        self.actual: Any = 0
        self.move: Any = 0
        self.half = 0

    def observe(self, reading: Any, halves: int, forces: Sequence[Any]) -> None:
        """Take in a reading, so many half periods after the last."""
        s, r, dt = self.stated, self.stated.half_resolution, halves * HALF
        span = range(self.half, self.half + halves)
        targets = [s.acting(forces, half, is_known=False) for half in span]
        first = second = 0
        for target in targets:
            self.actual, one, two = s.run(self.actual, target)
            first, second = first + one, second + two
        move, mean = reading - self.reading, first / dt
        change = 0 if s.omitted == "price" else r * size(mean - self.mean)
        position = play(reading, self.play, 0 if s.omitted == "play" else r + s.presliding)
        memory = SimpleNamespace(loss=self.loss, older_age=self.half * HALF)
        loss = self.loss + move * move / dt
        if r:  # with exact readings the longer window has less, by lemma 4
            step, older = (clear_square(reading, one, r) for one in (self.reading, self.anchor))
            loss = viscous_loss(memory, step, older, dt)
        self.state = self.state + loss - self.loss + s.friction * size(position - self.play)
        self.state = self.state + self.gain * (mean * move - change)
        if s.omitted != "penalty":
            self.state = self.state - self.penalty(targets, second - first * first / dt, move)
        self.reading, self.play, self.mean, self.loss = reading, position, mean, loss
        self.move = move
        self.half += halves

    def penalty(self, targets: Sequence[Any], deviation: Any, move: Any) -> Any:
        """What the hand can have gained by the changes of the force in an interval."""
        s, largest = self.stated, 1 + self.stated.gain
        steps = [k for k in range(1, len(targets)) if targets[k] is not targets[k - 1]]
        if len(steps) == 1 and s.friction and not s.lag and not s.presliding:
            share = steps[0] * HALF * (len(targets) - steps[0]) / len(targets)
            step = largest * (targets[-1] - targets[0])
            one = SimpleNamespace(half_resolution=s.half_resolution, friction=s.friction, damping=1)
            return step_penalty(step, share, move, one)
        return largest * largest * deviation / 4

    @property
    def energy(self) -> Any:
        """G, a lower bound of loss plus work."""
        price = 0 if self.stated.omitted == "price" else self.stated.half_resolution
        return self.state - self.gain * price * size(self.mean)

    def may_be_held(self, force: Any, forces: Sequence[Any]) -> Any:
        """Whether a force may follow those before it."""
        s = self.stated
        span = range(self.half, self.half + s.delay)
        acting = [s.acting(forces, half, is_known=False) for half in span]
        before = 0 if s.omitted == "paid before" else 1
        left = self.energy - before * sum(s.cost(self.gain * one, 1) for one in acting)
        if s.omitted == "counting once":  # as the paper's law, docs/theory.md, section 2
            left = left + s.friction * size(self.move)
        if s.lag:
            least, asked = (self._lagging(one) for one in (0, size(force)))
            return asked <= larger(left, least)
        held = s.cost(self.gain * force, s.hold_limit) <= left
        weak = 0 if s.presliding else s.friction  # friction pays for a force of at most its size
        return either(held, self.gain * size(force) <= weak)

    def lasts(self, force: Any) -> Any:
        """Whether it could follow itself, too, which the law asks as well (lemma 9)."""
        s = self.stated
        if s.lag:
            asked = self._lagging(size(force), larger(size(self.actual), size(force)))
            return asked <= larger(self.energy, self._lagging(0))
        paid = s.cost(self.gain * force, s.hold_limit)
        paid = paid + s.cost(self.gain * force, s.delay) if s.delay else paid
        weak = 0 if s.presliding else s.friction
        return either(paid <= self.energy, self.gain * size(force) <= weak)

    def _lagging(self, force: Any, actual: Any = None) -> Any:
        s = self.stated
        left, actual = s.left**s.hold_limit, size(self.actual) if actual is None else actual
        return lagging_cost(actual, force, 1, s.hold_limit * HALF, s.lag, left)


def dissipated(stated: Stated, moves: Sequence[Any], forces: Sequence[Any], gain: Any) -> list[Any]:
    """The least loss plus work after each half period, on a device with exactly what it states.

    A piece of constant force loses least in even motion; a bend of the force gives what lemma 6
    allows for. A bristle, where friction yields before it slides, keeps energy.
    """
    s, total, totals = stated, 0, []
    actual = position = foot = 0
    for half, move in enumerate(moves):
        actual, first, second = s.run(actual, s.acting(forces, half))
        total = total + move * move / HALF + gain * first / HALF * move
        if s.lag:
            total = total - gain * gain * (second - first * first / HALF) / 4
        position = position + move
        slid = play(position, foot, s.presliding)
        total, foot = total + s.friction * size(slid - foot), slid
        bent = position - foot
        stored = s.friction * bent * bent / (2 * s.presliding) if s.presliding else 0
        totals.append(total + stored)
    return totals


#: Forms of the device, and the terms that its ledger must not omit. The lag is such that half of a
#: force is left after half a period, to nine digits.
LAG = Fraction(round(0.5e9 / math.log(2.0)), 10**9)
SOME = (-4, -2, 0, 2, 4)
MODELS: dict[str, tuple[Stated, tuple[str, ...]]] = {
    "write delay of 1.5 T": (Stated(delay=3), ("forces on their way", "paid before")),
    "write delay of 0.5 T": (Stated(delay=1, intervals=(2,)), ("penalty", "paid before")),
    "cut at a known time": (Stated(intervals=(2,), hold_limit=1), ("cut", "penalty")),
    "gain": (Stated(gain=Fraction(1, 2), intervals=(1,), hold_limit=1), ("gain",)),
    "lag": (Stated(lag=LAG, left=Fraction(1, 2), intervals=(1,), hold_limit=1), ("penalty",)),
    "encoder": (Stated(half_resolution=1, intervals=(1,), hold_limit=1, choice=SOME), ("price",)),
    "friction": (Stated(friction=1, intervals=(1,), hold_limit=1, choice=SOME), ("counting once",)),
}
#: Whole ledgers of which no solver says that they hold; their controls must leak all the same.
LEAKS: dict[str, tuple[Stated, tuple[str, ...]]] = {
    "encoder and friction": (
        Stated(friction=1, half_resolution=1, intervals=(1,), hold_limit=1),
        ("price", "play"),
    )
}


def leak(stated: Stated) -> list[Any]:
    """Formulas that say: the ledger allows these forces, and loss plus work become negative.

    Three readings from rest; where there are two, they follow any past that has earned energy.
    """
    readings = len(stated.intervals) + 1
    forces = [z3.Real(f"force_{k}") for k in range(readings)]
    halves = sum(stated.intervals) + stated.delay + stated.hold_limit + (1 if stated.lag else 0)
    moves = [z3.Real(f"move_{k}") for k in range(halves)]
    earned = z3.Real("earned") if readings == 2 else z3.RealVal(0)
    gain = z3.Real("gain") if stated.gain else z3.RealVal(1)
    formulas = [earned >= 0, size(gain - 1) <= stated.gain]
    ends: tuple[Any, ...] = (1 - stated.gain, 1 + stated.gain)
    if not stated.gain or stated.omitted == "gain":
        ends = (1,)
    ledgers = []
    for k in range(readings):
        reading = position = sum(moves[: sum(stated.intervals[:k])], z3.RealVal(0))
        if stated.half_resolution:
            reading = z3.Real(f"reading_{k}")
            formulas.append(size(reading - position) <= stated.half_resolution)
        if k == 0:
            ledgers = [Ledger(stated, reading, end, earned) for end in ends]
        if stated.choice:
            formulas.append(z3.Or([forces[k] == one for one in stated.choice]))
        for one in ledgers:
            if k > 0:
                one.observe(reading, stated.intervals[k - 1], forces[:k])
            formulas.append(one.may_be_held(forces[k], forces[:k]))
    totals = dissipated(stated, moves, forces, gain)
    return [*formulas, z3.Or([earned + total < 0 for total in totals])]
