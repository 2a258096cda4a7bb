"""The package: every folder is listed, layered and complete."""

import ast
import re
import subprocess
import sys
import tomllib
from importlib.metadata import PackageNotFoundError, metadata
from pathlib import Path

import pytest
from packaging.specifiers import SpecifierSet

ROOT = Path(__file__).parent.parent
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())


def installed(name: str) -> bool:
    try:
        metadata(name)
    except PackageNotFoundError:
        return False
    return True


def rooms() -> set[str]:
    """Every folder with an ``__init__.py`` that is imported as part of forcebound."""
    files = (ROOT / "forcebound").glob("**/__init__.py")
    rooms = {".".join(file.parent.relative_to(ROOT).parts) for file in files}
    return rooms | {"forcebound.nodes", "forcebound.messages"}  # links are not followed


def test_every_room_is_packaged() -> None:
    packages = set(PROJECT["tool"]["setuptools"]["packages"])
    assert packages == rooms() | {
        f"forcebound.{data}" for data in ("examples", "launch_files", "study_files")
    }


def test_no_file_has_more_than_400_lines_and_no_function_more_than_60() -> None:
    files = [*(ROOT / "forcebound").rglob("*.py"), *(ROOT / "nodes").rglob("*.py")]
    files += (ROOT / "messages").rglob("*.py")
    functions = (ast.FunctionDef, ast.AsyncFunctionDef)
    for file in files:
        text = file.read_text(encoding="utf-8")
        assert text.count("\n") <= 400, file
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, functions) and node.end_lineno is not None:
                assert node.end_lineno - node.lineno < 60, (file, node.name)


def test_every_room_has_its_layer() -> None:
    layers, _ = (c for c in PROJECT["tool"]["importlinter"]["contracts"] if c["type"] == "layers")
    named = {name.strip() for row in layers["layers"] for name in re.split(r"[|:]", row)}
    modules = {
        path.stem
        for path in (ROOT / "forcebound").iterdir()
        if (path.suffix == ".py" or (path / "__init__.py").exists())
        and not path.stem.startswith("__")
    }
    assert named == modules


@pytest.mark.parametrize("room", ["nodes", "messages"])
def test_a_room_cannot_be_imported_under_its_bare_name(room: str) -> None:
    out = subprocess.run(
        [sys.executable, "-c", f"import {room}"], cwd=ROOT, capture_output=True, text=True
    )
    assert out.returncode == 1
    assert f"import forcebound.{room}, not {room}" in out.stderr


def test_no_commit_names_an_address_or_a_home() -> None:
    for name in ("constraints.txt", "pyproject.toml", "Makefile"):
        text = (ROOT / name).read_text()
        assert "://" not in text.replace("ipc://", "")
        assert not re.search(r"/(home|root|Users)/", text)


def test_every_tested_version_accepts_the_oldest_python_that_is_promised() -> None:
    """A package may ask for more than a minor version: soupsieve 3 did for 3.11.5."""
    oldest = PROJECT["project"]["requires-python"].removeprefix(">=") + ".0"
    lines = (ROOT / "constraints.txt").read_text().splitlines()
    names = [line.partition("==")[0] for line in lines if "==" in line]
    asked = {
        name: "".join(metadata(name).get_all("Requires-Python", []))
        for name in names
        if installed(name)
    }
    assert [name for name, asks in asked.items() if oldest not in SpecifierSet(asks)] == []
    assert len(asked) > 0.5 * len(names)


def test_the_tests_of_a_file_stay_together(request: pytest.FixtureRequest) -> None:
    are_grouped = getattr(request.config.option, "loadgroup", False)  # --dist loadgroup
    is_grouped = request.node.nodeid.endswith("@test_packaging")
    assert is_grouped == are_grouped, "pytest-xdist sees no groups"
