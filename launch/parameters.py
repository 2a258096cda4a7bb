"""What of a graph can be changed while it runs, by name: its links' impairments, its environment.

A parameter is named by its place in a launch file: ``links.environment_query.delay``,
``environment.compute_delay``, ``environment.stiffness``.
"""

from collections.abc import Iterable, Mapping
from typing import Any

from forcebound.launch.config import LINKS, GraphConfig, plain, to_document
from forcebound.messages.packets import (
    TOPIC_OF,
    DeviceState,
    EnvironmentQuery,
    EnvironmentReply,
    ForceCommand,
)
from forcebound.network.impairment import Impairment

SECTIONS = ("links", "environment")  # of a launch file, whose entries are parameters


RECEIVERS = {
    TOPIC_OF[DeviceState]: "controller",
    TOPIC_OF[EnvironmentQuery]: "environment",
    TOPIC_OF[EnvironmentReply]: "controller",
    TOPIC_OF[ForceCommand]: "device",
}  # the process that holds the model of a link


def parameters(config: GraphConfig) -> dict[str, Any]:
    """Return all that can be changed, by name, as plain JSON values in SI units."""
    document = to_document(config)
    links = {topic: plain(Impairment()) | document["links"].get(topic, {}) for topic in LINKS}
    found = {
        f"links.{topic}.{name}": value
        for topic, link in links.items()
        for name, value in link.items()
    }
    environment = document["environment"]
    return found | {
        f"environment.{name}": value for name, value in environment.items() if name != "kind"
    }


def differences(old: GraphConfig, new: GraphConfig) -> dict[str, Any]:
    """Return the parameters of ``new`` that ``old`` does not have with this value."""
    before = parameters(old)
    return {
        name: value
        for name, value in parameters(new).items()
        if name not in before or value != before[name]
    }


def holders(names: Iterable[str]) -> set[str]:
    """Return the processes that parameters belong to: of a link, the one that receives."""
    found = set()
    for name in names:
        section, entry, *_ = name.split(".")
        found.add(RECEIVERS[entry] if section == "links" else "environment")
    return found


def describe(settings: Mapping[str, Any]) -> str:
    """Return parameters and their values in words."""
    return ", ".join(f"{name} = {value}" for name, value in settings.items())
