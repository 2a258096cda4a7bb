"""A simulated device, and the hand on it: its time, its motor and its watchdog."""

from abc import abstractmethod
from typing import Protocol

from forcebound.haptics.devices import Device, DeviceModel, Kinematics, Truth
from forcebound.haptics.devices.motor import SimulatedMotor
from forcebound.haptics.devices.true_values import TrueAxes, TrueJoints, TrueNumbers
from forcebound.haptics.hands import Operator
from forcebound.haptics.hands.hands import NoHand
from forcebound.haptics.hands.pointer import PointerHand
from forcebound.haptics.laws.bounder import saturated
from forcebound.haptics.laws.dissipation import PerAxis, StatedAxes, per_axis
from forcebound.messages.packets import Vector


class Body(Protocol):
    """Mechanics of a device, in its hand."""

    kinematics: Kinematics | None  # of an arm; None: readings are positions of the tip
    compensation: Vector  # N, that the motor adds to every force

    def reading(self) -> Vector:
        """Return the readings of the encoders."""
        ...

    def move(self, target: Vector, target_end: Vector, duration: float, commanded: Vector) -> None:
        """Move on for ``duration`` s under a force commanded of the motor, in N (or N m).

        The hand's target moves evenly from ``target`` to ``target_end``, in m.
        """

    def brake(self, damping: Vector) -> None:
        """Add a viscous damping to its own from now on, in N s/m: of motors that brake."""

    def truth(self) -> Truth:
        """Return the ground truth."""
        ...

    def kinetic_energy(self) -> float:
        """Return that of the device without the hand's mass, in J."""
        ...


class SimulatedModel(DeviceModel):
    """Parameters of a device whose mechanics is stated: it can be simulated, or emulated."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self.true_numbers()  # a number of axes that does not fit is refused here

    @property
    @abstractmethod
    def truth(self) -> TrueAxes | TrueJoints | None:
        """True numbers, where they differ from the stated ones."""

    @property
    def force_sensor(self) -> bool:
        """True if it measures the force of the simulated hand, of its spring and damper."""
        return False

    def true_numbers(self) -> TrueNumbers:
        """Return what it truly has: what is stated, at its least favourable end, or its truth.

        Raises:
            ConfigError: If a number has neither one entry nor one for each axis; names the field.
        """
        true, axes = self.truth or TrueAxes(), self.axes

        def of_axes(name: str, value: PerAxis | None, stated: PerAxis) -> Vector:
            as_stated = per_axis(name, stated, axes)
            return as_stated if value is None else per_axis(f"truth.{name}", value, axes)

        weight: Vector = (0.0,) * axes
        if isinstance(self, StatedAxes) and isinstance(true, TrueAxes):
            weight = of_axes("weight", true.weight, self.weight)
            per_axis("weight_error", self.weight_error, axes)
        latest = 1.0 + (self.watchdog_tolerance or 0.0)
        return TrueNumbers(
            damping=of_axes("damping", true.damping, self.damping),
            friction=of_axes("friction", true.friction, self.friction),
            presliding=of_axes("presliding", true.presliding, self.presliding),
            resolution=of_axes("resolution", true.resolution, self.resolution),
            weight=weight,
            gain=of_axes("gain", true.gain, 1.0 + self.gain_error),
            lag=self.lag if true.lag is None else true.lag,
            write_delay=self.write_delay if true.write_delay is None else true.write_delay,
            watchdog=latest if true.watchdog is None else true.watchdog,
            seed=true.seed if true.random else None,
            weak_spot=true.weak_spot,
        )

    @abstractmethod
    def body(self, true: TrueNumbers, operator: Operator) -> Body:
        """Return what moves, with these true numbers, in an operator's hand.

        Raises:
            DeviceError: If the device and this hand do not go together.
        """


class SimulatedDevice(Device):
    """A device with a hand on it, whose time is that of the reads and writes.

    It starts at rest at the hand's first target and rests there until :meth:`engage`. Every read
    and write first moves the body to the given time, under the force that was held until then. A
    written force acts after the write delay; one that is too old is dropped at the very instant it
    gets too old, as the watchdog of a real device's firmware does, or guarded from then on.

    Without an operator nobody holds it.
    """

    def __init__(self, model: SimulatedModel, operator: Operator | None, hold_limit: float) -> None:
        operator = NoHand() if operator is None else operator
        true = model.true_numbers()
        self._operator = operator
        self._has_buttons = operator.buttons(0.0) is not None
        self.axes, self._saturation = model.axes, model.saturation
        self._body = model.body(true, operator)
        self.kinematics = self._body.kinematics
        self._gain = true.gain
        self._compensation = self._body.compensation
        self._scales = any(g != 1.0 for g in self._gain) or any(self._compensation)
        self._motor = SimulatedMotor(model, true, hold_limit, self._motor_force((0.0,) * self.axes))
        self._has_sensor = model.force_sensor
        self._reports_cuts = model.watchdog in ("guarding", "reporting")
        self._reading_at_cut = self._body.reading()
        self._time_ns: int | None = None
        self._engaged_ns: int | None = None
        self._read_ns = 0
        self._target = pad(operator.target(0.0), self.axes)
        self._pointer = operator.follow(self.axes) if isinstance(operator, PointerHand) else None

    def engage(self, time_ns: int) -> None:
        self._advance_to(time_ns)
        if self._engaged_ns is None:
            self._engaged_ns = time_ns

    def read(self, time_ns: int) -> Vector:
        self._advance_to(time_ns)
        self._read_ns = time_ns
        return self._body.reading()

    def write(self, time_ns: int, force: Vector) -> Vector:
        self._advance_to(time_ns)
        force = saturated(force, self._saturation)
        reading = self._body.reading() if self._motor.guards else ()
        commanded = self._motor_force(force) if self._scales else force
        self._motor.write(time_ns, commanded, force, reading, self._read_ns)
        return force

    def set_hold_limit(self, seconds: float) -> float:
        return self._motor.set_hold_limit(seconds)

    def cut(self) -> tuple[int, Vector] | None:
        cut_ns = self._motor.cut_ns if self._reports_cuts else None
        return None if cut_ns is None else (cut_ns, self._reading_at_cut)

    def stamps(self) -> tuple[int, int]:
        return self._read_ns, self._motor.effect_ns

    def truth(self) -> Truth:
        return self._body.truth()

    def brake(self, damping: Vector) -> None:
        """Add a viscous damping to that of the joints, or axes, from now on; see :class:`Body`."""
        self._body.brake(damping)

    def measured_force(self) -> Vector | None:
        return self._body.truth().hand_force if self._has_sensor else None

    def kinetic_energy(self) -> float:
        return self._body.kinetic_energy()

    def point(self, place: Vector) -> Vector | None:
        return None if self._pointer is None else self._pointer.point(place)

    def _motor_force(self, force: Vector) -> Vector:
        """Return what the motor gives for a written force, in N, once its lag has passed."""
        total = zip(self._gain, force, self._compensation, strict=True)
        return tuple([g * (f + c) for g, f, c in total])

    def buttons(self) -> int | None:
        if not self._has_buttons:
            return None
        began_ns = self._engaged_ns
        if began_ns is None:
            return 0
        return self._operator.buttons((self._read_ns - began_ns) * 1e-9) or 0

    def _advance_to(self, time_ns: int) -> None:
        if self._time_ns is None:
            self._time_ns = time_ns
        if time_ns <= self._time_ns:
            return
        motor = self._motor
        while motor.next_ns < time_ns:
            self._hold_until(motor.next_ns)
            reading = self._body.reading()
            if motor.change(reading):
                self._reading_at_cut = reading
        self._hold_until(time_ns)

    def _hold_until(self, time_ns: int) -> None:
        assert self._time_ns is not None
        duration = (time_ns - self._time_ns) * 1e-9
        if duration == 0.0:
            return
        self._time_ns = time_ns
        start = end = self._target
        if self._pointer is not None:
            end = self._target = self._pointer.advance(duration)
        elif self._engaged_ns is not None:
            end = self._operator.target((time_ns - self._engaged_ns) * 1e-9)
            self._target = end = end if len(end) == self.axes else pad(end, self.axes)
        self._body.move(start, end, duration, self._motor.force)


def pad(target: Vector, axes: int) -> Vector:
    """Return a target of a hand with as many entries as there are axes: 0 m where it has none."""
    return target if len(target) == axes else (target + (0.0,) * axes)[:axes]
