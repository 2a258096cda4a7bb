"""A local plane, estimated from what the environment answers (``docs/controllers.md``).

An environment that reports its contact gives the plane's direction and offset; stiffness and
damping are estimated from depth and speed (:class:`SpringDamper`), friction is a mean over answers
in which the hand slid. Of forces alone, the direction is that of the force; stiffness and damping
follow from *pairs* of answers, whose difference does not depend on the offset, so neither a wall
that moves now and then nor a plane that turns (to first order) disturbs them; the offset then
follows from the newest answer alone. A free answer moves the plane back.

Source: contact models of stiffness and damping from the answers: Verscheure, De Schutter et al.
2010; Li and Song 2007.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

from forcebound.messages.packets import Contact, Vector

NO_FORCE = 1e-9  # N; less is none
NEAR = 5e-4  # m; a surface this far before a free place is gone
PAIR_STEP = 1e-4  # m; of a hand
PAIR_NS = 50_000_000  # ns; an older answer makes no pair
TURNED = math.cos(math.radians(30.0))  # a surface that has turned further is another one
SOFTEST = 1.0  # N/m; less cannot be distinguished from a constant force
GUESS = 1e3  # N/m, of a surface that was never seen from outside
SLIDING = 0.005  # m/s along the plane, from which friction is estimated
FRICTION_SHARE = 0.05  # weight of a new friction coefficient
UNSURE_STIFFNESS, UNSURE_DAMPING = 1e7, 1e4  # N/m, N s/m: of an estimate, over 1 N of noise
UNSURE = (UNSURE_STIFFNESS**2, 0.0, UNSURE_DAMPING**2)
CHANGED = 0.5  # of the force: two samples this far from what was expected: it has changed


def dot(a: Vector, b: Vector) -> float:
    """Return the scalar product."""
    return sum([x * y for x, y in zip(a, b, strict=True)])


def along(a: Vector, direction: Vector, distance: float) -> Vector:
    """Return ``a + distance direction``."""
    return tuple([x + distance * d for x, d in zip(a, direction, strict=True)])


def across(a: Vector, direction: Vector) -> Vector:
    """Return the part of ``a`` at right angles to a unit vector."""
    return along(a, direction, -dot(a, direction))


class Asked(NamedTuple):
    """State in a query to the environment, and its time."""

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


class SpringDamper:
    r"""A spring k, in N/m, and a damper b, in N s/m, by directional forgetting.

    .. math:: F = k\,d + b\,v = \phi \cdot \theta, \qquad r = \phi \cdot P \phi, \qquad
              \theta \mathrel{+}= \frac{P \phi}{1 + r} (F - \phi \cdot \theta), \qquad
              P \mathrel{-}= \frac{P \phi \phi^T P}{1 / \beta + r}, \quad
              \beta = \lambda - \frac{1 - \lambda}{r}

    ``forgetting`` is λ, above 0, at most 1: old information is forgotten only in the direction in
    which there is new one. With plain forgetting P would grow without bound where nothing comes,
    such as along b for a hand at one speed.

    Source: R. Kulhavy and M. Karny, Tracking of slowly varying parameters by directional
    forgetting, IFAC World Congress, 1984.
    """

    def __init__(self, forgetting: float) -> None:
        self._forgetting = forgetting
        self._covariance = UNSURE  # P: kk, kb, bb
        self._is_doubted = False  # the last sample contradicted it, and was left out
        self.stiffness, self.damping = 0.0, 0.0
        self.samples = 0  # that have been taken in

    def add(self, depth: float, speed: float, force: float) -> None:
        """Take a sample in: ``depth`` in m, ``speed`` in m/s and ``force`` in N, or changes."""
        expected = self.stiffness * depth + self.damping * speed
        is_far = abs(force - expected) > CHANGED * max(abs(force), abs(expected))
        if self.samples > 1 and is_far and not self._is_doubted:
            self._is_doubted = True
            return  # one may be an error
        if self._is_doubted and is_far:
            self._covariance = UNSURE
        self._is_doubted = False
        kk, kb, bb = self._covariance
        k, b = kk * depth + kb * speed, kb * depth + bb * speed
        known = depth * k + speed * b
        if known <= 0.0:  # depth and speed are 0
            return
        error = (force - expected) / (1.0 + known)
        self.stiffness += k * error
        self.damping += b * error
        beta = self._forgetting - (1.0 - self._forgetting) / known
        taken = beta / (1.0 + beta * known)
        self._covariance = (kk - taken * k * k, kb - taken * k * b, bb - taken * b * b)
        self.samples += 1


class PlaneEstimator:
    """The plane that follows from the answers; None until the first contact.

    ``forgetting`` is the weight of the information before at each new sample, 0 to 1, ``stiffest``
    the largest stiffness it may take, in N/m, ``release`` the time of force-free answers behind the
    surface after which it is gone, in s, ``pair_step`` the least step along u between both answers
    of a pair, in m.
    """

    def __init__(
        self, forgetting: float, stiffest: float, release: float, pair_step: float = PAIR_STEP
    ) -> None:
        self._release_ns = round(release * 1e9)
        self._forgetting = forgetting
        self._stiffest = stiffest
        self._pair_step = pair_step
        self.plane: Plane | None = None
        self._free: Asked | None = None  # the last answer without contact
        self._first: tuple[Asked, float] | None = None  # of the next pair, with its force
        self._touched: Plane | None = None  # the plane at the last answer of a contact
        self._missing_ns: int | None = None  # the first free answer behind it since
        self._friction = 0.0
        self._spring = SpringDamper(forgetting)

    def take(self, asked: Asked, force: Vector, contact: Contact | None = None) -> None:
        """Take an answer in: the force, in N, and the contact if it was reported."""
        magnitude = math.hypot(*force)
        if contact is not None:
            self._take_contact(asked, force, contact)
        elif magnitude > NO_FORCE:
            self._take_force(asked, tuple([f / magnitude for f in force]), magnitude)
        else:
            self._take_free(asked)
            return
        self._touched, self._missing_ns = self.plane, None

    def _take_free(self, asked: Asked) -> None:
        self._free, self._first = asked, None
        plane, touched = self.plane, self._touched
        if plane is None or touched is None:
            return
        if touched.depth(asked.position) <= 0.0:
            self._missing_ns = None
            return
        if self._missing_ns is None:
            self._missing_ns = asked.time_ns
        missing = asked.time_ns - self._missing_ns
        if touched.depth(asked.position) > NEAR or missing >= self._release_ns:
            self.plane = None
        elif (depth := plane.depth(asked.position)) > 0.0:
            self.plane = plane.at(plane.offset + depth)

    def _take_contact(self, asked: Asked, force: Vector, contact: Contact) -> None:
        """Take in an answer that has the place of the surface."""
        inwards = tuple([-n for n in contact.normal])
        self._begin_surface(inwards)
        offset, pressed = dot(contact.proxy, inwards), dot(force, inwards)
        speed = dot(asked.velocity, inwards)
        if pressed > NO_FORCE:  # else the damper has taken it all
            self._spring.add(dot(asked.position, inwards) - offset, speed, pressed)
            self._take_friction(asked, inwards, across(force, inwards), pressed)
        self.plane = self._known(inwards, offset)

    def _take_force(self, asked: Asked, inwards: Vector, pressed: float) -> None:
        """Take in an answer that has only the force."""
        self._begin_surface(inwards)
        self._take_pair(asked, inwards, pressed)
        place = dot(asked.position, inwards)
        if not self._spring.samples:
            stiffness = min(max(self._guess(place, inwards, pressed), SOFTEST), self._stiffest)
            self.plane = Plane(inwards, place - pressed / stiffness, stiffness)
            return
        known = self._known(inwards, place)
        elastic = max(pressed - known.damping * dot(asked.velocity, inwards), 0.0)
        self.plane = known.at(place - elastic / known.stiffness)

    def _begin_surface(self, inwards: Vector) -> None:
        """Forget a surface that looks another way."""
        if self.plane is not None and dot(self.plane.inwards, inwards) < TURNED:
            self._spring = SpringDamper(self._forgetting)
            self._first, self._friction = None, 0.0

    def _take_pair(self, asked: Asked, inwards: Vector, pressed: float) -> None:
        if self._first is None:
            self._first = asked, pressed
            return
        before, pressed_before = self._first
        step = dot(asked.position, inwards) - dot(before.position, inwards)
        if abs(step) < self._pair_step:
            if asked.time_ns - before.time_ns > PAIR_NS:
                self._first = asked, pressed
            return
        speed = dot(asked.velocity, inwards) - dot(before.velocity, inwards)
        self._spring.add(step, speed, pressed - pressed_before)
        self._first = asked, pressed

    def _take_friction(
        self, asked: Asked, inwards: Vector, tangential: Vector, pressed: float
    ) -> None:
        slip = across(asked.velocity, inwards)
        speed = math.hypot(*slip)
        if speed < SLIDING:
            return
        coefficient = max(dot(tangential, slip) / speed / pressed, 0.0)
        self._friction += FRICTION_SHARE * (coefficient - self._friction)

    def _known(self, inwards: Vector, offset: float) -> Plane:
        """The plane with the stiffness, damping and friction known so far."""
        stiffness = min(max(self._spring.stiffness, SOFTEST), self._stiffest)
        damping = max(self._spring.damping, 0.0)
        return Plane(inwards, offset, stiffness, damping, self._friction)

    def _guess(self, place: float, inwards: Vector, pressed: float) -> float:
        """A stiffness, in N/m, rather too small: the surface is behind the last free place."""
        if self._free is not None:
            distance = place - dot(self._free.position, inwards)
            if distance > 0.0:
                return pressed / distance
        return self.plane.stiffness if self.plane is not None else GUESS
