"""Lemmas of ``docs/theory.md`` as questions to a solver of real arithmetic.

An obligation has a claim, named hypotheses and a domain of signs. It is proved if the solver finds
no values with which the domain and the hypotheses hold and the claim does not. Each hypothesis is
left out in turn, as a control, and so is the claim: there must then be such values. To add an
obligation, write a function and put it into ``OBLIGATIONS``.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from z3 import And, Or, Reals

from forcebound_proofs.lemmas.terms import (
    choose,
    clear_square,
    hold_cost,
    larger,
    play,
    rigid_cost,
    size,
    smaller,
    spread_price,
    unsure_change,
    unsure_cost,
)


@dataclass(frozen=True)
class Obligation:
    """A claim; ``instead`` has what takes the place of a hypothesis that is left out."""

    claim: Any
    hypotheses: Mapping[str, Any]
    domain: Sequence[Any] = ()
    instead: Mapping[str, Any] = field(default_factory=dict)


def hold() -> Obligation:
    """A hold lowers L by at most its cost, however early it ends."""
    b, s, t, f, d, force, lost, rubbed = Reals("b s t f d F lost rubbed")
    return Obligation(
        lost + rubbed + force * d >= -rigid_cost(size(force), f, b, s),
        {"loss": lost * t >= b * d * d, "friction": rubbed >= f * size(d), "end": t <= s},
        [b > 0, s > 0, t > 0, f >= 0, lost >= 0, rubbed >= 0],
    )


def presliding_hold() -> Obligation:
    """The same where friction is sure only beyond a play."""
    b, s, t, f, z, d, force, lost, rubbed = Reals("b s t f z d F lost rubbed")
    beyond = f * larger(size(d) - z, 0)
    return Obligation(
        lost + rubbed + force * d >= -hold_cost(size(force), f, z, b, s),
        {"loss": lost * t >= b * d * d, "friction": rubbed >= beyond, "end": t <= s},
        [b > 0, s > 0, t > 0, f >= 0, z > 0, lost >= 0, rubbed >= 0],
    )


def longer_hold() -> Obligation:
    """The cost of a hold grows with its length."""
    b, s, t, f, z, force = Reals("b s t f z F")
    claim = hold_cost(force, f, z, b, t) <= hold_cost(force, f, z, b, s)
    return Obligation(claim, {"length": t <= s}, [b > 0, t > 0, s > 0, f >= 0, z >= 0, force >= 0])


def stronger_hold() -> Obligation:
    """The cost of a hold grows with the force, so bisection finds the largest."""
    b, s, f, z, weak, strong = Reals("b s f z F F2")
    claim = hold_cost(weak, f, z, b, s) <= hold_cost(strong, f, z, b, s)
    return Obligation(claim, {"size": weak <= strong}, [b > 0, s > 0, f >= 0, z >= 0, weak >= 0])


def largest_force() -> Obligation:
    """The largest force of the formula is paid, or friction pays for it."""
    energy, f, b, s, root, force = Reals("E f b s root F")
    return Obligation(
        Or(rigid_cost(force, f, b, s) <= energy, force <= f),
        {"limit": force <= f + 2 * root, "root": root * root * s <= b * larger(energy, 0)},
        [b > 0, s > 0, f >= 0, root >= 0, force >= 0],
    )


def weak_force() -> Obligation:
    """A force of at most friction does not lower L."""
    f, d, force, lost, rubbed = Reals("f d F lost rubbed")
    hypotheses = {"friction": rubbed >= f * size(d), "size": size(force) <= f}
    return Obligation(lost + rubbed + force * d >= 0, hypotheses, [lost >= 0, rubbed >= 0])


def work() -> Obligation:
    """Induction step of the price of quantisation."""
    r, q, x, q2, x2, true, seen = Reals("r q x q2 x2 W Q")
    changes, changes2, force, before = Reals("P P2 F F0")
    return Obligation(
        true + force * (x2 - x) - seen - force * (q2 - q) + force * (q2 - x2) >= -r * changes2,
        {
            "induction": true - seen + before * (q - x) >= -r * changes,
            "H4": size(q - x) <= r,
            "price": changes2 >= changes + size(force - before),
        },
        [r >= 0, changes >= 0, changes2 >= changes],
    )


def held_work() -> Obligation:
    """What the price of the held force adds at the end."""
    r, q, x, true, seen, changes, force, price = Reals("r q x W Q P F price")
    return Obligation(
        true >= seen - r * changes - price,
        {
            "induction": true - seen + force * (q - x) >= -r * changes,
            "H4": size(q - x) <= r,
            "price": price >= r * size(force),
        },
        [r >= 0, changes >= 0, price >= 0],
    )


def path() -> Obligation:
    """Induction step of the path; ``foot`` is x without presliding, z = 0."""
    r, z, q, x, foot, foot2, y, y2 = Reals("r z q2 x2 foot foot2 y y2")
    slid, slid2, credited = Reals("X X2 P")
    return Obligation(
        slid2 >= credited + size(y2 - y) + size(foot2 - y2) - r,
        {
            "induction": slid >= credited + size(foot - y) - r,
            "H4": size(q - x) <= r,
            "path": slid2 >= slid + size(foot2 - foot),
            "bristle": size(foot2 - x) <= z,
            "play": y2 == play(q, y, r + z),
        },
        [r >= 0, z >= 0, slid2 >= slid],
        {"play": y2 == q},
    )


def windows() -> Obligation:
    """Cauchy-Schwarz over two windows that follow each other."""
    b, d1, d2, s1, s2, one, two = Reals("b d1 d2 s1 s2 S1 S2")
    return Obligation(
        (one + two) * (s1 + s2) >= b * (d1 + d2) * (d1 + d2),
        {"first": one * s1 >= b * d1 * d1, "second": two * s2 >= b * d2 * d2},
        [b > 0, s1 > 0, s2 > 0, one >= 0, two >= 0],
    )


def window() -> Obligation:
    """Induction step of the viscous loss, from any reading j before."""
    b, r, t, q, q_j, x, x_j, true, true_j, credited = Reals("b r t q q_j x x_j S S_j V_j")
    return Obligation(
        true >= credited + b * clear_square(q, q_j, r) / t,
        {
            "H4": And(size(q - x) <= r, size(q_j - x_j) <= r),
            "induction": true_j >= credited,
            "loss": (true - true_j) * t >= b * (x - x_j) * (x - x_j),
        },
        [b > 0, r >= 0, t > 0, true >= true_j],
    )


def ledger() -> Obligation:
    """Lemmas 2, 3, 4 and 6 together are L >= G."""
    total, lost, slid, true, seen, changes = Reals("L S X W Q C")
    credited, play_path, force, r, f, penalty = Reals("V P F r f penalty")
    state = credited + f * play_path + seen - r * changes - penalty - f * r
    return Obligation(
        total >= state - r * size(force),
        {
            "lemma 2": true >= seen - r * changes - r * size(force),
            "lemma 3": slid >= play_path - r,
            "lemma 4": lost >= credited,
            "lemma 6": total >= lost + f * slid + true - penalty,
        },
        [f > 0, r >= 0, lost >= 0, slid >= 0],
    )


def square() -> Obligation:
    """Completing the square in the deviation of the velocity."""
    b, w, g = Reals("b w g")
    return Obligation(b * w * w + g * w >= -g * g / (4 * b), {"damping": b > 0}, [b != 0])


def one_step() -> Obligation:
    """One step of the force: the penalty without friction."""
    b, s1, s2, d1, d2, f1, f2 = Reals("b s1 s2 d1 d2 F1 F2")
    dt, first, second = s1 + s2, f1 * s1 + f2 * s2, f1 * f1 * s1 + f2 * f2 * s2
    true = b * d1 * d1 / s1 + b * d2 * d2 / s2 + f1 * d1 + f2 * d2
    seen = b * (d1 + d2) * (d1 + d2) / dt + first / dt * (d1 + d2)
    claim = true >= seen - (second - first * first / dt) / (4 * b)
    return Obligation(claim, {"damping": b > 0}, [b != 0, s1 > 0, s2 > 0])


def detour() -> Obligation:
    """One step of the force: friction of a detour u, which a presliding hold then bounds."""
    f, r, s1, s2, d1, d2, u, move = Reals("f r s1 s2 d1 d2 u move")
    beyond = 2 * f * larger(size(u) - size(move) - 2 * r, 0)
    return Obligation(
        f * (size(d1) + size(d2)) >= f * size(d1 + d2) + beyond,
        {"detour": d1 == (d1 + d2) * s1 / (s1 + s2) + u, "H4": size(d1 + d2 - move) <= 2 * r},
        [f > 0, s1 > 0, s2 > 0, r >= 0],
    )


def decision() -> Obligation:
    """A force that acts later: it and the one before are paid."""
    b, f, s, h, total, paid, f0, f1 = Reals("b f s h L G F0 F1")
    d1, d2, lost1, lost2 = Reals("d1 d2 lost1 lost2")
    after = total + lost1 + f * size(d1) + f0 * d1 + lost2 + f * size(d2) + f1 * d2
    return Obligation(
        after >= 0,
        {
            "lemma 5": total >= paid,
            "decision": rigid_cost(size(f0), f, b, s) + rigid_cost(size(f1), f, b, h) <= paid,
            "loss before": lost1 * s >= b * d1 * d1,
            "loss after": lost2 * h >= b * d2 * d2,
        },
        [b > 0, f >= 0, s > 0, h > 0, lost1 >= 0, lost2 >= 0],
    )


def lasting_force() -> Obligation:
    """A force that may follow itself is paid again while nothing moves; a write delay of 1.5 T."""
    energy, f, b, period, before, force = Reals("G f b T F0 F")

    def paid(*acting: Any) -> Any:
        spent = sum(rigid_cost(size(one), f, b, period / 2) for one in acting)
        return spent + rigid_cost(force, f, b, period) <= energy

    return Obligation(
        And(paid(before, force, force), paid(force, force, force)),
        {"lasts": paid(force, force, force), "forces before": size(before) <= force},
        [f >= 0, b > 0, period > 0, force >= 0],
    )


def cut_share() -> Obligation:
    """A cut at an unknown time: the worst share of the interval."""
    share, capability, done, earliest, latest = Reals("share capability work earliest latest")
    return Obligation(
        capability * share * (1 - share) - done * share
        <= unsure_cost(capability, done, earliest, latest),
        {"earliest": earliest <= share, "latest": share <= latest},
        [capability > 0, earliest >= 0, latest <= 1, earliest <= latest],
    )


def cut_price() -> Obligation:
    """A cut at an unknown time: the price of the changes."""
    share, mean, force = Reals("share mean F")
    changes = size(mean - share * force) + share * size(force)
    claim = changes <= unsure_change(mean, force)
    return Obligation(claim, {"at most 1": share <= 1}, [share >= 0])


def gains() -> Obligation:
    """Two motors with a gain each: the worse ledger less the spread."""
    x, one, two, k1, k2 = Reals("x J1 J2 k1 k2")
    worse = smaller((1 - x) * (one + two), (1 + x) * (one + two))
    return Obligation(
        k1 * one + k2 * two >= worse - spread_price(x, [one, two]),
        {"first": size(k1 - 1) <= x, "second": size(k2 - 1) <= x},
        [x >= 0, x < 1],
    )


def gain() -> Obligation:
    """The cost of a hold is convex in the gain, so an end of its range is the worst."""
    b, f, s, force, k1, k2, k, share = Reals("b f s F k1 k2 k share")
    ends = [rigid_cost(end * force, f, b, s) for end in (k1, k2)]
    return Obligation(
        rigid_cost(k * force, f, b, s) <= share * ends[0] + (1 - share) * ends[1],
        {"between": k == share * k1 + (1 - share) * k2, "range": And(share >= 0, share <= 1)},
        [b > 0, f >= 0, s > 0, force >= 0, k1 > 0, k2 > k1, k >= 0],
    )


def drift() -> Obligation:
    """The price of an error of the weight covers its work since the start."""
    most, error, r, q, q_0, x, x_0 = Reals("e error r q q_0 x x_0")
    return Obligation(
        error * (x - x_0) >= -most * (size(q - q_0) + 2 * r),
        {"error": size(error) <= most, "H4": And(size(q - x) <= r, size(q_0 - x_0) <= r)},
        [most >= 0, r >= 0],
    )


def late_hold() -> Obligation:
    """Without a watchdog a late hold gives at most the allowance."""
    b, f, s, total, paid, allowance, force, d = Reals("b f s L G allowance F d")
    lost, rubbed = Reals("lost rubbed")
    return Obligation(
        total + lost + rubbed + force * d >= -allowance,
        {
            "lemma 5": total >= paid,
            "decision": rigid_cost(size(force), f, b, s) <= paid + allowance,
            "loss": lost * s >= b * d * d,
            "friction": rubbed >= f * size(d),
        },
        [b > 0, s > 0, f >= 0, allowance >= 0, lost >= 0, rubbed >= 0],
    )


def guard_windows() -> Obligation:
    """Guard: Cauchy-Schwarz over what a check saw and what follows."""
    period, guard, d1, d2 = Reals("T guard d1 d2")
    claim = (d1 + d2) * (d1 + d2) / period <= d1 * d1 / (period - guard) + d2 * d2 / guard
    return Obligation(
        claim, {"guard_period": guard < period}, [period > 0, guard > 0, period != guard]
    )


def guard_push() -> Obligation:
    """Guard: a motion in the direction of the push; the hold's cost bounds the rest."""
    b, r, period, guard, d1, d2 = Reals("b r T guard d1 d2")
    seen = b * (d1 + d2) * (d1 + d2) / period
    return Obligation(
        b * d2 * d2 / guard >= seen - 4 * b * r * r / (period - guard),
        {"unseen": d1 <= 2 * r, "guard_period": guard < period, "direction": d1 + d2 >= 0},
        [b > 0, r >= 0, period > 0, guard > 0, period != guard],
    )


def guard_after() -> Obligation:
    """Guard with a write delay, each drop reported: a force, then a guarded one, with the push."""
    b, f, r, s, period, guard, total, paid = Reals("b f r s T guard L G")
    before, force, d, push, lost, lost2 = Reals("F0 F d push lost lost2")
    reserve = 4 * b * r * r / (period - guard)
    costs = rigid_cost(size(before), f, b, s) + rigid_cost(force, f, b, period)
    after = total + lost + f * size(d) + before * d
    return Obligation(
        after + lost2 + f * size(push) - force * push >= 0,
        {
            "lemma 5": total >= paid + reserve,
            "decision": costs <= paid,
            "loss before": lost * s >= b * d * d,
            "lemma 7": lost2 >= b * push * push / period - reserve,
        },
        [b > 0, f >= 0, r >= 0, s > 0, period > guard, guard > 0, force >= 0, lost >= 0],
    )


def guard_error() -> Obligation:
    """Guard: a motion against the push, where an error of the weight alone can give anything."""
    b, f, z, error, period, guard, d = Reals("b f z e T guard d")
    given = error * d - f * larger(d - 2 * z, 0)
    reserve = 4 * b * z * z / (period - guard)
    return Obligation(
        given <= hold_cost(error, f, 2 * z, b, period) + reserve,
        {"friction": error <= f, "guard_period": guard < period},
        [b > 0, f >= 0, z > 0, error >= 0, d >= 0, period > 0, guard > 0, period != guard],
    )


def attenuated_work() -> Obligation:
    """A share of a force does at least the work of the middle, less what is away from it."""
    share, least, force, v = Reals("s m F v")
    away = (1 - least) / 2 * size(force)
    return Obligation(
        share * force * v >= (1 + least) / 2 * force * v - away * size(v),
        {"share": And(share >= least, share <= 1)},
        [least >= 0, least < 1],
    )


def attenuated_hold() -> Obligation:
    """One share for a hold: less friction, or a price along the way."""
    b, f, r, dt, share, least, force, d, move = Reals("b f r dt s m F d move")
    away = (1 - least) / 2 * size(force)
    c, left = larger(away - f, 0), larger(f - away, 0)
    seen = b * d * d / dt + left * size(d) + (1 + least) / 2 * force * d
    return Obligation(
        b * d * d / dt + f * size(d) + share * force * d >= seen - c * (size(move) + 2 * r),
        {"share": And(share >= least, share <= 1), "H4": size(d - move) <= 2 * r},
        [b > 0, f >= 0, r >= 0, dt > 0, least >= 0, least < 1],
    )


def attenuated_freely() -> Obligation:
    """Two parts of a hold, each with a share of its own, beside the middle: the price."""
    b, f, s1, s2, d1, d2, one, two, away, way = Reals("b f s1 s2 d1 d2 W1 W2 a D")
    dt, d = s1 + s2, d1 + d2
    c, left = larger(away - f, 0), larger(f - away, 0)
    true = b * d1 * d1 / s1 + b * d2 * d2 / s2 + f * (size(d1) + size(d2)) + one + two
    small = b * way * way / dt + c * c * dt / (4 * b)
    lost = choose(2 * b * way >= c * dt, c * way, small)
    return Obligation(
        true >= b * d * d / dt + left * size(d) - lost,
        {
            "first share": one >= -away * size(d1),
            "second share": two >= -away * size(d2),
            "way": size(d) <= way,
        },
        [b > 0, f >= 0, s1 > 0, s2 > 0, away >= 0, way >= 0],
    )


def attenuated_envelope() -> Obligation:
    """The largest price over the mean direction is that of the envelope."""
    b, c, dt, way, share = Reals("b c dt D share")
    small = b * way * way / dt + c * c * dt / (4 * b)
    lost = choose(2 * b * way >= c * dt, c * way, small)
    return Obligation(
        share * c * way + c * c * dt * (1 - share * share) / (4 * b) <= lost,
        {"direction": share <= 1},
        [b > 0, c >= 0, dt > 0, way >= 0, share >= 0],
    )


def attenuated_path() -> Obligation:
    """Induction step of the path where friction is used up, and its price when less is."""
    r, q, x, x2, y, y2, f, f2 = Reals("r q2 x x2 y y2 f f2")
    slid, slid2, credited, price = Reals("X X2 P price")
    return Obligation(
        slid2 >= credited + f2 * size(y2 - y) - price + f2 * size(x2 - y2),
        {
            "induction": slid >= credited + f * size(x - y),
            "play before": size(x - y) <= 2 * r,
            "H4": size(q - x2) <= r,
            "play": y2 == play(q, y, r),
            "path": slid2 >= slid + f2 * size(x2 - x),
            "price": price >= 2 * r * (f2 - f),
        },
        [r >= 0, f >= 0, f2 >= 0, price >= 0, slid2 >= slid],
        {"play": y2 == q},
    )


def transfer() -> Obligation:
    """Two hands together, from the claim of each and the link; U: what each claim gives up."""
    e1, e2, d1, d2, c1, c2, u1, u2 = Reals("E1 E2 D1 D2 C1 C2 U1 U2")
    return Obligation(
        e1 + e2 >= -(u1 + u2),
        {
            "first": e1 >= d1 - c1 - u1,
            "second": e2 >= d2 - c2 - u2,
            "link, to the first": c1 <= d2,
            "link, to the second": c2 <= d1,
        },
        [d1 >= 0, d2 >= 0, c1 >= 0, c2 >= 0, u1 >= 0, u2 >= 0],
    )


#: The lemma in ``docs/theory.md``, its section, and the obligation.
OBLIGATIONS: tuple[tuple[str, str, Callable[[], Obligation]], ...] = (
    ("lemma 1", "3", hold),
    ("lemma 1, presliding", "3.2", presliding_hold),
    ("lemma 2", "3", work),
    ("lemma 2, end", "3", held_work),
    ("lemma 3, presliding too", "3", path),
    ("lemma 4, two windows", "3", windows),
    ("lemma 4", "3", window),
    ("lemma 5", "3", ledger),
    ("theorem, largest force", "3", largest_force),
    ("theorem, deficit", "3", weak_force),
    ("lemma 6", "3.1", square),
    ("lemma 6, one step", "3.1", one_step),
    ("lemma 6, step, friction", "3.1", detour),
    ("lemma 8, decision", "3.1", decision),
    ("lemma 8, length", "3.1", longer_hold),
    ("lemma 8, bisection", "3.1", stronger_hold),
    ("lemma 9", "3.1", lasting_force),
    ("cut, share", "3.1", cut_share),
    ("cut, price", "3.1", cut_price),
    ("gain", "3.2", gain),
    ("gain of each motor", "3.2", gains),
    ("weight error", "3.2", drift),
    ("lemma 7, windows", "3.2", guard_windows),
    ("lemma 7, with the push", "3.2", guard_push),
    ("lemma 7, against it", "3.2", guard_error),
    ("lemma 7 and 8", "3.2", guard_after),
    ("two levels", "3.2", late_hold),
    ("energy transfer", "3.7", transfer),
    ("lemma 13, work", "3.10", attenuated_work),
    ("lemma 13, per write", "3.10", attenuated_hold),
    ("lemma 13, freely", "3.10", attenuated_freely),
    ("lemma 13, envelope", "3.10", attenuated_envelope),
    ("lemma 13, path", "3.10", attenuated_path),
)
