"""What a sweep file says: a launch file, and which values its arguments take.

::

    forcebound: 1
    description: ...
    launch: stiff_wall             # beside this file, or one that comes with forcebound
    duration: 4 s                  # instead of the launch file's
    set: { approach_speed: 100 mm/s }
    over:                          # every combination; the last one varies fastest
      law: [none, certified]                                          # a list, or { all: laws }
      stiffness: { from: 0.1 N/mm, to: 20 N/mm, count: 20, scale: log }   # a range
      seed: { repeat: 5 }                                             # 1 to 5, or from: on
    random: { count: 50, seed: 7, over: { delay: { from: 0 ms, to: 5 ms } } }   # drawn jointly
    map: { x: delay, y: stiffness, value: true_energy_min_j, per: law }

With ``random``, each combination of ``over`` meets each of the ``count`` draws: the same draws, so
that combinations differ in nothing else.
"""

import math
import random
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

from forcebound.bounding import LAWS
from forcebound.config.document import MAX_BYTES, find
from forcebound.config.fields import Section
from forcebound.config.graph import FORMAT
from forcebound.config.loader import arguments_of, read_template
from forcebound.config.problems import Problems, unknown
from forcebound.config.tree import Value, parse
from forcebound.errors import ConfigError
from forcebound.files import reason
from forcebound.quantities import parse_quantity, split_quantity

MAX_CASES = 2_000_000

KEYS = ("forcebound", "description", "launch", "duration", "set", "over", "random", "map")
RANGE_KEYS = ("from", "to", "count", "scale")
MAP_KEYS = ("x", "y", "value", "per", "limits", "title", "scale")

#: What ``{ all: NAME }`` stands for: the names of a table.
TABLES: Mapping[str, Mapping[str, object]] = {"laws": LAWS}

SHIPPED = Path(__file__).parent


@dataclass(frozen=True)
class Sweep:
    """A sweep, ready to run.

    Attributes:
        name: Of its file, without the ending.
        description: What it is for.
        template: The launch file; :func:`forcebound.config.loader.build` makes a case of it.
        duration: Of each run, in s; None: as the launch file says.
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
    if path.is_file():
        return path
    for name in (path.name, f"{path.name}.yaml"):
        if path.parent == Path() and name in shipped():
            return SHIPPED / name
    raise ConfigError(
        f"there is no sweep file {str(path)!r}; those that come with forcebound: "
        + ", ".join(shipped())
    )


def load_sweep(path: str | Path, overrides: Sequence[str] = ()) -> Sweep:
    """Return the sweep of a file.

    Args:
        path: The file, or the name of one that comes with forcebound: ``z_width``.
        overrides: ``name:=value``: arguments to hold constant, whatever the file says of them.

    Raises:
        ConfigError: If there is no such file or anything in it is wrong; every problem with its
            place. Values that only the launch file can judge are judged case by case.
    """
    file = find_sweep(Path(path))
    problems = Problems()
    try:
        text = file.read_bytes()[: MAX_BYTES + 1].decode("utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"cannot read the sweep file {file}: {reason(error)}") from error
    root = parse(text, str(file), problems)
    if root is None:
        raise problems.error()
    return _Reader(root, file, problems).sweep(overrides)


class _Reader:
    def __init__(self, root: Value, file: Path, problems: Problems) -> None:
        self._root = root
        self._file = file
        self._problems = problems
        self._known: set[str] = set()

    def sweep(self, overrides: Sequence[str]) -> Sweep:
        root, problems = self._root, self._problems
        top = Section(root, "the sweep file", root, problems)
        top.check_keys(KEYS)
        version = root.entries.get("forcebound")
        if version is None or version.content is True or version.content != FORMAT:
            message = f"the sweep file needs 'forcebound: {FORMAT}', the version of its format"
            problems.add(message, root.place if version is None else version.place)
        launch = self._launch(top)
        problems.raise_if_any()
        assert launch is not None
        self._known = {argument.name for argument in arguments_of(launch)}
        given = self._overrides(overrides)
        constants = {**self._constants(root.entries.get("set")), **given}
        grid = self._over(root.entries.get("over"), "over", None)
        drawn, count = self._random(root.entries.get("random"))
        duration = self._duration(root.entries.get("duration"))
        drawing = self._map(root.entries.get("map"), {*grid, *drawn})
        for name, values in (*grid.items(), *drawn.items()):
            if name in constants and name not in given:
                where = (self._root.entries["set"].entries[name]).place
                problems.add(f"{name!r} stands in set: and varies too", where)
            if not values and not problems:
                problems.add(f"{name!r} has no value", root.place)
        problems.raise_if_any()
        grid = {name: values for name, values in grid.items() if name not in given}
        drawn = {name: values for name, values in drawn.items() if name not in given}
        size = math.prod(len(values) for values in grid.values()) * max(count, 1)
        if size > MAX_CASES:
            raise ConfigError(f"{self._file}: {size} cases; at most {MAX_CASES} make one sweep")
        rows = [tuple(column[i] for column in drawn.values()) for i in range(max(count, 1))]
        cases = tuple((*combined, *row) for combined in product(*grid.values()) for row in rows)
        description = root.entries.get("description")
        return Sweep(
            name=self._file.stem,
            description="" if description is None else description.text,
            template=read_template(launch),
            duration=duration,
            constants=constants,
            columns=(*grid, *drawn),
            cases=cases,
            drawing=drawing,
        )

    def _launch(self, top: Section) -> Path | None:
        value = self._root.entries.get("launch")
        if value is None:
            top.add_here("the sweep file needs 'launch', the launch file to run")
            return None
        if not isinstance(value.content, str):
            top.add(f"launch must name one launch file, got {value}", value)
            return None
        found = find(Path(value.content), self._file.parent)
        if found is None:
            top.add(f"there is no launch file {value.content!r}", value)
        return found

    def _overrides(self, overrides: Sequence[str]) -> dict[str, str]:
        given = {}
        for text in overrides:
            name, separator, value = text.partition(":=")
            if not separator:
                raise ConfigError(f"expected name:=value, got {text!r}")
            if name not in self._known:
                raise ConfigError(unknown("argument", name, self._known))
            given[name] = value.strip()
        return given

    def _check_name(self, name: str, value: Value) -> None:
        if name not in self._known:
            self._problems.add(unknown("argument", name, self._known), value.key or value.place)

    def _constants(self, section: Value | None) -> dict[str, str]:
        constants = {}
        for name, value in self._entries(section, "set"):
            self._check_name(name, value)
            if isinstance(value.content, Mapping | tuple) or value.content is None:
                self._problems.add(f"set: one value for {name!r}, got {value}", value.place)
            else:
                constants[name] = value.text
        return constants

    def _over(
        self, section: Value | None, label: str, draw: tuple[random.Random, int] | None
    ) -> dict[str, list[str]]:
        found = {}
        for name, value in self._entries(section, label):
            self._check_name(name, value)
            found[name] = self._values(name, value, draw)
        return found

    def _entries(self, section: Value | None, label: str) -> list[tuple[str, Value]]:
        if section is None or section.content is None:
            return []
        if not isinstance(section.content, Mapping):
            self._problems.add(f"{label} must be a mapping, got {section}", section.place)
        return list(section.entries.items())

    def _values(self, name: str, value: Value, draw: tuple[random.Random, int] | None) -> list[str]:
        if isinstance(value.content, tuple):
            texts = [entry.text for entry in value.content]
            for entry in value.content:
                if isinstance(entry.content, Mapping | tuple) or entry.content is None:
                    self._problems.add(f"{name}: a list of single values, got {entry}", entry.place)
            if not texts:
                self._problems.add(f"{name}: an empty list leaves no case", value.place)
            elif draw is not None:
                return [draw[0].choice(texts) for _ in range(draw[1])]
            return texts
        if not isinstance(value.content, Mapping):
            return [value.text]
        section = Section(value, name, value, self._problems)
        if "all" in value.entries:
            section.check_keys(("all",))
            texts = self._table(value.entries["all"])
            return texts if draw is None else [draw[0].choice(texts) for _ in range(draw[1])]
        if "repeat" in value.entries:
            section.check_keys(("repeat", "from"))
            first = self._whole(value.entries.get("from"), 1)
            repeat = self._whole(value.entries["repeat"], 0)
            return [str(first + i) for i in range(repeat)]
        section.check_keys(RANGE_KEYS if draw is None else RANGE_KEYS[:2] + RANGE_KEYS[3:])
        return self._range(section, draw)

    def _table(self, value: Value) -> list[str]:
        if value.text not in TABLES:
            self._problems.add(unknown("table", value.text, TABLES), value.place)
            return [""]
        return list(TABLES[value.text])

    def _range(self, section: Section, draw: tuple[random.Random, int] | None) -> list[str]:
        entries = section.value.entries
        start, end = (self._end(section, key) for key in ("from", "to"))
        scale = entries.get("scale")
        is_log = scale is not None and scale.text == "log"
        if scale is not None and scale.text not in ("log", "linear"):
            section.add(f"scale must be linear or log, got {scale}", scale)
        count = draw[1] if draw is not None else self._whole(entries.get("count"), 0)
        if draw is None and count < 1:
            section.add_here(f"{section.name} needs 'count', a whole number of at least 1")
        if start is None or end is None:
            return []
        (low, unit), (high, other) = start, end
        if unit != other:
            section.add(
                f"from and to must have one unit, got {unit!r} and {other!r}", entries["to"]
            )
            return []
        if is_log and not (low > 0 and high > 0):
            section.add("a log range has no place for zero or less", entries["from"])
            return []
        if draw is not None:
            shares = [draw[0].random() for _ in range(count)]
        else:
            shares = [i / max(count - 1, 1) for i in range(count)]
        values = [_between(low, high, share, is_log) for share in shares]
        return [f"{value!r} {unit}".strip() for value in values]

    def _end(self, section: Section, key: str) -> tuple[float, str] | None:
        value = section.value.entries.get(key)
        if value is None:
            section.add_here(f"{section.name} needs {key!r}: a list of values, or a range")
            return None
        try:
            return split_quantity(value.text)
        except ConfigError as error:
            section.add(str(error), value)
            return None

    def _whole(self, value: Value | None, default: int) -> int:
        if value is None:
            return default
        if isinstance(value.content, bool) or not isinstance(value.content, int):
            self._problems.add(f"expected a whole number, got {value}", value.place)
            return default
        if not 0 <= value.content <= MAX_CASES:
            self._problems.add(f"expected 0 to {MAX_CASES}, got {value}", value.place)
            return default
        return value.content

    def _random(self, section: Value | None) -> tuple[dict[str, list[str]], int]:
        if section is None or section.content is None:
            return {}, 0
        part = Section(section, "random", section, self._problems)
        part.check_keys(("count", "seed", "over"))
        count = self._whole(section.entries.get("count"), 0)
        if count < 1:
            part.add_here("random needs 'count', a whole number of at least 1")
        seed = section.entries.get("seed")
        if seed is None:
            part.add_here("random needs 'seed': the same draws every time")
        draw = random.Random(self._whole(seed, 0))
        return self._over(section.entries.get("over"), "random.over", (draw, count)), count

    def _duration(self, value: Value | None) -> float | None:
        if value is None:
            return None
        try:
            seconds = parse_quantity(value.plain, "s")
        except ConfigError as error:
            self._problems.add(f"duration: {error}", value.place)
            return None
        if seconds <= 0:
            self._problems.add(f"duration must be > 0 s, got {value}", value.place)
        return seconds

    def _map(self, value: Value | None, varied: set[str]) -> dict[str, Any]:
        if value is None or value.content is None:
            return {}
        part = Section(value, "map", value, self._problems)
        part.check_keys(MAP_KEYS)
        for key in ("x", "value"):
            if key not in value.entries:
                part.add_here(f"map needs {key!r}")
        for key in ("x", "y", "per"):
            entry = value.entries.get(key)
            if entry is not None and entry.text not in varied:
                self._problems.add(
                    unknown(f"varied argument for {key}:", entry.text, varied), entry.place
                )
        plain: dict[str, Any] = value.plain
        return plain


def _between(low: float, high: float, share: float, is_log: bool) -> float:
    """A round number where the range allows: ends exactly, the rest to 12 digits."""
    if share == 0.0:
        return low
    if share == 1.0:
        return high
    value = low * (high / low) ** share if is_log else low + (high - low) * share
    return float(f"{value:.12g}")
