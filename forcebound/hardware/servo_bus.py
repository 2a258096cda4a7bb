"""Servos on a bus, one for each joint: what Dynamixel and Feetech have in common.

A tick has one request for the registers of all servos, which answer one after the other, and one
order with their goals, which none answers. Behind the order one servo, in turn, is asked for the
goal that it has, and for a register that shows that it is on; its answer is there before the next
request. So an order that was lost is found in the same tick, and a servo that was reset, or whose
watchdog has fired, after as many ticks as there are servos.

The motors are switched on with the first force, and off by whatever ends the run. What goes wrong
ends in zero force and a DeviceError, once, as :mod:`forcebound.hardware.line` has it: a servo that
is silent or says that it has an error; a packet that is spoiled or nobody's; a register that is not
as it was set; a guardian that had to step in.

**Stamps.** A servo takes its goal, and latches its reading, at the same place of each message, so
its times are shifted alike, whatever that place is. What varies is the time that a request takes
longer than the quickest one, and the phase of the servo's own cycle c, in which it takes a new goal
and latches a new reading: a goal that has come at g acts by g + c, its stamp, and a reading asked
for at a is not older than a - c. Goals and requests stay in order on the bus. So a reading is after
a goal that came before it, if the answer comes c later at least; it is stamped no earlier than that
goal then, and may be later than its stamp by the time from g to a, too. Else the goal acts later.
"""

import logging
import math
import time
from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import cycle
from typing import Annotated, Any, ClassVar

from forcebound.axes import OfAxes, per_axis
from forcebound.errors import ConfigError, DeviceError
from forcebound.haptics.devices import Source
from forcebound.haptics.devices.joint_device import JointBodies
from forcebound.haptics.devices.true_values import TrueServos
from forcebound.haptics.hands import Operator
from forcebound.haptics.laws.dissipation import AngleOfJoints, DampingOfJoints, TorqueOfJoints
from forcebound.hardware.driven import LimitedJoints
from forcebound.hardware.dynamixel_frames import Status
from forcebound.hardware.line import Line
from forcebound.hardware.serial_device import (
    FIRST_EXCHANGES,
    SerialDevice,
    SerialNumbers,
)
from forcebound.hardware.servo_models import COUNTS
from forcebound.hardware.servo_requests import Bus, orders
from forcebound.messages.packets import Vector
from forcebound.quantities import POSITIVE, AngularSpeed, Name, Range, Ratio, Time, Torque

GUESSED = "damping friction presliding saturation largest_speed write_delay gain_error inertia"
BITS = 10  # on the line, of a byte
LOST = "has not the goal that was written: the order was lost, or it refuses it"

_logger = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class ServoBus(  # pyright: ignore[reportIncompatibleVariableOverride]
    SerialNumbers, LimitedJoints, JointBodies
):
    """Parameters of servos on a bus.

    All is assumed but the resolution, damping and friction for the weakest joint of a small servo
    arm: ``forcebound identify`` measures them.

    Attributes:
        servos: Id of the servo of each joint.
        models: Of the servos, such as xl330-m288; one name, or one of each joint.
        baud: Bits a second on the bus.
        direction: 1 if larger counts of the servo are larger angles, else -1; likewise.
        zero: Position of the servo, in counts of 4096 in a turn, at which its joint is at 0 rad;
            likewise. An angle begins within half a turn of it.
        cycle: Of a servo's own control: by so much a register may be older than its answer, and a
            goal act later than it came.
        inertia: Of the emulator alone.
        truth: What the emulated servos really have, where that differs from what is stated.
    """

    known_models: ClassVar[Mapping[str, Any]]
    simulated_in: ClassVar[str] = "servo_wall"  # launch file for virtual time

    joints: tuple[str, ...] = ("base", "shoulder", "elbow", "wrist", "roll", "gripper")
    servos: tuple[Annotated[int, Range(at_least=0, at_most=252)], ...] = (1, 2, 3, 4, 5, 6)
    models: OfAxes[Name]
    baud: Annotated[int, Range(at_least=9600)] = 1_000_000
    direction: OfAxes[Annotated[Ratio, Range(at_least=-1, at_most=1)]] = 1.0
    zero: OfAxes[Annotated[Ratio, Range()]] = 2048.0
    cycle: Annotated[Time, Range(at_least=0)] = 2.5e-4
    damping: DampingOfJoints = 0.01
    friction: TorqueOfJoints = 0.04
    resolution: AngleOfJoints = math.tau / COUNTS  # data sheet
    saturation: Annotated[Torque, POSITIVE] = 0.5
    largest_speed: Annotated[AngularSpeed, POSITIVE] | None = 30.0  # without load: 11
    write_delay: Annotated[Time, Range(at_least=0)] = 5e-3  # one reading in a tick, at 300 Hz
    truth: TrueServos | None = None
    sources: Mapping[str, Source] = field(
        default_factory=lambda: dict.fromkeys([*GUESSED.split(), "cycle"], "assumed"), hash=False
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        known, names = ", ".join(self.known_models), self.named_models
        wrong = [name for name in names if name not in self.known_models]
        if wrong or len(names) != self.axes:
            each = f"one, or one of each of {self.axes} joints, of {known}, got {', '.join(names)}"
            raise ConfigError(f"models: expected {each}", field="models")
        for refused in filter(None, map(self.refused, names)):
            raise ConfigError(f"models: {refused}", field="models")
        if not len(set(self.servos)) == len(self.servos) == self.axes:
            ids = f"an id for each of {self.axes} joints, none twice, got {self.servos}"
            raise ConfigError(f"servos: expected {ids}", field="servos")
        if not {-1.0, 1.0}.issuperset(self.of_joints("direction", 1.0)):
            words = f"direction: expected 1 or -1, got {self.direction}"
            raise ConfigError(words, field="direction")
        self.of_joints("zero", 0.0)
        if len(self.constants) != self.axes:
            raise ConfigError("expected the torque of each joint, or one of all")

    @property
    def named_models(self) -> tuple[str, ...]:
        """Name of each servo's model."""
        return (self.models,) * self.axes if isinstance(self.models, str) else self.models

    @property
    def types(self) -> tuple[Any, ...]:
        """Numbers of each servo's model."""
        return tuple([self.known_models[name] for name in self.named_models])

    def refused(self, name: str) -> str:
        """Return why a model cannot be used, in words; empty: it can."""
        return ""

    @property
    @abstractmethod
    def constants(self) -> Vector:
        """Torque of each joint for the unit of its goals, in N m for an A, or for the full duty."""

    @property
    def named_servos(self) -> Mapping[int, str]:
        """By id: the servo in words."""
        pairs = zip(self.servos, self.joints, strict=True)
        return {servo: f"servo {servo} ({joint})" for servo, joint in pairs}

    def opened(self, kind: "type[OpenServos]", operator: Operator | None) -> "OpenServos":
        """Return the open device of a kind, on a line of its own."""
        zero, reply = kind.rest(self)
        with self.line(zero, operator, self.baud, reply) as line:
            return kind(self, line)


class OpenServos(SerialDevice):
    """Servos on a line, from open to close; DeviceError if one is not as the model states."""

    is_exchange = False
    frames: ClassVar[Any]
    goal: ClassVar[int]  # register, of two bytes, that sets the force
    polled: ClassVar[tuple[int, int]]  # registers of every tick: first, and how many bytes
    shown: ClassVar[tuple[int, int]]  # of one servo: the first says that it is on, its goal is last

    def __init__(
        self,
        model: ServoBus,
        line: Line,
        clock: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self.bus = Bus(line, model.reply_within, clock, self.frames, model.named_servos)
        super().__init__(line, self.bus, model.reply_within, clock)
        self.model, self.axes, self._torques = model, model.axes, model.torques()
        self._directions = model.of_joints("direction", 1.0)
        self._zeros = self._counts = model.of_joints("zero", 0.0)
        self._per_torque = self.goals_per_torque()
        self._driven = [s for s, one in zip(model.servos, self._per_torque, strict=True) if one]
        self._ask_all = self.frames.sync_read(bytes(model.servos), *self.polled)
        self._cycle_ns = round(1e9 * model.cycle)
        self._asking_ns = round(1e9 * BITS * len(self._ask_all) / model.baud)
        self._held: Vector = (0.0,) * model.axes
        self._is_on = False
        self._turns = cycle(self._driven)
        self._look: tuple[int, bytes] | None = None  # servo and goal, if the answer is to be taken
        self.bus.ask("begin", self.rest(model)[0], model.servos[:1])
        for joint in range(model.axes):
            self.set_up(joint)
        for _ in range(FIRST_EXCHANGES):
            self.read(0)
        self._line_ns = round(1e9 * BITS * len(self._goals([0] * self.axes)) / model.baud)
        self.bus.longest_wait = line.silence
        self.bus.restart()

    @classmethod
    @abstractmethod
    def rest(cls, model: Any) -> tuple[bytes, int]:
        """Return the message of zero force, motors off, and how many bytes answer it."""

    @abstractmethod
    def goals_per_torque(self) -> Vector:
        """Return what the goal register of each joint has for a N m; 0: it gives no force."""

    @abstractmethod
    def while_on(self) -> tuple[int, str]:
        """Return what the first register shown has while a servo is on, and words if not."""

    @abstractmethod
    def set_up(self, joint: int) -> None:
        """Check a servo, and set it up; its motor is off."""

    @abstractmethod
    def switched_on(self) -> bytes:
        """Return orders without an answer that switch the motors on."""

    @abstractmethod
    def encoded(self, goal: int) -> bytes:
        """Return a goal as its register has it."""

    @abstractmethod
    def counts(self, joint: int, values: bytes) -> float:
        """Return the position of a joint in its polled registers, after a look at the others."""

    @abstractmethod
    def explained(self, servo: int, error: int) -> str:
        """Return the error byte of a status in words; the force is zero."""

    def check_model(self, joint: int, number: int) -> None:
        """Check the model number of a servo; DeviceError if it is of another model."""
        if number != self.model.types[joint].number:
            known = {one.number: name for name, one in self.model.known_models.items()}
            name, stated = self.bus.names[self.model.servos[joint]], self.model.named_models[joint]
            found = known.get(number, "of an unknown model")
            then = self.model.refused(found) or "state its models"
            words = f"{name} is {found} (model number {number}), expected {stated}: {then}"
            self.bus.end(DeviceError(words))

    def read(self, time_ns: int) -> Vector:
        self._take_look()
        has_force, before_ns = any(self._held), self._read_ns
        exchange = self.bus.ask("read", self._ask_all, self.model.servos, has_force)
        if exchange.sent_ns - before_ns > 1e9 * self.bus.longest_wait and not has_force:
            self._is_on = False  # after a pause, in which a watchdog may have fired
        counts = []
        for joint, status in enumerate(exchange.reply):
            self._check(status, self.polled[1])
            found, before = self.counts(joint, status.values), self._counts[joint]
            # By half a turn at most, which is also how a servo's position wraps.
            counts.append(before + (found - before + COUNTS / 2) % COUNTS - COUNTS / 2)
        self._counts = tuple(counts)
        self._stamp(exchange.sent_ns, exchange.excess_ns)
        places = zip(self._directions, counts, self._zeros, strict=True)
        self._angles = tuple([d * (at - zero) * math.tau / COUNTS for d, at, zero in places])
        return self._angles

    def write(self, time_ns: int, force: Vector) -> Vector:
        """Hold torques, in N m, or less: within the limits of each joint, in whole goals."""
        if self._line.is_at_rest and not any(force):
            return force  # the last zero after a failure, which was written then
        self._take_look()
        torques = zip(self._torques(force, self._angles), self._per_torque, strict=True)
        goals, message = [int(torque * per_torque) for torque, per_torque in torques], b""
        if not self._is_on and any(goals):
            self._is_on, message, goals = True, self.switched_on(), [0] * self.axes
        held = zip(goals, self._per_torque, strict=True)
        self._held = tuple([-goal / one + 0.0 if one else 0.0 for goal, one in held])
        if self._is_on:
            servo = next(self._turns)
            message += self._goals(goals) + self.frames.read(servo, *self.shown)
            self.bus.order(message, any(goals))
            self._look = servo, self.encoded(goals[self.model.servos.index(servo)])
        self._effect_ns = self._clock() + self._line_ns + self._cycle_ns
        return self._held

    def _stamp(self, sent_ns: int, excess_ns: int) -> None:
        earliest_ns = sent_ns - self._cycle_ns
        self._read_ns = earliest_ns
        if sent_ns + self._asking_ns >= self._effect_ns:
            earliest_ns = max(earliest_ns, self._effect_ns - self._cycle_ns)  # the goal has come
            self._read_ns = max(self._read_ns, self._effect_ns)
        self._jitter_ns = excess_ns + sent_ns - earliest_ns

    def close(self) -> None:
        self._line.close()
        self.exchanges.log(_logger)

    def _goals(self, goals: Sequence[int]) -> bytes:
        """Return the order that sets the goals of the servos that give a force."""
        pairs = zip(self.model.servos, goals, strict=True)
        values = {servo: self.encoded(goal) for servo, goal in pairs if servo in self._driven}
        return orders(self.frames, ((self.goal, values),))

    def _take_look(self) -> None:
        """Take the answer of the servo that was asked with the last order, and check it."""
        if self._look is None:
            return
        (servo, goal), self._look = self._look, None
        status, (expected, words) = self.bus.collect(servo), self.while_on()
        self._check(status, self.shown[1])
        if status.values[0] == expected:
            if status.values[-2:] == goal:
                return
            words = LOST
        self.bus.end(DeviceError(f"{self.bus.names[servo]} {words}"))

    def _check(self, status: Status, count: int) -> None:
        if status.error:
            self.bus.order(self._goals([0] * self.axes), has_force=False)
            words = self.explained(status.servo, status.error)
        elif len(status.values) == count:
            return
        else:
            words = f"answers {len(status.values)} bytes, expected {count}"
        self.bus.end(DeviceError(f"{self.bus.names[status.servo]} {words}"))


def of_each(name: str, value: OfAxes[float] | None, axes: int, known: Sequence[float]) -> Vector:
    """Return a number of each joint, as it is stated or else ``known``; ConfigError if wrong."""
    return tuple(known) if value is None else per_axis(name, value, axes)
