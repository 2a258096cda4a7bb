"""The cache of compiled kernels: a changed callee counts, an unrelated file or path does not."""

import os
import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

import forcebound

KERNEL = """
from forcebound.compiled import jit
from forcebound.sample_constants import (
    FACTOR,
)

def scale(x):
    return FACTOR * x

print(jit(scale)(2.0))
"""


@pytest.fixture
def package(tmp_path: Path) -> Path:
    """A folder in which a few files of the package stand, with a kernel beside them."""
    source, copy = Path(forcebound.__file__).parent, tmp_path / "forcebound"
    copy.mkdir()
    for name in ("compiled.py", "errors.py", "folders.py"):
        shutil.copy(source / name, copy)
    (copy / "__init__.py").touch()
    (copy / "unrelated.py").touch()
    (copy / "sample_constants.py").write_text("FACTOR = 3.0\n")
    (copy / "kernel.py").write_text(KERNEL)
    return copy


def run(package: Path, home: Path | None = None) -> tuple[str, dict[Path, int]]:
    """What the kernel prints, and the files of compiled code with the times of their changes."""
    home = home or package.parent / "home"
    environment = os.environ | {"HOME": str(home), "PYTHONPATH": str(package.parent)}
    command = [sys.executable, "-m", "forcebound.kernel"]
    done = subprocess.run(
        command, env=environment, cwd=package.parent, capture_output=True, text=True, check=True
    )
    files = (path for path in (home / ".cache" / "forcebound").rglob("*.nb?") if path.is_file())
    return done.stdout.strip(), {path: path.stat().st_mtime_ns for path in files}


def test_kernel_follows_a_constant_of_another_file(package: Path) -> None:
    before = run(package)
    # Of another size: within a second, Python takes a file of the same one for unchanged.
    (package / "sample_constants.py").write_text("FACTOR = 5.00\n")
    after = run(package)
    assert (before[0], after[0]) == ("6.0", "10.0")


def test_of_processes_that_start_together_one_compiles(package: Path) -> None:
    with (package / "kernel.py").open("a") as file:
        file.write("print(*jit(scale).stats.cache_misses.values())\n")
    with ThreadPoolExecutor() as threads:
        outputs = sorted(output for output, _ in threads.map(run, [package] * 3))
    assert [output.split() for output in outputs] == [["6.0"], ["6.0"], ["6.0", "1"]]


def test_unrelated_file_leaves_compiled_code_valid(package: Path) -> None:
    before = run(package)
    (package / "unrelated.py").write_text("NEW = 1\n")
    assert run(package) == before


def test_equal_sources_elsewhere_share_compiled_code(package: Path, tmp_path: Path) -> None:
    before = run(package)
    assert before[1]
    elsewhere = Path(shutil.copytree(package, tmp_path / "elsewhere" / "forcebound"))
    assert run(elsewhere, home=tmp_path / "home") == before
