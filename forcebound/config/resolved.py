"""The resolved launch document: a configuration as plain JSON in SI units, and back.

It is itself a launch file, without arguments and with every value written out. Node processes read
it with :func:`restore`, which checks nothing again; every recording holds it.
"""

import dataclasses
import json
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

import msgspec

from forcebound.config.fields import adapter, fields_of
from forcebound.config.graph import (
    COMPUTATION,
    FORMAT,
    KINDS,
    ControllerConfig,
    DeviceConfig,
    EnvironmentConfig,
    GraphConfig,
    Phase,
    RealtimeConfig,
    RemoteConfig,
)
from forcebound.errors import ConfigError
from forcebound.network.impairment import Impairment
from forcebound.nodes.device import ServoSettings

ALL_CODE = frozenset(KINDS)

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
        "controller": member_document("controller", config.controller.model),
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
    computation = {name: _json(getattr(environment, name)) for name in COMPUTATION}
    return {**member_document("environment", environment.model), **computation}


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


def plain(member: Any) -> dict[str, Any]:
    """Return the fields of a dataclass that a launch file can set, as plain JSON types."""
    fields = [field.name for field in dataclasses.fields(member) if field.init]
    return {name: _json(getattr(member, name)) for name in fields}


def _json(value: Any) -> Any:
    if isinstance(value, tuple):
        return [_json(entry) for entry in value]
    if dataclasses.is_dataclass(value):
        return plain(value)
    return str(value) if isinstance(value, Path) else value


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
        return _graph(without_code(document, runs))
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
    links, environment = dict(config.links), config.environment
    new: dict[str, dict[str, Any]] = {}
    for name, value in settings.items():
        place, _, entry = name.rpartition(".")
        new.setdefault(place, {})[entry] = value
    try:
        for place, entries in new.items():
            if place == "environment":
                environment = _environment(environment_document(environment) | entries)
            else:
                topic = place.removeprefix("links.")
                link = plain(links.get(topic, Impairment())) | entries
                links[topic] = _restored(Impairment, link)
    except (KeyError, TypeError, AttributeError, msgspec.ValidationError) as error:
        raise ConfigError(f"these are no parameters of this graph: {error!r}") from error
    return dataclasses.replace(config, links=links, environment=environment)


def _graph(document: Mapping[str, Any]) -> GraphConfig:
    device = document["device"]
    remote = document.get("remote")
    return GraphConfig(
        description=document["description"],
        seed=document["seed"],
        duration=float(document["duration"]),
        device=DeviceConfig(_part("device", device), _restored(ServoSettings, device)),
        operator=_part("operator", document["operator"]) if "operator" in document else None,
        controller=ControllerConfig(_part("controller", document["controller"])),
        environment=_environment(document["environment"]),
        links={topic: _restored(Impairment, link) for topic, link in document["links"].items()},
        realtime=_restored(RealtimeConfig, document["realtime"]),
        remote=None if remote is None else _restored(RemoteConfig, remote),
        phases=tuple(
            Phase(phase["name"], float(phase["duration"]), phase["set"])
            for phase in document.get("phases", ())
        ),
    )


def _environment(document: Mapping[str, Any]) -> EnvironmentConfig:
    computation = _values(EnvironmentConfig, document, COMPUTATION)
    return EnvironmentConfig(_part("environment", document), **computation)


def _part(section: str, document: Mapping[str, Any]) -> Any:
    """The model that a section names."""
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


def without_code(document: Mapping[str, Any], runs: Collection[str]) -> Mapping[str, Any]:
    """Return a document with shipped parts in place of others, but in sections in ``runs``."""
    changed = dict(document)
    for section, table in KINDS.items():
        given = document.get(section)
        if section in runs or given is None or table.is_shipped(given["kind"]):
            continue
        if section == "operator":
            del changed[section]
            continue
        changed[section] = _stand_in(section, given)
        if section == "environment":
            changed["phases"] = [
                {**phase, "set": {n: v for n, v in phase["set"].items() if not _is_of_model(n)}}
                for phase in document.get("phases", ())
            ]
    return changed


def _stand_in(section: str, document: Mapping[str, Any]) -> dict[str, Any]:
    """A shipped part, with what of the section does not concern its kind."""
    if section == "controller":
        return member_document(section, KINDS[section]["direct"]())
    if section == "environment":
        kept = {name: document[name] for name in COMPUTATION}
        return {**member_document(section, KINDS[section]["wall"]()), **kept}
    device = KINDS[section]["phantom_premium_1_5"](axes=document.get("axes", 1))
    kept = {name: document[name] for name in fields_of(ServoSettings)}
    return {**member_document(section, device), **kept}


def _is_of_model(name: str) -> bool:
    section, _, entry = name.partition(".")
    return section == "environment" and entry not in COMPUTATION
