"""Names of parameters: the place of a value in a launch file.

``device.law``, ``links.environment_query.delay``, ``environment.surface.friction``. With several
hands, what belongs to one begins with its name: ``left.device.law``.
"""

from dataclasses import dataclass
from typing import Any, TypeAlias

from forcebound.errors import ConfigError
from forcebound.messages.topology import HAND, HANDS

# Sections of a launch file, of each hand and of the whole graph.
HAND_SECTIONS = ("device", "operator", "controller", "links", "remote")
OF_GRAPH = ("environment", "realtime", "phases")

Document: TypeAlias = dict[str, Any]  # a launch file, or a section of one, in plain JSON values


@dataclass(frozen=True)
class ParameterName:
    """A name as the keys from the top of the launch file to the value."""

    steps: tuple[str, ...]

    @classmethod
    def parse(cls, text: str) -> "ParameterName":
        """Return the keys of a name as it is written."""
        return cls(tuple(filter(None, text.split("."))) or ("",))

    @property
    def hand(self) -> str:
        """The hand that it belongs to; "" for the only one, and for what belongs to all."""
        first, *inside = self.steps
        return first if inside and first not in (*HAND_SECTIONS, *OF_GRAPH) else HAND

    @property
    def own(self) -> tuple[str, ...]:
        """The keys from the section of the launch file."""
        return self.steps[1:] if self.hand else self.steps

    @property
    def section(self) -> str:
        """The section of the launch file."""
        return self.own[0]

    @property
    def path(self) -> tuple[str, ...]:
        """The keys from the top of the launch file."""
        return (HANDS, *self.steps) if self.hand else self.steps

    @property
    def last(self) -> str:
        """The key of the value."""
        return self.steps[-1]

    @property
    def is_law(self) -> bool:
        """Whether it is the law of a device."""
        return self.section == "device" and self.last == "law"

    @property
    def topic(self) -> str | None:
        """The topic of a link's parameter; None for others."""
        return self.own[1] if self.section == "links" and len(self.own) > 2 else None

    def put(self, document: Document, value: Any) -> None:
        """Set the value in a document of plain values, in mappings of its own."""
        *before, last = self.path
        for step in before:
            document[step] = dict(document.get(step) or {})
            document = document[step]
        document[last] = value


def split_setting(text: str) -> tuple[str, str]:
    """Return name and value of ``name:=value``; ConfigError if it is not of this form."""
    name, sign, value = text.partition(":=")
    if sign and name:
        return name, value.strip()
    name, equals, value = text.partition("=")
    hint = '; a value with a space needs quotes, as in delay:="2 ms"'
    if equals:
        hint = f"; did you mean '{name.rstrip(':')}:={value}'?"
    raise ConfigError(f"expected name:=value, got {text!r}{hint}")


def of_hand(hand: str, name: str) -> str:
    """Return the name of a parameter that belongs to a hand."""
    return f"{hand}.{name}" if hand else name


LAW = "device.law"  # the one parameter of a device that can change while a graph runs
