"""The files of a study's folder: their schema, and how they are read, with the place of a problem.

A row must be what the order of its participant's trials asks for. So a row that is missing, doubled
or changed is found, and only what was measured is taken as it stands.
"""

import csv
import io
import json
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from itertools import zip_longest
from pathlib import Path
from typing import Annotated, Any, Literal, TypeAlias, TypeVar, cast

from forcebound.errors import ConfigError
from forcebound.files import MAX_TABLE, content_of, read_bytes, read_text, reason, text_of
from forcebound.graph.fields import Field, fields_of
from forcebound.graph.forms import Form
from forcebound.graph.problems import Problems, shortened
from forcebound.graph.tree import from_plain
from forcebound.lab.engine import Row
from forcebound.lab.study.measures import Measures
from forcebound.lab.study.order import next_trial
from forcebound.lab.study.plan import StudyFile
from forcebound.quantities import CheckedText, Range
from forcebound.units import to_si

Kind: TypeAlias = Literal["person", "rehearsal", "simulated"]  # rehearsal: without a device
_Document = TypeVar("_Document")
_Number: TypeAlias = Annotated[int, Range(at_least=0, at_most=1_000_000)]
_Count: TypeAlias = Annotated[int, Range(at_least=1, at_most=1_000_000)]
_FINITE: Any = Annotated[float, Range()]
_MEASURED = _FINITE | None


def _check_time(text: str) -> None:
    try:
        is_aware = datetime.fromisoformat(text).tzinfo is not None
    except ValueError:
        is_aware = False
    if not is_aware:
        raise ConfigError(f"expected a time with its zone, got {shortened(text)!r}")


_TIME: Any = Annotated[str, CheckedText(_check_time)]

TRIALS, ABOUT, STUDY = "trials.csv", "participant.json", "study.yaml"  # of a participant
REGISTER = "study.json"  # of all of them
_OF_TOUCH: dict[str, object] = {
    **dict.fromkeys(("condition", "level", "law"), str),
    "seed": int | None,
    "touches": _Count,
    **dict.fromkeys(Measures.__dataclass_fields__, _MEASURED),
}
_HINTS: dict[str, object] = {
    "trial": _Count,
    **dict.fromkeys(("block", "phase", "kind"), str),
    **dict.fromkeys(("counted", "counted_level", "other", "other_level"), str),
    **dict.fromkeys(("counted_interval", "answer"), Literal[1, 2]),
    "chose_counted": Literal[0, 1],
    "response_time": _MEASURED,
    **dict.fromkeys(("started", "answered"), _TIME),
    **{f"{name}_{interval}": hint for interval in (1, 2) for name, hint in _OF_TOUCH.items()},
}
COLUMNS = tuple(_HINTS)
LEVELS = ("counted_level", "other_level", "level_1", "level_2")
_TEXTS = (str, _TIME)  # the others are numbers, or empty
_ROW = Form("the row", {name: Field(name, hint, True) for name, hint in _HINTS.items()})


@dataclass(frozen=True, kw_only=True)
class Register:
    """Register of a folder, which stays whichever participants leave."""

    study: str
    digest: str
    kind: Kind
    next_number: _Number = 0  # one more than the largest that was ever given


@dataclass(frozen=True, kw_only=True)
class Participant:
    """A participant; the folder has their identifier as its name."""

    participant: str
    number: _Number  # from 0; the order follows from it
    study: str
    digest: str
    kind: Kind
    sessions: tuple[dict[str, Any], ...] = ()
    observer: str = ""  # parameters of a simulated one


def read_document(file: Path, kind: type[_Document]) -> _Document:
    """Return the content of a JSON file; ConfigError with its problems and their places."""
    text, problems = read_text(file, "the data in", MAX_TABLE), Problems()
    with content_of(file):
        root = from_plain(json.loads(text), f"{file}:1", ".")  # it is written as one line
        values = Form("the file", fields_of(cast(Any, kind))).read(root, problems)
    problems.raise_if_any()
    return kind(**(values or {}))


def read_participant(folder: Path) -> Participant:
    """Return the participant of a folder; ConfigError also if it is a copy."""
    about = read_document(folder / ABOUT, Participant)
    if about.participant != folder.name:
        raise ConfigError(
            f"{folder / ABOUT}: participant: expected the name of the folder, {folder.name!r}, got"
            f" {about.participant!r}: is it a copy?"
        )
    return about


def read_trials(study: StudyFile, folder: Path, about: Participant) -> tuple[list[Row], int]:
    """Return the rows of a participant's answered trials, and how many bytes of the file they are.

    A last row without its end that is not whole, as a killed process leaves it, is passed over.

    Raises:
        ConfigError: At the first row that is damaged, or not of the trial that comes there.
    """
    file = folder / TRIALS
    try:
        data = read_bytes(file, MAX_TABLE)
    except OSError as error:
        raise ConfigError(f"cannot read {file}: {reason(error)}") from error
    whole = data[: data.rfind(b"\n") + 1]
    if data != whole:
        try:
            return _read(study, file, about, data), len(data)
        except ConfigError:
            pass  # the last row, or one that is met again now
    return _read(study, file, about, whole), len(whole)


def _read(study: StudyFile, file: Path, about: Participant, data: bytes) -> list[Row]:
    rows, text = list[Row](), io.StringIO(text_of(file, data), newline="")
    reader = csv.DictReader(text, restkey="more", strict=True)
    try:
        for name, got in zip_longest(COLUMNS, reader.fieldnames or COLUMNS):
            if name != got:
                raise ConfigError(
                    f"{file}:1: expected the column {name!r}, got {shortened(str(got))!r}"
                )
        for row in reader:
            _check(study, about, rows, row, f"{file}:{reader.line_num}")
            rows.append(row)
    except csv.Error as error:
        raise ConfigError(f"{file}:{reader.line_num}: {error}") from None
    return rows


def _check(
    study: StudyFile, about: Participant, before: Sequence[Row], row: Row, place: str
) -> None:
    """Refuse a row that is damaged, or not of the trial that comes after those before it."""
    plain = {n: one if _HINTS.get(n) in _TEXTS else _number(one) for n, one in row.items()}
    problems, trial = Problems(), next_trial(study, about.number, before)
    _ROW.read(from_plain(plain, place, "."), problems)
    problems.raise_if_any()
    if trial is None:
        raise ConfigError(f"{place}: expected no more trials: all have been answered above")
    chose = str(int(row["answer"] == row["counted_interval"]))
    expected = trial.columns | {"kind": about.kind, "chose_counted": chose}
    for name in COLUMNS:
        if name in LEVELS and row[name] != expected[name]:  # once it was written with its unit
            number = to_si(row[name])
            row[name] = row[name] if number is None else f"{number:.12g}"
        if row[name] != expected.get(name, row[name]):
            raise ConfigError(
                f"{place}.{name}: expected {expected[name]!r}, got {shortened(row[name])!r}",
                f"was a row changed, doubled or removed, or the number in {ABOUT}?",
            )


def _number(text: Any) -> Any:
    """Return the number that a cell has, nothing if it is empty, or else its text."""
    try:
        return json.loads(text) if text else None
    except (ValueError, TypeError):  # TypeError: cells that are too many
        return text
