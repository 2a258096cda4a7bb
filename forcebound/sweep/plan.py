"""Sweep files: a launch file and the values of its arguments; ``docs/sweeps.md`` has the format.

With ``random``, each combination of ``over`` has the same ``count`` draws, so combinations differ
in nothing else.
"""

import math
import os
import random
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Annotated, Any, Literal, TypeAlias

from forcebound.bounding import LAWS
from forcebound.config.document import MAX_BYTES, find
from forcebound.config.fields import Field, fields_of
from forcebound.config.forms import Form
from forcebound.config.graph import FORMAT
from forcebound.config.loader import arguments_of, read_template
from forcebound.config.names import split_setting
from forcebound.config.problems import Problems, nearest_file, unknown
from forcebound.config.tree import Value, parse
from forcebound.errors import ConfigError
from forcebound.files import read_text
from forcebound.quantities import NOT_NEGATIVE, POSITIVE, Range, Time
from forcebound.sweep.limits import LABELS
from forcebound.units import split_quantity

MAX_CASES = 2_000_000

KEYS = ("forcebound", "description", "launch", "duration", "set", "over", "random", "map")
MAP_KEYS = ("x", "y", "value", "leaks", "per", "limits", "title", "scale")

#: What ``{ all: NAME }`` stands for: the names of a table.
TABLES: Mapping[str, Mapping[str, object]] = {"laws": LAWS}

SHIPPED = Path(__file__).parent

_Draw: TypeAlias = tuple[random.Random, int]  # what draws, and how many


class _NumberAndUnit:
    """Lets pydantic read an end of a range."""

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> Any:
        from pydantic_core import core_schema

        return core_schema.no_info_plain_validator_function(lambda v: split_quantity(str(v)))


_COUNT = Annotated[int, Range(at_least=1, at_most=MAX_CASES)]
_END = Annotated[Any, _NumberAndUnit()]
_OVER, _ALL = (Field(name, Any) for name in ("over", "all"))
_RANGE = {
    "from": Field("from", _END, True),
    "to": Field("to", _END, True),
    "count": Field("count", _COUNT, True),
    "scale": Field("scale", Literal["linear", "log"], False, "linear"),
}
_REPEAT = {
    "repeat": Field("repeat", _COUNT, True),
    "from": Field("from", Annotated[int, NOT_NEGATIVE], False, 1),
}
_MAP = {name: Field(name, str, name in ("x", "value"), None) for name in MAP_KEYS}
_MAP["limits"] = Field("limits", list[str])


@dataclass(frozen=True)
class _Head:
    launch: str
    description: str = ""
    duration: Annotated[Time, POSITIVE] = 0.0


@dataclass(frozen=True)
class _Draws:
    count: _COUNT
    seed: Annotated[int, NOT_NEGATIVE]


@dataclass(frozen=True)
class Sweep:
    """A sweep, ready to run.

    Attributes:
        name: Of its file, without the ending.
        description: Its subject.
        template: The launch file; :func:`forcebound.config.loader.build` makes a case of it.
        duration: Of each run, in s; None: that of the launch file.
        constants: Arguments that are the same in all cases, as text.
        columns: Names of the arguments that vary, in order.
        cases: Their values, as text, one row for each case.
        drawing: The map section, as plain values; empty without one.
    """

    name: str
    description: str
    template: Value
    duration: float | None
    constants: Mapping[str, str]
    columns: tuple[str, ...]
    cases: tuple[tuple[str, ...], ...]
    drawing: Mapping[str, Any]

    def overrides(self, case: int) -> list[str]:
        """Return the arguments of a case, each ``name:=value``."""
        values = {**self.constants, **dict(zip(self.columns, self.cases[case], strict=True))}
        return [f"{name}:={value}" for name, value in values.items()]


def shipped() -> list[str]:
    """Return the names of the sweep files that come with the package."""
    return sorted(path.name for path in SHIPPED.glob("*.yaml"))


def find_sweep(path: Path) -> Path:
    """Return the sweep file meant by ``path``: on disk, or one that comes with the package.

    Raises:
        ConfigError: If there is none.
    """
    if os.path.lexists(path):  # what is no file is refused when it is read
        return path
    for name in (path.name, f"{path.name}.yaml"):
        if path.parent == Path() and name in shipped():
            return SHIPPED / name
    raise ConfigError(
        f"there is no sweep file {str(path)!r}; {nearest_file(path.name, shipped())}"
        f"those that come with forcebound: {', '.join(shipped())}"
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
    file = find_sweep(Path(path))
    problems = Problems()
    text = read_text(file, "the sweep file", MAX_BYTES)
    root = parse(text, str(file), problems)
    if root is None:
        raise problems.error()
    return _sweep(root, file, overrides, problems)


def _sweep(root: Value, file: Path, overrides: Sequence[str], problems: Problems) -> Sweep:
    """Return the sweep in the tree of a sweep file."""
    rest = {name: Field(name, Any) for name in KEYS if name not in fields_of(_Head)}
    form = Form("the sweep file", {**rest, **fields_of(_Head)})
    head = form.read(root, problems)
    version = root.entries.get("forcebound")
    if version is None or version.content is True or version.content != FORMAT:
        message = f"the sweep file needs 'forcebound: {FORMAT}', the version of its format"
        problems.add(message, root.place if version is None else version.place)
    found = find(Path(head["launch"]), file.parent) if "launch" in head else None
    if "launch" in head and found is None:
        place = root.entries["launch"].place
        problems.add(f"there is no launch file {head['launch']!r}", place)
    problems.raise_if_any()
    assert found is not None
    known = {argument.name for argument in arguments_of(found)}
    given = _overrides(overrides, known)
    sections = {key: _mapping(root, key, problems) for key in KEYS[4:]}
    constants = _constants(sections["set"], known, problems)
    grid = _over(sections["over"], known, None, problems)
    drawn, rows = _random(sections["random"], known, problems)
    _check_map(sections["map"], {*grid, *drawn}, problems)
    for name in (*grid, *drawn):
        if name in constants:
            place = sections["set"].entries[name].place
            problems.add(f"{name!r} is constant in set: and also varies", place)
    problems.raise_if_any()
    grid = {name: values for name, values in grid.items() if name not in given}
    drawn = {name: values for name, values in drawn.items() if name not in given}
    size = math.prod(len(values) for values in grid.values()) * rows
    if size > MAX_CASES:
        raise ConfigError(f"{file}: {size} cases; at most {MAX_CASES} make one sweep")
    joint = [tuple(column[i] for column in drawn.values()) for i in range(rows)]
    return Sweep(
        name=file.stem,
        description=head.get("description", ""),
        template=read_template(found),
        duration=head.get("duration"),
        constants=constants | given,
        columns=(*grid, *drawn),
        cases=tuple((*combined, *row) for combined in product(*grid.values()) for row in joint),
        drawing=sections["map"].plain,
    )


def _overrides(overrides: Sequence[str], known: Collection[str]) -> dict[str, str]:
    given = {}
    for name, value in map(split_setting, overrides):
        if name not in known:
            raise ConfigError(unknown("argument", name, known))
        given[name] = value
    return given


def _mapping(root: Value, key: str, problems: Problems) -> Value:
    """A section of a sweep file; empty if it is not there or, with a problem noted, no mapping."""
    empty = Value({}, root.place, root.key)
    value = root.entries.get(key, empty)
    if isinstance(value.content, Mapping) or value.content is None:
        return value if value.entries else empty
    problems.add(f"{key} must be a mapping, got {value}", value.place)
    return empty


def _check_arguments(section: Value, known: Collection[str], problems: Problems) -> None:
    for name, value in section.entries.items():
        if name not in known:
            problems.add(unknown("argument", name, known), value.key or value.place)


def _constants(section: Value, known: Collection[str], problems: Problems) -> dict[str, str]:
    _check_arguments(section, known, problems)
    for name, value in section.entries.items():
        if not value.is_scalar:
            problems.add(f"set: one value for {name!r}, got {value}", value.place)
    return {name: value.text for name, value in section.entries.items()}


def _over(
    section: Value, known: Collection[str], draw: _Draw | None, problems: Problems
) -> dict[str, list[str]]:
    _check_arguments(section, known, problems)
    found: dict[str, list[str]] = {}
    for name, value in section.entries.items():
        found[name] = _values(name, value, draw, problems)
        if draw is None and math.prod(map(len, found.values())) > MAX_CASES:
            problems.add(f"more than {MAX_CASES} cases in one sweep", value.place)
            break
    return found


def _random(
    section: Value, known: Collection[str], problems: Problems
) -> tuple[dict[str, list[str]], int]:
    """Return the values of each drawn argument, and the number of draws."""
    if not section.entries:
        return {}, 1
    draws = Form("random", {**fields_of(_Draws), "over": _OVER}).read(section, problems)
    if not draws:
        return {}, 1
    draw = (random.Random(draws["seed"]), draws["count"])
    return _over(_mapping(section, "over", problems), known, draw, problems), draws["count"]


def _values(name: str, value: Value, draw: _Draw | None, problems: Problems) -> list[str]:
    """Return the values of one argument: one, a list, a repetition or a range."""
    if isinstance(value.content, tuple):
        for entry in value.content:
            if not entry.is_scalar:
                problems.add(f"{name}: a list of single values, got {entry}", entry.place)
        if not value.content:
            problems.add(f"{name}: an empty list leaves no case", value.place)
            return []
        return _drawn([entry.text for entry in value.content], draw)
    if not isinstance(value.content, Mapping):
        return [value.text]
    if "all" in value.entries:
        Form(name, {"all": _ALL}).read(value, problems)
        table = value.entries["all"]
        if table.text not in TABLES:
            problems.add(unknown("table", table.text, TABLES), table.place)
            return []
        return _drawn(list(TABLES[table.text]), draw)
    if "repeat" in value.entries:
        read = Form(name, _REPEAT).read(value, problems) or {"repeat": 0}
        return [str(read.get("from", 1) + i) for i in range(read["repeat"])]
    fields = _RANGE if draw is None else {k: f for k, f in _RANGE.items() if k != "count"}
    found = Form(name, fields).read(value, problems)
    return _range(value, found, draw, problems) if found else []


def _drawn(texts: list[str], draw: _Draw | None) -> list[str]:
    return texts if draw is None else [draw[0].choice(texts) for _ in range(draw[1])]


def _range(
    value: Value, read: Mapping[str, Any], draw: _Draw | None, problems: Problems
) -> list[str]:
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
    return [f"{_between(low, high, share, is_log)!r} {unit}".strip() for share in shares]


def _check_map(section: Value, varied: set[str], problems: Problems) -> None:
    if not section.entries:
        return
    Form("map", _MAP).read(section, problems)
    for key in ("x", "y", "per"):
        entry = section.entries.get(key)
        if entry is not None and entry.text not in varied:
            problems.add(unknown(f"varied argument for {key}:", entry.text, varied), entry.place)
    limits = section.entries.get("limits")
    for one in limits.content if limits and isinstance(limits.content, tuple) else ():
        if one.text not in LABELS:
            problems.add(unknown("limit", one.text, LABELS), one.place)


def _between(low: float, high: float, share: float, is_log: bool) -> float:
    """Interpolate: the ends exactly, other values rounded to 12 digits."""
    if share == 0.0:
        return low
    if share == 1.0:
        return high
    value = low * (high / low) ** share if is_log else low + (high - low) * share
    return float(f"{value:.12g}")
