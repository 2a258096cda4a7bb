"""``forcebound feel``: its rows are runs of the device as stated, and of others."""

import json
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

import forcebound as fb
from forcebound.cli import main
from forcebound.lab import feel

LAUNCH = Path(__file__).parent.parent / "launch"


@pytest.fixture
def few_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(feel, "LIMITS", (0.03,))
    monkeypatch.setattr(feel, "ALLOWANCES", (0.0, 0.015))
    monkeypatch.setattr(feel, "RATES", (0.5, 1.0))
    monkeypatch.setattr(feel, "HAND_SPEEDS", {"m/s": (2.0,), "rad/s": (20.0,)})


@pytest.mark.usefixtures("few_runs")
def test_a_device_at_a_port_is_simulated_with_its_numbers(tmp_path: Path) -> None:
    picture = tmp_path / "feel.png"
    done = CliRunner().invoke(main, ["feel", "haply_2diy", "--json", "-o", str(picture)])
    assert done.exit_code == 0, done.output
    found = json.loads(done.stdout)
    numbers = {"watchdog_limit": 0.03, "allowance": 0.015, "hand_speed": 50.0}
    assert found["stated"] == {"rate": 1000.0, **numbers}
    assert found["felt"] > 0.95 * found["stiffness"]
    rows = {(run.get("watchdog_limit"), run.get("allowance")): run["felt"] for run in found["runs"]}
    device = "device: {watchdog: none, watchdog_limit: %s, allowance: %s, write_delay: 0.3 ms}"
    for (limit, given), felt in rows.items():
        if limit is not None:
            same = tmp_path / "same.yaml"
            text = f"forcebound: 1\ninclude: five_bar_wall.yaml\n{device % (limit, given)}\n"
            same.write_text(text)
            late: Any = {"device.reply_wait": 0.8}
            run = fb.simulate(same, **late)
            assert felt == pytest.approx(run.figures.displayed_stiffness)
    assert rows[0.03, 0.0] < rows[0.03, 0.015]
    assert found["felt"] == rows[0.03, 0.015]
    assert picture.stat().st_size > 10_000


@pytest.mark.usefixtures("few_runs")
def test_the_words_say_what_the_hand_can_get() -> None:
    little = ["watchdog_limit:=100 ms", "allowance:=0 mJ"]
    done = CliRunner().invoke(main, ["feel", "haply_2diy", *little])
    numbers = "watchdog_limit 100 ms, allowance 0 mJ, rate 1000 Hz, hand_speed 50 rad/s"
    assert f"as stated ({numbers})" in done.output
    last = done.output.splitlines()[-1]
    assert last.startswith("With watchdog_limit 30 ms and allowance 15 mJ: 1.99 N/mm of 2 N/mm")
    assert last.endswith("at most 15 mJ, the energy of 1.5 N over 10 mm.")


@pytest.mark.usefixtures("few_runs")
def test_limits_of_a_forecast_are_those_that_the_device_can_have() -> None:
    found = feel.forecast("dynamixel_arm")  # its watchdog counts steps of 20 ms
    assert found.felt < 0.95 * found.asked
    limits = {run["watchdog_limit"] for run in found.document["runs"] if "watchdog_limit" in run}
    assert limits == {0.04}
    assert any("watchdog_limit 40 ms" in line for line in found.details)


@pytest.mark.usefixtures("few_runs")
def test_a_kind_is_held_against_the_wall_of_its_launch_file() -> None:
    found = feel.forecast("phantom_premium_1_5", ["hand_speed:=3 m/s"])  # as stiff_wall states
    assert found.asked == 10_000.0
    run = fb.simulate("stiff_wall")
    assert found.felt == pytest.approx(run.figures.displayed_stiffness)
    rates, speeds = found.varied
    assert rates.runs["device.rate"].tolist() == [500.0, 1000.0]
    assert speeds.runs["device.hand_speed"].tolist() == [2.0, 3.0]
    slower, stated = speeds.runs["displayed_stiffness"]
    assert slower > stated
    assert stated == found.felt


@pytest.mark.usefixtures("few_runs")
def test_the_headline_is_known_before_the_runs_with_other_limits(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    said: list[str] = []
    names: list[tuple[int, str]] = []

    def noted(config: Any, numbers: Any) -> feel.Varied:
        names.extend((len(said), name) for name in numbers)
        return varied(config, numbers)

    varied = feel._varied
    monkeypatch.setattr(feel, "_varied", noted)
    found = feel.forecast("haply_2diy", say=said.append)
    assert said == [found.headline]
    assert names == [(0, "rate"), (1, "watchdog_limit"), (1, "allowance"), (1, "hand_speed")]


ANGLES = """\
forcebound: 1
seed: 1
duration: 2 s
hands:
  one:
    device: { kind: joints, joints: [base], inertia: 0.005 kg m^2, damping: 0.04 N m s }
    operator: %s
  other:
    device: { kind: joints, joints: [base], inertia: 0.005 kg m^2, damping: 0.04 N m s }
environment: { kind: wall, position: 0.1 rad, stiffness: 2 N m/rad }
"""
HOLDS = (
    "{ kind: pressing, end: 0.3 rad, start: 0 rad, stiffness: 20 N m/rad, damping: 0.2 N m s/rad }"
)


@pytest.mark.usefixtures("few_runs")
def test_a_hand_of_joints_has_a_forecast_in_their_unit(tmp_path: Path) -> None:
    path = tmp_path / "angles.yaml"
    path.write_text(ANGLES % HOLDS)
    done = CliRunner().invoke(main, ["feel", f"{path}:one"])
    assert done.exit_code == 0, done.output
    assert "N m/rad of 2 N m/rad" in done.output
    assert "N/mm" not in done.output
    assert "nan" not in done.output


def test_without_a_hand_nothing_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "angles.yaml"
    path.write_text(ANGLES % HOLDS)
    monkeypatch.setattr(feel, "sweep", None)
    done = CliRunner().invoke(main, ["feel", f"{path}:other"])
    assert done.exit_code == 2, done.output
    assert "operator" in done.output


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("two_hands", "two_hands.yaml:left"),
        (str(LAUNCH / "leader_follower.yaml:leader"), "simulate"),
        (str(LAUNCH / "leader_follower.yaml:lead"), "leader"),
        ("follow_path", "stiffness"),
        ("nothing", "nothing"),
    ],
)
def test_what_has_no_forecast_is_refused(name: str, reason: str) -> None:
    done = CliRunner().invoke(main, ["feel", name])
    assert done.exit_code == 2, done.output
    assert reason in done.output
