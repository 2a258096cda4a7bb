"""Sweep files: a launch file and the values of its arguments; ``docs/sweeps.md`` has the format.

With ``random``, each combination of ``over`` has the same ``count`` draws, so combinations differ
in nothing else.
"""

import math
import os
import random
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from pathlib import Path
from typing import Annotated, Any, Literal, TypeAlias

from forcebound.errors import ConfigError
from forcebound.files import read_text
from forcebound.graph.document import MAX_BYTES, find
from forcebound.graph.fields import Field
from forcebound.graph.forms import Form, Values
from forcebound.graph.graph import FORMAT, GraphConfig
from forcebound.graph.loader import arguments_of, build, read_template
from forcebound.graph.names import split_setting
from forcebound.graph.problems import Problems, nearest_file, unknown
from forcebound.graph.tree import Value, parse
from forcebound.haptics.laws import LAWS
from forcebound.lab.cases import by_logarithm
from forcebound.lab.sweep.limits import LABELS
from forcebound.quantities import NOT_NEGATIVE, POSITIVE, Range, Time
from forcebound.units import split_quantity

MAX_CASES = 2_000_000
SHIPPED = Path(__file__).parent

_Draw: TypeAlias = tuple[random.Random, int]  # what draws, and how many


class _NumberAndUnit:
    """Of a type: an end of a range, as a number and its unit."""

    def read(self, value: Any, symbol: str) -> tuple[float, str]:
        """Return number and unit."""
        return split_quantity(str(value))


_COUNT = Annotated[int, Range(at_least=1, at_most=MAX_CASES)]
_WHOLE = Annotated[int, NOT_NEGATIVE]
_END = Annotated[Any, _NumberAndUnit()]
_ARGUMENTS = dict[str, Any] | None


def _form(name: str, needed: Mapping[str, object], others: Mapping[str, object]) -> Form:
    fields = {key: Field(key, hint, True) for key, hint in needed.items()}
    return Form(name, fields | {key: Field(key, hint) for key, hint in others.items()})


_SCALE = {"scale": Literal["linear", "log"]}
_FILE = _form(
    "the sweep file",
    {"forcebound": Literal[FORMAT], "launch": str},
    {
        "description": str,
        "duration": Annotated[Time, POSITIVE],
        "set": _ARGUMENTS,
        "over": _ARGUMENTS,
    },
)
_SECTIONS = {
    "random": _form("random", {"count": _COUNT, "seed": _WHOLE}, {"over": _ARGUMENTS}),
    "map": _form(
        "map",
        {"x": str, "value": str},
        {
            **dict.fromkeys(("y", "leaks", "per", "title", "scale"), str),
            "limits": list[str],
        },
    ),
}
#: Values of an argument that are no list, by their first key; ``from``: a range.
_VALUES = {
    "all": _form("all", {"all": Literal["laws"]}, {}),
    "repeat": _form("repeat", {"repeat": _COUNT}, {"from": _WHOLE}),
    "from": _form("range", {"from": _END, "to": _END, "count": _COUNT}, _SCALE),
}
_DRAWN = _form("range", {"from": _END, "to": _END}, _SCALE)


@dataclass(frozen=True)
class Sweep:
    """A launch file and the values of its arguments, ready to run."""

    template: Value  # launch file, its arguments still open
    duration: float | None  # s, of each run; None: that of the launch file
    constants: Mapping[str, str]  # arguments that are the same in all cases, as text
    columns: tuple[str, ...]  # arguments that vary, in order
    cases: tuple[tuple[str, ...], ...]  # their values, as text, a row for each case
    name: str = "sweep"  # of its file, without the ending
    description: str = ""
    drawing: Values = field(default_factory=dict)  # the map section; empty without one
    same: Values = field(default_factory=dict)  # columns that are the same in all its rows

    def overrides(self, values: Sequence[str]) -> list[str]:
        """Return the arguments of a case with these values, each ``name:=value``."""
        arguments = {**self.constants, **dict(zip(self.columns, values, strict=True))}
        return [f"{name}:={value}" for name, value in arguments.items()]

    def graph(self, values: Sequence[str]) -> GraphConfig:
        """Return the graph of a case with these values; ConfigError if one is wrong."""
        config = build(self.template, self.overrides(values))
        return config if self.duration is None else replace(config, duration=self.duration)


def shipped() -> list[str]:
    """Return the names of the sweep files that come with the package."""
    return sorted(path.name for path in SHIPPED.glob("*.yaml"))


def find_file(path: Path, folder: Path, what: str) -> Path:
    """Return the file meant by ``path``: on disk, or one that comes with the package.

    Args:
        path: The file, or the name of one that comes with the package.
        folder: Of those that come with it.
        what: Its name for messages, such as "sweep file".

    Raises:
        ConfigError: If there is none.
    """
    known = sorted(one.name for one in folder.glob("*.yaml"))
    if path.parent == Path() and not path.is_file():
        for name in (path.name, f"{path.name}.yaml"):
            if name in known:
                return folder / name
    if os.path.lexists(path):  # what is no file is refused when it is read
        return path
    raise ConfigError(
        f"there is no {what} {str(path)!r}; {nearest_file(path.name, known)}"
        f"those that come with forcebound: {', '.join(known)}"
    )


def load_sweep(path: str | Path, overrides: Sequence[str] = ()) -> Sweep:
    """Return the sweep of a file.

    Args:
        path: The file, or the name of one that comes with forcebound: ``z_width``.
        overrides: ``name:=value``: arguments held constant, even if the file varies them.

    Raises:
        ConfigError: If there is no such file, or with every problem in it and its location.
            Values of launch file arguments are checked case by case.
    """
    file = find_file(Path(path), SHIPPED, "sweep file")
    problems = Problems()
    text = read_text(file, "the sweep file", MAX_BYTES)
    root = parse(text, str(file), problems)
    if root is None:
        raise problems.error()
    return _sweep(root, file, overrides, problems)


def _sweep(root: Value, file: Path, overrides: Sequence[str], problems: Problems) -> Sweep:
    """Return the sweep in the tree of a sweep file."""
    head = _FILE.read(root, problems, _SECTIONS) or {}
    for name in _SECTIONS.keys() & root.entries.keys():
        head[name] = _SECTIONS[name].read(root.entries[name], problems)
    problems.raise_if_any()
    launch = find(Path(head["launch"]), file.parent)
    if launch is None:
        place = root.entries["launch"].place
        problems.add(f"there is no launch file {head['launch']!r}", place)
        raise problems.error()
    known = {argument.name for argument in arguments_of(launch)}
    given = _overrides(overrides, known)
    constants = _entries(root, known, problems, "set")
    for name, value in constants.items():
        if not value.is_scalar:
            problems.add(f"set: one value for {name!r}, got {value}", value.place)
    grid = _over(_entries(root, known, problems, "over"), None, problems)
    draws = head.get("random", {"count": 1, "seed": 0})
    draw = (random.Random(draws["seed"]), draws["count"])
    drawn = _over(_entries(root, known, problems, "random", "over"), draw, problems)
    varied, drawing = {*grid, *drawn}, head.get("map", {})
    known_of: dict[str, Collection[str]] = {"x": varied, "y": varied, "per": varied}
    known_of["limits"] = LABELS
    for key in known_of.keys() & drawing.keys():
        for name in [drawing[key]] if isinstance(drawing[key], str) else drawing[key]:
            if name not in known_of[key]:
                place = root.entries["map"].entries[key].place
                problems.add(unknown(f"name in map, {key}:", name, known_of[key]), place)
    for name in constants.keys() & varied:
        problems.add(f"{name!r} is constant in set: and also varies", constants[name].place)
    problems.raise_if_any()
    grid = {name: values for name, values in grid.items() if name not in given}
    drawn = {name: values for name, values in drawn.items() if name not in given}
    if math.prod(map(len, grid.values())) * draws["count"] > MAX_CASES:
        raise ConfigError(f"{file}: more than {MAX_CASES} cases in one sweep")
    joint = [tuple(column[i] for column in drawn.values()) for i in range(draws["count"])]
    return Sweep(
        name=file.stem,
        description=head.get("description", ""),
        template=read_template(launch),
        duration=head.get("duration"),
        constants={name: value.text for name, value in constants.items()} | given,
        columns=(*grid, *drawn),
        cases=tuple((*combined, *row) for combined in product(*grid.values()) for row in joint),
        drawing=drawing,
    )


def _overrides(overrides: Sequence[str], known: Collection[str]) -> dict[str, str]:
    given = {}
    for name, value in map(split_setting, overrides):
        if name not in known and "." not in name:  # else a path in the launch file
            raise ConfigError(unknown("argument", name, known))
        given[name] = value
    return given


def _entries(
    root: Value, known: Collection[str], problems: Problems, *keys: str
) -> Mapping[str, Value]:
    """Return the arguments in a section of a sweep file; empty without it."""
    section = root
    for key in keys:
        section = section.entries.get(key, Value({}, section.place))
    for name, value in section.entries.items():
        if name not in known and "." not in name:
            problems.add(unknown("argument", name, known), value.key or value.place)
    return section.entries


def _over(
    entries: Mapping[str, Value], draw: _Draw | None, problems: Problems
) -> dict[str, list[str]]:
    """Return the values of each argument, or the draws of it."""
    values_of: dict[str, list[str]] = {}
    for name, value in entries.items():
        values_of[name] = _values(name, value, draw, problems)
        if draw is None and math.prod(map(len, values_of.values())) > MAX_CASES:
            problems.add(f"more than {MAX_CASES} cases in one sweep", value.place)
            break
    return values_of


def _values(name: str, value: Value, draw: _Draw | None, problems: Problems) -> list[str]:
    """Return the values of one argument: one, a list, a repetition or a range."""
    if isinstance(value.content, tuple):
        for entry in value.content:
            if not entry.is_scalar:
                problems.add(f"{name}: a list of single values, got {entry}", entry.place)
        if not value.content:
            problems.add(f"{name}: an empty list leaves no case", value.place)
        return _drawn([entry.text for entry in value.content], draw)
    if not isinstance(value.content, Mapping):
        return [value.text] * (1 if draw is None else draw[1])
    kind = next((key for key in _VALUES if key in value.entries and key != "from"), "from")
    form = _VALUES[kind] if draw is None or kind != "from" else _DRAWN
    read = replace(form, name=name).read(value, problems)
    if not read:
        return []
    if kind == "all":
        return _drawn(LAWS.usual, draw)
    if kind == "repeat":
        return _drawn([str(read.get("from", 1) + i) for i in range(read["repeat"])], draw)
    return _range(value, read, draw, problems)


def _drawn(texts: list[str], draw: _Draw | None) -> list[str]:
    return texts if draw is None or not texts else [draw[0].choice(texts) for _ in range(draw[1])]


def _range(value: Value, read: Values, draw: _Draw | None, problems: Problems) -> list[str]:
    entries = value.entries
    (low, unit), (high, other) = read["from"], read["to"]
    is_log = read.get("scale") == "log"
    if unit != other:
        message = f"from and to must have one unit, got {unit!r} and {other!r}"
        problems.add(message, entries["to"].place)
        return []
    if is_log and not (low > 0 and high > 0):
        problems.add("a log range needs values > 0", entries["from"].place)
        return []
    if draw is not None:
        shares = [draw[0].random() for _ in range(draw[1])]
    else:
        shares = [i / max(read["count"] - 1, 1) for i in range(read["count"])]
    return [f"{between(low, high, share, is_log)!r} {unit}".strip() for share in shares]


def between(low: float, high: float, share: float, is_log: bool = False) -> float:
    """Interpolate: the ends exactly, other values rounded to 12 digits."""
    if share == 0.0:
        return low
    if share == 1.0:
        return high
    value = by_logarithm(low, high, share) if is_log else low + (high - low) * share
    return float(f"{value:.12g}")
