"""A controller that answers states by itself, from a plane that it estimates.

It asks the environment about every state, matches each answer with its question, measures how long
an answer takes, and lets its force fade when answers stay away: nobody else knows that the
environment is gone.
"""

from abc import abstractmethod
from dataclasses import dataclass
from typing import Annotated, ClassVar

from forcebound.haptics.controllers import Controller, ControllerModel
from forcebound.haptics.controllers.plane import Asked, PlaneEstimator
from forcebound.messages.packets import DeviceState, EnvironmentReply, Vector
from forcebound.quantities import NOT_NEGATIVE, POSITIVE, Ranged, Time

REMEMBERED = 4096  # questions that are kept; at 4 kHz those of one second
ROUND_TRIP_SHARE = 0.05  # weight of a new round trip in their mean


def has_restarted(before: DeviceState, state: DeviceState) -> bool:
    """Return whether the device counts its ticks from 0 again; a late state is older, too."""
    return state.seq < before.seq and state.time_ns > before.time_ns


@dataclass(frozen=True, kw_only=True)
class EstimatingModel(Ranged, ControllerModel):
    """Times that such a controller waits for the environment.

    Attributes:
        hold: Silence of the environment after which the force fades.
        fade: Time in which it does.
        age_limit: An answer that has taken longer is ignored.
        release: Time of force-free answers behind a surface after which the surface is gone.
    """

    hold: Annotated[Time, POSITIVE] = 0.1
    fade: Annotated[Time, POSITIVE] = 0.05
    age_limit: Annotated[Time, POSITIVE] = 0.5
    release: Annotated[Time, NOT_NEGATIVE] = 0.005

    answers_states: ClassVar[bool] = True


class EstimatingController(Controller):
    """Part of such a controller; times are of the controller's clock, in ns."""

    def __init__(self, timeouts: EstimatingModel) -> None:
        self._timeouts = timeouts
        self._state: DeviceState | None = None  # the newest
        self._time_ns = 0  # when it came
        self._forget()

    def _forget(self) -> None:
        """Begin as if the environment had never answered."""
        self._estimator = self._new_estimator()
        self._asked: dict[int, tuple[Asked, int]] = {}  # by tick, with the time of asking
        self._newest = -1  # tick that was answered
        self._heard_ns: int | None = None
        self._mean_round_trip = 0.0

    def on_state(self, state: DeviceState, time_ns: int) -> Vector | None:
        """Return the force of the estimate; None until there is an answer, and in silence."""
        dt = 0.0
        if self._state is not None:
            dt = (state.time_ns - self._state.time_ns) * 1e-9
            if has_restarted(self._state, state):
                self._forget()
        self._state, self._time_ns = state, time_ns
        share = 0.0
        if self._heard_ns is not None:
            silence = (time_ns - self._heard_ns) * 1e-9
            share = 1.0 - (silence - self._timeouts.hold) / self._timeouts.fade
            if share <= 0.0:
                self._forget()
        if self._heard_ns is None:
            return None
        force = self._force(state, dt)
        return force if share >= 1.0 else tuple([share * f for f in force])

    def query(self, state: DeviceState) -> tuple[Vector, Vector]:
        position, velocity = self._question(state)
        self._asked[state.seq] = Asked(position, velocity, state.time_ns), self._time_ns
        if len(self._asked) > REMEMBERED:
            del self._asked[next(iter(self._asked))]
        return position, velocity

    def on_reply(self, reply: EnvironmentReply, time_ns: int) -> None:
        """Learn from an answer that is not too old, the second one, or older than another."""
        known = self._asked.pop(reply.device_seq, None)
        if known is None:
            return
        asked, asked_ns = known
        round_trip = (time_ns - asked_ns) * 1e-9
        if round_trip > self._timeouts.age_limit:
            return
        share = 1.0 if self._heard_ns is None else ROUND_TRIP_SHARE
        self._mean_round_trip += share * (round_trip - self._mean_round_trip)
        self._heard_ns = time_ns
        if reply.device_seq >= self._newest:
            self._newest = reply.device_seq
            self._learn(asked, reply)

    def _round_trip(self) -> float:
        """The time that an answer takes, in s; before the first one: at least."""
        if self._heard_ns is None and self._asked:
            _, first_ns = next(iter(self._asked.values()))
            return (self._time_ns - first_ns) * 1e-9
        return self._mean_round_trip

    @abstractmethod
    def _new_estimator(self) -> PlaneEstimator: ...

    @abstractmethod
    def _force(self, state: DeviceState, dt: float) -> Vector:
        """The force at a state, in N, ``dt`` s after the one before."""

    @abstractmethod
    def _question(self, state: DeviceState) -> tuple[Vector, Vector]:
        """The position, in m, and velocity, in m/s, to ask about."""

    def _learn(self, asked: Asked, reply: EnvironmentReply) -> None:
        self._estimator.take(asked, reply.force, reply.contact)
