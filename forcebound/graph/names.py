"""Names of parameters: the place of a value in a launch file.

``device.law``, ``links.environment_query.delay``, ``environment.surface.friction``. With several
hands, what belongs to one begins with its name: ``left.device.law``, or ``hands.left.device.law``.
"""

import re
from collections.abc import Mapping, MutableMapping
from dataclasses import dataclass
from numbers import Integral, Real
from typing import Any

from forcebound.errors import ConfigError
from forcebound.messages.topology import HAND, HAND_SECTIONS, HANDS, HERE

#: Keys of a launch file that are no sections: of the run, and of the file alone.
RUN_KEYS = ("description", "seed", "duration", HERE)
FILE_KEYS = ("arguments", "include", "identified")
OF_GRAPH = ("environment", "realtime", "phases")  # sections of the whole graph


@dataclass(frozen=True)
class ParameterName:
    """A name as the hand that it belongs to, and the keys from the section to the value."""

    hand: str  # HAND for the only one, and for what belongs to all
    keys: tuple[str, ...]

    @classmethod
    def parse(cls, text: str) -> "ParameterName":
        """Return the hand and keys of a name as it is written."""
        first, *inside = tuple(filter(None, text.split("."))) or ("",)
        if first == HANDS and inside:
            first, *inside = inside
        if inside and first not in (*HAND_SECTIONS, *OF_GRAPH):
            return cls(first, tuple(inside))
        return cls(HAND, (first, *inside))

    def __str__(self) -> str:
        return parameter_name(self.hand, ".".join(self.keys))

    @property
    def section(self) -> str:
        """The section of the launch file."""
        return self.keys[0]

    @property
    def path(self) -> tuple[str, ...]:
        """The keys from the top of a launch file with its hands by name."""
        is_of_all = self.hand == HAND and self.section not in HAND_SECTIONS
        return self.keys if is_of_all else (HANDS, self.hand, *self.keys)

    @property
    def last(self) -> str:
        """The key of the value."""
        return self.keys[-1]

    @property
    def is_law(self) -> bool:
        """True for the law of a device."""
        return self.keys == ("device", "law")

    @property
    def topic(self) -> str | None:
        """The topic of a link's parameter; None for others."""
        return self.keys[1] if self.section == "links" and len(self.keys) > 2 else None

    @property
    def is_preset(self) -> bool:
        """True for the named network of a link."""
        return self.topic is not None and self.keys[2:] == ("preset",)


DEFAULT = "default"  # below hands: what all of them share
_RESERVED = ("forcebound", *HAND_SECTIONS, *OF_GRAPH, *RUN_KEYS, *FILE_KEYS, HANDS, "units")
_NAME_OF_HAND = re.compile("[A-Za-z][A-Za-z0-9_]{0,31}")


def problem_of_hand(name: str, of: int) -> str | None:
    """Return what is wrong with the name of a hand ``of`` so many; None: nothing."""
    if name == DEFAULT:
        return f"{HANDS}: {DEFAULT} is what hands share; expected the name of a hand beside it"
    if not _NAME_OF_HAND.fullmatch(name) or name in _RESERVED:
        words = "expected a word of letters, digits and _ that is no section of a file"
        return f"{HANDS}: {words}, got {name!r}"
    if name == HAND and of > 1:
        return f"{HANDS}: {HAND!r} is the name of an only hand; this graph has {of}"
    return None


def put(section: MutableMapping[str, Any], keys: tuple[str, ...], value: Any) -> None:
    """Set a value within a mapping of plain values; mappings inside are copied, not changed."""
    *before, last = keys
    for key in before:
        found = section.get(key)
        inside = dict(found) if isinstance(found, Mapping) else {}
        section[key] = inside
        section = inside
    section[last] = value


def parameter_name(hand: str, name: str) -> str:
    """Return the name of a parameter that belongs to a hand."""
    return name if hand == HAND else f"{hand}.{name}"


def split_setting(text: str) -> tuple[str, str]:
    """Return name and value of ``name:=value``; ConfigError if it is not of this form."""
    name, sign, value = text.partition(":=")
    if sign and name:
        return name, value.strip()
    name, equals, value = text.partition("=")
    hint = '; a value with a space needs quotes, as in delay:="2 ms"'
    if equals and name.rstrip(":"):
        hint = f"; did you mean '{name.rstrip(':')}:={value}'?"
    raise ConfigError(f"expected name:=value, got {text!r}{hint}")


def text_of(value: object) -> str:
    """Return a number, truth value, path or text from Python as a launch file has it."""
    if isinstance(value, Real) and not isinstance(value, bool):
        return repr(int(value) if isinstance(value, Integral) else float(value))
    text = str(value)
    return text.lower() if text in ("True", "False") else text


LAW = "device.law"  # the one parameter of a device that can change while a graph runs
