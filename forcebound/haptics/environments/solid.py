"""Plane, sphere, box and cylinder, put together and cut out of each other."""

import math
from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np

from forcebound.errors import ConfigError
from forcebound.haptics.environments.touching import Touchable
from forcebound.haptics.geometry import shapes
from forcebound.haptics.geometry.implicit import ImplicitSolid
from forcebound.haptics.geometry.vectors import (
    Quaternion,
    Vector3,
    norm,
    unit,
    unit_quaternion,
    z_onto,
)
from forcebound.messages.packets import SceneObject
from forcebound.quantities import (
    POSITIVE,
    Angle,
    Length,
    Ratio,
    check_ranges,
)

MOST = 64  # shapes: as many as a scene can show
KINDS = ("plane", "sphere", "box", "cylinder")  # in the order of the kernel's numbers
NEEDS = {"plane": set(), "sphere": {"radius"}, "box": {"size"}, "cylinder": {"radius", "length"}}


@dataclass(frozen=True)
class Shape:
    """One shape of a solid.

    Attributes:
        shape: Which one.
        position: Of its centre; of a plane any point of it.
        axis: Direction of its z axis: out of a plane, along a cylinder, across a box.
        turn: About its z axis, before it is tilted to ``axis``.
        radius: Of a sphere or a cylinder.
        size: Edges of a box, along its x, y and z axes.
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
        """Rotation from the shape's coordinates to the world's."""
        w, x, y, _ = z_onto(unit(self.axis))
        c, s = math.cos(self.turn / 2), math.sin(self.turn / 2)
        return unit_quaternion((w * c, x * c + y * s, y * c - x * s, w * s))

    @property
    def extent(self) -> Vector3:
        """Half its edges; of round shapes the radius first; as the kernel takes it."""
        if self.size is not None:
            return (self.size[0] / 2, self.size[1] / 2, self.size[2] / 2)
        return (self.radius or 0.0, (self.length or 0.0) / 2, 0.0)

    @property
    def scene_size(self) -> tuple[float, ...]:
        """The size of an object of a scene."""
        if self.size is not None:
            return self.size
        return tuple(one for one in (self.radius, self.length) if one is not None)

    def row(self) -> list[float]:
        """Return the shape as a row of the kernel's table."""
        kind = float(KINDS.index(self.shape))
        return [kind, float(self.is_removed), *self.position, *self.orientation, *self.extent]


@dataclass(frozen=True)
class Solid(Touchable):
    """Shapes that the hand touches: spring, damper and surface around all of them together.

    Attributes:
        shapes: In their order: each is added to those before it, or cut out of them.
    """

    shapes: tuple[Shape, ...] = (Shape("sphere", position=(0.05, 0.0, 0.0), radius=0.04),)

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0 < len(self.shapes) <= MOST:
            raise ConfigError(
                f"shapes must list 1 to {MOST} shapes, got {len(self.shapes)}", field="shapes"
            )
        if self.shapes[0].is_removed:
            raise ConfigError(
                "the first of the shapes is removed from nothing: a removed shape cuts those before"
                " it in the list only",
                field="shapes",
            )

    def solid(self) -> ImplicitSolid:
        table = np.array([shape.row() for shape in self.shapes])
        return ImplicitSolid(shapes.SHAPES, table)

    def scene(self) -> tuple[SceneObject, ...]:
        return tuple(
            SceneObject(
                name=f"{one.shape}_{number}",
                shape=one.shape,
                position=one.position,
                orientation=one.orientation,
                size=one.scene_size,
                is_removed=one.is_removed,
            )
            for number, one in enumerate(self.shapes, start=1)
        )
