"""Cost of observers: lateness and loop delay of the servo of a running graph with each.

In turns in each round, which has a graph of its own: the baseline without any; one command after
the other, its start and end included; the bridges to PlotJuggler and Foxglove, each with a client
that receives all topics; and the live page, with three programs that read what pages receive. They
must not disturb the servo.
"""

import asyncio
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import AsyncIterator, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import zmq
import zmq.asyncio
from tornado.websocket import websocket_connect

from benchmarks.harness import BareLoop, Figure, Measured, Result, between_loops, compare, note
from forcebound.errors import RunError
from forcebound.messages.topology import ONE_HAND
from forcebound.observe.measure import Round
from forcebound.recordings.recording import read

DURATION = 90.0
ASKED = "cost of the live page with three readers for the servo"
SECONDS = 3.0  # of each turn
END_TIMEOUT_S = 120.0
BASELINE = "baseline"
TARGET = 1.05  # times the baseline
COMMANDS = ("list --watch", "echo telemetry --json", "hz", "graph", "delay --links", "log")
TOPICS = tuple(dict.fromkeys(stream.topic for stream in ONE_HAND.streams))
PORTS = {"plotjuggler": 19872, "foxglove": 18765}
PAGE, READERS = "live page", 3


class Turn(NamedTuple):
    """A part of a run: the observer, and when it was there, in ns of the monotonic clock."""

    observer: str
    begin_ns: int
    end_ns: int


@dataclass(frozen=True)
class Graph:
    """A running graph.

    Attributes:
        launcher: Its process.
        variables: Of the environment, for commands that look at it.
        address: Of its page; who has it may change the graph. Empty: there is no page.
    """

    launcher: "subprocess.Popen[Any]"
    variables: Mapping[str, str]
    address: str = ""

    def run_for(self, seconds: float) -> None:
        """Let it run for a time.

        Raises:
            RunError: If it ends before.
        """
        try:
            self.launcher.wait(seconds)
        except subprocess.TimeoutExpired:
            return
        raise RunError(f"the graph has ended, status {self.launcher.returncode}")


@contextmanager
def graph(folder: str, *words: str) -> Iterator[Graph]:
    """Run ``forcebound launch`` with ``words``, from the first force on."""
    variables = {**os.environ, "XDG_RUNTIME_DIR": folder}
    command = [sys.executable, "-u", "-m", "forcebound", "launch", *words]
    quiet: dict[str, Any] = {"stdout": subprocess.DEVNULL, "stderr": subprocess.PIPE, "text": True}
    running = subprocess.Popen(command, env=variables, **quiet)
    try:
        next(line for line in running.stderr or () if "ramping force up" in line)
        yield Graph(running, variables)
    finally:
        running.send_signal(signal.SIGINT)
        running.communicate(timeout=END_TIMEOUT_S)


@contextmanager
def page(running: Graph) -> Iterator[Graph]:
    """Serve the page of a graph."""
    command = [sys.executable, "-u", "-m", "forcebound", "view", "--no-open"]
    command += ["--launcher", str(running.launcher.pid)]
    with _serving(command, running, subprocess.PIPE) as server:
        assert server.stdout is not None
        yield replace(running, address=server.stdout.readline().decode().split()[-1])


@contextmanager
def _serving(command: list[str], running: Graph, stdout: int) -> Iterator["subprocess.Popen[Any]"]:
    quiet = subprocess.DEVNULL
    with subprocess.Popen(command, env=running.variables, stdout=stdout, stderr=quiet) as server:
        try:
            yield server
        finally:
            server.send_signal(signal.SIGINT)
            server.wait(END_TIMEOUT_S)


def run(duration: float, rate: float) -> Result:
    """Run the benchmark, at the rate of the launch file."""
    observers = (BASELINE, *COMMANDS, *PORTS, PAGE)
    found: dict[tuple[str, str], Measured] = {}
    loops: list[BareLoop] = []
    for _ in between_loops(max(2, int(duration / SECONDS / len(observers))), loops):
        with tempfile.TemporaryDirectory(prefix="fb-") as folder:
            record = Path(folder) / "run.mcap"
            words = ("stiff_wall", "--duration", "30min", "--record", str(record))
            with graph(folder, *words) as running:
                taken = [_turn(observer, running) for observer in observers]
            for (name, observer), times_ns in servo(record, taken).items():
                empty = Measured(f"{name}, {observer}", loops=loops)
                found.setdefault((name, observer), empty).rounds.append(Round(times_ns))
    figures: list[Figure] = [
        compare(one, found[name, BASELINE], share, TARGET, shown(name, observer, share))
        for (name, observer), one in found.items()
        for share in ("p50", "p99")
        if observer != BASELINE
    ]
    return list(found.values()), figures


def shown(name: str, observer: str, share: str) -> str:
    """Return how the page calls a figure; empty: it is not on the page."""
    return f"the {name} without it ({share})" if (observer, share) == (PAGE, "p99") else ""


def _turn(observer: str, running: Graph) -> Turn:
    note(observer)
    program = [sys.executable, "-m", "forcebound"]
    (run_dir,) = Path(running.variables["XDG_RUNTIME_DIR"]).glob("forcebound-*")
    here = [str(run_dir)]  # other graphs may run
    if not observer.startswith("delay"):  # which has no option for it
        here.insert(0, "--run")
    begin_ns = time.monotonic_ns()
    if observer in PORTS:
        command = [*program, "bridge", observer, *TOPICS, *here]
        command += ["--port", str(PORTS[observer])]
        with _serving(command, running, subprocess.DEVNULL):
            begin_ns = asyncio.run(_receive(CLIENTS[observer](PORTS[observer])))
    elif observer == PAGE:
        with page(running) as served:
            address = served.address.replace("http:", "ws:").replace("/?", "/live?")
            begin_ns = asyncio.run(_receive(*(_as_page(address) for _ in range(READERS))))
    elif observer in COMMANDS:
        command = [*program, *observer.split(), *here, "--duration", f"{SECONDS} s"]
        subprocess.run(command, env=running.variables, stdout=subprocess.DEVNULL, check=True)
    else:
        running.run_for(SECONDS)
    return Turn(observer, begin_ns, time.monotonic_ns())


async def _receive(*clients: AsyncIterator[object]) -> int:
    """Let clients receive for the time of a turn; return when the first one began to, in ns."""
    received = asyncio.Event()

    async def listen(client: AsyncIterator[object]) -> None:
        async for _ in client:
            received.set()

    listening = [asyncio.create_task(listen(client)) for client in clients]
    try:
        await asyncio.wait_for(received.wait(), END_TIMEOUT_S)
    except TimeoutError:
        raise RunError(f"no client received anything within {END_TIMEOUT_S:g} s") from None
    begin_ns = time.monotonic_ns()
    await asyncio.sleep(SECONDS)
    for task in listening:
        task.cancel()
    return begin_ns


async def _connected(address: str, **options: Any) -> Any:
    while True:
        try:
            return await websocket_connect(address, **options)
        except OSError:  # it does not serve yet
            await asyncio.sleep(0.1)


async def _as_page(address: str) -> AsyncIterator[object]:
    client = await _connected(address)
    while (got := await client.read_message()) is not None:
        yield got


async def _as_plotjuggler(port: int) -> AsyncIterator[object]:
    with zmq.asyncio.Context() as context, context.socket(zmq.SUB) as subscriber:
        subscriber.subscribe(b"")
        subscriber.connect(f"tcp://127.0.0.1:{port}")
        while True:
            yield await subscriber.recv_multipart()


async def _as_foxglove(port: int) -> AsyncIterator[object]:
    """Subscribe to every channel, and receive their messages."""
    client = await _connected(f"ws://127.0.0.1:{port}", subprotocols=["foxglove.sdk.v1"])
    while (got := await client.read_message()) is not None:
        if isinstance(got, bytes):
            yield got
        elif (answer := json.loads(got))["op"] == "advertise":
            topics = [{"id": one["id"], "channelId": one["id"]} for one in answer["channels"]]
            await client.write_message(json.dumps({"op": "subscribe", "subscriptions": topics}))


CLIENTS = {"plotjuggler": _as_plotjuggler, "foxglove": _as_foxglove}


def lateness(time_ns: Any, period_ns: float) -> Any:
    """Return how much later than the earliest of its turn each write is in its period, in ns."""
    angle = 2.0 * np.pi * (((time_ns - time_ns[0]) / period_ns) % 1.0)
    middle = np.angle(np.exp(1j * angle).mean())
    phase = np.angle(np.exp(1j * (angle - middle))) / (2.0 * np.pi) * period_ns
    return phase - np.percentile(phase, 1)


def servo(record: Path, turns: Sequence[Turn]) -> dict[tuple[str, str], list[int]]:
    """Return lateness of the writes and loop delay with each observer, in ns."""
    recording = read(record)
    columns, period_ns = recording.telemetry, 1e9 / recording.launch["device"]["rate"]
    found: dict[tuple[str, str], list[int]] = {}
    for observer, begin_ns, end_ns in turns:
        here = (columns.time_ns >= begin_ns) & (columns.time_ns < end_ns)
        late, delay = lateness(columns.time_ns[here], period_ns), columns.loop_delay[here] * 1e9
        found["lateness", observer] = late.astype(int).tolist()
        found["loop delay", observer] = delay[np.isfinite(delay)].astype(int).tolist()
    return found
