"""A Haply service that answers as a test has it, on ports of its own: golden messages, threads."""

import json
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from websockets.frames import Frame, Opcode
from websockets.server import ServerProtocol

GOLDEN = Path(__file__).parent / "golden" / "inverse3"
Document = dict[str, Any]
#: Returns the replies to a message, of which it gets the number, from 0, and what is usual.
Script = Callable[[int, Document], list[bytes]]


def golden(name: str) -> Any:
    return json.loads((GOLDEN / name).read_text())


def packed(document: Any) -> bytes:
    return json.dumps(document).encode()


class ScriptedService:
    """The service; it has one Inverse3, which gives exactly the force that is set.

    Attributes:
        inventory: Its devices, configured; states have the same without ``config``.
        version: Answer to a request for it; None: there is no such path.
        force_scale: Setting of all devices.
        messages: That have come, decoded.
        script: What it answers in place of a state; None: one state.
        sessions: Number of open ones.
    """

    def __init__(self) -> None:
        self.inventory: Document = golden("from_service/inventory.json")
        self.version: str | None = "3.5.0.0"
        self.force_scale: object = 1.0
        self.bind_all_interfaces = False
        self.messages: list[Document] = []
        self.posts: list[tuple[str, Any]] = []
        self.script: Script | None = None
        self.sessions = 0
        self._events: list[socket.socket] = []
        self._open: list[socket.socket] = []
        self._listening = [socket.create_server(("127.0.0.1", 0)) for _ in range(2)]
        self.port, self.events_port = (one.getsockname()[1] for one in self._listening)
        for listening, is_events in zip(self._listening, (False, True), strict=True):
            threading.Thread(target=self._accept, args=(listening, is_events), daemon=True).start()

    @property
    def device(self) -> Document:
        found: Document = self.inventory["inverse3"][0]
        return found

    @property
    def forces(self) -> list[tuple[float, float, float]]:
        """All that were set, in N, along the service's axes."""
        sent = [message.get("inverse3", [{}])[0].get("commands", {}) for message in self.messages]
        vectors = [
            each["set_cursor_force"]["vector"] for each in sent if "set_cursor_force" in each
        ]
        return [(each["x"], each["y"], each["z"]) for each in vectors]

    def report(self, event: Document) -> None:
        """Send an event to all who listen."""
        for one in self._events:
            one.sendall(Frame(Opcode.TEXT, packed(event)).serialize(mask=False))

    def state(self) -> Document:
        """Return a state: the inventory without its configuration."""
        found: Document = json.loads(packed(self.inventory))
        for group in ("inverse3", "verse_grip", "wireless_verse_grip"):
            for device in found.get(group, ()):
                device.pop("config", None)
        return found

    def stop(self) -> None:
        """End all sessions, and listen no more."""
        for one in (*self._listening, *self._open):
            with suppress(OSError):
                one.shutdown(socket.SHUT_RDWR)
            one.close()

    def _accept(self, listening: socket.socket, is_events: bool) -> None:
        with suppress(OSError):
            while True:
                connection = listening.accept()[0]
                connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                self._open.append(connection)
                serve = self._serve_events if is_events else self._serve
                threading.Thread(target=serve, args=(connection,), daemon=True).start()

    def _serve_events(self, connection: socket.socket) -> None:
        with suppress(OSError), connection:
            self._upgrade(connection, connection.recv(65536))
            self._events.append(connection)
            while connection.recv(65536):
                pass
            self._events.remove(connection)

    def _serve(self, connection: socket.socket) -> None:
        with suppress(OSError), connection:
            request = connection.recv(65536)
            if b"Upgrade: websocket" not in request:
                connection.sendall(self._answer(request, connection))
                return
            protocol = self._upgrade(connection, request)
            self.sessions += 1
            self._send(connection, [packed(self.inventory)])
            try:
                while data := connection.recv(65536):
                    protocol.receive_data(data)
                    for frame in protocol.events_received():
                        if isinstance(frame, Frame) and frame.opcode is Opcode.TEXT:
                            self._send(connection, self._replies(json.loads(bytes(frame.data))))
                        elif isinstance(frame, Frame) and frame.opcode is Opcode.CLOSE:
                            return
            finally:
                self.sessions -= 1

    def _upgrade(self, connection: socket.socket, request: bytes) -> ServerProtocol:
        protocol = ServerProtocol()
        protocol.receive_data(request)
        (asked,) = protocol.events_received()
        protocol.send_response(protocol.accept(asked))  # type: ignore[arg-type]
        connection.sendall(b"".join(protocol.data_to_send()))
        return protocol

    def _send(self, connection: socket.socket, messages: list[bytes]) -> None:
        for message in messages:
            connection.sendall(Frame(Opcode.TEXT, message).serialize(mask=False))

    def _replies(self, message: Document) -> list[bytes]:
        self.messages.append(message)
        for device in message.get("inverse3", ()):
            self._take(device)
        is_full = "force_render_full_state" in message.get("session", {})
        state = self.inventory if is_full else self.state()
        if self.script is not None:
            return self.script(len(self.messages) - 1, state)
        return [packed(state)]

    def _take(self, message: Document) -> None:
        config, state = self.device["config"], self.device["state"]
        for name, value in message.get("configure", {}).items():
            where = config["filters"] if name in ("damping", "force_gate") else config
            where[name] = value
        force = message.get("commands", {}).get("set_cursor_force")
        if force is not None:
            state["current_cursor_force"] = force["vector"]

    def _answer(self, request: bytes, connection: socket.socket) -> bytes:
        head, _, body = request.partition(b"\r\n\r\n")
        method, path, _ = head.split(b"\r\n")[0].decode().split()
        if method == "POST":
            while b"}" not in body:
                body += connection.recv(65536)
        status, found = 200, self._found(method, path, body)
        if found is None:
            status, found = 404, {"ok": False, "error": "resource not found"}
        text = packed(found)
        return b"HTTP/1.1 %d X\r\nContent-Length: %d\r\n\r\n%s" % (status, len(text), text)

    def _found(self, method: str, path: str, body: bytes) -> Document | None:
        if path == "/version" and self.version is not None:
            return {"project_name": "haply-inverse-service", "project_version": self.version}
        if path == "/devices":
            return {"ok": True, "data": self.inventory}
        if path == "/settings/devices/force_scale":
            return {"ok": True, "data": self.force_scale}
        if path == "/settings/communication/events/port":
            return {"ok": True, "data": self.events_port}
        if path == "/settings/communication/bind_all_interfaces":
            return {"ok": True, "data": self.bind_all_interfaces}
        if method == "POST" and path.endswith("/config/torque_scaling"):
            self.device["config"]["torque_scaling"] = json.loads(body)
            self.posts.append((path, json.loads(body)))
            return {"ok": True, "data": json.loads(body)}
        return None


@contextmanager
def scripted_service() -> Iterator[ScriptedService]:
    service = ScriptedService()
    try:
        yield service
    finally:
        service.stop()
