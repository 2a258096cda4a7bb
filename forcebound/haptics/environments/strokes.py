"""Questions along strokes of a tip: from outside to the middle of what is drawn, and then across.

Questions at random rarely touch a ball in space, and never slide along it. These do. Presses go
inwards alone, at rest, while time stands still: what they find is a matter of the place.
"""

import itertools
from collections.abc import Iterator, Sequence
from random import Random
from typing import NamedTuple

from forcebound.haptics.environments import FAR
from forcebound.haptics.geometry.vectors import (
    ZERO,
    Vector3,
    add,
    along,
    cut,
    norm,
    rotate,
    scale,
    tangential,
    unit,
)
from forcebound.messages.packets import SceneObject, Vector

INWARDS, ACROSS = 40, 20  # questions of a stroke
CLEARANCE = 0.01  # m, from what is drawn to the beginning of a stroke
UNKNOWN = 0.03  # m, half the size of what is only in a file
THIN = 0.01  # m, how deep a stroke goes beyond a plane or path
PERIOD = 1e-3  # s, between two questions
BEFORE, NEAR, STEP, GROWTH = 0.02, 0.05, 5e-4, 1.5  # m, m, m, 1: presses have steps, then grow


class Question(NamedTuple):
    """One question to an environment."""

    position: Vector  # m
    velocity: Vector  # m/s
    elapsed: float  # s

    def __str__(self) -> str:
        return f"force('', {self.position}, {self.velocity}, {self.elapsed})"


def strokes(objects: Sequence[SceneObject], axes: int, count: int) -> Iterator[list[Question]]:
    """Return ``count`` strokes towards the objects in turn, the same each time; none of none."""
    random = Random(axes)
    for number, target in zip(range(count), itertools.cycle(objects), strict=False):
        half = _half_size(target)
        place = target.position
        if target.points:
            place = add(place, rotate(target.orientation, random.choice(target.points)))
        x, y, z = (random.uniform(-0.5, 0.5) * half for _ in range(3))
        aim = add(place, rotate(target.orientation, (x, y, z)))
        inwards, sideways = _direction(axes, random), _direction(axes, random)
        reach = half + CLEARANCE
        velocity = scale(inwards, reach / INWARDS / PERIOD)
        slow = scale(
            unit(tangential(sideways, inwards)) if axes > 1 else ZERO, 0.25 * norm(velocity)
        )
        tips = [(along(aim, inwards, reach * (k / INWARDS - 1)), velocity) for k in range(INWARDS)]
        tips += [(along(aim, slow, PERIOD * k), slow) for k in range(ACROSS + 1)]
        yield [
            Question(cut(position, axes), cut(speed, axes), number + PERIOD * step)
            for step, (position, speed) in enumerate(tips)
        ]


def presses(objects: Sequence[SceneObject], axes: int, count: int) -> list[list[Question]]:
    """Return presses along the axes in space, either way, up to ``FAR``; ``count`` to objects."""
    steps = [STEP * k for k in range(round(-BEFORE / STEP), round(NEAR / STEP) + 1)]
    while steps[-1] < FAR:
        steps.append(min(steps[-1] * GROWTH, FAR))
    still = (0.0,) * axes
    found = [
        [Question((*still[:axis], sign * step, *still[axis + 1 :]), still, 1.0) for step in steps]
        for axis, sign in itertools.product(range(min(axes, 3)), (1.0, -1.0))
    ]
    for stroke in strokes(objects, axes, count):
        found.append([Question(question.position, still, 1.0) for question in stroke[:INWARDS]])
    return found


def _half_size(target: SceneObject) -> float:
    """About how far from its middle an object reaches, in m."""
    if target.shape in ("mesh", "points"):
        return UNKNOWN
    edges = [2.0 * one for one in target.size[:1]] + [*target.size[1:]]  # the first is a radius
    return 0.5 * max(target.size if target.shape == "box" else edges, default=2.0 * THIN)


def _direction(axes: int, random: Random) -> Vector3:
    """A direction that a device of so many axes can go."""
    x, y, z = (random.gauss(0.0, 1.0) if axis < axes else 0.0 for axis in range(3))
    return unit((x, y, z))
