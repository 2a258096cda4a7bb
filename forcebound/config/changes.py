"""Change of parameters by ``forcebound param set``, checked as a launch file is.

:mod:`forcebound.launch.application` brings running nodes and links to it.
"""

import re
from collections.abc import Mapping
from typing import Any

from forcebound.config.graph import GraphConfig
from forcebound.config.loader import from_document
from forcebound.config.parameters import parameters, unknown_parameter
from forcebound.config.resolved import to_document
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
    document = to_document(config)
    for name, value in settings.items():
        *path, last = name.split(".")
        section = document
        for step in path:
            section = section.setdefault(step, {})
        section[last] = value
    try:
        return from_document(document)
    except ConfigError as error:  # the places are names of parameters: they need no other words
        raise ConfigError(re.sub(r"^document: ", "", str(error), flags=re.MULTILINE)) from None
