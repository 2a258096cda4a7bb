"""The configuration of a graph: frozen dataclasses in SI units.

:mod:`forcebound.graph.loader` makes it from launch files, :mod:`forcebound.graph.resolved` writes
it as plain JSON and reads that back.
"""

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated, Any, Literal

from forcebound.axes import Axis, lengths
from forcebound.errors import ConfigError
from forcebound.graph.fields import Field, fields_of
from forcebound.graph.names import text_of
from forcebound.graph.servo import ServoSettings, dissipation_of
from forcebound.haptics.controllers import CONTROLLERS, ControllerModel
from forcebound.haptics.devices import DEVICES, DeviceModel
from forcebound.haptics.environments import ENVIRONMENTS, EnvironmentModel
from forcebound.haptics.environments.fixtures import Fixtures, WithFixtures
from forcebound.haptics.hands import OPERATORS, Operator
from forcebound.haptics.laws import Dissipation
from forcebound.haptics.parts import Table
from forcebound.messages.control import Parameters
from forcebound.messages.topology import HAND, HERE, Document, Graph, graph_of, hand_values
from forcebound.network.ends import RemoteSection
from forcebound.network.impairment import Impairment
from forcebound.quantities import NOT_NEGATIVE, POSITIVE, PROBABILITY, Ratio, Time, check_ranges

FORMAT = 1  # version of the launch file format: the value of the key "forcebound"

# Section -> name of a kind -> dataclass of its parameters.
KINDS: Mapping[str, Table[Any]] = {
    "device": DEVICES,
    "operator": OPERATORS,
    "controller": CONTROLLERS,
    "environment": ENVIRONMENTS,
}

#: Words of a link in which an environment gives the time that it computes: compute_delay.
COMPUTATION = ("delay", "jitter", "distribution", "correlation", "trace")


@dataclass(frozen=True)
class PartSpec:
    """A part that is not made here: only the process that runs it does."""

    kind: str  # of its section's table
    values: Document  # its parameters, plain JSON values in SI units


@dataclass(frozen=True)
class DeviceFacts:
    """Numbers of a device for the processes that do not make it."""

    axes: int
    dissipation: Dissipation
    workspace: tuple[float, ...] | None  # m, edges; None: not stated

    @classmethod
    def of(cls, model: DeviceModel, servo: ServoSettings) -> "DeviceFacts":
        """Return those of a device at the rate of its servo."""
        return cls(model.axes, dissipation_of(model, servo), model.workspace)


@dataclass(frozen=True)
class EnvironmentConfig:
    """The virtual environment, and the time that it computes on top of what its code needs.

    Attributes:
        compute_delay: Time for an answer, during which it answers nothing else.
        compute_jitter: Scale of the deviation from it, as of a link's delay.
        compute_distribution: Of the deviation.
        compute_correlation: Of a time with the one before.
        compute_trace: File of recorded times, instead of delay and jitter.
        fixtures: Guidance and limits beside the environment; null: none.

    Raises:
        ConfigError: If the settings of that time do not go together or a file cannot be read.
    """

    model: EnvironmentModel
    compute_delay: Annotated[Time, NOT_NEGATIVE] = 0.0
    compute_jitter: Annotated[Time, NOT_NEGATIVE] = 0.0
    compute_distribution: Literal["uniform", "normal", "pareto", "paretonormal"] = "uniform"
    compute_correlation: Annotated[Ratio, PROBABILITY] = 0.0
    compute_trace: Path | None = None
    fixtures: Fixtures | None = None

    def __post_init__(self) -> None:
        check_ranges(self)
        try:
            _ = self.computation
        except ConfigError as error:
            name = f"compute_{error.field}"
            raise ConfigError(f"compute_{error}", field=name) from None

    @property
    def computation(self) -> Impairment:
        """The time that it computes, in the words of a link."""
        values = {name: getattr(self, f"compute_{name}") for name in COMPUTATION}
        return Impairment(**values)

    @property
    def served(self) -> EnvironmentModel:
        """The model, with its fixtures."""
        return self.model if self.fixtures is None else WithFixtures(self.model, self.fixtures)


#: Section of a part -> keys that are settings of the section, and not of the part.
SECTION_SETTINGS: Mapping[str, Mapping[str, Field]] = {
    "device": fields_of(ServoSettings),
    "environment": {n: f for n, f in fields_of(EnvironmentConfig).items() if n != "model"},
}


@dataclass(frozen=True)
class RealtimeConfig:
    """Scheduling of the processes of a live run; see :mod:`forcebound.realtime`.

    Attributes:
        policy: Scheduling class: ``fifo`` goes before ordinary processes.
        cores: Core of the chain of nodes: one that is chosen, and others for further hands; none in
            particular; or its number, for the nodes of all hands.
        lock_memory: Whether no page of memory may be moved to disk.
        deep_sleep: Whether idle processors may sleep deeply; false costs energy.
        spin: Time before an instant at which sleeping turns into spinning.
    """

    policy: Literal["fifo", "other"] = "fifo"
    cores: Literal["auto", "none"] | Annotated[int, NOT_NEGATIVE] = "auto"
    lock_memory: bool = True
    deep_sleep: bool = True
    spin: Annotated[Time, NOT_NEGATIVE] = 30e-6


@dataclass(frozen=True)
class RemoteConfig(RemoteSection):
    """An environment on another machine: where the two meet, and who may; see docs/remote.md.

    Attributes:
        local: Whether the launcher starts the environment here, too.
    """

    local: bool = False


@dataclass(frozen=True)
class Phase:
    """A part of a scripted run; see :mod:`forcebound.graph.phases`.

    Attributes:
        name: For events, tables and plots.
        duration: The next phase begins then.
        settings: Parameters that differ from those of the launch file.
    """

    name: str
    duration: Annotated[Time, POSITIVE]
    settings: Parameters = field(default_factory=dict)


PHASE_KEYS = ("name", "duration")  # fields of Phase that a launch file gives as they are


@dataclass(frozen=True)
class HandConfig:
    """One hand's loop: what it holds, who holds it, what answers it, and the links in between.

    Attributes:
        device: What it holds.
        servo: How the device's node runs, and which law bounds the force.
        operator: Who holds the device; None: nobody.
        controller: What makes queries of readings, and forces of answers.
        links: Impairments by topic; a topic that is not named has a perfect link.
        remote: Where it meets its environment; None: on this machine.
        stated: Numbers of a device that this process does not make.
        seen: Axes of such a device, unless they are lengths without names.
    """

    device: DeviceModel
    servo: ServoSettings = field(default_factory=ServoSettings)
    operator: Operator | None = None
    controller: ControllerModel = field(default_factory=lambda: CONTROLLERS["direct"]())
    links: Mapping[str, Impairment] = field(default_factory=dict)
    remote: RemoteConfig | None = None
    stated: DeviceFacts | None = field(default=None, compare=False)
    seen: tuple[Axis, ...] = field(default=(), compare=False)

    @property
    def named_axes(self) -> tuple[Axis, ...]:
        """Axes that environment and results see; none if they are lengths, of unknown number."""
        if isinstance(self.device, DeviceModel):
            return self.device.named_axes
        return self.seen or lengths(0 if self.stated is None else self.stated.axes)

    @property
    def axes(self) -> int:
        """Number of axes."""
        return self.device.axes if self.stated is None else self.stated.axes

    @property
    def facts(self) -> DeviceFacts:
        """Numbers of the device, for processes that do not make it."""
        return self.stated or DeviceFacts.of(self.device, self.servo)


@dataclass(frozen=True)
class GraphConfig:
    """Everything that a run is made of; each part an object, or the :class:`PartSpec` of one.

    Attributes:
        description: In a sentence.
        seed: Of everything random.
        duration: From the moment when the force engages; with phases, theirs together.
        hands: By name; that of a file without a section ``hands`` is called ``hand``.
        phases: One after the other, from the moment when the force engages.
        here: Names of the hands on this machine, as `launch --hand` sets it; null: all.
        units: In which quantities were written, by the name of the parameter; for people.

    Raises:
        ConfigError: With all that does not go together, as of a launch file.
    """

    seed: Annotated[int, NOT_NEGATIVE]
    duration: Annotated[Time, POSITIVE]
    hands: Mapping[str, HandConfig]
    environment: EnvironmentConfig
    description: str = ""
    realtime: RealtimeConfig = field(default_factory=RealtimeConfig)
    phases: tuple[Phase, ...] = ()
    here: tuple[str, ...] | None = None
    units: Mapping[str, str] = field(default_factory=dict, compare=False)

    def __post_init__(self) -> None:
        if isinstance(self.environment, EnvironmentModel):
            object.__setattr__(self, "environment", EnvironmentConfig(self.environment))
        from forcebound.graph.objects import check  # which knows these classes

        check(self)
        for name in self.here or ():
            if name not in self.hands:
                known = ", ".join(self.hands)
                raise ConfigError(f"no hand {name!r}; the hands are: {known}", field=HERE)
        for name, hand in self.hands_here.items():
            partner = hand.servo.energy_partner
            if partner in self.hands and partner not in self.hands_here:
                remote = hand.remote or self.hands[partner].remote
                if remote is None or remote.local:
                    message = (
                        f"{name} exchanges energy with {partner}, on another machine: expected a"
                        f" section remote, without local: true, of {name} or {partner}"
                    )
                    raise ConfigError(message, field=HERE)

    if TYPE_CHECKING:

        def __init__(
            self,
            seed: int,
            duration: float,
            hands: Mapping[str, HandConfig],
            environment: EnvironmentConfig | EnvironmentModel,
            description: str = "",
            realtime: RealtimeConfig = RealtimeConfig(),
            phases: tuple[Phase, ...] = (),
            here: tuple[str, ...] | None = None,
            units: Mapping[str, str] = MappingProxyType({}),
        ) -> None: ...

    @classmethod
    def read(cls, file: str | Path, **arguments: object) -> "GraphConfig":
        """Return the graph of a launch file, or of one that comes with forcebound: "stiff_wall".

        Args:
            file: Its path or name.
            arguments: Values for the file's arguments: text with its unit, or a number in SI units.

        Raises:
            ConfigError: With every problem of the file and its place.
        """
        from forcebound.graph.loader import load  # which makes this class

        return load(file, [f"{name}:={text_of(value)}" for name, value in arguments.items()])

    def yaml(self) -> str:
        """Return the graph as the text of a launch file, without what has its default."""
        from forcebound.graph.resolved import to_yaml  # which knows this class

        return to_yaml(self)

    @cached_property
    def graph(self) -> Graph:
        """Its nodes and streams, as far as they are on this machine."""
        hands = self.hands
        partners = ((name, hand.servo.energy_partner) for name, hand in hands.items())
        pairs = [(name, partner) for name, partner in partners if name < partner in hands]
        linked = [name for name, hand in hands.items() if hand.remote is not None]
        return graph_of(tuple(hands), self.here, self.has_environment, pairs, linked)

    @property
    def hands_here(self) -> Mapping[str, HandConfig]:
        """The hands on this machine."""
        here = self.hands if self.here is None else self.here
        return {name: hand for name, hand in self.hands.items() if name in here}

    @property
    def has_environment(self) -> bool:
        """True if a launcher starts the environment on this machine."""
        remotes = [hand.remote for hand in self.hands_here.values()]
        return any(remote is None or remote.local for remote in remotes)

    @property
    def served_elsewhere(self) -> Mapping[str, RemoteConfig]:
        """Ends of the environment on this machine for hands of other machines, by hand."""
        if not self.has_environment:
            return {}
        return {
            name: hand.remote
            for name, hand in self.hands.items()
            if name not in self.hands_here and hand.remote is not None
        }

    @property
    def only(self) -> HandConfig:
        """The only hand; ConfigError if there are several."""
        if len(self.hands) > 1:
            raise ConfigError(f"which hand? This graph has {', '.join(self.hands)}")
        return next(iter(self.hands.values()))

    def on_one_machine(self) -> "GraphConfig":
        """Return the configuration with all hands on this machine, as in virtual time."""
        return self if self.here is None else dataclasses.replace(self, here=None)

    def of(self, hand: str) -> "GraphConfig":
        """Return the configuration with this hand alone, as its only one; KeyError if unknown."""
        phases = tuple(
            dataclasses.replace(phase, settings=hand_values(phase.settings, hand, self.hands))
            for phase in self.phases
        )
        hands, units = {HAND: self.hands[hand]}, hand_values(self.units, hand, self.hands)
        return dataclasses.replace(self, hands=hands, here=None, phases=phases, units=units)

    def with_hand(self, **parts: Any) -> "GraphConfig":
        """Return the configuration with other parts of the only hand."""
        return dataclasses.replace(
            self, hands=dict.fromkeys(self.hands, dataclasses.replace(self.only, **parts))
        )
