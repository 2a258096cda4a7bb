"""A controller that knows a plane near the hand, and answers for an environment that is far away.

For each state of the device the force is that of a local plane, at once: the loop over the device
has no delay, however far the environment is. The environment is asked about the place where the
hand will be when the answer is back; ``docs/controllers.md`` says how the plane is estimated, shown
and forgotten.

Source: model-mediated teleoperation, Hannaford 1989; Mitra and Niemeyer, IJRR 27(2), 2008.
"""

import math
from collections import deque
from dataclasses import dataclass
from typing import Annotated, Literal

from forcebound.haptics.controllers import Controller
from forcebound.haptics.controllers.exchange import Exchange, ReplyTimeouts, has_restarted
from forcebound.haptics.controllers.plane import Asked, PlaneEstimator
from forcebound.haptics.controllers.shown_plane import ShownPlane
from forcebound.haptics.controllers.vectors import along
from forcebound.messages.packets import DeviceState, EnvironmentReply, Vector
from forcebound.quantities import (
    NOT_NEGATIVE,
    POSITIVE,
    Length,
    Power,
    Range,
    Ratio,
    Stiffness,
    Time,
)

VELOCITY_STATES = 16  # that give the velocity for looking ahead: one step of the encoder is then
#                       2 mm/s at 1 kHz
LEAD_SHARE, LEAD = 1.5, 0.01  # in round trips, and in s: the hand may speed up meanwhile
MICROMETRE = 1e-6


@dataclass(frozen=True)
class LocalModel(ReplyTimeouts):
    """Parameters of the local model.

    Attributes:
        prediction: Source of the force: plane; or, for comparison, hold: the newest answer as it
            is. With ahead: 0 that is a zero-order hold, with ahead: auto a phase-compensated one.
        ahead: Time by which the environment is asked ahead of the hand; auto: until the answer is
            back, and in free motion half as long again and 10 ms.
        reach: Longest distance ahead of the hand at which the environment is asked.
        margin: Greatest depth below a known surface at which it is asked, unless the hand is
            deeper.
        power: Largest power that changes of the shown plane may deliver to the hand.
        forgetting: Weight that older pairs of answers keep with each new one.
        stiffest: Largest stiffness that the estimate may take.
    """

    prediction: Literal["plane", "hold"] = "plane"
    ahead: Literal["auto"] | Annotated[Time, NOT_NEGATIVE] = "auto"
    reach: Annotated[Length, NOT_NEGATIVE] = 0.03
    margin: Annotated[Length, POSITIVE] = 0.001
    power: Annotated[Power, NOT_NEGATIVE] = 0.005
    forgetting: Annotated[Ratio, Range(above=0, at_most=1)] = 0.9
    stiffest: Annotated[Stiffness, POSITIVE] = 1e5

    def open(self, axes: int) -> "OpenLocalModel":
        """Return a new controller, without an estimate."""
        return OpenLocalModel(self, axes)


class OpenLocalModel(Controller):
    """The running controller: the model's parameters and its current estimate."""

    def __init__(self, model: LocalModel, axes: int) -> None:
        self._model = model
        self._zero: Vector = (0.0,) * axes
        self._states: deque[DeviceState] = deque(maxlen=VELOCITY_STATES)
        self._time_ns = 0  # of the newest state, controller's clock
        self._forget()

    def _forget(self) -> None:
        model = self._model
        self._exchange = Exchange(model)
        self._estimator = PlaneEstimator(model.forgetting, model.stiffest, model.release)
        self._shown = ShownPlane(model.power, len(self._zero))
        self._answer: Vector | None = None  # N, the newest

    def on_state(self, state: DeviceState, time_ns: int) -> Vector | None:
        """Return the force of the shown plane; None without a living environment."""
        if self._states and has_restarted(self._states[-1], state):
            self._states.clear()
            self._forget()
        dt = (state.time_ns - self._states[-1].time_ns) * 1e-9 if self._states else 0.0
        self._states.append(state)
        self._time_ns = time_ns
        if self._answer is None:
            return None
        share = self._exchange.share(time_ns)
        if share == 0.0:
            self._forget()
            return None
        force = self._answer
        if self._model.prediction == "plane":
            plane = self._estimator.plane
            force = self._zero
            if plane is None:
                self._shown.forget()
            else:
                force = self._shown.force(plane, state.position, state.velocity, dt)
        return force if share == 1.0 else tuple([share * f for f in force])

    def query(self, state: DeviceState) -> tuple[Vector, Vector]:
        """Return the place where the hand will be, and the device's velocity."""
        asked = Asked(self._place(state), state.velocity, state.time_ns)
        self._exchange.ask(state.seq, asked, self._time_ns)
        return asked.position, asked.velocity

    def _place(self, state: DeviceState) -> Vector:
        """The place to ask about, in m."""
        position, first = state.position, self._states[0]
        plane = self._estimator.plane if self._model.prediction == "plane" else None
        since = (state.time_ns - first.time_ns) * 1e-9
        if since <= 0.0:
            return position
        ahead = self._ahead(plane is not None and plane.depth(position) > 0.0)
        moved = along(position, first.position, -1.0)
        farthest = self._model.reach / max(math.hypot(*moved), MICROMETRE)
        place = along(position, moved, min(ahead / since, farthest))
        if plane is None:
            return place
        deepest = max(self._model.margin, plane.depth(position))
        return along(place, plane.inwards, min(deepest - plane.depth(place), 0.0))

    def _ahead(self, touches: bool) -> float:
        """How far ahead to ask, in s; in free motion longer than an answer takes."""
        if self._model.ahead != "auto":
            return self._model.ahead
        round_trip = self._exchange.round_trip(self._time_ns)
        if touches or self._model.prediction == "hold":
            return round_trip
        return LEAD_SHARE * round_trip + LEAD

    def on_reply(self, reply: EnvironmentReply, time_ns: int) -> None:
        """Learn from an answer."""
        asked = self._exchange.take(reply, time_ns)
        if asked is not None:
            self._answer = reply.force
            self._estimator.take(asked, reply.force, reply.contact)
