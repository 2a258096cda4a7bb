"""Phases of a scripted run."""

import json
from pathlib import Path

import pytest
from launch_texts import problems_of, written

from forcebound.graph.loader import from_document, load
from forcebound.graph.parameters import differences, with_values
from forcebound.graph.phases import timetable
from forcebound.graph.resolved import to_document
from forcebound.network.impairment import Impairment
from forcebound.results.tables import phase_rows
from forcebound.run.virtual import run_virtual

PHASES = """
forcebound: 1
include: stiff_wall.yaml
phases:
  - { name: quiet, duration: 300 ms }
  - name: late
    duration: 200 ms
    set: { links.environment_reply.delay: 5 ms, environment.stiffness: 2 N/mm }
  - { name: gone, duration: 0.3 s, set: { links.environment_reply.loss: 100 % } }
  - { name: quiet again, duration: 0.2 s }
"""


def test_a_run_is_as_long_as_its_phases_and_each_begins_with_the_file(tmp_path: Path) -> None:
    config = load(written(tmp_path, PHASES))
    assert config.duration == pytest.approx(1.0)
    parts = timetable(config)
    assert [part.name for part in parts] == ["quiet", "late", "gone", "quiet again"]
    assert [part.start_ns for part in parts] == [0, 300_000_000, 500_000_000, 800_000_000]
    late, gone, again = (with_values(config, part.values) for part in parts[1:])
    assert late.only.links["environment_reply"].delay == 0.005
    assert gone.only.links["environment_reply"] == Impairment(loss=1.0)
    assert differences(config, again) == {}


def test_phases_survive_the_way_to_the_processes(tmp_path: Path) -> None:
    config = load(written(tmp_path, PHASES))
    assert from_document(json.loads(json.dumps(to_document(config)))) == config


def test_each_phase_is_reported_with_what_happened_in_it(tmp_path: Path) -> None:
    result = run_virtual(load(written(tmp_path, PHASES)))
    quiet, late, gone, again = result.summary["phases"]
    assert quiet["loop_delay_ms"]["p50"] == pytest.approx(0.4)
    assert late["loop_delay_ms"]["p50"] == pytest.approx(5.4)
    assert late["start_s"] == pytest.approx(0.3, abs=2e-3)
    assert gone["answered_share"] < 0.1
    assert gone["force_share"] == pytest.approx(0.1 / 0.3, abs=0.03)  # the age limit: 100 ms
    assert again["force_share"] > 0.95
    assert result.summary["faults"]["force_released"] == 1
    lost = result.summary["links"]["environment_reply"]
    assert lost["lost"] == pytest.approx(300, abs=3)
    assert sum(count for fate, count in lost.items() if fate not in ("sent", "duplicated")) == (
        lost["sent"] + lost["duplicated"]
    )
    assert len({len(row) for row in phase_rows(result.summary["phases"])}) == 1


def test_phases_are_the_same_run_every_time_and_in_a_recording(tmp_path: Path) -> None:
    config = load(written(tmp_path, PHASES))
    run_virtual(config, record=tmp_path / "one.mcap")
    run_virtual(config, record=tmp_path / "two.mcap")
    assert (tmp_path / "one.mcap").read_bytes() == (tmp_path / "two.mcap").read_bytes()


@pytest.mark.parametrize(
    ("phases", "message"),
    [
        ("phases: []", "phases: expected"),
        ("phases: [{name: a}]", "needs 'duration'"),
        ("phases: [{name: a, duration: 1 s, set: {environment.stifness: 1}}]", "did you mean"),
        ("phases: [{name: a, duration: 1 s, set: {environment.stiffness: 5 s}}]", "is a time"),
        ("phases: [{name: a, duration: 1 s, set: {device.law: none}}]", "cannot set device.law"),
    ],
)
def test_a_wrong_phase_is_a_problem_of_the_launch_file_at_its_place(
    tmp_path: Path, phases: str, message: str
) -> None:
    text = f"forcebound: 1\ninclude: stiff_wall.yaml\n{phases}\n"
    problems = problems_of(written(tmp_path, text))
    assert message in problems
    assert ":3:" in problems


def test_the_shipped_stress_test_keeps_the_hand_safe() -> None:
    result = run_virtual(load("stress"))
    summary = result.summary
    assert summary["true_energy_min_j"] >= -1e-9
    assert summary["faults"]["force_released"] >= 2
    by_name = {phase["name"]: phase for phase in summary["phases"]}
    assert by_name["far away"]["loop_delay_ms"]["p50"] == pytest.approx(200.4, abs=1.0)
    assert by_name["a third is lost"]["answered_share"] == pytest.approx(0.67, abs=0.03)
    assert by_name["slow computation"]["answered_share"] == pytest.approx(1 / 15, abs=0.01)
    assert by_name["nothing comes through"]["answered_share"] < 0.01
    assert by_name["quiet again"]["answered_share"] > 0.99
    silent = by_name.pop("nothing comes through")
    assert silent["peak_force_n"] < min(phase["peak_force_n"] for phase in by_name.values())
