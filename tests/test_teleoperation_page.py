"""docs/teleoperation.md: its files, as a reader writes them, from the check to his own sums."""

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest
from invoking import invoke
from live_graph import PROCESSES_OF_THEIR_OWN

from forcebound.run.results import results_of

PAGE = Path(__file__).parent.parent / "docs/teleoperation.md"
FILE = re.compile(r"^```(?:yaml|python)\n(# (\S+)\n.*?)^```$", re.MULTILINE | re.DOTALL)
ROUNDED = 5e-5  # J, of what the page's lines print
#: A slow bus, so that no busy machine is too slow for it.
PATIENT = ["rate:=50 Hz"] + [
    f"{hand}.device.{value}"
    for hand in ("leader", "follower")
    for value in ("timeout:=5 s", "write_delay:=60 ms", "watchdog_limit:=1 s")
]


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with the files of the page."""
    for text, name in FILE.findall(PAGE.read_text(encoding="utf-8")):
        (tmp_path / name).write_text(text, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_the_files_of_the_page_are_right(folder: Path) -> None:
    for name in ("one.yaml", "pair.yaml", "no_law.yaml"):
        done = invoke("launch", name, "--check")
        assert done.exit_code == 0, done.output


def test_only_a_law_keeps_late_arms_passive(folder: Path) -> None:
    late = ("delay:=20 ms", "--duration", "2 s", "--json")
    energies = {
        name: json.loads(invoke("simulate", name, *late).stdout)["coupling"]["energy_min_j"]
        for name in ("joint_arms", "no_law.yaml")
    }
    assert energies["joint_arms"] >= 0.0
    assert energies["no_law.yaml"] < -1.0


def test_an_empty_partner_on_the_command_line_is_none_as_in_a_file(folder: Path) -> None:
    alone = [f"{hand}.device.energy_partner:=" for hand in ("leader", "follower")]
    short = ("--duration", "0.5 s", "--json")
    given, own = (
        json.loads(invoke("simulate", *words, *short).stdout)["coupling"]["energy_min_j"]
        for words in (("joint_arms", "law:=none", *alone), ("no_law.yaml",))
    )
    assert given == own


def test_a_hand_that_gets_energy_feels_no_negative_stiffness(folder: Path) -> None:
    done = invoke("simulate", "no_law.yaml", "delay:=20 ms", "--json")
    assert json.loads(done.stdout)["coupling"]["transmitted_stiffness_n_per_m"] is None


@pytest.mark.usefixtures("folder")
class TestLive:
    pytestmark = PROCESSES_OF_THEIR_OWN

    def test_the_readers_sums_are_those_of_the_verdict_within_its_error(self) -> None:
        words = ("--duration", "9 s", "--record", "pair.mcap")
        graph = [sys.executable, "-m", "forcebound", "launch", "pair.yaml", *PATIENT, *words]
        launched = subprocess.run(graph, capture_output=True, text=True, check=False)
        assert "torque off" in launched.stderr + launched.stdout
        sums = [sys.executable, "sums.py"]
        printed = subprocess.run(sums, capture_output=True, text=True, check=True).stdout
        own = dict(re.findall(r"(\w+): the motors gave up to ([\d.]+) mJ", printed))
        for hand, result in results_of(Path("pair.mcap"), None).items():
            figures = result.summary
            lowest, error = (figures[f"observed_energy_{one}_j"] for one in ("min", "error"))
            assert 1e-3 * float(own[hand]) == pytest.approx(-lowest, abs=error + ROUNDED)
        assert float(own["follower"]) > 20.0  # mJ: it has moved
        (felt,) = re.findall(r"the leader feels .* = ([\d.]+) N m/rad", printed)
        assert 0.0 < float(felt) < 4.0
        again = invoke("simulate", "again.yaml", "--duration", "1 s", "--json")
        assert again.exit_code == 0, again.output
