"""Commands that show the topics of a running graph, here or in other programs."""

import csv
import json
import sys
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from datetime import datetime
from itertools import islice
from pathlib import Path
from typing import Any

import click

from forcebound.cli import complete
from forcebound.cli import options as opt
from forcebound.cli.common import (
    UNKNOWN,
    Group,
    command,
    print_document,
    print_json,
    print_json_line,
    say,
    show,
)
from forcebound.cli.lazy import when_used
from forcebound.results.printing import print_rows

with when_used():
    import msgspec

    from forcebound.messages import packets
    from forcebound.network import trace
    from forcebound.observe import bridges, drawing, streams
    from forcebound.observe import delay as delays
    from forcebound.recordings import delay_traces

BAR = 40  # characters, of the longest bar of a histogram

_topics = complete.offering(lambda context, _: complete.graph_of(context).names)


@complete.offering
def _fields(context: click.Context, begun: str) -> Iterable[str]:
    """Fields of the topic that is already there."""
    # An option without its value ends the parsing, before arguments have their names.
    topic = context.params.get("topic") or context.args[0]
    return packets.field_types(packets.TOPICS[topic.rpartition("/")[2]])


_some_topics = opt.arguments("[TOPIC]...", _topics)
_measuring = opt.duration("Measuring time. Default: 2s.", "--duration", default="2s")


def echo(
    topic: str = opt.argument(_topics),
    fields: tuple[str, ...] = opt.repeated(
        "Only this field; repeatable.", "--field", metavar="NAME", shell_complete=_fields
    ),
    count: int | None = opt.option("End after so many packets.", type=opt.COUNT),
    as_csv: bool = opt.flag("One row each, a column for each entry.", "--csv"),
    as_line: bool = opt.flag("One line each.", "--line"),
    as_json: bool = opt.as_json_lines,
    run: Path = opt.run,
    duration: float | None = opt.ending,
) -> None:
    r"""Print the packets of TOPIC as they arrive, until Ctrl-C.

    \b
    forcebound echo telemetry --field position --field applied_force --line
    forcebound echo event --json
    forcebound echo telemetry --csv --duration 5s > telemetry.csv
    forcebound echo left/telemetry
    """
    if as_csv + as_line + as_json > 1:
        raise click.UsageError("choose one of --csv, --line, --json")
    streams.check_fields(streams.streams_of(run, (topic,))[topic], fields)
    write = _csv_writer() if as_csv else _show_block
    write = _show_line if as_line else print_json_line if as_json else write
    for received in islice(streams.packets_of(run, (topic,), duration), count):
        values = streams.fields_of_packet(received.packet)
        write({name: values[name] for name in fields or values if name in values})


def _show_block(values: Mapping[str, object]) -> None:
    show("\n".join(f"{name}: {_text(value)}" for name, value in values.items()) + "\n---")


def _show_line(values: Mapping[str, object]) -> None:
    show("  ".join(f"{name}={_text(value)}" for name, value in values.items()))


def _csv_writer() -> Callable[[Mapping[str, object]], None]:
    """Return a writer of rows; the first has the names, with a column for each entry of a list.

    A list that the first packet has not comes as JSON, in one column.
    """
    rows = csv.writer(sys.stdout, lineterminator="\n")
    names: list[str] = []

    def write(values: Mapping[str, object]) -> None:
        flat: dict[str, object] = {}
        for name, value in values.items():
            if isinstance(value, list | tuple) and name not in names:
                flat |= {f"{name}[{i}]": entry for i, entry in enumerate(value)}
            else:
                is_plain = value is None or isinstance(value, str | int | float)
                flat[name] = value if is_plain else json.dumps(value)
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
    if isinstance(value, Mapping):
        return f"{{{', '.join(f'{name}: {_text(entry)}' for name, entry in value.items())}}}"
    return UNKNOWN if value is None else str(value)


def hz(
    topics: tuple[str, ...] = _some_topics,
    run: Path = opt.run,
    duration: float = _measuring,
    as_json: bool = opt.as_json,
) -> None:
    r"""Measure rate and bandwidth of topics. Default: all topics.

    Rates and intervals use the senders' time stamps.

    \b
    forcebound hz
    forcebound hz telemetry force_command --duration 10s --json
    """
    figures = streams.measure_streams(run, topics, duration)
    if as_json:
        print_json(figures)
        return
    times = ("rate", "mean", "min", "max", "deviation")
    head = ("topic", *times, "packets", "missing", "bandwidth", "mean size")
    print_rows(head, [(topic, *_stream(one)) for topic, one in figures.items()])


def _stream(figures: "streams.StreamFigures") -> tuple[str, ...]:
    one = figures.interval_ms
    times = () if one is None else (one.mean, one.min, one.max, one.deviation)
    shown = [f"{time:.3f} ms" for time in times] or [UNKNOWN] * 4
    counts = (str(figures.packets), str(figures.missing))
    mean = UNKNOWN if figures.mean_size_b is None else f"{figures.mean_size_b:.0f} B"
    bandwidth = f"{figures.bandwidth_b_per_s / 1e3:.1f} kB/s"
    return (f"{figures.rate_hz:.1f} Hz", *shown, *counts, bandwidth, mean)


def graph(
    mermaid: bool = opt.flag("As a Mermaid flowchart."),
    run: Path = opt.run,
    duration: float = _measuring,
    as_json: bool = opt.as_json,
) -> None:
    r"""Show nodes and streams, with the measured rates.

    \b
    forcebound graph
    forcebound graph --mermaid > graph.md
    """
    edges = drawing.measure_edges(run, duration)
    draw = drawing.as_mermaid if mermaid else drawing.as_text
    print_document([edge._asdict() for edge in edges], as_json, lambda _: [draw(edges)])


def log(
    quiet: bool = opt.flag("Faults only.", "-q", "--quiet"),
    verbose: bool = opt.flag("Print their data, too.", "-v", "--verbose"),
    run: Path = opt.run,
    duration: float | None = opt.ending,
    as_json: bool = opt.as_json_lines,
) -> None:
    r"""Print the events of a graph with the time of day, until Ctrl-C.

    \b
    forcebound log
    forcebound log -q --json
    forcebound log -v --run stiff_wall
    """
    ahead_ns = time.time_ns() - time.monotonic_ns()

    for _, packet, _ in streams.packets_of(run, ("event",), duration):
        if not isinstance(packet, packets.Event) or (quiet and not packet.is_fault):
            continue
        time_s = (packet.time_ns + ahead_ns) * 1e-9
        at = datetime.fromtimestamp(time_s).isoformat(" ", "milliseconds")
        if as_json:
            print_json_line({"time": at, **streams.fields_of_packet(packet)})
        else:
            more = f"  {_text(packet.data)}" if verbose and packet.data else ""
            kind = "FAULT" if packet.is_fault else "event"
            show(f"{at}  {kind}  {packet.node}: {packet.message}{more}")


def delay(
    run: Path | None = opt.argument(complete.runs, required=False, type=opt.PATH),
    output: Path | None = opt.output(
        "Write the delays as a trace for a link.", metavar="TRACE.csv"
    ),
    duration: float | None = opt.duration("Measuring time of a running graph. Default: 5s."),
    links: bool = opt.flag("Also of each link."),
    hand: str | None = opt.hand,
    as_json: bool = opt.as_json,
) -> None:
    r"""Show the loop delay of RUN, a recording or a running graph. Default: the running graph.

    With --links also how long a tick takes from hop to hop: from the sending of a packet until its
    receiver has sent what it made of it.

    \b
    forcebound delay
    forcebound delay stiff_wall --links --duration 10s
    forcebound delay run.mcap -o trace.csv
    """
    if output is not None:
        trace.check_output(output)
    measured = delays.measure(run, duration, links, hand)
    if not measured.is_complete:
        show(f"{run} is incomplete: these are the delays up to its end", err=True)
    if output is not None:
        delay_traces.as_link_trace(measured.trace, measured.document).write(output)
    figures = measured.figures
    if as_json:
        print_json({**msgspec.structs.asdict(figures), "trace": output})
        return
    for name, value in msgspec.structs.asdict(figures.loop_delay_ms).items():
        label = name.replace("_", ".")
        show(f"loop delay {label:<6}{UNKNOWN if value is None else f'{value:.2f} ms':>10}")
    _show_histogram(figures.histogram)
    why = "lost, or overtaken by a newer answer"
    show(f"unanswered {figures.lost_share:>8.1%} of {figures.ticks} ticks ({why})")
    if links:
        _show_links(figures.links_ms)
    if output is not None:
        show(f"trace: {output}")


def _show_histogram(bins: "Sequence[delays.Bin]") -> None:
    most = max((one.count for one in bins), default=1)
    for one in bins:
        bar = "█" * round(BAR * one.count / most)
        show(f"{one.from_ms:>8.2f} ms {one.count:>7} {bar}".rstrip())


def _show_links(links: "Mapping[str, delays.LinkDelays]") -> None:
    rows = []
    for name, link in links.items():
        values = [getattr(link, share) for share in delays.SHARES]
        shown = [UNKNOWN if value is None else f"{value:.3f}" for value in values]
        rows.append((name, *shown, str(link.count)))
    head = ("from sending, ms", *(share.replace("_", ".") for share in delays.SHARES), "ticks")
    print_rows(head, rows)


bridge = Group("bridge", help="Show a running graph in another program, read-only.")


def _port(default: int) -> Any:
    words = f"On loopback. Default: {default}."
    return opt.option(words, type=click.IntRange(1, 65535), default=default)


@command("plotjuggler", bridge, short_help="Publish topics for PlotJuggler.")
def plotjuggler(
    topics: tuple[str, ...] = _some_topics,
    run: Path = opt.run,
    port: int = _port(9872),
    duration: float | None = opt.ending,
) -> None:
    r"""Publish topics of a running graph for PlotJuggler, until Ctrl-C. Default: telemetry.

    In PlotJuggler: Streaming, ZMQ Subscriber, Start; connect to tcp:// localhost, port 9872, json.

    \b
    forcebound bridge plotjuggler
    forcebound bridge plotjuggler telemetry device_state --run stiff_wall
    """
    topics = topics or bridges.telemetry_of(run)
    bridges.serve(bridges.plotjuggler, run, topics, port, duration, say)


@command("foxglove", bridge, short_help="Serve topics to Foxglove.")
def foxglove(
    topics: tuple[str, ...] = _some_topics,
    run: Path = opt.run,
    port: int = _port(8765),
    duration: float | None = opt.ending,
) -> None:
    r"""Serve topics of a running graph to Foxglove, until Ctrl-C. Default: all topics.

    In Foxglove or Lichtblick: Open connection, Foxglove WebSocket, ws://localhost:8765. Needs the
    extra `foxglove`. Every program and every page in a browser of this machine can read there.

    \b
    forcebound bridge foxglove
    """
    bridges.serve(bridges.foxglove, run, topics, port, duration, say)
