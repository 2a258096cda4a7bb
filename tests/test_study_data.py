"""Damaged data of a study: read right, or refused with the file's name; never a traceback.

A seeded generator damages files and folders; each is then analysed, and its session opened again.
"""

import csv
import io
import json
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from random import Random
from types import SimpleNamespace
from typing import Any, TypeVar

import pytest
from test_user_study import SHORT, STAIRCASE, advance, study_of, with_method

from forcebound.errors import ConfigError
from forcebound.lab.study import analysis
from forcebound.lab.study.analysis import load_data
from forcebound.lab.study.data import ABOUT, COLUMNS, LEVELS, REGISTER, TRIALS
from forcebound.lab.study.plan import Study
from forcebound.lab.study.session import Session

Result = TypeVar("Result")
PEOPLE = ("p1", "p2", "p3")
VALUES: list[Any] = [
    None,
    True,
    -1,
    0,
    1,
    2,
    1.5,
    10**30,
    float("nan"),
    "",
    "x",
    "1",
    "\ud800",
    [],
    {},
    [1],
]
CELLS = ["", "x", "0", "3", "-1", "1.5", "1e3", "nan", "inf", "1e999", "0x1", "01", "+1", " 1"]
CELLS += [
    "true",
    "[1]",
    "\u0663",
    "\x00",
    "a\nb",
    '"',
    "9" * 5000,
    "p1",
    "slow",
    "friction",
    "x" * 200_000,
]
#: What was measured, and so may be any number: the order asks for all else.
FREE = {"response_time", "started", "answered"} | {
    f"{name}_{place}"
    for name in ("law", "seed", "touches", "speed", "penetration", "force", "stiffness")
    for place in (1, 2)
}


@pytest.fixture(scope="module", params=["forced choice", "staircase"])
def made(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Study, Path]:
    folder, random = tmp_path_factory.mktemp("made"), Random(1)
    climbs = STAIRCASE.replace("step:", "most: 5, step:")
    study = study_of(SHORT if request.param == "forced choice" else with_method(climbs), folder)
    for name in PEOPLE:
        with Session(study, folder / "data", name) as session:
            while session.step.kind != "finished":
                advance(session, 1, random.choice((1, 2)))
    return study, folder / "data"


def damaged_bytes(data: bytes, random: Random) -> bytes:
    """What a disk, an editor or a slip of the finger makes of a file."""
    at = random.randrange(len(data))
    return random.choice(
        [
            b"",
            data[:at],
            data[:at] + bytes([random.randrange(256)]) + data[at + 1 :],
            data[:at] + data[at + 1 :],
            data + data,
            b"\xef\xbb\xbf" + data,
            data.replace(b"\n", b"\r\n"),
            data.rstrip(),
            data.replace(b",", b";"),
            b"\x00" * len(data),
            b"[" * 100_000,
        ]
    )


def damaged_about(data: bytes, random: Random) -> bytes:
    about: dict[str, Any] = json.loads(data)
    key = random.choice(list(about))
    if random.random() < 0.2:
        about.pop(key)
    elif random.random() < 0.1:
        about["another"] = 1
    else:
        about[key] = random.choice(VALUES)
    return json.dumps(about).encode()


def damaged_rows(data: bytes, random: Random) -> bytes:
    rows = list(csv.reader(io.StringIO(data.decode(), newline="")))
    one, other = random.randrange(len(rows)), random.randrange(1, len(rows))
    column = random.randrange(len(COLUMNS))
    match random.choice(["cell"] * 8 + ["double", "remove", "swap", "short", "long", "column"]):
        case "cell":
            rows[other][column] = random.choice([*CELLS, rows[one][column]])
        case "double":
            rows.insert(one, rows[other])
        case "remove":
            rows.pop(one)
        case "swap":
            rows[one], rows[other] = rows[other], rows[one]
        case "short":
            rows[one].pop(column)
        case "long":
            rows[one].insert(column, "1")
        case "column":
            rows = [row[:column] + row[column + 1 :] for row in rows]
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue().encode()


def damage(folder: Path, random: Random) -> tuple[Path, str]:
    """Damage one file of the folder, or what it is called; return it and what its error names."""
    own = folder / random.choice(PEOPLE)
    other = folder / random.choice([name for name in PEOPLE if name != own.name])
    file = own / random.choice([ABOUT, TRIALS])
    change: Callable[[bytes, Random], bytes]
    match random.choice(["rows"] * 6 + ["about"] * 4 + ["bytes"] * 4 + ["file"] * 2 + ["folder"]):
        case "rows":
            file, change = own / TRIALS, damaged_rows
        case "about":
            file, change = own / ABOUT, damaged_about
        case "bytes":
            change = damaged_bytes
        case "file":
            name = file.name
            if random.random() < 0.3:
                file.unlink()
            elif random.random() < 0.3:
                file.unlink()
                file.mkdir()
            else:
                shutil.copy(other / name, file)
            return own, name if name == TRIALS else own.name
        case _:
            if random.random() < 0.5:
                shutil.copytree(own, folder / "p9")
                return folder / "p9", "p9"
            own.rename(folder / "p9")
            return folder / "p9", "p9"
    file.write_bytes(change(file.read_bytes(), random))
    return own, file.name


def as_written(folder: Path) -> list[dict[str, str]]:
    """The whole rows of a file, by a reader of no schema."""
    data = (folder / TRIALS).read_bytes()
    whole = data if data.endswith(b"\n") else data[: data.rfind(b"\n") + 1] or data
    text = io.StringIO(whole.decode("utf-8-sig"), newline="")
    return list(csv.DictReader(text))


def assert_equal(found: list[dict[str, Any]], own: Path, original: list[dict[str, str]]) -> None:
    """What was read is what the file says, and of what is not measured what was written."""
    written = as_written(own)[: len(found)]
    assert len(written) >= len(found) - 1  # the last may have no end
    for read, row in zip(found, written, strict=False):
        assert {name: read[name] for name in COLUMNS} == row
    for read, row in zip(found, original, strict=False):
        assert {n: read[n] for n in COLUMNS if n not in FREE} == {
            n: row[n] for n in COLUMNS if n not in FREE
        }
    assert len(found) <= len(original)


def main_rows(folder: Path) -> list[dict[str, str]]:
    return [row for row in as_written(folder) if row["phase"] == "main"]


@pytest.mark.parametrize("seed", range(120))
def test_damaged_data_are_read_right_or_refused_by_name(
    seed: int, made: tuple[Study, Path], tmp_path: Path
) -> None:
    study, whole = made
    folder = tmp_path / "data"
    shutil.copytree(whole, folder)
    own, named = damage(folder, Random(seed))
    original = as_written(whole / own.name) if own.name in PEOPLE else []
    before = {file: file.read_bytes() for file in own.rglob("*") if file.is_file()}
    data, refusal = tried(lambda: load_data(folder))
    if data is None:
        assert named in refusal
        assert own.name in refusal
    else:
        people = analysis.by_participant(data.rows)
        for name in PEOPLE:
            if name != own.name:
                found = [{key: row[key] for key in COLUMNS} for row in people[name]]
                assert found == main_rows(whole / name)
        analysis.checks(data)
        for group in data.groups.values():
            analysis.shares(group)
            analysis.expected_share(group, 0.23, 0.02)
    session, refusal = tried(lambda: Session(study, folder, own.name))
    if session is None:
        assert own.name in refusal
        assert before == {file: file.read_bytes() for file in before}  # nothing is lost
    else:
        with session:
            assert_equal(session.rows, own, original)
            assert data is not None
            mains = [row for row in session.rows if row["phase"] == "main"]
            assert len(mains) == len(people.get(own.name, ()))


def tried(work: Callable[[], Result]) -> tuple[Result | None, str]:
    """What a work returns; or the words with which it refuses."""
    try:
        return work(), ""
    except ConfigError as error:
        return None, str(error)


def test_a_row_that_was_removed_is_named_with_what_was_expected_there(
    made: tuple[Study, Path], tmp_path: Path
) -> None:
    folder = tmp_path / "data"
    shutil.copytree(made[1], folder)
    file = folder / "p2" / TRIALS
    lines = file.read_text().splitlines(keepends=True)
    file.write_text("".join(lines[:2] + lines[3:]))
    (folder / "p3" / ABOUT).write_text("{}")
    with pytest.raises(ConfigError) as caught:
        load_data(folder)
    assert f"{file}:3.trial: expected '2', got '3'" in str(caught.value)
    assert f"{folder / 'p3' / ABOUT}:1: the file needs 'number'" in str(caught.value)


@pytest.mark.parametrize(
    ("column", "value", "expected"),
    [
        ("answer", "3", "1 or 2"),
        ("speed_1", "fast", "a number"),
        ("speed_1", 400 * "9", "a number"),
        ("block", "fst", "'slow'"),
    ],
)
def test_a_cell_is_named_with_what_was_expected_and_what_came(
    column: str, value: str, expected: str, made: tuple[Study, Path], tmp_path: Path
) -> None:
    folder = tmp_path / "data"
    shutil.copytree(made[1], folder)
    file = folder / "p1" / TRIALS
    rows = as_written(file.parent)
    rows[0][column] = value
    with file.open("w", newline="") as out:
        writer = csv.DictWriter(out, COLUMNS)
        writer.writeheader()
        writer.writerows(rows)
    with pytest.raises(ConfigError) as caught:
        load_data(folder)
    assert f"{file}:2.{column}: expected {expected}" in str(caught.value)
    assert f"got {value[:50]!r}"[:-1] in str(caught.value)


def test_levels_that_were_written_with_their_unit_are_read(
    made: tuple[Study, Path], tmp_path: Path
) -> None:
    folder = tmp_path / "data"
    shutil.copytree(made[1], folder)
    new = load_data(folder)
    for name in PEOPLE:
        rows = as_written(folder / name)
        for row in rows:
            for key in (one for one in LEVELS if row[one]):
                row[key] = f"{float(row[key]) / 1e3:.12g} N/mm"
        with (folder / name / TRIALS).open("w", newline="") as out:
            writer = csv.DictWriter(out, COLUMNS)
            writer.writeheader()
            writer.writerows(rows)
    assert load_data(folder).rows == new.rows


def test_a_number_is_never_given_twice(made: tuple[Study, Path], tmp_path: Path) -> None:
    study, folder = made[0], tmp_path / "data"
    numbers = []
    for name in ("p1", "p2", "p3", "p4"):
        with Session(study, folder, name) as session:
            numbers.append(session.number)
        shutil.rmtree(folder / name)
    assert numbers == [0, 1, 2, 3]


def test_a_folder_without_a_register_goes_on_with_the_numbers_of_its_participants(
    made: tuple[Study, Path], tmp_path: Path
) -> None:
    folder = tmp_path / "data"
    shutil.copytree(made[1], folder)
    (folder / REGISTER).unlink()
    shutil.rmtree(folder / "p1")
    with Session(made[0], folder, "p4") as session:
        assert session.number == 3


def test_participants_of_several_kinds_are_not_analysed_together(
    made: tuple[Study, Path], tmp_path: Path
) -> None:
    with Session(made[0], tmp_path / "rehearsals", "p9", "rehearsal") as session:
        advance(session)
    shutil.copytree(made[1], tmp_path / "data")
    shutil.copytree(tmp_path / "rehearsals" / "p9", tmp_path / "data" / "p9")
    with pytest.raises(ConfigError, match=r"kind: .*'person' of p1, p2, p3; 'rehearsal' of p9"):
        load_data(tmp_path / "data")


def test_a_start_that_is_refused_uses_up_no_number(
    made: tuple[Study, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    usage = SimpleNamespace(free=0)
    with monkeypatch.context() as patched:
        patched.setattr("forcebound.lab.study.session.shutil.disk_usage", lambda path: usage)
        with pytest.raises(ConfigError):
            Session(made[0], tmp_path / "data", "p1")
    with Session(made[0], tmp_path / "data", "p2") as session:
        assert session.number == 0


def test_git_does_not_take_the_data_of_people(made: tuple[Study, Path], tmp_path: Path) -> None:
    subprocess.run(["git", "init", "-q", tmp_path], check=True)
    shutil.copytree(made[1], tmp_path / "data")
    status = ["git", "-C", str(tmp_path), "status", "--porcelain", "--untracked-files=all"]
    (tmp_path / "seen").touch()
    assert subprocess.run(status, capture_output=True, text=True, check=True).stdout == "?? seen\n"


def test_lock_is_an_identifier_as_any_other(made: tuple[Study, Path], tmp_path: Path) -> None:
    for number, name in enumerate(("lock", "study", "p1")):
        with Session(made[0], tmp_path / "data", name) as session:
            assert session.number == number


def test_a_participant_who_has_not_finished_is_named_in_the_checks(
    made: tuple[Study, Path], tmp_path: Path
) -> None:
    folder = tmp_path / "data"
    shutil.copytree(made[1], folder)
    assert analysis.checks(load_data(folder))["participants with trials left"] == "none"
    file = folder / "p2" / TRIALS
    file.write_text("".join(file.read_text().splitlines(keepends=True)[:-1]))
    assert analysis.checks(load_data(folder))["participants with trials left"] == "p2"
