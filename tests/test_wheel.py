"""The wheel, installed by itself: what pip gives a user runs, outside the clone."""

import json
import os
import shutil
import subprocess
import sys
import venv
from importlib.metadata import Distribution, distribution, distributions
from pathlib import Path

import pytest
from packaging.requirements import Requirement

ROOT = Path(__file__).parent.parent
BESIDE = {"build", "docs", "results"}  # at the root, beside the sources


def not_sources(folder: str, names: list[str]) -> set[str]:
    beside = BESIDE if Path(folder) == ROOT else set()
    return {n for n in names if n in beside or n.startswith(".") or n == "node_modules"}


def run(*words: str | Path, cwd: Path = ROOT, **variables: str) -> str:
    done = subprocess.run(
        list(map(str, words)),
        cwd=cwd,
        env={**os.environ, **variables, "PYTHONPATH": ""},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def link_requirements(package: Distribution, folder: Path, known: set[str]) -> None:
    """Link what a distribution requires, without extras, and what that requires, into a folder."""
    for required in map(Requirement, package.requires or ()):
        is_needed = required.marker is None or required.marker.evaluate({"extra": ""})
        if required.name in known or not is_needed:
            continue
        known.add(required.name)
        found = distribution(required.name)
        for top in {Path(file).parts[0] for file in found.files or ()} - {"..", "__pycache__"}:
            if not (folder / top).exists():
                (folder / top).symlink_to(str(found.locate_file(top)))
        link_requirements(found, folder, known)


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of an environment that has the wheel and what it requires, and nothing else."""
    folder = tmp_path_factory.mktemp("wheel")
    shutil.copytree(ROOT, folder / "clone", symlinks=True, ignore=not_sources)
    pip = (sys.executable, "-m", "pip", "--disable-pip-version-check", "--quiet")
    run(*pip, "wheel", "--no-deps", "--wheel-dir", folder, folder / "clone")
    (wheel,) = folder.glob("forcebound-*.whl")
    shutil.rmtree(folder / "clone")
    venv.create(folder / "env", symlinks=True)
    python = folder / "env" / "bin" / "python"
    run(*pip, "--python", python, "install", "--no-deps", "--no-index", wheel)
    (packages,) = (folder / "env" / "lib").glob("python3*/site-packages")
    (wheeled,) = distributions(name="forcebound", path=[str(packages)])
    link_requirements(wheeled, packages, {"forcebound"})
    return folder


@pytest.mark.live
def test_the_wheel_simulates_and_launches_outside_the_clone(installed: Path) -> None:
    python, forcebound = (installed / "env" / "bin" / name for name in ("python", "forcebound"))
    imported = Path(
        run(python, "-c", "import forcebound; print(forcebound.__file__)", cwd=installed)
    )
    assert imported.is_relative_to(installed / "env")
    words = ("stiff_wall", "--json", "--duration")
    for command, duration in (("simulate", "500ms"), ("launch", "2s")):
        runtime = {"XDG_RUNTIME_DIR": str(installed)}
        summary = json.loads(run(forcebound, command, *words, duration, cwd=installed, **runtime))
        assert summary["samples"] > 0
        assert summary["true_energy_min_j"] >= 0.0, command


NEEDS = {  # an extra by its name, or another distribution
    "sweep z_width": "[lab]",
    "map result.parquet": "[plot]",
    "plot run.mcap": "[plot]",
    "identify five_bar": "[lab]",
    "simulate touch_mesh": "[mesh]",
    "simulate push_boxes": "[mujoco]",
    "study analyse .": "[plot]",
    "view": "[view]",
    "audit": "forcebound-proofs",
    "league": "forcebound-proofs",
    "reproduce table1": "forcebound-proofs",
}


@pytest.mark.parametrize("words", NEEDS)
def test_what_a_command_needs_and_is_not_there_is_named_in_a_sentence(
    installed: Path, words: str
) -> None:
    command = [str(installed / "env" / "bin" / "forcebound"), *words.split()]
    done = subprocess.run(command, cwd=installed, capture_output=True, text=True)
    assert done.returncode == 2
    assert "needs" in done.stderr
    assert NEEDS[words] in done.stderr
    assert "Traceback" not in done.stderr


SAMPLE = """
import forcebound as fb
from numpy import float64
from numpy.typing import NDArray

from forcebound.testing import Pad, check_environment, scripted

run: fb.Run = fb.simulate("stiff_wall", law="certified", delay="2 ms", duration="1 s")
stiffness: float = run.figures.displayed_stiffness
unit: str = run.figures["peak_force"].unit
runs: fb.Runs = fb.sweep("stiff_wall", law=["none", "certified"], duration="100 ms")
applied: NDArray[float64] = fb.bound([0.0, 1e-4], [0.0, 1.0], "certified")
print(len(runs), unit, float(applied[0]), stiffness > 0.0, list(fb.laws)[:1])
seen: dict[str, bool] = check_environment(Pad(stiffness=500.0), axes=(1,), at_rest={0.0: 0.0}).held
with scripted((b"f 0", b"0.25 0"), (None, {"ready": True})) as line:
    line.send(b"f 0")
    print(line.read_lines(1), line.recv(), seen["resists"])


def live() -> fb.Figures:
    with fb.launch("stiff_wall") as graph:
        graph.set("device.law", "none")
        return graph.figures()
"""


@pytest.mark.live
def test_the_wheel_has_the_python_interface(installed: Path) -> None:
    (installed / "sample.py").write_text(SAMPLE)
    shown = run(installed / "env" / "bin" / "python", "sample.py", cwd=installed)
    assert shown == "2 N 0.0 True ['none']\nb'0.25 0' {\"ready\": true} True\n"


@pytest.mark.slow
@pytest.mark.live
def test_its_types_are_complete_from_outside(installed: Path) -> None:
    (installed / "sample.py").write_text(SAMPLE)
    python = installed / "env" / "bin" / "python"
    tools = ("-m", "mypy", "--strict", "--python-executable"), ("-m", "pyright", "--pythonpath")
    for tool in tools:
        run(sys.executable, *tool, python, "sample.py", cwd=installed)
