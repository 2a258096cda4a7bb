"""Contract of every bounding law, and its check.

Whether a law is passive is not asked here: :mod:`forcebound.lab` does that.
"""

import math
from collections.abc import Iterator
from random import Random

from forcebound.haptics.laws import LAWS, Dissipation, ForceBounder
from forcebound.haptics.parts.contract import Findings, Report
from forcebound.messages.packets import Vector

PROMISES: dict[str, str] = {
    "answers": "takes every sample: finite readings, forces and times",
    "bounded": "no force above the commanded one and the saturation, none that opposes it"
    " (a law that adds damping: none above the saturation)",
    "pure": "the same samples, in the same order from the start on, have the same forces",
    "summary": "has a summary of one line",
}

DEVICE = Dissipation(
    damping=0.27, friction=0.12, resolution=3e-5, period=1e-3, hold_limit=1.25e-3, saturation=8.5
)  # of the PHANToM


def check(law: str, seed: int = 1, samples: int = 2000) -> Report:
    """Return which of the ``PROMISES`` a law of :data:`LAWS` keeps, in walks of so many samples."""
    found = Findings()
    summary = LAWS[law].summary
    if not summary or "\n" in summary:
        found.add("summary", "one line", repr(summary), "summary")
    for axes in (1, 3):
        where = f"a random walk, axes: {axes}"
        with found.noting("answers", "a force", where):
            one, other = (list(_walk(law, axes, Random(seed), samples, found)) for _ in range(2))
            found.check_repeats(one, other, where)
        if found.is_broken("answers"):  # what does not compile for one axis does not for three
            return found.report(PROMISES, 4 * samples, unseen=("bounded", "pure"))
    return found.report(PROMISES, 4 * samples)


def _walk(law: str, axes: int, random: Random, samples: int, found: Findings) -> Iterator[Vector]:
    """The forces of a walk of a hand that begins, turns and stops."""
    bounder = ForceBounder(law, DEVICE, axes)
    adds_damping = LAWS[law].adds_damping
    position, time_ns = [0.0] * axes, 0
    bounder.start(time_ns, tuple(position))
    for sample in range(samples):
        time_ns += random.choice((1_000_000, 1_000_000, 1_100_000, 3_000_000))
        speed = random.choice((0.0, 1e-5, 3e-4))
        position = [x + random.gauss(0.0, speed) for x in position]
        readings = tuple(
            round(x / DEVICE.coarsest_resolution) * DEVICE.coarsest_resolution for x in position
        )
        scale = random.choice((0.0, 0.1, 5.0, 100.0))
        commanded = tuple(random.uniform(-scale, scale) for _ in range(axes))
        force = bounder.bound(time_ns, readings, commanded)
        fault = _fault(force, commanded, adds_damping)
        if fault is not None:
            found.add("bounded", fault, repr(force), f"sample {sample}: {commanded}")
        bounder.settle(force)
        yield force


def _fault(force: Vector, commanded: Vector, adds_damping: bool) -> str | None:
    size = math.hypot(*force)
    if not size <= DEVICE.saturation * (1 + 1e-12):
        return f"at most {DEVICE.saturation} N"
    if adds_damping:
        return None
    if size > math.hypot(*commanded) * (1 + 1e-12):
        return f"at most {math.hypot(*commanded)} N"
    if any(f * c < 0.0 for f, c in zip(force, commanded, strict=True)):
        return "a force in the direction of the commanded one"
    return None
