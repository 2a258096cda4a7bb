"""Virtual fixtures: guidance and limits that may stand beside any environment.

Their forces are added to that of the environment. Each is the gradient of a potential (plus a
damping that only resists), so that without delay no fixture gives energy; the bounder at the
device guards them like any other force. Missing coordinates of a position are zero.

Source: L. B. Rosenberg, Virtual fixtures, IEEE VRAIS 1993; J. J. Abbott, P. Marayong, A. M.
Okamura, Haptic virtual fixtures for robot-assisted manipulation, ISRR 2005.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from typing import Annotated, Any, ClassVar, TypeAlias

from forcebound.errors import ConfigError
from forcebound.haptics.environments import (
    Environment,
    EnvironmentModel,
    change_environment,
    check_hand,
    open_environment,
)
from forcebound.haptics.geometry.triangles import closest_on_segment
from forcebound.haptics.geometry.vectors import (
    Vector3,
    add,
    cut,
    dot,
    norm,
    pad3,
    scale,
    sub,
    unit,
    z_onto,
)
from forcebound.haptics.parts.signals import Signal
from forcebound.messages.packets import Contact, SceneObject, Vector
from forcebound.messages.topology import HAND
from forcebound.quantities import (
    NOT_NEGATIVE,
    POSITIVE,
    Damping,
    Length,
    Speed,
    Stiffness,
    check_ranges,
)

Point: TypeAlias = tuple[Length, ...]  # 1 to 3 numbers
MOST_POINTS = 64  # of a path: so many can be drawn


def pull(offset: Vector3, stiffness: float, reach: float) -> Vector3:
    """Return the force of a guidance at an offset (m) from it: a spring that lets go.

    ``F = k d (1 - (d / reach)^2)^2`` within its reach, 0 beyond: the gradient of
    ``k reach^2 (1 - (1 - (d / reach)^2)^3) / 6``.
    """
    share = 1.0 - min(norm(offset) / reach, 1.0) ** 2
    return scale(offset, stiffness * share * share)


def _expect(is_sound: bool, field: str, expected: str, got: object) -> None:
    if not is_sound:
        raise ConfigError(f"{field}: expected {expected}, got {got}", field=field)


@dataclass(frozen=True, kw_only=True)
class _Fixture(ABC):
    places: ClassVar[tuple[str, ...]] = ()  # fields that are places

    def __post_init__(self) -> None:
        check_ranges(self)
        for name in self.places:
            count = len(getattr(self, name))
            _expect(1 <= count <= 3, name, "1 to 3 numbers", count)

    @abstractmethod
    def force(self, position: Vector3, velocity: Vector3) -> Vector3:
        """Return the force, in N, at a position (m) and velocity (m/s)."""

    @abstractmethod
    def drawn(self, name: str) -> SceneObject | None:
        """Return what there is to draw, if there is anything."""


@dataclass(frozen=True, kw_only=True)
class _Guidance(_Fixture):
    stiffness: Annotated[Stiffness, NOT_NEGATIVE] = 500.0
    reach: Annotated[Length, POSITIVE] = 0.020


@dataclass(frozen=True, kw_only=True)
class GuidancePlane(_Guidance):
    """A plane that the hand is drawn to.

    Attributes:
        point: On the plane.
        normal: Across it, of any length but 0.
        stiffness: Near the plane.
        reach: Distance at which it lets go.
    """

    places: ClassVar[tuple[str, ...]] = ("point", "normal")
    point: Point = (0.0, 0.0, 0.0)
    normal: tuple[float, ...] = (0.0, 0.0, 1.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        _expect(any(self.normal), "normal", "a direction", list(self.normal))

    @property
    def unit_normal(self) -> Vector3:
        """The normal, of length 1."""
        return unit(pad3(self.normal))

    def force(self, position: Vector3, velocity: Vector3) -> Vector3:
        normal = self.unit_normal
        offset = scale(normal, dot(sub(position, pad3(self.point)), normal))
        return pull(offset, self.stiffness, self.reach)

    def drawn(self, name: str) -> SceneObject:
        turned = z_onto(self.unit_normal)
        return SceneObject(name, "plane", position=pad3(self.point), orientation=turned)


@dataclass(frozen=True, kw_only=True)
class GuidancePath(_Guidance):
    """A path that the hand is drawn to, straight from point to point.

    Attributes:
        points: Of the path, 2 to 64.
        stiffness: Near the path.
        reach: Distance at which it lets go.
    """

    points: tuple[Point, ...]

    def __post_init__(self) -> None:
        super().__post_init__()
        count = len(self.points)
        _expect(2 <= count <= MOST_POINTS, "points", f"2 to {MOST_POINTS}", count)
        for point in self.points:
            _expect(1 <= len(point) <= 3, "points", "1 to 3 numbers of each", len(point))

    def closest(self, position: Vector3) -> Vector3:
        """Return the point of the path that is closest to a position, in m."""
        corners = [pad3(point) for point in self.points]
        found = [closest_on_segment(position, a, b) for a, b in pairwise(corners)]
        return min(found, key=lambda point: norm(sub(position, point)))

    def force(self, position: Vector3, velocity: Vector3) -> Vector3:
        return pull(sub(position, self.closest(position)), self.stiffness, self.reach)

    def drawn(self, name: str) -> SceneObject:
        return SceneObject(name, "path", points=tuple(map(pad3, self.points)))


@dataclass(frozen=True, kw_only=True)
class ForbiddenRegion(_Fixture):
    """A box or a sphere that pushes the hand out by the nearest way.

    It remembers nothing, so a hand that is pushed past its middle comes out on the other side. What
    nobody may pass is the environment ``solid``.

    Attributes:
        centre: Of the box or sphere.
        size: Edges of a box along the axes; null: it is a sphere.
        radius: Of a sphere; null: it is a box.
        stiffness: Of its skin.
    """

    places: ClassVar[tuple[str, ...]] = ("centre",)

    centre: Point
    size: tuple[Annotated[Length, POSITIVE], ...] | None = None
    radius: Annotated[Length, POSITIVE] | None = None
    stiffness: Annotated[Stiffness, NOT_NEGATIVE] = 1000.0

    def __post_init__(self) -> None:
        super().__post_init__()
        if (self.size is None) == (self.radius is None):
            raise ConfigError("a forbidden region needs size (a box) or radius (a sphere)")
        if self.size is not None:
            _expect(len(self.size) == 3, "size", "three edges in m", len(self.size))

    def force(self, position: Vector3, velocity: Vector3) -> Vector3:
        return scale(self._penetration(sub(position, pad3(self.centre))), self.stiffness)

    def _penetration(self, offset: Vector3) -> Vector3:
        """The vector from the nearest point of the skin to an offset inside; 0 outside."""
        if self.radius is not None:
            depth = self.radius - norm(offset)
            out = unit(offset) if any(offset) else (1.0, 0.0, 0.0)
            return scale(out, -max(depth, 0.0))
        assert self.size is not None  # __post_init__
        depths = [0.5 * edge - abs(x) for edge, x in zip(self.size, offset, strict=True)]
        shallowest = max(min(depths), 0.0)
        inwards = [0.0, 0.0, 0.0]
        axis = depths.index(min(depths))
        inwards[axis] = -math.copysign(shallowest, offset[axis])
        return (inwards[0], inwards[1], inwards[2])

    def drawn(self, name: str) -> SceneObject:
        centre = pad3(self.centre)
        if self.radius is not None:
            return SceneObject(name, "sphere", position=centre, size=(self.radius,))
        return SceneObject(name, "box", position=centre, size=self.size or ())


@dataclass(frozen=True, kw_only=True)
class WorkspaceLimit(_Fixture):
    """A soft wall at the ends of a workspace: a box that the hand is kept in.

    Attributes:
        low: Lowest position on each axis; axes without an entry have no limit.
        high: Highest position on each axis.
        stiffness: Of the wall.
        damping: Against motion outwards, beyond the limit.
    """

    places: ClassVar[tuple[str, ...]] = ("low", "high")

    low: Point
    high: Point
    stiffness: Annotated[Stiffness, NOT_NEGATIVE] = 1000.0
    damping: Annotated[Damping, NOT_NEGATIVE] = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        count = len(self.low)
        _expect(len(self.high) == count, "high", f"{count} entries, as low", len(self.high))
        for low, high in zip(self.low, self.high, strict=True):
            _expect(low < high, "low", "less than high", f"{low:g} m and {high:g} m")

    def force(self, position: Vector3, velocity: Vector3) -> Vector3:
        forces = [0.0, 0.0, 0.0]
        for axis, (low, high) in enumerate(zip(self.low, self.high, strict=True)):
            if not low <= position[axis] <= high:
                beyond = position[axis] - min(max(position[axis], low), high)
                out = math.copysign(1.0, beyond)
                speed = max(0.0, out * velocity[axis])
                forces[axis] = self.stiffness * beyond + out * self.damping * speed
        return (forces[0], forces[1], forces[2])

    def drawn(self, name: str) -> SceneObject:
        low, high = pad3(self.low), pad3(self.high)
        return SceneObject(
            name, "box", position=scale(add(low, high), 0.5), size=sub(high, low), is_removed=True
        )


@dataclass(frozen=True, kw_only=True)
class SpeedLimit(_Fixture):
    """A damper on the part of a hand's speed that is above a limit.

    Attributes:
        limit: Up to this speed there is no force.
        damping: Force for the speed beyond it.
    """

    limit: Annotated[Speed, POSITIVE]
    damping: Annotated[Damping, NOT_NEGATIVE] = 5.0

    def force(self, position: Vector3, velocity: Vector3) -> Vector3:
        beyond = norm(velocity) - self.limit
        return scale(unit(velocity), self.damping * beyond) if beyond > 0.0 else (0.0, 0.0, 0.0)

    def drawn(self, name: str) -> None:
        """Return None: a speed is at no place."""


@dataclass(frozen=True, kw_only=True)
class HandFixtures:
    """Virtual fixtures of a hand; what is null is not there.

    Attributes:
        plane: The hand is drawn to it.
        path: The hand is drawn to it.
        workspace: The hand is kept in it.
        forbidden: The hand is kept out of these.
        speed: The hand is slowed down beyond it.
    """

    plane: GuidancePlane | None = None
    path: GuidancePath | None = None
    workspace: WorkspaceLimit | None = None
    forbidden: tuple[ForbiddenRegion, ...] = ()
    speed: SpeedLimit | None = None

    def force(self, position: Vector3, velocity: Vector3) -> Vector3:
        """Return the sum of their forces, in N, at a position (m) and velocity (m/s)."""
        total = (0.0, 0.0, 0.0)
        for fixture in self._named.values():
            total = add(total, fixture.force(position, velocity))
        return total

    def scene(self, hand: str = HAND) -> tuple[SceneObject, ...]:
        """Return what there is to draw, under names that begin with that of a hand."""
        whose = "" if hand == HAND else f"{hand} "
        return tuple(filter(None, [one.drawn(f"{whose}{k}") for k, one in self._named.items()]))

    @cached_property
    def _named(self) -> dict[str, _Fixture]:
        named = {
            "guidance plane": self.plane,
            "guidance path": self.path,
            "workspace limit": self.workspace,
            "speed limit": self.speed,
            **{f"forbidden {i}": region for i, region in enumerate(self.forbidden, 1)},
        }
        return {name: fixture for name, fixture in named.items() if fixture is not None}


@dataclass(frozen=True, kw_only=True)
class Fixtures(HandFixtures):
    """Virtual fixtures beside an environment, for all hands alike; what is null is not there.

    Attributes:
        hands: More of them for some hands alone, by their names.
    """

    hands: Mapping[str, HandFixtures] = field(default_factory=dict, hash=False)

    def on(self, hand: str, position: Vector3, velocity: Vector3) -> Vector3:
        """Return the force on a hand, in N, at a position (m) and velocity (m/s)."""
        force, of_hand = self.force(position, velocity), self.hands.get(hand)
        return force if of_hand is None else add(force, of_hand.force(position, velocity))

    def drawn(self) -> tuple[SceneObject, ...]:
        """Return what there is to draw of all hands."""
        return sum([each.scene(hand) for hand, each in self.hands.items()], self.scene())


@dataclass(frozen=True)
class WithFixtures(EnvironmentModel):
    """An environment with fixtures beside it."""

    model: EnvironmentModel
    fixtures: Fixtures

    def declared(self) -> Collection[Signal]:
        return self.model.declared()

    def check_hands(self, hands: tuple[str, ...]) -> None:
        self.model.check_hands(hands)
        for name in self.fixtures.hands:
            check_hand(name, hands, "fixtures.hands")

    def open(self, axes: int) -> Environment:
        return _Guided(self, axes)


class _Guided(Environment):
    def __init__(self, model: WithFixtures, axes: int) -> None:
        self._model, self._axes = model, axes
        self._users: Collection[str] = ()
        self._opened = open_environment(model.model, axes)
        self.published = self._opened.published

    def force(self, user: str, position: Vector, velocity: Vector, elapsed: float) -> Vector:
        force = self._opened.force(user, position, velocity, elapsed)
        more = cut(self._model.fixtures.on(user, pad3(position), pad3(velocity)), self._axes)
        return tuple([one + other for one, other in zip(force, more, strict=True)])

    def expect(self, users: Collection[str]) -> None:
        self._users = users
        self._opened.expect(users)

    def take_readings(self, user: str, buttons: int | None, measured_force: Vector | None) -> None:
        self._opened.take_readings(user, buttons, measured_force)

    def leave(self, user: str) -> None:
        self._opened.leave(user)

    def contact(self, user: str) -> Contact | None:
        return self._opened.contact(user)

    def scene(self) -> tuple[SceneObject, ...]:
        return (*(self._opened.scene() or ()), *self._model.fixtures.drawn())

    def mujoco(self) -> tuple[Any, Any] | None:
        return self._opened.mujoco()

    def change(self, model: WithFixtures) -> bool:
        if model.model != self._model.model:
            self._opened = change_environment(self._opened, model.model, self._axes, self._users)
            self.published = self._opened.published
        self._model = model
        return True

    def reset(self) -> bool:
        return self._opened.reset()

    def close(self) -> None:
        self._opened.close()
