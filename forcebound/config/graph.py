"""What a launch file says, resolved: frozen dataclasses in SI units.

:mod:`forcebound.config.loader` makes them from launch files; :func:`to_document` gives them back as
plain JSON, which is itself a launch file: without arguments, everything said, all in SI units.
Node processes read it, and every recording holds it.
"""

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

from forcebound.bounding import LAWS
from forcebound.controllers import CONTROLLERS, ControllerModel
from forcebound.devices import DEVICES, DeviceModel
from forcebound.environments import ENVIRONMENTS, EnvironmentModel
from forcebound.errors import ConfigError
from forcebound.network.ends import RemoteSection
from forcebound.network.impairment import Impairment, check_delay
from forcebound.nodes.device import ServoSettings
from forcebound.operators import OPERATORS, Operator
from forcebound.parts import Table
from forcebound.quantities import NOT_NEGATIVE, POSITIVE, Ratio, Time

FORMAT = 1  # version of the launch file format: the value of the key "forcebound"

# Section -> name of a kind -> dataclass of its parameters.
KINDS: Mapping[str, Table[Any]] = {
    "device": DEVICES,
    "operator": OPERATORS,
    "controller": CONTROLLERS,
    "environment": ENVIRONMENTS,
}

RUN_KEYS = ("description", "seed", "duration")  # fields of GraphConfig that are no sections

__all__ = [
    "COMPUTATION",
    "FORMAT",
    "KINDS",
    "LAWS",
    "RUN_KEYS",
    "ControllerConfig",
    "DeviceConfig",
    "EnvironmentConfig",
    "GraphConfig",
    "RealtimeConfig",
    "kind_of",
    "member_document",
    "plain",
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

    model: ControllerModel


@dataclass(frozen=True)
class EnvironmentConfig:
    """The virtual environment, and the time that it computes on top of what its code needs.

    Raises:
        ConfigError: If the settings of that time do not go together or a file cannot be read.
    """

    model: EnvironmentModel
    compute_delay: Annotated[Time, NOT_NEGATIVE] = 0.0  # s
    compute_jitter: Annotated[Time, NOT_NEGATIVE] = 0.0  # s; all as the delay of a link
    compute_distribution: Literal["uniform", "normal", "pareto", "paretonormal"] = "uniform"
    compute_correlation: Ratio = 0.0
    compute_distribution_file: Path | None = None
    compute_trace: Path | None = None

    def __post_init__(self) -> None:
        check_delay(self, "compute_")

    @property
    def computation(self) -> Impairment:
        """The time that it computes, in the words of a link."""
        settings = {name.removeprefix("compute_"): getattr(self, name) for name in COMPUTATION}
        return Impairment(**settings)


# Settings of the time that an environment computes: they stand beside those of its model.
COMPUTATION = tuple(
    field.name for field in dataclasses.fields(EnvironmentConfig) if field.name != "model"
)


@dataclass(frozen=True)
class RealtimeConfig:
    """How punctual the processes of a live run are asked to be; see :mod:`forcebound.realtime`."""

    policy: Literal["fifo", "other"] = "fifo"
    cores: Literal["auto", "none"] | Annotated[int, NOT_NEGATIVE] = "auto"  # of the chain of nodes
    lock_memory: bool = True
    spin: Annotated[Time, NOT_NEGATIVE] = 30e-6  # s before an instant that sleep turns to spinning


@dataclass(frozen=True)
class RemoteConfig(RemoteSection):
    """An environment on another machine: where the two meet, and who may; see docs/remote.md."""

    local: bool = False  # whether the launcher starts the environment here, too


@dataclass(frozen=True)
class Phase:
    """A part of a scripted run; see :mod:`forcebound.config.phases`."""

    name: str
    duration: float  # s
    settings: Mapping[str, Any]  # by name of a parameter, plain JSON values in SI units


@dataclass(frozen=True)
class GraphConfig:
    """Everything that a run is made of."""

    seed: Annotated[int, NOT_NEGATIVE]
    duration: Annotated[Time, POSITIVE]  # s from the moment when the force engages
    device: DeviceConfig
    operator: Operator | None  # None: nobody holds the device
    environment: EnvironmentConfig
    controller: ControllerConfig
    description: str = ""
    links: Mapping[str, Impairment] = field(default_factory=dict)  # by topic; not named: perfect
    realtime: RealtimeConfig = field(default_factory=RealtimeConfig)
    remote: RemoteConfig | None = None
    phases: tuple[Phase, ...] = ()  # one after the other, from the moment when the force engages


def to_document(config: GraphConfig) -> dict[str, Any]:
    """Return the configuration as a launch file of plain JSON types in SI units.

    :func:`forcebound.config.loader.from_document` reads it back to an equal configuration.
    """
    device, environment = config.device, config.environment
    document: dict[str, Any] = {
        "forcebound": FORMAT,
        "description": config.description,
        "seed": config.seed,
        "duration": config.duration,
        "device": {**member_document("device", device.model), **plain(device.servo)},
        "controller": member_document("controller", config.controller.model),
        "environment": {
            **member_document("environment", environment.model),
            **{name: _json(getattr(environment, name)) for name in COMPUTATION},
        },
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
    return {
        field.name: _json(getattr(member, field.name))
        for field in dataclasses.fields(member)
        if field.init
    }


def _json(value: Any) -> Any:
    if isinstance(value, tuple):
        return [_json(entry) for entry in value]
    if dataclasses.is_dataclass(value):
        return plain(value)
    return str(value) if isinstance(value, Path) else value
