"""Names of parameters: the place of a value in a launch file.

``device.law``, ``links.environment_query.delay``, ``environment.surface.friction``.
"""

from dataclasses import dataclass
from typing import Any, TypeAlias

from forcebound.errors import ConfigError

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
    def section(self) -> str:
        """The section of the launch file."""
        return self.steps[0]

    @property
    def last(self) -> str:
        """The key of the value."""
        return self.steps[-1]

    @property
    def topic(self) -> str | None:
        """The topic of a link's parameter; None for others."""
        return self.steps[1] if self.section == "links" and len(self.steps) > 2 else None

    def put(self, document: Document, value: Any) -> None:
        """Set the value in a document of plain values, in mappings of its own."""
        *before, last = self.steps
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


LAW = "device.law"  # the one parameter of a device that can change while a graph runs
