"""What the bridges to PlotJuggler and Foxglove cost the servo of a running graph.

In turns: nobody looks, PlotJuggler's bridge publishes all topics to a subscriber, Foxglove's serves
them all to a client. The servo must not notice. The clients only count what they get.
"""

import asyncio
import json
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import zmq
from tornado.websocket import websocket_connect

from benchmarks.harness import Figure, Result, note
from benchmarks.turns import ALONE, END_TIMEOUT_S, Graph, Turn, graph, servo
from forcebound.errors import RunError
from forcebound.messages.packets import TOPICS
from forcebound.monitor.snapshot import use_of

PORTS = {"plotjuggler": 19872, "foxglove": 18765}
POLL = 0.1  # s
DURATION = 54.0
SETTLE, SECONDS = 2.0, 4.0  # s, of each turn: what does not count, and what does


def run(duration: float, rate: float) -> Result:
    """Run the benchmark, at the rate of the launch file."""
    turns = max(2, int(duration / (SETTLE + SECONDS) / (1 + len(CLIENTS))))
    taken: list[Turn] = []
    rates: dict[str, list[Any]] = {program: [] for program in CLIENTS}
    with tempfile.TemporaryDirectory(prefix="fb-") as folder:
        record = Path(folder) / "run.mcap"
        words = ("stiff_wall", "--duration", "30min", "--record", str(record))
        with graph(folder, *words) as running:
            for _ in range(turns):
                taken.append(_turn(ALONE, running))
                for program in CLIENTS:
                    with bridge(program, running) as (pid, received):
                        before = np.array((_processor_time(pid), received.count))
                        taken.append(_turn(program, running))
                        after = np.array((_processor_time(pid), received.count))
                        rates[program].append((after - before) / (SETTLE + SECONDS))
        contestants, figures = servo(record, taken)
    for program, of in rates.items():
        share, rate_hz = np.median(of, axis=0).tolist()
        figures.append(Figure(f"{program}, processor", share, "%"))
        figures.append(Figure(f"{program}, messages a second", rate_hz))
    return contestants, figures


def _turn(viewers: str, running: Graph) -> Turn:
    """Let a turn pass, without what starting disturbs."""
    note(viewers)
    running.run_for(SETTLE)
    begin_ns = time.monotonic_ns()
    running.run_for(SECONDS)
    return Turn(viewers, begin_ns, time.monotonic_ns())


@dataclass
class Received:
    """What a client has received."""

    count: int = 0  # messages
    is_over: bool = False  # whether it is to end


def count_as_plotjuggler(port: int, received: Received) -> None:
    """Count the messages that a subscriber gets."""
    with zmq.Context() as context, context.socket(zmq.SUB) as subscriber:
        subscriber.set(zmq.SUBSCRIBE, b"")
        subscriber.connect(f"tcp://127.0.0.1:{port}")
        while not received.is_over:
            if subscriber.poll(round(POLL * 1e3)):
                subscriber.recv_multipart()
                received.count += 1


def count_as_foxglove(port: int, received: Received) -> None:
    """Count the messages that a client gets which subscribes to every channel."""
    asyncio.run(_count_as_foxglove(port, received))


async def _count_as_foxglove(port: int, received: Received) -> None:
    client = await _connected(port)
    while not received.is_over:
        try:
            got = await asyncio.wait_for(client.read_message(), POLL)
        except TimeoutError:
            continue
        if isinstance(got, bytes):
            received.count += got[0] == 1  # a message, not the time
        elif got is not None and (answer := json.loads(got))["op"] == "advertise":
            topics = [{"id": one["id"], "channelId": one["id"]} for one in answer["channels"]]
            await client.write_message(json.dumps({"op": "subscribe", "subscriptions": topics}))
    client.close()


async def _connected(port: int) -> Any:
    end = time.monotonic() + END_TIMEOUT_S
    while True:
        try:
            return await websocket_connect(
                f"ws://127.0.0.1:{port}", subprotocols=["foxglove.sdk.v1"]
            )
        except OSError:  # the bridge is not there yet
            if time.monotonic() > end:
                raise
            await asyncio.sleep(POLL)


CLIENTS: dict[str, Callable[[int, Received], None]] = {
    "plotjuggler": count_as_plotjuggler,
    "foxglove": count_as_foxglove,
}


@contextmanager
def bridge(program: str, running: Graph) -> Iterator[tuple[int, Received]]:
    """Run a bridge and its client, which receives; give its process, and what it has received."""
    port, run_dir = str(PORTS[program]), str(running.run_dir)
    words = ["bridge", program, *TOPICS, "--port", port, "--run", run_dir]
    command, quiet = [sys.executable, "-m", "forcebound", *words], subprocess.DEVNULL
    serving = subprocess.Popen(command, env=running.variables, stdout=quiet, stderr=quiet)
    received = Received()
    client = threading.Thread(target=CLIENTS[program], args=(PORTS[program], received))
    client.start()
    try:
        end = time.monotonic() + END_TIMEOUT_S
        while not received.count:
            running.run_for(POLL)
            if time.monotonic() > end:
                raise RunError(f"the client of {program} received nothing for {END_TIMEOUT_S:g} s")
        yield serving.pid, received
    finally:
        received.is_over = True
        client.join()
        serving.send_signal(signal.SIGINT)
        serving.wait(END_TIMEOUT_S)


def _processor_time(pid: int) -> float:
    use = use_of(pid)
    assert use is not None  # it still runs
    return use.processor_time
