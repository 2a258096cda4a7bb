"""Devices: what the hand holds.

A device is a frozen dataclass of its parameters (:class:`AxesModel`) whose ``open`` returns the
:class:`Device` that the device node reads and writes. Damping and friction are *minimum* values:
the bounder's guarantee rests on them, so state where they come from (measured, data sheet).

To add a device: copy ``phantom.py`` to ``my_device.py``, add one line to ``DEVICES``;
``tests/test_devices.py`` tests it with all the others, and launch files know it as
``device: {kind: my_device}``. Or name a custom file (docs/write-your-own-device.md).

A device that does not answer, or answers nonsense, raises :class:`forcebound.errors.DeviceError`:
the node then tries to write zero force, closes the device, and the graph ends.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any, ClassVar, Literal, Protocol, TypeAlias

from msgspec import Struct

from forcebound.axes import Axis, lengths
from forcebound.errors import ConfigError
from forcebound.haptics.hands import Operator
from forcebound.haptics.laws.dissipation import JointNumbers, StatedAxes, StatedNumbers
from forcebound.haptics.parts import PartShape, Table
from forcebound.haptics.parts.signals import Publisher, Publishing
from forcebound.messages.packets import MAX_AXES, MAX_NAME, Quaternion, Vector

__all__ = ["DEVICES", "AxesModel", "Axis", "Device", "DeviceModel", "JointsModel", "Kinematics"]
__all__ += ["Source", "Truth"]

#: Where a number comes from.
Source: TypeAlias = Literal["measured", "data sheet", "assumed"]


class Truth(Struct, frozen=True, array_like=True, gc=False):
    """Ground truth of a simulated device, which no law may see.

    In the units of its axes: of an angle rad for m, N m for N.
    """

    position: Vector  # m, not quantised
    velocity: Vector  # m/s
    hand_force: Vector  # N, of spring and damper of the hand, positive into the environment
    energy: float  # J, that has flowed from the hand into the device: integral of F_h v dt


class Kinematics(Protocol):
    """Geometry of an arm whose readings are joint angles and whose motors give torques."""

    def position(self, angles: Vector) -> Vector:
        """Return the position of the tip, in m, of joint angles in rad."""
        ...

    def torque(self, angles: Vector, force: Vector) -> Vector:
        """Return the joint torques, in N m, of a force at the tip, in N: J(angles)^T force."""
        ...


class Device(Publisher, ABC):
    """An open device; only ``axes``, ``read`` and ``write`` have no default.

    Attributes:
        axes: Number of axes, 1 to 8.
        kinematics: Of an arm of which others see the tip: ``read`` then returns joint angles, in
            rad, and ``write`` takes torques, in N m, in place of positions and forces. None: others
            see the axes that it reads, in the units of its model's ``named_axes``.
        is_exchange: Whether a write is an exchange with the device that brings a reading, which
            :meth:`fresh_reading` returns. After a slow one the next write then waits 0.3 periods
            for the answer to the late state.
    """

    axes: int
    kinematics: Kinematics | None = None
    is_exchange: bool = False

    @property
    def serial_number(self) -> str:
        """Serial number of its USB device; empty if it has none."""
        return ""

    @abstractmethod
    def read(self, time_ns: int) -> Vector:
        """Return the encoder readings at ``time_ns``, in m."""

    @abstractmethod
    def write(self, time_ns: int, force: Vector) -> Vector:
        """Hold ``force``, in N, from ``time_ns`` on; return what is really applied.

        The device lets the force fall to zero by itself when it is older than the hold limit,
        unless it states ``watchdog: none``; with ``guarding`` once a reading has moved back from
        where it was when the force began to act, at the hold limit at the earliest.
        """

    def engage(self, time_ns: int) -> None:
        """Start the run now; a simulated hand begins to move."""

    def close(self) -> None:
        """Release the device, its force at zero; called once, whatever came before."""

    def set_hold_limit(self, seconds: float) -> float | None:
        """Drop the forces from the next write on when they have acted for ``seconds``.

        Returns:
            The hold limit that was really set, in s; the bounder plans with it. None if this device
            keeps the one with which it was opened.
        """
        return None

    def cut(self) -> tuple[int, Vector] | None:
        """Return when and where the watchdog has dropped a force since the last write.

        Returns:
            Time when the force was gone, in ns, and the reading then; None if it has dropped none.
            If it has dropped the force of the last write and, before it began to act, that of the
            one before, the later cut.
        """
        return None

    def stamps(self) -> tuple[int, int] | None:
        """Return when the last reading was latched, and when the last write acts, in ns.

        None: both happen at the time that ``read`` and ``write`` are given.
        """
        return None

    def latch_jitter(self) -> int | None:
        """Return by how much the last reading may be later than its stamp, in ns.

        Beside what shifts all stamps alike. The ledger takes the longest time that can have passed
        since the reading before, in which the same motion dissipates least. None: it is exact.
        """
        return None

    def fresh_reading(self) -> Vector | None:
        """Return the reading that came with the last write; None: ask for a new one.

        Give it only while it is young. It serves the state of the next tick, which then need not
        wait for an exchange with the device; the ledger takes another reading.
        """
        return None

    def orientation(self) -> Quaternion | None:
        """Return the orientation of the tip at the last reading, a unit quaternion w x y z."""
        return None

    def buttons(self) -> int | None:
        """Return which buttons were down at the last reading, bit i of button i; None: has none."""
        return None

    def measured_force(self) -> Vector | None:
        """Return the hand's force on the tip at the last reading, by a force sensor, in N.

        One entry per axis, positive into the environment. None: it has no sensor.
        """
        return None

    def truth(self) -> Truth | None:
        """Return the ground truth at the last read or write; None for hardware."""
        return None

    def kinetic_energy(self) -> float:
        """Return what the motion of a simulated device holds, in J, the hand's mass not counted."""
        return 0.0

    def point(self, place: Vector) -> Vector | None:
        """Move the pointer that a simulated hand follows; None: this hand follows none.

        Args:
            place: In m; entries that it does not have stay as they are.

        Returns:
            Where the pointer is now, in m; within the hand's reach.
        """
        return None


@dataclass(frozen=True, kw_only=True)
class DeviceModel(StatedNumbers, Publishing, ABC):
    """Parameters of a kind of device: its stated numbers, and others of this kind.

    A device that is no arm derives from :class:`AxesModel`.

    Attributes:
        sources: By name of a number: measured, data sheet or assumed; for reports.
        simulated_in: Launch file with the simulated device of this kind, if it has no virtual time.
        has_coupled_axes: Whether its axes are those of an arm's tip: between two axes there may be
            less friction and damping, and a coarser resolution, than along both.
        port: Path of its serial port; empty: it is at none.
        on_loss: While the force is on: ``end`` ends the graph when the device is lost; ``wait``
            keeps it, without force, until the user says that the device is in order.
        workspace: Edges of the box about 0 m in which the hand should stay, in m; None: unknown.
    """

    simulated_in: ClassVar[str | None] = None
    has_coupled_axes: ClassVar[bool] = False

    sources: Mapping[str, Source] = field(default_factory=dict, hash=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        known = {each.name for each in fields(self)}
        for name in self.sources:
            if name not in known:
                raise ConfigError(f"sources: the device has no number {name!r}", field="sources")

    @property
    @abstractmethod
    def axes(self) -> int:
        """Number of axes, 1 to 8."""

    @property
    def named_axes(self) -> tuple[Axis, ...]:
        """Axes that graph, environment and results see: lengths x, y, z, unless it names them."""
        return lengths(self.axes)

    @property
    def hand_axes(self) -> tuple[Axis, ...]:
        """Axes along which a simulated hand holds it."""
        return self.named_axes

    @classmethod
    def written_axes(cls, values: Mapping[str, Any]) -> tuple[Axis, ...] | None:
        """Return the axes of which the entries of its section are, ``values`` as they are written.

        Each is then read in the unit of its axis. None: in the units of the types alone.
        """
        return None

    @abstractmethod
    def open(self, operator: Operator | None, hold_limit: float) -> Device:
        """Return the device, ready to read.

        Args:
            operator: The hand on a simulated device; None: nobody holds it. Hardware ignores it.
            hold_limit: Longest time that a force is held without a new one, in s.

        Raises:
            DeviceError: If the device does not answer.
        """

    @property
    def port(self) -> str:
        return ""

    @property
    def on_loss(self) -> Literal["end", "wait"]:
        return "end"

    @property
    def workspace(self) -> Vector | None:
        return None

    @property
    def longest_force(self) -> float:
        """The watchdog limit, in s; infinite if it is ``auto``."""
        return math.inf if self.watchdog_limit == "auto" else self.watchdog_limit

    def possible_limit(self, limit: float) -> float:
        """Return the least watchdog limit from ``limit`` on that the device can have, in s."""
        return limit

    @property
    def own_code(self) -> str:
        """Its user's code beside the kind, ``FILE.py:NAME``; empty: none."""
        return ""

    @property
    def torque_scale(self) -> str:
        """Its number of each joint that scales the torque of the motor; empty: none.

        ``forcebound identify`` measures it with a weight.
        """
        return ""

    def check_files(self) -> None:
        """Check, where a launch file is read, the files that it names; ConfigError if not sound."""

    def check_here(self) -> None:
        """Check, before anything starts, that this machine has the device.

        Raises:
            DeviceError: If not; says what to try.
        """

    def kinematics(self) -> Kinematics | None:
        """Return the geometry of an arm; None: it is no arm."""
        return None

    def angles(self, position: Vector) -> Vector | None:
        """Return the joint angles of an arm, in rad, for a tip at ``position``, in m."""
        return None


@dataclass(frozen=True, kw_only=True)
class AxesModel(DeviceModel, StatedAxes):
    """Parameters of a device of axes, which may carry a weight: of every one that is no arm."""


@dataclass(frozen=True, kw_only=True)
class JointsModel(JointNumbers, DeviceModel):
    """Parameters of a device whose joints are the axes that others see; no kinematics is needed.

    Attributes:
        joints: Their names, 1 to 8.
        prismatic: Those of them that move along a straight line: m for rad and N for N m then.
    """

    joints: tuple[str, ...]
    prismatic: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        super().__post_init__()
        names = [name for name in self.joints if 0 < len(name) <= MAX_NAME and name.isprintable()]
        if not 1 <= len(set(names)) == len(self.joints) <= MAX_AXES:
            expected = f"joints must be 1 to {MAX_AXES} different names"
            raise ConfigError(f"{expected}, got {', '.join(self.joints)}", field="joints")
        self.written_axes({"joints": self.joints, "prismatic": self.prismatic})

    @property
    def axes(self) -> int:
        return len(self.joints)

    @property
    def named_axes(self) -> tuple[Axis, ...]:
        return tuple(
            Axis(name, "length" if name in self.prismatic else "angle") for name in self.joints
        )

    @classmethod
    def written_axes(cls, values: Mapping[str, Any]) -> tuple[Axis, ...] | None:
        names, straight = values.get("joints"), values.get("prismatic", ())
        if not isinstance(names, tuple | list) or not isinstance(straight, tuple | list):
            return None  # wrong, and noted where it is read
        for name in straight:
            if name not in names:
                message = f"prismatic: no joint {name!r}; the joints are: {', '.join(names)}"
                raise ConfigError(message, field="prismatic")
        return tuple(Axis(str(one), "length" if one in straight else "angle") for one in names)


DEVICES: Table[type[DeviceModel]] = Table(
    "devices",
    {
        "desktop_arm": "forcebound.haptics.devices.desktop_arm:DesktopArm",
        "dynamixel": "forcebound.hardware.dynamixel:Dynamixel",
        "feetech": "forcebound.hardware.feetech:Feetech",
        "five_bar": "forcebound.haptics.devices.five_bar:FiveBar",
        "haply_2diy": "forcebound.hardware.haply_2diy:Haply2DIY",
        "haply_inverse3": "forcebound.hardware.haply_inverse3:HaplyInverse3",
        "joints": "forcebound.haptics.devices.joint_device:Joints",
        "knob": "forcebound.haptics.devices.knob:Knob",
        "odrive": "forcebound.hardware.odrive:ODrive",
        "phantom_premium_1_5": "forcebound.haptics.devices.phantom:PhantomPremium15",
        "program": "forcebound.hardware.program:Program",
        "robot": "forcebound.hardware.robot:Robot",
        "serial_arm": "forcebound.haptics.devices.serial_arm:SerialArm",
    },
    PartShape("forcebound.haptics.devices:DeviceModel"),
)
