"""Commands that show a running graph in other programs."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import click

from forcebound.cli.common import (
    Group,
    duration_option_for,
    reports_errors,
    run_option,
    show,
    topics_argument,
)

Command = Callable[..., None]


@click.group(short_help="Show a running graph in another program.", cls=Group)
def bridge() -> None:
    """Show a running graph in another program, which can change nothing."""


def _serving(port: int) -> Callable[[Command], Command]:
    """Give a command the topics, the graph, a port of this default, and a duration."""

    def give(command: Command) -> Command:
        kind, words = click.IntRange(1, 65535), f"On loopback. Default: {port}."
        command = duration_option_for("Time after which it ends. Default: with the graph.")(
            reports_errors(command)
        )
        command = click.option("--port", type=kind, default=port, help=words)(command)
        return topics_argument(run_option(command))

    return give


def _serve(
    program: str, topics: Sequence[str], scheme: str, run_dir: Path | None, port: int, **time: Any
) -> None:
    from forcebound.monitor.bridges import serve
    from forcebound.monitor.runs import find
    from forcebound.monitor.streams import topic_named

    chosen = [topic_named(topic) for topic in topics]
    words = f"{', '.join(chosen)} at {scheme}://localhost:{port}; Ctrl-C ends it"
    serve(program, find(run_dir), chosen, port, begin=lambda: show(words, err=True), **time)


@bridge.command(short_help="Publish topics for PlotJuggler.")
@_serving(9872)
def plotjuggler(topics: tuple[str, ...], **options: Any) -> None:
    r"""Publish topics of a running graph for PlotJuggler, until Ctrl-C. Default: telemetry.

    In PlotJuggler: Streaming, ZMQ Subscriber, Start; connect to tcp:// localhost, port 9872, json.

    \b
    forcebound bridge plotjuggler
    forcebound bridge plotjuggler telemetry device_state --run stiff_wall
    """
    _serve("plotjuggler", topics or ("telemetry",), "tcp", **options)


@bridge.command(short_help="Serve topics to Foxglove.")
@_serving(8765)
def foxglove(topics: tuple[str, ...], **options: Any) -> None:
    r"""Serve topics of a running graph to Foxglove, until Ctrl-C. Default: all topics.

    In Foxglove or Lichtblick: Open connection, Foxglove WebSocket, ws://localhost:8765. Needs the
    extra `foxglove`. Every program and every page in a browser of this machine can read there.

    \b
    forcebound bridge foxglove
    """
    from forcebound.messages.packets import TOPICS

    _serve("foxglove", topics or tuple(TOPICS), "ws", **options)
