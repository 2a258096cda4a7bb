r"""What the follower of a lerobot session meets, as the environment of the leader's graph.

lerobot's process publishes each observation of the follower (:class:`Observations`); the
environment's process computes the force on the leader from the newest one, for every reading of the
leader. So the spring is computed at the rate of the leader's servo, only the follower's position is
held between two observations, and lerobot's process is not in the loop. Nothing here imports
lerobot. For each joint, with the positions and velocities of leader and follower, and the
follower's effort :math:`e`, positive towards larger positions:

.. math::

    f = k (x_l - x_f) + b (v_l - v_f) + g e

:math:`v_f` is the mean velocity between the last two observations.
"""

import math
import time
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from numbers import Real
from typing import Annotated, Any, ClassVar, TypeAlias

import msgspec

from forcebound.axes import OfAxes, entries, per_axis
from forcebound.errors import ConfigError
from forcebound.folders import runtime_folder
from forcebound.haptics.environments import Environment, EnvironmentModel
from forcebound.haptics.parts.signals import Signal
from forcebound.messages.packets import Vector
from forcebound.network.sockets import Network
from forcebound.quantities import NOT_NEGATIVE, Damping, Force, Length, Stiffness, Time

#: An observation on its way: time (ns) of the sender's monotonic clock, what is no image by name.
Observation: TypeAlias = tuple[int, dict[str, float]]

DEGREE = math.radians(1.0)
ONSET = 0.5  # s, over which the force comes in when the follower is seen, or seen again


class Observations:
    """Observations on their way to the graph; nobody waits for their receiver.

    Raises:
        ConfigError: If another robot sends under this name.
    """

    def __init__(self, link: str) -> None:
        self._network = Network(linger_ms=0)
        try:
            self._send = self._network.publisher(_endpoint(link)).send
        except ConfigError:
            self._network.close()
            raise

    def send(self, observation: Mapping[str, Any]) -> None:
        """Send what is a number."""
        numbers = {k: float(v) for k, v in observation.items() if isinstance(v, Real)}
        self._send(msgspec.msgpack.encode((time.monotonic_ns(), numbers)))

    def close(self) -> None:
        """Close the socket."""
        self._network.close()


def _endpoint(link: str) -> str:
    """Return where a follower's observations are: in a folder that only this user can enter."""
    return f"ipc://{runtime_folder()}/lerobot-{link}"


@dataclass(frozen=True, kw_only=True)
class Follower(EnvironmentModel):
    """A follower that lerobot drives, and that a hand feels at the leader.

    An observation that lacks a joint, or has a number that is not finite, is none.

    Attributes:
        joints: What the follower calls its joints, in the order of the leader's axes.
        stiffness: Of a spring from the leader to the follower; one number, or one of each joint, as
            are the next three.
        damping: Between leader and follower.
        unit: Angle of the leader for 1 of the follower's ``.pos``; null: 1 degree.
        zero: Angle of the leader where the follower's ``.pos`` is 0.
        effort: What the follower calls its effort, such as effort or current; empty: it has none.
        effort_unit: Torque on the leader for 1 of the effort.
        observation_age: An older observation gives no force.
        link: Name of the link, that of the robot's configuration.
    """

    signals: ClassVar[Collection[Signal]] = (
        Signal("position_error", "m", "follower, from the leader"),
        Signal("observation_age", "s", "since the follower's last observation"),
    )

    joints: tuple[str, ...]
    stiffness: OfAxes[Annotated[Stiffness, NOT_NEGATIVE]] = 100.0
    damping: OfAxes[Annotated[Damping, NOT_NEGATIVE]] = 1.0
    unit: OfAxes[Length] | None = None
    zero: OfAxes[Length] = 0.0
    effort: str = ""
    effort_unit: OfAxes[Force] = 0.0
    observation_age: Annotated[Time, NOT_NEGATIVE] = 0.2
    link: str = "lerobot"

    def __post_init__(self) -> None:
        if 0.0 in entries(DEGREE if self.unit is None else self.unit):
            raise ConfigError("unit must not be 0: no angle has a .pos then", field="unit")
        if bool(self.effort) != any(entries(self.effort_unit)):
            raise ConfigError("effort and effort_unit: both, or neither", field="effort_unit")

    def on_axes(self, field: str, axes: int) -> tuple[float, ...]:
        """Return the numbers of a field, one for each axis; ConfigError if there are others."""
        value = getattr(self, field)
        return per_axis(field, DEGREE if value is None else value, axes)

    def check_axes(self, axes: int) -> None:
        if (got := len(self.joints)) != axes:
            raise ConfigError(f"joints: expected {axes} names, got {got}", field="joints")
        for field in _OF_AXES:
            self.on_axes(field, axes)

    def action(self, position: Vector) -> dict[str, float]:
        """Return what lerobot calls a position of the leader, in rad."""
        units, zeros = (self.on_axes(field, len(position)) for field in ("unit", "zero"))
        each = zip(self.joints, position, zeros, units, strict=True)
        return {f"{joint}.pos": (q - zero) / unit for joint, q, zero, unit in each}

    def open(self, axes: int) -> Environment:
        return _Followed(self, axes)


_OF_AXES = ("stiffness", "damping", "unit", "zero", "effort_unit")


#: A whole observation: ns of the sender; rad, rad/s and N m on the leader, for each joint.
_Seen: TypeAlias = tuple[int, Vector, Vector, Vector]


class _Followed(Environment):
    """An open link to a follower."""

    def __init__(self, model: Follower, axes: int) -> None:
        self._network = Network(linger_ms=0)
        self._subscriber = self._network.subscriber(_endpoint(model.link))
        self._seen: _Seen | None = None  # None: it is silent
        self._heard, self._onset = -math.inf, 0.0  # s: the last, and the first of those in a row
        self._refused = ""
        self._model = model
        numbers = (model.on_axes(field, axes) for field in _OF_AXES)
        self._joints = list(zip(model.joints, *numbers, strict=True))

    def force(self, user: str, position: Vector, velocity: Vector, elapsed: float) -> Vector:
        if messages := self._subscriber.receive():
            self._take(messages[-1], elapsed)
        age = elapsed - self._heard
        self.signal("observation_age", age)
        seen = self._seen
        if seen is not None and age > self._model.observation_age:
            self._seen = seen = None
            self.event("follower_silent", f"no observation for {1e3 * age:.0f} ms", is_fault=True)
        if seen is None:
            self.signal("position_error", math.nan)
            return (0.0,) * len(position)
        share = min(max((elapsed - self._onset) / ONSET, 0.0), 1.0)
        _, places, speeds, efforts = seen
        errors = [x - at for x, at in zip(position, places, strict=True)]
        self.signal("position_error", math.hypot(*errors))
        each = zip(self._joints, errors, velocity, speeds, efforts, strict=True)
        felt = [k * e + b * (v - v_f) + t for (_, k, b, *_), e, v, v_f, t in each]
        return tuple([share * one for one in felt])

    def _take(self, message: bytes, elapsed: float) -> None:
        """Let the follower be where an observation says, if it is whole."""
        try:
            seen = self._read(*msgspec.msgpack.decode(message, type=Observation))
        except (KeyError, ValueError, msgspec.MsgspecError) as error:
            if (lack := f"expected {error}") != self._refused:
                self.event("observation_refused", lack, is_fault=True)
            self._refused = lack
            return
        if self._seen is None:
            self._onset = elapsed
            self.event("follower_seen", "the follower is observed: its force comes in")
        self._seen, self._heard, self._refused = seen, elapsed, ""

    def _read(self, time_ns: int, numbers: Mapping[str, float]) -> _Seen:
        """Return what an observation says; KeyError or ValueError if it lacks something."""
        name, of = self._model.effort, self._joints
        places = [zero + unit * numbers[f"{joint}.pos"] for joint, _, _, unit, zero, _ in of]
        efforts = [unit * numbers[f"{joint}.{name}"] if name else 0.0 for joint, *_, unit in of]
        if not all(map(math.isfinite, (*places, *efforts))):
            raise ValueError("finite numbers")
        speeds, before = (0.0,) * len(places), self._seen
        if before is not None and time_ns > before[0]:
            step = 1e-9 * (time_ns - before[0])
            both = zip(places, before[1], strict=True)
            speeds = tuple([(now - then) / step for now, then in both])
        return time_ns, tuple(places), speeds, tuple(efforts)

    def close(self) -> None:
        self._network.close()
