"""Arguments of a launch file: ``arguments:``, ``name:=value`` on the command line, and their use.

Values are put where the file says ``$(arg name)`` or ``${env:NAME}``. A value that is nothing but
one substitution takes the substitute's type: ``seed: $(arg seed)`` with ``seed:=3`` is the number
3. Inside other text the substitute is pasted as it was written: ``$(arg delay) ms``.
"""

import os
import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

from forcebound.errors import ConfigError
from forcebound.graph.names import DEFAULT, split_setting
from forcebound.graph.problems import Place, Problems, Related, shortened, unknown
from forcebound.graph.tree import BROKEN, Scalar, Value, scalar
from forcebound.messages.topology import HANDS

_SUBSTITUTION = re.compile(
    r"\$\(\s*arg\s+(?P<argument>[^\s()]+)\s*\)"
    r"|\$\{env:(?P<variable>[A-Za-z_][A-Za-z0-9_]*)(:-(?P<default>[^{}]*))?\}"
    r"|\$[({][^(){}]*[)}]?"  # anything else is a mistake
)
_KNOWN = "known are $(arg name), ${env:NAME} and ${env:NAME:-default}"
_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
_KEYS = ("default", "help", "choices")


@dataclass(frozen=True)
class Argument:
    """One argument that a launch file declares."""

    name: str
    value: Value  # its default; without content if it must be given
    help: str = ""
    choices: tuple[Scalar, ...] = ()  # empty: any

    @property
    def default(self) -> Scalar:
        """The default as a plain value; None: it must be given."""
        default: Scalar = None if self.value.is_broken else self.value.plain
        return default


class Arguments:
    """The arguments of one launch file, ``declared`` by name, and their values."""

    def __init__(self, root: Value, problems: Problems) -> None:
        self._problems = problems
        section = root.entries.get("arguments", Value(None, root.place))
        if section.content is not None and not isinstance(section.content, Mapping):
            problems.add(f"arguments must be a mapping, got {section}", section.place)
        self.declared = {n: self._declared(n, value) for n, value in section.entries.items()}

    def values(self, overrides: Sequence[str]) -> dict[str, Value]:
        """Return the value of each argument; broken where a problem was noted."""
        values = {name: argument.value for name, argument in self.declared.items()}
        given: set[str] = set()
        for text in overrides:
            place = override_place(text)
            try:
                name, word = split_setting(text)
            except ConfigError as error:
                self._problems.add(str(error), place)
                continue
            if name not in values:
                hint = DURATION_HINT if name == "duration" else ""
                self._problems.add(unknown("argument", name, values) + hint, place)
            elif name in given:
                first_place = Related("first", values[name].place)
                self._problems.add(f"argument {name!r} is given twice", place, first_place)
            else:
                given.add(name)
                content = scalar(word)
                values[name] = Value("" if content is None else content, place, text=word)
        return {name: self._chosen(name, value) for name, value in values.items()}

    def note_unused(self, overrides: Sequence[str], used: Collection[str]) -> None:
        """Note each override that changes nothing, because no value uses its argument."""
        for text in overrides:
            name = text.partition(":=")[0]
            if name in self.declared and name not in used:
                self._problems.add(
                    "nothing in the launch file uses this argument", override_place(text)
                )

    def _declared(self, name: str, value: Value) -> Argument:
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
            hint = f"; what hands share goes below {HANDS}: {DEFAULT}:" if default.entries else ""
            self._problems.add(f"a default is a single value, got {default}{hint}", default.place)
            default = replace(default, content=BROKEN)
        default = Substitution(None, self._problems).apply(default)
        listed = entries.get("choices", nothing)
        choices = listed.plain or []
        if not isinstance(choices, list) or any(isinstance(one, dict | list) for one in choices):
            self._problems.add(f"choices must be a list of values, got {listed}", listed.place)
            choices = []
        words = entries.get("help", nothing).text
        return Argument(name, replace(default, key=place), words, tuple(choices))

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


DURATION_HINT = "; how long a run takes: --duration, in gymnasium max_episode_steps"
OVERRIDE = "argument "  # begins the name of such a place


def override_place(override: str) -> Place:
    """Return the place of a setting on the command line, for messages."""
    return Place(f"{OVERRIDE}{shortened(override)}")


class Substitution:
    """Puts arguments and environment variables where they are used; notes those ``used``."""

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
        matches = list(_SUBSTITUTION.finditer(content)) if isinstance(content, str) else []
        if not matches or not isinstance(content, str):
            return value
        found = [self._substitute(match, value) for match in matches]
        if any(one.is_broken for one in found):
            return replace(value, content=BROKEN)
        if matches[0][0] == content:
            return replace(found[0], key=value.key)
        texts = iter(found)
        text = _SUBSTITUTION.sub(lambda match: next(texts).text, content)
        origins = [Related("with", one.place) for one in found if one.related is not None]
        return replace(value, content=text, text=text, related=origins[-1] if origins else None)

    def _substitute(self, match: re.Match[str], value: Value) -> Value:
        name, variable = match["argument"], match["variable"]
        if variable is not None:
            text = os.environ.get(variable, match["default"])
            if text is not None:
                return replace(value, content=scalar(text), text=text)
            hint = f"${{env:{variable}:-default}} would give it a default"
            message = f"environment variable {variable} is not set; {hint}"
        elif name is None:
            message = f"unknown substitution {match[0]!r}; {_KNOWN}"
        elif self._arguments is None:
            message = f"$(arg {name}) cannot stand here: the arguments are not known yet"
        elif name not in self._arguments:
            message = unknown("argument", name, self._arguments)
        else:
            self.used.add(name)
            return replace(self._arguments[name], related=Related("used at", value.place))
        self._problems.add(message, value.place)
        return replace(value, content=BROKEN)
