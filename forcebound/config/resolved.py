"""The resolved launch document: a configuration as plain JSON in SI units, and back.

It is itself a launch file, without arguments and with every value written out. Node processes read
it with :func:`restore`, which checks nothing again; every recording holds it.
"""

import json
from collections.abc import Collection, Mapping
from dataclasses import replace
from typing import Any

import msgspec

from forcebound.config.fields import adapter, fields_of
from forcebound.config.graph import (
    BESIDE_MODEL,
    FORMAT,
    KINDS,
    LAW,
    DeviceConfig,
    EnvironmentConfig,
    GraphConfig,
    Phase,
    RealtimeConfig,
    RemoteConfig,
)
from forcebound.errors import ConfigError
from forcebound.network.impairment import Impairment
from forcebound.nodes.servo import ServoSettings
from forcebound.parts.plain import plain, plain_value

ALL_CODE = frozenset(KINDS)
_STAND_INS = {"controller": "direct", "environment": "wall", "device": "phantom_premium_1_5"}

# Sections whose code a process runs. That of environment and controller must not run beside the
# bounder; the others need the device's number of axes.
CODE_OF_PROCESS: Mapping[str, frozenset[str]] = {
    "device": frozenset({"device", "operator"}),
    "controller": frozenset({"device", "controller"}),
    "environment": frozenset({"device", "environment"}),
    "recorder": frozenset(),
}


def to_document(config: GraphConfig) -> dict[str, Any]:
    """Return the configuration as a launch file of plain JSON types in SI units.

    :func:`restore` reads it back to an equal configuration.
    """
    device = config.device
    document: dict[str, Any] = {
        "forcebound": FORMAT,
        "description": config.description,
        "seed": config.seed,
        "duration": config.duration,
        "device": {**member_document("device", device.model), **plain(device.servo)},
        "controller": member_document("controller", config.controller),
        "environment": environment_document(config.environment),
        "links": {topic: plain(impairment) for topic, impairment in config.links.items()},
        "realtime": plain(config.realtime),
    }
    if config.operator is not None:
        document["operator"] = member_document("operator", config.operator)
    if config.remote is not None:
        document["remote"] = plain(config.remote)
    if config.phases:
        document["phases"] = [
            {"name": phase.name, "duration": phase.duration, "set": dict(phase.settings)}
            for phase in config.phases
        ]
    return document


def environment_document(environment: EnvironmentConfig) -> dict[str, Any]:
    """Return the section of an environment in plain JSON types."""
    beside = {name: plain_value(getattr(environment, name)) for name in BESIDE_MODEL}
    return {**member_document("environment", environment.model), **beside}


def kind_of(section: str, member: object) -> str:
    """Return the ``kind`` that a launch file gives to ``member`` of a section.

    Raises:
        ConfigError: If it has none: it was made by a class that no launch file can name.
    """
    kind = KINDS[section].kind_of(type(member))
    if kind is None:
        raise ConfigError(
            f"no kind of {section} is a {type(member).__name__}: keep the class in a file and name"
            " it in a launch file, kind: my_file.py"
        )
    return kind


def member_document(section: str, member: object) -> dict[str, Any]:
    """Return kind and parameters of a member of a section, in plain JSON types."""
    return {"kind": kind_of(section, member), **plain(member)}


def restore(document: Mapping[str, Any], runs: Collection[str] = ALL_CODE) -> GraphConfig:
    """Return the configuration of a document that :func:`to_document` made.

    Args:
        document: Unchanged; else :func:`forcebound.config.loader.from_document` checks it.
        runs: Sections whose parts' code may run here if it does not ship with forcebound; in the
            others a shipped part takes the place.

    Raises:
        ConfigError: If it is no such document, or a file that it names is gone.
    """
    try:
        return _graph(document, runs)
    except (KeyError, TypeError, AttributeError, msgspec.ValidationError) as error:
        raise ConfigError(f"this is no resolved launch document: {error!r}") from error


def with_parameters(config: GraphConfig, settings: Mapping[str, Any]) -> GraphConfig:
    """Return the configuration with other :func:`~forcebound.config.parameters.parameters`.

    Args:
        config: What has other values.
        settings: By name, plain JSON values in SI units, checked before.

    Raises:
        ConfigError: If there is no such parameter, or a file that one names is gone.
    """
    device, links, environment = config.device, dict(config.links), config.environment
    of_environment = environment_document(environment)
    of_links: dict[str, Any] = {}
    of_servo = plain(device.servo)
    places = {"environment": of_environment, "links": of_links, "device": of_servo}
    try:
        for name, value in settings.items():
            section, *path, entry = name.split(".")
            place = places[section]
            for step in path:
                place = place.setdefault(step, {})
            place[entry] = value
        if LAW in settings:
            device = replace(device, servo=_restored(ServoSettings, of_servo))
        if any(name.startswith("environment.") for name in settings):
            environment = _environment(of_environment)
        for topic, entries in of_links.items():
            link = plain(links.get(topic, Impairment())) | entries
            links[topic] = _restored(Impairment, link)
    except (KeyError, TypeError, AttributeError, msgspec.ValidationError) as error:
        raise ConfigError(f"these are no parameters of this graph: {error!r}") from error
    return replace(config, device=device, links=links, environment=environment)


def _graph(document: Mapping[str, Any], runs: Collection[str]) -> GraphConfig:
    device = document["device"]
    remote = document.get("remote")
    phases = [
        Phase(phase["name"], float(phase["duration"]), phase["set"])
        for phase in document.get("phases", ())
    ]
    if not _is_run("environment", document["environment"], runs):
        phases = [replace(phase, settings=_without_model(phase.settings)) for phase in phases]
    return GraphConfig(
        description=document["description"],
        seed=document["seed"],
        duration=float(document["duration"]),
        device=DeviceConfig(_part("device", device, runs), _restored(ServoSettings, device)),
        operator=_part("operator", document.get("operator"), runs),
        controller=_part("controller", document["controller"], runs),
        environment=_environment(document["environment"], runs),
        links={topic: _restored(Impairment, link) for topic, link in document["links"].items()},
        realtime=_restored(RealtimeConfig, document["realtime"]),
        remote=None if remote is None else _restored(RemoteConfig, remote),
        phases=tuple(phases),
    )


def _environment(
    document: Mapping[str, Any], runs: Collection[str] = ALL_CODE
) -> EnvironmentConfig:
    beside = _values(EnvironmentConfig, document, BESIDE_MODEL)
    return EnvironmentConfig(_part("environment", document, runs), **beside)


def _is_run(section: str, document: Mapping[str, Any], runs: Collection[str]) -> bool:
    """Whether the part of a section is made here, not a shipped one in its place."""
    return section in runs or KINDS[section].is_shipped(document["kind"])


def _without_model(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Parameters without those of the environment's model."""
    kept = {f"environment.{name}" for name in BESIDE_MODEL}
    return {n: v for n, v in settings.items() if n in kept or not n.startswith("environment.")}


def _part(section: str, document: Mapping[str, Any] | None, runs: Collection[str]) -> Any:
    """The model that a section names, or what takes its place; None without a section."""
    if document is None:
        return None
    if not _is_run(section, document, runs):
        if section == "operator":
            return None
        stand_in = KINDS[section][_STAND_INS[section]]
        return stand_in(axes=document.get("axes", 1)) if section == "device" else stand_in()
    kind = document["kind"]
    model = KINDS[section][kind]
    if KINDS[section].is_shipped(kind):
        return _restored(model, document)
    fields = fields_of(model)  # of any type that pydantic knows
    given = json.dumps({name: document[name] for name in fields})
    return model(**adapter(*fields.values()).validate_json(given))


def _restored(kind: type, document: Mapping[str, Any]) -> Any:
    """A dataclass with its values in a document."""
    return kind(**_values(kind, document))


def _path(kind: type, value: Any) -> Any:  # the only type here that JSON does not have
    return kind(value)


def _values(
    kind: type, document: Mapping[str, Any], names: tuple[str, ...] | None = None
) -> dict[str, Any]:
    return {
        field.name: msgspec.convert(document[field.name], field.hint, dec_hook=_path)
        for field in fields_of(kind, names).values()
    }
