"""The walls in other languages as processes, and a graph of bytes that queries them."""

import itertools
import re
import signal
import subprocess
import tempfile
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
import zmq
from waiting import TIMEOUT, free_port

from forcebound.messages.codec import decode, encode
from forcebound.messages.packets import EnvironmentQuery, EnvironmentReply
from forcebound.network import sockets

ROOT = Path(__file__).parent.parent
EXAMPLES = ROOT / "examples"
LANGUAGES = {  # the command, and what a build leaves
    "cpp": ([str(EXAMPLES / "cpp/wall")], EXAMPLES / "cpp/wall"),
    "javascript": (
        ["node", str(EXAMPLES / "javascript/wall.js")],
        EXAMPLES / "javascript/node_modules/zeromq",
    ),
    "rust": (
        [str(EXAMPLES / "rust/target/release/wall")],
        EXAMPLES / "rust/target/release/wall",
    ),
}


SOURCES = {
    "cpp": "*.cpp",
    "javascript": "package.json",
    "rust": "src/*.rs",
}  # compiled, or installed


class Wall:
    """One of the programs, running."""

    def __init__(self, language: str, log: Path, *words: str) -> None:
        command, built = LANGUAGES[language]
        if not built.exists():
            pytest.skip(f"examples/{language} is not built: make examples")
        sources = (EXAMPLES / language).glob(SOURCES[language])
        if any(source.stat().st_mtime > built.stat().st_mtime for source in sources):
            pytest.skip(f"examples/{language} is newer than what is built of it: make examples")
        self._log = log
        with log.open("wb") as stream:
            self.process = subprocess.Popen(
                [*command, *words], stdin=subprocess.DEVNULL, stdout=stream, stderr=stream
            )

    @property
    def log(self) -> str:
        return self._log.read_text(errors="replace")

    @property
    def name(self) -> str:
        return self.log.partition(":")[0]

    def until(self, said: str) -> None:
        wait_until(lambda: said in self.log, said, self)

    def end(self, number: int = signal.SIGTERM) -> tuple[int, int]:
        """Ask it to end; return how many queries it has answered and how many packets dropped."""
        self.process.send_signal(number)
        assert self.process.wait(TIMEOUT) == 0, self.log
        counts = re.search(r"(\d+) answered, (\d+) dropped\n$", self.log)
        assert counts is not None, self.log
        return int(counts[1]), int(counts[2])


def wait_until(happened: Callable[[], object], what: str, *walls: Wall) -> None:
    end = time.monotonic() + TIMEOUT
    while not happened():
        logs = "\n".join(wall.log for wall in walls)
        assert all(wall.process.poll() is None for wall in walls), f"it ended:\n{logs}"
        assert time.monotonic() < end, f"waited {TIMEOUT} s for: {what}\n{logs}"
        sockets.wait((), 10_000_000)


@contextmanager
def walls_started() -> Iterator[Callable[..., Wall]]:
    with tempfile.TemporaryDirectory(prefix="fb-") as folder:
        walls: list[Wall] = []

        def start(language: str, *words: str) -> Wall:
            walls.append(Wall(language, Path(folder) / f"log{len(walls)}", *words))
            return walls[-1]

        try:
            yield start
        finally:
            for wall in walls:
                wall.process.kill()
                wall.process.wait()


class FakeGraph:
    """Stands in for a controller that listens: sends any bytes to who has greeted."""

    def __init__(self, context: "zmq.Context[zmq.Socket[bytes]]") -> None:
        self.socket = context.socket(zmq.ROUTER)
        self.socket.linger = 0
        self.port = free_port()
        self.socket.bind(f"tcp://127.0.0.1:{self.port}")
        self._routes: set[bytes] = set()
        self._replies: deque[bytes] = deque()

    def send(self, *frames: bytes) -> None:
        self._take()
        for route in self._routes:
            self.socket.send_multipart([route, *frames])

    def reply(self, timeout: float = TIMEOUT) -> EnvironmentReply | None:
        """Return the next reply, or None if none comes in time."""
        end = time.monotonic() + timeout
        self._take()
        while not self._replies:
            if not self.socket.poll(max(0, round((end - time.monotonic()) * 1e3))):
                return None
            self._take()
        packet = decode(self._replies.popleft())  # refuses what is not of this version in every key
        assert isinstance(packet, EnvironmentReply)
        return packet

    def _take(self) -> None:
        while self.socket.poll(0):
            route, *frames = self.socket.recv_multipart()
            self._routes.add(route)
            if frames != [b""]:
                self._replies.append(*frames)

    def ask(self, query: EnvironmentQuery) -> EnvironmentReply:
        """Send a query once and return what comes next."""
        self.send(encode(query))
        reply = self.reply()
        assert reply is not None, f"no answer within {TIMEOUT} s"
        return reply

    def meet(self) -> None:
        """Ask until answers come, and take them all."""
        end = time.monotonic() + TIMEOUT
        for seq in itertools.count():
            self.send(encode(query(seq)))
            if self.reply(0.05) is not None:
                break
            assert time.monotonic() < end, f"no answer within {TIMEOUT} s"
        reply = self.ask(query(seq + 1))
        while reply.query_seq != seq + 1:
            late = self.reply()
            assert late is not None, f"no answer within {TIMEOUT} s"
            reply = late


def query(seq: int, *position: float, environment: str | None = None) -> EnvironmentQuery:
    place = position or (0.0,)
    return EnvironmentQuery(seq, 2, 3, 4, 0.5, place, (0.0,) * len(place), environment)
