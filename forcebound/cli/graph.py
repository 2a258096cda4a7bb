"""Commands that monitor and change a running graph."""

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from forcebound.cli import complete
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
from forcebound.files import printable

if TYPE_CHECKING:
    from forcebound.monitor.findings import Finding

BAR = 40  # characters, of the longest bar of a histogram
COLOURS = {"problem": "red", "note": "yellow", "fine": "green"}


@click.command(short_help="Stop a node: zero force.")
@click.argument("node_name", metavar="NODE", shell_complete=complete.nodes)
@run_option
@reports_errors
def stop(node_name: str, run_dir: Path | None) -> None:
    """Stop NODE (environment or controller) of a running graph."""
    from forcebound.monitor.control import stop_node
    from forcebound.monitor.nodes import ENVIRONMENT, present
    from forcebound.monitor.runs import find

    run = find(run_dir, of_graph=True)
    serving = present(run).serving if node_name == ENVIRONMENT else None
    stop_node(run, node_name)
    what = f"{serving} serves as before"
    if serving is None:
        what = "the device applies zero force until replies arrive again"
    show(f"{node_name} is stopped; {what}")


@click.command(short_help="Start a node that was stopped.")
@click.argument("node_name", metavar="NODE", shell_complete=complete.nodes)
@run_option
@reports_errors
def start(node_name: str, run_dir: Path | None) -> None:
    """Start NODE (environment or controller) of a running graph after a stop."""
    from forcebound.monitor.control import start_node
    from forcebound.monitor.runs import find

    start_node(find(run_dir, of_graph=True), node_name)
    show(f"{node_name} runs")


@click.command(short_help="Show the loop delay of a recording or graph.")
@click.argument("run", required=False, metavar="[RUN]", type=click.Path(path_type=Path))
@file_option("-o", "--output", metavar="TRACE.csv", help="Write the delays as a trace for a link.")
@duration_option_for("Measuring time of a running graph. Default: 5s.")
@click.option("--links", is_flag=True, help="Of each link of a running graph, too.")
@json_option
@reports_errors
def delay(
    run: Path | None, output: Path | None, duration: float | None, links: bool, as_json: bool
) -> None:
    """Show the loop delay of RUN, a recording or a running graph. Default: the running graph."""
    from forcebound.config.traces import as_link_trace
    from forcebound.monitor.delay import measure
    from forcebound.network.trace import check_output

    if output is not None:
        check_output(output)
    measured = measure(run, duration)
    if not measured.is_complete:
        show(f"{run} is incomplete: these are the delays up to its end", err=True)
    if output is not None:
        as_link_trace(measured.trace, measured.document).write(output)
    document = {**measured.summary, "trace": None if output is None else str(output)}
    if links:
        document["links_ms"] = _delays_of_links(run, duration)
    if as_json:
        print_json(document)
        return
    for name, value in document["loop_delay_ms"].items():
        label = name.replace("_", ".")
        show(f"loop delay {label:<6}{'-' if value is None else f'{value:.2f} ms':>10}")
    _show_histogram(document["histogram"])
    why = "lost, or overtaken by a newer answer"
    show(f"unanswered {document['lost_share']:>8.1%} of {document['ticks']} ticks ({why})")
    if links:
        _show_delays(document["links_ms"])
    if output is not None:
        show(f"trace: {output}")


def _delays_of_links(run: Path | None, duration: float | None) -> Mapping[str, Any]:
    from forcebound.monitor.runs import find
    from forcebound.monitor.streams import DURATION, measure_hops

    run_dir = find(run, of_graph=True, option="`forcebound delay GRAPH`")
    return measure_hops(run_dir, DURATION if duration is None else duration)


def _show_delays(links: Mapping[str, Mapping[str, Any]]) -> None:
    from forcebound.monitor.streams import SHARES

    def text(value: float | None) -> str:
        return "–" if value is None else f"{value:.3f} ms"

    head = ("from sending on", *(name.replace("_", ".") for name in SHARES), "ticks")
    rows = [
        (name, *(text(one[share]) for share in SHARES), str(one["count"]))
        for name, one in links.items()
    ]
    print_rows(head, rows)


def _show_histogram(classes: Sequence[Mapping[str, float]]) -> None:
    most = max((row["count"] for row in classes), default=1)
    for row in classes:
        bar = "█" * round(BAR * row["count"] / most)
        show(f"{row['from_ms']:>8.2f} ms {row['count']:>7} {bar}")


@click.group()
def param() -> None:
    """Show and change the parameters of a running graph."""


@param.command("list", short_help="List what can be changed during a run.")
@click.option("--changed", is_flag=True, help="Only those changed since launch.")
@run_option
@json_option
@reports_errors
def list_parameters(changed: bool, run_dir: Path | None, as_json: bool) -> None:
    """List the parameters that can be changed during a run, with their values."""
    _show_parameters((), run_dir, as_json, changed)


@param.command("get", short_help="Show parameters, or a whole section.")
@click.argument(
    "names", nargs=-1, required=True, metavar="NAME...", shell_complete=complete.parameters
)
@run_option
@json_option
@reports_errors
def get_parameters(names: tuple[str, ...], run_dir: Path | None, as_json: bool) -> None:
    """Show parameters, e.g. environment.stiffness, or a whole section, e.g. links."""
    _show_parameters(names, run_dir, as_json)


@param.command("set", short_help="Change parameters.")
@click.argument(
    "settings", nargs=-1, required=True, metavar="NAME:=VALUE...", shell_complete=complete.changes
)
@run_option
@reports_errors
def set_parameters(settings: tuple[str, ...], run_dir: Path | None) -> None:
    """Change parameters of a running graph, e.g. links.environment_query.delay:="20 ms"."""
    from forcebound.monitor import tuning, wording
    from forcebound.monitor.runs import find, while_running

    run = find(run_dir)
    with while_running(run):
        change = tuning.set_parameters(run, tuning.read_settings(settings))
        _print_parameters(run, change.values)
    if not change.values:
        show("nothing to change: the graph already has these values")
    for note in change.notes:
        show(f"note: {wording.note(note)}", err=True)


def _show_parameters(
    names: tuple[str, ...], run_dir: Path | None, as_json: bool, changed: bool = False
) -> None:
    from forcebound.monitor import tuning
    from forcebound.monitor.runs import find, while_running

    run = find(run_dir)
    with while_running(run):
        if changed:
            found = tuning.changed_parameters(run)
        else:
            found = tuning.find_parameters(tuning.configuration(run), names)
        print_json(found) if as_json else _print_parameters(run, found)


def _print_parameters(run: Path, values: "Mapping[str, Any]") -> None:
    from forcebound.monitor.formatting import as_written
    from forcebound.monitor.tuning import configuration, found_elsewhere

    config = configuration(run)
    elsewhere = found_elsewhere(run, config, values)
    for name, text in as_written(config, values).items():
        remark = "  # belongs to another machine; value of the launch file here"
        show(f"{name}: {text}{remark if name in elsewhere else ''}")


@click.command()
@run_option
@json_option
@reports_errors
def doctor(run_dir: Path | None, as_json: bool) -> None:
    """Diagnose the running graph, else this machine.

    Exit status 0: no problem; 1: at least one problem, or the graph ended meanwhile; 2: no such
    graph.
    """
    from forcebound.monitor import doctor, machine, runs
    from forcebound.monitor.observation import observe

    graph = None if run_dir is None and not runs.running() else runs.find(run_dir)
    findings = machine.examine(machine.look()) if graph is None else doctor.examine(observe(graph))
    is_well = all(finding.severity != "problem" for finding in findings)
    if as_json:
        name = None if graph is None else str(graph)
        documents = [_document(finding) for finding in findings]
        print_json({"graph": name, "is_well": is_well, "findings": documents})
    else:
        show("this machine; no graph runs" if graph is None else f"graph in {graph}")
        for document in map(_document, findings):
            _show_finding(document)
        if is_well:
            show("no problem found")
    sys.exit(0 if is_well else 1)


def _document(finding: "Finding") -> dict[str, Any]:
    """Return a finding as a map: its codes and data, and its words."""
    from dataclasses import asdict

    from forcebound.monitor import wording

    words = {"seen": wording.seen(finding), "advice": wording.advice(finding)}
    return {**asdict(finding), **words, "commands": wording.commands(finding)}


def _show_finding(document: Mapping[str, Any]) -> None:
    severity = document["severity"]
    label = click.style(f"{severity:<8}", fg=COLOURS[severity])
    click.echo(f"{label} " + printable(f"{document['where']}: {document['seen']}"))
    if document["advice"]:
        show(f"{'':8} -> {document['advice']}")
