"""A device that a program of its user's drives: positions out of it, torques into it.

All calls are made in one thread, one after the other, each with the times before and after it. A
reading was latched at the earliest when its call began, and by as much later as the call took
longer than the quickest; a torque acts when its call has returned, and ``write_latency`` later.

A call that fails or does not return in time is a DeviceError, once. The node then writes zero and
closes the device: zero torque, then ``stop``, whatever came before.
"""

import logging
import math
import os
import queue
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from operator import mul
from typing import Annotated, Any, ClassVar, NamedTuple

from forcebound.errors import DeviceError
from forcebound.haptics.devices import Device, JointsModel
from forcebound.haptics.laws import Watchdog
from forcebound.haptics.laws.bounder import saturated
from forcebound.haptics.laws.dissipation import OfAxes, PerAxis, per_axis
from forcebound.haptics.parts.signals import Signal
from forcebound.haptics.parts.user_module import describe_user_error
from forcebound.messages.packets import MAX_AXES, Vector
from forcebound.quantities import NOT_NEGATIVE, POSITIVE, Angle, Range, Time, Torque

FIRST_CALLS = 10  # without force, for the quickest call
GRACE = 1.0  # s, for a call when the device is closed
HANGING = 0.1  # s, for one that hangs then
SIGNALS = {"velocities": "velocity", "currents": "current"}  # of joints 1, 2, ..., as published
SIGNALS_OF_JOINTS = tuple(
    Signal(f"{name}_{joint}", unit)
    for name, unit in (("velocity", "rad/s"), ("current", "A"))
    for joint in range(1, MAX_AXES + 1)
)

_logger = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class LimitedJoints(JointsModel):
    """Stated limits of joints.

    Attributes:
        torque_limit: Largest torque of a joint, beside the saturation of all; one number, or one of
            each; null: the saturation.
        lower: Least position of a joint: no torque pushes it further there; one number, or one of
            each; null: none.
        upper: Largest position, likewise.
    """

    torque_limit: OfAxes[Annotated[Torque, POSITIVE]] | None = None
    lower: OfAxes[Annotated[Angle, Range()]] | None = None
    upper: OfAxes[Annotated[Angle, Range()]] | None = None

    def of_joints(self, name: str, absent: float) -> Vector:
        """Return a number of each joint; ConfigError if there are others."""
        value: PerAxis | None = getattr(self, name)
        return per_axis(name, absent if value is None else value, self.axes)

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("torque_limit", "lower", "upper"):
            self.of_joints(name, 0.0)

    @property
    def largest_torques(self) -> Vector:
        """Of each joint, in N m."""
        return tuple([min(t, self.saturation) for t in self.of_joints("torque_limit", math.inf)])

    def torques(self) -> Callable[[Vector, Vector], Vector]:
        """Return what limits forces that resist at a reading to torques that accelerate, in N m."""
        lower, upper = self.of_joints("lower", -math.inf), self.of_joints("upper", math.inf)
        limits = tuple(zip(self.largest_torques, lower, upper, strict=True))

        def torques(force: Vector, reading: Vector) -> Vector:
            allowed = []
            for resisting, at, (limit, least, most) in zip(
                saturated(force, self.saturation), reading, limits, strict=True
            ):
                torque = min(max(-resisting, -limit), limit)
                if (at >= most and torque > 0.0) or (at <= least and torque < 0.0):
                    torque = 0.0
                allowed.append(torque)
            return tuple(allowed)

        return torques


@dataclass(frozen=True, kw_only=True)
class DrivenModel(LimitedJoints):
    """Stated numbers and limits of such a device.

    Attributes:
        timeout: A call that takes longer ends the run.
        write_latency: Longest time from the return of a write until the motors have its torques, as
            of bytes that still wait for the line.
    """

    simulated_in: ClassVar[str] = "joint_arms"
    signals = SIGNALS_OF_JOINTS

    watchdog: Watchdog = "none"
    timeout: Annotated[Time, POSITIVE] = 0.05
    write_latency: Annotated[Time, NOT_NEGATIVE] = 0.0


class Called(NamedTuple):
    """What a call has returned, and when it began and ended, in ns."""

    answer: Any
    began_ns: int
    ended_ns: int


class Units(NamedTuple):
    """Units of a program, per joint: rad (or m) of one of its positions, its commands per N m."""

    positions: Vector
    commands: Vector
    are_counts: bool = False  # commands are whole numbers


class Caller:
    """Calls the user's code in a thread of its own, since it may hang; ``timeout`` in s."""

    def __init__(self, timeout: float) -> None:
        self._timeout, self._stuck = timeout, ""
        self._asked: queue.SimpleQueue[Any] = queue.SimpleQueue()
        self._answers: queue.SimpleQueue[Any] = queue.SimpleQueue()
        threading.Thread(target=self._serve, name="robot", daemon=True).start()

    def call(
        self, name: str, what: Callable[..., Any], *arguments: Any, timeout: float | None = None
    ) -> Called:
        """Return what a call returns; DeviceError if it fails or takes too long."""
        timeout = timeout or self._timeout
        if self._stuck:
            raise DeviceError(f"{self._stuck} has not returned yet, so {name} cannot be called")
        self._asked.put((what, arguments))
        try:
            called, error = self._answers.get(timeout=timeout)
        except queue.Empty:
            self._stuck = name
            raise DeviceError(
                f"{name} has not returned for {1e3 * timeout:g} ms (device.timeout): look at the"
                " bus and the power of the robot"
            ) from None
        if error is not None:
            words = str(error) if isinstance(error, DeviceError) else describe_user_error(error)
            raise DeviceError(f"{name}: {words}") from error
        return Called(*called)

    def end(self) -> None:
        """Let the thread end, when its last call has returned."""
        self._asked.put(None)

    def waits(self, seconds: float) -> bool:
        """Return whether a call still hangs, after so many s at most."""
        if self._stuck:
            with suppress(queue.Empty):
                self._answers.get(timeout=seconds)
                self._stuck = ""
        return bool(self._stuck)

    def _serve(self) -> None:
        while (asked := self._asked.get()) is not None:
            what, arguments = asked
            answer, failure, began_ns = None, None, time.monotonic_ns()
            try:
                answer = what(*arguments)
            except BaseException as error:  # also of a class that calls exit()
                failure = error
            self._answers.put(((answer, began_ns, time.monotonic_ns()), failure))


class OpenDriven(Device):
    """The device from open to close; ``robot`` has the methods of a user's class.

    DeviceError if one is missing, or fails.
    """

    def __init__(self, model: DrivenModel, caller: Caller, robot: Any, units: Units) -> None:
        self._caller, self._robot, self._units = caller, robot, units
        self._name = type(robot).__name__
        self.axes, self._names, self._torques = model.axes, model.joints, model.torques()
        self._latency_ns = round(1e9 * model.write_latency)
        self._more = [name for name in ("velocities", "currents") if hasattr(robot, f"get_{name}")]
        self._reading: Vector = ()
        self._read_ns = self._effect_ns = self._jitter_ns = 0
        self._quickest_ns = 1_000_000_000
        try:
            for name in ("get_positions", "set_torques"):
                if not callable(getattr(robot, name, None)):
                    raise DeviceError(f"class {self._name} has no method {name}")
            for _ in range(FIRST_CALLS):
                self.read(0)
                self.write(0, (0.0,) * self.axes)
        except BaseException:
            self.close()
            raise

    def engage(self, time_ns: int) -> None:
        """Let the thread of the calls run as this one does: on its cores, with its priority."""
        self._caller.call("the scheduler", _run_as, threading.get_native_id())

    def read(self, time_ns: int) -> Vector:
        name = f"{self._name}.get_positions"
        (positions, *more), began_ns, ended_ns = self._caller.call(name, self._ask)
        self._reading = tuple(map(mul, self._numbers(name, positions), self._units.positions))
        took_ns = ended_ns - began_ns
        self._quickest_ns = min(self._quickest_ns, took_ns)
        self._read_ns, self._jitter_ns = began_ns, took_ns - self._quickest_ns
        for what, values in zip(self._more, more, strict=True):
            numbers = self._numbers(f"{self._name}.get_{what}", values)
            if what == "velocities":
                numbers = tuple(map(mul, numbers, self._units.positions))
            for joint, number in enumerate(numbers, start=1):
                self.signal(f"{SIGNALS[what]}_{joint}", number)
        return self._reading

    def write(self, time_ns: int, force: Vector) -> Vector:
        """Hold torques, in N m, or less: within the limits of each joint, in whole counts."""
        commands, held = [], []
        torques = self._torques(force, self._reading)
        for torque, per_torque in zip(torques, self._units.commands, strict=True):
            command = torque * per_torque
            if self._units.are_counts:
                command = int(command)
                torque = command / per_torque
            commands.append(command)
            held.append(-torque + 0.0)
        called = self._caller.call(f"{self._name}.set_torques", self._robot.set_torques, commands)
        self._effect_ns = called.ended_ns + self._latency_ns
        return tuple(held)

    def stamps(self) -> tuple[int, int]:
        return self._read_ns, max(self._effect_ns, self._read_ns)

    def latch_jitter(self) -> int:
        return self._jitter_ns

    def close(self) -> None:
        """Write zero torque and call ``stop``, whatever came before."""
        zero, stop = [0.0] * self.axes, getattr(self._robot, "stop", None)
        calls = [("set_torques", self._robot.set_torques, [zero])] if self._reading else []
        calls += [("stop", stop, [])] if callable(stop) else []
        if self._caller.waits(HANGING):
            _logger.warning("%s: a call hangs, so `stop` is called beside it", self._name)
            self._caller.end()
            self._caller, calls = Caller(GRACE), calls[-1:]
        for name, what, arguments in calls:
            try:
                self._caller.call(f"{self._name}.{name}", what, *arguments, timeout=GRACE)
            except DeviceError as error:
                _logger.warning("at the end: %s", error)
        self._caller.end()

    def _ask(self) -> list[Any]:
        return [getattr(self._robot, f"get_{name}")() for name in ("positions", *self._more)]

    def _numbers(self, name: str, values: Any) -> Vector:
        try:
            numbers = tuple(map(float, values))
        except Exception:  # of any kind, by a value of any type
            numbers = ()
        if len(numbers) != self.axes or not all(map(math.isfinite, numbers)):
            expected = f"{self.axes} finite numbers ({', '.join(self._names)})"
            raise DeviceError(f"{name}: expected {expected}, got {values!r}")
        return numbers


def _run_as(thread: int) -> None:
    os.sched_setaffinity(0, os.sched_getaffinity(thread))
    with suppress(OSError):  # without the right to it, as punctual as before
        os.sched_setscheduler(0, os.sched_getscheduler(thread), os.sched_getparam(thread))
