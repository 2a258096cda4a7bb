"""Solids that are described by a distance: the proxy on them.

A *field* is a pair of compiled functions of some data and a point: the distance to the surface
(negative inside, nowhere more than the true one), and its gradient. The proxy is moved in rounds.
In each it sees the solid as the plane that the field has where the proxy is, and marches towards
the closest place behind no plane; what it runs into on the way becomes another plane, until nothing
is in the way. So in a corner of two solids both hold it. Marching goes in steps of the distance,
which nothing can hide in (sphere tracing: J. C. Hart, The Visual Computer 12, 1996), and dips a
little below a hollow surface; the rounds bring it up again.
"""

from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from forcebound.compiled import jit, outlined
from forcebound.haptics.geometry.planes import closest_legal
from forcebound.haptics.geometry.vectors import Vector3, add, along, dot, norm, scale, sub, unit

Data: TypeAlias = Any  # what a field's functions know of the solid
Distance: TypeAlias = Callable[[Data, Vector3], float]
Gradient: TypeAlias = Callable[[Data, Vector3], Vector3]

DIP = 2e-5  # m, how deep a march may go below a hollow surface; thinner than two is not felt
STEPS = 512  # of a march at most along surfaces: a longer way has longer steps
CUTS = 8  # planes of one round
ROUNDS = 30  # from then on, one without gain is the last
STEPS_IN_ALL = 2000  # of the marches of one answer
LEGAL = 1e-9  # m, depth that counts as none
STILL = 5e-6  # dips; a move that counts as none


class Field(NamedTuple):
    """The functions of a solid; compiled into the kernels that move its proxy."""

    distance: Distance
    gradient: Gradient  # exactly that of the distance, or the proxy jams
    shading: Gradient  # smoothed, where the other one jumps


def _march_of(distance: Distance) -> Any:
    """Return the straight move of a proxy on a field."""

    def narrow(data: Data, outside: Vector3, inside: Vector3, dip: float) -> Vector3:
        """A place between two that is not much deeper behind the surface than a march may be.

        Its plane gives the place of the surface. On a hollow one it has to be on the way ahead,
        thus not at the very surface, which the way leaves already where it begins.
        """
        for _ in range(12):
            middle = scale(add(outside, inside), 0.5)
            free = distance(data, middle)
            if free < -dip:
                inside = middle
            elif free < -0.25 * dip:
                return middle
            else:
                outside = middle
        return inside

    @outlined
    def march(
        data: Data, start: Vector3, end: Vector3, dip: float
    ) -> tuple[bool, Vector3, Vector3, float, int]:
        """Return whether an obstacle is hit, the last legal place, the obstacle, its distance.

        Last, the number of steps.
        """
        move = sub(end, start)
        length = norm(move)
        direction = scale(move, 1.0 / length) if length > 0.0 else move
        smallest = max(dip, length / STEPS)
        gone, here, legal, steps = 0.0, start, start, 0
        while True:
            free = distance(data, here)
            steps += 1
            if free < -dip:
                return True, legal, narrow(data, legal, here, dip), free, steps
            if free >= -LEGAL:
                legal = here
            if not gone < length:
                return False, end, end, free, steps
            gone = min(gone + max(free, smallest), length)
            here = along(start, direction, gone) if gone < length else end

    return march


def _add_plane_of(field: Field) -> Callable[[Data, Any, int, Vector3], None]:
    """Return what sees a field as a plane."""
    distance, gradient, _ = field

    @outlined
    def add_plane(data: Data, planes: Any, count: int, point: Vector3) -> None:
        """Set row ``count`` to the plane of the field at a point."""
        slope = gradient(data, point)
        steepness = norm(slope)
        normal = scale(slope, 1.0 / steepness) if steepness > 0.0 else (0.0, 0.0, 0.0)
        away = distance(data, point) / steepness if steepness > 0.0 else 0.0
        planes[count, 0], planes[count, 1], planes[count, 2] = normal
        planes[count, 3] = dot(normal, point) - away

    return add_plane


def _surfacing_of(field: Field) -> Callable[[Data, Vector3], tuple[bool, Vector3]]:
    """Return Newton's steps to the surface."""
    distance, gradient, _ = field

    def surface(data: Data, point: Vector3) -> tuple[bool, Vector3]:
        """Bring a point to the surface, at most ``LEGAL`` outside; whether that was possible."""
        for _ in range(20):
            away = distance(data, point)
            if abs(away - 0.5 * LEGAL) <= 0.5 * LEGAL:
                return True, point
            slope = gradient(data, point)
            square = max(dot(slope, slope), 1e-12)
            point = along(point, slope, (0.5 * LEGAL - away) / square)
        return False, point

    return surface


@cache
def slide_of(field: Field) -> Any:
    """Return the compiled move of a proxy on a field; see :class:`ImplicitSolid`."""
    distance, march = field.distance, _march_of(field.distance)
    add_plane, surface = _add_plane_of(field), _surfacing_of(field)

    def slide(
        data: Data, proxy: Vector3, goal: Vector3, dip: float, still: float, most: int
    ) -> tuple[bool, Vector3, Vector3]:
        planes = np.empty((CUTS, 4))
        place, before, target = proxy, proxy, goal
        count, steps, rounds, best = 0, 0, 0, np.inf
        while steps < most:
            is_blocked, place, obstacle, free, taken = march(data, place, target, dip)
            if not is_blocked:
                if steps == 0 and free >= 0.0:
                    return False, goal, (0.0, 0.0, 0.0)
                depth = norm(sub(place, goal)) + 2.0 * max(-free, 0.0)
                move = norm(sub(place, before))
                if depth < best:  # arrived: the solid is seen again from here
                    rounds += 1
                    is_last = rounds > ROUNDS and best - depth < LEGAL
                    before, best, count = place, depth, 0
                    if is_last or (free >= -LEGAL and move < still):
                        break
                else:  # too far: what is there holds the proxy, too
                    place = before
                    if move < still or count == CUTS:
                        break
            elif count == CUTS:
                count = 0
            steps += taken
            add_plane(data, planes, count, obstacle)
            count += 1
            found, target = closest_legal(goal, planes, count, 1e-12)
            if not found:
                break
        if distance(data, place) < -LEGAL:
            is_legal, place = surface(data, place)
            if not is_legal:
                place = proxy
        return norm(sub(place, goal)) > LEGAL, place, unit(sub(place, goal))

    return jit(slide)


@cache
def closest_of(field: Field) -> Any:
    """Return the compiled search of a field's closest point of the surface, and its normal."""
    surface, gradient = _surfacing_of(field), field.gradient

    def closest(data: Data, point: Vector3) -> tuple[Vector3, Vector3]:
        _, place = surface(data, point)
        return place, unit(gradient(data, place))

    return jit(closest)


class ImplicitSolid:
    """A solid of a field and its data, compiled when it is made: a :class:`.proxy.Solid`.

    A move may ``dip`` (m) below a hollow surface; what is thinner than twice as much is not felt.
    Larger is faster. A move by ``still`` dips counts as none. One move may ask for so many
    distances (``steps``); what is left is done in the next.
    """

    def __init__(
        self,
        field: Field,
        data: Data,
        dip: float = DIP,
        still: float = STILL,
        steps: int = STEPS_IN_ALL,
    ) -> None:
        self._limits = dip, still * dip, steps
        self._data = data
        self._slide, self._closest = slide_of(field), closest_of(field)
        self._distance, self._shading = jit(field.distance), jit(field.shading)
        origin = (0.0, 0.0, 0.0)
        self._slide(data, origin, origin, *self._limits)
        self._closest(data, origin)
        self.shade(origin, origin)
        self.distance(origin)

    def slide(self, proxy: Vector3, goal: Vector3) -> tuple[Vector3, Vector3 | None]:
        is_touching, place, normal = self._slide(self._data, proxy, goal, *self._limits)
        return (place, normal) if is_touching else (goal, None)

    def distance(self, point: Vector3) -> float:
        return self._distance(self._data, point)

    def closest(self, point: Vector3) -> tuple[Vector3, Vector3]:
        place, normal = self._closest(self._data, point)
        return place, normal

    def shade(self, point: Vector3, normal: Vector3) -> Vector3:
        """Return the direction of the field's smoothed gradient."""
        return unit(self._shading(self._data, point))
