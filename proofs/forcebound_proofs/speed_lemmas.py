"""Lemmas 10 to 12 for a solver: what a hold costs if the hand has a largest speed.

Each obligation is a claim with its hypotheses (``docs/theory.md``, section 3.2). The claim must
follow from all of them, and must not follow once the one named ``needed`` is left out. What is an
integral there is a number here, with what Cauchy and Schwarz say of it as a hypothesis; the second
mean value theorem of lemma 11 stays on paper.

The terms are those of ``hold_cost.py``, by their names; a test holds both against each other.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import z3

LIMIT = 40_000_000  # of the solver's resource units; it answers "unknown" beyond


@dataclass(frozen=True)
class Obligation:
    """A claim, its hypotheses by name, one that is needed, and the domain of the numbers."""

    claim: Any
    hypotheses: dict[str, Any]
    needed: str
    domain: list[Any] = field(default_factory=list)

    def check(self, left_out: str = "") -> str:
        """Return ``unsat`` if the claim follows, ``sat`` if not; without one hypothesis."""
        solver = z3.Solver()
        solver.set("rlimit", LIMIT)
        solver.add(*self.domain, z3.Not(self.claim))
        solver.add(*[one for name, one in self.hypotheses.items() if name != left_out])
        return str(solver.check())


def choose(condition: Any, yes: Any, no: Any) -> Any:
    """One of two values."""
    if isinstance(condition, z3.BoolRef):
        return z3.If(condition, yes, no)
    return yes if condition else no


def larger(one: Any, other: Any) -> Any:
    """The larger of two values."""
    return choose(one >= other, one, other)


def smaller(one: Any, other: Any) -> Any:
    """The smaller of two values."""
    return choose(one <= other, one, other)


def size(value: Any) -> Any:
    """The magnitude of a value."""
    return choose(value >= 0, value, -value)


def bounded_cost(
    force: Any, friction: Any, play: Any, damping: Any, duration: Any, reach: Any
) -> Any:
    """The cost of a hold in which the hand moves by at most ``reach``."""
    mobility = duration / (2 * damping)
    beyond = choose((force - friction) * mobility >= play, (force - friction) * mobility, play)
    way = choose(force * mobility <= play, force * mobility, beyond)
    way = smaller(way, reach)
    return force * way - friction * larger(way - play, 0) - damping * way * way / duration


def rigid_bounded_cost(force: Any, friction: Any, damping: Any, duration: Any, reach: Any) -> Any:
    """The same with rigid friction."""
    excess = larger(force - friction, 0)
    way = smaller(excess * duration / (2 * damping), reach)
    return excess * way - damping * way * way / duration


def hold() -> Obligation:
    """Lemma 10: a hold lowers L by at most its cost, however early it ends."""
    b, s, t, f, d, force, reach, viscous, rubbed = z3.Reals("b s t f d F D viscous rubbed")
    return Obligation(
        viscous + rubbed + force * d >= -rigid_bounded_cost(size(force), f, b, s, reach),
        {
            "Cauchy-Schwarz": viscous * t >= b * d * d,
            "friction": rubbed >= f * size(d),
            "end of the hold": t <= s,
            "H10": size(d) <= reach,
        },
        "H10",
        [b > 0, s > 0, t > 0, f >= 0, reach > 0, viscous >= 0, rubbed >= 0],
    )


def hold_with_presliding() -> Obligation:
    """Lemma 10 with presliding."""
    b, s, f, d, force, play, reach, viscous, rubbed = z3.Reals("b s f d F 2z D viscous rubbed")
    return Obligation(
        viscous + rubbed + force * d >= -bounded_cost(size(force), f, play, b, s, reach),
        {
            "Cauchy-Schwarz": viscous * s >= b * d * d,
            "friction beyond the play": rubbed >= f * larger(size(d) - play, 0),
            "H10": size(d) <= reach,
        },
        "H10",
        [b > 0, s > 0, f >= 0, play > 0, reach > 0, viscous >= 0, rubbed >= 0],
    )


def cost_grows() -> Obligation:
    """Lemma 10: the cost grows with the force, the duration and the reach."""
    b, s, t, f, one, two, reach, far = z3.Reals("b s t f F1 F2 D1 D2")
    return Obligation(
        rigid_bounded_cost(one, f, b, t, reach) <= rigid_bounded_cost(two, f, b, s, far),
        {"shorter": t <= s, "weaker": one <= two, "nearer": reach <= far},
        "nearer",
        [b > 0, t > 0, s > 0, f >= 0, reach > 0, far > 0, one >= 0, two >= 0],
    )


def largest_force() -> Obligation:
    """The largest force of a ledger costs what there is; ``root`` is that of G b / s."""
    energy, f, b, s, root, force, reach = z3.Reals("G f b s root F D")
    speed = reach / s
    return Obligation(
        z3.Or(rigid_bounded_cost(force, f, b, s, reach) <= energy, force <= f),
        {
            "near": z3.Implies(energy <= b * reach * speed, force <= f + 2 * root),
            "far": z3.Implies(energy > b * reach * speed, force <= f + b * speed + energy / reach),
            "root": root * root * s <= b * larger(energy, 0),
        },
        "far",
        [b > 0, s > 0, f >= 0, root >= 0, force >= 0, reach > 0],
    )


def two_pieces() -> Obligation:
    """Lemma 11: a step within a hold costs at most one hold of the larger force, and reach."""
    b, p, u, e, one, two, near, far = z3.Reals("b p u e d1 d2 D1 D2")
    given = e * (size(one) + size(two)) - b * one * one / p - b * two * two / u
    return Obligation(
        given <= rigid_bounded_cost(e, 0, b, p + u, near + far),
        {"H10": size(one) <= near, "H10 later": size(two) <= far},
        "H10",
        [b > 0, p > 0, u > 0, e >= 0, near > 0, far > 0],
    )


def two_reaches() -> Obligation:
    """Lemma 11: how far two pieces of a hold reach."""
    speed, period, s, part = z3.Reals("v T s part")
    return Obligation(
        speed * (larger(part, period) + larger(s - part, period))
        <= speed * (larger(s, period) + period),
        {"within the hold": z3.And(part >= 0, part <= s)},
        "within the hold",
        [speed > 0, period > 0, s > 0],
    )


def guard() -> Obligation:
    """Lemma 7 with a speed: a guarded hold of any length, with rigid friction."""
    b, f, r, period, g, force, one, two, reach = z3.Reals("b f r T g F d1 d2 D")
    way = one + two
    given = force * way - f * size(way) - b * two * two / g
    reserve = 4 * b * r * r / (period - g)
    return Obligation(
        given <= rigid_bounded_cost(force, f, b, period, reach) + reserve,
        {
            "back is not seen": one <= 2 * r,
            "H10": size(two) + 2 * r <= reach,
            "guard_period": g < period,
        },
        "H10",
        [b > 0, f >= 0, r >= 0, g > 0, force >= 0, period > 0, period != g, reach > 0],
    )


def faster_hand() -> Obligation:
    """Lemma 12: the most that a faster hand has got, after an interval in which it was seen."""
    before, now, held, measured, spent = z3.Reals("X X' L G C")
    loss = z3.Real("L'")
    return Obligation(
        loss >= -now,
        {
            "induction": held >= -before,
            "lemma 5": held >= measured,
            "lemma 1": loss >= held - spent,
            "seen": now >= spent - larger(measured, -before),
        },
        "seen",
        [before >= 0, now >= before, spent >= 0],
    )


OBLIGATIONS: tuple[Callable[[], Obligation], ...] = (
    hold,
    hold_with_presliding,
    cost_grows,
    largest_force,
    two_pieces,
    two_reaches,
    guard,
    faster_hand,
)
