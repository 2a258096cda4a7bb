"""Commands that look at processes: list, top, doctor."""

import sys
from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from forcebound.cli.common import (
    UNKNOWN,
    duration_option_for,
    json_lines_option,
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
COLOURS = {"problem": "red", "note": "yellow", "fine": "green"}


@click.command("list", short_help="List the graphs that run here, with their nodes.")
@json_option
@reports_errors
def list_graphs(as_json: bool) -> None:
    r"""List the graphs that run here: nodes, states, processor, memory, restarts.

    \b
    forcebound list
    forcebound list --json
    """
    from forcebound.monitor.listing import list_graphs as find_graphs

    graphs = find_graphs()
    if as_json:
        print_json([_as_document(graph) for graph in graphs])
        return
    if not graphs:
        show("no graph of yours runs on this machine; start one with `forcebound launch FILE`")
    for graph in graphs:
        _show_graph(graph)


@click.command(short_help="Show what the nodes of a graph use, each second.")
@run_option
@duration_option_for("Time after which it ends. Default: with the graph.")
@json_lines_option
@reports_errors
def top(run_dir: Path | None, duration: float | None, as_json: bool) -> None:
    r"""Show what the processes of a graph use, anew each second, until Ctrl-C.

    \b
    forcebound top
    forcebound top --run stiff_wall --duration 10s --json
    """
    import time

    from forcebound.monitor.listing import list_graphs as find_graphs
    from forcebound.monitor.runs import find

    run = find(run_dir)
    end = None if duration is None else time.monotonic() + duration
    while (end is None or time.monotonic() < end) and (found := find_graphs(1.0, run)):
        if as_json:
            print_json_line(_as_document(found[0]))
            continue
        click.clear()  # of a terminal only
        _show_graph(found[0])


def _show_graph(graph: "ListedGraph") -> None:
    core = "any core" if graph.core is None else f"core {graph.core}"
    show(f"{graph.name}  ({graph.phase or 'nodes by hand'}, {core}, {graph.run_dir})")
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
@run_option
@json_option
@reports_errors
def doctor(run_dir: Path | None, as_json: bool) -> None:
    r"""Diagnose the running graph, else this machine.

    Exit status 0: no problem; 1: at least one problem, or the graph ended; 2: no such
    graph.

    \b
    forcebound doctor
    forcebound doctor --run stiff_wall --json
    """
    from forcebound.monitor import doctor, machine, runs
    from forcebound.monitor.observation import observe

    graph = None if run_dir is None and not runs.running() else runs.find(run_dir)
    findings = machine.examine(machine.look()) if graph is None else doctor.examine(observe(graph))
    is_well = all(finding.severity != "problem" for finding in findings)
    if as_json:
        name = None if graph is None else str(graph)
        documents = [finding.document() for finding in findings]
        print_json({"graph": name, "is_well": is_well, "findings": documents})
    else:
        show("this machine; no graph runs" if graph is None else f"graph in {graph}")
        for finding in findings:
            _show_finding(finding)
        if is_well:
            show("no problem found")
    sys.exit(0 if is_well else 1)


def _show_finding(finding: "Finding") -> None:
    label = click.style(f"{finding.severity:<8}", fg=COLOURS[finding.severity])
    click.echo(f"{label} " + printable(f"{finding.where}: {finding.seen}"))
    if finding.advice:
        show(f"{'':8} -> {finding.advice}")
