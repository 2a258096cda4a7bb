"""Devices: what the hand holds.

A device is a frozen dataclass of its parameters (:class:`DeviceModel`) whose ``open`` returns the
:class:`Device` that the device node reads and writes. Damping and friction are *minimum* values:
the bounder's guarantee rests on them, so state where they come from (measured, data sheet).

To add a device: copy ``phantom.py`` to ``my_device.py``, add one line to ``DEVICES``;
``tests/test_devices.py`` tests it with all the others, and launch files know it as
``device: {kind: my_device}``. Or name a file of one's own (docs/write-your-own-device.md).

A device that does not answer, or answers nonsense, raises :class:`forcebound.errors.DeviceError`:
the node then tries to write zero force, closes the device, and the graph ends.
"""

from typing import Protocol

from forcebound.bounding.dissipation import PerAxis, Watchdog
from forcebound.devices.truth import Truth
from forcebound.messages.packets import Quaternion, Vector
from forcebound.operators import Operator
from forcebound.parts import Form, Table

__all__ = ["DEVICES", "Device", "DeviceExtras", "DeviceModel", "Kinematics", "Truth"]


class Device(Protocol):
    """Interface of a device for the device node."""

    @property
    def axes(self) -> int:
        """Number of axes, 1 to 6."""
        ...

    def engage(self, time_ns: int) -> None:
        """Start the run now; a simulated hand begins to move."""
        ...

    def read(self, time_ns: int) -> Vector:
        """Return the encoder readings at ``time_ns``, in m."""
        ...

    def write(self, time_ns: int, force: Vector) -> Vector:
        """Hold ``force``, in N, from ``time_ns`` on; return what is really applied.

        The device lets the force fall to zero by itself when it is older than the hold limit,
        unless it states ``watchdog: none``; with ``guarding`` once a reading has moved back from
        where it was when the force began to act, at the hold limit at the earliest.
        """
        ...

    def truth(self) -> Truth | None:
        """Return the ground truth at the last read or write; None for hardware."""
        ...

    def close(self) -> None:
        """Release the device, its force at zero; called once, whatever came before."""
        ...


class Kinematics(Protocol):
    """Geometry of an arm whose readings are joint angles and whose motors give torques."""

    def position(self, angles: Vector) -> Vector:
        """Return the position of the tip, in m, of joint angles in rad."""
        ...

    def torque(self, angles: Vector, force: Vector) -> Vector:
        """Return the joint torques, in N m, of a force at the tip, in N: J(angles)^T force."""
        ...


class DeviceExtras(Protocol):
    """Optional members of a :class:`Device`; one that is absent, or None, is not used.

    Attributes:
        kinematics: Of an arm: ``read`` then returns joint angles, in rad, and ``write`` takes
            torques, in N m, in place of positions and forces. None: it is no arm.
    """

    kinematics: Kinematics | None

    def set_hold_limit(self, seconds: float) -> float:
        """Drop the forces from the next write on when they have acted for ``seconds``.

        Return the hold limit that was really set, in s: the bounder plans with it.
        """
        ...

    def cut(self) -> tuple[int, Vector] | None:
        """Return when and where the watchdog has dropped a force since the last write.

        Returns:
            Time when the force was gone, in ns, and the reading then; None if it has dropped none.
            If it has dropped the force of the last write and, before it began to act, that of the
            one before, the later cut.
        """
        ...

    def stamps(self) -> tuple[int, int]:
        """Return when the last reading was latched, and when the last write acts, in ns.

        Without them, both happen at the time that ``read`` and ``write`` are given.
        """
        ...

    def fresh_reading(self) -> Vector | None:
        """Return the reading that came with the last write; None: ask for a new one.

        Give it only while it is young. It serves the state of the next tick, which then need not
        wait for an exchange with the device; the ledger takes a reading of its own. A state that is
        late all the same, because the write before it was, gets some time for its answer: the next
        write waits for it.
        """
        ...

    def latch_jitter(self) -> int:
        """Return by how much the last reading may be later than its stamp, in ns.

        Beside what shifts all stamps alike. The ledger takes the longest time that can have passed
        since the reading before, in which the same way dissipates least.
        """
        ...

    def orientation(self) -> Quaternion:
        """Return the orientation of the tip at the last reading, a unit quaternion w x y z."""
        ...

    def buttons(self) -> int:
        """Return which buttons were down at the last reading: bit i of button i."""
        ...

    def kinetic_energy(self) -> float:
        """Return what the motion of a simulated device holds, in J, the hand's mass not counted."""
        ...

    def point(self, place: Vector) -> Vector | None:
        """Move the pointer that a simulated hand follows; None: this hand follows none.

        Args:
            place: In m; entries that it does not have stay as they are.

        Returns:
            Where the pointer is now, in m: within the hand's reach.
        """
        ...


class DeviceModel(Protocol):
    """Parameters of a kind of device.

    A model may also state the numbers of :class:`forcebound.devices.stated.StatedImperfections`,
    ``presliding``, ``weight`` and ``weight_error`` under their names; without them, or with None,
    the device has none of these imperfections.
    """

    @property
    def axes(self) -> int:
        """Number of axes, 1 to 6."""
        ...

    @property
    def damping(self) -> PerAxis:
        """Minimum viscous damping b, in N s/m (of joints: N m s); alike, or of each axis."""
        ...

    @property
    def friction(self) -> PerAxis:
        """Minimum Coulomb friction f_c, in N (of joints: N m); along the path, or of each axis."""
        ...

    @property
    def resolution(self) -> PerAxis:
        """Encoder resolution at the tip, in m (of joints: rad), 0 for none; alike, or of each."""
        ...

    @property
    def saturation(self) -> float:
        """Largest force, in N (of joints: N m)."""
        ...

    @property
    def watchdog(self) -> Watchdog:
        """What drops a force that is too old; a silent one has a ``watchdog_tolerance``."""
        ...

    def open(self, operator: Operator | None, hold_limit: float) -> Device:
        """Return the device, ready to read.

        Args:
            operator: The hand on a simulated device; None: nobody holds it. Hardware ignores it.
            hold_limit: Longest time that a force is held without a new one, in s.

        Raises:
            DeviceError: If the device does not answer.
        """
        ...


DEVICES: Table[type[DeviceModel]] = Table(
    "devices",
    {
        "desktop_arm": "forcebound.devices.desktop_arm:DesktopArm",
        "five_bar": "forcebound.devices.five_bar:FiveBar",
        "haply_2diy": "forcebound.hardware.haply_2diy:Haply2DIY",
        "knob": "forcebound.devices.knob:Knob",
        "odrive": "forcebound.hardware.odrive:ODrive",
        "phantom_premium_1_5": "forcebound.devices.phantom:PhantomPremium15",
        "serial_arm": "forcebound.devices.serial_arm:SerialArm",
    },
    Form("forcebound.devices:DeviceModel"),
)
