"""Benchmark of the bridges: ``python -m benchmarks.bridges [--turns 5] [--json]``.

A graph runs. Its servo's lateness and loop delay are compared in turns: nobody looks, PlotJuggler's
bridge publishes all topics to a subscriber, Foxglove's serves them all to a client. The servo must
not notice: less than 5 % difference. The clients only count what they get, in this process.
"""

import asyncio
import json
import os
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

import click
import numpy as np
import zmq
from tornado.websocket import websocket_connect

from benchmarks.turns import ALONE, PATIENCE, Graph, Turn, graph, servo, told
from forcebound.messages.packets import TOPICS
from forcebound.monitor.snapshot import use_of

PORTS = {"plotjuggler": 19872, "foxglove": 18765}
POLL = 0.1  # s
SETTLE = 2.0  # s


@dataclass
class Heard:
    """What a client has heard."""

    count: int = 0  # messages
    is_over: bool = False  # whether it is to end


def count_as_plotjuggler(port: int, heard: Heard) -> None:
    """Count the messages that a subscriber gets."""
    with zmq.Context() as context, context.socket(zmq.SUB) as subscriber:
        subscriber.set(zmq.SUBSCRIBE, b"")
        subscriber.connect(f"tcp://127.0.0.1:{port}")
        while not heard.is_over:
            if subscriber.poll(round(POLL * 1e3)):
                subscriber.recv_multipart()
                heard.count += 1


def count_as_foxglove(port: int, heard: Heard) -> None:
    """Count the messages that a client gets which subscribes to every channel."""
    asyncio.run(_count_as_foxglove(port, heard))


async def _count_as_foxglove(port: int, heard: Heard) -> None:
    client = await _connected(port)
    while not heard.is_over:
        try:
            got = await asyncio.wait_for(client.read_message(), POLL)
        except TimeoutError:
            continue
        if isinstance(got, bytes):
            heard.count += got[0] == 1  # a message, not the time
        elif got is not None and (said := json.loads(got))["op"] == "advertise":
            wanted = [{"id": one["id"], "channelId": one["id"]} for one in said["channels"]]
            await client.write_message(json.dumps({"op": "subscribe", "subscriptions": wanted}))
    client.close()


async def _connected(port: int) -> Any:
    end = time.monotonic() + PATIENCE
    while True:
        try:
            return await websocket_connect(
                f"ws://127.0.0.1:{port}", subprotocols=["foxglove.sdk.v1"]
            )
        except OSError:  # the bridge is not there yet
            if time.monotonic() > end:
                raise
            await asyncio.sleep(POLL)


CLIENTS: dict[str, Callable[[int, Heard], None]] = {
    "plotjuggler": count_as_plotjuggler,
    "foxglove": count_as_foxglove,
}


@contextmanager
def bridge(program: str, running: Graph) -> Iterator[tuple[int, Heard]]:
    """Run a bridge and its client; give its process, and what the client has heard: something."""
    port, run_dir = str(PORTS[program]), str(running.run_dir)
    words = ["bridge", program, *TOPICS, "--port", port, "--run", run_dir]
    command, quiet = [sys.executable, "-m", "forcebound", *words], subprocess.DEVNULL
    serving = subprocess.Popen(command, env=running.variables, stdout=quiet, stderr=quiet)
    heard = Heard()
    client = threading.Thread(target=CLIENTS[program], args=(PORTS[program], heard))
    client.start()
    try:
        end = time.monotonic() + PATIENCE
        while not heard.count:
            running.run_for(POLL)
            if time.monotonic() > end:
                raise RuntimeError(f"the client of {program} has heard nothing for {PATIENCE:g} s")
        yield serving.pid, heard
    finally:
        heard.is_over = True
        client.join()
        serving.send_signal(signal.SIGINT)
        serving.wait(PATIENCE)


@click.command()
@click.option("--turns", default=5, help="Turns without and with each bridge.")
@click.option("--seconds", default=4.0, help="Of each turn.")
@click.option("--json", "as_json", is_flag=True)
def main(turns: int, seconds: float, as_json: bool) -> None:
    """Measure the servo without a bridge and with each."""
    taken: list[Turn] = []
    rates: dict[str, list[Any]] = {name: [] for name in CLIENTS}
    with tempfile.TemporaryDirectory(prefix="fb-") as folder:
        record = Path(folder) / "run.mcap"
        with graph(folder, record) as running:
            for _ in range(turns):
                taken.append(measured(ALONE, running, seconds))
                for program in CLIENTS:
                    with bridge(program, running) as (pid, heard):
                        before = account(pid, heard)
                        taken.append(measured(program, running, seconds))
                        rates[program].append((account(pid, heard) - before) / (SETTLE + seconds))
        figures, load = servo(record, taken), os.getloadavg()[0]
    names = ("processor_share", "rate_hz")
    bridges = {
        program: dict(zip(names, np.median(of, axis=0).tolist(), strict=True))
        for program, of in rates.items()
    }
    if as_json:
        click.echo(json.dumps({"bridges": bridges, "servo": figures, "load": load}, indent=2))
        return
    for program, of in bridges.items():
        share, rate_hz = of.values()
        click.echo(f"{program}: {rate_hz:.0f} messages a second, {share:.0%} of a processor")
    for line in told(figures):
        click.echo(line)
    click.echo(f"load of the machine at the end: {load:.1f}")


def account(pid: int, heard: Heard) -> Any:
    """Return the processor time that a bridge has used, in s, and its client's messages."""
    use = use_of(pid)
    assert use is not None  # the bridge still runs
    return np.array((use.processor_time, heard.count))


def measured(viewers: str, running: Graph, seconds: float) -> Turn:
    """Let a turn pass; return when it began and ended, without what starting disturbs."""
    running.run_for(SETTLE)
    begin_ns = time.monotonic_ns()
    running.run_for(seconds)
    return Turn(viewers, begin_ns, time.monotonic_ns())


if __name__ == "__main__":
    main()
