"""What a launch file says, resolved: frozen dataclasses in SI units.

:mod:`forcebound.launch.loader` makes them from launch files; :func:`to_document` gives them back as
plain JSON, which is itself a launch file: without arguments, everything said, all in SI units.
Node processes read it, and every recording holds it.
"""

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

from forcebound.bounding import LAWS
from forcebound.devices import DEVICES, DeviceModel
from forcebound.environments import ENVIRONMENTS, Environment
from forcebound.errors import ConfigError
from forcebound.launch import own
from forcebound.messages.packets import TOPICS
from forcebound.network.impairment import Impairment
from forcebound.nodes.controller import CONTROLLERS, Controller
from forcebound.nodes.device import ServoSettings
from forcebound.operators import OPERATORS, Operator
from forcebound.quantities import NOT_NEGATIVE, POSITIVE, Time

FORMAT = 1  # version of the launch file format: the value of the key "forcebound"

# Section -> name of a kind -> dataclass of its parameters.
KINDS: dict[str, Mapping[str, type]] = {
    "device": DEVICES,
    "operator": OPERATORS,
    "controller": CONTROLLERS,
    "environment": ENVIRONMENTS,
}

# Topics whose link can be impaired. Telemetry is for looking on: nothing in the loop waits for it.
LINKS = tuple(topic for topic in TOPICS if topic != "telemetry")

__all__ = [
    "FORMAT",
    "KINDS",
    "LAWS",
    "LINKS",
    "ControllerConfig",
    "DeviceConfig",
    "EnvironmentConfig",
    "GraphConfig",
    "RealtimeConfig",
    "kind_of",
    "member_document",
    "to_document",
]


@dataclass(frozen=True)
class DeviceConfig:
    """The device, and how its servo runs."""

    model: DeviceModel
    servo: ServoSettings


@dataclass(frozen=True)
class ControllerConfig:
    """What connects device and environment."""

    model: Controller


@dataclass(frozen=True)
class EnvironmentConfig:
    """The virtual environment."""

    model: Environment
    compute_delay: Annotated[Time, NOT_NEGATIVE] = 0.0  # s, on top of what its code needs


@dataclass(frozen=True)
class RealtimeConfig:
    """How punctual the processes of a live run are asked to be; see :mod:`forcebound.realtime`."""

    policy: Literal["fifo", "other"] = "fifo"
    cores: Literal["auto", "none"] | Annotated[int, NOT_NEGATIVE] = "auto"  # of the chain of nodes
    lock_memory: bool = True
    spin: Annotated[Time, NOT_NEGATIVE] = 30e-6  # s before an instant that sleep turns to spinning


@dataclass(frozen=True)
class GraphConfig:
    """Everything that a run is made of."""

    seed: Annotated[int, NOT_NEGATIVE]
    duration: Annotated[Time, POSITIVE]  # s from the moment when the force engages
    device: DeviceConfig
    operator: Operator
    environment: EnvironmentConfig
    controller: ControllerConfig
    description: str = ""
    links: Mapping[str, Impairment] = field(default_factory=dict)  # by topic; not named: perfect
    realtime: RealtimeConfig = field(default_factory=RealtimeConfig)


def to_document(config: GraphConfig) -> dict[str, Any]:
    """Return the configuration as a launch file of plain JSON types in SI units.

    :func:`forcebound.launch.loader.from_document` reads it back to an equal configuration.
    """
    device, environment = config.device, config.environment
    return {
        "forcebound": FORMAT,
        "description": config.description,
        "seed": config.seed,
        "duration": config.duration,
        "device": {**member_document("device", device.model), **_plain(device.servo)},
        "operator": member_document("operator", config.operator),
        "controller": member_document("controller", config.controller.model),
        "environment": {
            **member_document("environment", environment.model),
            "compute_delay": environment.compute_delay,
        },
        "links": {topic: _plain(impairment) for topic, impairment in config.links.items()},
        "realtime": _plain(config.realtime),
    }


def kind_of(section: str, member: object) -> str:
    """Return the ``kind`` that a launch file gives to ``member`` of a section.

    Raises:
        ConfigError: If it has none: it was made by a class that no launch file can name.
    """
    for name, kind in KINDS[section].items():
        if kind is type(member):
            return name
    own_kind = own.kind_of(type(member))
    if own_kind is None:
        raise ConfigError(
            f"no kind of {section} is a {type(member).__name__}: keep the class in a file and name"
            " it in a launch file, kind: my_file.py"
        )
    return own_kind


def member_document(section: str, member: object) -> dict[str, Any]:
    """Return kind and parameters of a member of a section, in plain JSON types."""
    return {"kind": kind_of(section, member), **_plain(member)}


def _plain(member: Any) -> dict[str, Any]:
    """The fields of a dataclass that a launch file can set."""
    return {
        field.name: _json(getattr(member, field.name))
        for field in dataclasses.fields(member)
        if field.init
    }


def _json(value: Any) -> Any:
    if isinstance(value, tuple):
        return [_json(entry) for entry in value]
    if dataclasses.is_dataclass(value):
        return _plain(value)
    return str(value) if isinstance(value, Path) else value
