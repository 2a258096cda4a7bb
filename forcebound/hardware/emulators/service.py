"""The Inverse3's service as a program: its channels on this machine, and the real time.

The link points to its URL; beside it is the ground truth, as beside a port
(:mod:`forcebound.hardware.emulators.pty`), and the service shows the link as the device's port.
"""

import asyncio
import os
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import tornado.httpserver
import tornado.netutil
import tornado.web
import tornado.websocket

from forcebound import realtime
from forcebound.errors import ConfigError
from forcebound.haptics.devices.truth_file import SUFFIX, TruthFile
from forcebound.haptics.hands import Operator
from forcebound.hardware.emulators.faults import Fault, Faults
from forcebound.hardware.emulators.inverse3 import Inverse3, Stated
from forcebound.hardware.emulators.inverse3_service import Service
from forcebound.hardware.emulators.program import be_punctual
from forcebound.hardware.emulators.pty import STEP, UNUSED_TIMEOUT_NS, claim
from forcebound.stop import Stop

HOST = "127.0.0.1"
EVENTS_AFTER = 19  # ports: 10020 is that of the events, 10001 that of the states
RESTART = 0.5  # s
GOING_AWAY = 1001  # RFC 6455, 7.4.1
GONE_TIMEOUT_NS = 5_000_000_000  # without a session, of an emulator that is to end when unused


class Server:
    """The channels of a service; a port of 0 takes two that are free.

    ConfigError if it cannot listen there.
    """

    def __init__(self, service: Service, port: int) -> None:
        self.service = service
        self._ports = [port, port and port + EVENTS_AFTER]
        self._sessions: dict[int, _States] = {}
        self.listeners: set[_Events] = set()
        self._servers: list[tornado.httpserver.HTTPServer] = []
        own: dict[str, Any] = {"server": self}
        rest = (r"/(.+)", _Settings, own)
        self._routes = [[(r"/", _States, own), rest], [(r"/", _Events, own)]]
        self.listen()
        self.url = f"ws://{HOST}:{self._ports[0]}"

    def listen(self) -> None:
        """Take clients, at the same ports as before."""
        for k, routes in enumerate(self._routes):
            application = tornado.web.Application(
                routes,  # type: ignore[arg-type]
                log_function=lambda request: None,
            )
            server = tornado.httpserver.HTTPServer(application)
            try:
                (listening,) = tornado.netutil.bind_sockets(self._ports[k], HOST)
            except OSError as error:
                raise ConfigError(
                    f"cannot listen at port {self._ports[k]} of {HOST}: {error.strerror}: end what"
                    " listens there, such as the real service, or choose another --port"
                ) from error
            self._ports[k] = listening.getsockname()[1]
            server.add_socket(listening)
            self._servers.append(server)
        states, events = self._ports
        self.service.settings["communication/websocket/port"] = states
        self.service.settings["communication/events/port"] = events

    async def leave(self) -> None:
        """End every connection, and listen no more."""
        for server in self._servers:
            server.stop()
        self._servers.clear()
        for number, states in list(self._sessions.items()):
            states.close(GOING_AWAY)
            self.closed(number)
        for listener in self.listeners:
            listener.close(GOING_AWAY)
        await asyncio.sleep(STEP)

    def step(self) -> None:
        """Move on to now, and send what is due."""
        time_ns = time.monotonic_ns()
        self.service.tick(time_ns)
        self.send(time_ns)

    def send(self, time_ns: int) -> None:
        """Send what is due now, and the events."""
        for message in self.service.due(time_ns):
            if message.session in self._sessions:
                self._sessions[message.session].post(message.text)
        while self.service.events:
            text = self.service.events.popleft()
            for listener in self.listeners:
                listener.post(text)

    def opened(self, states: "_States") -> int:
        """Begin a session, whose first message is the inventory."""
        number, inventory = self.service.connect(time.monotonic_ns())
        self._sessions[number] = states
        states.post(inventory)
        return number

    def received(self, session: int, text: bytes | str) -> None:
        """Take a message of a session."""
        time_ns = time.monotonic_ns()
        self.service.receive(session, text, time_ns)
        self.send(time_ns)

    def closed(self, session: int) -> None:
        """End a session."""
        self._sessions.pop(session, None)
        self.service.disconnect(session, time.monotonic_ns())


class _Socket(tornado.websocket.WebSocketHandler):
    """A connection that sends each message at once, uncompressed."""

    def initialize(self, server: Server) -> None:
        self._server = server

    def post(self, text: bytes) -> None:
        with suppress(tornado.websocket.WebSocketClosedError):
            self.write_message(text.decode())


class _States(_Socket):
    """A session."""

    def open(self, *_: str, **__: str) -> None:
        self.set_nodelay(True)
        self._session = self._server.opened(self)

    def on_message(self, message: str | bytes) -> None:
        self._server.received(self._session, message)

    def on_close(self) -> None:
        self._server.closed(self._session)


class _Events(_Socket):
    """A listener at the channel of events, which says nothing."""

    def open(self, *_: str, **__: str) -> None:
        self._server.listeners.add(self)

    def on_message(self, message: str | bytes) -> None:
        pass

    def on_close(self) -> None:
        self._server.listeners.discard(self)


class _Settings(tornado.web.RequestHandler):
    """Settings over HTTP."""

    def initialize(self, server: Server) -> None:
        self._server = server

    def get(self, path: str) -> None:
        self._answer(path)

    def post(self, path: str) -> None:
        self._answer(path)

    def _answer(self, path: str) -> None:
        query, body = self.get_query_argument("session", ""), self.request.body
        method, now = self.request.method or "", time.monotonic_ns()
        answer = self._server.service.request(method, path, query, body, now)
        self.set_status(answer.status)
        self.write(answer.body)


def run(
    parts: tuple[Stated, Operator | None],
    link: Path,
    port: int,
    idle: float,
    faults: Sequence[Fault],
    until_unused: bool,
    say: Callable[[str], None],
    advise: Callable[[str], str],
) -> None:
    """Run an emulated service until it is interrupted, or no longer used.

    The parts are the model of a device and a hand; ``idle`` is in s. ``say`` takes the lines for
    the terminal, the second of which is what ``advise`` says of the URL, if anything.
    """
    be_punctual()
    planned = [
        replace(one, duration=RESTART) if (one.kind, one.duration) == ("restart", None) else one
        for one in faults
    ]
    truth_path = Path(f"{link}{SUFFIX}")
    lock = claim(link, truth_path)
    truth = TruthFile(truth_path)
    try:
        with Stop() as stop:
            device = Inverse3(*parts, idle)
            service = Service(device, parts[1], Faults(planned), truth)
            service.port = str(link)
            service.start(time.monotonic_ns())
            asyncio.run(_serve(service, link, port, stop, until_unused, say, advise))
    finally:
        link.unlink(missing_ok=True)
        truth_path.unlink(missing_ok=True)
        truth.close()
        os.close(lock)
    say(
        f"{service.replies} replies; lowest energy {device.lowest_energy:.3g} J;"
        f" force held without a message for at most {1e3 * device.longest_hold:.3g} ms"
    )


async def _serve(
    service: Service,
    link: Path,
    port: int,
    stop: Stop,
    until_unused: bool,
    say: Callable[[str], None],
    advise: Callable[[str], str],
) -> None:
    """Let the service go on in real time."""
    server = Server(service, port)
    realtime.freeze_garbage()
    link.symlink_to(server.url)
    say(f"an emulated haply_inverse3 at {server.url}; Ctrl-C ends it")
    if advice := advise(server.url):
        say(advice)
    seen_ns, timeout_ns = time.monotonic_ns(), UNUSED_TIMEOUT_NS
    while not stop.requested:
        await asyncio.sleep(STEP)
        if service.is_away(time.monotonic_ns()):
            await server.leave()
            while service.is_away(time.monotonic_ns()) and not stop.requested:
                await asyncio.sleep(STEP)
            server.listen()
        server.step()
        if service.sessions:
            seen_ns, timeout_ns = time.monotonic_ns(), GONE_TIMEOUT_NS
        elif until_unused and time.monotonic_ns() - seen_ns > timeout_ns:
            break
    await server.leave()
