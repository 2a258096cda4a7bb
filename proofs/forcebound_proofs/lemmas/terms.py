"""Terms of the ledger for numbers and for a solver's unknowns alike, by the names of the code.

They are transcribed from ``forcebound/haptics/laws``: ``hold_cost.py``, ``sample.py``,
``waveform.py``, ``all_axes.py`` and ``timeline.py``. A test holds each against the code.
"""

from typing import Any

import z3


def choose(condition: Any, yes: Any, no: Any) -> Any:
    """One of two values."""
    if isinstance(condition, z3.BoolRef):
        return z3.If(condition, yes, no)
    return yes if condition else no


def either(one: Any, other: Any) -> Any:
    """Whether one of two statements holds."""
    return z3.Or(one, other) if isinstance(one, z3.BoolRef) else one or other


def larger(one: Any, other: Any) -> Any:
    """The larger of two values."""
    return choose(one >= other, one, other)


def smaller(one: Any, other: Any) -> Any:
    """The smaller of two values."""
    return choose(one <= other, one, other)


def size(value: Any) -> Any:
    """The magnitude of a value."""
    return choose(value >= 0, value, -value)


def rigid_cost(force: Any, friction: Any, damping: Any, duration: Any) -> Any:
    """The cost of a hold with rigid friction."""
    excess = larger(force - friction, 0)
    return excess * excess * duration / (4 * damping)


def hold_cost(force: Any, friction: Any, play: Any, damping: Any, duration: Any) -> Any:
    """The cost of a hold in which friction is sure only beyond a play."""
    mobility = duration / (2 * damping)
    excess = force - friction
    before = force * force * mobility / 2
    beyond = excess * excess * mobility / 2 + friction * play
    at_end = play * (force - play / mobility / 2)
    return choose(
        force * mobility <= play, before, choose(excess * mobility >= play, beyond, at_end)
    )


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


def play(reading: Any, position: Any, half_width: Any) -> Any:
    """The play operator."""
    return larger(reading - half_width, smaller(reading + half_width, position))


def clear_square(reading: Any, anchor: Any, half_resolution: Any) -> Any:
    """The square of what of a move cannot be quantisation."""
    clear = larger(size(reading - anchor) - 2 * half_resolution, 0)
    return clear * clear


def viscous_loss(memory: Any, step: Any, older: Any, dt: Any) -> Any:
    """The least viscous loss since the older anchor, before the anchors have moved, for b = 1."""
    return larger(memory.loss + step / dt, older / (memory.older_age + dt))


def step_penalty(step: Any, share: Any, move: Any, one: Any) -> Any:
    """The penalty of a single step; ``share`` is its deviation over its square."""
    distance = size(move) + 2 * one.half_resolution
    return hold_cost(size(step), 2 * one.friction, distance, one.damping, share)


def unsure_cost(capability: Any, work: Any, earliest: Any, latest: Any) -> Any:
    """The most that a hold can have cost that was cut at an unknown time."""
    share = choose(capability > 0, (1 - work / capability) / 2, latest)
    share = smaller(larger(share, earliest), latest)
    return capability * share * (1 - share) - work * share


def unsure_change(mean: Any, force: Any) -> Any:
    """The most that a change to an unknown mean force, then to none, can be."""
    return larger(size(mean), size(mean - force) + size(force))


def spread_price(gain: Any, work: Any) -> Any:
    """What motors with different gains can give beyond motors with the same gain."""
    return gain * (sum(size(one) for one in work) - size(sum(work)))


def lagging_cost(before: Any, after: Any, damping: Any, duration: Any, lag: Any, left: Any) -> Any:
    """The cost of a hold that an amplifier approaches; ``left`` is the exponential."""
    once = lag * (1 - left)
    twice = lag * (1 - left * left) / 2
    at_end = after * (1 - left) + before * left
    square = after * after * (duration - 2 * once + twice)
    square = square + 2 * before * after * (once - twice) + before * before * twice
    return (square + lag * at_end * at_end / 2) / (4 * damping)
