"""Joints at a serial port: what the drivers that ship have in common."""

from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal

from forcebound.devices.stated_joints import StatedJoints
from forcebound.hardware.line import EMULATED
from forcebound.hardware.port import Port
from forcebound.hardware.ports import check_serial_number, find
from forcebound.quantities import POSITIVE, Inertia, Name, Range, Time

# s. Nobody is in danger at an emulator, and a busy machine should not end the run: at a load of 5
# on two cores the longest of 200 000 replies took 33 ms.
LIMIT, EMULATED_LIMIT = 0.02, 0.1
SIMULATED = (
    *("inertia", "damping", "friction", "resolution", "presliding"),
    *("gain_error", "lag", "substep", "truth"),
)


@dataclass(frozen=True, kw_only=True)
class SerialJoints(StatedJoints):
    """What a driver states about its line.

    Attributes:
        watchdog_limit: Age at which a force ends that nobody renews; a board that is silent for
            half of it is lost. auto: 20 ms at a port; 100 ms if the port is emulated, on a
            machine that may be busy.
        port: Path of the serial port, auto, the serial number of its USB device, or emulated.
        serial_number: Of the USB device whose numbers these are; `forcebound identify` writes it,
            and a launch refuses a port with another one. Empty, or a port without one: any.
        on_loss: Of the device, while the force is on: end ends the graph; wait keeps it, without
            force, until the device is in order and the user says so (`forcebound device resume`). A
            device whose guardian is gone or silent waits in either case.
        reply_within: A reply later than this is counted as late; a reading that came with a write
            serves the next state if it is younger.
    """

    board: ClassVar[str]  # kind of device

    inertia: Annotated[Inertia, POSITIVE] = 1e-4  # assumed; of the emulator alone
    watchdog: Literal["none"] = "none"
    watchdog_limit: Annotated[Time, Range(at_least=0.005, at_most=100.0)] | Literal["auto"] = "auto"
    port: Name = EMULATED
    serial_number: Name = ""
    on_loss: Literal["end", "wait"] = "end"
    reply_within: Annotated[Time, POSITIVE] = 3e-4

    def check_here(self) -> None:
        """Check, before anything starts, that the port can be opened, and is the right one.

        Raises:
            DeviceError: If not; says what to try.
        """
        if self.port != EMULATED:
            path = find(self.port, self.board)
            Port(path).close()
            check_serial_number(path, self.serial_number)

    def simulated_joints(self) -> dict[str, Any]:
        """Return the numbers that a simulated arm takes for the same joints, by name."""
        return {name: getattr(self, name) for name in SIMULATED}

    @property
    def longest_force(self) -> float:
        """The watchdog limit, in s; see the class."""
        if self.watchdog_limit != "auto":
            return self.watchdog_limit
        return EMULATED_LIMIT if self.port == EMULATED else LIMIT
