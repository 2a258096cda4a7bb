"""The first hour: completion in a shell, and a folder to begin with."""

import os
import shutil
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest
from click.testing import CliRunner

from forcebound.cli import main
from forcebound.graph.document import GROUPS


def invoked(*words: str) -> "tuple[int, str]":
    done = CliRunner().invoke(main, list(words))
    return done.exit_code, done.output


def offered(tmp_path: Path, line: str) -> list[str]:
    """What bash has after the user has typed a line and presses Tab."""
    command = tmp_path / "forcebound"
    command.write_text(f"#!{sys.executable}\nfrom forcebound.__main__ import main\nmain()\n")
    command.chmod(0o755)
    (tmp_path / "sub").mkdir()
    (tmp_path / "sub/my_wall.yaml").touch()
    (tmp_path / "run.mcap").touch()
    _, script = invoked("completion", "bash", "--print")
    (tmp_path / "script").write_text(script)
    # As readline cuts it: at blanks, and around : and =.
    words = 'read -ra COMP_WORDS <<< "$(sed -E "s/([:=]+)/ \\1 /g" <<< "$COMP_LINE")"'
    program = f"""
        COMP_LINE={line!r}; COMP_POINT={len(line)}
        {words}
        [[ "$COMP_LINE" == *" " ]] && COMP_WORDS+=("")
        COMP_CWORD=$((${{#COMP_WORDS[@]}} - 1))
        compopt() {{ :; }}
        source {tmp_path}/script
        _forcebound_completion forcebound
        printf '%s\\n' "${{COMPREPLY[@]}}"
    """
    done = subprocess.run(
        ["bash", "-c", program],
        env={**os.environ, "PATH": f"{tmp_path}:{os.environ['PATH']}"},
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout.split()


@pytest.mark.skipif(shutil.which("bash") is None, reason="needs bash")
@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("forcebound sim", ["simulate"]),
        ("forcebound simulate stiff", ["stiff_wall"]),
        ("forcebound simulate stiff_wall la", ["law:="]),
        ("forcebound simulate stiff_wall law:=cert", ["certified", "certified_fading"]),
        ("forcebound simulate stiff_wall stiffness:=", ["10N/mm"]),
        ("forcebound simulate stiff_wall delay:=2ms stiffn", ["stiffness:="]),
        ("forcebound simulate no_such_file x", []),
        ("forcebound simulate sub/", ["sub/my_wall.yaml"]),
        ("forcebound plot r", ["run.mcap"]),
        ("forcebound map r", []),  # a file of any name: the shell's own matter
        ("forcebound echo tele", ["telemetry"]),
        ("forcebound echo telemetry --field comm", ["commanded_force"]),
        ("forcebound stop env", ["environment"]),
    ],
)
def test_bash_completes_commands_files_arguments_laws_and_topics(
    tmp_path: Path, line: str, expected: list[str]
) -> None:
    assert offered(tmp_path, line) == expected


@pytest.mark.parametrize(
    ("shell", "place"),
    [
        ("bash", ".local/share/bash-completion/completions/forcebound"),
        ("zsh", ".zfunc/_forcebound"),
        ("fish", ".config/fish/completions/forcebound.fish"),
    ],
)
def test_completion_is_installed_where_the_shell_looks(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, shell: str, place: str
) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    status, told = invoked("completion", shell)
    assert status == 0
    assert str(tmp_path / place) in told
    assert "_FORCEBOUND_COMPLETE" in (tmp_path / place).read_text()


def test_a_new_folder_runs_and_is_not_written_over(tmp_path: Path) -> None:
    folder = tmp_path / "mine"
    status, told = invoked("new", str(folder))
    assert status == 0
    assert f"forcebound simulate {folder}/my_environment.yaml" in told
    status, told = invoked("simulate", str(folder / "my_environment.yaml"), "--duration", "0.2s")
    assert status == 0, told
    status, told = invoked("new", str(folder))
    assert status == 2
    assert "has my_environment.yaml, my_environment.py, test_my_environment.py already" in told


def test_the_tests_in_a_new_folder_pass_and_see_a_force_of_the_opposite_sign(
    tmp_path: Path,
) -> None:
    invoked("new", str(tmp_path))
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "."]
    assert subprocess.run(command, cwd=tmp_path, capture_output=True).returncode == 0
    world = tmp_path / "my_environment.py"
    world.write_text(world.read_text().replace("damping * v - push", "damping * v + push"))
    failed = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert "2 failed" in failed.stdout
    assert "resists: resists a press into it" in failed.stdout


def test_an_interrupt_after_the_command_has_ended_leaves_its_exit_status() -> None:
    program = """
        import os, signal, sys
        from forcebound.__main__ import main

        sys.argv = ["forcebound", "--version"]
        try:
            main()
        finally:
            os.kill(os.getpid(), signal.SIGINT)
    """
    command = [sys.executable, "-c", textwrap.dedent(program)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


def test_without_a_name_launch_lists_its_files_in_groups() -> None:
    status, text = invoked("launch")
    assert status == 2
    heads = [line.rstrip(":") for line in text.split("\n") if line.endswith(":") and line[0] != " "]
    assert heads[-len(GROUPS) :] == list(GROUPS)
    (pages,) = (block for block in text.split("\n\n") if block.startswith("pages:"))
    assert [line.split()[0] for line in pages.split("\n")[1:]] == GROUPS["pages"]


def test_the_hint_at_all_figures_comes_three_times_and_never_in_json(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("forcebound.cli.outcome.cache_folder", lambda name: tmp_path)
    run = ("simulate", "stiff_wall", "--duration", "0.2s")
    assert "All figures" not in invoked(*run, "--json")[1]
    assert ["All figures" in invoked(*run)[1] for _ in range(4)] == [True, True, True, False]
    monkeypatch.setattr("forcebound.cli.outcome.cache_folder", lambda name: None)
    assert "All figures" in invoked(*run)[1]
