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

from dataclasses import dataclass, replace

from forcebound.errors import ConfigError
from forcebound.graph.graph import GraphConfig, Phase
from forcebound.graph.names import LAW, ParameterName
from forcebound.graph.parameters import (
    describe,
    differences,
    parameters,
    spelled_out,
    unknown_parameter,
    with_written,
)
from forcebound.graph.problems import Problems
from forcebound.graph.tree import Value, from_plain
from forcebound.messages.control import Parameters

_KEEPS_LAW = f"a phase cannot set {LAW}; while the graph runs, `forcebound param set` changes it"


def read_phases(root: Value, config: GraphConfig, problems: Problems) -> GraphConfig:
    """Return a configuration with the settings of its phases; what is wrong is noted.

    ``root`` is its launch file.
    """
    listed = root.entries["phases"].content
    assert isinstance(listed, tuple)  # checked with the rest of the file
    first, known = replace(config, phases=()), parameters(config)
    phases: list[Phase] = []
    for phase, written in zip(config.phases, listed, strict=True):
        settings = written.entries.get("set", Value({}, written.place, written.key))
        try:
            settings = _with_presets(settings)
        except ConfigError as error:
            problems.add(str(error), settings.key or settings.place)
            continue
        _check_names(settings, known, config, problems)
        named = {name: one for name, one in settings.entries.items() if name in known}
        try:
            changed = with_written(first, named, problems)
        except ConfigError as error:
            problems.add(str(error), settings.key or settings.place)
            continue
        phases.append(replace(phase, settings=differences(first, changed)))
    return replace(config, phases=tuple(phases))


def _with_presets(settings: Value) -> Value:
    """Return settings with the keys of links in place of their named networks."""
    texts = {n: v for n, v in settings.entries.items() if ParameterName.parse(n).is_preset}
    keys = spelled_out({name: value.plain for name, value in texts.items()})
    made = {name: from_plain(one, name, ".") for name, one in keys.items()}
    return settings.with_entries({**made, **settings.without(*texts).entries})


def _check_names(
    settings: Value, known: Parameters, config: GraphConfig, problems: Problems
) -> None:
    """Note names that are no parameters of a phase."""
    for name, value in settings.entries.items():
        if ParameterName.parse(name).is_law:
            problems.add(_KEEPS_LAW, value.key or value.place)
        elif name not in known:
            problems.add(unknown_parameter(name, config), value.key or value.place)


@dataclass(frozen=True)
class ScheduledPhase:
    """A phase of a run with its beginning."""

    name: str
    start_ns: int  # since the force engaged
    values: Parameters  # all that hold in it, but the laws, which stay
    message: str

    @property
    def data(self) -> dict[str, str]:
        """Of the event that reports its beginning."""
        return {"name": self.name}


def timetable(config: GraphConfig) -> list[ScheduledPhase]:
    """Return the phases of a graph with their beginnings."""
    scheduled: list[ScheduledPhase] = []
    first = {n: v for n, v in parameters(config).items() if not ParameterName.parse(n).is_law}
    start_ns = 0
    for phase in config.phases:
        settings = describe(phase.settings, config.units) or "as the launch file says"
        message = f"phase {phase.name}: {settings}"
        scheduled.append(ScheduledPhase(phase.name, start_ns, first | phase.settings, message))
        start_ns += round(phase.duration * 1e9)
    return scheduled
