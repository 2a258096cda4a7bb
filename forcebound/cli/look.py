"""Commands that look into a running graph."""

import csv
import json
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from forcebound.cli.common import (
    duration_option_for,
    file_option,
    json_option,
    print_json,
    print_rows,
    reports_errors,
    run_option,
    show,
)
from forcebound.cli.complete import links, topics

if TYPE_CHECKING:
    from forcebound.messages.packets import Packet
    from forcebound.monitor.listing import ListedGraph

UNKNOWN = "–"
HEAD = ("node", "state", "pid", "processor", "memory", "restarts")


_measuring_option = duration_option_for("Measuring time. Default: 2s.")
_topics_argument = click.argument("topics", nargs=-1, metavar="[TOPIC]...", shell_complete=topics)


@click.command("list")
@json_option
@reports_errors
def list_graphs(as_json: bool) -> None:
    """List the graphs that run here: nodes, states, processor, memory, restarts."""
    from forcebound.monitor.listing import list_graphs as find_graphs

    graphs = find_graphs()
    if as_json:
        print_json([_as_document(graph) for graph in graphs])
        return
    if not graphs:
        show("no graph of yours runs on this machine; start one with `forcebound launch FILE`")
    for graph in graphs:
        show(_title(graph))
        print_rows(HEAD, _rows(graph))


@click.command()
@run_option
@duration_option_for("Time after which it ends. Default: never.")
@reports_errors
def top(run_dir: Path | None, duration: float | None) -> None:
    """Show what the processes of a graph use, anew each second, until Ctrl-C."""
    import time

    from forcebound.monitor.listing import list_graphs as find_graphs
    from forcebound.monitor.runs import find

    run = find(run_dir)
    end = None if duration is None else time.monotonic() + duration
    while end is None or time.monotonic() < end:
        (graph,) = find_graphs(1.0, run)
        if sys.stdout.isatty():
            click.clear()
        show(_title(graph))
        print_rows(HEAD, _rows(graph))


@click.command(short_help="Print the packets of a topic.")
@click.argument("topic", shell_complete=topics)
@click.option("--field", "fields", multiple=True, metavar="NAME", help="Only this field.")
@click.option("--count", type=click.IntRange(min=1), help="End after so many packets.")
@click.option("--csv", "as_csv", is_flag=True, help="One row each, a column for each entry.")
@click.option("--line", "as_line", is_flag=True, help="One line each.")
@click.option("--json", "as_json", is_flag=True, help="One JSON document each, on a line.")
@run_option
@duration_option_for("Time after which it ends. Default: with the graph.")
@reports_errors
def echo(
    topic: str,
    fields: tuple[str, ...],
    count: int | None,
    as_csv: bool,
    as_line: bool,
    as_json: bool,
    run_dir: Path | None,
    duration: float | None,
) -> None:
    r"""Print the packets of TOPIC as they come, until Ctrl-C.

    \b
    forcebound echo telemetry --field position --field applied_force --line
    forcebound echo event --json
    forcebound echo telemetry --csv --duration 5s > telemetry.csv
    """
    from forcebound.monitor.runs import find
    from forcebound.monitor.streams import check_fields, fields_of_packet, read_topics, topic_named

    if as_csv + as_line + as_json > 1:
        raise click.UsageError("choose one of --csv, --line, --json")
    check_fields(topic_named(topic), fields)
    write = _as_csv() if as_csv else _as_line if as_line else _as_json if as_json else _as_block
    left = [count]

    def take(_: str, packet: "Packet", data: bytes) -> bool:
        values = fields_of_packet(packet)
        write({name: values[name] for name in fields or values if name in values})
        if left[0] is not None:
            left[0] -= 1
        return left[0] != 0

    read_topics(find(run_dir), (topic,), take, duration)


def _as_block(values: Mapping[str, Any]) -> None:
    show("\n".join(f"{name}: {_text(value)}" for name, value in values.items()) + "\n---")


def _as_line(values: Mapping[str, Any]) -> None:
    show("  ".join(f"{name}={_text(value)}" for name, value in values.items()))


def _as_json(values: Mapping[str, Any]) -> None:
    click.echo(json.dumps(values))


def _as_csv() -> Callable[[Mapping[str, Any]], None]:
    """Return a writer of rows; the first has the names, with a column for each entry of a list."""
    rows = csv.writer(sys.stdout, lineterminator="\n")
    names: list[str] = []

    def write(values: Mapping[str, Any]) -> None:
        flat: dict[str, Any] = {}
        for name, value in values.items():
            if isinstance(value, list | tuple):
                flat |= {f"{name}[{i}]": entry for i, entry in enumerate(value)}
            else:
                flat[name] = json.dumps(value) if isinstance(value, Mapping) else value
        if not names:
            names.extend(flat)
            rows.writerow(names)
        rows.writerow([flat.get(name) for name in names])

    return write


def _text(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_text, value))}]"
    return UNKNOWN if value is None else str(value)


def _measuring(command: Callable[..., None]) -> Callable[..., None]:
    """Give a command the topics, the graph, a duration and ``--json``."""
    for option in (reports_errors, json_option, _measuring_option, run_option, _topics_argument):
        command = option(command)
    return command


@click.command()
@_measuring
def hz(
    topics: tuple[str, ...], run_dir: Path | None, duration: float | None, as_json: bool
) -> None:
    """Measure how often topics are sent, by their senders' time stamps. Default: all topics."""
    head = ("topic", "rate", "mean", "min", "max", "deviation", "packets", "missing")
    _show_figures(_measured(topics, run_dir, duration), as_json, head, _regularity)


def _regularity(figures: Mapping[str, Any]) -> tuple[str, ...]:
    interval = figures["interval_ms"] or {}
    times = [interval.get(name) for name in ("mean", "min", "max", "deviation")]
    shown = [UNKNOWN if time is None else f"{time:.3f} ms" for time in times]
    rate = f"{figures['rate_hz']:.1f} Hz"
    return (rate, *shown, str(figures["packets"]), str(figures["missing"]))


@click.command()
@_measuring
def bw(
    topics: tuple[str, ...], run_dir: Path | None, duration: float | None, as_json: bool
) -> None:
    """Measure how many bytes topics need. Default: all topics."""
    head = ("topic", "bandwidth", "mean size", "packets")
    _show_figures(_measured(topics, run_dir, duration), as_json, head, _sizes)


def _sizes(figures: Mapping[str, Any]) -> tuple[str, ...]:
    size = figures["mean_size_b"]
    mean = UNKNOWN if size is None else f"{size:.0f} B"
    return (f"{figures['bandwidth_b_per_s'] / 1e3:.1f} kB/s", mean, str(figures["packets"]))


def _show_figures(
    figures: Mapping[str, Mapping[str, Any]],
    as_json: bool,
    head: Sequence[str],
    row: Callable[[Mapping[str, Any]], tuple[str, ...]],
) -> None:
    if as_json:
        print_json(figures)
    else:
        print_rows(head, [(topic, *row(one)) for topic, one in figures.items()])


def _measured(
    topics: Sequence[str], run_dir: Path | None, duration: float | None
) -> dict[str, dict[str, Any]]:
    from forcebound.messages.packets import TOPICS
    from forcebound.monitor.runs import find
    from forcebound.monitor.streams import DURATION, measure_streams, topic_named

    wanted = [topic_named(topic) for topic in topics] or list(TOPICS)
    return measure_streams(find(run_dir), wanted, DURATION if duration is None else duration)


@click.command("graph", short_help="Show the graph with its measured rates.")
@click.option("--mermaid", is_flag=True, help="As a Mermaid flowchart.")
@file_option("-o", "--output", metavar="GRAPH.svg", help="Draw a picture: .svg, .png or .pdf.")
@run_option
@_measuring_option
@json_option
@reports_errors
def draw_graph(
    mermaid: bool,
    output: Path | None,
    run_dir: Path | None,
    duration: float | None,
    as_json: bool,
) -> None:
    """Show who sends what to whom, with the measured rates."""
    from forcebound.messages.packets import LINKS
    from forcebound.monitor import drawing

    if output is not None:
        from forcebound.analysis.plots import check_picture

        check_picture(output)
    rates = _measured(LINKS, run_dir, duration)
    if output is not None:
        drawing.draw(rates, output)
    if as_json:
        names = ("sender", "receiver", "topic", "rate_hz")
        print_json([dict(zip(names, edge, strict=True)) for edge in drawing.edges(rates)])
    elif output is not None:
        show(f"picture: {output}")
    else:
        show(drawing.as_mermaid(rates) if mermaid else drawing.as_text(rates))


@click.command(short_help="Print events of a graph as they come.")
@click.option("-q", "--quiet", is_flag=True, help="Faults only.")
@click.option("-v", "--verbose", is_flag=True, help="Their data, too.")
@run_option
@duration_option_for("Time after which it ends. Default: with the graph.")
@json_option
@reports_errors
def log(
    quiet: bool, verbose: bool, run_dir: Path | None, duration: float | None, as_json: bool
) -> None:
    """Print the events of a graph with the time of day, until Ctrl-C; --json: a line each."""
    import time
    from datetime import datetime

    from forcebound.messages.packets import Event
    from forcebound.monitor.runs import find
    from forcebound.monitor.streams import fields_of_packet, read_topics

    ahead_ns = time.time_ns() - time.monotonic_ns()

    def take(_: str, packet: "Packet", data: bytes) -> bool:
        if isinstance(packet, Event) and (packet.is_fault or not quiet):
            at = datetime.fromtimestamp((packet.time_ns + ahead_ns) * 1e-9).isoformat(
                " ", "milliseconds"
            )
            if as_json:
                click.echo(json.dumps({"time": at, **fields_of_packet(packet)}))
            else:
                more = f"  {dict(packet.data)}" if verbose and packet.data else ""
                kind = "FAULT" if packet.is_fault else "event"
                show(f"{at}  {kind}  {packet.node}: {packet.message}{more}")
        return True

    read_topics(find(run_dir), ("event",), take, duration)


@click.group(short_help="Show a running graph in another program.")
def bridge() -> None:
    """Show a running graph in another program, which can change nothing."""


def _port_option(default: int) -> Callable[..., Any]:
    kind = click.IntRange(1, 65535)
    return click.option(
        "--port", type=kind, default=default, help=f"On loopback. Default: {default}."
    )


@bridge.command(short_help="Publish topics for PlotJuggler.")
@_topics_argument
@run_option
@_port_option(9872)
@duration_option_for("Time after which it ends. Default: with the graph.")
@reports_errors
def plotjuggler(
    topics: tuple[str, ...], run_dir: Path | None, port: int, duration: float | None
) -> None:
    r"""Publish topics of a running graph for PlotJuggler, until Ctrl-C. Default: telemetry.

    In PlotJuggler: Streaming, ZMQ Subscriber, connect to tcp:// localhost, port 9872, JSON.

    \b
    forcebound bridge plotjuggler
    forcebound bridge plotjuggler telemetry device_state --run stiff_wall
    """
    from forcebound.monitor.bridges import serve_plotjuggler
    from forcebound.monitor.runs import find
    from forcebound.monitor.streams import topic_named

    wanted = [topic_named(topic) for topic in topics or ("telemetry",)]
    serve_plotjuggler(find(run_dir), wanted, port, duration)


@bridge.command(short_help="Serve topics to Foxglove.")
@_topics_argument
@run_option
@_port_option(8765)
@duration_option_for("Time after which it ends. Default: with the graph.")
@reports_errors
def foxglove(
    topics: tuple[str, ...], run_dir: Path | None, port: int, duration: float | None
) -> None:
    r"""Serve topics of a running graph to Foxglove, until Ctrl-C. Default: all topics.

    In Foxglove: Open connection, Foxglove WebSocket, ws://localhost:8765. Needs the extra
    `foxglove`. Every program and every page in a browser of this machine can read there.

    \b
    forcebound bridge foxglove
    """
    from forcebound.messages.packets import TOPICS
    from forcebound.monitor.bridges import serve_foxglove
    from forcebound.monitor.runs import find
    from forcebound.monitor.streams import topic_named

    wanted = [topic_named(topic) for topic in topics or TOPICS]
    serve_foxglove(find(run_dir), wanted, port, duration)


@click.command(short_help="Cut a link from now for a time.")
@click.argument("time", metavar="TIME")
@click.argument("links", nargs=-1, metavar="[LINK]...", shell_complete=links)
@run_option
@reports_errors
def outage(time: str, links: tuple[str, ...], run_dir: Path | None) -> None:
    r"""Lose every packet of LINK from now for TIME. Default: environment_query, environment_reply.

    \b
    forcebound outage 500ms
    forcebound outage 2s force_command
    """
    from forcebound.monitor.runs import find
    from forcebound.monitor.tuning import cut_links

    run = find(run_dir)
    seconds, cut = cut_links(run, time, links)
    show(f"{', '.join(cut)}: no packet for {seconds:g} s")


def _title(graph: "ListedGraph") -> str:
    core = "any core" if graph.core is None else f"core {graph.core}"
    return f"{graph.name}  ({graph.phase or 'nodes by hand'}, {core}, {graph.run_dir})"


def _rows(graph: "ListedGraph") -> Iterable[tuple[str, ...]]:
    for process in graph.processes:
        share, memory = process.processor, process.memory
        yield (
            process.node,
            process.state,
            UNKNOWN if process.pid is None else str(process.pid),
            UNKNOWN if share is None else f"{share:.0%}",
            UNKNOWN if memory is None else f"{memory / 1e6:.0f} MB",
            str(process.restarts),
        )


def _as_document(graph: "ListedGraph") -> dict[str, Any]:
    return asdict(graph) | {"run_dir": str(graph.run_dir)}
