"""The methods of the league in one table, and those of a user's file.

To add a method: one entry of ``methods`` in ``league.yaml``.
"""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from forcebound.errors import ConfigError
from forcebound.graph.fields import fields_of
from forcebound.haptics.controllers import CONTROLLERS
from forcebound.haptics.laws import LAWS
from forcebound.haptics.parts.user_module import names_file
from forcebound_proofs.cases import Range
from forcebound_proofs.field_ranges import ranges_of
from forcebound_proofs.league.places import TABLES, Words


class Method(NamedTuple):
    """A way to keep a hand safe, as words of a launch file."""

    words: Words
    promise: str  # what it says of itself, in a few words
    source: str
    numbers: Mapping[str, Range] = {}  # to be tuned; none: it has none of its own
    excuse: str = ""  # why energy given to the hand breaks no promise of it
    condition: Mapping[str, Any] = {}  # of its promise: network, weights of numbers, most
    audit: str = "–"  # lowest energy in the audit

    def with_numbers(self, numbers: Mapping[str, float]) -> Words:
        """Return the words with these numbers in them; without any, those of the defaults."""
        if not numbers:
            given = (re.sub(r"\(.*{.*\)", "", word) for word in self.words)
            return tuple(word for word in given if "{" not in word)
        return tuple(word.format(**numbers) for word in self.words)

    def is_met(self, row: Mapping[str, Any], numbers: Mapping[str, float]) -> bool:
        """Return whether the condition of its promise holds in a run, with these numbers."""
        if not self.condition:
            return True
        weights = self.condition["weights"]
        # without numbers of a tuning it has its defaults, which meet it
        total = sum(weights[name] * value for name, value in numbers.items())
        return bool(row["network"] == self.condition["network"] and total <= self.condition["most"])


def _read(words: Sequence[str], numbers: Mapping[str, Any] = {}, **rest: Any) -> Method:
    ranges = {name: Range(**row) for name, row in numbers.items()}
    return Method(tuple(words), numbers=ranges, **rest)


METHODS = {name: _read(**row) for name, row in TABLES["methods"].items()}
CERTIFIED = "certified"  # the one that others are compared with
_OF_A_USER = ("what its author says", "a file of yours")
_ASK = "its author knows"
OURS = ("certified", "certified_fading", "certified_deadband")


def method_of_file(kind: str) -> tuple[Method, object]:
    """Return the method of a user's law or controller, ``FILE.py`` or ``FILE.py:NAME``, and that.

    The numbers of a controller are tuned in the ranges of their types; with it there is no law.

    Raises:
        ConfigError: If the file has neither, or several of one, or cannot be loaded.
    """
    try:
        name = LAWS.resolve(kind, Path())
    except ConfigError as no_law:
        try:
            name = CONTROLLERS.resolve(kind, Path())
        except ConfigError as error:
            words = str(no_law) if str(no_law) == str(error) else f"{no_law}; {error}"
            raise ConfigError(f"--method: expected a law or a controller: {words}") from None
    else:
        return Method((f"law:={name}",), *_OF_A_USER, excuse=_ASK), LAWS[name]
    model = CONTROLLERS[name]
    floats = [key for key, field in fields_of(model).items() if type(field.default) is float]
    own = (f"controller.{key}:={{{key}}}" for key in floats)
    return Method(
        ("law:=none", f"controller:={name}", *own),
        *_OF_A_USER,
        {key: ranges_of(model)[key] for key in floats},
        _ASK,
    ), model


def chosen(files: Sequence[str]) -> tuple[dict[str, Method], list[object]]:
    """Return the methods of the table and of a user's files, by name; and what the files define.

    Raises:
        ConfigError: If a file has no method, or its name is taken.
    """
    found, parts = dict(METHODS), list[object]()
    for kind in files:
        if not names_file(kind):
            raise ConfigError(f"--method: expected FILE.py or FILE.py:NAME, got {kind!r}")
        name = Path(kind).stem
        if name in found:
            raise ConfigError(f"--method {kind}: there is a method {name!r}: rename the file")
        found[name], part = method_of_file(kind)
        parts.append(part)
    return found, parts
