"""Study files: conditions, method, blocks and guidance; ``docs/study.md`` has the format."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache, cached_property, lru_cache
from pathlib import Path
from typing import Annotated, Any, Literal, TypeAlias

from forcebound.errors import ConfigError
from forcebound.files import read_text
from forcebound.graph.document import MAX_BYTES, find, missing
from forcebound.graph.fields import fields_of
from forcebound.graph.forms import Form
from forcebound.graph.graph import GraphConfig
from forcebound.graph.loader import arguments_of, build, read_template
from forcebound.graph.problems import Problems, unknown
from forcebound.graph.resolved import kind_of
from forcebound.graph.tree import Value, parse
from forcebound.lab.sweep.plan import find_file
from forcebound.quantities import (
    NOT_NEGATIVE,
    POSITIVE,
    Force,
    Length,
    Range,
    Ratio,
    Speed,
    Stiffness,
    Time,
)
from forcebound.units import split_quantity, to_si

#: Environments that are one flat wall, across the first axis.
WALLS = ("wall", "damped_wall", "power_law_wall", "time_varying_wall")
SHIPPED = Path(__file__).parents[2] / "study_files"
_Count: TypeAlias = Annotated[int, Range(at_least=1, at_most=1000)]
_Whole: TypeAlias = Annotated[int, Range(at_least=0, at_most=1_000_000)]
_Settings: TypeAlias = dict[str, Any]


@dataclass(frozen=True)
class Stimulus:
    """Stimulus of a touch: a condition, and the value of the varied argument, if one varies."""

    condition: str
    level: str = ""  # as written: 1.2 N/mm

    def __str__(self) -> str:
        return f"{self.condition} {self.level}".rstrip()

    @property
    def columns(self) -> dict[str, str]:
        """Condition, and level in SI, as rows and events have it."""
        number = to_si(self.level) if self.level else None
        return {
            "condition": self.condition,
            "level": f"{number:.12g}" if number is not None else self.level,
        }


@dataclass(frozen=True, kw_only=True)
class Pairs:
    """Two-interval forced choice between conditions; counted is how often the first is chosen."""

    kind: Literal["forced_choice"]
    pairs: tuple[tuple[str, str], ...]
    repetitions: _Count


@dataclass(frozen=True, kw_only=True)
class ConstantStimuli:
    """Each level of an argument against a standard, in each condition."""

    kind: Literal["constant_stimuli"]
    argument: str
    standard: str
    levels: tuple[str, ...]
    repetitions: _Count

    def __post_init__(self) -> None:
        same_unit(self, *self.levels)


@dataclass(frozen=True, kw_only=True)
class Staircase:
    """One up, two down: the level falls after two right answers, and rises after a wrong one.

    It converges to 70.7 % right answers (Levitt, Transformed up-down methods in psychoacoustics,
    Journal of the Acoustical Society of America 49, 1971). The higher level is the right answer.
    After ``coarse`` reversals the step is halved; the staircase ends after ``reversals``, or
    ``most`` trials. All levels are at least half a step above the standard.
    """

    kind: Literal["staircase"]
    argument: str
    standard: str
    start: str
    step: str
    reversals: Annotated[int, Range(at_least=4, at_most=100)] = 12
    coarse: Annotated[int, Range(at_least=0, at_most=100)] = 4
    most: _Count = 100

    def __post_init__(self) -> None:
        low, start, step = same_unit(self, self.start, self.step)
        if not (start > low and step > 0.0 and self.coarse < self.reversals):
            raise ConfigError("needs start > standard, step > 0 and coarse < reversals")


def same_unit(method: ConstantStimuli | Staircase, *others: str) -> list[float]:
    """Return the standard and other levels as numbers; ConfigError unless they have one unit."""
    numbers, units = zip(*map(split_quantity, (method.standard, *others)), strict=True)
    if len(set(units)) > 1:
        raise ConfigError(f"levels must have the unit of the standard, {method.standard!r}")
    return list(numbers)


@dataclass(frozen=True)
class Block:
    """Trials at one band of speed, in m/s; without a band any speed will do."""

    band: tuple[Annotated[Speed, NOT_NEGATIVE], Annotated[Speed, POSITIVE]] | None = None
    text: str = ""  # instruction

    def __post_init__(self) -> None:
        if self.band is not None and not self.band[0] < self.band[1]:
            raise ConfigError("the lower end of the band comes first", field="band")

    def holds(self, speed: float | None) -> bool:
        """Return whether a speed, in m/s, is in the band; None: it could not be measured."""
        return self.band is None or (speed is not None and self.band[0] <= speed <= self.band[1])


@dataclass(frozen=True)
class Guidance:
    """How the participant is kept at speed, and what is repeated if the speed was out of band."""

    line: Annotated[Length, POSITIVE] = 0.010  # starting line, before the wall
    colours: tuple[str, str, str] = ("yellow", "blue", "red")  # too slow, in the band, too fast
    repeat: Literal["touch", "trial", "nothing"] = "touch"


@dataclass(frozen=True)
class Training:
    """Trials before those of a block, so many of each pair, with feedback."""

    repetitions: Annotated[int, Range(at_least=0, at_most=100)] = 0
    feedback: bool = True


@dataclass(frozen=True)
class Breaks:
    """A break after so many trials; 0: none."""

    every: _Whole = 0
    duration: Annotated[Time, NOT_NEGATIVE] = 60.0


@dataclass(frozen=True)
class Order:
    """Order of blocks, as written or balanced over participants; the seed of all that is drawn."""

    blocks: Literal["counterbalanced", "fixed"] = "counterbalanced"
    seed: _Whole = 1


@dataclass(frozen=True, kw_only=True)
class Published:
    """Results of a block that somebody has published: shown beside ours."""

    people: _Count
    chosen: Ratio
    sd: Ratio  # over people
    penetration: Length
    force: Force
    stiffness: Stiffness


@dataclass(frozen=True)
class _Condition:
    launch: str = ""
    set: _Settings = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True, eq=False)
class StudyFile:
    """A study file as it is written; its launch files have not been read."""

    forcebound: Literal[1]
    question: str
    conditions: dict[str, _Condition]
    method: Pairs | ConstantStimuli | Staircase
    blocks: dict[str, Block]
    description: str = ""
    launch: str = ""
    set: _Settings = field(default_factory=dict)
    touch_time: Annotated[Time, POSITIVE] = 2.0  # in contact, of each touch
    noise: Literal["none", "white", "pink"] = "none"  # on earphones
    guidance: Guidance = Guidance()
    training: Training = Training()
    breaks: Breaks = Breaks()
    order: Order = Order()
    published: dict[str, Published] = field(default_factory=dict)

    @cached_property
    def pairs(self) -> list[tuple[Stimulus, Stimulus]]:
        """Each pair, first the stimulus that is counted; of a staircase those it starts with."""
        method = self.method
        if isinstance(method, Pairs):
            return [(Stimulus(one), Stimulus(other)) for one, other in method.pairs]
        levels = method.levels if isinstance(method, ConstantStimuli) else (method.start,)
        return [
            (Stimulus(name, level), Stimulus(name, method.standard))
            for name in self.conditions
            for level in levels
        ]


@dataclass(frozen=True, kw_only=True, eq=False)
class Study(StudyFile):
    """A study, ready to run."""

    name: str  # of its file, without the ending
    text: str  # of its file
    digest: str  # two studies share it only if their files and launch files say the same
    graphs: Mapping[str, tuple[Value, Mapping[str, str]]]  # by condition: launch file, arguments

    def config(self, stimulus: Stimulus) -> GraphConfig:
        """Return the graph of a stimulus; ConfigError if a setting does not fit."""
        return _built(self, stimulus)


@lru_cache(maxsize=4096)
def _built(study: Study, stimulus: Stimulus) -> GraphConfig:
    template, settings = study.graphs[stimulus.condition]
    if not isinstance(study.method, Pairs):
        settings = {**settings, study.method.argument: stimulus.level}
    return build(template, [f"{name}:={text}" for name, text in settings.items()])


def shipped() -> list[str]:
    """Return the names of the study files that come with the package."""
    return sorted(path.name for path in SHIPPED.glob("*.yaml"))


def read_study(file: Path, problems: Problems) -> tuple[StudyFile, Value, str]:
    """Return a study file, its tree and its text; ConfigError with every problem and its place."""
    text = read_text(file, "the study file", MAX_BYTES)
    root = parse(text, str(file), problems)
    if root is None:
        raise problems.error()
    values = Form("the study file", fields_of(StudyFile)).read(root, problems)
    problems.raise_if_any()
    return StudyFile(**(values or {})), root, text


def load_study(path: str | Path) -> Study:
    """Return the study of a file; ConfigError with every problem in it and its place."""
    file, problems = find_file(Path(path), SHIPPED, "study file"), Problems()
    written, root, text = read_study(file, problems)
    graphs = _graphs(written, root, file.parent, problems)
    problems.raise_if_any()
    launch = {name: [template.plain, settings] for name, (template, settings) in graphs.items()}
    decisive = json.dumps([root.plain, launch], sort_keys=True, default=str)
    digest = hashlib.sha256(decisive.encode()).hexdigest()
    about = {"name": file.stem, "text": text, "digest": digest, "graphs": graphs}
    study = Study(**(vars(written) | about))
    _check(study, root, problems)
    problems.raise_if_any()
    return study


def _graphs(
    written: StudyFile, root: Value, folder: Path, problems: Problems
) -> dict[str, tuple[Value, Mapping[str, str]]]:
    """Return launch file and arguments of each condition, whose names are checked."""
    nothing = Value({}, root.place)
    found: dict[str, tuple[Value, Mapping[str, str]]] = {}
    # One launch file serves many conditions.
    file_of, template_of, known_of = cache(find), cache(read_template), cache(arguments_of)
    common = root.entries.get("set", nothing).entries
    for name, value in root.entries["conditions"].entries.items():
        launch = written.conditions[name].launch or written.launch
        file = file_of(Path(launch), folder) if launch else None
        if file is None:
            at = value.entries.get("launch", root.entries.get("launch", value))
            problems.add(missing(launch, folder) if launch else f"{name} needs 'launch'", at.place)
            continue
        known = {one.name for one in known_of(file)}
        settings = {**common, **value.entries.get("set", nothing).entries}
        named = {argument: one.key or one.place for argument, one in settings.items()}
        if not isinstance(written.method, Pairs):
            at = root.entries["method"].entries["argument"]
            named[written.method.argument] = at.place
        for argument in named.keys() - known:
            problems.add(unknown("argument", argument, known), named[argument])
        found[name] = template_of(file), {key: one.text for key, one in settings.items()}
    return found


def _check(study: Study, root: Value, problems: Problems) -> None:
    """Add the problems of a file: unknown names, graphs that cannot be built, bands too fast."""
    for key in study.published.keys() - study.blocks:
        at = root.entries["published"].entries[key]
        problems.add(unknown("block", key, study.blocks), at.key or at.place)
    for section in ("conditions", "blocks"):
        if not getattr(study, section):
            problems.add(f"{section}: expected at least one", root.entries[section].place)
    if not study.pairs:
        problems.add("method: expected at least one pair", root.entries["method"].place)
    for stimulus in dict.fromkeys(one for pair in study.pairs for one in pair):
        if stimulus.condition not in study.graphs:
            at = root.entries["method"].entries["pairs"]
            problems.add(unknown("condition", stimulus.condition, study.graphs), at.place)
            continue
        place = root.entries["conditions"].entries[stimulus.condition].place
        try:
            config = study.config(stimulus)
            fastest = getattr(config.only.device, "largest_speed", None)
        except ConfigError as error:
            problems.add(f"{stimulus.condition} {stimulus.level}: {error}", place)
            continue
        if wall_of(config) is None:
            problems.add(f"{stimulus.condition}: a study needs a flat wall", place)
        for name, block in study.blocks.items():
            if block.band and fastest is not None and block.band[0] >= fastest:
                at = root.entries["blocks"].entries[name].entries["band"]
                words = f"no condition can reach it: the device refuses more than {fastest:g} m/s"
                problems.add(f"band of {name!r}: {words}", at.place)


def wall_of(config: GraphConfig) -> float | None:
    """Return the place of the flat wall of a graph across its first axis, in m; None without."""
    model = config.environment.model
    is_wall = kind_of("environment", model) in WALLS
    return float(getattr(model, "position", 0.0)) if is_wall else None
