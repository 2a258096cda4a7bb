"""Code of a user's own that fails during a run: status 1, and the first line says so."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from invoking import invoke
from launch_texts import written

from forcebound.errors import RunError
from forcebound.interface.gym import HapticEnv

HEAD = "from dataclasses import dataclass\n"
SOURCES = {
    "environment": """
from forcebound.haptics.environments import StatelessEnvironment

@dataclass(frozen=True)
class Mine(StatelessEnvironment):
    def force(self, user, position, velocity, elapsed):
        if elapsed > 0.1: raise ValueError("spoilt")
        return (max(0.0, 2000.0 * (position[0] - 0.01)),)
""",
    "controller": """
from forcebound.haptics.controllers import Controller, ControllerModel

class Opened(Controller):
    def query(self, state): return state.position, state.velocity
    def on_state(self, state, time_ns): return None
    def on_reply(self, reply, time_ns):
        if reply.device_time_ns > 100_000_000: raise ValueError("spoilt")
        return reply.force

@dataclass(frozen=True)
class Mine(ControllerModel):
    def open(self, axes): return Opened()
""",
    "operator": """
from forcebound.haptics.hands import Operator

@dataclass(frozen=True)
class Mine(Operator):
    mass: float = 0.1
    stiffness: float = 300.0
    damping: float = 2.0
    def target(self, elapsed):
        if 0.1 < elapsed < 0.5: raise ValueError("spoilt")
        return (0.02,)
""",
    "law": """
from forcebound.haptics.laws import BoundingLaw

def limit(state, sample, device):
    if state + sample.work > 1e-4: raise ValueError("spoilt")
    return state + sample.work, 8.5, 0.0

MINE = BoundingLaw(summary="spoilt once it has some energy", limit=limit)
""",
}


def own(folder: Path, section: str) -> Path:
    """A launch file with code of the user's own in a section."""
    written(folder, HEAD + SOURCES[section], "mine.py")
    entry = "device: {law: mine.py}" if section == "law" else f"{section}: {{kind: mine.py}}"
    return written(folder, f"forcebound: 1\ninclude: stiff_wall.yaml\n{entry}\n")


@pytest.mark.parametrize("section", ["environment", "controller"])
def test_a_run_whose_code_failed_is_shown_and_is_no_success(tmp_path: Path, section: str) -> None:
    path = own(tmp_path, section)
    result = invoke("simulate", path, "--duration", "0.5s")
    assert result.exit_code == 1
    first, *others = result.stdout.splitlines()
    assert first.startswith("Failed")
    assert section in first
    assert "mine.py:" in first
    assert "spoilt" in first
    assert others[0].startswith("Passive")
    summary = json.loads(invoke("simulate", path, "--duration", "0.5s", "--json").stdout)
    assert summary["verdict"][0] == first
    assert "spoilt" in summary["failed"]
    assert len(summary["verdict"]) <= 5


@pytest.mark.parametrize("section", ["operator", "law"])
def test_code_in_the_device_node_that_fails_ends_the_run_with_a_sentence(
    tmp_path: Path, section: str
) -> None:
    result = invoke("simulate", own(tmp_path, section), "--duration", "0.5s")
    assert result.exit_code == 1
    (said,) = [line for line in result.stderr.splitlines() if line.startswith("forcebound: ")]
    assert "ValueError" in said
    assert "mine.py:" in result.stderr
    assert "Traceback" not in result.stderr


def test_an_episode_ends_with_the_error_of_a_world_whose_code_failed(tmp_path: Path) -> None:
    env = HapticEnv(own(tmp_path, "environment"), frame_skip=200)
    env.reset()
    with pytest.raises(RunError, match="spoilt"):
        env.step(np.array([0.0]))
    env.close()


@pytest.mark.live
@pytest.mark.parametrize("section", ["environment", "operator"])
def test_live_the_first_line_says_what_failed(tmp_path: Path, section: str) -> None:
    words = ["launch", str(own(tmp_path, section)), "--duration", "1 s"]
    command = [sys.executable, "-m", "forcebound", *words]
    out = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert out.returncode == 1, out.stderr
    first = out.stdout.splitlines()[0]
    assert first.startswith("Failed")
    assert "ValueError" in first
    assert "mine.py:" in first
