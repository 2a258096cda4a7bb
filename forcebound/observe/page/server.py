"""The server of the page: files, and a WebSocket for each page that is open."""

import asyncio
import json
import mimetypes
import signal
import socket
import time
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

import tornado.httpserver
import tornado.iostream
import tornado.web
import tornado.websocket

from forcebound.errors import ConfigError, ForceboundError
from forcebound.messages.events import (
    EPISODE_BEGINS,
    EPISODE_ENDS,
    LAW_CHANGED,
    PARAMETERS_SET,
)
from forcebound.messages.topology import HAND
from forcebound.observe.listing import list_graphs
from forcebound.observe.page.access import Access, hosts_of
from forcebound.observe.page.controls import Controls
from forcebound.observe.page.feed import Message, request_of
from forcebound.observe.page.pace import Limit
from forcebound.observe.page.reason import Recent
from forcebound.observe.page.shown import FRAME, ShownGraph

PAGE = Path(__file__).parent / "static"
PROCESSES_PERIOD = 1.0  # s between two looks at its processes
PING = 30.0  # s between two; as long may a page on a busy machine take to answer one
CLOSE_TIMEOUT_S = 1.0  # s that pages have to close
MOST_PAGES = 32
MOST_CONNECTIONS = 64  # besides those of pages; a page needs a few while it loads
MOST_REQUEST = 16_000  # B, of the head of a request; no route takes a body
IDLE = 10.0  # s that a connection may wait with its next request
MOST_MESSAGE = 64_000  # B, of a message from a page
MOST_WAITING = 2_000_000  # B that a page may leave unread before it misses frames
POLICY = "default-src 'self'; connect-src 'self'; img-src 'self' data:"
ALONE = "; frame-ancestors 'none'"


class Server:
    """A server for pages that show one running graph, and then perhaps another one; to be closed.

    It serves in the event loop in which it is made, at any port that is free for port 0. ``access``
    has the addresses of the page; with ``embed`` other pages may show it in a frame.

    Raises:
        ConfigError: If the address cannot be listened at.
    """

    index: ClassVar[str] = "index.html"

    def __init__(
        self,
        listen: str = "127.0.0.1",
        port: int = 0,
        recordings: Path = Path(),
        *,
        embed: bool = False,
    ) -> None:
        listening = _bound(listen, port)
        self.access = Access(hosts_of(listen), listening.getsockname()[1])
        self.graph: ShownGraph | None = None  # that is shown
        self.is_stopped = False
        self._loop = asyncio.get_running_loop()
        self._loop.add_signal_handler(signal.SIGTERM, self.stop)
        self._recordings, self.embed = recordings, embed
        self.last: Path | None = None  # shown before; its launcher may still compute the result
        self.pages: set[_Page] = set()
        self.workers = ThreadPoolExecutor(1, "controls")  # one change after the other
        own = {"server": self}
        routes = [
            (r"/", _Index, own),
            (r"/live", _Page, own),
            (r"/file/([0-9a-f]{64})", _SceneFile, own),
            (r"/([a-z]+\.(?:js|css|svg))", _File, own),
        ]
        application = tornado.web.Application(
            routes,
            websocket_ping_interval=PING,
            websocket_max_message_size=MOST_MESSAGE,
            log_function=lambda request: None,  # an address has its token
        )
        self._http = _Http(
            application,
            max_header_size=MOST_REQUEST,
            max_body_size=0,
            max_buffer_size=10 * MOST_MESSAGE,
            idle_connection_timeout=IDLE,
        )
        self._http.add_socket(listening)

    def stop(self) -> None:
        """End :meth:`show`."""
        self.is_stopped = True

    async def show(self, run_dir: Path) -> None:
        """Show a graph until it ends, or :meth:`stop`; ConfigError if none runs there."""
        controls = await self._loop.run_in_executor(None, Controls, run_dir, self._recordings)
        try:
            await self._follow(ShownGraph(run_dir, controls, self._pointed))
        finally:
            self.graph = None
            self.broadcast(*self.describe())
            # After what is under way.
            await self._loop.run_in_executor(self.workers, controls.close)
            self.broadcast(controls.recording.describe())

    async def _follow(self, graph: ShownGraph) -> None:
        """Send the pages what comes from a graph, until its end."""
        self.graph, loop = graph, self._loop
        for pointer in graph.pointers.values():
            loop.add_reader(pointer.descriptor, pointer.send)
        for page in tuple(self.pages):
            page.greet()
        loop.run_in_executor(None, self._foresee, graph)
        next_nodes = 0.0
        looking: asyncio.Future[None] | None = None  # may wait for a law that is being compiled
        try:
            while not (graph.watch.is_over or self.is_stopped):
                started = time.monotonic()
                for message in graph.look(started):
                    self._note(message)
                    self.broadcast(message)
                for pointer in graph.pointers.values():
                    pointer.send()
                is_free = looking is None or looking.done()
                if self.pages and is_free and started >= next_nodes:
                    next_nodes = started + PROCESSES_PERIOD
                    recent = {name: one.recent for name, one in graph.feed.hands.items()}
                    look = partial(self._look_at_nodes, graph, recent)
                    looking = loop.run_in_executor(self.workers, look)
                period = FRAME * graph.pace.slowness
                await asyncio.sleep(max(0.0, period - (time.monotonic() - started)))
        finally:
            if graph.watch.was_launched:  # else its run directory may be used again
                self.last = graph.run_dir
            for pointer in graph.pointers.values():
                loop.remove_reader(pointer.descriptor)
            graph.close()

    def describe(self) -> list[Message]:
        """Return what a page that opens needs to know."""
        return [{"type": "over"}] if self.graph is None else self.graph.describe()

    def receive(self, page: "_Page", request: Message) -> None:
        """Do what a page that may change the graph asks for."""
        if (graph := self.graph) is None:
            page.answer(request, "no graph runs")
        elif request["do"] == "point":
            hand = str(request.get("hand", HAND))
            pointer = graph.pointers.get(hand)
            error: str | None = f"no hand {request.get('hand')!r}"
            if pointer is not None:
                graph.let_be(hand)
                error = pointer.point(request.get("target"), (page, request.get("stamp")))
            if error is not None:
                page.answer(request, error)
        else:
            counts = graph.controls.receive(request)
            self.workers.submit(self._act, page, graph, request, counts)

    def _act(
        self, page: "_Page", graph: ShownGraph, request: Message, counts: Callable[[], bool]
    ) -> None:
        controls = graph.controls
        error = controls.act(request, counts)
        if request["do"] == "safe" and error is None and counts():
            self.later(graph.press_again)
        self.later(page.answer, request, error)
        self.later(self.broadcast, controls.recording.describe())
        self.broadcast_parameters(controls)

    def opened(self, page: "_Page") -> None:
        """Note that a page has opened."""
        self.pages.add(page)

    def closed(self, page: "_Page") -> None:
        """Note that a page has closed."""
        self.pages.discard(page)

    def broadcast(self, message: Message) -> None:
        """Send a message to every page; one that does not read misses it."""
        if self.pages:
            text = json.dumps(message)
            for page in tuple(self.pages):
                page.send(text)

    def _note(self, message: Message) -> None:
        """Keep an event; send the parameters to the pages again when some have changed."""
        if message["type"] == "event" and self.graph:
            self.graph.events.append(message)
        shown = (LAW_CHANGED, PARAMETERS_SET, EPISODE_BEGINS, EPISODE_ENDS)
        if message.get("event") in shown and self.graph:
            self.workers.submit(self.broadcast_parameters, self.graph.controls)

    def broadcast_parameters(self, controls: Controls) -> None:
        """Send the pages parameters and episodes of a graph; from a thread: it takes time."""
        with suppress(ForceboundError):  # the graph has ended
            self.later(self.broadcast, controls.parameters())
            self.later(self.broadcast, controls.count_episodes())

    def _pointed(self, stamp: tuple["_Page", Any]) -> None:
        """Report to a page that the device has taken its place."""
        page, own = stamp
        page.send(json.dumps({"type": "taken", "stamp": own}))

    def _foresee(self, graph: ShownGraph) -> None:
        """Show what the environment will show before it answers; in a thread: a file takes time."""
        with suppress(ForceboundError):  # the environment says what is wrong with its file
            objects = graph.controls.scene()
            self.later(lambda: self._show_scene(graph.feed.foresee(objects)))

    def _show_scene(self, scene: Message | None) -> None:
        if scene is not None:
            self.broadcast(scene)

    def _look_at_nodes(self, graph: ShownGraph, recent: Mapping[str, Recent]) -> None:
        """Send the pages the processes, and judge the hands; in a thread, since it takes time."""
        looked = time.monotonic()
        try:
            (listed,) = list_graphs(0.3, graph.run_dir)
            judged = graph.controls.judge(recent)
        except (ForceboundError, ValueError):
            return  # it ended just now
        self.later(graph.take_judged, judged)
        processes = [asdict(one) for one in listed.processes]
        self.later(self.broadcast, {"type": "nodes", "time": looked, "processes": processes})
        self.later(self.broadcast, graph.controls.recording.describe())

    def later(self, call: Callable[..., object], *arguments: object) -> None:
        """Call something in the server's own thread, from another one."""
        self._loop.call_soon_threadsafe(call, *arguments)

    async def close(self) -> None:
        """Report to the pages that the server closes, and end."""
        self.broadcast({"type": "closed"})
        for page in tuple(self.pages):
            page.close()
        end = time.monotonic() + CLOSE_TIMEOUT_S
        while self.pages and time.monotonic() < end:
            await asyncio.sleep(FRAME)
        self._http.stop()
        await self._http.close_all_connections()
        self.workers.shutdown(wait=True, cancel_futures=True)


class _Http(tornado.httpserver.HTTPServer):
    """An HTTP server that closes the connections that are too many."""

    def handle_stream(self, stream: tornado.iostream.IOStream, address: tuple[Any, ...]) -> None:
        if len(self._connections) >= MOST_CONNECTIONS:
            stream.close()
        else:
            super().handle_stream(stream, address)


def _bound(listen: str, port: int) -> socket.socket:
    try:
        family, *_, address = socket.getaddrinfo(listen, port, type=socket.SOCK_STREAM)[0]
        listening = socket.create_server(address[:2], family=family)
    except OSError as error:
        words = f"cannot listen at {listen}, port {port}: {error.strerror}"
        raise ConfigError(words) from error
    listening.setblocking(False)
    return listening


class _Handler(tornado.web.RequestHandler):
    """A request from a browser that calls this server by its own name, and has a token."""

    needs_token: ClassVar[bool] = True

    def initialize(self, server: Server) -> None:
        self.server = server

    def prepare(self) -> None:
        access, self.token = self.server.access, self.get_query_argument("token", "")
        if not access.permits_host(self.request.headers.get("Host")):
            raise tornado.web.HTTPError(403, "another host")
        if self.needs_token and not access.may_look(self.token):
            raise tornado.web.HTTPError(403, "no token")

    def set_default_headers(self) -> None:
        self.set_header("Content-Security-Policy", POLICY + ALONE)
        self.set_header("Referrer-Policy", "no-referrer")
        self.set_header("X-Content-Type-Options", "nosniff")
        self.set_header("Cache-Control", "no-store")

    def log_exception(self, *_: object) -> None:
        """Log nothing: the browser shows the status of a refusal."""


class _Index(_Handler):
    def get(self) -> None:
        if self.server.embed:
            self.set_header("Content-Security-Policy", POLICY)
        self.set_header("Content-Type", "text/html; charset=utf-8")
        self.write((PAGE / self.server.index).read_bytes())


class _File(_Handler):
    needs_token = False

    def get(self, name: str) -> None:
        file = PAGE / name
        if not file.is_file():
            raise tornado.web.HTTPError(404)
        self.set_header("Content-Type", mimetypes.guess_type(name)[0] or "text/plain")
        self.write(file.read_bytes())


class _SceneFile(_Handler):
    """Triangles of a mesh of the scene, or points of a cloud."""

    async def get(self, digest: str) -> None:
        loop, graph = asyncio.get_running_loop(), self.server.graph
        content = None
        if graph is not None:  # a change need not wait for it
            content = await loop.run_in_executor(None, graph.feed.file, digest)
        if content is None:
            raise tornado.web.HTTPError(404)
        self.write(content)


class _Page(_Handler, tornado.websocket.WebSocketHandler):
    """One open page."""

    def check_origin(self, origin: str) -> bool:
        return self.server.access.permits_origin(origin, self.request.headers.get("Host"))

    def prepare(self) -> None:
        super().prepare()
        if len(self.server.pages) >= MOST_PAGES:
            raise tornado.web.HTTPError(503, "too many pages")
        self.may_change = self.server.access.may_change(self.token)
        self._limit = Limit()

    def open(self, *_: str, **__: str) -> None:
        self.set_nodelay(True)
        self.greet()
        self.server.opened(self)

    def greet(self) -> None:
        """Send what a page needs to know of the graph that is shown now."""
        for message in self.server.describe():
            self.send(json.dumps({**message, "may_change": self.may_change}))

    async def on_message(self, message: str | bytes) -> None:
        request = request_of(message) if self._limit.permits(time.monotonic()) else None
        if self._limit.is_flooded:
            self.close(1008, "too many messages")
        if request is None:  # perhaps of a flood: tornado reads on and on
            await asyncio.sleep(0)  # the others' turn
        elif self.may_change:
            self.server.receive(self, request)
        else:
            self.answer(request, "this page may only look")

    def on_close(self) -> None:
        self.server.closed(self)

    def send(self, text: str) -> None:
        """Send a message unless the page has stopped reading."""
        stream = None if self.ws_connection is None else self.ws_connection.stream
        if stream is None or stream.closed():
            return
        if len(getattr(stream, "_write_buffer", ())) > MOST_WAITING:
            return
        try:
            sent = self.write_message(text)
        except tornado.websocket.WebSocketClosedError:
            self.server.closed(self)
        else:
            sent.add_done_callback(asyncio.Future.exception)  # it closed just now: no news

    def answer(self, request: Message, error: str | None) -> None:
        self.send(json.dumps({"type": "answer", "id": request.get("id"), "error": error}))
