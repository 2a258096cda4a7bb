"""Parameters of a running graph: reading and changing them.

The launch document in the run directory holds the present values. A change writes it anew and sends
the values to the nodes; a node that starts later reads the document.

Not every parameter in the document belongs to this machine: with an environment elsewhere, each
machine has a document of its own, which the nodes there read.
"""

import json
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from forcebound.config.graph import LAW, GraphConfig
from forcebound.config.loader import change
from forcebound.config.parameters import differences, holders, parameters, unknown_parameter
from forcebound.config.problems import Problems, unknown
from forcebound.config.resolved import ALL_CODE, restore, to_document
from forcebound.config.tree import parse
from forcebound.errors import ConfigError, RunError
from forcebound.launch.run_directory import (
    RunDocument,
    read_launch_document,
    updating,
    write_launch_document,
)
from forcebound.messages.packets import LINKS
from forcebound.monitor.control import ANSWER_TIMEOUT, ask_all, await_law
from forcebound.monitor.findings import Fact
from forcebound.monitor.kernels import Kernels
from forcebound.monitor.nodes import ENVIRONMENT, Present, present
from forcebound.processes import LAUNCHER
from forcebound.quantities import Range
from forcebound.units import parse_quantity

PATHS = (
    "trace",
    "distribution_file",
    ".file",
    ".texture",
)  # ends of the names of parameters that are files

DOWN = ("stopped", "ended")  # states of a node that is not restarted by its launcher


@dataclass(frozen=True)
class Change:
    """The outcome of a change."""

    values: Mapping[str, Any]  # the parameters that are new, by name, in SI units
    notes: tuple[Fact, ...] = ()  # a node that has it later, or does not serve


def configuration(run_dir: Path, serves: bool = True) -> GraphConfig:
    """Return the present configuration of a graph; the user's own code is run if it ``serves``.

    Raises:
        ConfigError: If the run directory does not say.
    """
    return restore(read_launch_document(run_dir), ALL_CODE if serves else ())


def find_parameters(config: GraphConfig, names: Sequence[str]) -> dict[str, Any]:
    """Return the values of some parameters; a section's name stands for all that begin with it.

    Without names: all that can be changed. By name also what is fixed while the graph runs.

    Raises:
        ConfigError: If a name is not known.
    """
    if not names:
        return parameters(config)
    every = every_parameter(config)
    found: dict[str, Any] = {}
    for name in names:
        matching = {key: every[key] for key in every if key == name or key.startswith(f"{name}.")}
        if not matching:
            raise ConfigError(unknown_parameter(name, config))
        found |= matching
    return found


def every_parameter(config: GraphConfig) -> dict[str, Any]:
    """Return all values by name: those that can be changed, and what is fixed during a run."""
    fixed: dict[str, Any] = {}
    for section, value in to_document(config).items():
        if isinstance(value, Mapping):
            fixed |= {f"{section}.{name}": entry for name, entry in value.items()}
        elif section != "forcebound":
            fixed[section] = value
    fixed = {name: value for name, value in fixed.items() if not name.startswith("links.")}
    return parameters(config) | fixed


def found_elsewhere(run_dir: Path, config: GraphConfig, names: Iterable[str]) -> set[str]:
    """Return those of some parameters that belong to nodes on another machine."""
    return set(_elsewhere(names, present(run_dir, config)))


def changed_parameters(run_dir: Path) -> dict[str, Any]:
    """Return the parameters of a graph that were changed since its launch, with their values.

    Raises:
        ConfigError: If the run directory does not say.
    """
    try:
        started = json.loads(RunDocument.read(run_dir).metadata["launch"])
    except (ValueError, KeyError) as error:
        raise ConfigError(f"{run_dir} does not say with what its graph was started") from error
    return differences(started, configuration(run_dir))


def read_settings(texts: Sequence[str]) -> dict[str, Any]:
    """Return the settings of ``NAME:=VALUE`` texts; a value is YAML, as in a launch file.

    Raises:
        ConfigError: If a text is not of this form.
    """
    settings: dict[str, Any] = {}
    for text in texts:
        name, sign, value = text.partition(":=")
        if not sign or not name:
            raise ConfigError(
                f"expected NAME:=VALUE, such as environment.stiffness:=2 N/mm, got {text}"
            )
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
    """Lose every packet of some links from now for a time.

    Args:
        run_dir: Of the graph.
        time: Such as ``500ms``.
        links: By topic; none: query and reply of the environment.

    Returns:
        The time in s, and the links.

    Raises:
        ConfigError: As :func:`set_parameters`; and if it is no time.
        RunError: As there.
    """
    seconds = Range(above=0).check(parse_quantity(time, "s"), "s")
    for link in links:
        if link not in LINKS:
            raise ConfigError(unknown("link", link, LINKS))
    chosen = tuple(links) or ("environment_query", "environment_reply")
    names = [f"links.{topic}.outages" for topic in chosen]
    # The same outages once more would be no change.
    set_parameters(run_dir, {name: [] for name in names})
    set_parameters(run_dir, {name: [{"start": 0.0, "duration": seconds}] for name in names})
    return seconds, chosen


def set_parameters(
    run_dir: Path, settings: Mapping[str, Any], kernels: Kernels | None = None
) -> Change:
    """Change parameters of a graph that runs; return when its nodes have them.

    Args:
        run_dir: Of the graph.
        settings: New values by name, as :func:`read_settings` returns them.
        kernels: Compiles those of a new law before the device takes it; None: the device does.

    Raises:
        ConfigError: If there is no such parameter, it cannot have this value, or it belongs to a
            node on another machine; nothing is changed then.
        RunError: If a node refuses, or does not answer; it will read the change later. If another
            command does not end its change.
    """
    now = configuration(run_dir)
    _check_files(run_dir, settings, now)
    here = present(run_dir, now)
    if LAW in settings:
        _prepare_law(change(now, settings).device.servo.law, here, kernels)
    with updating(run_dir, ANSWER_TIMEOUT) as is_alone:
        if not is_alone:
            raise RunError(
                f"another command is changing parameters in {run_dir}, and has not ended for "
                f"{ANSWER_TIMEOUT:g} s; is it suspended (Ctrl-Z)?"
            )
        old = configuration(run_dir)
        new = change(old, settings)
        _check_reach(settings, here)
        request = write_launch_document(run_dir, new)
    # Also those for which the document has the values already: they may not have had the request.
    concerned = sorted(holders(settings))
    down = {
        node for node in concerned if here.states.get(node) in DOWN or node not in here.reachable
    }
    _configure(run_dir, [node for node in concerned if node not in down], request, here)
    notes = [_why_down(node, here) for node in concerned if node in down]
    if ENVIRONMENT in concerned and here.serving is not None:
        code = "another_serves" if here.is_graph else "environment_waits"
        notes.append(Fact(code, {"serving": here.serving}))
    values = differences(old, new)
    if LAW in values and "device" not in down:
        await_law(run_dir, values[LAW])
        notes.append(Fact("law_taken", {"ramp": new.device.servo.engage_time}))
    return Change(values, tuple(notes))


def _check_files(run_dir: Path, settings: Mapping[str, Any], now: GraphConfig) -> None:
    """Refuse other files than those beside the launch file: a page may be someone else's."""
    before = parameters(now)
    for name, value in settings.items():
        if not name.endswith(PATHS) or value in (None, before.get(name)):
            continue
        folder = Path(RunDocument.read(run_dir).folder).resolve()
        try:
            is_there = Path(str(value)).resolve().is_relative_to(folder)
        except (OSError, ValueError, RuntimeError):  # a name that no file can have
            is_there = False
        if not is_there:
            raise ConfigError(
                f"{name}: expected a file in {folder} or below, the folder of the launch file (of"
                f" one that comes with forcebound: where it was started); got {value}"
            )


def _prepare_law(law: str, here: Present, kernels: Kernels | None) -> None:
    """Get ready for a law that the device is to take."""
    if here.states.get("device") == "lost":
        raise ConfigError(f"{LAW}: the device is lost; first, `forcebound device resume`")
    if kernels is not None and here.answers.get("device", {}).get("law") not in (law, None):
        kernels.wait(law)


def _configure(
    run_dir: Path, nodes: Collection[str], request: Mapping[str, Any], here: Present
) -> None:
    """Bring nodes to what the launch document says now."""
    answers = ask_all(run_dir, nodes, request, ANSWER_TIMEOUT)
    for node, answer in answers.items():
        if answer is not None and "error" in answer:
            raise RunError(f"{node} did not take the change: {answer['error']}")
    silent = [node for node, answer in answers.items() if answer is None]
    if not silent:
        return
    who = " and ".join(silent)
    if LAUNCHER not in here.answers:
        raise RunError(
            f"{who} did not answer: no change there; suspended (Ctrl-Z), or just ending?"
        )
    for node in silent:
        ask_all(run_dir, [LAUNCHER], {**request, "node": node}, ANSWER_TIMEOUT)
    raise RunError(
        f"{who} did not answer; the change is kept until it continues (if it is suspended) or"
        " restarts"
    )


def _check_reach(names: Iterable[str], here: Present) -> None:
    """Refuse a change without effect here, because its node is on another machine."""
    elsewhere = _elsewhere(names, here)
    if not elsewhere:
        return
    listed, nodes = ", ".join(sorted(elsewhere)), " and ".join(sorted(set(elsewhere.values())))
    why = f"this link ends at the {nodes}, on the machine of the graph; here is only an environment"
    if ENVIRONMENT in elsewhere.values():
        why = "this belongs to the environment, which is on another machine"
    raise ConfigError(f"{listed}: {why}; use `forcebound param set` there")


def _elsewhere(names: Iterable[str], here: Present) -> dict[str, str]:
    """Return the parameters that belong to nodes on another machine, with those."""
    return {name: node for name in names for node in holders([name]) if node not in here.nodes}


def _why_down(node: str, here: Present) -> Fact:
    """Return why a node that has a change does not run."""
    state = here.states.get(node)
    codes = {None: "no_node", "stopped": "node_stopped"}
    return Fact(codes.get(state, "node_ended"), {"node": node})
