"""The service of Haply's Inverse devices, version 3.5: its channels, its messages, its settings.

The channel for simulations is a WebSocket: an inventory on connection, then exactly one state for
each message. A connection is a session: it ends with the connection, and with it all that the
session has set. Settings over HTTP, at the same address, are those of the device or of the service,
and outlive it. Events come over a WebSocket of their own, which takes no messages.

Source: the maker's documentation (docs.haply.co, Inverse SDK 3.5).
"""

import http.client
import os
import select
import socket
import time
from collections import deque
from collections.abc import Sequence
from typing import Any, TypeVar

import msgspec

from forcebound.errors import DeviceError
from forcebound.extras import check_installed
from forcebound.hardware.inverse_messages import Inverse3, parse
from forcebound.hardware.port import Port
from forcebound.hardware.ports import SerialPort

CONNECT = 2.0  # s, for a connection, a setting, and the inventory
SOON = 0.3  # s, for a service of which nobody says that it is there
CLOSE, PING = 8, 9  # opcodes of frames; those below have data
CHUNK = 65536  # bytes; a state of five devices has 5000
SUPPORTED = [3, 5], [4]  # from the first version up, below the other
START = "start it (`systemctl start haply-inverse-service`, or the Haply Hub)"

Kind = TypeVar("Kind")


LOCAL = "localhost:10001"


class Connection(Port):
    """A WebSocket to the service: whole messages in until a deadline, frames out.

    It has no compression, and no small packet waits. DeviceError, with what to try, if there is no
    service at ``address``, a host and a port.
    """

    def __init__(self, address: str) -> None:
        check_installed("device: {kind: haply_inverse3}", "websockets")
        from websockets.client import ClientProtocol
        from websockets.uri import parse_uri

        self.path, self._what = address, f"the Haply service at {address}"
        self._messages, self._part = deque[bytes](), b""
        try:
            host, _, port = address.rpartition(":")
            self._socket = socket.create_connection((host.strip("[]"), port), CONNECT)
        except OSError as error:
            raise absent(self._what, error) from error
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._socket.setblocking(False)
        self.descriptor = self._socket.fileno()
        self._protocol = ClientProtocol(parse_uri(f"ws://{address}/"))
        try:
            self._open()
        except BaseException:
            self._socket.close()
            raise

    def _open(self) -> None:
        protocol, until_ns = self._protocol, time.monotonic_ns() + round(CONNECT * 1e9)
        protocol.send_request(protocol.connect())
        self._send_waiting()
        while protocol.state.name == "CONNECTING" and self._wait(until_ns):
            self._take_in()
        if protocol.state.name != "OPEN":
            reason = protocol.handshake_exc or f"no answer within {CONNECT:g} s"
            raise DeviceError(f"{self._what} opens no WebSocket ({reason}): is it this service?")

    def write(self, message: bytes) -> None:
        try:
            if self._socket.send(message) == len(message):
                return
        except BlockingIOError:
            pass
        except OSError as error:
            raise self._ended(error.strerror) from error
        raise DeviceError(f"{self._what} does not read: restart it")

    def read(self, count: int, deadline_ns: int) -> bytes:
        """Return the next message, whatever its length; nothing if none has come by the deadline.

        DeviceError if the service has ended the session.
        """
        while not self._messages:
            if not self._wait(deadline_ns):
                return b""
            self._take_in()
        return self._messages.popleft()

    def drain(self, quiet: float = 0.0) -> bytes:
        """Return what nobody has read."""
        data = b""
        while more := self.read(0, time.monotonic_ns() + round(1e9 * quiet)):
            data += more
        return data

    def close(self) -> None:
        self._socket.close()

    def _wait(self, deadline_ns: int) -> bool:
        wait_ns = max(deadline_ns - time.monotonic_ns(), 0)
        return bool(select.select((self.descriptor,), (), (), wait_ns * 1e-9)[0])

    def _take_in(self) -> None:
        try:
            data = self._socket.recv(CHUNK)
        except OSError as error:
            raise self._ended(error.strerror) from error
        if not data:
            raise self._ended()
        self._protocol.receive_data(data)
        for frame in self._protocol.events_received():
            self._keep(frame)
        if self._protocol.parser_exc is not None:
            raise DeviceError(f"{self._what} sends no WebSocket frames: is it this service?")
        self._send_waiting()

    def _keep(self, frame: Any) -> None:
        opcode = getattr(frame, "opcode", PING)  # the answer to the handshake has none
        if opcode == CLOSE:
            self.is_over = True
            raise self._ended()
        if opcode < CLOSE:
            self._part += frame.data
            if frame.fin:
                self._messages.append(self._part)
                self._part = b""

    def _send_waiting(self) -> None:
        for data in self._protocol.data_to_send():
            if data:
                self.write(data)

    def _ended(self, reason: str | None = "closed") -> DeviceError:
        return DeviceError(
            f"{self._what} has ended the session ({reason}): it was stopped or restarted; {START}"
            " and launch again"
        )


def absent(what: str, error: OSError) -> DeviceError:
    """Return the error that there is no service."""
    reason = error.strerror or error
    return DeviceError(f"{what} does not answer ({reason}): {START}, or correct device.service")


def ask(address: str, path: str, body: Any = None, timeout: float = CONNECT) -> Any:
    """Return the answer to a request over HTTP; with a ``body`` it sets something.

    DeviceError if there is no service, or it refuses.
    """
    what = f"the Haply service at {address}"
    http_client = http.client.HTTPConnection(address, timeout=timeout)
    try:
        text = None if body is None else msgspec.json.encode(body)
        headers = {"Content-Type": "application/json"}
        http_client.request("GET" if body is None else "POST", path, text, headers)
        answered = http_client.getresponse()
        found: Any = msgspec.json.decode(answered.read())
    except (http.client.HTTPException, msgspec.MsgspecError) as error:
        raise DeviceError(f"{what} gives no JSON for {path}: is it this service?") from error
    except OSError as error:
        raise absent(what, error) from error
    finally:
        http_client.close()
    if not isinstance(found, dict) or "ok" not in found:
        found = {"ok": answered.status == http.client.OK, "data": found, "error": answered.status}
    if not found["ok"]:
        raise DeviceError(f"{what} refuses {path}: {found.get('error')}")
    return found.get("data")


def check_version(address: str, timeout: float = CONNECT) -> str:
    """Return the version of a service; DeviceError if it is none that is known."""
    found = ask(address, "/version", timeout=timeout)
    text = found.get("project_version") if isinstance(found, dict) else None
    if not isinstance(text, str):
        raise DeviceError(f"what listens at {address} is no Haply service: correct device.service")
    version = [int(word) for word in text.split(".") if word.isdigit()]
    first, end = SUPPORTED
    if not first <= version < end:
        raise DeviceError(
            f"the Haply service at {address} is of version {text}; expected 3.5 or"
            f" later, below 4: {'use an older' if version >= end else 'update the'} service"
        )
    return text


def setting(address: str, name: str, kind: type[Kind], timeout: float = CONNECT) -> Kind:
    """Return a setting of the service, which holds for all devices; DeviceError if unknown."""
    found = ask(address, f"/settings/{name}", timeout=timeout)
    found = found.get("value") if isinstance(found, dict) else found
    try:
        return msgspec.convert(found, kind)
    except msgspec.ValidationError as error:
        raise DeviceError(f"the Haply service's setting {name} is {found!r}: {error}") from error


def devices(address: str, timeout: float = CONNECT) -> Sequence[Inverse3]:
    """Return the Inverse3 that a service has; DeviceError if there is no service."""
    return parse(msgspec.json.encode(ask(address, "/devices", timeout=timeout))).inverse3


def listed(address: str = LOCAL) -> list[SerialPort]:
    """Return the Inverse3 that a service has, as if at ports of their own; none without service."""
    try:
        words = f"Inverse3 of the Haply service {check_version(address, SOON)}"
        found = devices(address, SOON)
    except DeviceError:
        return []
    return [SerialPort(address, words, one.device_id, "haply_inverse3") for one in found]


def address_of(name: str, service: str) -> str:
    """Return where the service of a device is: of an emulator, a link with a ``/`` leads there."""
    try:
        return os.readlink(name).removeprefix("ws://") if "/" in name else service
    except OSError as error:
        raise DeviceError(f"expected the link of an emulator, got {name!r}: {error}") from error
