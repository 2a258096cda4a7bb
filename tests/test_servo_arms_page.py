"""docs/servo-arms.md: its programs print the numbers of its tables."""

import re
import subprocess
import sys
from pathlib import Path

import pytest
from invoking import invoke

PAGE = Path(__file__).parent.parent / "docs/servo-arms.md"
FILE = re.compile(r"^```(?:yaml|python)\n(# (\S+)\n.*?)^```$", re.MULTILINE | re.DOTALL)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with the files of the page."""
    for text, name in FILE.findall(PAGE.read_text(encoding="utf-8")):
        (tmp_path / name).write_text(text, encoding="utf-8")
    return tmp_path


def rows_of_table(first: str) -> list[list[str]]:
    """Return the cells of the table of the page whose head begins so, without the head."""
    lines = PAGE.read_text(encoding="utf-8").splitlines()
    begin = next(i for i, line in enumerate(lines) if line.startswith(f"| {first} |"))
    end = next(i for i in range(begin, len(lines)) if not lines[i])
    return [
        [cell.strip() for cell in line.strip("| ").split(" | ")] for line in lines[begin + 2 : end]
    ]


def printed(folder: Path, program: str) -> list[str]:
    done = subprocess.run(
        [sys.executable, program], cwd=folder, capture_output=True, text=True, check=True
    )
    return done.stdout.splitlines()


def test_the_rates_are_those_that_the_program_prints(folder: Path) -> None:
    lines = iter(printed(folder, "bus.py"))
    for servos, *cells in rows_of_table("servos"):
        for cell in cells:
            took, rate = re.findall(r"[\d.]+(?= ms| Hz)", cell)
            line = next(lines)
            assert line.startswith(f"{servos} servos,")
            assert line.endswith(f" {took} ms, {rate} Hz")
    assert next(lines, None) is None


def test_the_stiffnesses_are_those_that_the_program_prints(folder: Path) -> None:
    def numbers(text: str) -> list[float]:
        return [float(one) for one in re.findall(r"-?\d+\.?\d*", text)]

    once: dict[str, list[str]] = {}
    late: dict[str, list[str]] = {}
    limits: dict[str, list[float]] = {}
    found = once
    for line in printed(folder, "gains.py"):
        if "times" in line:
            found = once if line.startswith("1 ") else late
            continue
        name, *cells = re.split(r"\s+\|\s+", line)
        found[name.split()[0]] = cells
        limits[name.split()[0]] = numbers(name.partition("theory:")[2])
    for joint, gain, theory, share, stiff, none, slow in rows_of_table("joint"):
        all_of_it = float(gain)
        assert numbers(theory) == pytest.approx(limits[joint], rel=5e-3)
        assert float(share) == pytest.approx(all_of_it / limits[joint][2], abs=6e-3)
        rows = ((stiff, once[joint]), (slow, late[joint]))
        for text, cells in rows:
            stated = [all_of_it if one == "all" else float(one) for one in text.split(", ")]
            assert stated == pytest.approx([float(cell) for cell in cells[1::2]], rel=5e-3)
        assert [float(cell) for cell in once[joint][::2]] == [all_of_it] * 3  # passive, and all
        energies = [-numbers(cell)[0] for cell in late[joint][::2] if "no rest" in cell]
        if "no rest" in none:
            assert [round(min(energies)), round(max(energies))] == pytest.approx(
                numbers(none), abs=1
            )
        else:
            assert energies == []


def test_the_arm_in_a_file_is_right(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder)
    done = invoke("launch", "my_arm.yaml", "--check", "device:=emulated")
    assert done.exit_code == 0, done.output
