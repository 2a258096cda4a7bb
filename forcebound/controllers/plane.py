r"""A local plane, estimated from what the environment answers.

An answer F belongs to the position x and velocity v that were asked about. Near the surface it is
taken for that of a plane with the unit vector u into the solid, at the offset c:

.. math:: F_n = F \cdot u = k (x \cdot u - c) + b\, v \cdot u, \qquad
          F_t = \mu F_n \text{ against the motion along the plane}

* u is the direction of the normal that the environment tells, else that of its force.
* k and b follow from *pairs* of answers, by recursive least squares with forgetting: the
  difference of two answers does not depend on c, so neither a wall that moves nor a plane that
  turns (:math:`x \cdot u` changes by the turn to second order only) disturbs it. Information is
  forgotten only where there is new (directional forgetting): a hand at rest forgets nothing.
* c then follows from the newest answer alone.
* :math:`\mu` is a mean of :math:`|F_t| / F_n` over answers in which the hand slid; it needs the
  normal.
* A free answer says that the surface lies beyond x: the plane recedes to x if it lay before.

The positions are those that were asked about, so the encoder's quantisation is no noise here.

Source: least squares with directional forgetting: Kulhavy and Karny 1984; contact models of
stiffness and damping from the answers: Verscheure, De Schutter et al. 2010, Li and Song 2007.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

from forcebound.controllers.vectors import across, dot
from forcebound.messages.packets import Vector

NO_FORCE = 1e-9  # N; less is none
PAIR_WAY = 1e-4  # m; of a hand
PAIR_NS = 50_000_000  # ns; an older answer makes no pair
TURNED = math.cos(math.radians(30.0))  # a surface that has turned further is another one
SOFTEST = 1.0  # N/m; less cannot be told from a constant force
GUESS = 1e3  # N/m, of a surface that was never seen from outside
UNSURE_STIFFNESS, UNSURE_DAMPING = 1e7, 1e4  # N/m, N s/m: of an estimate, over 1 N of noise
SLIDING = 0.005  # m/s along the plane, from which friction is estimated
FRICTION_SHARE = 0.05  # weight of a new friction coefficient


class Asked(NamedTuple):
    """What the environment was asked about, and when."""

    position: Vector  # m
    velocity: Vector  # m/s
    time_ns: int  # device's clock


@dataclass(frozen=True)
class Plane:
    """A plane that resists what enters it."""

    inwards: Vector  # unit vector u into the solid
    offset: float  # c, m
    stiffness: float  # k, N/m
    damping: float = 0.0  # b, N s/m
    friction: float = 0.0  # coefficient of the friction along it

    def depth(self, position: Vector) -> float:
        """Return how deep a position lies behind the surface, in m; negative before it."""
        return dot(position, self.inwards) - self.offset

    def energy(self, position: Vector) -> float:
        """Return what its spring stores at a position, in J."""
        return 0.5 * self.stiffness * max(self.depth(position), 0.0) ** 2

    def at(self, offset: float) -> "Plane":
        """Return the same plane at another offset."""
        return Plane(self.inwards, offset, self.stiffness, self.damping, self.friction)


class PlaneEstimator:
    """The plane that the answers tell of.

    Args:
        forgetting: Weight of the information before at each new pair, 0 to 1.
        stiffest: Largest stiffness believed, in N/m.
        pair_way: Way along u between the two answers of a pair, in m.

    Attributes:
        plane: The newest; None until the first contact.
    """

    def __init__(self, forgetting: float, stiffest: float, pair_way: float = PAIR_WAY) -> None:
        self._forgetting = forgetting
        self._stiffest = stiffest
        self._pair_way = pair_way
        self.plane: Plane | None = None
        self._free: Asked | None = None  # the last answer without contact
        self._first: tuple[Asked, float] | None = None  # of the next pair, with its force
        self._friction = 0.0
        self._forget()

    def _forget(self) -> None:
        self._stiffness, self._damping = 0.0, 0.0
        self._covariance = (UNSURE_STIFFNESS**2, 0.0, UNSURE_DAMPING**2)
        self._pairs = 0
        self._first = None

    def take(self, asked: Asked, force: Vector, normal: Vector | None = None) -> None:
        """Take an answer in.

        Args:
            asked: What it answers.
            force: N.
            normal: Outward unit normal, if the environment tells it.
        """
        magnitude = math.hypot(*force)
        inwards = None if normal is None else tuple([-n for n in normal])
        if inwards is None and magnitude > NO_FORCE:
            inwards = tuple([f / magnitude for f in force])
        pressed = 0.0 if inwards is None else dot(force, inwards)
        if inwards is None or pressed <= NO_FORCE:
            self._take_free(asked)
            return
        plane = self.plane
        if plane is not None and dot(plane.inwards, inwards) < TURNED:
            self._forget()
            self._friction = 0.0
        self._take_pair(asked, inwards, pressed)
        if normal is not None:
            self._take_friction(asked, inwards, across(force, inwards), pressed)
        self.plane = self._through(asked, inwards, pressed)

    def _take_free(self, asked: Asked) -> None:
        self._free, self._first = asked, None
        plane = self.plane
        if plane is not None and (depth := plane.depth(asked.position)) > 0.0:
            self.plane = plane.at(plane.offset + depth)

    def _take_pair(self, asked: Asked, inwards: Vector, pressed: float) -> None:
        if self._first is None:
            self._first = asked, pressed
            return
        before, pressed_before = self._first
        way = dot(asked.position, inwards) - dot(before.position, inwards)
        if abs(way) < self._pair_way:
            if asked.time_ns - before.time_ns > PAIR_NS:
                self._first = asked, pressed
            return
        speed = dot(asked.velocity, inwards) - dot(before.velocity, inwards)
        self._regress(way, speed, pressed - pressed_before)
        self._first = asked, pressed

    def _regress(self, way: float, speed: float, force: float) -> None:
        """Recursive least squares of ``force = stiffness way + damping speed``."""
        a, b, d = self._covariance
        a, b, d = a / self._forgetting, b / self._forgetting, d / self._forgetting
        one, other = a * way + b * speed, b * way + d * speed
        scale = 1.0 / (1.0 + way * one + speed * other)
        error = force - self._stiffness * way - self._damping * speed
        self._stiffness += scale * one * error
        self._damping += scale * other * error
        self._covariance = (
            a - scale * one * one,
            b - scale * one * other,
            d - scale * other * other,
        )
        self._pairs += 1

    def _take_friction(
        self, asked: Asked, inwards: Vector, tangential: Vector, pressed: float
    ) -> None:
        slip = across(asked.velocity, inwards)
        speed = math.hypot(*slip)
        if speed < SLIDING:
            return
        coefficient = max(dot(tangential, slip) / speed / pressed, 0.0)
        self._friction += FRICTION_SHARE * (coefficient - self._friction)

    def _through(self, asked: Asked, inwards: Vector, pressed: float) -> Plane:
        """The plane that gives the newest answer."""
        stiffness, damping = self._stiffness, max(self._damping, 0.0)
        if self._pairs == 0:
            stiffness, damping = self._first_guess(asked, inwards, pressed), 0.0
        stiffness = min(max(stiffness, SOFTEST), self._stiffest)
        place = dot(asked.position, inwards)
        elastic = max(pressed - damping * dot(asked.velocity, inwards), 0.0)
        return Plane(inwards, place - elastic / stiffness, stiffness, damping, self._friction)

    def _first_guess(self, asked: Asked, inwards: Vector, pressed: float) -> float:
        """A stiffness, in N/m, rather too small: the surface is behind the last free place."""
        if self._free is not None:
            way = dot(asked.position, inwards) - dot(self._free.position, inwards)
            if way > 0.0:
                return pressed / way
        return self.plane.stiffness if self.plane is not None else GUESS
