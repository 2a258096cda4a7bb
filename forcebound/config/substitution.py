"""Substitutions in a launch file: ``$(arg name)`` and ``${env:NAME}``.

A value that is nothing but one substitution takes the substitute's type: ``seed: $(arg seed)`` with
``seed:=3`` is the number 3. Inside other text the substitute is pasted as it was written:
``$(arg delay) ms``.
"""

import os
import re
from collections.abc import Mapping
from dataclasses import replace

from forcebound.config.problems import Problems, Related, unknown
from forcebound.config.tree import BROKEN, Value, scalar

_SUBSTITUTION = re.compile(r"\$\((?P<call>[^()]*)\)?|\$\{(?P<braces>[^{}]*)\}?")
_ARG = re.compile(r"\s*arg\s+(?P<name>\S+)\s*")
_ENV = re.compile(r"env:(?P<name>[A-Za-z_][A-Za-z0-9_]*)(?P<fallback>:-.*)?", re.DOTALL)
MAX_PASTED = 4096  # characters of a value that substitutes are pasted into: they could fill memory

_KNOWN = "known are $(arg name), ${env:NAME} and ${env:NAME:-default}"


class Substitution:
    """Puts the values of arguments and of the process's environment where they are used.

    Attributes:
        used: Names of the arguments that were used.
    """

    def __init__(self, arguments: Mapping[str, Value] | None, problems: Problems) -> None:
        """Prepare; ``arguments`` None: they are not known yet and using one is a problem."""
        self.used: set[str] = set()
        self._arguments = arguments
        self._problems = problems

    def apply(self, value: Value) -> Value:
        """Return ``value`` with everything filled in; broken where that failed."""
        content = value.content
        if isinstance(content, Mapping):
            filled = {name: self.apply(entry) for name, entry in content.items()}
            return replace(value, content=filled)
        if isinstance(content, tuple):
            return replace(value, content=tuple(self.apply(entry) for entry in content))
        if not isinstance(content, str) or "$" not in content:
            return value
        matches = list(_SUBSTITUTION.finditer(content))
        parts = [self._substitute(match, value) for match in matches]
        if None in parts:
            return replace(value, content=BROKEN)
        substitutes = [part for part in parts if part is not None]
        if len(matches) == 1 and matches[0].span() == (0, len(content)):
            return replace(substitutes[0], key=value.key)
        length = len(content) + sum(len(part.text) for part in substitutes)
        if length > MAX_PASTED:
            message = (
                f"filled in, this has {length} characters; more than {MAX_PASTED} is a mistake"
            )
            self._problems.add(message, value.place)
            return replace(value, content=BROKEN)
        return _pasted(value, matches, substitutes)

    def _substitute(self, match: re.Match[str], value: Value) -> Value | None:
        opened, closed = match[0][1], match[0][-1]  # "$(arg}" is neither
        if (opened, closed) == ("(", ")") and (call := _ARG.fullmatch(match["call"])):
            return self._argument(call["name"], value)
        if (opened, closed) == ("{", "}") and (braces := _ENV.fullmatch(match["braces"])):
            return self._variable(braces["name"], braces["fallback"], value)
        self._problems.add(f"unknown substitution {match[0]!r}; {_KNOWN}", value.place)
        return None

    def _argument(self, name: str, value: Value) -> Value | None:
        if self._arguments is None:
            message = f"$(arg {name}) cannot stand here: the arguments are not known yet"
            self._problems.add(message, value.place)
            return None
        if name not in self._arguments:
            self._problems.add(unknown("argument", name, self._arguments), value.place)
            return None
        self.used.add(name)
        argument = self._arguments[name]
        if argument.is_broken:
            return None
        return replace(argument, related=Related("used at", value.place))

    def _variable(self, name: str, fallback: str | None, value: Value) -> Value | None:
        text = os.environ.get(name, None if fallback is None else fallback[2:])
        if text is None:
            self._problems.add(
                f"environment variable {name} is not set;"
                f" ${{env:{name}:-default}} would give it a default",
                value.place,
            )
            return None
        text = text.encode("utf-8", "replace").decode()  # the environment may hold any bytes
        return replace(value, content=scalar(text), text=text)


def _pasted(value: Value, matches: list[re.Match[str]], substitutes: list[Value]) -> Value:
    text, end = "", 0
    content = str(value.content)
    related = None
    for match, substitute in zip(matches, substitutes, strict=True):
        text += content[end : match.start()] + substitute.text
        end = match.end()
        if substitute.related is not None:
            related = Related("with", substitute.place)
    text += content[end:]
    return replace(value, content=text, text=text, related=related)
