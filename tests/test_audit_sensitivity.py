"""What a wrong number costs: the search and its command."""

import json

import pytest
from click.testing import CliRunner

from forcebound.audit.sensitivity import (
    MISTAKES,
    TRIED_SENSORS,
    Search,
    lowest_energy,
    run_sensitivity,
    stated_by,
)
from forcebound.bounding import ENERGY_TOLERANCE
from forcebound.cli import main
from forcebound.errors import ConfigError

PHANTOM = "phantom_premium_1_5"
BY_NAME = {mistake.summary: mistake for mistake in MISTAKES}


def lowest(summary: str, runs: int) -> float:
    return lowest_energy(Search(BY_NAME[summary], stated_by(PHANTOM), TRIED_SENSORS[1], runs))


def test_nothing_is_lost_if_nothing_is_wrong() -> None:
    assert lowest("nothing is wrong", 20) >= -ENERGY_TOLERANCE


@pytest.mark.parametrize(
    "summary",
    [
        "reading to writing 400 us",
        "1 reading of 100 wrong by 10 mm, no largest speed stated",
    ],
)
def test_a_broken_promise_costs_energy(summary: str) -> None:
    assert lowest(summary, 30) < -1e-3


@pytest.mark.parametrize("late", ["first look 50 us late", "drops a force 50 us after the look"])
def test_a_guard_that_is_late_costs_energy(late: str) -> None:
    def found(summary: str) -> float:
        mistake = BY_NAME[f"guarding, any hand: {summary}"]
        return lowest_energy(Search(mistake, stated_by(PHANTOM), TRIED_SENSORS[0], 60))

    assert found("nothing is wrong") >= -ENERGY_TOLERANCE
    assert found(late) < -1e-4


def test_the_device_states_its_own_numbers() -> None:
    device = stated_by(PHANTOM)
    assert (device.damping, device.friction, device.saturation) == (0.27, 0.12, 8.5)
    with pytest.raises(ConfigError, match="no device 'unheard'; known are"):
        stated_by("unheard")


def test_each_mistake_is_reported_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("forcebound.audit.sensitivity.SAMPLES", 210)
    reported: list[tuple[int, int]] = []
    document = run_sensitivity(PHANTOM, 4, 0, lambda *progress: reported.append(progress))
    assert [row["summary"] for row in document["mistakes"]] == list(BY_NAME)
    assert reported[-1] == (4 * len(MISTAKES), 4 * len(MISTAKES))
    done = CliRunner().invoke(
        main, ["audit", "sensitivity", "--runs", "4", "--workers", "0", "--json"]
    )
    assert done.exit_code == 0, done.output
    assert json.loads(done.stdout) == document
