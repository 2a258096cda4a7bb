"""A session at the service of an Inverse3: its start, its settings, its end."""

import logging
import socket
import time
from collections.abc import Iterator
from contextlib import ExitStack
from typing import TYPE_CHECKING, Any

from forcebound.errors import DeviceError
from forcebound.hardware import inverse_service as service
from forcebound.hardware.inverse_messages import (
    Inverse3,
    Message,
    chosen,
    end_of_session,
    framed,
    parse,
    parse_event,
    to_device,
)
from forcebound.messages.packets import Vector

if TYPE_CHECKING:
    from forcebound.hardware.haply_inverse3 import HaplyInverse3

PROFILE = "forcebound"  # of the session, in the maker's programs
#: Events about the device that end its force, unless they are of a level that only informs.
ENDING = ("device-safety-triggered", "device-disconnected", "device-busy")
INFORMING = ("info", "notice")
NO_FORCE: Vector = (0.0, 0.0, 0.0)
IDENTITY = {"scale": {"x": 1.0, "y": 1.0, "z": 1.0}}  # of a transform
UNDAMPED = {"scalar": 0.0, "vector": {"x": 0.0, "y": 0.0, "z": 0.0}}

_logger = logging.getLogger(__name__)


class Session(service.Connection):
    """A session at the service, in which everything is set that is to be set before any force.

    DeviceError if there is no such service or device, another session drives it, or it is not as
    the model states.

    Attributes:
        device_id: Of its device.
        force_scale: Share of every force that the service gives, 0 to 1.
    """

    def __init__(self, model: "HaplyInverse3", name: str) -> None:
        address = service.address_of(name, model.service)
        self._model, self._address = model, address
        version = service.check_version(address)
        self.force_scale = service.setting(address, "devices/force_scale", float)
        if not 0.0 < self.force_scale <= 1.0:
            raise DeviceError(
                f"the Haply service multiplies every force by {self.force_scale:g}"
                " (devices/force_scale); expected above 0 and at most 1: set it to 1, in its Hub"
            )
        events_port = service.setting(address, "communication/events/port", int)
        super().__init__(address)
        if "/" in name:
            self.path = name  # which has the truth beside it
        self._others = ExitStack()  # that are closed after it
        try:
            self._events = service.Connection(f"{address.rpartition(':')[0]}:{events_port}")
            self._others.callback(self._events.close)
            self._begin()
        except BaseException:
            self.close()
            raise
        words = "the Inverse3 %s at the Haply service %s, version %s"
        _logger.info(words, self.device_id, address, version)
        if self.force_scale < 1.0:
            words = "the Haply service gives %.3g of every force (devices/force_scale)"
            _logger.warning(words, self.force_scale)

    def _begin(self) -> None:
        """Choose the device, and set what belongs to the session and to the device."""
        inventory, model = self._received(), self._model
        self._id, device = inventory.session_id, chosen(inventory.inverse3, model.port)
        self.device_id = device.device_id
        self._name = f"the Inverse3 {self.device_id}"
        self._grips = [(group, grip.device_id) for group, grip in inventory.grips]
        self.zero = framed(self.force(NO_FORCE)) + end_of_session()
        if model.serial_number not in ("", self.device_id):
            raise DeviceError(
                f"the numbers in the launch file are of the device {model.serial_number}, and this"
                f" is {self.device_id}: plug the other one in, or measure this one with `forcebound"
                " identify`"
            )
        self._others.callback(claim(device, self._address).close)
        if device.lack:
            raise DeviceError(
                f"{self._name} is not {device.lack}: give it power, and calibrate it as its maker"
                " describes (the Haply Hub does)"
            )
        filters = {"damping": UNDAMPED, "force_gate": {"gain": model.force_gate}}
        basis = {"permutation": model.basis}
        configure = to_device(self.device_id, (), configure={"basis": basis, **filters})
        self._asked({**configure, "session": {"configure": {"profile": {"name": PROFILE}}}})
        full = self._asked({"session": {"force_render_full_state": {}}})
        device = chosen(full.inverse3, self.device_id)
        gravity = {"enabled": model.gravity_compensation}
        expected = {"basis": basis, "filters": filters, "gravity_compensation": gravity}
        transforms = {"mount": IDENTITY, "transform": IDENTITY}
        found = {**device.config, "transform": device.state.transform}
        for name, kept, stated in _differences(found, {**expected, **transforms}):
            raise DeviceError(
                f"the Haply service keeps {name} at {kept}, expected {stated}: state it in the"
                " launch file or set it in the Haply Hub, then close that, which changes sessions"
            )
        if device.config.get("torque_scaling") != {"enabled": model.torque_scaling}:
            self._set_torque_scaling(model.torque_scaling)
            self._others.callback(self._put_back)

    def _received(self) -> Message:
        data = self.read(0, time.monotonic_ns() + round(1e9 * service.CONNECT))
        if not data:
            raise DeviceError(f"the Haply service at {self._address} is silent: restart it")
        return parse(data)

    def _asked(self, message: object) -> Message:
        """Send a message without force; return its reply."""
        self.write(framed(message))
        return self._received()

    def _set_torque_scaling(self, is_on: bool) -> None:
        path, wanted = f"/inverse3/{self.device_id}/config/torque_scaling", {"enabled": is_on}
        after = service.ask(self._address, path, wanted)
        if after != wanted:
            raise DeviceError(f"the Haply service keeps torque_scaling at {after}")
        words = "torque_scaling is %s now: it belongs to the device, and outlives the session"
        _logger.warning(words, "on" if is_on else "off")

    def force(self, force: Vector) -> dict[str, object]:
        """Return the message of a force, in N, along the service's axes."""
        commands = {"set_cursor_force": {"vector": dict(zip("xyz", force, strict=True))}}
        return to_device(self.device_id, self._grips, commands=commands)

    def state(self, data: bytes) -> Message:
        """Return the state in a reply, whose only Inverse3 is this one; DeviceError if it has none.

        Also if the device is no longer ready, or this is the reply of another session.
        """
        message = parse(data)
        own = [one for one in message.inverse3 if one.device_id == self.device_id]
        if None not in (self._id, message.session_id) and message.session_id != self._id:
            fault = f"the reply is of session {message.session_id}, this one is {self._id}"
            raise DeviceError(f"{fault}: restart the Haply service")
        if not own:
            there = ", ".join(one.device_id for one in message.inverse3) or "none"
            raise DeviceError(f"the reply has not {self._name} (it has {there}): is it unplugged?")
        if own[0].lack:
            raise DeviceError(f"{self._name} is no longer {own[0].lack}: see the Haply Hub")
        message.inverse3 = own
        return message

    def check(self) -> None:
        """Fail if the service has reported what ends the force, or has sent a second reply."""
        if extra := self.read(0, 0):
            raise DeviceError(
                f"the Haply service has sent two replies to one message, the second {extra[:60]!r}:"
                " restart it"
            )
        while data := self._events.read(0, 0):
            event = parse_event(data)
            is_about = event.data.get("device_id") == self.device_id
            if event.name in ENDING and event.level not in INFORMING and is_about:
                kind = event.data.get("safety_type", event.name)
                more = f" ({event.message})" if event.message not in ("", kind) else ""
                raise DeviceError(
                    f"the Haply service reports {kind} of {self._name}{more}: see that it is"
                    " plugged in and free and nobody else drives it, then launch or resume again"
                )

    def close(self) -> None:
        """End both connections, and put back what outlives the session."""
        super().close()
        self._others.close()

    def _put_back(self) -> None:
        try:
            self._set_torque_scaling(not self._model.torque_scaling)
        except DeviceError as error:
            _logger.error("torque_scaling cannot be put back: %s", error)


def claim(device: Inverse3, address: str) -> socket.socket:
    """Return what keeps other programs of this machine from a device, until it is closed.

    The service says ``in_use`` only while a session gives a force. The socket's abstract name ends
    with its process, and is that of all users; one service has several addresses, but one port.
    DeviceError if another session or program has the device.
    """
    name = f"the Inverse3 {device.device_id}"
    if device.status.get("in_use") or device.state.control_mode not in ("idle", ""):
        raise DeviceError(
            f"{name} is driven by another session, whose forces would add to these: end the other"
            " program, the Haply Hub's demos among them"
        )
    claimed = socket.socket(socket.AF_UNIX)
    try:
        claimed.bind(f"\0forcebound-inverse3-{address.rpartition(':')[2]}-{device.device_id}")
    except OSError as error:
        claimed.close()
        raise DeviceError(
            f"{name} is in use by another program of this machine, whose forces would add to these:"
            " end it"
        ) from error
    return claimed


def _differences(found: Any, stated: Any, name: str = "") -> Iterator[tuple[str, Any, Any]]:
    """Yield what differs from what is stated: its name, as found, as stated.

    A transform without a scale has the scale 1, a damping without a vector none along axes.
    """
    if isinstance(stated, dict):
        usual = IDENTITY if stated is IDENTITY else UNDAMPED if stated is UNDAMPED else {}
        there = {**usual, **found} if isinstance(found, dict) else {}
        for key, value in stated.items():
            yield from _differences(there.get(key), value, f"{name}.{key}".strip("."))
    elif found != stated:
        yield name, found, stated
