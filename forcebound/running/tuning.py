"""Look at the parameters of a graph that runs, and change them.

The launch document in the run directory says what holds. Who changes a parameter writes it anew and
tells the nodes, which read it: so a node that starts later has the change, too.
"""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from forcebound.errors import ConfigError, RunError
from forcebound.launch.build import NODE_KINDS
from forcebound.launch.changes import change
from forcebound.launch.config import GraphConfig
from forcebound.launch.live import LAUNCH_FILE, write_launch_document
from forcebound.launch.loader import from_document
from forcebound.launch.parameters import differences, holders, parameters
from forcebound.launch.problems import Problems, unknown
from forcebound.launch.tree import parse
from forcebound.running.orders import ask

PATHS = ("trace", "distribution_file")  # ends of the names of parameters that are files


def configuration(run_dir: Path) -> GraphConfig:
    """Return what a graph runs with now.

    Raises:
        ConfigError: If the run directory does not say.
    """
    try:
        document = json.loads((run_dir / LAUNCH_FILE).read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise ConfigError(f"cannot read what the graph in {run_dir} runs with: {error}") from error
    return from_document(document)


def find_parameters(config: GraphConfig, names: Sequence[str]) -> dict[str, Any]:
    """Return the values of some parameters; a section's name stands for all that begin with it.

    Raises:
        ConfigError: If a name is not known.
    """
    known = parameters(config)
    found: dict[str, Any] = {}
    for name in names:
        matching = {key: known[key] for key in known if key == name or key.startswith(f"{name}.")}
        if not matching:
            raise ConfigError(unknown("parameter", name, known))
        found |= matching
    return found if names else known


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


def set_parameters(run_dir: Path, settings: Mapping[str, Any]) -> dict[str, Any]:
    """Change parameters of a graph that runs; return those that are new, with their values.

    Raises:
        ConfigError: If there is no such parameter, it cannot have this value, or its link ends on
            another machine; nothing is changed then.
        RunError: If a node does not answer; it will read the change when it starts.
    """
    old = configuration(run_dir)
    new = change(old, settings)
    changed = differences(old, new)
    put(run_dir, new, changed)
    return changed


def put(run_dir: Path, config: GraphConfig, changed: Mapping[str, Any]) -> None:
    """Let a graph run with another configuration; see :func:`set_parameters`."""
    nodes = holders(changed)
    here = {node for node in NODE_KINDS if (run_dir / f"control-{node}").exists()}
    _check_reach(config, changed, here)
    write_launch_document(run_dir, config)
    silent = []
    for node in sorted(nodes & here):
        answer = ask(run_dir, node, {"request": "configure"})
        if answer is None:
            silent.append(node)
        elif "error" in answer:
            raise RunError(f"{node} did not take the change: {answer['error']}")
    if silent:
        raise RunError(
            f"{' and '.join(silent)} did not answer; the change is kept for when it starts anew"
        )


def _check_reach(config: GraphConfig, changed: Mapping[str, Any], here: set[str]) -> None:
    if config.remote is None or "environment" in here:
        return
    away = sorted(name for name in changed if "environment" in holders([name]))
    if away:
        raise ConfigError(
            f"{', '.join(away)}: this belongs to the environment, which is on another machine; "
            "use forcebound param set there"
        )
