"""Emulated buses of servos in virtual time, and the makers' own clients at them."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import dynamixel_sdk
import scservo_sdk

from forcebound.haptics.devices.joint_device import Joints
from forcebound.haptics.devices.true_values import TrueServos
from forcebound.haptics.devices.truth_file import TruthFile
from forcebound.haptics.hands import Operator
from forcebound.hardware.emulators.dynamixel_bus import DynamixelBus, DynamixelServo
from forcebound.hardware.emulators.emulation import Emulation
from forcebound.hardware.emulators.faults import SERVO_KINDS, Faults, parse_fault
from forcebound.hardware.emulators.feetech_bus import FeetechBus, FeetechServo
from forcebound.hardware.emulators.mechanism import Mechanism
from forcebound.hardware.emulators.servo_bus import Servo, Wiring
from forcebound.hardware.servo_models import DYNAMIXELS, FEETECHS

MS = 1_000_000
STEP_NS = 50_000
STEP = math.tau / 4096  # rad, of an encoder


class Rig:
    """Servos 1, 2, ... on a bus, whose time goes on when a client waits; nobody holds the joints.

    Attributes:
        time_ns: Now.
        bus: Their firmware.
        mechanism: Their joints.
    """

    def __init__(
        self,
        servos: Sequence[Servo],
        folder: Path,
        faults: tuple[str, ...] = (),
        operator: Operator | None = None,
        truth: TrueServos | None = None,
        baud: int = 1_000_000,
    ) -> None:
        names = tuple(f"joint {one.wiring.number}" for one in servos)
        joints = Joints(joints=names, damping=0.02, friction=0.05, resolution=0.0, truth=truth)
        self.mechanism = Mechanism(joints, operator, (0.0,) * len(names))
        is_feetech = isinstance(servos[0], FeetechServo)
        kind, supply = (FeetechBus, 8.0) if is_feetech else (DynamixelBus, 5.0)
        given = truth or TrueServos()
        self.bus: Any = kind(servos, baud, given, supply, self.mechanism.brake)
        planned = Faults([parse_fault(text, SERVO_KINDS) for text in faults])
        self.bus.plan(planned)
        self.truth = TruthFile(folder / "bus.truth", creates=True)
        self.emulation = Emulation(self.bus, self.mechanism, planned, self.truth)
        self.time_ns = 5_000 * MS
        self.emulation.start(self.time_ns)
        self.replies: list[tuple[int, bytes]] = []  # that have come, and when

    def send(self, data: bytes) -> None:
        """Send bytes now."""
        self._step(data)

    def wait(self, duration_ns: int) -> bytes:
        """Let time pass; return what has come in it."""
        end_ns, before = self.time_ns + duration_ns, len(self.replies)
        while self.time_ns < end_ns:
            wake_ns = self.emulation.wake_ns
            next_ns = self.time_ns + STEP_NS if wake_ns is None else wake_ns
            self.time_ns = min(max(next_ns, self.time_ns), self.time_ns + STEP_NS, end_ns)
            self._step(b"")
        return b"".join(data for _, data in self.replies[before:])

    def exchange(self, data: bytes, duration_ns: int = 5 * MS) -> bytes:
        """Send bytes and return what comes within a time."""
        self.send(data)
        return self.wait(duration_ns)

    def _step(self, data: bytes) -> None:
        reply = self.emulation.step(data, self.time_ns)
        self.emulation.settle(self.time_ns)
        if reply:
            self.replies.append((self.time_ns, reply))


def _wirings(models: Any, constant: float, direction: int) -> list[Wiring]:
    return [Wiring(i, direction, 2048, constant, one) for i, one in enumerate(models, start=1)]


def dynamixels(
    folder: Path,
    *faults: str,
    models: tuple[str, ...] = ("xl330-m288", "xl330-m288"),
    direction: int = 1,
    baud: int = 1_000_000,
    truth: TrueServos | None = None,
) -> Rig:
    """Return Dynamixels of 0.35 N m/A at 5 V, whose joints are at 0 rad where they count 2048."""
    wirings = _wirings([DYNAMIXELS[one] for one in models], 0.35, direction)
    servos = [DynamixelServo(one, 5.0) for one in wirings]
    return Rig(servos, folder, faults, None, truth, baud)


def feetechs(
    folder: Path,
    *faults: str,
    models: tuple[str, ...] = ("sts3215", "sts3215"),
    direction: int = 1,
    truth: TrueServos | None = None,
    operator: Operator | None = None,
) -> Rig:
    """Return STS of 2 N m with full duty at 8 V; they count 2048 where joints are at 0 rad."""
    wirings = _wirings([FEETECHS[one] for one in models], 2.0, direction)
    servos = [FeetechServo(one, 8.0) for one in wirings]
    return Rig(servos, folder, faults, operator, truth)


class _Rigged:
    """What is alike in the ports of both clients: the time of a rig passes when they read."""

    packet_start_time: float
    packet_timeout: float
    tx_time_per_byte: float

    def __init__(self, rig: Rig) -> None:
        super().__init__("none")  # type: ignore[call-arg]
        self.rig, self._came = rig, b""
        self.tx_time_per_byte = 0.01  # ms

    def clearPort(self) -> None:  # noqa: N802 - their name
        self._came = b""

    def readPort(self, length: int) -> bytes:  # noqa: N802
        self._came += self.rig.wait(STEP_NS)
        data, self._came = self._came[:length], self._came[length:]
        return data

    def writePort(self, packet: list[int]) -> int:  # noqa: N802
        self.rig.send(bytes(packet))
        return len(packet)

    def getCurrentTime(self) -> float:  # noqa: N802
        return self.rig.time_ns * 1e-6


class DynamixelPort(_Rigged, dynamixel_sdk.PortHandler):  # type: ignore[misc]
    """The port of the maker's client, at a rig."""


class FeetechPort(_Rigged, scservo_sdk.PortHandler):  # type: ignore[misc]
    """Likewise."""
