"""The serial ports of this machine, and the one that a name means."""

import grp
import os
import stat
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass

from forcebound.errors import DeviceError

#: Kind of device by the USB vendor and product of its board.
BOARDS = {
    (0x2341, 0x003E): "haply_2diy",  # native port of an Arduino Due, on which the hAPI board rests
    (0x16C0, 0x0483): "haply_inverse3",  # to be driven through its service; of a Teensy, too
    (0x1209, 0x0D31): "odrive",  # ODrive v3; these three are registered for it
    (0x1209, 0x0D32): "odrive",
    (0x1209, 0x0D33): "odrive",
    (0x0403, 0x6014): "dynamixel",  # FT232H, the converter of a U2D2, and of others
    (0x1A86, 0x55D3): "feetech",  # CH343, of the usual bus adapters, and of others
}


@dataclass(frozen=True)
class SerialPort:
    """A serial port of this machine.

    Attributes:
        path: To open.
        description: Of the device behind it, in its maker's words.
        serial_number: Of its USB device; empty if it has none.
        seems: Kind of device, a key of ``forcebound.haptics.devices.DEVICES``, by its USB vendor
            and product; empty if unknown. A board of this kind may also be something else.
        is_permitted: Whether this user may open it.
        group: Whose members may open it; empty: no group may.
    """

    path: str
    description: str = ""
    serial_number: str = ""
    seems: str = ""
    is_permitted: bool = True
    group: str = ""

    def __str__(self) -> str:
        number = f", serial number {self.serial_number}" if self.serial_number else ""
        seems = f", seems to be {self.seems}" if self.seems else ""
        return f"{self.path} ({self.description or 'no description'}{number}{seems})"


def listed() -> list[SerialPort]:
    """Return the serial ports that have a device, in the order of their paths."""
    from serial.tools import list_ports

    return sorted(
        (
            SerialPort(
                port.device,
                "" if port.description in (None, "n/a") else port.description,
                port.serial_number or "",
                BOARDS.get((port.vid, port.pid), ""),
                os.access(port.device, os.R_OK | os.W_OK),
                _group(port.device),
            )
            for port in list_ports.comports()
        ),
        key=lambda port: port.path,
    )


def find(name: str, kind: str = "", among: Sequence[SerialPort] | None = None) -> str:
    """Return the path of a port, of those of this machine or ``among`` others.

    ``name`` is a path; the serial number of a USB device; or ``auto``: the only port that seems to
    be of this kind, else the only one with a USB device. DeviceError if there is none, or ``auto``
    may mean several.
    """
    if "/" in name:
        return name
    ports = listed() if among is None else among
    if name == "auto":
        alike = [port for port in ports if kind and port.seems == kind]
        found = alike or [port for port in ports if port.description]  # something is plugged in
        expected = "a device on a serial port"
    else:
        found = [port for port in ports if name and port.serial_number == name]
        expected = (
            f"a path such as /dev/ttyACM0, auto, or the serial number of a device, got {name!r}"
        )
    if len(found) == 1:
        return found[0].path
    there = "; ".join(map(str, found or ports)) or "none"
    if found:
        raise DeviceError(f"port {name!r} may mean several: {there}; name one by its path")
    raise DeviceError(
        f"expected {expected}, found none: plug it in, switch it on; serial ports here: {there}"
    )


def serial_number(path: str, among: Sequence[SerialPort] | None = None) -> str:
    """Return the serial number of the USB device at a port; empty if it has none."""
    ports, meant = listed() if among is None else among, os.path.realpath(path)
    return next((p.serial_number for p in ports if os.path.realpath(p.path) == meant), "")


def check_serial_number(path: str, stated: str, among: Sequence[SerialPort] | None = None) -> None:
    """Check that the device at a port is the one whose numbers are stated; empty: any.

    DeviceError if it has another serial number. One without any passes.
    """
    found = serial_number(path, among) if stated else ""
    if found and found != stated:
        raise DeviceError(
            f"the numbers in the launch file are of the device with the serial number {stated}, and"
            f" {path} is that with {found}: plug the other one in, or measure this one with"
            " `forcebound identify`"
        )


def _group(path: str) -> str:
    with suppress(OSError, KeyError):  # it is gone, or the group has no name
        status = os.stat(path)
        may_open = stat.S_IRGRP | stat.S_IWGRP
        if status.st_mode & may_open == may_open and status.st_gid != 0:
            return grp.getgrgid(status.st_gid).gr_name
    return ""
