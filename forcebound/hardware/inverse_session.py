"""A session at the service of an Inverse3: its start, its settings, its end."""

import logging
import time
from typing import TYPE_CHECKING

from forcebound.errors import DeviceError
from forcebound.hardware.inverse_messages import (
    Inverse3,
    Message,
    Xyz,
    chosen,
    end_of_session,
    framed,
    parse,
    parse_event,
    to_device,
)
from forcebound.hardware.inverse_service import (
    CONNECT,
    Connection,
    address_of,
    ask,
    check_version,
    setting,
)
from forcebound.messages.packets import Vector

if TYPE_CHECKING:
    from forcebound.hardware.haply_inverse3 import HaplyInverse3

PROFILE = "forcebound"  # of the session, in the maker's programs
#: Events about the device that end its force, unless they are of a level that only informs.
ENDING = ("device-safety-triggered", "device-disconnected", "device-busy")
INFORMING = ("info", "notice")
NO_FORCE: Vector = (0.0, 0.0, 0.0)

_logger = logging.getLogger(__name__)


class Session:
    """A session at the service: its connections, its device, what is set for it.

    DeviceError if there is no such service or device, or another session drives it.
    """

    def __init__(self, model: "HaplyInverse3", name: str) -> None:
        self._model = model
        self.address = address_of(name, model.service)
        version = check_version(self.address)
        host, port = self.address
        events_port = setting(self.address, "communication/events/port", int)
        path = name if "/" in name else str(self.address)
        self.events = Connection(host, events_port, path)
        try:
            self.connection = Connection(host, port, path)
        except BaseException:
            self.events.close()
            raise
        try:
            inventory = self.received(CONNECT)
            self.id = inventory.session_id
            device = chosen(inventory.inverse3, model.port)
            self.device_id = device.device_id
            if model.serial_number not in ("", self.device_id):
                raise DeviceError(
                    f"the numbers in the launch file are of the device {model.serial_number}, and"
                    f" this is {self.device_id}: plug the other one in, or measure this one with"
                    " `forcebound identify`"
                )
            self.grips = [
                (group, grip.device_id)
                for group in ("verse_grip", "wireless_verse_grip")
                for grip in getattr(inventory, group)
                if grip.is_here
            ]
            _check_idle(device)
        except BaseException:
            self.close()
            raise
        words = "the Inverse3 %s at the Haply service %s, version %s"
        _logger.info(words, self.device_id, self.address, version)

    def received(self, within: float) -> Message:
        """Return the next message, within so many s."""
        data = self.connection.read(0, time.monotonic_ns() + round(1e9 * within))
        if not data:
            raise DeviceError(f"the Haply service at {self.address} is silent: restart it")
        return parse(data)

    def asked(self, message: object) -> Message:
        """Send a message without force; return its reply."""
        self.connection.write(framed(message))
        return self.received(CONNECT)

    def force(self, force: Vector) -> dict[str, object]:
        """Return the message of a force, in N, along the service's axes."""
        x, y, z = force
        commands = {"set_cursor_force": {"vector": {"x": x, "y": y, "z": z}}}
        return to_device(self.device_id, self.grips, commands=commands)

    def check(self) -> None:
        """Fail if the service has reported what ends the force, or has sent a second reply."""
        if extra := self.connection.read(0, 0):
            raise DeviceError(
                f"the Haply service has sent two replies to one message, the second {extra[:60]!r}:"
                " restart it"
            )
        while data := self.events.read(0, 0):
            event = parse_event(data)
            is_about = event.data.get("device_id") == self.device_id
            if event.name in ENDING and event.level not in INFORMING and is_about:
                kind = event.data.get("safety_type", event.name)
                raise DeviceError(
                    f"the Haply service reports {kind} of the Inverse3 {self.device_id}"
                    f" ({event.message or event.level}): see that it is free and nobody else drives"
                    " it, then launch or resume again"
                )

    @property
    def zero(self) -> bytes:
        """What ends the force and the session, on the wire."""
        return framed(self.force(NO_FORCE)) + end_of_session()

    def close(self) -> None:
        """End both connections."""
        self.connection.close()
        self.events.close()


def _check_idle(device: Inverse3) -> None:
    """Check that nobody drives a device, and that it can be driven; DeviceError if not."""
    name = f"the Inverse3 {device.device_id}"
    if device.status.in_use or device.state.control_mode not in ("idle", ""):
        raise DeviceError(
            f"{name} is driven by another session, whose forces would add to these: end the other"
            " program, the Haply Hub's demos among them"
        )
    if device.lack:
        raise DeviceError(
            f"{name} is not {device.lack}: give it power, and calibrate it as its maker describes"
            " (the Haply Hub does)"
        )


class Settings:
    """What is set before any force, and put back at the end where it outlives the session."""

    def __init__(self, model: "HaplyInverse3", session: Session) -> None:
        self._model, self._session = model, session
        self._path = f"/inverse3/{session.device_id}/config/torque_scaling"
        self._torque_scaling: bool | None = None  # before
        self.force_scale = setting(session.address, "devices/force_scale", float)
        if not 0.0 < self.force_scale <= 1.0:
            raise DeviceError(
                f"the Haply service multiplies every force by {self.force_scale:g}"
                " (devices/force_scale); expected above 0 and at most 1: set it to 1, in the Haply"
                " Hub"
            )
        device = {
            "basis": {"permutation": model.basis},
            "damping": {"scalar": 0.0},
            "force_gate": {"gain": model.force_gate},
        }
        configure = to_device(session.device_id, (), configure=device)
        configure["session"] = {"configure": {"profile": {"name": PROFILE}}}
        session.asked(configure)
        self._check()
        if self.force_scale < 1.0:
            words = "the Haply service gives %.3g of every force (devices/force_scale, of all)"
            _logger.warning(words, self.force_scale)

    def _check(self) -> None:
        """Read back what was set, compare what may not be changed; DeviceError if one differs."""
        model, session = self._model, self._session
        full = session.asked({"session": {"force_render_full_state": {}}})
        device = chosen(full.inverse3, session.device_id)
        config = device.config
        if config is None or config.filters is None or config.basis is None:
            raise DeviceError(
                f"the Haply service at {session.address} does not say how the Inverse3"
                f" {session.device_id} is configured: expected a service of version 3.5"
            )
        if config.gravity_compensation.enabled is not model.gravity_compensation:
            raise DeviceError(
                f"gravity_compensation is {_on(config.gravity_compensation.enabled)} at the device,"
                f" and {_on(model.gravity_compensation)} in the launch file: it belongs to the"
                " device; set it in the Haply Hub, or state it in the launch file"
            )
        filters = config.filters
        damping = filters.damping.vector or Xyz(0.0, 0.0, 0.0)
        transforms = (config.mount, device.state.transform)
        scales = [(t.scale.x, t.scale.y, t.scale.z) for t in transforms if t is not None]
        found = {
            "basis": (config.basis.permutation, model.basis),
            "force_gate": (filters.force_gate.gain, model.force_gate),
            "damping": (filters.damping.scalar, 0.0),
            "damping along axes": ((damping.x, damping.y, damping.z), NO_FORCE),
            "scale": (scales, [(1.0, 1.0, 1.0)] * len(scales)),
        }
        for name, (kept, expected) in found.items():
            if kept != expected:
                raise DeviceError(
                    f"the Haply service keeps {name} at {kept}, expected {expected}: close the"
                    " Haply Hub, which changes the settings of sessions that it knows"
                )
        if config.torque_scaling.enabled is not model.torque_scaling:
            self._torque_scaling = config.torque_scaling.enabled
            self._set_torque_scaling(model.torque_scaling)
            _logger.warning(
                "torque_scaling is now %s: it belongs to the device, not to this session; it is put"
                " back at the end",
                _on(model.torque_scaling),
            )

    def _set_torque_scaling(self, is_on: bool) -> None:
        after = ask(self._session.address, self._path, {"enabled": is_on})
        if after != {"enabled": is_on}:
            raise DeviceError(f"the Haply service keeps torque_scaling at {after}")

    def put_back(self) -> None:
        """Set what outlives the session to what it was; say so if that fails."""
        if self._torque_scaling is not None:
            try:
                self._set_torque_scaling(self._torque_scaling)
            except DeviceError as error:
                words = "torque_scaling of the device stays %s: %s"
                _logger.error(words, _on(not self._torque_scaling), error)


def _on(is_on: bool) -> str:
    return "on" if is_on else "off"
