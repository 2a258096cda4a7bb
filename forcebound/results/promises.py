"""Promises of a device that a run shows to be broken: the certificate rests on them.

A force that acts later after its reading than ``device.write_delay`` is covered only if the ledger
had enough for it all the same (docs/theory.md, 3.1). Without a watchdog, one that lasts longer than
``device.watchdog_limit`` is covered by no certificate. A reading that
implies more than ``device.largest_speed`` is refused: that costs force, but nothing else. Holds
beyond the hold limit are priced, or dropped by the watchdog (docs/theory.md, 3.2): they break none.
"""

import math
from collections.abc import Iterator
from typing import TypedDict

import numpy as np

from forcebound.results.energy import Holds
from forcebound.results.samples import Samples, is_certified
from forcebound.results.surface import Floats, Mask
from forcebound.units import MM_S, in_unit

ROUNDING = 5e-10  # s; stamps are whole nanoseconds
LARGEST_SPEED = 3e8  # m/s; a recording may imply any
ROUNDED_UP = 1.005  # a number of three digits is then no less
COSTS_FORCE = "largest_speed"  # the promise that costs no more if it is broken
_WORDS = {
    "write_delay": (
        "forces acted later than",
        'state {path}:="{most}" (costs some stiffness), or make the bus faster',
    ),
    "watchdog_limit": (
        "forces lasted longer than",
        'state {path}:="{most}" (costs some stiffness), if nothing drops them then',
    ),
    COSTS_FORCE: (
        "readings were refused, since they imply more than",
        "that costs force; state more if the hand was so fast, else look at the encoder{unit}",
    ),
}
_UNIT = ", or at the unit: degrees taken as radians (positions: deg)"


class BrokenPromise(TypedDict):
    """A promise that a run breaks, ready for JSON."""

    promise: str  # a key of ``device``
    unit: str  # of the numbers
    stated: float
    count: int  # of values beyond that
    of: int  # so many
    typical: float  # of those beyond
    largest: float
    is_paid: bool  # the certificate covers the run all the same


def is_uncovered(broken: BrokenPromise) -> bool:
    """Whether no certificate covers a run that breaks a promise."""
    return not broken["is_paid"]


def broken_promises(run: Samples) -> list[BrokenPromise]:
    """Return the promises that a run breaks; none without a certified law."""
    if not run.time.size or not is_certified(run.device.law):
        return []
    return [
        {
            "promise": name,
            "unit": unit,
            "stated": stated,
            "count": int(beyond.sum()),
            "of": int(beyond.size),
            "typical": float(np.median(values[beyond])),
            "largest": float(values[beyond].max()),
            "is_paid": name == COSTS_FORCE or (name == "write_delay" and _is_paid(run)),
        }
        for name, unit, stated, values, beyond in _found(run.holds, run)
        if beyond.any()
    ]


def _is_paid(run: Samples) -> bool:
    """Whether the ledger had enough for each late write, but for the allowance that is stated."""
    return run.report is not None and run.report.largest_allowance <= run.device.allowance


def _found(holds: Holds, run: Samples) -> Iterator[tuple[str, str, float, Floats, Mask]]:
    """Yield a promise with its unit, what is stated, what was, and where that is beyond."""
    device, acts = run.device, np.asarray(holds.force.any(axis=1))
    matters = acts | np.concatenate((acts[:1], acts[:-1]))  # the force before lasts as long
    delay, stated = (holds.write - holds.read)[matters], device.write_delay
    yield "write_delay", "s", stated, delay, delay > stated + ROUNDING
    limit = device.watchdog_limit
    is_lost = any(event.event == "device_lost" for event in run.events)  # at zero then
    if device.watchdog == "none" and isinstance(limit, float) and not is_lost:
        lasted = np.diff(holds.write)[acts[:-1]]
        yield "watchdog_limit", "s", limit, lasted, lasted > limit + ROUNDING
    largest = device.largest_speed
    if largest is not None:
        ahead = np.maximum(run.run.ahead_ns[run.since], 0) * 1e-9
        speed = _refused_speeds(holds, holds.read + ahead, largest)
        unit = "rad/s" if run.is_arm else run.launched.shown(MM_S).si
        yield COSTS_FORCE, unit, largest, speed, speed > 0.0


def _refused_speeds(holds: Holds, time: Floats, largest: float) -> Floats:
    """Return the speeds that refused readings imply, in m/s, 0 of the others: as the bounder."""
    speed = np.zeros(holds.read.size)
    slack = float(np.linalg.norm(np.broadcast_to(holds.resolution, holds.reading.shape[1])))
    moves = np.linalg.norm(np.diff(holds.reading, axis=0), axis=1)
    taken = 0
    for k in range(1, speed.size if (moves > largest * np.diff(time) + slack).any() else 0):
        move, dt = math.dist(holds.reading[k], holds.reading[taken]), time[k] - time[taken]
        if move > largest * dt + slack:
            speed[k] = move / max(dt, ROUNDING)
        else:
            taken = k
    return np.minimum(speed, LARGEST_SPEED)


def in_words(broken: BrokenPromise) -> str:
    """Return a broken promise as a part of a sentence: how often, by how much, what to do."""
    what, remedy = _WORDS[broken["promise"]]
    if broken["is_paid"] and broken["promise"] == "write_delay":
        remedy = "the ledger had enough for each of them"
    doubt = _UNIT if broken["unit"] == "rad/s" else ""
    unit = "ms" if broken["unit"] == "s" else broken["unit"]
    most = broken["largest"]
    numbers = (broken["stated"], broken["typical"], most, ROUNDED_UP * most)
    stated, typical, largest, more = (in_unit(number, unit, 3) for number in numbers)
    counts = f"{broken['count']:,} of {broken['of']:,}"
    path = f"device.{broken['promise']}"
    return (
        f"{counts} {what} {path} ({stated}): typically {typical}, at most"
        f" {largest}; {remedy.format(most=more, path=path, unit=doubt)}"
    )
