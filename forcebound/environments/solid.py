"""Plane, sphere, box and cylinder, put together and cut out of each other."""

import math
from dataclasses import dataclass, field
from typing import Annotated, Literal

import numpy as np

from forcebound.environments import EnvironmentModel
from forcebound.environments.touching import OpenTouchable
from forcebound.errors import ConfigError
from forcebound.geometry import shapes
from forcebound.geometry.implicit import ImplicitSolid
from forcebound.geometry.proxy import Surface
from forcebound.geometry.vectors import Quaternion, Vector3, norm, rotate, unit_quaternion
from forcebound.messages.packets import SceneObject
from forcebound.quantities import (
    NOT_NEGATIVE,
    POSITIVE,
    Angle,
    Damping,
    Length,
    Ratio,
    Stiffness,
    check_ranges,
)

MOST = 64  # shapes: as many as a scene can show
TRIES = 2000  # points of each shape, of which one has to be left
KINDS = ("plane", "sphere", "box", "cylinder")  # in the order of the kernel's numbers
NEEDS = {"plane": set(), "sphere": {"radius"}, "box": {"size"}, "cylinder": {"radius", "length"}}


@dataclass(frozen=True)
class Shape:
    """One shape of a solid.

    Attributes:
        shape: Which one.
        position: Of its centre; of a plane any point of it.
        axis: Where its own z points: out of a plane, along a cylinder, across a box.
        turn: About its own z, before it is tilted to ``axis``.
        radius: Of a sphere or a cylinder.
        size: Edges of a box, along its own x, y and z.
        length: Of a cylinder.
        is_removed: Whether it is cut out of the shapes before it.
    """

    shape: Literal["plane", "sphere", "box", "cylinder"]
    position: tuple[Length, Length, Length] = (0.0, 0.0, 0.0)
    axis: tuple[Ratio, Ratio, Ratio] = (0.0, 0.0, 1.0)
    turn: Angle = 0.0
    radius: Annotated[Length, POSITIVE] | None = None
    size: tuple[Length, Length, Length] | None = None
    length: Annotated[Length, POSITIVE] | None = None
    is_removed: bool = False

    def __post_init__(self) -> None:
        check_ranges(self)
        if self.size is not None and min(self.size) <= 0.0:
            raise ConfigError(f"size must be > 0 m along each edge, got {self.size}", field="size")
        if norm(self.axis) == 0.0:
            raise ConfigError("axis must point somewhere, got 0, 0, 0", field="axis")
        given = {name for name in ("radius", "size", "length") if getattr(self, name) is not None}
        for name in sorted(NEEDS[self.shape] - given):
            raise ConfigError(f"a {self.shape} needs {name}", field="shape")
        for name in sorted(given - NEEDS[self.shape]):
            raise ConfigError(f"a {self.shape} has no {name}: leave it out", field=name)

    @property
    def orientation(self) -> Quaternion:
        """Rotation from the shape's own coordinates to the world's."""
        x, y, z = self.axis
        length = norm(self.axis)
        across = math.hypot(x, y)
        tilt = math.atan2(across, z) if length else 0.0
        u, v = (-y / across, x / across) if across > 0.0 else (1.0, 0.0)
        tilted = (math.cos(tilt / 2), u * math.sin(tilt / 2), v * math.sin(tilt / 2), 0.0)
        c, s = math.cos(self.turn / 2), math.sin(self.turn / 2)
        w, a, b, _ = tilted
        return unit_quaternion((w * c, a * c + b * s, b * c - a * s, w * s))

    @property
    def extent(self) -> Vector3:
        """Half its edges; of round shapes the radius first; as the kernel wants it."""
        if self.size is not None:
            return (self.size[0] / 2, self.size[1] / 2, self.size[2] / 2)
        return (self.radius or 0.0, (self.length or 0.0) / 2, 0.0)

    def row(self) -> list[float]:
        """Return the shape as a row of the kernel's table."""
        kind = float(KINDS.index(self.shape))
        return [kind, float(self.is_removed), *self.position, *self.orientation, *self.extent]


@dataclass(frozen=True)
class Solid(EnvironmentModel):
    """Shapes that the hand touches: spring, damper and surface around all of them together.

    Attributes:
        shapes: In their order: each is added to those before it, or cut out of them.
        stiffness: Of the spring between the device and the proxy.
        damping: Along the surface's normal; it pushes out and never pulls in.
        surface: How it feels.
    """

    shapes: tuple[Shape, ...] = (Shape("sphere", position=(0.05, 0.0, 0.0), radius=0.04),)
    stiffness: Annotated[Stiffness, NOT_NEGATIVE] = 1000.0
    damping: Annotated[Damping, NOT_NEGATIVE] = 0.0
    surface: Surface = field(default_factory=Surface)

    def __post_init__(self) -> None:
        check_ranges(self)
        if not 0 < len(self.shapes) <= MOST:
            raise ConfigError(
                f"shapes must list 1 to {MOST} shapes, got {len(self.shapes)}", field="shapes"
            )
        if not self._is_something():
            raise ConfigError(
                "nothing is left of the shapes: all that is added is removed again; a removed shape"
                " cuts those before it in the list only",
                field="shapes",
            )

    def _table(self) -> "np.ndarray[tuple[int, ...], np.dtype[np.float64]]":
        return np.array([shape.row() for shape in self.shapes])

    def _is_something(self) -> bool:
        """Whether one of many places within the shapes that were added is solid."""
        table = self._table()
        places = np.random.default_rng(1).uniform(-1.0, 1.0, (TRIES, 3))
        for shape in self.shapes:
            if shape.is_removed:
                continue
            radius, half = shape.extent[:2]
            reach = (radius, radius, half if shape.shape == "cylinder" else radius)
            ends = shape.extent if shape.shape == "box" else reach
            if shape.shape == "plane":
                ends = (1.0, 1.0, 1.0)  # m, near the point that it is given by
            for x, y, z in (places * np.array(ends)).tolist():
                inside = rotate(shape.orientation, (x, y, z))
                point = (
                    inside[0] + shape.position[0],
                    inside[1] + shape.position[1],
                    inside[2] + shape.position[2],
                )
                if shapes.distance(table, point) < 0.0:
                    return True
        return False

    def check_files(self) -> None:
        """Read what the surface names.

        Raises:
            ConfigError: If it will not do.
        """
        self.surface.check_files()

    def solid(self) -> ImplicitSolid:
        """Return what the proxy slides on."""
        return ImplicitSolid(shapes.SHAPES, self._table())

    def scene(self) -> tuple[SceneObject, ...]:
        """Return the shapes."""
        return tuple(
            SceneObject(
                name=f"{one.shape}_{number}",
                shape=one.shape,
                position=one.position,
                orientation=one.orientation,
                size=_scene_size(one),
                is_removed=one.is_removed,
            )
            for number, one in enumerate(self.shapes, start=1)
        )

    def open(self, axes: int) -> OpenTouchable:
        """Return a new instance; see :class:`forcebound.environments.EnvironmentModel`."""
        return OpenTouchable(self, axes)


def _scene_size(shape: Shape) -> tuple[float, ...]:
    if shape.size is not None:
        return shape.size
    return tuple(one for one in (shape.radius, shape.length) if one is not None)
