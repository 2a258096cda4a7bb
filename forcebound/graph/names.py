"""Names of parameters: the place of a value in a launch file.

``device.law``, ``links.environment_query.delay``, ``environment.surface.friction``.
"""

from dataclasses import dataclass
from typing import Any, TypeAlias

from forcebound.errors import ConfigError

Document: TypeAlias = dict[str, Any]  # a launch file, or a section of one, in plain JSON values


@dataclass(frozen=True)
class ParameterName:
    """A name in its parts."""

    section: str  # of the launch file
    path: tuple[str, ...] = ()  # mappings within the section, from outside to inside
    entry: str = ""  # key of the value; empty for a value at the top, such as ``seed``

    @classmethod
    def parse(cls, text: str) -> "ParameterName":
        """Return the parts of a name as it is written."""
        section, *rest = text.split(".")
        return cls(section, tuple(rest[:-1]), rest[-1] if rest else "")

    @property
    def steps(self) -> tuple[str, ...]:
        """The keys from the top of the launch file to the value."""
        return tuple(step for step in (self.section, *self.path, self.entry) if step)

    @property
    def last(self) -> str:
        """The key of the value."""
        return self.steps[-1]

    @property
    def topic(self) -> str | None:
        """The topic of a link's parameter; None for others."""
        return self.path[0] if self.section == "links" and self.path else None

    def put(self, document: Document, value: Any) -> None:
        """Set the value in a document of plain values, in mappings of its own."""
        *before, last = self.steps
        for step in before:
            document[step] = dict(document.get(step) or {})
            document = document[step]
        document[last] = value

    def __str__(self) -> str:
        return ".".join(self.steps)


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


LAW = "device.law"  # the one parameter of a device that can change while a graph runs
