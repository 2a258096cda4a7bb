"""Application of other parameters to running nodes and links, the same live and in virtual time.

:func:`forcebound.config.changes.change` makes the configuration that holds them.
"""

import json
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

from forcebound.config.graph import GraphConfig
from forcebound.config.parameters import differences
from forcebound.config.resolved import ALL_CODE, restore
from forcebound.errors import ConfigError
from forcebound.files import reason
from forcebound.launch.build import build_link, change_environment, change_link
from forcebound.messages.packets import TOPIC_OF
from forcebound.network.impairment import Impairment
from forcebound.nodes.environment import EnvironmentNode
from forcebound.process import Runner
from forcebound.simulation import Simulation


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


class Reloader:
    """Brings a running process to what the launch document of its run says now.

    Args:
        config: What it was started with.
        file: The document, which ``forcebound param set`` writes anew.
        runs: See :func:`forcebound.config.resolved.restore`.
    """

    def __init__(self, config: GraphConfig, file: Path, runs: Collection[str] = ALL_CODE) -> None:
        self._config = config
        self._runs = runs
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
        new = restore(document, self._runs)
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
