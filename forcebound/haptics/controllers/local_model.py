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

from forcebound.haptics.controllers.estimating import EstimatingController, EstimatingModel
from forcebound.haptics.controllers.plane import Asked, PlaneEstimator, along
from forcebound.haptics.controllers.shown_plane import ShownPlane
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

VELOCITY_STATES = 16  # for looking ahead: one step of the encoder is then 2 mm/s at 1 kHz
LEAD_SHARE, LEAD = 1.5, 0.01  # in round trips, and in s: the hand may speed up on the way
MICROMETRE = 1e-6


@dataclass(frozen=True)
class LocalModel(EstimatingModel):
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
        return OpenLocalModel(self, axes)


class OpenLocalModel(EstimatingController):
    """The running controller: the model's parameters and its current estimate."""

    def __init__(self, model: LocalModel, axes: int) -> None:
        self._model = model
        self._zero: Vector = (0.0,) * axes
        super().__init__(model)

    def _forget(self) -> None:
        super()._forget()
        self._shown = ShownPlane(self._model.power, len(self._zero))
        self._answer = self._zero  # N, the newest
        self._states: deque[DeviceState] = deque(maxlen=VELOCITY_STATES)

    def _new_estimator(self) -> PlaneEstimator:
        model = self._model
        return PlaneEstimator(model.forgetting, model.stiffest, model.release)

    def _force(self, state: DeviceState, dt: float) -> Vector:
        if self._model.prediction == "hold":
            return self._answer
        plane = self._estimator.plane
        if plane is None:
            self._shown.forget()
            return self._zero
        return self._shown.force(plane, state.position, state.velocity, dt)

    def _question(self, state: DeviceState) -> tuple[Vector, Vector]:
        self._states.append(state)
        return self._place(state), state.velocity

    def _place(self, state: DeviceState) -> Vector:
        """The place where the hand will be, in m, not too deep behind a known surface."""
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
        """Return the time ahead to ask for, in s; in free motion longer than an answer takes."""
        if self._model.ahead != "auto":
            return self._model.ahead
        round_trip = self._round_trip()
        if touches or self._model.prediction == "hold":
            return round_trip
        return LEAD_SHARE * round_trip + LEAD

    def _learn(self, asked: Asked, reply: EnvironmentReply) -> None:
        super()._learn(asked, reply)
        self._answer = reply.force
