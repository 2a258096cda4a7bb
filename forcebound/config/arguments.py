"""Arguments of a launch file: ``arguments:``, ``name:=value`` on the command line, and their use.

Values are put where the file says ``$(arg name)`` or ``${env:NAME}``. A value that is nothing but
one substitution takes the substitute's type: ``seed: $(arg seed)`` with ``seed:=3`` is the number
3. Inside other text the substitute is pasted as it was written: ``$(arg delay) ms``.
"""

import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from forcebound.config.problems import Place, Problems, Related, shortened, unknown
from forcebound.config.tree import BROKEN, Scalar, Value, scalar

_SUBSTITUTION = re.compile(r"\$\((?P<call>[^()]*)\)?|\$\{(?P<braces>[^{}]*)\}?")
_ARG = re.compile(r"\s*arg\s+(?P<name>\S+)\s*")
_ENV = re.compile(r"env:(?P<name>[A-Za-z_][A-Za-z0-9_]*)(?P<fallback>:-.*)?", re.DOTALL)

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
    """The arguments of one launch file and their values.

    Attributes:
        declared: Each argument by name.
    """

    def __init__(self, root: Value, problems: Problems) -> None:
        self._problems = problems
        self._defaults: dict[str, Value] = {}
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
        values = dict(self._defaults)
        given: dict[str, Place] = {}
        for text in overrides:
            name, value = self._override(text)
            if name in given:
                message = f"argument {name!r} is given twice"
                self._problems.add(message, _place(text), Related("first", given[name]))
            elif name is not None:
                values[name], given[name] = value, value.place
        return {name: self._chosen(name, value) for name, value in values.items()}

    def _declare(self, name: str, value: Value) -> None:
        place = value.key or value.place
        if not _NAME.fullmatch(name):
            message = f"an argument's name has letters, digits and _, got {name!r}"
            self._problems.add(message, place)
        for key, entry in value.entries.items():
            if key not in _KEYS:
                self._problems.add(unknown("key", key, _KEYS), entry.key or entry.place)
        nothing = Value(None, place)
        entries = value.entries if isinstance(value.content, Mapping) else {"default": value}
        default = entries.get("default", nothing)
        if isinstance(default.content, Mapping | tuple):
            self._problems.add(f"a default is a single value, got {default}", default.place)
            default = replace(default, content=BROKEN)
        default = Substitution(None, self._problems).apply(default)
        self._defaults[name] = replace(default, key=place)
        choices = entries.get("choices", nothing).plain or []
        if not isinstance(choices, list) or any(isinstance(one, dict | list) for one in choices):
            listed = entries["choices"]
            self._problems.add(f"choices must be a list of values, got {listed}", listed.place)
            choices = []
        known = None if default.is_broken else default.plain
        words = entries.get("help", nothing).text
        self.declared[name] = Argument(name, known, words, tuple(choices))

    def _override(self, text: str) -> tuple[str | None, Value]:
        """Name and value of ``name:=value``; no name, with a problem noted, if it is wrong."""
        place = _place(text)
        name, separator, word = text.partition(":=")
        word = word.strip()
        content = scalar(word)
        value = Value("" if content is None else content, place, text=word)
        if name in self.declared and separator:
            return name, value
        if separator:
            self._problems.add(unknown("argument", name, self.declared), place)
        else:
            first, equals, rest = text.partition("=")
            hint = '; a value with a space needs quotes, as in delay:="2 ms"'
            if equals:
                hint = f"; did you mean '{first.rstrip(':')}:={rest}'?"
            self._problems.add(f"expected name:=value{hint}", place)
        return None, value

    def _chosen(self, name: str, value: Value) -> Value:
        choices = self.declared[name].choices
        if value.content is None:
            message = f"argument {name!r} has no default; give it: {name}:=..."
            self._problems.add(message, value.key or value.place)
        elif value.is_broken or not choices or value.plain in choices:
            return value
        else:
            known = [str(choice) for choice in choices]
            message = unknown(f"choice for argument {name!r}:", value.text, known)
            self._problems.add(message, value.place)
        return replace(value, content=BROKEN)


def check_overrides_are_used(
    overrides: Sequence[str], used: set[str], declared: Mapping[str, Argument], problems: Problems
) -> None:
    """Note each override that changes nothing, because no value of the launch file uses it."""
    for text in overrides:
        name = text.partition(":=")[0]
        if name in declared and name not in used:
            problems.add("nothing in the launch file uses this argument", _place(text))


def _place(override: str) -> Place:
    return Place(f"argument {shortened(override)}")


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
            return value.with_entries({n: self.apply(entry) for n, entry in content.items()})
        if isinstance(content, tuple):
            return replace(value, content=tuple(self.apply(entry) for entry in content))
        if not isinstance(content, str) or "$" not in content:
            return value
        text, end, related = "", 0, None
        for match in _SUBSTITUTION.finditer(content):
            substitute = self._substitute(match, value)
            if substitute is None or substitute.is_broken:
                return replace(value, content=BROKEN)
            if match.span() == (0, len(content)):
                return replace(substitute, key=value.key)
            text += content[end : match.start()] + substitute.text
            end = match.end()
            if substitute.related is not None:
                related = Related("with", substitute.place)
        text += content[end:]
        return replace(value, content=text, text=text, related=related)

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
        elif name not in self._arguments:
            message = unknown("argument", name, self._arguments)
        else:
            self.used.add(name)
            return replace(self._arguments[name], related=Related("used at", value.place))
        self._problems.add(message, value.place)
        return None

    def _variable(self, name: str, fallback: str | None, value: Value) -> Value | None:
        text = os.environ.get(name, None if fallback is None else fallback[2:])
        if text is None:
            hint = f"${{env:{name}:-default}} would give it a default"
            self._problems.add(f"environment variable {name} is not set; {hint}", value.place)
            return None
        return replace(value, content=scalar(text), text=text)
