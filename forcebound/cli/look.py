"""Commands that look at processes: list, doctor."""

import math
import sys
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from forcebound.cli.common import (
    UNKNOWN,
    duration_option_for,
    json_option,
    print_json,
    print_json_line,
    print_rows,
    reports_errors,
    run_option,
    show,
)
from forcebound.files import printable

if TYPE_CHECKING:
    from forcebound.monitor.findings import Finding
    from forcebound.monitor.listing import ListedGraph

HEAD = ("node", "state", "pid", "processor", "memory", "restarts")
MEASURE_S = 12.0  # of all contestants together, without their start
COLOURS = {"problem": "red", "note": "yellow", "fine": "green"}


@click.command("list", short_help="List the graphs that run here, with their nodes.")
@click.option("--watch", is_flag=True, help="Again each second, as long as a graph runs.")
@run_option
@duration_option_for("Time after which --watch ends. Default: with the last graph.")
@json_option
@reports_errors
def list_graphs(watch: bool, run_dir: Path | None, duration: float | None, as_json: bool) -> None:
    r"""List the graphs that run here: nodes, states, processor, memory, restarts.

    With --watch and --json, one document on each line.

    \b
    forcebound list
    forcebound list --watch --run stiff_wall --duration 10s
    """
    import time

    from forcebound.monitor.listing import list_graphs as find_graphs
    from forcebound.monitor.runs import find

    only = None if run_dir is None else find(run_dir)
    if not watch:
        _show_graphs(find_graphs(only=only), print_json if as_json else None)
        return
    end = math.inf if duration is None else time.monotonic() + duration
    while time.monotonic() < end and (graphs := find_graphs(1.0, only)):
        if not as_json:
            click.clear()  # of a terminal only
        _show_graphs(graphs, print_json_line if as_json else None)


def _show_graphs(graphs: "Sequence[ListedGraph]", write: Callable[[Any], None] | None) -> None:
    """Show graphs as tables, or ``write`` them as one JSON document."""
    if write is not None:
        write([_as_document(graph) for graph in graphs])
        return
    if not graphs:
        show("no graph of yours runs on this machine; start one with `forcebound launch FILE`")
    for graph in graphs:
        _show_graph(graph)


def _show_graph(graph: "ListedGraph") -> None:
    core = "any core" if graph.core is None else f"core {graph.core}"
    show(f"{graph.name}  ({graph.phase or 'an environment'}, {core}, {graph.run_dir})")
    print_rows(HEAD, _rows(graph))


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


@click.command()
@click.option("--measure", is_flag=True, help=f"Measure this machine, too: {MEASURE_S:g} s.")
@run_option
@json_option
@reports_errors
def doctor(measure: bool, run_dir: Path | None, as_json: bool) -> None:
    r"""Diagnose the running graph, else this machine.

    With --measure, also how late wake-ups of a servo are at 1 kHz, and how long the loop of a graph
    takes, beside one of bare sockets; best when nothing else runs.

    Exit status 0: no problem; 1: at least one problem, or the graph ended; 2: no such
    graph.

    \b
    forcebound doctor
    forcebound doctor --measure
    forcebound doctor --run stiff_wall --json
    """
    from forcebound.monitor import doctor, machine, runs
    from forcebound.monitor.observation import observe

    graph = None if run_dir is None and not runs.running() else runs.find(run_dir)
    findings = machine.examine(machine.look()) if graph is None else doctor.examine(observe(graph))
    is_well = all(finding.severity != "problem" for finding in findings)
    measured = _measured() if measure else {}
    if as_json:
        name = None if graph is None else str(graph)
        documents = [finding.document() for finding in findings]
        found = {"graph": name, "is_well": is_well, "findings": documents}
        print_json(found | ({"measured": measured} if measure else {}))
    else:
        show("this machine; no graph runs" if graph is None else f"graph in {graph}")
        for finding in findings:
            _show_finding(finding)
        if is_well:
            show("no problem found")
        if measure:
            head = ("measured at 1 kHz", *next(iter(measured.values())))
            print_rows(head, [(name, *map(str, one.values())) for name, one in measured.items()])
    sys.exit(0 if is_well else 1)


def _measured() -> dict[str, dict[str, float]]:
    """Return what this machine is capable of, by what was measured."""
    from forcebound.monitor.measure import SHARES, measure, percentile

    return {
        name: {f"{share}_us": round(percentile(rounds, share) / 1e3, 1) for share in SHARES}
        | {"ticks": sum(len(one.times_ns) for one in rounds)}
        | {"missed": sum(one.missed for one in rounds)}
        for name, rounds in measure(MEASURE_S, 1000.0).items()
    }


def _show_finding(finding: "Finding") -> None:
    label = click.style(f"{finding.severity:<8}", fg=COLOURS[finding.severity])
    click.echo(f"{label} " + printable(f"{finding.where}: {finding.seen}"))
    if finding.advice:
        show(f"{'':8} -> {finding.advice}")
