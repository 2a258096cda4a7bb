"""One run: simulated, or read from a recording."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields, replace
from functools import cached_property
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from forcebound.axes import Axis
from forcebound.errors import ConfigError, RunError
from forcebound.extras import needed
from forcebound.files import recording_file
from forcebound.graph import checks
from forcebound.graph.graph import KINDS, SECTION_SETTINGS, EnvironmentConfig, GraphConfig
from forcebound.graph.loader import build, read_template
from forcebound.graph.names import text_of
from forcebound.graph.problems import unknown
from forcebound.graph.resolved import check_plain, environment_document, part_document, to_document
from forcebound.graph.tree import Value, from_plain
from forcebound.haptics.laws import LAWS, BoundingLaw
from forcebound.interface.figures import Figures
from forcebound.messages.packets import Event
from forcebound.messages.topology import HAND, HANDS, Document, flat
from forcebound.quantities import POSITIVE
from forcebound.recordings.launched import launched
from forcebound.recordings.telemetry import TelemetryColumns
from forcebound.results.samples import Samples
from forcebound.run.progress import progress_bar
from forcebound.run.results import RunResult, results_of
from forcebound.run.virtual import run_virtual_hands
from forcebound.units import parse_quantity

#: A graph, or a launch file: its path, the name of one that comes with forcebound, its content.
LaunchFile: TypeAlias = GraphConfig | str | Path | Mapping[str, Any]


class Telemetry(Mapping[str, NDArray[Any]]):
    """The telemetry of a run: one numpy array per column, oldest sample first, SI units.

    ``position``, ``commanded_force``, ``applied_force``, ``true_position`` and ``hand_force`` have
    one row per sample and one column per axis, ``(n, axes)``; all others are ``(n,)``.
    """

    def __init__(self, columns: TelemetryColumns) -> None:
        self._columns = columns
        found = ((field.name, getattr(columns, field.name)) for field in fields(columns))
        self._names = [name for name, value in found if isinstance(value, np.ndarray)]

    def __getitem__(self, name: str) -> NDArray[Any]:
        if name not in self._names:
            raise KeyError(unknown("column", name, self._names))
        column: NDArray[Any] = getattr(self._columns, name)
        return column

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)

    def __repr__(self) -> str:
        return "\n".join(f"{name:18}{self[name].dtype} {self[name].shape}" for name in self)


class Run:
    """A run: its figures, telemetry, events and launch file.

    Of a run of several hands, :attr:`hands` has that of each, with its figures; only what says so
    is of all of them. What else is asked of it is a ConfigError.

    Attributes:
        path: The recording, if there is one.
    """

    def __init__(
        self, results: Mapping[str, RunResult], path: Path | None = None, keeps: object = None
    ) -> None:
        self._results = dict(results)  # by hand
        self._keeps = keeps  # the graph whose end removes the recording
        self.path = path

    @property
    def _result(self) -> RunResult:
        if len(self._results) > 1:
            known = " or ".join(f'run.hands["{hand}"]' for hand in self._results)
            raise ConfigError(f"which hand? This run has several: {known}")
        return next(iter(self._results.values()))

    @property
    def label(self) -> str:
        """Its law; of a run that changed it, all of them."""
        return self._result.label

    @cached_property
    def telemetry(self) -> Telemetry:
        """Columns of the telemetry."""
        return Telemetry(self._result.columns)

    @cached_property
    def samples(self) -> Samples:
        """The samples with an engaged force, and what happened in their contacts."""
        result = self._result
        return Samples(result.columns, result.document, result.events)

    @property
    def events(self) -> Sequence[Event]:
        """Events that the nodes reported, in order."""
        return tuple(self._result.events)

    @property
    def document(self) -> Document:
        """The launch file as resolved for the run, in SI units."""
        return self._result.document

    @property
    def figures(self) -> Figures:
        """The figures of the run."""
        return Figures(self._result.summary, self.label)

    @property
    def verdict(self) -> list[str]:
        """The verdict in words, as every command prints it: at most five lines."""
        return [*self._result.summary["verdict"]]

    @property
    def hands(self) -> Mapping[str, "Run"]:
        """The run of each hand by its name; that of a file without ``hands`` is ``"hand"``."""
        if len(self._results) == 1:
            return dict.fromkeys(self._results, self)
        results = self._results.items()
        return {hand: Run({hand: result}, self.path, self) for hand, result in results}

    def last(self, seconds: float | str) -> "Run":
        """Return the end of the run, of all hands, as another run, whose time begins at 0 s.

        Its figures are those of this time, but true energy counts from the beginning of the run.

        Args:
            seconds: Its length, in s or with its unit.

        Raises:
            ConfigError: If that is not a time > 0 s.
        """
        length = time_of("last", seconds)
        ends = {hand: result.last(length) for hand, result in self._results.items()}
        return Run(ends, self.path, self)

    def to_pandas(self) -> Any:
        """Return the telemetry as a pandas.DataFrame, indexed by time in s; needs pandas.

        A vector has a column for each axis, as in the tables of ``forcebound export``:
        ``position[0]``, ``position[1]``; :attr:`axes` has their names.
        """
        found: dict[str, NDArray[Any]] = {}
        for name, column in self.telemetry.items():
            if column.ndim == 1:
                found[name] = column
            else:
                found |= {f"{name}[{axis}]": values for axis, values in enumerate(column.T)}
        return needed("to_pandas", "pandas").DataFrame(found).set_index("time")

    @property
    def axes(self) -> tuple[Axis, ...]:
        """The axes of the run of one hand: the name and the kind of each column of a vector."""
        result = self._result
        return launched(result.document).named_axes(result.columns.position.shape[1])

    def plot(self, *panels: str) -> "NDArray[Any]":
        """Draw the run of one hand; see :func:`plot`. Returns the axes, from top to bottom."""
        _ = self._result
        return plot(self, panels=panels)[:, 0]

    def __repr__(self) -> str:
        lines: list[str] = []
        for hand, result in self._results.items():
            lines += [*([f"{hand}:"] if hand != HAND else []), *result.summary["verdict"]]
        return "\n".join(lines)


def simulate(
    launch: LaunchFile,
    *,
    duration: float | str | None = None,
    seed: int | None = None,
    record: str | Path | None = None,
    **arguments: Any,
) -> Run:
    """Run a launch file in virtual time, as ``forcebound simulate`` does.

    Args:
        launch: A :class:`forcebound.Graph`; or a launch file: a path, the name of one that comes
            with forcebound, or its content.
        duration: Of the run, in s or with its unit; default: that of the launch file.
        seed: Of everything random; default: that of the launch file.
        record: Recording to write, ``.mcap``; one that exists is replaced.
        arguments: Values for the file's arguments: text with its unit, or a number in SI units. Any
            other value by its path, ``**{"environment.stiffness": "2 N/mm"}``.
            ``law``, ``device``, ``operator``, ``controller`` and ``environment`` also take a part
            that was made in Python, for example in the cell of a notebook.

    Raises:
        ConfigError: If the launch file or an argument is wrong; all problems at once.
        DeviceError: If a user's device failed.
        RunError: If the run is too short to have a sample, or nothing came of it.
    """
    config = configuration(launch, arguments, duration, seed)
    path = None if record is None else recording_file(Path(record))
    with progress_bar("ms of virtual time", after=1.0) as progress:
        results = run_virtual_hands(config, record=path, progress=progress)
    for hand, result in results.items():
        if result.failed:
            raise RunError(f"{hand}: {result.failed}" if hand != HAND else result.failed)
    return Run(results, path)


def read(recording: str | Path) -> Run:
    """Return the run of a recording, live or in virtual time; of a cut one what is readable.

    Raises:
        ConfigError: If it is no recording of a run.
    """
    path = Path(recording)
    return Run(results_of(path), path)


def plot(*runs: Run, panels: Sequence[str] = ()) -> "NDArray[Any]":
    """Draw runs side by side, as ``forcebound plot`` does, in a figure of matplotlib's pyplot.

    Args:
        runs: One column each; of several hands, one for each hand.
        panels: Of ``position``, ``force``, ``energy``, ``loop_delay`` and the others of
            :data:`forcebound.results.panels.PANELS`; default: those that suit the runs.

    Returns:
        The axes, shape (panels, columns), each a :class:`matplotlib.axes.Axes`.
    """
    pyplot = needed("plot", "matplotlib.pyplot")

    from forcebound.recordings.recording import read as read_recording
    from forcebound.results.panels import PANELS
    from forcebound.results.plots import figure
    from forcebound.results.signals import curves_of

    for name in panels:
        if name not in PANELS:
            raise ConfigError(unknown("panel", name, PANELS))
    columns = [(run.path, *one) for run in runs for one in run._results.items()]
    results = [result for _, _, result in columns]
    drawing = figure(
        [(result.label, result.columns, result.document) for result in results],
        panels or None,
        events=[result.events for result in results],
        signals=[
            [] if path is None else curves_of(read_recording(path, hand=hand))
            for path, hand, _ in columns
        ],
        new=pyplot.figure,
    )
    axes: NDArray[Any] = np.array(drawing.axes, dtype=object).reshape(-1, len(columns))
    return axes


def configuration(
    launch: LaunchFile,
    arguments: Mapping[str, Any],
    duration: float | str | None = None,
    seed: int | None = None,
) -> GraphConfig:
    """Return the graph of a launch file with the values of its arguments.

    Raises:
        ConfigError: If the launch file or an argument is wrong; all problems at once.
    """
    if isinstance(launch, GraphConfig) and not arguments:
        config = launch
    else:
        parts, texts = split(arguments)
        config = build(with_parts(template_of(launch), parts), texts, asks=True)
    if duration is not None:
        config = replace(config, duration=time_of("duration", duration))
    if seed is not None:
        config = replace(config, seed=seed)
    checks.warn(config)
    return config


def time_of(name: str, value: float | str) -> float:
    """Return a time in s, as a number or with its unit; ConfigError with ``name`` unless > 0 s."""
    try:
        return POSITIVE.check(parse_quantity(value, "s"), "s")
    except ConfigError as error:
        raise ConfigError(f"{name}: {error}") from None


def template_of(launch: LaunchFile) -> Value:
    """Return a launch file with its arguments still open; of a graph, its law is one."""
    if isinstance(launch, GraphConfig):
        document = flat(to_document(launch))
        if len(launch.hands) == 1:
            (hand,) = [document] if "device" in document else document[HANDS].values()
            document["arguments"] = {"law": hand["device"]["law"]}
            hand["device"]["law"] = "$(arg law)"
        return from_plain(document, "graph")
    if isinstance(launch, str | Path):
        return read_template(launch)
    if not isinstance(launch, Mapping):
        expected = "a forcebound.Graph, the path or name of a launch file, or its content"
        raise ConfigError(f"expected {expected}, got {launch!r}")
    if "include" in launch:
        raise ConfigError(
            "include: only a file includes others; name one, or write its content out"
        )
    return from_plain(launch, "launch file")


def split(arguments: Mapping[str, Any]) -> tuple[dict[str, Any], list[str]]:
    """Return the parts among some arguments, and the others as ``name:=value``."""
    parts = {name: value for name, value in arguments.items() if is_part(value)}
    rest = {name: value for name, value in arguments.items() if name not in parts}
    return parts, [f"{name}:={text_of(value)}" for name, value in rest.items()]


def is_part(value: Any) -> bool:
    """Return whether the value of an argument is a part that was made in Python."""
    return not isinstance(value, str | int | float | np.number | np.bool_ | Path)


def with_parts(template: Value, parts: Mapping[str, Any]) -> Value:
    """Return a launch file with parts that were made in Python in place of those it names.

    Raises:
        ConfigError: If a part does not belong in its section, or its parameters are not plain.
    """
    entries = dict(template.entries)
    for name, part in parts.items():
        section = "device" if name == "law" else name
        kept = entries[section].entries if section in entries else {}
        if name == "law":
            content: Document = {"law": known_law(part)}
        else:
            content = _known_part(section, part)
            kept = {key: kept[key] for key in kept if key in SECTION_SETTINGS.get(section, ())}
        entries[section] = replace(template, content={**kept, **from_plain(content, name).entries})
    return template.with_entries(entries)


def known_law(law: Any) -> str:
    """Return the name of a law, which is known by it from then on; ConfigError if it is none."""
    if not isinstance(law, BoundingLaw):
        raise ConfigError(f"law: expected a name or a BoundingLaw, got {law!r}")
    return LAWS.known(law, law.limit.__name__)


def _known_part(section: str, part: Any) -> Document:
    """Return the document of a part, whose class is known by its name from then on."""
    if section not in KINDS:
        sections = ", ".join(["law", *KINDS])
        raise ConfigError(
            f"{section}: expected one number or text, got {part!r}; objects are for {sections}"
        )
    if isinstance(part, type):
        part = part()
    if isinstance(part, EnvironmentConfig) and section == "environment":
        return {**_known_part(section, part.model), **environment_document(part)}
    KINDS[section].known(type(part), type(part).__name__)
    check_plain(part)
    return part_document(section, part)
