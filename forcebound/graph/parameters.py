"""Parameters: the law, and values of links and environment, which can change while a graph runs.

A parameter is named by its place in a launch file: ``device.law``,
``links.environment_query.delay``, ``environment.compute_delay``, ``environment.stiffness``; with
several hands ``left.device.law``.
"""

import difflib
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from forcebound.graph.graph import GraphConfig
from forcebound.graph.names import LAW, Document, ParameterName, of_hand
from forcebound.graph.problems import shortened
from forcebound.graph.resolved import to_document
from forcebound.haptics.laws import LAWS
from forcebound.haptics.parts.plain import plain
from forcebound.messages.control import Parameters
from forcebound.messages.topology import (
    IMPAIRABLE,
    LINKS,
    ONE_HAND,
    TRANSFER,
    hand_sections,
    in_hand,
)
from forcebound.network.impairment import Impairment
from forcebound.roles import DEVICE, ENVIRONMENT
from forcebound.units import in_unit

SECTIONS = ("links", "environment")  # of a launch file, whose entries are parameters


def parameters(config: GraphConfig | Document) -> Parameters:
    """Return all that can be changed, by name, as plain JSON in SI units; of a document, too."""
    document = config if isinstance(config, Mapping) else to_document(config)
    found: Parameters = {}
    for hand, sections in hand_sections(document).items():
        found[of_hand(hand, LAW)] = sections["device"]["law"]
        for topic in IMPAIRABLE if sections["device"].get("energy_partner") else LINKS:
            link = plain(Impairment()) | sections["links"].get(topic, {})
            found |= {of_hand(hand, f"links.{topic}.{name}"): v for name, v in link.items()}
    environment = {n: v for n, v in document["environment"].items() if n != "kind"}
    return found | dict(_leaves("environment", environment))


def takeable_laws() -> list[str]:
    """Return the laws that a running device can take: it loads no code from elsewhere."""
    return sorted(law for law in LAWS if LAWS.is_shipped(law))


def _leaves(place: str, section: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    """Names and values of a section and of the sections within it."""
    for name, value in section.items():
        full = f"{place}.{name}"
        yield from _leaves(full, value) if isinstance(value, Mapping) else ((full, value),)


def differences(old: GraphConfig | Document, new: GraphConfig | Document) -> Parameters:
    """Return the parameters of ``new`` that ``old`` does not have with this value."""
    before = parameters(old)
    return {n: v for n, v in parameters(new).items() if n not in before or v != before[n]}


def unknown_parameter(name: str, config: GraphConfig) -> str:
    """Return the message for a name that is no parameter: the nearest ones, or why it is none."""
    known, hands = parameters(config), [hand for hand in config.hands if hand]
    if hands and ParameterName.parse(name).hand not in hands:
        near = [of_hand(hand, name) for hand in hands if of_hand(hand, name) in known]
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
    """Whether the launch file has such a value or section, which cannot be changed."""
    place = ParameterName.parse(name)
    if place.section in ("operator", "remote", "phases"):  # which a graph need not have
        return True
    found: Any = to_document(config)
    for step in place.path:
        if not isinstance(found, Mapping) or step not in found:
            return False
        found = found[step]
    return True


def _sections() -> str:
    return f"{', '.join((LAW, *(f'links.{topic}' for topic in LINKS)))} and environment"


def processes_of(names: Iterable[str], config: GraphConfig) -> set[str]:
    """Return the processes that parameters belong to: of a link, the one that receives."""
    receivers = {stream.topic: str(stream.receiver) for stream in ONE_HAND.links}
    found = set()
    for name in map(ParameterName.parse, names):
        role, hand = receivers.get(name.topic or "", name.section), name.hand
        if name.topic == TRANSFER:
            role, hand = DEVICE, config.hands[hand].device.servo.energy_partner
        found.add(role if role == ENVIRONMENT else in_hand(hand, role))
    return found


def describe(settings: Parameters, units: Mapping[str, str]) -> str:
    """Return parameters and their values in words, each in its unit, if it was written in one."""

    def text(name: str, value: Any) -> str:
        is_quantity = name in units and isinstance(value, int | float)
        return in_unit(value, units[name]) if is_quantity else str(value)

    return ", ".join(f"{name} = {text(name, value)}" for name, value in settings.items())
