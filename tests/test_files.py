"""Files from outside: what is no file is refused at once; limits; names that can be printed."""

import os
from collections.abc import Callable
from pathlib import Path

import pytest
from launch_texts import GOOD, written

from forcebound.errors import ConfigError
from forcebound.files import MAX_TABLE, check_writable, printable, read_rows
from forcebound.graph.loader import load
from forcebound.graph.parts import law_of
from forcebound.haptics.hands.paths import TrajectoryHand
from forcebound.lab.sweep.plan import load_sweep
from forcebound.lab.table import read_table
from forcebound.network.keys import list_keys, new_key, public_key
from forcebound.recordings.delay_traces import read_trace
from forcebound.recordings.recording import read

# s; on a machine under load, far more than a refusal needs; a test must not wait for ever.
pytestmark = pytest.mark.timeout(60)


def including(path: Path) -> object:
    return load(written(path.parent, f"include: {path.name}\n{GOOD}", "above.yaml"))


READERS: dict[str, Callable[[Path], object]] = {
    "launch file": load,
    "include": including,
    "trace": read_trace,
    "trajectory": TrajectoryHand,
    "recording": read,
    "sweep": load_sweep,
    "result": read_table,
    "law": lambda path: law_of(f"{path}.py"),
}

ENDINGS = {"trace": ".csv", "recording": ".mcap", "law": ""}


def pipe(path: Path) -> None:
    os.mkfifo(path)


@pytest.mark.parametrize("reader", READERS)
@pytest.mark.parametrize(
    ("make", "kind"),
    [
        (pipe, "it is a pipe"),
        (Path.mkdir, "it is a folder"),
        (lambda path: path.symlink_to("/dev/zero"), "a device, not a file"),
        (lambda path: path.symlink_to(path.name), "Too many levels of symbolic links"),
    ],
)
def test_what_is_no_file_is_refused_at_once(
    tmp_path: Path, reader: str, make: Callable[[Path], None], kind: str
) -> None:
    path = tmp_path / f"x{ENDINGS.get(reader, '.yaml')}"
    make(path.with_suffix(".py") if reader == "law" else path)
    with pytest.raises(ConfigError) as caught:
        READERS[reader](path)
    if "symbolic" in kind:
        assert "there is no" in str(caught.value) or kind in str(caught.value)
    else:
        assert kind in str(caught.value)


def test_a_file_that_is_too_large_is_refused_unread(tmp_path: Path) -> None:
    path = tmp_path / "large.csv"
    with path.open("wb") as file:
        file.truncate(MAX_TABLE + 1)
    with pytest.raises(ConfigError, match=r"large\.csv: it has more than 100000000 bytes"):
        next(read_rows(path, "the trace"))


def test_rows_have_their_lines_whatever_ends_them(tmp_path: Path) -> None:
    path = written(tmp_path, b'\xef\xbb\xbfa,"b"\r\n\r\n1,2\r3,4\n\n5', "rows.csv")
    rows = [(place.rpartition(":")[2], row) for place, row in read_rows(path, "the table")]
    assert rows == [("1", ["a", "b"]), ("3", ["1", "2"]), ("4", ["3", "4"]), ("6", ["5"])]


def test_a_file_that_cannot_be_written_is_told_before_the_work(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="there is no folder"):
        check_writable(tmp_path / "no" / "file", "the page")
    with pytest.raises(ConfigError, match="it is a folder"):
        check_writable(tmp_path, "the page")
    check_writable(tmp_path / "new", "the page")


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("wall µ 壁", "wall µ 壁"),
        ("two\nlines\tand a tab", "two\nlines\tand a tab"),
        ("\x1b[2Jred\r\x07", r"\x1b[2Jred\r\x07"),
        ("left\u202ethgir", r"left\u202ethgir"),
    ],
)
def test_a_name_is_shown_without_what_steers_a_terminal(text: str, shown: str) -> None:
    assert printable(text) == shown


def test_a_long_name_is_cut() -> None:
    assert printable("x" * 100, 10) == "xxxxxxx..."


def test_a_key_that_is_no_file_does_not_hide_the_others(tmp_path: Path) -> None:
    made = new_key("lab", tmp_path)
    os.mkfifo(tmp_path / "pipe.key", 0o600)
    with pytest.raises(ConfigError, match="not a file"):
        public_key("pipe", tmp_path)
    assert {entry.name: entry.public for entry in list_keys(tmp_path)} == {
        "lab": made.public,
        "pipe": "",
    }
