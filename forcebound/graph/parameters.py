"""Parameters: the law, and values of links and environment, which can change while a graph runs.

A parameter is named by its place in a launch file: ``device.law``,
``links.environment_query.delay``, ``environment.compute_delay``, ``environment.stiffness``; with
several hands ``left.device.law``.
"""

import difflib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from typing import Any

from forcebound.errors import ConfigError
from forcebound.graph.graph import GraphConfig, PartSpec
from forcebound.graph.model import always, never, read_link, read_section
from forcebound.graph.names import LAW, ParameterName, parameter_name
from forcebound.graph.problems import Problems, shortened, unknown
from forcebound.graph.resolved import environment_document, hand_document, to_document
from forcebound.graph.tree import Value, from_plain
from forcebound.haptics.laws import LAWS
from forcebound.haptics.parts.plain import plain
from forcebound.haptics.parts.user_module import names_file
from forcebound.messages.control import Parameters
from forcebound.messages.topology import (
    IMPAIRABLE,
    LINKS,
    ONE_HAND,
    TRANSFER,
    node_name,
)
from forcebound.network.impairment import Impairment
from forcebound.network.presets import PRESET, named_link
from forcebound.roles import DEVICE, ENVIRONMENT
from forcebound.units import in_unit

PERFECT = Impairment()
SECTIONS = ("links", "environment")  # of a launch file, whose entries are parameters


def parameters(config: GraphConfig) -> Parameters:
    """Return all that can be changed, by name, as plain JSON in SI units."""
    found: Parameters = {}
    for name, hand in config.hands.items():
        found[parameter_name(name, LAW)] = hand.servo.law
        for topic in IMPAIRABLE if hand.servo.energy_partner else LINKS:
            link = plain(hand.links.get(topic, PERFECT))
            found |= {parameter_name(name, f"links.{topic}.{key}"): v for key, v in link.items()}
    environment = environment_document(config.environment)
    del environment["kind"]
    return found | dict(_leaves("environment", environment))


def takeable_laws() -> list[str]:
    """Return the laws that a running device can take: it loads no code from elsewhere."""
    return sorted(law for law in LAWS if LAWS.is_shipped(law))


def _leaves(place: str, section: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    """Names and values of a section and of the sections within it."""
    for name, value in section.items():
        full = f"{place}.{name}"
        yield from _leaves(full, value) if isinstance(value, Mapping) else ((full, value),)


def differences(old: GraphConfig, new: GraphConfig) -> Parameters:
    """Return the parameters of ``new`` that ``old`` does not have with this value."""
    before = parameters(old)
    return {n: v for n, v in parameters(new).items() if n not in before or v != before[n]}


def change(config: GraphConfig, settings: Parameters) -> GraphConfig:
    """Return the configuration with other parameters, as a running graph could have them.

    The new values are by name, in SI units or text with their unit. ConfigError, with every
    problem, if there is no such parameter, or it cannot have this value.
    """
    known, values = parameters(config), {}
    for written, value in spelled_out(settings).items():
        place = ParameterName.parse(written)
        name = str(place)
        if name not in known:
            raise ConfigError(unknown_parameter(written, config))
        if place.is_law:
            check_takeable(name, value, known[name])
        values[name] = value
    return with_values(config, values)


def spelled_out(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Return settings in which the keys of a link stand in place of its named network.

    All of them; what is set beside it wins. ConfigError if there is no such network.
    """
    found: dict[str, Any] = {}
    own: dict[str, Any] = {}
    for name, value in settings.items():
        if ParameterName.parse(name).is_preset:
            found |= {
                f"{name.removesuffix(PRESET)}{key}": one
                for key, one in plain(named_link(str(value))).items()
            }
        else:
            own[name] = value
    return found | own


def with_values(config: GraphConfig, settings: Parameters) -> GraphConfig:
    """Return the configuration with other values of sections, by name, checked as a launch file is.

    ConfigError, with every problem, if one cannot have its value.
    """
    problems = Problems()
    values = {name: from_plain(value, name, ".") for name, value in settings.items()}
    try:
        changed = with_written(config, values, problems)
    except (ValueError, OverflowError, RecursionError, OSError) as error:
        if isinstance(error, ConfigError):
            raise
        words = f"{', '.join(settings)}: it holds what no launch file has: {error}"
        raise ConfigError(words) from error
    problems.raise_if_any()
    return changed


def with_written(
    config: GraphConfig, values: Mapping[str, Value], problems: Problems
) -> GraphConfig:
    """Return the configuration with values of sections as they are written, by name.

    What is wrong with one is noted; ConfigError for what does not go together.
    """
    hands, environment = dict(config.hands), config.environment
    written: dict[tuple[str, tuple[str, ...]], Value] = {}  # sections that change, by hand
    for name, value in values.items():
        place = ParameterName.parse(name)
        is_of_hand = place.hand in hands and (place.section == "device" or bool(place.topic))
        if not is_of_hand and place.section != "environment":
            raise ConfigError(unknown_parameter(name, config))
        section = place.keys[: 2 if place.topic else 1]
        if (place.hand, section) not in written:
            document = environment_document(environment)
            if place.topic:
                document = plain(hands[place.hand].links.get(place.topic, PERFECT))
            elif place.section == "device":
                document = hand_document(hands[place.hand])["device"]
            full = parameter_name(place.hand, ".".join(section))
            written[place.hand, section] = from_plain(document, full, ".")
        before = written[place.hand, section]
        written[place.hand, section] = before.with_entry(place.keys[len(section) :], value)
    axes = next(iter(hands.values())).named_axes  # of all
    for (name, (section_name, *topics)), value in written.items():
        hand = hands[name] if section_name != "environment" else None
        if hand is None:
            makes = never if isinstance(environment.model, PartSpec) else always
            environment = read_section("environment", value, problems, makes, axes) or environment
        elif not topics:
            makes = never if isinstance(hand.device, PartSpec) else always
            hands[name] = replace(hand, **read_section("device", value, problems, makes) or {})
        elif (link := read_link(topics[0], value, problems)) is not None:
            hands[name] = replace(hand, links={**hand.links, topics[0]: link})
    return replace(config, hands=hands, environment=environment)


def check_takeable(name: str, law: Any, present: str) -> None:
    """Raise ConfigError for a law that a running device cannot take, by its parameter's name."""
    if law == present or law in takeable_laws():
        return
    message = unknown("law", str(law), takeable_laws())
    if names_file(str(law)):
        message = "a law of your own needs a launch of its own: law:=FILE.py"
    raise ConfigError(f"{name}: {message}")


def unknown_parameter(name: str, config: GraphConfig) -> str:
    """Return the message for a name that is no parameter: the nearest ones, or why it is none."""
    known = parameters(config)
    if ParameterName.parse(name).hand not in config.hands:
        near = [parameter_name(hand, name) for hand in config.hands]
        near = [full for full in near if full in known and full != name]
        if near:
            return f"whose {name}? It belongs to a hand: {' or '.join(near)}"
    if name not in SECTIONS and _is_fixed(name, config):
        return (
            f"{name} is fixed while a graph runs: change it in the launch file and start again;"
            f" what can be changed is in {_sections()}"
        )
    last = ParameterName.parse(name).last
    near = [full for full in known if ParameterName.parse(full).last == last]
    if not near or name != last:  # else all of that name, of which an argument sets some: delay
        near = difflib.get_close_matches(name, near or known, n=1) or near[:1]
    shown = shortened(name)
    if near:
        return f"unknown parameter {shown!r}; did you mean {' or '.join(map(repr, near))}?"
    return f"unknown parameter {shown!r}; what can be changed is in {_sections()}"


def _is_fixed(name: str, config: GraphConfig) -> bool:
    """Return whether the launch file has such a value or section, which cannot be changed."""
    place = ParameterName.parse(name)
    if place.section in ("operator", "remote", "phases"):  # which a graph need not have
        return True
    found: Any = to_document(config)
    for key in place.path:
        if not isinstance(found, Mapping) or key not in found:
            return False
        found = found[key]
    return True


def _sections() -> str:
    return f"{', '.join((LAW, *(f'links.{topic}' for topic in LINKS)))} and environment"


def node_of(name: str, config: GraphConfig) -> str:
    """Return the node that a parameter belongs to: of a link, the one that receives."""
    place = ParameterName.parse(name)
    receivers = {stream.topic: str(stream.receiver) for stream in ONE_HAND.links}
    role, hand = receivers.get(place.topic or "", place.section), place.hand
    if place.topic == TRANSFER:
        role, hand = DEVICE, config.hands[hand].servo.energy_partner
    return role if role == ENVIRONMENT else node_name(hand, role)


def by_node(config: GraphConfig, names: Iterable[str] | None = None) -> dict[str, Parameters]:
    """Return the parameters of each node, by its name; of those in ``names`` alone, if given."""
    found: dict[str, Parameters] = {}
    for name, value in parameters(config).items():
        if names is None or name in names:
            found.setdefault(node_of(name, config), {})[name] = value
    return found


def describe(settings: Parameters, units: Mapping[str, str]) -> str:
    """Return parameters and their values in words, each in its unit, if it was written in one."""

    def text(name: str, value: Any) -> str:
        is_quantity = name in units and isinstance(value, int | float)
        return in_unit(value, units[name]) if is_quantity else str(value)

    return ", ".join(f"{name} = {text(name, value)}" for name, value in settings.items())
