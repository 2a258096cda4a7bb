"""Lemmas 10 to 12 as questions to a solver: what a hold costs if the hand has a largest speed.

What is an integral in ``docs/theory.md`` is a number here, with what Cauchy and Schwarz say of it
as a hypothesis; the second mean value theorem of lemma 11 stays on paper.
"""

from collections.abc import Callable

from z3 import And, Implies, Or, Real, Reals

from forcebound_proofs.lemmas.obligations import Obligation
from forcebound_proofs.lemmas.terms import (
    bounded_cost,
    larger,
    rigid_bounded_cost,
    size,
)


def hold() -> Obligation:
    """Lemma 10: a hold lowers L by at most its cost, however early it ends."""
    b, s, t, f, d, force, reach, viscous, rubbed = Reals("b s t f d F D viscous rubbed")
    return Obligation(
        viscous + rubbed + force * d >= -rigid_bounded_cost(size(force), f, b, s, reach),
        {
            "Cauchy-Schwarz": viscous * t >= b * d * d,
            "friction": rubbed >= f * size(d),
            "end of the hold": t <= s,
            "H10": size(d) <= reach,
        },
        [b > 0, s > 0, t > 0, f >= 0, reach > 0, viscous >= 0, rubbed >= 0],
    )


def hold_with_presliding() -> Obligation:
    """Lemma 10 with presliding."""
    b, s, f, d, force, play, reach, viscous, rubbed = Reals("b s f d F 2z D viscous rubbed")
    return Obligation(
        viscous + rubbed + force * d >= -bounded_cost(size(force), f, play, b, s, reach),
        {
            "Cauchy-Schwarz": viscous * s >= b * d * d,
            "friction beyond the play": rubbed >= f * larger(size(d) - play, 0),
            "H10": size(d) <= reach,
        },
        [b > 0, s > 0, f >= 0, play > 0, reach > 0, viscous >= 0, rubbed >= 0],
    )


def cost_grows() -> Obligation:
    """Lemma 10: the cost grows with the force, the duration and the reach."""
    b, s, t, f, one, two, reach, far = Reals("b s t f F1 F2 D1 D2")
    return Obligation(
        rigid_bounded_cost(one, f, b, t, reach) <= rigid_bounded_cost(two, f, b, s, far),
        {"shorter": t <= s, "weaker": one <= two, "nearer": reach <= far},
        [b > 0, t > 0, s > 0, f >= 0, reach > 0, far > 0, one >= 0, two >= 0],
    )


def largest_force() -> Obligation:
    """The largest force of a ledger costs what there is; ``root`` is that of G b / s."""
    energy, f, b, s, root, force, reach = Reals("G f b s root F D")
    speed = reach / s
    return Obligation(
        Or(rigid_bounded_cost(force, f, b, s, reach) <= energy, force <= f),
        {
            "near": Implies(energy <= b * reach * speed, force <= f + 2 * root),
            "far": Implies(energy > b * reach * speed, force <= f + b * speed + energy / reach),
            "root": root * root * s <= b * larger(energy, 0),
        },
        [b > 0, s > 0, f >= 0, root >= 0, force >= 0, reach > 0],
    )


def two_pieces() -> Obligation:
    """Lemma 11: a step within a hold costs at most one hold of the larger force, and reach."""
    b, p, u, e, one, two, near, far = Reals("b p u e d1 d2 D1 D2")
    given = e * (size(one) + size(two)) - b * one * one / p - b * two * two / u
    return Obligation(
        given <= rigid_bounded_cost(e, 0, b, p + u, near + far),
        {"H10": size(one) <= near, "H10 later": size(two) <= far},
        [b > 0, p > 0, u > 0, e >= 0, near > 0, far > 0],
    )


def two_reaches() -> Obligation:
    """Lemma 11: how far two pieces of a hold reach."""
    speed, period, s, part = Reals("v T s part")
    return Obligation(
        speed * (larger(part, period) + larger(s - part, period))
        <= speed * (larger(s, period) + period),
        {"within the hold": And(part >= 0, part <= s)},
        [speed > 0, period > 0, s > 0],
    )


def guard() -> Obligation:
    """Lemma 7 with a speed: a guarded hold of any length, with rigid friction."""
    b, f, r, period, g, force, one, two, reach = Reals("b f r T g F d1 d2 D")
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
        [b > 0, f >= 0, r >= 0, g > 0, force >= 0, period > 0, period != g, reach > 0],
    )


def faster_hand() -> Obligation:
    """Lemma 12: the most that a faster hand has got, after an interval in which it was seen."""
    before, now, held, measured, spent = Reals("X X' L G C")
    loss = Real("L'")
    return Obligation(
        loss >= -now,
        {
            "induction": held >= -before,
            "lemma 5": held >= measured,
            "lemma 1": loss >= held - spent,
            "seen": now >= spent - larger(measured, -before),
        },
        [before >= 0, now >= before, spent >= 0],
    )


#: The lemma in ``docs/theory.md``, its section, and the obligation.
SPEED: tuple[tuple[str, str, Callable[[], Obligation]], ...] = (
    ("lemma 10", "3.2", hold),
    ("lemma 10, presliding", "3.2", hold_with_presliding),
    ("lemma 10, growth", "3.2", cost_grows),
    ("lemma 10, largest force", "3.2", largest_force),
    ("lemma 11, two pieces", "3.2", two_pieces),
    ("lemma 11, their reach", "3.2", two_reaches),
    ("lemma 7 with a speed", "3.2", guard),
    ("lemma 12", "3.2", faster_hand),
)
