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

_duration_option = duration_option_for("Time after which it ends. Default: with the graph.")


@click.group(short_help="Show a running graph in another program.", cls=Group)
def bridge() -> None:
    """Show a running graph in another program, which can change nothing."""


def _telling(topics: Sequence[str], address: str) -> Callable[[], None]:
    return lambda: show(f"{', '.join(topics)} at {address}; Ctrl-C ends it", err=True)


def _port_option(default: int) -> Callable[..., Any]:
    kind = click.IntRange(1, 65535)
    return click.option(
        "--port", type=kind, default=default, help=f"On loopback. Default: {default}."
    )


@bridge.command(short_help="Publish topics for PlotJuggler.")
@topics_argument
@run_option
@_port_option(9872)
@_duration_option
@reports_errors
def plotjuggler(
    topics: tuple[str, ...], run_dir: Path | None, port: int, duration: float | None
) -> None:
    r"""Publish topics of a running graph for PlotJuggler, until Ctrl-C. Default: telemetry.

    In PlotJuggler: Streaming, ZMQ Subscriber, Start; connect to tcp:// localhost, port 9872, json.

    \b
    forcebound bridge plotjuggler
    forcebound bridge plotjuggler telemetry device_state --run stiff_wall
    """
    from forcebound.monitor.bridges import serve
    from forcebound.monitor.runs import find
    from forcebound.monitor.streams import topic_named

    wanted = [topic_named(topic) for topic in topics or ("telemetry",)]
    serve(
        "plotjuggler",
        find(run_dir),
        wanted,
        port,
        duration,
        _telling(wanted, f"tcp://localhost:{port}"),
    )


@bridge.command(short_help="Serve topics to Foxglove.")
@topics_argument
@run_option
@_port_option(8765)
@_duration_option
@reports_errors
def foxglove(
    topics: tuple[str, ...], run_dir: Path | None, port: int, duration: float | None
) -> None:
    r"""Serve topics of a running graph to Foxglove, until Ctrl-C. Default: all topics.

    In Foxglove or Lichtblick: Open connection, Foxglove WebSocket, ws://localhost:8765. Needs the
    extra `foxglove`. Every program and every page in a browser of this machine can read there.

    \b
    forcebound bridge foxglove
    """
    from forcebound.messages.packets import TOPICS
    from forcebound.monitor.bridges import serve
    from forcebound.monitor.runs import find
    from forcebound.monitor.streams import topic_named

    wanted = [topic_named(topic) for topic in topics or TOPICS]
    serve(
        "foxglove",
        find(run_dir),
        wanted,
        port,
        duration,
        _telling(wanted, f"ws://localhost:{port}"),
    )
