"""The start of an ODrive: its checks, its settings, switching its motors on."""

import logging
import time

from forcebound.errors import DeviceError
from forcebound.hardware.odrive_lines import (
    CLOSED_LOOP_CONTROL,
    IDLE,
    PASSED_THROUGH,
    Requests,
    error_words,
    request,
    torque_request,
    whole_number,
)

FIRMWARES = ((0, 5), (0, 0))  # the other is what a build out of a folder without git says
SWITCHING_NS = 1_000_000_000  # for the motors to be on
WATCHDOG_MARGIN = 0.001  # s, between the board's watchdog and the limit that is stated

_logger = logging.getLogger(__name__)


def zero_torque(joints: int) -> bytes:
    """Return the lines that set no torque, which also feed the watchdogs."""
    return b"".join(torque_request(axis, 0.0) for axis in range(joints))


def switched_off(joints: int) -> bytes:
    """Return the lines that leave the motors off, and no watchdog to complain."""
    return b"".join(
        request(f"w axis{axis}.requested_state {IDLE}")
        + request(f"w axis{axis}.config.enable_watchdog 0")
        for axis in range(joints)
    )


def check_firmware(requests: Requests) -> None:
    """Check that the board is an ODrive whose protocol is known; DeviceError if not."""
    version = [requests.value(f"fw_version_{part}", whole_number) for part in ("major", "minor")]
    if None not in version and tuple(version) not in FIRMWARES:
        raise DeviceError(
            f"the ODrive has the firmware {version[0]}.{version[1]}; this driver speaks the"
            " ASCII protocol of 0.5"
        )


def set_up(requests: Requests, axis: int, saturation: float) -> None:
    """Let the torque of an axis be what is written, up to ``saturation``, in N m.

    DeviceError if the board has no such axis, keeps another setting or gives less torque.
    """
    if requests.value(f"axis{axis}.current_state") is None:
        raise DeviceError(f"the ODrive has no axis {axis}: expected joints: {axis} at most")
    own = f"axis{axis}.controller.config"
    _set(requests, f"{own}.enable_torque_mode_vel_limit", 0)
    _set(requests, f"{own}.input_mode", PASSED_THROUGH)
    own = f"axis{axis}.motor.config"
    limit = requests.value(f"{own}.torque_lim")
    current = requests.value(f"{own}.current_lim")
    constant = requests.value(f"{own}.torque_constant")
    if limit is None or current is None or constant is None:
        return
    most = min(limit, current * constant)
    if most < saturation:
        raise DeviceError(
            f"axis {axis} gives {most:.3g} N m at most (torque_lim {limit:g} N m, current_lim"
            f" {current:g} A, torque_constant {constant:g} N m/A); expected the saturation,"
            f" {saturation:g} N m, or more: lower the one or raise the other"
        )


def _set(requests: Requests, name: str, value: int) -> None:
    if requests.value(name) is None:
        _logger.warning("the ODrive has no %s: see that its torque is what is written", name)
        return
    requests.send(request(f"w {name} {value}"))
    after = requests.value(name)
    if after != value:
        raise DeviceError(f"the ODrive keeps {name} at {after}, after it was set to {value}")


class Switch:
    """Switches the motors on within some ticks, without waiting.

    The board switches them off again when no torque has come for ``watchdog_limit`` s.
    """

    def __init__(self, requests: Requests, joints: int, watchdog_limit: float) -> None:
        self._requests, self._joints = requests, joints
        self._timeout = watchdog_limit - WATCHDOG_MARGIN
        self._zero = zero_torque(joints)
        self.begin()

    @property
    def is_on(self) -> bool:
        """True if all motors are on."""
        return not self._off

    def begin(self) -> None:
        """Count all motors as off."""
        self._off = set(range(self._joints))
        self._ordered_ns: int | None = None

    def go_on(self) -> None:
        """Order the motors to be on, or ask one whether it is; DeviceError after a second."""
        message, now_ns = self._zero, time.monotonic_ns()
        if self._ordered_ns is None:
            self._ordered_ns = now_ns
            message += self._order()
        axis = min(self._off)
        state = self._requests.value(f"axis{axis}.current_state", before=message)
        if state == CLOSED_LOOP_CONTROL:
            self._off.remove(axis)
        elif now_ns - self._ordered_ns > SWITCHING_NS:
            error = int(self._requests.value(f"axis{axis}.error", whole_number) or 0)
            self._requests.end(
                DeviceError(
                    f"axis {axis} of the ODrive does not switch on, error {error_words(error)}:"
                    " calibrate motor and encoder with its tool"
                )
            )

    def _order(self) -> bytes:
        """Return what switches on: a watchdog that is fed, no error, the state."""
        lines = b""
        for axis in range(self._joints):
            lines += request(f"w axis{axis}.config.watchdog_timeout {self._timeout:g}")
            lines += request(f"u {axis}")
            lines += request(f"w axis{axis}.config.enable_watchdog 1")
        lines += request("sc")
        for axis in range(self._joints):
            lines += request(f"w axis{axis}.requested_state {CLOSED_LOOP_CONTROL}")
        return lines
