"""The plane that the hand is shown: it follows the estimated one without giving energy.

A surface that comes towards the hand, or gets stiffer, would fill its spring out of nothing, and
the hand could take the energy out. So the shown plane takes direction, stiffness, damping and
friction of the estimated one at once, but only as much of its depth as a budget pays
(``docs/controllers.md``, "Changes give no energy"). Damping and friction only dissipate: the force
never pulls the hand in, and the spring of the friction gives way at its limit and is not filled
when it gets stiffer.

Source: a surface that appears where the hand is and then moves to its place: Mitra and Niemeyer,
Model-mediated telemanipulation, International Journal of Robotics Research 27(2), 2008. The budget
is ours.
"""

import math

from forcebound.haptics.controllers.plane import Plane, across, along, dot
from forcebound.messages.packets import Vector

MOST = 0.02  # J, of the budget: 6 N on a wall of 1 N/mm


class ShownPlane:
    """The shown part of a plane, whose changes may give at most ``power``, in W."""

    def __init__(self, power: float, axes: int) -> None:
        self._power = power
        self._zero: Vector = (0.0,) * axes
        self._budget = 0.0  # J
        self._plane: Plane | None = None  # shown last, at its own offset
        self._position = self._zero  # then, m
        self._stretch = self._zero  # of the spring along the surface, m

    def forget(self) -> None:
        """Show no plane; what it has stored is lost."""
        self._plane, self._stretch = None, self._zero

    def force(self, plane: Plane, position: Vector, velocity: Vector, dt: float) -> Vector:
        """Return the force at a new position, in N, ``dt`` s after the position before."""
        place = dot(position, plane.inwards)
        depth = self._depth(plane, position, dt)
        pressed = 0.0
        if depth > 0.0:
            damping = plane.damping * dot(velocity, plane.inwards)
            pressed = max(plane.stiffness * depth + damping, 0.0)
        friction = self._friction(plane, position, pressed)
        self._plane = plane.at(place - depth if depth > 0.0 else max(plane.offset, place))
        self._position = position
        return along(friction, plane.inwards, pressed)

    def _depth(self, plane: Plane, position: Vector, dt: float) -> float:
        """As much of the depth as the budget pays, in m."""
        stored = 0.0
        if self._plane is not None:
            stored = self._plane.energy(position)
        self._budget = min(self._budget + self._power * dt, MOST)
        affordable = math.sqrt(2.0 * (stored + self._budget) / plane.stiffness)
        depth = min(max(plane.depth(position), 0.0), affordable)
        spent = 0.5 * plane.stiffness * depth**2 - stored
        self._budget = min(max(self._budget - spent, 0.0), MOST)
        return depth

    def _friction(self, plane: Plane, position: Vector, pressed: float) -> Vector:
        """The force of a spring along the surface that gives way at the limit of friction, in N."""
        most = plane.friction * pressed
        if most == 0.0 or self._plane is None:
            self._stretch = self._zero
            return self._zero
        kept = min(1.0, math.sqrt(self._plane.stiffness / plane.stiffness))
        moved = along(position, self._position, -1.0)
        stretch = across(along(moved, self._stretch, kept), plane.inwards)
        length = math.hypot(*stretch)
        if length * plane.stiffness > most:
            stretch = tuple([s * most / (length * plane.stiffness) for s in stretch])
        self._stretch = stretch
        return tuple([plane.stiffness * s for s in stretch])
