"""Other parameters for a graph that runs: by ``forcebound param set``, or in its phases.

:func:`change` makes a new configuration, checked as a launch file is;
:mod:`forcebound.launch.application` brings running nodes and links to it.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from forcebound.config.graph import GraphConfig
from forcebound.config.loader import from_document
from forcebound.config.parameters import (
    describe,
    parameters,
    unknown_parameter,
)
from forcebound.config.resolved import restore, to_document
from forcebound.errors import ConfigError


def change(config: GraphConfig, settings: Mapping[str, Any]) -> GraphConfig:
    """Return the configuration with other parameters.

    Args:
        config: What runs.
        settings: New values by name; quantities are SI, or text with their unit.

    Raises:
        ConfigError: If there is no such parameter, or it cannot have this value.
    """
    known = parameters(config)
    for name in settings:
        if name not in known:
            raise ConfigError(unknown_parameter(name, config))
    try:
        return from_document(_with(config, settings))
    except ConfigError as error:  # the places are names of parameters: they need no other words
        raise ConfigError(re.sub(r"^document: ", "", str(error), flags=re.MULTILINE)) from None


def _with(config: GraphConfig, settings: Mapping[str, Any]) -> dict[str, Any]:
    """The document of a configuration with parameters in their places."""
    document = to_document(config)
    for name, value in settings.items():
        *path, last = name.split(".")
        section = document
        for step in path:
            section = section.setdefault(step, {})
        section[last] = value
    return document


@dataclass(frozen=True)
class Part:
    """A phase of a run with its beginning."""

    name: str
    start_ns: int  # since the force engaged
    config: GraphConfig  # that holds in it
    message: str

    @property
    def data(self) -> dict[str, str]:
        """Of the event that reports its beginning."""
        return {"name": self.name}


def timetable(config: GraphConfig) -> list[Part]:
    """Return the phases of a graph with their beginnings."""
    parts: list[Part] = []
    plain = replace(config, phases=())
    start_ns = 0
    for phase in config.phases:
        told = describe(phase.settings) or "as the launch file says"
        message = f"phase {phase.name}: {told}"
        parts.append(Part(phase.name, start_ns, restore(_with(plain, phase.settings)), message))
        start_ns += round(phase.duration * 1e9)
    return parts
