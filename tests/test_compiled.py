"""Compiled kernels: a changed callee makes a new one, an unrelated file does not; prefetching."""

import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numba
import numpy as np
import pytest

import forcebound
from forcebound.compiled import allow_in_kernels, prefetch

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


def run(package: Path) -> tuple[str, set[Path]]:
    """What the kernel prints, and the folders of compiled code."""
    home = package.parent / "home"
    environment = os.environ | {"HOME": str(home), "PYTHONPATH": str(package.parent)}
    command = [sys.executable, "-m", "forcebound.kernel"]
    done = subprocess.run(
        command, env=environment, cwd=package.parent, capture_output=True, text=True, check=True
    )
    return done.stdout.strip(), set((home / ".cache" / "forcebound").iterdir())


def test_kernel_follows_a_constant_of_another_file(package: Path) -> None:
    before = run(package)
    (package / "sample_constants.py").write_text("FACTOR = 5.0\n")
    after = run(package)
    assert (before[0], after[0]) == ("6.0", "10.0")


def test_unrelated_file_leaves_compiled_code_valid(package: Path) -> None:
    before = run(package)
    (package / "unrelated.py").write_text("NEW = 1\n")
    assert run(package) == before


def test_what_is_asked_for_early_is_an_instruction_of_the_kernel_and_changes_nothing() -> None:
    allow_in_kernels([prefetch])
    kernel: Any = numba.njit(total)  # anew: of one from the cache the code is not known
    numbers = np.arange(6.0)
    assert kernel(numbers) == total(numbers) == 15.0
    (code,) = kernel.inspect_llvm().values()
    assert "call void @llvm.prefetch" in code


def total(numbers: Any) -> float:
    """Return the sum of an array."""
    summed = 0.0
    for place in range(len(numbers)):
        prefetch(numbers, place + 1)
        summed += numbers[place]
    return summed
