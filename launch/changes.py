"""How a running graph gets other parameters: by ``forcebound param set``, or in its phases.

:func:`change` makes a new configuration, checked as a launch file is; :func:`apply` brings running
nodes and links from the old one to the new one, the same way live and in virtual time.
"""

import copy
import json
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from forcebound.errors import ConfigError
from forcebound.files import reason
from forcebound.launch.build import build_link, change_environment, change_link
from forcebound.launch.config import GraphConfig, to_document
from forcebound.launch.loader import from_document
from forcebound.launch.parameters import (
    describe,
    differences,
    parameters,
    unknown_parameter,
)
from forcebound.messages.packets import TOPIC_OF
from forcebound.network.impairment import Impairment
from forcebound.nodes.environment import EnvironmentNode
from forcebound.process import Runner
from forcebound.simulation import Simulation


def change(config: GraphConfig, settings: Mapping[str, Any]) -> GraphConfig:
    """Return the configuration with other parameters.

    Args:
        config: What runs.
        settings: New values by name; quantities are SI, or text with their unit.

    Raises:
        ConfigError: If there is no such parameter, or it cannot have this value.
    """
    known = parameters(config)
    document = copy.deepcopy(to_document(config))
    for name, value in settings.items():
        if name not in known:
            raise ConfigError(unknown_parameter(name, config))
        *path, last = name.split(".")
        section = document
        for step in path:
            section = section.setdefault(step, {})
        section[last] = value
    try:
        return from_document(document)
    except ConfigError as error:  # the places are names of parameters: they need no other words
        raise ConfigError(re.sub(r"^document: ", "", str(error), flags=re.MULTILINE)) from None


def apply(old: GraphConfig, new: GraphConfig, graph: Runner | Simulation) -> dict[str, Any]:
    """Bring the nodes and links of a simulation, or of one process, to other parameters.

    Args:
        old: What they have.
        new: What they get.
        graph: What drives them.

    Returns:
        What has changed there: names and new values.
    """
    changed = differences(old, new)
    done: dict[str, Any] = {}
    for node in graph.nodes:
        for topic in (TOPIC_OF[packet] for packet in node.subscribes):
            here = _beginning(f"links.{topic}.", changed)
            if here:
                _change_link(graph, topic, new)
            done |= here
        if isinstance(node, EnvironmentNode):
            here = _beginning("environment.", changed)
            if here:
                change_environment(node, new.environment)
            done |= here
    return done


@dataclass(frozen=True)
class Part:
    """A phase of a run with its beginning."""

    name: str
    start_ns: int  # since the force engaged
    config: GraphConfig  # that holds in it
    message: str

    @property
    def data(self) -> dict[str, str]:
        """For the event that tells it."""
        return {"name": self.name}


def timetable(config: GraphConfig) -> list[Part]:
    """Return the phases of a graph with their beginnings."""
    parts: list[Part] = []
    plain = replace(config, phases=())  # which each phase would check again, and each node read
    start_ns = 0
    for phase in config.phases:
        told = describe(phase.settings) or "as the launch file says"
        message = f"phase {phase.name}: {told}"
        parts.append(Part(phase.name, start_ns, change(plain, phase.settings), message))
        start_ns += round(phase.duration * 1e9)
    return parts


class Reloader:
    """Brings a running process to what the launch document of its run says now.

    Args:
        config: What it was started with.
        file: The document, which ``forcebound param set`` writes anew.
    """

    def __init__(self, config: GraphConfig, file: Path) -> None:
        self._config = config
        self._file = file

    def __call__(self, runner: Runner) -> dict[str, Any]:
        """Read the document again and apply what is new; return what has changed here.

        Raises:
            ConfigError: If the document cannot be read.
        """
        try:
            document = json.loads(self._file.read_text(encoding="utf-8"))
        except (OSError, ValueError) as error:
            raise ConfigError(f"cannot read {self._file}: {reason(error)}") from error
        serves = any(isinstance(node, EnvironmentNode) for node in runner.nodes)
        new = from_document(document, serves)
        changed = apply(self._config, new, runner)
        self._config = new
        return changed


def _beginning(prefix: str, changed: Mapping[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in changed.items() if name.startswith(prefix)}


def _change_link(graph: Runner | Simulation, topic: str, config: GraphConfig) -> None:
    impairment = config.links.get(topic, Impairment())
    link = graph.link(topic)
    if link is not None:
        change_link(link, impairment)
    elif impairment != Impairment():
        graph.set_link(topic, build_link(topic, impairment, config.seed))
