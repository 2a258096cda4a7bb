"""The proxy on a surface, and the force between it and the device.

The *proxy* is the point where the tip would be if it could not enter anything. A spring ties the
device at x to the proxy at p, so that with stiffness k the force is ``F = k (x - p)`` (positive:
it resists). A *solid* moves the proxy; how the surface feels is decided here, the same for all.

**Friction.** Where the proxy is, the spring presses with ``N = k (p - x) . n`` along the outward
normal n and draws with T across it. The proxy sticks while ``T <= mu N``; else it slides towards x
until T is ``mu N`` again: the proxy of a goal that lies beside x by ``mu N / k``, against the
motion. *mu* is the static coefficient while it sticks and the dynamic one while it slides
(hysteresis), which ends when T falls below the dynamic cone. The proxy only ever moves towards x,
so friction only takes energy out of the spring.

Sources: D. C. Ruspini, K. Kolarov, O. Khatib, The haptic display of complex graphical environments,
SIGGRAPH 1997; W. S. Harwin, N. Melder, Improved haptic rendering for multi-finger manipulation
using friction cone based god-objects, Eurohaptics 2002.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, NamedTuple, Protocol

from forcebound.errors import ConfigError
from forcebound.haptics.geometry.texture import Texture
from forcebound.haptics.geometry.vectors import (
    ZERO,
    Pose,
    Vector3,
    add,
    along,
    dot,
    norm,
    scale,
    sub,
    tangential,
)
from forcebound.quantities import (
    NOT_NEGATIVE,
    POSITIVE,
    Damping,
    Length,
    Ratio,
    Speed,
    check_ranges,
)

HERE = Pose()
ROUNDS = 12  # of the search for the place where the friction cone holds the proxy
ON_SURFACE = 1e-6  # m; a proxy so near to a surface is on it
SAME = 1e-9  # relative: a drag so close to the cone is on it


class Solid(Protocol):
    """A solid that the proxy slides on; positions in m, normals of length 1 out of the solid."""

    def slide(self, proxy: Vector3, goal: Vector3) -> tuple[Vector3, Vector3 | None]:
        """Move the proxy from a legal place towards the goal as far as nothing is entered.

        Return the legal place that is closest to the goal along the way (a local minimum), and the
        direction from the goal to it, or None if the goal itself was reached: free motion.
        """
        ...

    def distance(self, point: Vector3) -> float:
        """Return the distance to the surface, or less; negative: inside."""
        ...

    def closest(self, point: Vector3) -> tuple[Vector3, Vector3]:
        """Return the closest point of the surface, and the outward normal there."""
        ...

    def shade(self, point: Vector3, normal: Vector3) -> Vector3:
        """Return the smoothed normal at a point of the surface with this ``normal``."""
        ...


@dataclass(frozen=True)
class Surface:
    """Feel of a surface; everything is off by default.

    Attributes:
        friction: Coefficient of Coulomb friction while the tip slides.
        static_friction: Coefficient until it begins to slide; at least ``friction``, which it is
            where nothing is said.
        stick_slip: Speed along the surface below which a slide ends after each slip, so that a slow
            stroke judders (Karnopp's dead band: D. Karnopp, Computer simulation of stick-slip
            friction in mechanical dynamic systems, J. Dyn. Sys. Meas. Control 107, 1985); 0: it
            slides on.
        viscosity: Damping along the surface.
        texture: Height map of the surface, a picture (white is high) or an array in a .npy file;
            its highest points lie in the surface, all others below.
        texture_height: From its lowest to its highest point.
        texture_size: Edge of one tile of the map, which repeats.
        magnet: Distance from the surface to which it holds on to a tip that has touched it.
        force_shading: Whether the force points along smoothed normals, so that facets feel round.
    """

    friction: Annotated[Ratio, NOT_NEGATIVE] = 0.0
    static_friction: Annotated[Ratio, NOT_NEGATIVE] | None = None
    stick_slip: Annotated[Speed, NOT_NEGATIVE] = 0.0
    viscosity: Annotated[Damping, NOT_NEGATIVE] = 0.0
    texture: Path | None = None
    texture_height: Annotated[Length, NOT_NEGATIVE] = 0.0002
    texture_size: Annotated[Length, POSITIVE] = 0.02
    magnet: Annotated[Length, NOT_NEGATIVE] = 0.0
    force_shading: bool = False

    def __post_init__(self) -> None:
        check_ranges(self)
        if self.static_friction is not None and self.static_friction < self.friction:
            raise ConfigError(
                f"static_friction must be at least friction, {self.friction:g}, got"
                f" {self.static_friction:g}: what sticks holds at least as well as what slides",
                field="static_friction",
            )

    def check_files(self) -> None:
        """Read the texture, if there is one; ConfigError if it is no height map."""
        self.relief()

    def relief(self) -> Texture | None:
        """Return the texture, ready for the first question."""
        if self.texture is None:
            return None
        return Texture.read(self.texture, self.texture_height, self.texture_size)

    @property
    def sticking(self) -> float:
        """Coefficient of static friction."""
        return self.friction if self.static_friction is None else self.static_friction


class Touch(NamedTuple):
    """A contact in space."""

    proxy: Vector3  # m
    normal: Vector3  # outward, of length 1


class HapticSurface:
    """The force of a solid's surface on a device, question by question.

    Spring in N/m between device and proxy, damping in N s/m along the normal: it pushes the device
    out and never pulls it in. A device that begins inside the solid feels nothing until it has left
    it once. All that it keeps is in the coordinates of the solid; ``pose`` is their place.
    """

    def __init__(
        self, solid: Solid, surface: Surface, stiffness: float, damping: float, pose: Pose = HERE
    ) -> None:
        self._touched: Touch | None = None  # by the last question
        self._proxy: Vector3 | None = None  # None: the device has not been outside yet
        self._is_sliding = False
        self._pose = pose
        self.change(solid, surface, stiffness, damping, pose)

    @property
    def touched(self) -> Touch | None:
        """The contact of the last question, in the world; None: free motion."""
        if self._touched is None:
            return None
        return Touch(self._pose.world(self._touched.proxy), self._pose.turned(self._touched.normal))

    def change(
        self, solid: Solid, surface: Surface, stiffness: float, damping: float, pose: Pose = HERE
    ) -> None:
        """Go on with other parameters; a proxy that a solid was moved over comes to its surface."""
        before, self._pose = self._pose, pose
        self._texture = surface.relief()
        self._solid, self._surface = solid, surface
        self._stiffness, self._damping = stiffness, damping
        if self._proxy is None:
            return
        if pose != before:
            self._proxy = pose.local(before.world(self._proxy))
        gap = solid.distance(self._proxy)
        if not 0.0 <= gap <= ON_SURFACE or pose != before:
            self._touched = None  # friction would hold on to a place where nothing is now
        if gap < 0.0:
            place, _ = solid.closest(self._proxy)
            self._proxy = place if solid.distance(place) > -ON_SURFACE else None

    def touch(self, position: Vector3, velocity: Vector3) -> Vector3:
        """Return the force at a device's position, in N; moves the proxy."""
        device, speed = self._pose.local(position), self._pose.turned_back(velocity)
        if self._proxy is None:
            if self._solid.distance(device) <= 0.0:
                return ZERO
            self._proxy = device
        goal, normal = self._solid.slide(self._proxy, device)
        if normal is None:
            self._touched = self._held_by_the_magnet(device)
            self._proxy = device if self._touched is None else self._touched.proxy
            self._is_sliding = False
        else:
            self._touched = self._with_friction(device, speed, Touch(goal, normal))
            self._proxy = self._touched.proxy
        if self._touched is None:
            return ZERO
        return self._pose.turned(self._force(device, speed, self._touched))

    def _held_by_the_magnet(self, device: Vector3) -> Touch | None:
        """The foot of a device outside, while the surface that it has touched holds on to it."""
        if self._surface.magnet == 0.0 or self._touched is None:
            return None
        foot, normal = self._solid.closest(device)
        if norm(sub(device, foot)) > self._surface.magnet:
            return None
        return Touch(self._solid.slide(self._touched.proxy, foot)[0], normal)

    def _with_friction(self, device: Vector3, velocity: Vector3, smooth: Touch) -> Touch:
        """The contact with friction, of the one without; see the module."""
        if self._surface.sticking == 0.0:
            return smooth
        before = self._touched if self._touched is not None else smooth
        assert self._proxy is not None
        old = Touch(self._proxy, before.normal)
        if self._is_sliding:
            slow = norm(tangential(velocity, old.normal)) < self._surface.stick_slip
            self._is_sliding = not slow
        limit = self._surface.friction if self._is_sliding else self._surface.sticking
        depth, drag = _pull(device, old)
        if drag <= limit * depth * (1.0 - SAME):
            self._is_sliding = False
            if self._touched is not None:
                return old
            return self._at_cone(device, smooth, limit)
        self._is_sliding = True
        return self._at_cone(device, smooth, self._surface.friction)

    def _at_cone(self, device: Vector3, smooth: Touch, friction: float) -> Touch:
        """Return where a sliding proxy rests: T is ``friction`` times N, or all that there is."""
        assert self._proxy is not None
        touch, reach = smooth, friction
        most = norm(sub(self._proxy, device)) * (1.0 + SAME)
        for _ in range(ROUNDS):
            depth = dot(sub(touch.proxy, device), touch.normal)
            behind = tangential(sub(self._proxy, device), touch.normal)
            length = norm(behind)
            if length == 0.0:
                break
            goal = along(device, behind, min(reach * depth / length, 1.0))
            proxy, normal = self._solid.slide(self._proxy, goal)
            away = norm(sub(proxy, device))
            if normal is None or away > most:  # so deep in a small solid that it would go round it
                reach *= 0.5
                continue
            moved = norm(sub(proxy, touch.proxy))
            touch = Touch(proxy, normal)
            if moved <= 1e-4 * depth:
                break
        return touch

    def _force(self, device: Vector3, velocity: Vector3, touch: Touch) -> Vector3:
        stiffness, surface = self._stiffness, self._surface
        from_proxy = sub(device, touch.proxy)
        depth = -dot(from_proxy, touch.normal)
        if depth < 0.0:  # held by the magnet
            return scale(from_proxy, stiffness)
        across = tangential(from_proxy, touch.normal)
        if self._texture is not None:
            height, slope = self._texture.at(along(device, touch.normal, depth), touch.normal)
            depth = max(depth + height, 0.0)
            across = along(across, slope, depth)
        sideways = along(
            scale(across, stiffness), tangential(velocity, touch.normal), surface.viscosity
        )
        push = max(stiffness * depth - self._damping * dot(velocity, touch.normal), 0.0)
        normal = touch.normal
        if surface.force_shading:
            normal = self._solid.shade(touch.proxy, normal)
        return add(sideways, scale(normal, -push))


def _pull(device: Vector3, touch: Touch) -> tuple[float, float]:
    """Along and across the normal, how far the device is from the proxy, in m."""
    to_proxy = sub(touch.proxy, device)
    return dot(to_proxy, touch.normal), norm(tangential(to_proxy, touch.normal))
