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

from forcebound.errors import ConfigError
from forcebound.graph.graph import GraphConfig, Phase
from forcebound.graph.names import LAW, ParameterName
from forcebound.graph.parameters import describe, differences, parameters, unknown_parameter
from forcebound.graph.problems import Problems
from forcebound.graph.resolved import with_parameters
from forcebound.graph.tree import Value

_KEEPS_LAW = f"a phase cannot set {LAW}; while the graph runs, `forcebound param set` changes it"


def read_phases(
    root: Value,
    heads: Sequence[Phase],
    config: GraphConfig,
    build: Callable[[Value, Problems], GraphConfig],
    problems: Problems,
) -> tuple[Phase, ...]:
    """Return the phases of a launch file ``root``; what is wrong is added to ``problems``.

    ``config`` is its configuration without phases; ``build`` reads a launch file, and raises
    ConfigError with the problems noted.
    """
    listed = root.entries["phases"].content
    assert isinstance(listed, tuple)  # checked with the rest of the file
    plain = root.without("phases")
    plain = plain.with_entries({"duration": Value(1.0, root.place), **plain.entries})
    phases: list[Phase] = []
    for head, value in zip(heads, listed, strict=True):
        changed = _overlaid(plain, value.entries.get("set"), config, problems)
        if changed is None:
            continue
        found = Problems()
        try:
            settled = differences(config, build(changed, found))
        except ConfigError:
            problems.extend(found)
        else:
            phases.append(replace(head, settings=settled))
    return tuple(phases)


def _overlaid(
    root: Value, settings: Value | None, config: GraphConfig, problems: Problems
) -> Value | None:
    """The launch file with some parameters at their places; None with problems noted."""
    known = parameters(config)
    is_known = True
    for name, value in ({} if settings is None else settings.entries).items():
        place = ParameterName.parse(name)
        if place.is_law or name not in known:
            message = _KEEPS_LAW if place.is_law else unknown_parameter(name, config)
            problems.add(message, value.key or value.place)
            is_known = False
        else:
            root = _placed(root, place.path, value)
    return root if is_known else None


def _placed(tree: Value, path: Sequence[str], value: Value) -> Value:
    """A tree with ``value`` at ``path``."""
    if not path:
        return value
    inner = tree.entries.get(path[0], Value({}, value.place, value.key))
    return tree.with_entries({**tree.entries, path[0]: _placed(inner, path[1:], value)})


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
        settings = describe(phase.settings, config.units) or "as the launch file says"
        message = f"phase {phase.name}: {settings}"
        parts.append(Part(phase.name, start_ns, with_parameters(plain, phase.settings), message))
        start_ns += round(phase.duration * 1e9)
    return parts
