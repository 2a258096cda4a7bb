"""A world of my own in three dimensions: a ball that cannot be pushed through, drawn and told.

Copy this file, change it, and check it:

    forcebound check environment my_world.py
    forcebound simulate my_world.yaml

docs/write-your-own-environment.md explains `contact` and `scene`; docs/worlds.md the proxy.
"""

import math
from dataclasses import dataclass
from typing import Annotated

from forcebound.haptics.environments import Environment, EnvironmentModel
from forcebound.haptics.geometry.vectors import (
    Vector3,
    along,
    cut,
    dot,
    norm,
    pad3,
    scale,
    sub,
    unit,
)
from forcebound.messages.packets import Contact, SceneObject, Vector
from forcebound.quantities import POSITIVE, Length, Stiffness


@dataclass(frozen=True)
class Ball(EnvironmentModel):
    """A ball in space, whatever the number of axes of the device."""

    stiffness: Annotated[Stiffness, POSITIVE] = 2_000.0  # N/m
    radius: Annotated[Length, POSITIVE] = 0.010  # m
    x: Length = 0.020  # m, of the centre
    y: Length = 0.0
    z: Length = 0.0

    def open(self, axes: int) -> "TouchedBall":
        """Return the ball, untouched."""
        return TouchedBall(self, axes)


class TouchedBall(Environment):
    """The ball and the proxy on it, from open to close."""

    def __init__(self, model: Ball, axes: int) -> None:
        self.axes = axes
        self.touched: tuple[Vector3, Vector3] | None = None  # proxy and outward normal
        self.change(model)

    def change(self, model: Ball) -> bool:
        """Take other parameters over; the proxy stays where it is on the ball."""
        self.model = model
        self.centre = (model.x, model.y, model.z)
        return True

    def force(self, user: str, position: Vector, velocity: Vector, elapsed: float) -> Vector:
        """Return the force of the spring from the proxy to the tip, F = k (x - p), in N."""
        tip = pad3(position)
        offset = sub(tip, self.centre)
        normal = self.normal(offset)
        proxy = along(self.centre, normal, self.model.radius)
        if not dot(sub(tip, proxy), normal) < 0.0:  # on the free side
            self.touched = None
            return (0.0,) * self.axes
        self.touched = proxy, normal
        return cut(scale(sub(tip, proxy), self.model.stiffness), self.axes)

    def normal(self, offset: Vector3) -> Vector3:
        """Return the way out. Beyond the centre it stays: a deep push does not pop through."""
        if self.touched is not None and dot(offset, self.touched[1]) <= 0.0:
            return self.touched[1]
        return unit(offset) if 0.0 < norm(offset) < math.inf else (-1.0, 0.0, 0.0)

    def contact(self, user: str) -> Contact | None:
        """Return what the last question touched; None: free motion."""
        if self.touched is None:
            return None
        proxy, normal = self.touched
        return Contact(cut(proxy, self.axes), cut(normal, self.axes))

    def scene(self) -> tuple[SceneObject, ...]:
        """Return what there is to draw."""
        return (SceneObject("ball", "sphere", self.centre, size=(self.model.radius,)),)
