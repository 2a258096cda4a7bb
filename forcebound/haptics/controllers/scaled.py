r"""Workspace and force scaled, a clutch on a button, rate control beyond a border.

The device at x commands a point X in the environment, :math:`\dot X = s \dot x` and :math:`F = s_f
F_{env}(X)`; ``docs/controllers.md`` has the rest.

Source: scaling and its power: J. E. Colgate, Robust impedance shaping telemanipulation, IEEE
Transactions on Robotics and Automation 9(4), 1993; rate control beyond an elastic border: L.
Dominjon et al., The bubble technique: interacting with large virtual environments using haptic
devices with limited workspace, World Haptics 2005.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Annotated, Literal

from forcebound.haptics.controllers import Controller, ControllerModel
from forcebound.haptics.controllers.estimating import has_restarted
from forcebound.haptics.controllers.plane import along
from forcebound.messages.packets import DeviceState, EnvironmentReply, Vector
from forcebound.quantities import (
    NOT_NEGATIVE,
    Frequency,
    Length,
    Range,
    Ranged,
    Ratio,
    Stiffness,
    Time,
)

SCALE = Range(above=0, hint=", with 1 as it is")
BUTTONS = 63  # bits of the packet's number


@dataclass(frozen=True)
class Scaled(Ranged, ControllerModel):
    """Parameters of the scaling controller.

    Attributes:
        motion_scale: s, motion in the environment over motion of the device.
        force_scale: Force on the hand over force of the environment; auto: as motion_scale, so that
            the power is the same.
        origin: Point of the environment where the device's origin is at the start, on each axis
            alike.
        clutch_button: Number of the button that uncouples the device while it is down.
        engage_time: From no force to full force after the clutch.
        border: Distance from the device's origin beyond which there is rate control; 0: none.
        border_rate: g, drift over excess beyond the border.
        border_stiffness: Of the spring beyond the border.
    """

    motion_scale: Annotated[Ratio, SCALE] = 1.0
    force_scale: Literal["auto"] | Annotated[Ratio, SCALE] = "auto"
    origin: Length = 0.0
    clutch_button: Annotated[int, Range(at_least=0, below=BUTTONS)] | None = None
    engage_time: Annotated[Time, NOT_NEGATIVE] = 0.1
    border: Annotated[Length, NOT_NEGATIVE] = 0.0
    border_rate: Annotated[Frequency, NOT_NEGATIVE] = 5.0
    border_stiffness: Annotated[Stiffness, NOT_NEGATIVE] = 100.0

    @property
    def force_factor(self) -> float:
        """Force on the hand over force of the environment."""
        return self.motion_scale if self.force_scale == "auto" else self.force_scale

    def cautions(self, damping: float, period: float, delay: float) -> Sequence[str]:
        gain = self.force_factor / self.motion_scale
        if gain <= 1.0:
            return ()
        return (
            f"force_scale is {gain:.3g} times motion_scale, so the hand gets {gain:.3g} times the"
            " power of the environment: the law takes away what is too much; force_scale: auto"
            " keeps the power",
        )

    def open(self, axes: int) -> "OpenScaled":
        """Return a coupled controller at its origin."""
        return OpenScaled(self, axes)


class Clutch:
    """A button that uncouples the device while it is down, if it has a number.

    ``engage_time`` is from no force to full force, once it is up again, in s; ``warn`` publishes
    an event and its message.
    """

    def __init__(
        self, button: int | None, engage_time: float, warn: Callable[[str, str], None]
    ) -> None:
        self._button = button
        self._engage_time, self._warn = engage_time, warn
        self.is_down = False
        self._has_begun = False
        self._changed_ns: int | None = None  # when it went down or up; None: never

    def take(self, state: DeviceState) -> None:
        """Take the buttons of a state in."""
        if self._button is None:
            return
        is_down = bool((state.buttons or 0) >> self._button & 1)
        if not self._has_begun:
            self._has_begun = True
            if state.buttons is None:
                message = f"the device has no buttons, so clutch_button: {self._button} never acts"
                self._warn("no_clutch", message)
            elif is_down:
                message = (
                    f"the clutch (button {self._button}) is down at the start: there is no force of"
                    " the environment until it is let go"
                )
                self._warn("clutch_down", message)
        if is_down != self.is_down:
            self.is_down, self._changed_ns = is_down, state.time_ns

    def share(self, time_ns: int) -> float:
        """Return how much of the environment's force is shown."""
        if self.is_down:
            return 0.0
        if self._changed_ns is None or self._engage_time == 0.0:
            return 1.0
        return min((time_ns - self._changed_ns) * 1e-9 / self._engage_time, 1.0)


class OpenScaled(Controller):
    """A scaling controller with its point in the environment."""

    def __init__(self, model: Scaled, axes: int) -> None:
        self._model = model
        warn = partial(self.event, is_fault=True)
        self._clutch = Clutch(model.clutch_button, model.engage_time, warn)
        self._zero: Vector = (0.0,) * axes
        self._point: Vector | None = None  # X, m
        self._velocity = self._zero  # of X, m/s
        self._before: DeviceState | None = None
        self._excess = self._zero  # of it beyond the border, m

    def on_state(self, state: DeviceState, time_ns: int) -> None:
        """Move the point; the environment's reply brings the force."""
        model, before = self._model, self._before
        if before is None or has_restarted(before, state):
            before = state
        dt = (state.time_ns - before.time_ns) * 1e-9
        moved = along(state.position, before.position, -1.0)
        self._before = state
        self._clutch.take(state)
        distance = math.hypot(*state.position)
        excess = max(distance - model.border, 0.0) if model.border else 0.0
        self._excess = along(self._zero, state.position, excess / distance if excess else 0.0)
        scale = 0.0 if self._clutch.is_down else model.motion_scale
        drift = along(self._zero, self._excess, scale * model.border_rate)
        self._velocity = along(drift, state.velocity, scale)
        if self._point is None:
            origin = (model.origin,) * len(state.position)
            self._point = along(origin, state.position, model.motion_scale)
        else:
            self._point = along(along(self._point, moved, scale), drift, dt)

    def query(self, state: DeviceState) -> tuple[Vector, Vector]:
        """Return the point and its velocity."""
        assert self._point is not None  # on_state comes first
        return self._point, self._velocity

    def on_reply(self, reply: EnvironmentReply, time_ns: int) -> Vector:
        """Return the scaled force of the environment, and that of the border."""
        border = along(self._zero, self._excess, self._model.border_stiffness)
        share = 0.0 if self._before is None else self._clutch.share(self._before.time_ns)
        return along(border, reply.force, share * self._model.force_factor)
