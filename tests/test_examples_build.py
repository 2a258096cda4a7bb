"""``examples/build.sh`` with stub commands: what it uses, what it skips, and why."""

import os
import shutil
import subprocess
from pathlib import Path

import pytest
from waiting import TIMEOUT
from walls import EXAMPLES

REAL = ("dirname", "env", "ls", "sh")
WORKING = ("c++", "cc", "make", "node", "npm", "pkg-config")
CRATES = Path("/usr/share/cargo/registry")


def command(folder: Path, name: str, script: str) -> None:
    folder.mkdir(exist_ok=True)
    file = folder / name
    file.write_text(f"#!/bin/sh\n{script}\n")
    file.chmod(0o755)


@pytest.fixture
def stubs(tmp_path: Path) -> Path:
    """A folder of commands: the user is root, all run, and there is no cargo."""
    folder = tmp_path / "bin"
    folder.mkdir()
    for name in REAL:
        found = shutil.which(name)
        assert found is not None
        (folder / name).symlink_to(found)
    for name in WORKING:
        command(folder, name, "exit 0")
    command(folder, "id", "echo 0")
    command(folder, "apt-get", f'echo "$@" >>{tmp_path}/installed')
    return folder


def build(folder: Path, *path: Path) -> subprocess.CompletedProcess[str]:
    shutil.copy(EXAMPLES / "build.sh", folder)
    for language in ("cpp", "javascript", "rust"):
        (folder / language).mkdir(exist_ok=True)
    return subprocess.run(
        [folder / "build.sh"],
        env={"PATH": os.pathsep.join(map(str, path))},
        capture_output=True,
        text=True,
        timeout=TIMEOUT,
    )


def installed(folder: Path) -> list[str]:
    file = folder / "installed"
    return file.read_text().split() if file.exists() else []


def test_a_cargo_that_does_not_run_is_named_and_keeps_nobody_else_from_being_built(
    tmp_path: Path, stubs: Path
) -> None:
    shim = tmp_path / "shim"
    command(shim, "cargo", "echo no default is configured >&2; exit 1")
    built = build(tmp_path, shim, stubs)
    assert built.returncode == 0
    assert "examples/cpp: built" in built.stdout
    assert "examples/javascript: built" in built.stdout
    assert "examples/rust: skipped: no cargo in PATH runs" in built.stderr
    assert "although apt-get has installed cargo gcc" in built.stderr


def test_a_cargo_that_runs_is_found_behind_one_that_does_not(tmp_path: Path, stubs: Path) -> None:
    for name in ("cargo", "rustc"):
        command(tmp_path / "shim", name, "exit 1")
        command(stubs, name, f'echo {name} "$@" >>{tmp_path}/ran')
    built = build(tmp_path, tmp_path / "shim", stubs)
    assert "cargo" not in installed(tmp_path)
    assert "no cargo" not in built.stderr
    assert built.returncode == 0
    crates = ("zmq-0", "rmp-serde-1", "serde_derive-1", "libc-0")
    has_crates = all(any(CRATES.glob(f"{crate}.*")) for crate in crates)
    assert ("cargo build" in (tmp_path / "ran").read_text()) == has_crates


def test_what_does_not_build_is_an_error(tmp_path: Path, stubs: Path) -> None:
    command(stubs, "make", 'test "$1" = --version')
    built = build(tmp_path, stubs)
    assert built.returncode == 1
    assert "examples/cpp: does not build" in built.stderr
    assert "examples/javascript: built" in built.stdout


def test_without_apt_get_what_is_missing_is_named(tmp_path: Path, stubs: Path) -> None:
    (stubs / "apt-get").unlink()
    command(stubs, "node", "exit 1")
    built = build(tmp_path, stubs)
    assert built.returncode == 0
    assert "examples/javascript: skipped: node is older than 18, or does not run" in built.stderr
    assert "there is no apt-get here" in built.stderr
