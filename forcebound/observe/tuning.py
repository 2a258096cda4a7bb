"""Parameters of a running graph: reading and changing them.

The launch document in the run directory holds the present values. A change rewrites it
and sends the values to the nodes; a node that starts later reads the document.

Not every parameter in the document belongs to this machine: with an environment elsewhere, each
machine has a document of its own, which the nodes there read.
"""

import json
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from forcebound.errors import ConfigError, RunError
from forcebound.graph.graph import KINDS, GraphConfig
from forcebound.graph.model import always, restore
from forcebound.graph.names import LAW, ParameterName, parameter_name, split_setting
from forcebound.graph.parameters import (
    change,
    differences,
    node_of,
    parameters,
    spelled_out,
    unknown_parameter,
)
from forcebound.graph.problems import Problems
from forcebound.graph.resolved import to_document
from forcebound.graph.tree import parse
from forcebound.messages.control import (
    Configure,
    ConfigureNode,
    DeviceStatus,
    Parameters,
    Refused,
)
from forcebound.messages.topology import HAND, HANDS, node_name
from forcebound.observe.control import ANSWER_TIMEOUT, ask, ask_all, await_law
from forcebound.observe.kernels import Kernels
from forcebound.observe.snapshot import GraphStatus, other_environment, snapshot
from forcebound.observe.streams import unknown_stream
from forcebound.quantities import Range
from forcebound.roles import DEVICE, ENVIRONMENT, LAUNCHER
from forcebound.run.application import try_out
from forcebound.run.lifecycle import resume_command
from forcebound.run.run_directory import (
    RunDocument,
    graph_in,
    read_configuration,
    requests,
    updating,
    write_configuration,
)
from forcebound.units import parse_quantity

PATHS = ("trace", ".file", ".texture")  # ends of names of file parameters


@dataclass(frozen=True)
class Change:
    """The outcome of a change."""

    values: Parameters  # the parameters that are new, by name, in SI units
    notes: tuple[str, ...] = ()  # about nodes that have it later, or do not serve; for people


def configuration(run_dir: Path, with_code: bool = True) -> GraphConfig:
    """Return the present configuration of a graph; ``with_code``: also parts in users' files."""
    is_made = always if with_code else lambda section, kind: KINDS[section].is_shipped(kind)
    return read_configuration(run_dir, is_made)


def find_parameters(config: GraphConfig, names: Sequence[str]) -> Parameters:
    """Return the values of some parameters; a section's name stands for all that begin with it.

    Without names: all that can be changed. Values that are fixed during a run are found by name.
    """
    if not names:
        return parameters(config)
    every = every_parameter(config)
    found: Parameters = {}
    for name in (str(ParameterName.parse(name)) for name in names):
        matching = {key: every[key] for key in every if key == name or key.startswith(f"{name}.")}
        if not matching:
            raise ConfigError(unknown_parameter(name, config))
        found |= matching
    return found


def every_parameter(config: GraphConfig) -> Parameters:
    """Return all values by name: those that can be changed, and what is fixed during a run."""
    fixed: Parameters = {}
    document = to_document(config)
    sections = {
        parameter_name(hand, section): value
        for hand, own in document.pop(HANDS).items()
        for section, value in own.items()
        if section != "links"
    }
    for section, value in {**document, **sections}.items():
        if isinstance(value, Mapping) and section != "units":
            fixed |= {f"{section}.{name}": entry for name, entry in value.items()}
        elif section not in ("forcebound", "units"):
            fixed[section] = value
    return parameters(config) | fixed


def found_elsewhere(run_dir: Path, config: GraphConfig, names: Iterable[str]) -> set[str]:
    """Return those of some parameters that belong to nodes on another machine."""
    return set(_elsewhere(names, snapshot(run_dir), config))


def changed_parameters(run_dir: Path) -> Parameters:
    """Return the parameters of a graph that were changed since its launch, with their values."""
    started = restore(json.loads(RunDocument.read(run_dir).metadata["launch"]))
    return differences(started, read_configuration(run_dir))


def read_settings(texts: Sequence[str]) -> Parameters:
    """Return the settings of ``NAME:=VALUE`` texts; a value is YAML, as in a launch file."""
    settings: Parameters = {}
    for name, value in map(split_setting, texts):
        problems = Problems()
        tree = parse(f"value: {value}", name, problems)
        problems.raise_if_any()
        assert tree is not None  # what is no YAML was a problem
        plain = tree.entries["value"].plain
        if name.endswith(PATHS) and isinstance(plain, str):
            plain = str(Path(plain).absolute())  # the nodes have another current folder
        settings[name] = plain
    return settings


def cut_links(run_dir: Path, time: str, links: Sequence[str]) -> tuple[float, tuple[str, ...]]:
    """Lose every packet of some links from now for a time such as ``500ms``.

    A link is named as its stream: ``environment_query``, or ``left/environment_query``. Without
    links: query and reply of the environment, of all hands. Returns the time, in s, and the links.
    Errors are as of :func:`set_parameters`.
    """
    seconds = Range(above=0).check(parse_quantity(time, "s"), "s")
    known = {stream.name: stream for stream in graph_in(run_dir).links}
    for link in links:
        if link not in known:
            raise ConfigError(unknown_stream("link", link, known))
    asked = ("environment_query", "environment_reply")
    chosen = tuple(links) or tuple(name for name, one in known.items() if one.topic in asked)
    cut = (known[name] for name in chosen)
    names = [parameter_name(one.hand or HAND, f"links.{one.topic}.outages") for one in cut]
    # The same outages once more would be no change.
    set_parameters(run_dir, {name: [] for name in names})
    set_parameters(run_dir, {name: [{"start": 0.0, "duration": seconds}] for name in names})
    return seconds, chosen


def set_parameters(run_dir: Path, settings: Parameters, kernels: Kernels | None = None) -> Change:
    """Change parameters of a graph that runs; return when its nodes have them.

    ``settings`` are as of :func:`read_settings`. ``kernels`` compiles those of a new law before the
    device takes it; None: the device does.

    Raises:
        ConfigError: If there is no such parameter, it cannot have this value, or it belongs to a
            node on another machine; nothing is changed then.
        RunError: If a node refuses, or does not answer; it will read the change later. If another
            command does not end its change.
    """
    settings = spelled_out(settings)
    now, graph = configuration(run_dir), snapshot(run_dir)
    known = parameters(now)
    concerned = sorted({node_of(name, now) for name in settings if name in known})
    _check_files(graph.run, settings, now)
    other = other_environment(graph) if ENVIRONMENT in concerned else None
    laws = [name for name in map(ParameterName.parse, settings) if name.is_law]
    hands = change(now, settings).hands if laws else {}
    for name in laws:
        _prepare_law(hands[name.hand].servo.law, name.hand, graph, kernels)
    with updating(run_dir, ANSWER_TIMEOUT) as is_alone:
        if not is_alone:
            raise RunError(
                f"another command is changing parameters in {run_dir}, and has not ended for "
                f"{ANSWER_TIMEOUT:g} s; is it suspended (Ctrl-Z)?"
            )
        old = configuration(run_dir)
        new = change(old, settings)
        _check_reach(_elsewhere(settings, graph, new))
        try_out(new, settings)
        write_configuration(run_dir, new)
    # Also those for which the document has the values already: they may not have had the request.
    down = {node: why for node in concerned if (why := _why_down(node, graph))}
    sent = requests(new, settings)
    _configure(graph, {node: sent[node] for node in concerned if node not in down})
    notes = list(down.values())
    if other is not None:
        waits = "this environment, which waits: it has the change, which is felt when it serves"
        here = (
            "the environment of this machine, to which the change was made: use `forcebound param"
            " set` on the other's machine"
        )
        notes.append(f"{other} serves the graph, and not {here if graph.run.is_graph else waits}")
    values = differences(old, new)
    for hand in (name.hand for name in laws if parameter_name(name.hand, LAW) in values):
        if node_name(hand, DEVICE) in down:
            continue
        await_law(run_dir, values[parameter_name(hand, LAW)], hand)
        ramp = f"the force returns over {1e3 * new.hands[hand].servo.engage_time:.3g} ms"
        notes.append(f"the law was taken without force, with a new ledger; {ramp}")
    return Change(values, tuple(notes))


def _check_files(run: RunDocument, settings: Parameters, now: GraphConfig) -> None:
    """Refuse other files than those beside the launch file: a page may be someone else's."""
    before = parameters(now)
    for name, value in settings.items():
        if not name.endswith(PATHS) or value in (None, before.get(name)):
            continue
        folder = Path(run.folder).resolve()
        if not Path(os.path.realpath(str(value))).is_relative_to(folder):
            raise ConfigError(
                f"{name}: expected a file in {folder} or below, the folder of the launch file (of"
                f" one that comes with forcebound: where it was started); got {value}"
            )


def _prepare_law(law: str, hand: str, graph: GraphStatus, kernels: Kernels | None) -> None:
    """Get ready for a law that the device of a hand is to take."""
    device = graph.processes.get(node_name(hand, DEVICE))
    if device is not None and device.state == "lost":
        resume = resume_command(hand)
        raise ConfigError(f"{parameter_name(hand, LAW)}: the device is lost; first, {resume}")
    status = None if device is None else device.answer
    if kernels is not None and isinstance(status, DeviceStatus) and status.law != law:
        kernels.wait(law)


def _why_down(node: str, graph: GraphStatus) -> str:
    """Return why a node does not take a change now; empty: it does."""
    process = graph.processes.get(node)
    if process is None:
        return f"no {node} is running here"
    if process.state == "stopped":
        words = f"{node} is stopped on request, and has the change when it starts again"
        return f"{words} (`forcebound start {node}`)"
    return f"{node} has ended" if process.state == "ended" else ""


def _configure(graph: GraphStatus, sent: Mapping[str, Configure]) -> None:
    """Send nodes the parameters of now."""
    answers = ask_all(graph.run_dir, sent, ANSWER_TIMEOUT)
    for node, answer in answers.items():
        if isinstance(answer, Refused):
            raise RunError(f"{node} did not take the change: {answer.error}")
    silent = [node for node, answer in answers.items() if answer is None]
    if not silent:
        return
    listed = " and ".join(silent)
    if graph.phase is None:
        raise RunError(
            f"{listed} did not answer: no change there; suspended (Ctrl-Z), or just ending?"
        )
    for node in silent:
        ask(graph.run_dir, LAUNCHER, ConfigureNode(node, sent[node]), ANSWER_TIMEOUT)
    raise RunError(
        f"{listed} did not answer; the change is kept until it continues (if it is suspended) or"
        " restarts"
    )


def _elsewhere(names: Iterable[str], graph: GraphStatus, config: GraphConfig) -> dict[str, str]:
    """Return the parameters that belong to nodes on another machine, with those."""
    here = graph.nodes_here(config)
    nodes = {name: node_of(name, config) for name in names}
    return {name: node for name, node in nodes.items() if node not in here}


def _check_reach(elsewhere: Mapping[str, str]) -> None:
    """Refuse a change without effect here, because its node is on another machine."""
    if not elsewhere:
        return
    listed, nodes = ", ".join(sorted(elsewhere)), " and ".join(sorted(set(elsewhere.values())))
    why = f"this link ends at the {nodes}, on the machine of the graph; here is only an environment"
    if ENVIRONMENT in elsewhere.values():
        why = "this belongs to the environment, which is on another machine"
    raise ConfigError(f"{listed}: {why}; use `forcebound param set` there")
