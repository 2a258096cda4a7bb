r"""Leader and follower: two hands that a teleoperator couples.

Each axis is coupled by itself: coordinates of the tips, or joints, to those of the same number.
With the positions :math:`x_l, x_f` of both, the follower's target position is :math:`s x_l + o`,
with the scale :math:`s` and the offset :math:`o`. Forces are positive towards
positive x: :math:`f_h` of the hand on the leader, measured; :math:`f_e` of the follower on what it
touches, minus the force measured at the follower; :math:`u_l, u_f` of the motors, with the force
scale :math:`r`:

.. math::

    u_f &= c + C_3 f_h / r , \qquad c = k (s x_l + o - x_f) + b (s v_l - v_f) , \\
    u_l &= - r (C_4 c + C_2 f_e) .

The answers are :math:`-u_l` and :math:`-u_f`, since an answer is positive when it resists. Names of
the gains, 0 or 1, as in Hashtrudi-Zaad and Salcudean; their :math:`C_1` is the spring and damper of
c, and there is no local force feedback (:math:`C_5, C_6`). With all of them, four_channel, their
condition of transparency is fulfilled, without the terms of acceleration. Without the force sensors
that an architecture needs, it is position_position.

Sources: D. A. Lawrence, Stability and transparency in bilateral teleoperation, IEEE Trans. Robotics
and Automation 9(5), 1993; K. Hashtrudi-Zaad, S. E. Salcudean, Analysis of control architectures for
teleoperation systems with impedance/admittance master and slave manipulators, Int. J. Robotics
Research 20(6), 2001.
"""

import math
from dataclasses import dataclass
from typing import Annotated, Literal, TypeAlias

from forcebound.axes import OfAxes, PerAxis, entries, per_axis
from forcebound.errors import ConfigError
from forcebound.haptics.environments import (
    Environment,
    EnvironmentModel,
    check_hand,
    within_reach,
)
from forcebound.haptics.geometry.vectors import pad3
from forcebound.haptics.parts.signals import Signal
from forcebound.messages.packets import SceneObject, Vector
from forcebound.quantities import (
    NOT_NEGATIVE,
    Damping,
    Length,
    Range,
    Ratio,
    Stiffness,
    check_ranges,
)

AnyRatio: TypeAlias = Annotated[Ratio, Range()]  # finite
JOINING = 1.0  # s, in which the force grows on a hand whose partner comes while it has force
_STARTING = 0.05  # s; a hand that has force for so short a time is still on its own device's ramp
#: ``C_4``, ``C_2`` and ``C_3`` of each architecture.
GAINS = {
    "position_position": (1.0, 0.0, 0.0),
    "position_force": (0.0, 1.0, 0.0),
    "four_channel": (1.0, 1.0, 1.0),
}


@dataclass(frozen=True, kw_only=True)
class Coupling(EnvironmentModel):
    """A leader and a follower, coupled by spring and damper, or by measured forces, too.

    While one of them is not there, there is no force on the other. When it comes (back), the force
    on the one that was there grows from zero within a second. Other hands feel nothing.

    Attributes:
        leader: Name of the hand that leads.
        follower: Name of the hand that follows.
        architecture: position_position: spring and damper between both; position_force: the leader
            feels the force that is measured at the follower; four_channel: positions and measured
            forces both ways.
        stiffness: Between the follower and its target position; one number, or one of each axis,
            as are the next three.
        damping: Between the follower and its target position.
        scale: Way of the follower for the leader's; negative: mirrored.
        force_scale: Force on the leader for the follower's, of the sign of scale; null: scale, so
            that the coupling makes no power.
        offset: Added to the follower's target position, for each axis; 0 where there is none.
        clutch: Bit of the leader's button that releases the coupling while it is down; when it is
            let go, they are coupled where they are then. null: none.
    """

    signals = (
        Signal("position_error", "m", "follower, from its target position"),
        Signal("force_error", "N", "hand's force on the leader, less that of the follower"),
    )

    leader: str = "leader"
    follower: str = "follower"
    architecture: Literal["position_position", "position_force", "four_channel"] = (
        "position_position"
    )
    stiffness: OfAxes[Annotated[Stiffness, NOT_NEGATIVE]] = 300.0
    damping: OfAxes[Annotated[Damping, NOT_NEGATIVE]] = 2.0
    scale: OfAxes[AnyRatio] = 1.0
    force_scale: OfAxes[AnyRatio] | None = None
    offset: tuple[Length, ...] = ()
    clutch: Annotated[int, Range(at_least=0, below=63)] | None = None

    def __post_init__(self) -> None:
        check_ranges(self)
        if self.leader == self.follower:
            message = f"follower must be another hand than the leader, {self.leader!r}"
            raise ConfigError(message, field="follower")
        scales = per_axis("scale", self.scale, len(entries(self.ratio)))
        ratios = per_axis("force_scale", self.ratio, len(scales))
        for scale, ratio in zip(scales, ratios, strict=True):
            if scale == 0.0:
                message = "scale must not be 0: the follower would not follow"
                raise ConfigError(message, field="scale")
            if ratio * scale <= 0.0:
                message = f"force_scale must have the sign of scale, {scale:g}, got {ratio:g}"
                raise ConfigError(f"{message}: the coupling would give energy", field="force_scale")

    @property
    def ratio(self) -> PerAxis:
        """The force scale."""
        return self.scale if self.force_scale is None else self.force_scale

    def on_axis(self, axis: int) -> list[float]:
        """Return stiffness, damping, scale and force scale of one axis."""
        numbers = map(entries, (self.stiffness, self.damping, self.scale, self.ratio))
        return [of[axis % len(of)] for of in numbers]

    def check_hands(self, hands: tuple[str, ...]) -> None:
        for field in ("leader", "follower"):
            check_hand(getattr(self, field), hands, field)

    def check_axes(self, axes: int) -> None:
        if len(self.offset) > axes:
            message = f"offset: expected at most {axes} entries, got {len(self.offset)}"
            raise ConfigError(message, field="offset")
        for field in _OF_AXES:
            per_axis(field, getattr(self, field) or 0.0, axes)

    def open(self, axes: int) -> "_Coupled":
        self.check_axes(axes)
        return _Coupled(self, axes)


_OF_AXES = ("stiffness", "damping", "scale", "force_scale")


class _Hand:
    """Leader or follower, at its last query."""

    position: Vector = ()  # m; empty: it is not there
    velocity: Vector = ()  # m/s
    felt: Vector | None = None  # N, by its force sensor


class _Coupled(Environment):
    """An open coupling."""

    def __init__(self, model: Coupling, axes: int) -> None:
        self._model, self._offset = model, model.offset
        self._gains = [model.on_axis(i) for i in range(axes)]
        self._hands = {model.leader: _Hand(), model.follower: _Hand()}
        self._joined: dict[str, float] = {}  # s, when each hand's partner was there
        self._is_released = False  # by the clutch
        self._reindexes = False  # as soon as both are there and the clutch is up
        self._has_warned = False

    def take_readings(self, user: str, buttons: int | None, measured_force: Vector | None) -> None:
        if user in self._hands:
            self._hands[user].felt = measured_force
        if user == self._model.leader and self._model.clutch is not None:
            self._is_released = bool((buttons or 0) >> self._model.clutch & 1)
            self._reindexes = self._reindexes or self._is_released

    def force(self, user: str, position: Vector, velocity: Vector, elapsed: float) -> Vector:
        model, hand = self._model, self._hands.get(user)
        zero = (0.0,) * len(position)
        if hand is None:
            return zero
        hand.position = tuple(map(within_reach, position))
        hand.velocity = tuple(map(within_reach, velocity))
        leader, follower = self._hands[model.leader], self._hands[model.follower]
        if self._is_released or not (leader.position and follower.position):
            self.signal("position_error", math.nan)
            self.signal("force_error", math.nan)
            return zero
        share = self._grown(user, elapsed)
        if self._reindexes:
            both = enumerate(zip(leader.position, follower.position, strict=False))
            offsets = [f - self._gains[i][2] * at for i, (at, f) in both]
            self._offset, self._reindexes = tuple(offsets), False
        motors = self._motors(leader, follower)
        answer = tuple([-share * forces[hand is follower] for forces in motors])
        return (answer + zero)[: len(zero)]

    def _grown(self, user: str, elapsed: float) -> float:
        """Return the share of its force that a hand gets; an event when its partner comes."""
        if user not in self._joined:
            self._joined[user] = elapsed
            if elapsed > _STARTING:
                words = f"both hands are there: the force on {user} grows within {JOINING:g} s"
                self.event("coupled", words)
        since = elapsed - self._joined[user]
        return min(since / JOINING, 1.0) if self._joined[user] > _STARTING else 1.0

    def _motors(self, leader: _Hand, follower: _Hand) -> list[tuple[float, float]]:
        """Return the forces of leader and follower, in N, on each axis that both have."""
        model = self._model
        count = min(len(leader.position), len(follower.position))
        on_leader, on_follower = _padded(leader.felt, count), _padded(follower.felt, count)
        is_sensed = self._is_sensed(leader, follower)
        c_4, c_2, c_3 = GAINS[model.architecture if is_sensed else "position_position"]
        forces, errors, differences = [], [], []
        for i, offset in enumerate(_padded(self._offset, count)):
            k, b, s, r = self._gains[i]
            error = s * leader.position[i] + offset - follower.position[i]
            c = k * error
            c += b * (s * leader.velocity[i] - follower.velocity[i])
            f_h, f_e = on_leader[i], -on_follower[i]
            forces.append((-r * (c_4 * c + c_2 * f_e), c + c_3 * f_h / r))
            errors.append(error)
            differences.append(f_h - r * f_e)
        is_known = leader.felt is not None and follower.felt is not None
        self.signal("position_error", math.hypot(*errors))
        self.signal("force_error", math.hypot(*differences) if is_known else math.nan)
        return forces

    def _is_sensed(self, leader: _Hand, follower: _Hand) -> bool:
        """Return whether there are the sensors that the architecture needs; an event if not."""
        _, c_2, c_3 = GAINS[self._model.architecture]
        lacks_leader = leader.felt is None and c_3 != 0.0
        lacks = lacks_leader or (follower.felt is None and c_2 != 0.0)
        if lacks and not self._has_warned:
            self._has_warned = True
            hand = self._model.leader if lacks_leader else self._model.follower
            words = f"{hand} has no force sensor: position_position takes the place of"
            self.event("no_force_sensor", f"{words} {self._model.architecture}", is_fault=True)
        return not lacks

    def leave(self, user: str) -> None:
        if user in self._hands:
            self._hands[user] = _Hand()
            self._joined.clear()

    def scene(self) -> tuple[SceneObject, ...]:
        tips = [hand.position for hand in self._hands.values()]
        if not all(tips):
            return ()
        return (SceneObject("coupling", "path", is_fixed=False, points=tuple(map(pad3, tips))),)

    def change(self, model: Coupling) -> bool:
        """Take over other parameters; with another scale the hands are coupled where they are."""
        before = self._model
        if {model.leader, model.follower} != self._hands.keys():
            return False
        self._model = model
        self._gains = [model.on_axis(i) for i in range(len(self._gains))]
        self._reindexes = self._reindexes or model.scale != before.scale
        if model.offset != before.offset:
            self._offset, self._reindexes = model.offset, False
        return True


def _padded(vector: Vector | None, count: int) -> Vector:
    return ((vector or ()) + (0.0,) * count)[:count]
