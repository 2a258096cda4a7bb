"""Commands that change a running graph: its nodes, parameters, links."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

from forcebound.cli import complete
from forcebound.cli.common import Group, graph_option, json_option, print_json, run_option, show
from forcebound.roles import ENVIRONMENT

if TYPE_CHECKING:
    from forcebound.messages.control import Parameters

node_argument = click.argument("node", metavar="NODE", shell_complete=complete.nodes)


@click.command(short_help="Stop a node: zero force.")
@node_argument
@graph_option
def stop(node: str, run: Path) -> None:
    r"""Stop NODE (environment or controller) of a running graph: zero force.

    \b
    forcebound stop environment
    forcebound stop left/controller
    """
    from forcebound.observe.control import stop_node
    from forcebound.observe.snapshot import other_environment, snapshot

    serving = other_environment(snapshot(run)) if node == ENVIRONMENT else None
    stop_node(run, node)
    effect = "the device applies zero force until replies arrive again"
    if serving is not None:
        effect = f"{serving} serves as before"
    show(f"{node} is stopped; {effect}")


@click.command(short_help="Start a node that was stopped.")
@node_argument
@graph_option
def start(node: str, run: Path) -> None:
    r"""Start NODE (environment or controller) of a running graph after a stop.

    \b
    forcebound start environment
    """
    from forcebound.observe.control import start_node

    start_node(run, node)
    show(f"{node} runs")


@click.group(short_help="Show and change parameters of a running graph.", cls=Group)
def param() -> None:
    """Show and change the parameters of a running graph, its law included."""


@param.command("list", short_help="List what can be changed during a run.")
@click.option("--changed", is_flag=True, help="Only the changed ones.")
@run_option
@json_option
def list_parameters(changed: bool, run: Path, as_json: bool) -> None:
    r"""List the parameters that can be changed during a run, with their values and ranges.

    \b
    forcebound param list
    forcebound param list --changed --json
    """
    from forcebound.observe import tuning

    if changed:
        _print(run, tuning.changed_parameters(run), as_json)
    else:
        found = tuning.find_parameters(tuning.configuration(run), ())
        _print(run, found, as_json, with_ranges=True)


@param.command("get", short_help="Show parameters, or a whole section.")
@click.argument(
    "names", nargs=-1, required=True, metavar="NAME...", shell_complete=complete.parameters
)
@run_option
@json_option
def get_parameters(names: tuple[str, ...], run: Path, as_json: bool) -> None:
    r"""Show parameters, or a whole section; also what is fixed while the graph runs.

    \b
    forcebound param get environment.stiffness device.law
    forcebound param get links
    """
    from forcebound.observe import tuning

    _print(run, tuning.find_parameters(tuning.configuration(run), names), as_json)


@param.command("set", short_help="Change parameters.")
@click.argument(
    "settings", nargs=-1, required=True, metavar="NAME:=VALUE...", shell_complete=complete.changes
)
@run_option
@json_option
def set_parameters(settings: tuple[str, ...], run: Path, as_json: bool) -> None:
    r"""Change parameters of a running graph, until it ends.

    A new law begins without force and with a new ledger; the force returns over device.engage_time.

    \b
    forcebound param set device.law:=certified_fading
    forcebound param set links.environment_query.delay:="20 ms"
    forcebound param set environment.stiffness:="2 N/mm" --run stiff_wall
    forcebound param set left.device.law:=certified
    """
    from contextlib import closing

    from forcebound.observe import tuning
    from forcebound.observe.kernels import Kernels

    with closing(Kernels(run)) as kernels:
        change = tuning.set_parameters(run, tuning.read_settings(settings), kernels)
    _print(run, change.values, as_json)
    if not change.values and not as_json:
        show("nothing to change: the graph already has these values")
    for note in change.notes:
        show(f"note: {note}", err=True)


def _print(run: Path, values: "Parameters", as_json: bool, *, with_ranges: bool = False) -> None:
    from forcebound.observe.formatting import as_written, ranges
    from forcebound.observe.tuning import configuration, found_elsewhere

    if as_json:
        print_json(values)
        return
    config = configuration(run)
    remarks = ranges(config, values) if with_ranges else {}
    elsewhere = found_elsewhere(run, config, values)
    remarks |= dict.fromkeys(elsewhere, "belongs to another machine; value of the launch file here")
    for name, text in as_written(config, values, config.units).items():
        show(f"{name}: {text}  # {remarks[name]}" if remarks.get(name) else f"{name}: {text}")


@click.command(short_help="Cut a link from now for a time.")
@click.argument("time", metavar="TIME")
@click.argument("links", nargs=-1, metavar="[LINK]...", shell_complete=complete.links)
@run_option
@json_option
def outage(time: str, links: tuple[str, ...], run: Path, as_json: bool) -> None:
    r"""Lose every packet of LINK for TIME. Default: environment_query, environment_reply.

    With several hands, a link has the name of its hand; the default is both links of each.

    \b
    forcebound outage 500ms
    forcebound outage 2s force_command
    forcebound outage 2s left/force_command
    """
    from forcebound.observe.tuning import cut_links

    seconds, cut = cut_links(run, time, links)
    if as_json:
        print_json({"links": cut, "duration_s": seconds})
    else:
        show(f"{', '.join(cut)}: no packet for {time}")
