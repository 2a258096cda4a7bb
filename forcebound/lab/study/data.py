"""The files of a study's folder: their schema, and how they are read, with the place of a problem.

A row must be what the order of its participant's trials asks for. So a row that is missing, doubled
or changed is found, and only what was measured is taken as it stands.
"""

import csv
import io
import json
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate
from pathlib import Path
from typing import Annotated, Any, Literal, TypeAlias, TypeVar, cast

from pydantic import AwareDatetime, FiniteFloat

from forcebound.errors import ConfigError
from forcebound.files import MAX_TABLE, content_of, read_bytes, read_text, reason, text_of
from forcebound.graph.fields import Field, fields_of
from forcebound.graph.forms import Form
from forcebound.graph.problems import Place, Problems
from forcebound.graph.tree import Value, from_plain
from forcebound.lab.engine import Row
from forcebound.lab.study.measures import Measures
from forcebound.lab.study.order import next_trial
from forcebound.lab.study.plan import StudyFile
from forcebound.quantities import Range

Kind: TypeAlias = Literal["person", "rehearsal", "simulated"]  # rehearsal: without a device
_Document = TypeVar("_Document")
_Number: TypeAlias = Annotated[int, Range(at_least=0, at_most=1_000_000)]
_Count: TypeAlias = Annotated[int, Range(at_least=1, at_most=1_000_000)]

TRIALS, ABOUT, STUDY = "trials.csv", "participant.json", "study.yaml"  # of a participant
REGISTER = "study.json"  # of all of them
_OF_TOUCH: dict[str, Any] = {
    **dict.fromkeys(("condition", "level", "law"), str),
    "seed": int | None,
    "touches": _Count,
    **dict.fromkeys(Measures.__dataclass_fields__, FiniteFloat | None),
}
_HINTS: dict[str, Any] = {
    "trial": _Count,
    **dict.fromkeys(("block", "phase", "kind"), str),
    **dict.fromkeys(("counted", "counted_level", "other", "other_level"), str),
    **dict.fromkeys(("counted_interval", "answer"), Literal[1, 2]),
    "chose_counted": Literal[0, 1],
    "response_time": FiniteFloat | None,
    **dict.fromkeys(("started", "answered"), AwareDatetime),
    **{f"{name}_{interval}": hint for interval in (1, 2) for name, hint in _OF_TOUCH.items()},
}
COLUMNS = tuple(_HINTS)
_TEXTS = (str, AwareDatetime)  # the others are numbers, or empty
_ROW = Form("the row", {name: Field(name, hint, True) for name, hint in _HINTS.items()})


@dataclass(frozen=True, kw_only=True)
class Register:
    """What a folder keeps of its study, whichever participants leave."""

    study: str
    digest: str
    kind: Kind
    next_number: _Number = 0  # one more than the largest that was ever given


@dataclass(frozen=True, kw_only=True)
class Participant:
    """What is known of a participant; the folder has their identifier as its name."""

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
        root = from_plain(json.loads(text), str(file))
        values = Form("the file", fields_of(cast(Any, kind))).read(root, problems)
    problems.raise_if_any()
    return kind(**(values or {}))


def read_participant(folder: Path) -> Participant:
    """Return what a participant's folder says of them; ConfigError also if it is a copy."""
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
    text, rows, problems = text_of(file, data), list[Row](), Problems()
    lines, reader = text.splitlines(), csv.reader(io.StringIO(text, newline=""), strict=True)
    known: Sequence[str] = ()
    try:
        for cells in reader:
            number = reader.line_num
            places = [
                Place(str(file), number, 1 + start, lines[number - 1])
                for start in accumulate((len(one) + 1 for one in cells), initial=0)
            ]
            if len(cells) != len(COLUMNS):
                words = f"expected {len(COLUMNS)} columns, got {len(cells)}"
                problems.add(words, places[0])
            elif known:
                rows.append(_row(study, about, rows, cells, places, problems))
            else:
                known = cells
                for asked, got, place in zip(COLUMNS, cells, places, strict=False):
                    if asked != got:
                        problems.add(f"expected the column {asked!r}, got {got!r}", place)
            problems.raise_if_any()
    except csv.Error as error:
        raise ConfigError(f"{file}:{reader.line_num}: {error}") from None
    return rows


def _row(
    study: StudyFile,
    about: Participant,
    before: Sequence[Row],
    cells: Sequence[str],
    places: Sequence[Place],
    problems: Problems,
) -> Row:
    """Return a row by column, with the first of its problems noted."""
    row = dict(zip(COLUMNS, cells, strict=True))
    named = zip(_HINTS.items(), cells, places, strict=False)
    tree = {
        name: Value(text if hint in _TEXTS else _number(text), place, text=text)
        for (name, hint), text, place in named
    }
    if _ROW.read(Value(tree, places[0]), problems) is None:
        return row
    trial = next_trial(study, about.number, before)
    if trial is None:
        problems.add("expected no more trials: all have been answered above", places[0])
        return row
    chose = str(int(row["answer"] == row["counted_interval"]))
    expected = trial.columns | {"kind": about.kind, "chose_counted": chose}
    for name in COLUMNS:
        if row[name] != expected.get(name, row[name]):
            words = f"{name}: expected {expected[name]!r}, got {row[name]!r}"
            hint = f"was a row changed, doubled or removed, or the number in {ABOUT}?"
            problems.add(f"{words}; {hint}", tree[name].place)
            break
    return row


def _number(text: str) -> Any:
    """Return the number that a cell has, nothing if it is empty, or else its text."""
    try:
        return json.loads(text) if text else None
    except ValueError:
        return text
