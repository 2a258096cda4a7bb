"""What the follower of a lerobot session meets, as the environment of the leader's graph.

lerobot's process publishes each observation of the follower (:class:`Observations`); the
environment's process computes the force from the newest one for every reading of the leader. So the
spring is computed at the rate of the leader's servo, only the follower's position is held between
two observations, and nothing of lerobot's process is in the loop. Nothing here imports lerobot.
"""

import math
import time
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from numbers import Real
from typing import Annotated, Any, ClassVar

import msgspec

from forcebound.axes import OfAxes, PerAxis, entries, per_axis
from forcebound.errors import ConfigError
from forcebound.folders import runtime_folder
from forcebound.haptics.environments import Environment, check_hand
from forcebound.haptics.environments.coupling import Coupling
from forcebound.haptics.parts.signals import Signal
from forcebound.messages.packets import Vector
from forcebound.messages.topology import HAND
from forcebound.network.sockets import Network
from forcebound.quantities import POSITIVE, Force, Length, Range, Time

DEGREE = math.radians(1.0)
ONSET = 0.5  # s, over which the force comes in when the follower is seen, or seen again


class Observation(msgspec.Struct):
    """One observation of the follower on its way."""

    time_ns: int  # of the sender's monotonic clock
    numbers: dict[str, float]  # what is no image, by lerobot's names


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
        self._send(msgspec.msgpack.encode(Observation(time.monotonic_ns(), numbers)))

    def close(self) -> None:
        """Close the socket."""
        self._network.close()


def _endpoint(link: str) -> str:
    """Return where a follower's observations are: in a folder that only this user can enter."""
    folder = runtime_folder()
    if folder is None:
        raise ConfigError("this user has no private folder for the link to lerobot")
    return f"ipc://{folder}/lerobot-{link}"


@dataclass(frozen=True, kw_only=True)
class Follower(Coupling):
    """A follower that lerobot drives, coupled to the leader by spring and damper.

    Stiffness, damping, scale, offset and architecture are those of the kind ``coupling``; the
    follower is not a hand of the graph. An observation that is late, lacks a joint or has a number
    that is not finite is none.

    Attributes:
        joints: What the follower calls its joints, in the order of the leader's axes.
        unit: Angle of the leader for 1 of the follower's ``.pos``; one number, or one of each
            joint; null: 1 degree.
        zero: Angle of the leader where the follower's ``.pos`` is 0; likewise.
        effort: What the follower calls its effort, such as effort or current, for the architectures
            with a measured force; empty: it has none.
        effort_unit: Torque on what the follower touches for 1 of its effort; null: 1 N m.
        observation_age: Older observations give no force.
        link: Name of the link, if there are several pairs.
    """

    signals: ClassVar[Collection[Signal]] = (
        *Coupling.signals,
        Signal("observation_age", "s", "since the follower's last observation"),
    )

    leader: str = HAND
    follower: str = "follower"
    joints: tuple[str, ...]
    unit: OfAxes[Annotated[Length, Range()]] | None = None
    zero: OfAxes[Length] = 0.0
    effort: str = ""
    effort_unit: OfAxes[Annotated[Force, Range()]] | None = None
    observation_age: Annotated[Time, POSITIVE] = 0.2
    link: str = "lerobot"

    def __post_init__(self) -> None:
        super().__post_init__()
        if 0.0 in entries(self.units):
            raise ConfigError("unit must not be 0: no angle has a .pos then", field="unit")
        if not self.link.isidentifier():
            message = f"link must be a word of letters, digits and _, got {self.link!r}"
            raise ConfigError(message, field="link")

    @property
    def units(self) -> PerAxis:
        """Angle for 1 of a ``.pos``, in rad."""
        return DEGREE if self.unit is None else self.unit

    @property
    def efforts(self) -> PerAxis:
        """Torque for 1 of an effort, in N m."""
        return 1.0 if self.effort_unit is None else self.effort_unit

    def check_hands(self, hands: tuple[str, ...]) -> None:
        check_hand(self.leader, hands, "leader")

    def check_axes(self, axes: int) -> None:
        super().check_axes(axes)
        if len(self.joints) != axes:
            message = f"joints: expected {axes} names, one per axis, got {len(self.joints)}"
            raise ConfigError(message, field="joints")
        for field, value in (("unit", self.units), ("zero", self.zero)):
            per_axis(field, value, axes)
        per_axis("effort_unit", self.efforts, axes)

    def action(self, position: Vector) -> dict[str, float]:
        """Return what lerobot calls the position of the leader, in rad."""
        units, zeros = (per_axis("", of, len(position)) for of in (self.units, self.zero))
        each = zip(self.joints, position, zeros, units, strict=True)
        return {f"{joint}.pos": (q - zero) / unit for joint, q, zero, unit in each}

    def open(self, axes: int) -> Environment:
        return _Followed(self, super().open(axes), axes)


class _Followed(Environment):
    """An open coupling to a follower of which only observations are here."""

    def __init__(self, model: Follower, coupled: Environment, axes: int) -> None:
        self._model, self._coupled = model, coupled
        self.published = coupled.published
        self._of_axes = [per_axis("", of, axes) for of in (model.units, model.zero, model.efforts)]
        self._network = Network(linger_ms=0)
        self._subscriber = self._network.subscriber(_endpoint(model.link))
        self._decoder = msgspec.msgpack.Decoder(Observation)
        self._last: tuple[int, Vector] | None = None  # ns of the sender, rad; None: it is silent
        self._heard, self._onset = -math.inf, 0.0  # s: the last, and the first of those in a row
        self._lacking = ""

    def expect(self, users: Collection[str]) -> None:
        self._coupled.expect(users)

    def take_readings(self, user: str, buttons: int | None, measured_force: Vector | None) -> None:
        self._coupled.take_readings(user, buttons, measured_force)

    def force(self, user: str, position: Vector, velocity: Vector, elapsed: float) -> Vector:
        if user != self._model.leader:
            return (0.0,) * len(position)
        if messages := self._subscriber.receive():
            self._take(messages[-1], elapsed)
        age = elapsed - self._heard
        if self._last is not None and age > self._model.observation_age:
            self._last = None
            self._coupled.leave(self._model.follower)
            words = f"no observation of the follower for {1e3 * age:.0f} ms: no force"
            self.event("follower_silent", words, is_fault=True)
        self.signal("observation_age", age)
        share = min(max((elapsed - self._onset) / ONSET, 0.0), 1.0)
        felt = self._coupled.force(user, position, velocity, elapsed)
        return tuple([share * one for one in felt])

    def _take(self, message: bytes, elapsed: float) -> None:
        """Let the follower be where the newest observation says."""
        model = self._model
        try:
            observation = self._decoder.decode(message)
            places = [observation.numbers[f"{joint}.pos"] for joint in model.joints]
            felt = [
                -unit * observation.numbers[f"{joint}.{model.effort}"]
                for joint, unit in zip(model.joints, self._of_axes[2], strict=True)
                if model.effort
            ]
        except (KeyError, msgspec.DecodeError) as error:
            self._report(f"the follower's observation lacks {error}")
            return
        units, zeros, _ = self._of_axes
        place = tuple([z + u * p for u, z, p in zip(units, zeros, places, strict=True)])
        if not all(map(math.isfinite, (*place, *felt))):
            self._report("the follower's observation has a number that is not finite")
            return
        velocity = self._velocity(observation.time_ns, place)
        if self._last is None:
            self._onset = elapsed
            self.event("follower_seen", "the follower is observed: its force comes in")
        self._last, self._heard = (observation.time_ns, place), elapsed
        self._coupled.take_readings(model.follower, None, tuple(felt) or None)
        self._coupled.force(model.follower, place, velocity, elapsed)

    def _velocity(self, time_ns: int, place: Vector) -> Vector:
        """Return the mean velocity since the observation before, in rad/s."""
        if self._last is None or time_ns <= self._last[0]:
            return (0.0,) * len(place)
        before_ns, before = self._last
        step = 1e-9 * (time_ns - before_ns)
        return tuple([(now - then) / step for now, then in zip(place, before, strict=True)])

    def _report(self, words: str) -> None:
        """Report what an observation lacks, when that is another thing than before."""
        if words != self._lacking:
            self._lacking = words
            self.event("observation_refused", words, is_fault=True)

    def leave(self, user: str) -> None:
        self._coupled.leave(user)

    def close(self) -> None:
        self._network.close()
