"""User code that hangs, exits or crashes: reported, and confined to its own process."""

import json
import os
import re
import runpy
import signal
import subprocess
import sys
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from invoking import invoke
from launch_texts import GOOD, written
from waiting import TIMEOUT, until

from forcebound.bounded_child import ChildError, in_bounded_child, tried
from forcebound.errors import ConfigError
from forcebound.graph.loader import load, load_tried
from forcebound.run.check import check_part, lines

SOURCE = """\
import ctypes, os, subprocess, sys, time
from dataclasses import dataclass
from forcebound.haptics.environments import StatelessEnvironment
from forcebound.quantities import Stiffness


@dataclass(frozen=True)
class Mine(StatelessEnvironment):
    stiffness: Stiffness = 500.0

    def force(self, user, position, velocity, elapsed):
        return tuple(self.stiffness * x for x in position)
"""
ANSWER = "        return tuple"
FOR_EVER = "any(iter(int, 1))"


def own(folder: Path, code: str = "") -> tuple[Path, Path]:
    """A launch file and the environment beside it, whose answer begins with a line of code."""
    file = written(folder, SOURCE.replace(ANSWER, f"        {code}\n{ANSWER}", 1), "mine.py")
    return written(folder, GOOD.replace("kind: wall", "kind: mine.py")), file


def test_the_line_of_code_that_never_ends_is_named(tmp_path: Path) -> None:
    file = written(tmp_path, f"x = 1\n{FOR_EVER}\n", "mine.py")
    run: Any = partial(runpy.run_path, str(file))
    with pytest.raises(ConfigError) as caught:
        tried(run, [file], 3.0)
    assert f"in {file}:2: {FOR_EVER}" in str(caught.value)
    assert "took more than 3 s" in str(caught.value)


def test_a_check_finds_the_modules_that_a_launch_does(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    written(tmp_path, "x = 1\n", "beside.py")
    written(tmp_path, f"import beside\n{SOURCE}", "mine.py")
    monkeypatch.chdir(tmp_path)
    result = invoke("check", "environment", "mine.py")
    assert result.exit_code == 0, result.output


@pytest.mark.parametrize(
    ("code", "named"),
    [
        ("os._exit(0)", "exit status 0"),
        ("os.kill(os.getpid(), 9)", "signal 9, Killed"),
        ("ctypes.string_at(0)", "mine.py:12: ctypes.string_at(0)"),
        ("sys.exit(3)", "SystemExit: 3\n  in"),
        ("input()", "EOFError"),
    ],
)
def test_an_environment_that_ends_its_process_ends_no_other(
    tmp_path: Path, code: str, named: str
) -> None:
    with pytest.raises(ConfigError) as caught:
        load_tried(own(tmp_path, code)[0])
    assert named in str(caught.value)


def test_a_child_may_take_only_so_much_memory() -> None:
    with pytest.raises(ChildError, match="status 1"):
        in_bounded_child(partial(bytes, 10**10), 60.0, 10**9)


def test_what_a_function_prints_is_no_part_of_its_answer() -> None:
    prints: Any = partial(eval, "print('[1]', flush=True) or b'answer'")
    assert in_bounded_child(prints, 60.0) == b"answer"


def test_what_the_code_has_started_ends_with_the_child(tmp_path: Path) -> None:
    left = tmp_path / "left"
    code = f"open({str(left)!r}, 'w').write(str(subprocess.Popen(['sleep', '600']).pid))"
    path, _ = own(tmp_path, f"import os; os.path.exists({str(left)!r}) or {code}")
    load_tried(path)
    pid = int(left.read_text())

    def is_gone() -> bool:
        try:
            return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] in "ZX"
        except FileNotFoundError:
            return True

    until(is_gone, "the end of what the code has started")


def test_a_file_loads_to_the_same_after_it_was_tried_and_is_called_once(tmp_path: Path) -> None:
    asked = tmp_path / "asked"
    path, _ = own(tmp_path, f"os.system('printf x >> {asked}')")
    config = load_tried(path, ["law:=none"])
    assert asked.read_text() == "x"
    assert config == load(path, ["law:=none"])


def test_a_kind_of_the_package_needs_no_child(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: Any, **__: Any) -> None:
        raise AssertionError("a process was started")

    monkeypatch.setattr(subprocess, "Popen", refuse)
    assert load_tried("stiff_wall", ["law:=none"]) == load("stiff_wall", ["law:=none"])
    assert invoke("check", "environment", "wall").exit_code == 0


@pytest.mark.parametrize("command", ["launch", "simulate"])
def test_the_check_tries_some_ticks_with_the_file(tmp_path: Path, command: str) -> None:
    path, _ = own(tmp_path, "if elapsed > 0.01: raise ValueError('late')")
    assert load(path)
    result = invoke(command, path, "--check")
    assert result.exit_code == 2
    assert "in a trial of 20 ticks the environment's code failed" in result.stderr


def test_the_check_of_a_part_names_the_line_that_ends_its_process(tmp_path: Path) -> None:
    _, file = own(tmp_path, "position[0] == 10.0 and ctypes.string_at(0)")
    result = invoke("check", "environment", file)
    assert result.exit_code == 2
    assert "mine.py:12" in result.stderr


def test_a_slow_environment_is_asked_fewer_questions(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("forcebound.run.check.QUERYING", 1.0)
    monkeypatch.setattr("forcebound.run.check.TIMING", 0.2)
    _, file = own(tmp_path, "time.sleep(0.02)")
    checked = check_part("environment", str(file), [], [1, 2], is_child=True)
    assert checked.passed
    assert 1 <= checked.questions <= 1.0 / 0.02 / 2
    assert checked.seconds_per_answer is not None
    assert checked.seconds_per_answer.answers == 10
    known = checked.questions + (checked.left_out or 0)
    assert f"{checked.questions} of {known} queries" in "\n".join(lines("environment", checked))


def test_the_check_says_how_far_it_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("forcebound.cli.parts.Progress.EVERY", 0.0)
    result = invoke("check", "environment", own(tmp_path)[1], "--axes", "1", "--json")
    assert json.loads(result.stdout)["left_out"] == 0
    assert re.search(r"^7 of \d+ answers$", capfd.readouterr().err, re.MULTILINE)


@pytest.mark.live
def test_ctrl_c_ends_command_and_child(tmp_path: Path) -> None:
    begun = tmp_path / "begun"
    path, _ = own(tmp_path, f"open({str(begun)!r}, 'w').write(str(os.getpid())); time.sleep(600)")
    program = [sys.executable, "-m", "forcebound", "simulate", str(path)]
    with subprocess.Popen(program, stderr=subprocess.PIPE, text=True) as command:
        until(lambda: begun.exists() and begun.read_text(), "the first question")
        command.send_signal(signal.SIGINT)
        assert command.wait(TIMEOUT) == 130
        assert command.stderr is not None
        assert "interrupted" in command.stderr.read()
    with pytest.raises(ProcessLookupError):
        os.kill(int(begun.read_text()), 0)
