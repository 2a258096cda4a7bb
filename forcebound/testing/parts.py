"""One part of each kind, to test others with and to copy; each has every kind of parameter.

That is a quantity with a unit, a range, a choice, a list, a flag, and one that may be missing. A
law has no parameters: the numbers that it uses are those of the device.
"""

import math
from dataclasses import dataclass
from typing import Annotated, Literal

from forcebound.haptics.controllers import Controller, ControllerModel
from forcebound.haptics.devices import AxesModel, Device
from forcebound.haptics.environments import Environment, EnvironmentModel
from forcebound.haptics.hands import Operator
from forcebound.haptics.laws import BoundingLaw, DeviceConstants, Sample
from forcebound.haptics.laws.aol import AOL
from forcebound.haptics.laws.bounder import saturated
from forcebound.haptics.laws.dissipation import DampingOfAxes, FrictionOfAxes, LengthOfAxes
from forcebound.haptics.parts.signals import Signal
from forcebound.messages.packets import Contact, DeviceState, EnvironmentReply, SceneObject, Vector
from forcebound.quantities import POSITIVE, Damping, Force, Length, Range, Ratio, Stiffness


@dataclass(frozen=True)
class Pad(EnvironmentModel):
    """A soft wall across the first axis, which may become stiffer further in.

    Attributes:
        position: Of its surface.
        stiffness: Of each layer.
        layers: Depths at which another layer begins.
        damping: Of motion inside; null: none.
        damps: Which motion.
        reports_contact: Whether it says where it is touched.
    """

    signals = (Signal("depth", "m", "depth in the pad"),)

    position: Length = 0.010
    stiffness: Annotated[Stiffness, POSITIVE] = 1000.0
    layers: tuple[Length, ...] = ()
    damping: Annotated[Damping, POSITIVE] | None = None
    damps: Literal["inwards", "always"] = "inwards"
    reports_contact: bool = True

    def open(self, axes: int) -> "TouchedPad":
        return TouchedPad(self)


class TouchedPad(Environment):
    """A pad, and where it is touched."""

    def __init__(self, pad: Pad) -> None:
        self.pad = pad
        self.touched: Contact | None = None

    def force(self, user: str, position: Vector, velocity: Vector, elapsed: float) -> Vector:
        pad, still = self.pad, (0.0,) * (len(position) - 1)
        depth = max(position[0] - pad.position, 0.0)
        self.signal("depth", depth)
        self.touched = None
        if depth == 0.0:
            return (0.0, *still)
        if pad.reports_contact:
            self.touched = Contact((pad.position, *position[1:]), (-1.0, *still))
        push = pad.stiffness * sum(max(depth - layer, 0.0) for layer in (0.0, *pad.layers))
        if pad.damping is not None and (pad.damps == "always" or velocity[0] > 0.0):
            push += pad.damping * velocity[0]
        return (push, *still)

    def contact(self, user: str) -> Contact | None:
        return self.touched

    def scene(self) -> tuple[SceneObject, ...]:
        return (SceneObject("pad", "plane", (self.pad.position, 0.0, 0.0)),)


@dataclass(frozen=True, kw_only=True)
class Handle(AxesModel):
    """A handle that a test moves, and that keeps the forces that were written.

    Attributes:
        start: Where it is when it is opened; no entries: at 0.
        has_stamps: Whether it says when it was read and written.
    """

    axes: int = 1
    damping: DampingOfAxes = 0.27
    friction: FrictionOfAxes = 0.12
    resolution: LengthOfAxes = 0.0  # exact: it returns where it was moved
    saturation: Annotated[Force, POSITIVE] = 8.5
    watchdog: Literal["silent", "none"] = "silent"
    watchdog_tolerance: Annotated[Ratio, Range(at_least=0, below=1)] | None = 0.1
    start: tuple[Length, ...] = ()
    has_stamps: bool = False

    def open(self, operator: Operator | None, hold_limit: float) -> "OpenHandle":
        return OpenHandle(self)


class OpenHandle(Device):
    """The handle.

    Attributes:
        position: Where it is, in m; a test sets it.
        written: Times, in ns, and forces, in N, that were written.
        engaged_ns: When the run has begun.
        closed: How often it was closed.
    """

    def __init__(self, model: Handle) -> None:
        self.model = model
        self.axes = model.axes
        self.position: Vector = model.start or (0.0,) * model.axes
        self.written: list[tuple[int, Vector]] = []
        self.engaged_ns: int | None = None
        self.closed = self._read_ns = self._written_ns = 0

    def engage(self, time_ns: int) -> None:
        self.engaged_ns = time_ns

    def read(self, time_ns: int) -> Vector:
        self._read_ns = time_ns
        return self.position

    def write(self, time_ns: int, force: Vector) -> Vector:
        self._written_ns = time_ns
        self.written.append((time_ns, force))
        return saturated(force, self.model.saturation)

    def stamps(self) -> tuple[int, int] | None:
        return (self._read_ns, self._written_ns) if self.model.has_stamps else None

    def close(self) -> None:
        self.closed += 1


@dataclass(frozen=True)
class Passing(ControllerModel):
    """Passes the environment's force on, scaled.

    Attributes:
        gain: Of the force.
        gains: Of the force on each axis, beside ``gain``; no entries: 1.
        largest: No force is larger; null: any.
        answers: What it answers: replies at once, or each state with the newest reply.
        counts: Whether it publishes how many replies have come.
    """

    signals = (Signal("replies"),)

    gain: Annotated[Ratio, Range(at_least=0, at_most=10)] = 1.0
    gains: tuple[Ratio, ...] = ()
    largest: Annotated[Force, POSITIVE] | None = None
    answers: Literal["replies", "states"] = "replies"
    counts: bool = True

    def open(self, axes: int) -> "OpenPassing":
        return OpenPassing(self, self.gains or (1.0,) * axes)


class OpenPassing(Controller):
    """The controller, with the newest force of the environment."""

    def __init__(self, model: Passing, gains: Vector) -> None:
        self.model, self.gains, self.replies = model, gains, 0
        self.force: Vector | None = None

    def query(self, state: DeviceState) -> tuple[Vector, Vector]:
        return state.position, state.velocity

    def on_state(self, state: DeviceState, time_ns: int) -> Vector | None:
        return self.force if self.model.answers == "states" else None

    def on_reply(self, reply: EnvironmentReply, time_ns: int) -> Vector | None:
        self.replies += 1
        if self.model.counts:
            self.signal("replies", self.replies)
        pairs = zip(self.gains, reply.force, strict=True)
        force = tuple(self.model.gain * gain * f for gain, f in pairs)
        self.force = saturated(force, self.model.largest or math.inf)
        return self.force if self.model.answers == "replies" else None


_exact = AOL.limit


def _half(state: float, sample: Sample, device: DeviceConstants) -> tuple[float, float, float]:
    energy, force, damping = _exact(state, sample, device)
    return energy, 0.5 * force, damping


#: A law: half of the force that the exact causal bound allows.
HALF = BoundingLaw(summary="half of the exact causal bound", limit=_half)
