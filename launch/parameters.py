"""What can be changed while a graph runs: the impairments of its links, and the environment.

A parameter is named as in a launch file: ``links.environment_query.delay``,
``environment.compute_delay``, ``environment.stiffness``. :func:`change` makes a new configuration,
checked as a launch file is; :func:`apply` brings a running node from the old one to the new one.
The same two serve ``forcebound param set``, live phases and those in virtual time.
"""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from forcebound.errors import ConfigError
from forcebound.launch.build import build_link, change_environment, change_link
from forcebound.launch.config import LINKS, GraphConfig, plain, to_document
from forcebound.launch.loader import from_document
from forcebound.launch.problems import unknown
from forcebound.messages.packets import TOPIC_OF
from forcebound.network.impairment import Impairment
from forcebound.nodes.environment import EnvironmentNode
from forcebound.process import Runner
from forcebound.simulation import Simulation

SECTIONS = ("links", "environment")


def parameters(config: GraphConfig) -> dict[str, Any]:
    """Return all that can be changed, by name, in SI units."""
    document = to_document(config)
    perfect = plain(Impairment())
    found = {
        f"links.{topic}.{name}": value
        for topic in LINKS
        for name, value in {**perfect, **document["links"].get(topic, {})}.items()
    }
    environment = document["environment"]
    return found | {
        f"environment.{name}": value for name, value in environment.items() if name != "kind"
    }


def change(config: GraphConfig, settings: Mapping[str, Any]) -> GraphConfig:
    """Return the configuration with some parameters changed.

    Args:
        config: What runs.
        settings: New values by name of the parameter; quantities with or without their unit.

    Raises:
        ConfigError: If there is no such parameter or it cannot have this value.
    """
    known = parameters(config)
    document = json.loads(json.dumps(to_document(config)))
    for name, value in settings.items():
        if name not in known:
            raise ConfigError(unknown("parameter", name, known))
        *path, last = name.split(".")
        section = document
        for step in path:
            section = section.setdefault(step, {})
        section[last] = value
    return from_document(document)


def differences(old: GraphConfig, new: GraphConfig) -> dict[str, Any]:
    """Return the parameters in which ``new`` differs, with their new values."""
    before = parameters(old)
    return {
        name: value for name, value in parameters(new).items() if value != before.get(name, value)
    }


def apply(old: GraphConfig, new: GraphConfig, graph: Runner | Simulation) -> dict[str, Any]:
    """Bring the running nodes and links of a graph, or of one process, to a new configuration.

    Returns:
        What was changed there, as :func:`differences`.
    """
    changed = differences(old, new)
    here: dict[str, Any] = {}
    for node in graph.nodes:
        mine = {f"links.{TOPIC_OF[packet]}." for packet in node.subscribes}
        for topic in (TOPIC_OF[packet] for packet in node.subscribes):
            if not any(name.startswith(f"links.{topic}.") for name in changed):
                continue
            impairment = new.links.get(topic, Impairment())
            link = graph.link(topic)
            if link is not None:
                change_link(link, impairment)
            elif impairment != Impairment():
                graph.set_link(topic, build_link(topic, impairment, new.seed))
        if isinstance(node, EnvironmentNode):
            mine.add("environment.")
            if any(name.startswith("environment.") for name in changed):
                change_environment(node, new.environment)
        here |= {name: v for name, v in changed.items() if name.startswith(tuple(mine))}
    return here


def describe(settings: Mapping[str, Any]) -> str:
    """Return changes in words."""
    return ", ".join(f"{name} = {value}" for name, value in settings.items()) or "nothing changed"


class Reloader:
    """Brings a running process to what the launch document says now.

    Args:
        config: What it was started with.
        file: The launch document of its run, which ``forcebound param set`` rewrites.
    """

    def __init__(self, config: GraphConfig, file: Path) -> None:
        self._config = config
        self._file = file

    def __call__(self, runner: Runner) -> dict[str, Any]:
        """Read the document again and apply what is new; return what was changed here.

        Raises:
            ConfigError: If the document cannot be read.
        """
        try:
            document = json.loads(self._file.read_text(encoding="utf-8"))
        except (OSError, ValueError) as error:
            raise ConfigError(f"cannot read {self._file}: {error}") from error
        new = from_document(document)
        changed = apply(self._config, new, runner)
        self._config = new
        return changed
