"""User code that hangs, exits or crashes: reported, and confined to its own process."""

import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from itertools import count
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner, Result
from launch_texts import GOOD, written
from waiting import PATIENCE, until

from forcebound.cli import main
from forcebound.config.loader import load, load_tried, try_out
from forcebound.config.sandbox import no_progress, run_in_sandbox
from forcebound.errors import ConfigError
from forcebound.launch.check import check_here, lines

SOURCE = """\
import ctypes, os, subprocess, sys, time
from dataclasses import dataclass
from forcebound.quantities import Stiffness


@dataclass(frozen=True)
class Mine:
    stiffness: Stiffness = 500.0

    def force(self, user, position, velocity, elapsed):
        return tuple(self.stiffness * x for x in position)
"""
FIRST, CLASS, ANSWER = "\n\n@dataclass", "    stiffness: ", "        return tuple"
FOR_EVER = "any(iter(int, 1))"


@pytest.fixture
def skip_time(monkeypatch: pytest.MonkeyPatch) -> Callable[[Callable[[], object]], None]:
    """Let a clock jump beyond every limit as soon as something has happened."""
    clock = time.monotonic

    def skip(happened: Callable[[], object]) -> None:
        monkeypatch.setattr(time, "monotonic", lambda: clock() + (1000.0 if happened() else 0.0))

    return skip


def hanging(folder: Path, skip_time: Callable[[Callable[[], object]], None]) -> str:
    """Code that never ends; where it is reached, time passes at once."""
    reached = folder / "reached"
    skip_time(reached.exists)
    return f"open({str(reached)!r}, 'w').close(); {FOR_EVER}"


def own(folder: Path, code: str = "", before: str = ANSWER) -> tuple[Path, Path]:
    """A launch file and the environment beside it, with a line of code before another."""
    indent = re.match(r"\n*( *)", before)
    assert indent is not None
    source = SOURCE.replace(before, f"{indent[0]}{code}\n{before}", 1)
    file = written(folder, source, "mine.py")
    return written(folder, GOOD.replace("kind: wall", "kind: mine.py")), file


def error_of(folder: Path, code: str, before: str = ANSWER) -> str:
    path, file = own(folder, code, before)
    with pytest.raises(ConfigError) as caught:
        run_in_sandbox(try_out, [str(path), []], [file])
    return str(caught.value)


def invoke(*words: object) -> Result:
    return CliRunner().invoke(main, [str(word) for word in words], catch_exceptions=False)


@pytest.mark.parametrize(
    "before",
    [
        pytest.param(FIRST, marks=pytest.mark.slow),
        pytest.param(CLASS, marks=pytest.mark.slow),
        ANSWER,
    ],
)
def test_what_never_ends_is_told_with_its_line(
    tmp_path: Path, before: str, skip_time: Callable[[Callable[[], object]], None]
) -> None:
    code = hanging(tmp_path, skip_time)
    message = error_of(tmp_path, code, before)
    assert "mine.py: loading it and calling it once took more than 60 s" in message
    assert re.search(rf"in {tmp_path}/mine.py:\d+: {re.escape(code)}", message)
    assert "Does a loop never end?" in message


@pytest.mark.parametrize(
    ("code", "message"),
    [
        ("os._exit(3)", "ended the process (exit status 3): expected an answer"),
        ("os._exit(0)", "ended the process (exit status 0): expected an answer"),
        ("os.kill(os.getpid(), 9)", "ended the process (signal 9, Killed)"),
        ("ctypes.string_at(0)", "(signal 11, Segmentation fault): expected an answer\n  in "),
        ("ctypes.string_at(0)", "mine.py:11: ctypes.string_at(0)"),
        ("sys.exit(3)", "graph.yaml:13:9: environment: force((0.0,), (0.0,), 0.0): SystemExit: 3"),
        ("1 / 0", "mine.py:11: 1 / 0"),
        ("input()", "EOFError"),
    ],
)
def test_an_environment_that_ends_its_process_ends_no_other(
    tmp_path: Path, code: str, message: str
) -> None:
    assert message in error_of(tmp_path, code)


def test_what_a_file_prints_does_not_get_into_the_result(tmp_path: Path) -> None:
    path, file = own(tmp_path, "print('[1]', flush=True)")
    assert run_in_sandbox(try_out, [str(path), []], [file]) is None


def test_what_the_code_has_started_ends_with_the_child(tmp_path: Path) -> None:
    left = tmp_path / "left"
    code = f"open({str(left)!r}, 'w').write(str(subprocess.Popen(['sleep', '600']).pid))"
    path, file = own(tmp_path, code)
    run_in_sandbox(try_out, [str(path), []], [file])  # although that process has our pipe
    pid = int(left.read_text())

    def is_gone() -> bool:
        try:
            return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] in "ZX"
        except FileNotFoundError:
            return True

    until(is_gone, "the end of what the code has started")


def test_a_file_of_ones_own_loads_to_the_same_after_it_was_tried(tmp_path: Path) -> None:
    path, _ = own(tmp_path)
    assert load_tried(path, ["law:=none"]) == load(path, ["law:=none"])


def test_this_process_asks_nothing_of_what_was_asked_run_in_sandbox(tmp_path: Path) -> None:
    asked = tmp_path / "asked"
    path, _ = own(tmp_path, f"open({str(asked)!r}, 'a').write('x')")
    load_tried(path)
    assert asked.read_text() == "x"


def test_a_kind_of_the_package_needs_no_child(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: Any, **__: Any) -> None:
        raise AssertionError("a process was started")

    monkeypatch.setattr(subprocess, "Popen", refuse)
    assert load_tried("stiff_wall", ["law:=none"]) == load("stiff_wall", ["law:=none"])
    assert invoke("check", "environment", "wall").exit_code == 0


def test_who_waits_long_is_told_for_what_once(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
    skip_time: Callable[[Callable[[], object]], None],
) -> None:
    monkeypatch.setattr("forcebound.config.sandbox.REMARK", 0.0)
    message = "mine.py: loading it and calling it once takes long; it may take 60 s"
    looks = count()
    skip_time(lambda: message in caplog.messages and next(looks) > 10)
    error_of(tmp_path, FOR_EVER)
    said = caplog.messages
    assert said.count(message) == 1
    assert len(said) == len(set(said))
    monkeypatch.setattr("forcebound.config.sandbox.REMARK", 60.0)
    caplog.clear()
    error_of(tmp_path, "os._exit(3)")
    assert not caplog.records


@pytest.mark.parametrize("command", ["launch", "simulate"])
def test_the_commands_that_run_a_graph_say_what_the_file_did(tmp_path: Path, command: str) -> None:
    path, _ = own(tmp_path, "os._exit(3)")
    result = invoke(command, path, "--check")
    assert result.exit_code == 2
    assert "mine.py: loading it and calling it once ended the process" in result.stderr


def test_the_check_tries_some_ticks_with_the_file(tmp_path: Path) -> None:
    path, _ = own(tmp_path, "if elapsed > 0.01: raise ValueError('late')")
    assert load(path)
    for command in ("launch", "simulate"):
        result = invoke(command, path, "--check")
        assert result.exit_code == 2
        assert "in a trial of 20 ticks the environment's code failed" in result.stderr


def test_the_check_says_at_which_question_it_stopped(
    tmp_path: Path, skip_time: Callable[[Callable[[], object]], None]
) -> None:
    _, file = own(tmp_path, "if position[0] == 1e6: os._exit(3)")
    result = invoke("check", "environment", file)
    assert result.exit_code == 2
    assert "force((1000000.0,), (0.0,), 0.0) ended the process (exit status 3)" in result.stderr
    _, file = own(tmp_path, f"if position[0] == 1e6: {hanging(tmp_path, skip_time)}")
    with pytest.raises(ConfigError, match=r"force\(\(1000000.0,\), .* took more than 10 s"):
        run_in_sandbox(check_here, ["environment", str(file), [], [1]], [file])


def test_a_slow_environment_is_asked_fewer_questions(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("forcebound.launch.check.QUERYING", 1.0)
    monkeypatch.setattr("forcebound.launch.check.TIMING", 0.2)
    _, file = own(tmp_path, "time.sleep(0.02)")
    document = check_here(no_progress, "environment", str(file), [], [1, 2])
    assert document["passed"]
    assert 1 <= document["questions"] <= 1.0 / 0.02 / 2
    assert document["seconds_per_answer"]["answers"] == 10
    known = document["questions"] + document["left_out"]
    assert f"{document['questions']} of {known} queries" in "\n".join(
        lines("environment", document)
    )


def test_the_check_says_how_far_it_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("forcebound.cli.check.Progress.EVERY", 0.0)
    result = invoke("check", "environment", own(tmp_path)[1], "--axes", "1", "--json")
    assert json.loads(result.stdout)["left_out"] == 0
    assert re.search(r"^7 of \d+ answers$", result.stderr, re.MULTILINE)


@pytest.mark.live
def test_ctrl_c_ends_command_and_child(tmp_path: Path) -> None:
    begun = tmp_path / "begun"
    path, _ = own(tmp_path, f"open({str(begun)!r}, 'w').write(str(os.getpid())); time.sleep(600)")
    program = [sys.executable, "-m", "forcebound", "simulate", str(path)]
    with subprocess.Popen(program, stderr=subprocess.PIPE, text=True) as command:
        until(lambda: begun.exists() and begun.read_text(), "the first question")
        command.send_signal(signal.SIGINT)
        assert command.wait(PATIENCE) == 130
        assert command.stderr is not None
        assert "interrupted" in command.stderr.read()
    with pytest.raises(ProcessLookupError):
        os.kill(int(begun.read_text()), 0)
