"""Arguments of a launch file: ``arguments:``, ``name:=value`` on the command line, and their use.

Values are put where the file says ``$(arg name)`` or ``${env:NAME}``. A value that is nothing but
one substitution takes the substitute's type: ``seed: $(arg seed)`` with ``seed:=3`` is the number
3. Inside other text the substitute is pasted as it was written: ``$(arg delay) ms``.
"""

import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from forcebound.config.problems import Place, Problems, Related, unknown
from forcebound.config.tree import BROKEN, Scalar, Value, scalar

_SUBSTITUTION = re.compile(r"\$\((?P<call>[^()]*)\)?|\$\{(?P<braces>[^{}]*)\}?")
_ARG = re.compile(r"\s*arg\s+(?P<name>\S+)\s*")
_ENV = re.compile(r"env:(?P<name>[A-Za-z_][A-Za-z0-9_]*)(?P<fallback>:-.*)?", re.DOTALL)
MAX_PASTED = 4096  # characters of a value that substitutes are pasted into: they could fill memory

_KNOWN = "known are $(arg name), ${env:NAME} and ${env:NAME:-default}"
_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
_KEYS = ("default", "help", "choices")


@dataclass(frozen=True)
class Argument:
    """One argument that a launch file declares."""

    name: str
    default: Scalar  # None: it must be given
    help: str = ""
    choices: tuple[Scalar, ...] = ()  # empty: any


class Arguments:
    """The arguments of one launch file and their values."""

    def __init__(self, root: Value, problems: Problems) -> None:
        self._problems = problems
        self._substitution = Substitution(None, problems)
        self._places: dict[str, Place] = {}
        self._defaults: dict[str, Value | None] = {}
        self.declared: dict[str, Argument] = {}
        section = root.entries.get("arguments")
        if section is None or section.content is None:
            return
        if not isinstance(section.content, Mapping):
            problems.add(f"arguments must be a mapping, got {section}", section.place)
        for name, value in section.entries.items():
            self._declare(name, value)

    def values(self, overrides: Sequence[str]) -> dict[str, Value]:
        """Return the value of each argument; broken where a problem was noted."""
        given: dict[str, Value] = {}
        for text in overrides:
            self._override(text, given)
        values: dict[str, Value] = {}
        for name, default in self._defaults.items():
            value = given.get(name, default)
            if value is None:
                message = f"argument {name!r} has no default; give it: {name}:=..."
                self._problems.add(message, self._places[name])
                value = Value(BROKEN, self._places[name])
            values[name] = self._chosen(name, value)
        return values

    def _declare(self, name: str, value: Value) -> None:
        place = value.key or value.place
        self._places[name] = place
        if not _NAME.fullmatch(name):
            message = f"an argument's name has letters, digits and _, got {name!r}"
            self._problems.add(message, place)
        for key, entry in value.entries.items():
            if key not in _KEYS:
                self._problems.add(unknown("key", key, _KEYS), entry.key or entry.place)
        is_mapping = isinstance(value.content, Mapping)
        default = self._default(value.entries.get("default") if is_mapping else value)
        self._defaults[name] = default
        self.declared[name] = Argument(
            name,
            None if default is None or default.is_broken else default.plain,
            value.entries["help"].text if "help" in value.entries else "",
            self._choices(value.entries.get("choices")),
        )

    def _default(self, value: Value | None) -> Value | None:
        if value is None:
            return None
        if isinstance(value.content, Mapping | tuple):
            self._problems.add(f"a default is a single value, got {value}", value.place)
            return Value(BROKEN, value.place)
        filled = self._substitution.apply(value)
        return None if filled.content is None else filled

    def _choices(self, value: Value | None) -> tuple[Scalar, ...]:
        if value is None:
            return ()
        choices = value.plain
        if not isinstance(choices, list) or any(isinstance(one, dict | list) for one in choices):
            self._problems.add(f"choices must be a list of values, got {value}", value.place)
            return ()
        return tuple(choices)

    def _override(self, text: str, given: dict[str, Value]) -> None:
        text = text.encode("utf-8", "replace").decode()  # the shell may pass any bytes
        place = _place(text)
        name, separator, word = text.partition(":=")
        if not separator:
            first, equals, rest = text.partition("=")
            hint = '; a value with a space needs quotes, as in delay:="2 ms"'
            if equals:
                hint = f"; did you mean '{first.rstrip(':')}:={rest}'?"
            self._problems.add(f"expected name:=value{hint}", place)
        elif name not in self.declared:
            self._problems.add(unknown("argument", name, self.declared), place)
        elif name in given:
            message = f"argument {name!r} is given twice"
            self._problems.add(message, place, Related("first", given[name].place))
        else:
            word = word.strip()
            content = scalar(word)
            given[name] = Value("" if content is None else content, place, text=word)

    def _chosen(self, name: str, value: Value) -> Value:
        choices = self.declared[name].choices
        if value.is_broken or not choices or value.plain in choices:
            return value
        known = [str(choice) for choice in choices]
        message = unknown(f"choice for argument {name!r}:", value.text, known)
        self._problems.add(message, value.place)
        return Value(BROKEN, value.place)


def check_overrides_are_used(
    overrides: Sequence[str], used: set[str], declared: Mapping[str, Argument], problems: Problems
) -> None:
    """Note each override that changes nothing, because no value of the launch file uses it."""
    for text in overrides:
        name = text.partition(":=")[0]
        if name in declared and name not in used:
            problems.add("nothing in the launch file uses this argument", _place(text))


def _place(override: str) -> Place:
    shown = override if len(override) <= 200 else override[:197] + "..."
    return Place(f"argument {shown}")


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
        substitutes = [part for part in parts if part is not None]
        if len(substitutes) < len(parts):
            return replace(value, content=BROKEN)
        if len(matches) == 1 and matches[0].span() == (0, len(content)):
            return replace(substitutes[0], key=value.key)
        length = len(content) + sum(len(part.text) for part in substitutes)
        if length > MAX_PASTED:
            words = f"filled in, this has {length} characters; more than {MAX_PASTED} is a mistake"
            self._problems.add(words, value.place)
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
        related = Related("used at", value.place)
        return None if argument.is_broken else replace(argument, related=related)

    def _variable(self, name: str, fallback: str | None, value: Value) -> Value | None:
        text = os.environ.get(name, None if fallback is None else fallback[2:])
        if text is None:
            hint = f"${{env:{name}:-default}} would give it a default"
            self._problems.add(f"environment variable {name} is not set; {hint}", value.place)
            return None
        text = text.encode("utf-8", "replace").decode()  # the environment may hold any bytes
        return replace(value, content=scalar(text), text=text)


def _pasted(value: Value, matches: list[re.Match[str]], substitutes: list[Value]) -> Value:
    text, end, content, related = "", 0, str(value.content), None
    for match, substitute in zip(matches, substitutes, strict=True):
        text += content[end : match.start()] + substitute.text
        end = match.end()
        if substitute.related is not None:
            related = Related("with", substitute.place)
    text += content[end:]
    return replace(value, content=text, text=text, related=related)
