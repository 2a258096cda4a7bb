"""Phases: parts of a run, each with parameters of its own.

::

    phases:
      - { name: quiet, duration: 2 s }
      - { name: 20 ms late, duration: 2 s, set: { links.environment_reply.delay: 20 ms } }

The run is as long as its phases; ``duration`` has no meaning then. A phase begins with the
parameters of the launch file, not with those of the phase before, and sets its own; so each can be
read alone. What a phase makes of the launch file is checked as a launch file is, before anything
starts.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Annotated

from forcebound.config.fields import Section, fields_of
from forcebound.config.graph import LAW, GraphConfig, Phase
from forcebound.config.parameters import describe, differences, parameters, unknown_parameter
from forcebound.config.problems import Problems
from forcebound.config.resolved import with_parameters
from forcebound.config.tree import Value
from forcebound.errors import ConfigError
from forcebound.quantities import POSITIVE, Time

KEY = "phases"
MAX_PHASES = 200  # each one is checked as a launch file of its own

_KEEPS_LAW = f"a phase cannot set {LAW}; while the graph runs, `forcebound param set` changes it"


@dataclass(frozen=True)
class PhaseHead:
    """Keys of a phase besides its settings."""

    name: str
    duration: Annotated[Time, POSITIVE]


def read_phases(
    root: Value,
    config: GraphConfig,
    build: Callable[[Value, Problems], GraphConfig],
    problems: Problems,
) -> tuple[Phase, ...]:
    """Return the phases of a launch file; what is wrong is added to ``problems``.

    Args:
        root: The launch file.
        config: Configuration without phases.
        build: Reads a launch file; raises ConfigError with the problems noted.
        problems: Of the launch file.
    """
    listed = root.entries[KEY]
    entries = listed.content if isinstance(listed.content, tuple) else ()
    if not entries and not listed.is_broken:
        problems.add(f"phases must be a list of mappings, got {listed}", listed.place)
    if len(entries) > MAX_PHASES:
        problems.add(f"{len(entries)} phases; at most {MAX_PHASES} make one run", listed.place)
        entries = ()
    plain = {name: value for name, value in root.entries.items() if name != KEY}
    plain.setdefault("duration", Value(1.0, root.place))  # that of a phase is its own
    phases: list[Phase] = []
    for number, value in enumerate(entries, start=1):
        section = Section(value, f"phase {number}", root, problems)
        if not section.is_readable:
            continue
        section.check_keys(("name", "duration", "set"))
        head = section.read(fields_of(PhaseHead))
        settings = Section(value.entries.get("set"), f"set of phase {number}", value, problems)
        changed = _overlaid(replace(root, content=plain), settings, config)
        if changed is None or head is None:
            continue
        found = Problems()
        try:
            settled = differences(config, build(changed, found))
        except ConfigError:
            problems.extend(found)
        else:
            phases.append(Phase(head["name"], head["duration"], settled))
    return tuple(phases)


def phase_duration(phases: Sequence[Phase]) -> float:
    """Return how long phases take together, in s."""
    return sum(phase.duration for phase in phases)


def _overlaid(root: Value, settings: Section, config: GraphConfig) -> Value | None:
    """The launch file with some parameters at their places; None with problems noted."""
    if not settings.is_readable:
        return None
    known = parameters(config)
    for name, value in settings.value.entries.items():
        if name == LAW or name not in known:
            message = _KEEPS_LAW if name == LAW else unknown_parameter(name, config)
            settings.problems.add(message, value.key or value.place)
            return None
        root = _placed(root, name.split("."), value)
    return root


def _placed(tree: Value, path: Sequence[str], value: Value) -> Value:
    """A tree with ``value`` at ``path``."""
    if not path:
        return value
    inner = tree.entries.get(path[0], Value({}, value.place, value.key))
    return replace(tree, content={**tree.entries, path[0]: _placed(inner, path[1:], value)})


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
        message = f"phase {phase.name}: {describe(phase.settings) or 'as the launch file says'}"
        parts.append(Part(phase.name, start_ns, with_parameters(plain, phase.settings), message))
        start_ns += round(phase.duration * 1e9)
    return parts
