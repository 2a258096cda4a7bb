"""Parameters of a running graph: their names, what may be set, phases, in virtual time and live."""

import json
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from launch_texts import problems_of, written

from forcebound.analysis.metrics import phase_rows
from forcebound.errors import ConfigError, RunError
from forcebound.launch.changes import Reloader, change, timetable
from forcebound.launch.config import GraphConfig, to_document
from forcebound.launch.loader import from_document, load
from forcebound.launch.parameters import differences, holders, parameters
from forcebound.launch.virtual import run_virtual
from forcebound.network.impairment import Impairment
from forcebound.running import orders, tuning
from forcebound.running.tuning import find_parameters, read_settings, set_parameters


@pytest.fixture(scope="module")
def config() -> GraphConfig:
    return replace(load("stiff_wall"), duration=0.5)


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


# --- Names and values ----------------------------------------------------------------------------


def test_every_impairment_of_every_link_and_all_of_the_environment_can_be_changed(
    config: GraphConfig,
) -> None:
    known = parameters(config)
    assert {"environment.stiffness", "environment.compute_delay"} <= known.keys()
    for topic in ("device_state", "environment_query", "environment_reply", "force_command"):
        assert known[f"links.{topic}.loss"] == 0.0
    assert not any("kind" in name or name.startswith("device.") for name in known)


def test_a_change_takes_units_and_changes_nothing_else(config: GraphConfig) -> None:
    new = change(config, {"links.force_command.delay": "2 ms", "environment.stiffness": 500})
    assert new.links["force_command"] == Impairment(delay=0.002)
    assert differences(config, new) == {
        "links.force_command.delay": 0.002,
        "environment.stiffness": 500.0,
    }
    assert replace(new, links=config.links, environment=config.environment) == config


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"environment.stifness": 1}, "did you mean 'environment.stiffness'"),
        ({"device.law": "none"}, "unknown parameter 'device.law'"),
        ({"environment.kind": "damper"}, "unknown parameter"),
        ({"environment.stiffness": "5 s"}, "which is a time"),
        ({"links.environment_query.loss": 2}, "probability"),
        ({"links.environment_query.delay": "1 s"}, "age_limit"),
    ],
)
def test_what_cannot_be_set_is_refused_with_a_reason(
    config: GraphConfig, settings: dict[str, Any], message: str
) -> None:
    with pytest.raises(ConfigError, match=message):
        change(config, settings)


def test_a_setting_is_read_as_in_a_launch_file() -> None:
    texts = ["environment.stiffness:=2 N/mm", "links.device_state.outages:=[{start: 1 s}]"]
    assert read_settings(texts) == {
        "environment.stiffness": "2 N/mm",
        "links.device_state.outages": [{"start": "1 s"}],
    }
    assert read_settings(["links.device_state.trace:=a.csv"]) == {
        "links.device_state.trace": str(Path("a.csv").absolute())
    }


@pytest.mark.parametrize("text", ["environment.stiffness=2", ":=2", "nonsense"])
def test_a_setting_without_name_and_sign_is_refused(text: str) -> None:
    with pytest.raises(ConfigError, match="NAME:=VALUE"):
        read_settings([text])


def test_a_section_stands_for_its_parameters(config: GraphConfig) -> None:
    found = find_parameters(config, ["links.force_command"])
    assert set(found) == {name for name in parameters(config) if "force_command" in name}
    assert find_parameters(config, []) == parameters(config)
    with pytest.raises(ConfigError, match="did you mean"):
        find_parameters(config, ["environment.stifness"])


def test_a_link_belongs_to_the_process_that_receives() -> None:
    names = ["links.environment_query.delay", "links.force_command.loss"]
    assert holders(names) == {"environment", "device"}
    assert holders(["environment.stiffness"]) == {"environment"}


def test_a_run_directory_without_nodes_keeps_the_change_for_them(
    config: GraphConfig, tmp_path: Path
) -> None:
    file = tmp_path / "launch.json"
    file.write_text(json.dumps(to_document(config)))
    assert set_parameters(tmp_path, {"environment.stiffness": 500}) == {
        "environment.stiffness": 500.0
    }
    assert from_document(json.loads(file.read_text())).environment.model.force(
        (0.012,), (0.0,), 0.0
    ) == pytest.approx((1.0,))
    with pytest.raises(ConfigError, match="which is a time"):
        set_parameters(tmp_path, {"environment.stiffness": "5 s"})
    assert json.loads(file.read_text())["environment"]["stiffness"] == 500.0


def test_a_node_that_does_not_answer_is_named(
    config: GraphConfig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tuning, "ask", partial(orders.ask, patience=0.1))
    (tmp_path / "launch.json").write_text(json.dumps(to_document(config)))
    (tmp_path / "control-environment").touch()
    with pytest.raises(RunError, match="environment did not answer"):
        set_parameters(tmp_path, {"environment.stiffness": 500})


def test_what_ends_on_another_machine_is_changed_there(tmp_path: Path) -> None:
    remote = written(
        tmp_path, "forcebound: 1\ninclude: stiff_wall.yaml\nremote: {address: 127.0.0.1}\n"
    )
    (tmp_path / "launch.json").write_text(json.dumps(to_document(load(remote))))
    with pytest.raises(ConfigError, match="on another machine"):
        set_parameters(tmp_path, {"environment.stiffness": 500})
    assert set_parameters(tmp_path, {"links.environment_reply.loss": 0.1})


def test_a_reloader_names_a_document_that_is_gone(config: GraphConfig, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"launch\.json"):
        Reloader(config, tmp_path / "launch.json")(None)  # type: ignore[arg-type]  # not reached


# --- Phases --------------------------------------------------------------------------------------


def test_a_run_is_as_long_as_its_phases_and_each_begins_with_the_file(tmp_path: Path) -> None:
    config = load(written(tmp_path, PHASES))
    assert config.duration == pytest.approx(1.0)
    parts = timetable(config)
    assert [part.name for part in parts] == ["quiet", "late", "gone", "quiet again"]
    assert [part.start_ns for part in parts] == [0, 300_000_000, 500_000_000, 800_000_000]
    late, gone = parts[1].config, parts[2].config
    assert late.links["environment_reply"].delay == 0.005
    assert gone.links["environment_reply"] == Impairment(loss=1.0)
    assert differences(config, parts[3].config) == {}


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


def test_phases_that_set_nothing_are_the_plain_run(config: GraphConfig, tmp_path: Path) -> None:
    names = "[{name: one, duration: 0.2 s}, {name: two, duration: 0.3 s}]"
    file = written(tmp_path, f"forcebound: 1\ninclude: stiff_wall.yaml\nphases: {names}\n")
    in_phases, plain = run_virtual(load(file)).columns, run_virtual(config).columns
    assert np.array_equal(plain.applied_force, in_phases.applied_force)


@pytest.mark.parametrize(
    ("phases", "message"),
    [
        ("phases: 3", "phases must be a list"),
        ("phases: []", "phases must be a list"),
        ("phases: [{name: a, duration: 0 s}]", "duration"),
        ("phases: [{name: a}]", "needs 'duration'"),
        ("phases: [{name: a, duration: 1 s, sett: {}}]", "did you mean 'set'"),
        ("phases: [{name: a, duration: 1 s, set: {environment.stifness: 1}}]", "did you mean"),
        ("phases: [{name: a, duration: 1 s, set: {environment.stiffness: 5 s}}]", "is a time"),
        ("phases: [{name: a, duration: 1 s, set: {links.device_state.loss: 3}}]", "probability"),
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
