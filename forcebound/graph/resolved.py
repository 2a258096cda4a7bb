"""The resolved launch file: a configuration as plain JSON in SI units.

It is itself a launch file, without arguments, with every value written out and its hands by name.
Every recording holds it; the processes of a run get it with :func:`run_document`.
:func:`forcebound.graph.model.restore` reads it again, and
:func:`forcebound.graph.loader.from_document` one that may have been changed.
"""

import json
from collections.abc import Callable
from io import StringIO
from typing import Any, TypeAlias

from forcebound.axes import lengths
from forcebound.errors import ConfigError
from forcebound.graph.fields import fields_of
from forcebound.graph.graph import (
    FORMAT,
    KINDS,
    EnvironmentConfig,
    GraphConfig,
    HandConfig,
    PartSpec,
)
from forcebound.haptics.parts.plain import field_of, plain, plain_value
from forcebound.messages.topology import HANDS, HERE, Document, flat

FACTS = "facts"  # key of a run's document: numbers of the devices, by hand, for all processes


#: Fields of a dataclass that a launch file can set, as plain JSON types: all, or some of them.
Fields: TypeAlias = Callable[[Any], Document]


def to_document(config: GraphConfig, fields: Fields = plain) -> Document:
    """Return the configuration as plain JSON in SI units."""
    document: Document = {
        "forcebound": FORMAT,
        "description": config.description,
        "seed": config.seed,
        "duration": config.duration,
        HANDS: {name: hand_document(hand, fields) for name, hand in config.hands.items()},
        "environment": environment_document(config.environment, fields),
        "realtime": fields(config.realtime),
    }
    if config.here is not None:
        document[HERE] = list(config.here)
    if config.units:
        document["units"] = dict(config.units)
    if config.phases:
        document["phases"] = [
            {"name": phase.name, "duration": phase.duration, "set": dict(phase.settings)}
            for phase in config.phases
        ]
    return document


def hand_document(hand: HandConfig, fields: Fields = plain) -> Document:
    """Return the sections of a hand."""
    document: Document = {
        "device": {**part_document("device", hand.device, fields), **fields(hand.servo)},
        "controller": part_document("controller", hand.controller, fields),
        "links": {topic: fields(impairment) for topic, impairment in hand.links.items()},
    }
    if hand.operator is not None:
        document["operator"] = part_document("operator", hand.operator, fields)
    if hand.remote is not None:
        document["remote"] = fields(hand.remote)
    if (axes := hand.named_axes) != lengths(len(axes)):  # of before, a document has none
        document["axes"] = [plain(axis) for axis in axes]
    return document


def environment_document(environment: EnvironmentConfig, fields: Fields = plain) -> Document:
    """Return the section of an environment."""
    settings = {name: value for name, value in fields(environment).items() if name != "model"}
    return {**part_document("environment", environment.model, fields), **settings}


def to_yaml(config: GraphConfig) -> str:
    """Return the configuration as the text of a launch file, without what has its default."""
    from ruamel.yaml import YAML  # slow to import; no process of a run writes a launch file

    document = flat(to_document(config, _without_defaults))
    for name in [name for name, value in document.items() if name == "units" or not value]:
        if name != "seed":
            del document[name]
    yaml = YAML()  # the kind that keeps the order
    yaml.default_flow_style = False
    text = StringIO()
    yaml.dump(json.loads(json.dumps(document)), text)  # no object twice: that gives anchors
    return text.getvalue()


def _without_defaults(part: Any) -> Document:
    return {
        field.name: value
        for field in fields_of(part.__class__).values()
        if (value := plain_value(getattr(part, field_of(field.name)))) != plain_value(field.default)
        or field.required
    }


def run_document(config: GraphConfig) -> Document:
    """Return the document for the processes of a run: with facts of the devices."""
    facts = {name: plain(hand.facts) for name, hand in config.hands.items()}
    return {**to_document(config), FACTS: facts}


def kind_of(section: str, part: object) -> str:
    """Return the ``kind`` that a launch file gives to a part; ConfigError if it has none."""
    kind = KINDS[section].kind_of(type(part))
    if kind is None:
        raise ConfigError(
            f"no kind of {section} is a {type(part).__name__}: keep the class in a file and name"
            " it in a launch file, kind: my_file.py"
        )
    return kind


def part_document(section: str, part: Any, fields: Fields = plain) -> Document:
    """Return kind and parameters of a part, in plain JSON types."""
    if isinstance(part, PartSpec):
        return {"kind": part.kind, **part.values}
    return {"kind": kind_of(section, part), **fields(part)}


def check_plain(part: Any) -> None:
    """Raise ConfigError if JSON has no type or value for a parameter of a part."""
    for name, value in plain(part).items():
        try:
            json.dumps(value, allow_nan=False)
        except (TypeError, ValueError) as error:
            raise ConfigError(f"{name} cannot be written down: {error}") from None
