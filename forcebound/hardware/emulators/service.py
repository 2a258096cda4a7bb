"""The Inverse3's service as a program: its channels on this machine, and the real time.

As much of HTTP/1.1 and of WebSockets (RFC 6455) as its clients use: no extension, messages in one
frame, each sent at once. The link points to the service's URL, and the ground truth is beside it
(:mod:`forcebound.hardware.emulators.pty`).
"""

import selectors
import socket
import time
from base64 import b64encode
from collections.abc import Callable, Sequence
from contextlib import suppress
from email import message_from_bytes
from hashlib import sha1
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, unquote, urlsplit

import msgspec

from forcebound import realtime
from forcebound.errors import ConfigError
from forcebound.haptics.hands import Operator
from forcebound.hardware.emulators.faults import Fault, Faults
from forcebound.hardware.emulators.inverse3 import Inverse3
from forcebound.hardware.emulators.inverse3_service import Service
from forcebound.hardware.emulators.program import be_punctual
from forcebound.hardware.emulators.pty import STEP, UNUSED_TIMEOUT_NS, Place
from forcebound.stop import Stop

HOST = "127.0.0.1"
EVENTS_AFTER = 19  # ports: 10020 is that of the events, 10001 that of the states
GONE_TIMEOUT_NS = 5_000_000_000  # without a session, of an emulator that is to end when unused
CHUNK = 65536  # bytes
KEY_SUFFIX = b"258EAFA5-E914-47DA-95CA-C5AB0DC85B11"  # RFC 6455, 1.3
TEXT, BINARY, CLOSE, PING, PONG = 1, 2, 8, 9, 10  # RFC 6455, 5.2
GOING_AWAY = (1001).to_bytes(2, "big")


class Client:
    """A connection: of HTTP, then perhaps of a WebSocket, which ``session`` then numbers.

    A listener at the channel of events is a session without a number.
    """

    def __init__(self, connection: socket.socket, has_states: bool) -> None:
        connection.setblocking(False)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.socket, self.has_states = connection, has_states
        self.is_websocket = False
        self.session: int | None = None
        self._inbox = bytearray()

    def send(self, data: bytes) -> None:
        """Send bytes; what the client does not take is lost."""
        with suppress(OSError):
            self.socket.sendall(data)

    def post(self, text: bytes, code: int = TEXT) -> None:
        """Send a message in one frame."""
        size = len(text)
        length = bytes([size]) if size < 126 else b"\x7e" + size.to_bytes(2, "big")
        self.send(bytes([0x80 | code]) + length + text)

    def read(self) -> bool:
        """Take what has come; return whether more may come."""
        try:
            data = self.socket.recv(CHUNK)
        except OSError:
            return False
        self._inbox += data
        return bool(data)

    def take_request(self) -> tuple[bytes, bytes] | None:
        """Return head and body of a request, if it has come as a whole."""
        head, end, rest = bytes(self._inbox).partition(b"\r\n\r\n")
        size = int(message_from_bytes(head.partition(b"\r\n")[2])["Content-Length"] or 0)
        if not end or len(rest) < size:
            return None
        self._inbox[:] = rest[size:]
        return head, rest[:size]

    def take_frame(self) -> tuple[int, bytes] | None:
        """Return code and content of a frame, if it has come as a whole."""
        inbox = self._inbox
        short = inbox[1] & 0x7F if len(inbox) > 1 else 0
        at = 2 + {126: 2, 127: 8}.get(short, 0)
        if len(inbox) < at + 4:
            return None
        size = short if at == 2 else int.from_bytes(inbox[2:at], "big")
        mask, content = inbox[at : at + 4], inbox[at + 4 : at + 4 + size]
        if len(content) < size:
            return None
        code = inbox[0] & 0xF
        del inbox[: at + 4 + size]
        key = int.from_bytes((mask * (size // 4 + 1))[:size], "big")
        return code, (int.from_bytes(content, "big") ^ key).to_bytes(size, "big")


class Server:
    """The channels of a service, at these ports of states and of events; 0: one that is free.

    ConfigError if it cannot listen there.
    """

    def __init__(self, service: Service, ports: Sequence[int]) -> None:
        self.service = service
        self._selector = selectors.DefaultSelector()
        self._listening: list[socket.socket] = []
        self._clients: set[Client] = set()
        for port, has_states in zip(ports, (True, False), strict=True):
            try:
                listening = socket.create_server((HOST, port))
            except OSError as error:
                raise ConfigError(
                    f"cannot listen at port {port} of {HOST}: {error.strerror}: end what listens"
                    " there, such as the real service, or choose another --port"
                ) from error
            self._selector.register(listening, selectors.EVENT_READ, (listening, has_states))
            self._listening.append(listening)
        self.ports = states, events = [each.getsockname()[1] for each in self._listening]
        known = {"communication/websocket/port": states, "communication/events/port": events}
        service.settings |= known

    def close(self) -> None:
        """End every connection, and listen no more."""
        for client in list(self._clients):
            if client.is_websocket:
                client.post(GOING_AWAY, CLOSE)
            self._end(client)
        for listening in self._listening:
            listening.close()
        self._selector.close()

    def step(self) -> None:
        """Wait for messages, at most a step of the mechanism, and go on."""
        for key, _ in self._selector.select(STEP):
            if isinstance(key.data, Client):
                self._read(key.data)
            else:
                listening, has_states = key.data
                client = Client(listening.accept()[0], has_states)
                self._selector.register(client.socket, selectors.EVENT_READ, client)
                self._clients.add(client)
        self.service.tick(time.monotonic_ns())
        self._send()

    def _send(self) -> None:
        service, now_ns = self.service, time.monotonic_ns()
        while service.outgoing and service.outgoing[0].due_ns <= now_ns:
            message = service.outgoing.popleft()
            for client in self._clients:
                if client.session == message.session:
                    client.post(message.text)
        while service.events:
            event = service.events.popleft()
            for client in self._clients:
                if client.is_websocket and not client.has_states:
                    client.post(event)

    def _read(self, client: Client) -> None:
        goes_on = client.read()
        while not client.is_websocket and (request := client.take_request()):
            self._answer(client, *request)
        while client.is_websocket and (frame := client.take_frame()):
            code, content = frame
            if code in (TEXT, BINARY) and client.session is not None:
                self.service.receive(client.session, content, time.monotonic_ns())
                self._send()
            elif code == PING:
                client.post(content, PONG)
            elif code == CLOSE:
                client.post(content, CLOSE)
                goes_on = False
        if not goes_on:
            self._end(client)

    def _answer(self, client: Client, head: bytes, body: bytes) -> None:
        """Answer a request of HTTP, or begin a WebSocket."""
        line, _, lines = head.partition(b"\r\n")
        method, target, *_ = [*line.decode("latin-1").split(), "", ""]
        now_ns, fields = time.monotonic_ns(), message_from_bytes(lines)
        if key := fields["Sec-WebSocket-Key"]:
            accept = b64encode(sha1(key.encode() + KEY_SUFFIX).digest()).decode()
            words = "HTTP/1.1 101 Switching Protocols\r\nUpgrade: websocket\r\nConnection: Upgrade"
            client.send(f"{words}\r\nSec-WebSocket-Accept: {accept}\r\n\r\n".encode())
            client.is_websocket = True
            if client.has_states:
                client.session, inventory = self.service.connect(now_ns)
                client.post(inventory)
            return
        url = urlsplit(target)
        selector = parse_qs(url.query).get("session", [""])[0]
        status, reply = self.service.request(method, unquote(url.path), selector, body, now_ns)
        text = msgspec.json.encode(reply)
        words = f"HTTP/1.1 {status} \r\nContent-Type: application/json"
        client.send(f"{words}\r\nContent-Length: {len(text)}\r\n\r\n".encode() + text)

    def _end(self, client: Client) -> None:
        self._selector.unregister(client.socket)
        client.socket.close()
        self._clients.discard(client)
        if client.session is not None:
            self.service.disconnect(client.session, time.monotonic_ns())


def run(
    parts: tuple[Any, Operator | None],
    link: Path,
    port: int,
    idle: float,
    faults: Sequence[Fault],
    until_unused: bool,
    say: Callable[[str], None],
    advice: str,
) -> None:
    """Run an emulated service until it is interrupted, or no longer used.

    The parts are the model of a device and a hand; ``idle`` is in s. ``say`` takes the lines for
    the terminal, the second of which is ``advice`` if there is any.
    """
    be_punctual()
    model, operator = parts
    with Stop() as stop, Place(link) as place:
        device = Inverse3(model, model.mass, operator, idle)
        service = Service(device, operator, Faults(faults), place.truth)
        service.port = str(link)
        server = Server(service, (port, port and port + EVENTS_AFTER))
        realtime.freeze_garbage()
        device.start(time.monotonic_ns())
        server.step()
        url = f"ws://{HOST}:{server.ports[0]}"
        place.show(url)
        say(f"an emulated haply_inverse3 at {url}; Ctrl-C ends it")
        if advice:
            say(advice)
        _serve(server, stop, until_unused)
    say(
        f"{service.replies} replies; lowest energy {device.lowest_energy:.3g} J;"
        f" force held without a message for at most {1e3 * device.longest_hold:.3g} ms"
    )


def _serve(server: Server, stop: Stop, until_unused: bool) -> None:
    """Let the service go on in real time, until a stop; or until no session has been there."""
    service, seen_ns, timeout_ns = server.service, time.monotonic_ns(), UNUSED_TIMEOUT_NS
    while not stop.requested:
        if service.is_away(time.monotonic_ns()):
            server.close()
            while service.is_away(time.monotonic_ns()) and not stop.requested:
                service.tick(time.monotonic_ns())  # the arm and its hand go on
                time.sleep(STEP)
            server = Server(service, server.ports)
        server.step()
        if service.sessions:
            seen_ns, timeout_ns = time.monotonic_ns(), GONE_TIMEOUT_NS
        elif until_unused and time.monotonic_ns() - seen_ns > timeout_ns:
            break
    server.close()
