"""Results of runs that changed their law, and of runs of which nothing came."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from forcebound.cli import main
from forcebound.graph.loader import load
from forcebound.messages.events import LAW_CHANGED, EventLog
from forcebound.results.summary import OF_ONE_LAW
from forcebound.results.tables import summary_table
from forcebound.run.results import RunResult
from forcebound.run.virtual import run_virtual

MOMENT_NS = 3_000_000_000
BEFORE = 0.002  # J


@pytest.fixture(scope="module")
def whole() -> RunResult:
    return run_virtual(load("stiff_wall", ["law:=none"]), 6.0)


@pytest.fixture(scope="module")
def changed(whole: RunResult) -> RunResult:
    """The same, as if another law had begun in the middle."""
    data = {"law": "tdpa", "energy_before": repr(BEFORE)}
    event = EventLog("device").emit(MOMENT_NS, LAW_CHANGED, "", data)
    return replace(whole, events=[*whole.events, event])


def test_the_time_of_the_first_law_has_the_figures_of_a_run_that_ends_then(
    changed: RunResult,
) -> None:
    first, _ = changed.summary["laws"]
    alone = run_virtual(load("stiff_wall", ["law:=none"]), MOMENT_NS * 1e-9).summary
    for key in OF_ONE_LAW:
        assert first[key] == alone[key], key
    assert first["displayed_stiffness_n_per_m"] is not None
    assert (first["law"], first["samples"]) == ("none", alone["samples"])


def test_the_time_of_the_second_law_starts_at_zero(whole: RunResult, changed: RunResult) -> None:
    _, second = changed.by_law
    assert second.columns.time[0] == 0.0
    later = whole.columns.time_ns > MOMENT_NS
    expected = whole.columns.true_energy[later] - BEFORE
    np.testing.assert_array_equal(second.columns.true_energy, expected)
    assert second.summary["law"] == "tdpa"
    assert changed.summary["laws"][1]["start_s"] == pytest.approx(3.0, abs=2e-3)


def test_a_law_of_one_of_several_hands_is_named_without_the_hand(changed: RunResult) -> None:
    of_left = replace(changed, columns=replace(changed.columns, hand="left"))
    assert [one["law"] for one in of_left.summary["laws"]] == ["none", "tdpa"]


def test_the_whole_run_has_no_figure_that_mixes_laws(whole: RunResult, changed: RunResult) -> None:
    summary = changed.summary
    for key in OF_ONE_LAW:
        assert summary[key] is None
        assert "laws" in summary["undefined"][key]
    for key in ("samples", "duration_s", "peak_force_n", "loop_delay_ms", "rejected_packets"):
        assert summary[key] == whole.summary[key]
    assert "laws" not in whole.summary


def test_the_table_has_a_column_for_each_law(changed: RunResult) -> None:
    head, rows = summary_table([(changed.label, changed.summary)])
    assert len(head) == 4
    assert all(len(row) == 4 for row in rows)
    by_label = {row[0]: row[1:] for row in rows}
    assert by_label["displayed stiffness"][0] == "–"
    assert by_label["displayed stiffness"][1].endswith("N/mm")
    assert by_label["rejected packets"][1:] == ("–", "–")


def test_a_force_that_never_engages_ends_with_status_1(tmp_path: Path) -> None:
    file = tmp_path / "slow.yaml"
    file.write_text("forcebound: 1\ninclude: stiff_wall.yaml\ndevice: {engage_time: 80000}\n")
    done = CliRunner().invoke(main, ["simulate", str(file), "--duration", "500ms"])
    assert done.exit_code == 1
    assert "engage_time" in done.output
    assert "Stiffness felt" in done.output  # the result is shown all the same


@pytest.mark.parametrize("controller", ["direct", "local_model", "virtual_coupling"])
def test_a_run_without_an_answer_is_idle(controller: str) -> None:
    config = load("stiff_wall", [f"controller:={controller}"])
    deaf = replace(config.only.links["environment_reply"], loss=1.0)
    links = {**config.only.links, "environment_reply": deaf}
    assert run_virtual(config.with_hand(links=links), 0.3).failed
    assert not run_virtual(config, 0.3).failed


def test_the_age_of_the_reply_is_that_of_the_environment(whole: RunResult) -> None:
    far = run_virtual(load("far_wall"), 1.0).summary
    assert far["loop_delay_ms"]["p50"] == pytest.approx(0.4)
    assert far["reply_age_ms"]["p50"] == pytest.approx(2 * 20.0 + 0.4)
    direct = run_virtual(load("far_wall", ["controller:=direct"]), 1.0).columns
    np.testing.assert_array_equal(direct.reply_age, direct.loop_delay)
    np.testing.assert_array_equal(whole.columns.reply_age, whole.columns.loop_delay)
