"""The resolved launch document: a configuration as plain JSON in SI units, and back.

It is itself a launch file, without arguments and with every value written out. Every recording
holds it. The processes of a run read it with :func:`restore`, which checks nothing again and makes
no part; each process makes the part that it runs (:func:`made`).
"""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

from forcebound.errors import ConfigError
from forcebound.graph.fields import fields_of
from forcebound.graph.forms import read_as
from forcebound.graph.graph import (
    BESIDE_MODEL,
    FORMAT,
    KINDS,
    DeviceConfig,
    DeviceFacts,
    EnvironmentConfig,
    GraphConfig,
    HandConfig,
    PartSpec,
    Phase,
    RealtimeConfig,
    RemoteConfig,
)
from forcebound.graph.names import Document, ParameterName
from forcebound.graph.servo import ServoSettings
from forcebound.graph.tree import from_plain
from forcebound.haptics.parts.plain import plain, plain_value
from forcebound.messages.control import Parameters
from forcebound.messages.topology import HAND, HANDS, HERE, hand_sections
from forcebound.network.impairment import Impairment

FACTS = "facts"  # key of a run's document beside those of a launch file: numbers of the devices


def to_document(config: GraphConfig) -> Document:
    """Return the configuration as plain JSON in SI units, for :func:`restore`."""
    environment = config.environment
    beside = {name: plain_value(getattr(environment, name)) for name in BESIDE_MODEL}
    document: Document = {
        "forcebound": FORMAT,
        "description": config.description,
        "seed": config.seed,
        "duration": config.duration,
        "environment": {**member_document("environment", environment.model), **beside},
        "realtime": plain(config.realtime),
    }
    hands = {name: _hand_document(hand) for name, hand in config.hands.items()}
    document |= hands.get(HAND, {HANDS: hands})
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


def _hand_document(hand: HandConfig) -> Document:
    device, operator = hand.device, hand.operator
    document: Document = {
        "device": {**member_document("device", device.model), **plain(device.servo)},
        "controller": member_document("controller", hand.controller),
        "links": {topic: plain(impairment) for topic, impairment in hand.links.items()},
    }
    if operator is not None:
        document["operator"] = member_document("operator", operator)
    if hand.remote is not None:
        document["remote"] = plain(hand.remote)
    return document


def run_document(config: GraphConfig) -> Document:
    """Return the document for the processes of a run: with facts of the devices."""
    facts = {name: plain(hand.device.facts) for name, hand in config.hands.items()}
    return {**to_document(config), FACTS: facts}


def kind_of(section: str, member: object) -> str:
    """Return the ``kind`` that a launch file gives to ``member``; ConfigError if it has none."""
    kind = KINDS[section].kind_of(type(member))
    if kind is None:
        raise ConfigError(
            f"no kind of {section} is a {type(member).__name__}: keep the class in a file and name"
            " it in a launch file, kind: my_file.py"
        )
    return kind


def member_document(section: str, member: object) -> Document:
    """Return kind and parameters of a member of a section, in plain JSON types."""
    if isinstance(member, PartSpec):
        return {"kind": member.kind, **member.values}
    return {"kind": kind_of(section, member), **plain(member)}


def check_plain(part: Any) -> None:
    """Raise ConfigError if JSON has no type or value for a parameter of a part."""
    for name, value in plain(part).items():
        try:
            json.dumps(value, allow_nan=False)
        except (TypeError, ValueError) as error:
            raise ConfigError(f"{name} cannot be written down: {error}") from None


def restore(document: Document) -> GraphConfig:
    """Return the configuration of an unchanged document, its parts as :class:`PartSpec`.

    :func:`forcebound.graph.loader.from_document` checks one that may have been changed.

    Raises:
        ConfigError: If it is no such document, or a file that it names is gone.
    """
    with _refusing("this is no resolved launch document"):
        return _graph(document)


def made(section: str, part: Any) -> Any:
    """Return a part, made if it is a :class:`PartSpec`; ConfigError if it cannot be."""
    if not isinstance(part, PartSpec):
        return part
    with _refusing(f"the {section} {part.kind} cannot be made"):
        return _restored(KINDS[section][part.kind], part.values)


def with_parts(config: GraphConfig, of_users: bool = True) -> GraphConfig:
    """Return the configuration with its parts made; ``of_users``: also those of others' code."""

    def part(section: str, one: Any) -> Any:
        is_foreign = isinstance(one, PartSpec) and not KINDS[section].is_shipped(one.kind)
        return one if is_foreign and not of_users else made(section, one)

    hands = {
        name: replace(
            hand,
            device=replace(hand.device, model=part("device", hand.device.model)),
            operator=part("operator", hand.operator),
            controller=part("controller", hand.controller),
        )
        for name, hand in config.hands.items()
    }
    model = part("environment", config.environment.model)
    return replace(config, hands=hands, environment=replace(config.environment, model=model))


def with_parameters(config: GraphConfig, settings: Parameters) -> GraphConfig:
    """Return the configuration with other parameters: plain JSON values, checked before, by name.

    Its environment is a :class:`PartSpec` if a parameter of it changes. ConfigError if there is no
    such parameter, or a file that one names is gone.
    """
    document, names = to_document(config), list(map(ParameterName.parse, settings))
    with _refusing("these are no parameters of this graph"):
        for name, value in zip(names, settings.values(), strict=True):
            name.put(document, value)
        changed = _graph(document)
    has_environment = any(name.section == "environment" for name in names)
    hands = {}
    for each, hand in config.hands.items():
        new = changed.hands[each]
        device = replace(hand.device, servo=new.device.servo)
        hands[each] = replace(hand, device=device, links=new.links)
    return replace(
        config,
        hands=hands,
        environment=changed.environment if has_environment else config.environment,
    )


@contextmanager
def _refusing(words: str) -> Iterator[None]:
    """Turn what the values of a document raise into a ConfigError."""
    try:
        yield
    except ConfigError as error:
        raise ConfigError(f"{words}: {error}", field=error.field) from error
    except (KeyError, TypeError, AttributeError) as error:
        raise ConfigError(f"{words}: {error!r}") from error


def _graph(document: Document) -> GraphConfig:
    facts, environment = document.get(FACTS), document["environment"]
    return GraphConfig(
        description=document["description"],
        seed=document["seed"],
        duration=float(document["duration"]),
        hands={
            name: _hand(hand, facts and facts[name])
            for name, hand in hand_sections(document).items()
        },
        environment=EnvironmentConfig(
            _spec("environment", environment),
            **_values(EnvironmentConfig, environment, BESIDE_MODEL),
        ),
        realtime=_restored(RealtimeConfig, document["realtime"]),
        phases=tuple(
            Phase(phase["name"], float(phase["duration"]), phase["set"])
            for phase in document.get("phases", ())
        ),
        here=tuple(document[HERE]) if HERE in document else None,
        units=document.get("units", {}),
    )


def _hand(document: Document, facts: Document | None) -> HandConfig:
    device, operator, remote = document["device"], document.get("operator"), document.get("remote")
    stated = None if facts is None else _restored(DeviceFacts, facts)
    return HandConfig(
        DeviceConfig(_spec("device", device), _restored(ServoSettings, device), stated),
        None if operator is None else _spec("operator", operator),
        _spec("controller", document["controller"]),
        {topic: _restored(Impairment, link) for topic, link in document["links"].items()},
        None if remote is None else _restored(RemoteConfig, remote),
    )


def _spec(section: str, document: Document) -> Any:
    """The part of a section; as a configuration has it, so of any type."""
    settings = {"device": fields_of(ServoSettings), "environment": BESIDE_MODEL}.get(section, ())
    values = {n: v for n, v in document.items() if n != "kind" and n not in settings}
    return PartSpec(document["kind"], values)


def _restored(kind: type, document: Document) -> Any:
    """A dataclass with its values in a document."""
    return kind(**_values(kind, document))


def _values(kind: type, document: Document, names: tuple[str, ...] | None = None) -> Document:
    return {
        field.name: read_as(field.hint, from_plain(document[field.name], kind.__name__), field.name)
        for field in fields_of(kind, names).values()
        if field.required or field.name in document  # a recording may be older than a setting
    }
