"""Commands that change a running graph: its nodes, parameters, links."""

from collections.abc import Iterable
from contextlib import closing
from pathlib import Path

import click

from forcebound.cli import complete
from forcebound.cli import options as opt
from forcebound.cli.common import Group, command, print_document, print_json, show
from forcebound.cli.lazy import when_used
from forcebound.errors import ConfigError
from forcebound.roles import CONTROLLER, ENVIRONMENT

with when_used():
    from forcebound.graph import names as graph_names
    from forcebound.graph import parameters
    from forcebound.messages import control as messages
    from forcebound.observe import control, episodes, formatting, snapshot, tuning
    from forcebound.observe import kernels as observed

EPISODES = ("start", "keep", "discard")

_links = complete.offering(
    lambda context, _: (stream.name for stream in complete.graph_of(context).links)
)


@complete.offering
def _nodes(context: click.Context, begun: str) -> Iterable[str]:
    """Nodes of the running graph that can be stopped."""
    graph = complete.graph_of(context)
    return (name for name in graph.loop if graph.nodes[name].role in (ENVIRONMENT, CONTROLLER))


@complete.offering
def _parameters(context: click.Context, begun: str) -> Iterable[str]:
    """Parameters of the running graph, also those that are fixed."""
    return tuning.every_parameter(tuning.configuration(context.params["run"], with_code=False))


@complete.offering
def _changes(context: click.Context, begun: str) -> Iterable[str]:
    """Parameters of the running graph, each ``name:=``, and its value; for the law all choices."""
    config = tuning.configuration(context.params["run"], with_code=False)
    known = tuning.find_parameters(config, ())
    name, sign, _ = begun.partition(":=")
    if not sign:
        return [f"{one}:=" for one in known]
    if graph_names.ParameterName.parse(name).is_law:
        return [f"{name}:={law}" for law in parameters.takeable_laws()]
    value = formatting.as_written(config, {name: known[name]})[name]
    return [f"{name}:={complete.one_word(value)}"]


_node = opt.argument(_nodes)


def stop(node: str = _node, run: Path = opt.graph) -> None:
    r"""Stop NODE (environment or controller) of a running graph: zero force.

    \b
    forcebound stop environment
    forcebound stop left/controller
    """
    serving = snapshot.other_environment(snapshot.snapshot(run)) if node == ENVIRONMENT else None
    control.stop_node(run, node)
    effect = "the device applies zero force until replies arrive again"
    if serving is not None:
        effect = f"{serving} serves as before"
    show(f"{node} is stopped; {effect}")


def start(node: str = _node, run: Path = opt.graph) -> None:
    r"""Start NODE (environment or controller) of a running graph after a stop.

    \b
    forcebound start environment
    """
    control.start_node(run, node)
    show(f"{node} runs")


param = Group("param", help="Show and change the parameters of a running graph, its law included.")


@command("list", param, short_help="List what can be changed during a run.")
def list_parameters(
    changed: bool = opt.flag("Only the changed ones."),
    run: Path = opt.run,
    as_json: bool = opt.as_json,
) -> None:
    r"""List the parameters that can be changed during a run, with their values and ranges.

    \b
    forcebound param list
    forcebound param list --changed --json
    """
    if changed:
        _print(run, tuning.changed_parameters(run), as_json)
    else:
        found = tuning.find_parameters(tuning.configuration(run), ())
        _print(run, found, as_json, with_ranges=True)


@command("get", param, short_help="Show parameters, or a whole section.")
def get_parameters(
    names: tuple[str, ...] = opt.arguments("NAME...", _parameters, required=True),
    run: Path = opt.run,
    as_json: bool = opt.as_json,
) -> None:
    r"""Show parameters, or a whole section; also what is fixed while the graph runs.

    \b
    forcebound param get environment.stiffness device.law
    forcebound param get links
    """
    _print(run, tuning.find_parameters(tuning.configuration(run), names), as_json)


@command("set", param, short_help="Change parameters.")
def set_parameters(
    settings: tuple[str, ...] = opt.arguments("NAME:=VALUE...", _changes, required=True),
    run: Path = opt.run,
    as_json: bool = opt.as_json,
) -> None:
    r"""Change parameters of a running graph, until it ends.

    A new law begins without force and with a new ledger; the force returns over device.engage_time.

    \b
    forcebound param set device.law:=certified_fading
    forcebound param set links.environment_query.delay:="20 ms"
    forcebound param set environment.stiffness:="2 N/mm" --run stiff_wall
    forcebound param set left.device.law:=certified
    """
    with closing(observed.Kernels(run)) as kernels:
        change = tuning.set_parameters(run, tuning.read_settings(settings), kernels)
    _print(run, change.values, as_json)
    if not change.values and not as_json:
        show("nothing to change: the graph already has these values")
    for note in change.notes:
        show(f"note: {note}", err=True)


def _print(
    run: Path, values: "messages.Parameters", as_json: bool, *, with_ranges: bool = False
) -> None:
    if as_json:
        print_json(values)
        return
    config = tuning.configuration(run)
    remarks = formatting.ranges(config, values) if with_ranges else {}
    elsewhere = tuning.found_elsewhere(run, config, values)
    remarks |= dict.fromkeys(elsewhere, "belongs to another machine; value of the launch file here")
    for name, text in formatting.as_written(config, values, config.units).items():
        show(f"{name}: {text}  # {remarks[name]}" if remarks.get(name) else f"{name}: {text}")


def outage(
    time: str = opt.argument(),
    links: tuple[str, ...] = opt.arguments("[LINK]...", _links),
    run: Path = opt.run,
    as_json: bool = opt.as_json,
) -> None:
    r"""Lose every packet of LINK for TIME. Default: environment_query, environment_reply.

    With several hands, a link has the name of its hand; the default is both links of each.

    \b
    forcebound outage 500ms
    forcebound outage 2s force_command
    forcebound outage 2s left/force_command
    """
    seconds, cut = tuning.cut_links(run, time, links)
    words = f"{', '.join(cut)}: no packet for {time}"
    print_document({"links": cut, "duration_s": seconds}, as_json, lambda _: [words])


def episode(
    action: "messages.EpisodeAction | None" = opt.argument(
        required=False, metavar="[start|keep|discard]", type=click.Choice(EPISODES)
    ),
    buttons: str = opt.option(
        "Actions of the device's buttons, start=0,keep=1,discard=2.", default=""
    ),
    hand: str | None = opt.hand,
    run: Path = opt.graph,
) -> None:
    r"""Start an episode of the recording of a running graph; keep or discard the open one.

    At a start and after a discard the world begins again; the force returns over engage_time.
    Without an action: by the keys s, k and d, and by buttons of the device, until q.

    \b
    forcebound episode start
    forcebound episode keep
    forcebound episode --buttons start=0,keep=1,discard=2
    """

    def act(chosen: "messages.EpisodeAction") -> None:
        try:
            found = episodes.mark(run, chosen)
        except ConfigError as error:
            if action is not None:
                raise
            show(f"forcebound: {error}", err=True)
            return
        open_one = f"episode {found.begun - 1} is open, " if found.is_open else ""
        show(f"{open_one}{found.kept} kept of {found.begun}")

    if action is not None:
        act(action)
        return
    whose, by_bit = (
        control.chosen_hand(run, hand) if buttons else None,
        episodes.buttons_of(buttons),
    )
    show("s: start, k: keep, d: discard, q: end this command")
    episodes.watch(run, whose, by_bit, act)
