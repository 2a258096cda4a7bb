"""The audit of certificates: its ground truth, its cases, and what it finds."""

import dataclasses
import json
import math
import re
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from forcebound.audit import (
    CERTIFICATES,
    PathResult,
    attack_path,
    path_case_of,
    replay_path,
    run_certificates,
)
from forcebound.audit import truth as ground
from forcebound.audit.cases import encode
from forcebound.audit.certify import PathTask, results_of
from forcebound.audit.paths import SENSORS, dimensions
from forcebound.audit.plan import axes_of, device_of, dissipation_of, plan_of
from forcebound.audit.report import page
from forcebound.bounding import ENERGY_TOLERANCE, LAWS
from forcebound.cli import main
from forcebound.errors import ConfigError

CERTIFIED_LAWS = sorted(name for name, law in LAWS.items() if law.is_certified)
INFORMED = sorted(name for name, one in CERTIFICATES.items() if one.unstated)
RUNS = 25


def lowest(law: str, certificate: str, is_stated: bool, sensor: int | None, runs: int) -> float:
    results = results_of(PathTask(law, certificate, is_stated, sensor, 1, runs))
    return min(result.margin for result in results)


@pytest.mark.no_cover  # too many runs, as those below
@pytest.mark.parametrize("certificate", CERTIFICATES)
def test_a_certificate_holds_on_any_path(certificate: str) -> None:
    for law in CERTIFIED_LAWS:
        assert lowest(law, certificate, True, None, RUNS) >= -ENERGY_TOLERANCE


@pytest.mark.no_cover
@pytest.mark.parametrize("certificate", ["own_axes", "speed_gate", "presliding", "lag", "all"])
def test_a_law_that_is_not_informed_leaks(certificate: str) -> None:
    assert lowest("certified", certificate, False, None, 300) < -100 * ENERGY_TOLERANCE


@pytest.mark.slow
@pytest.mark.parametrize("certificate", INFORMED)
def test_without_any_information_a_search_finds_a_leak(certificate: str) -> None:
    attacks = (lowest("certified", certificate, False, one, 1000) for one in (None, 4, 1, 0))
    assert any(energy < -100 * ENERGY_TOLERANCE for energy in attacks)


@pytest.mark.no_cover
@pytest.mark.parametrize("law", ["none", "less_conservative", "more_conservative", "aol", "tdpa"])
def test_the_attacks_break_the_laws_that_are_not_certified(law: str) -> None:
    assert lowest(law, "plain", True, None, 60) < -1e-3


@pytest.mark.no_cover
def test_the_search_leaves_nearly_nothing() -> None:
    task = PathTask("certified", "plain", True, SENSORS.index("anticipating"), 1, 400)
    assert min(result.share_left for result in results_of(task)) < 0.01


def truth_of(name: str) -> tuple[int, ground.Floats, ground.Floats]:
    """Axes, device and state of a case."""
    case = path_case_of(name)
    device = device_of(case)
    return axes_of(case), device, ground.start(axes_of(case), device).state


def test_a_bristle_gives_back_what_it_has_stored_and_loses_what_slides() -> None:
    stretch = 1e-4  # m
    assert ground.pull(2.0, stretch, 0.0, stretch) == pytest.approx(1e-4)  # half f z, stored
    assert ground.pull(2.0, stretch, stretch, 0.0) == pytest.approx(-1e-4)
    assert ground.pull(2.0, stretch, stretch, 3.0 * stretch) == pytest.approx(2.0 * 2e-4)
    assert ground.pull(2.0, 0.0, 0.0, stretch) == pytest.approx(2e-4)


def test_a_motor_with_a_lag_works_as_the_sum_of_small_steps() -> None:
    axes, device, coarse = truth_of("lag:1")
    lag, gain = 3e-4, 1.1
    device[ground.SHARED, ground.LAG], device[ground.GAIN] = lag, gain
    coarse[ground.WRITTEN] = 2.0
    fine = coarse.copy()
    step = np.full(axes, 1e-3)
    work = ground.work_of_motor(axes, device, step, 1e-3, coarse)
    parts = [ground.work_of_motor(axes, device, step / 1000, 1e-6, fine) for _ in range(1000)]
    assert sum(parts) == pytest.approx(work)
    assert coarse[ground.MOTOR, 0] == pytest.approx(2.0 * gain * (1.0 - math.exp(-1e-3 / lag)))


def test_a_bristle_that_carries_a_weight_is_at_rest() -> None:
    axes, device, state = truth_of("all:3")
    stiffness = device[ground.FRICTION, :axes] / device[ground.PRESLIDING, :axes]
    force = stiffness * state[ground.BRISTLE, :axes]
    assert force == pytest.approx(-device[ground.WEIGHT, :axes])


@pytest.mark.parametrize("name", ["plain:4", "own_axes:4"])
def test_the_best_theft_takes_the_most_from_a_constant_force(name: str) -> None:
    axes, device, state = truth_of(name)
    b, f = device[ground.DAMPING, :axes], device[ground.FRICTION, :axes]
    acts_on_axes = bool(device[ground.SHARED, ground.ON_EACH_AXIS])
    for force in (np.zeros(axes), f * 3.0 + 1.0):
        state[ground.MOTOR, :axes] = force
        factor = ground.theft_factor(axes, device, state)
        best = np.array([factor * ground.best_theft(axis, device, state) for axis in range(axes)])

        def spent(speeds: ground.Floats, force: ground.Floats = force) -> float:
            slid = f @ np.abs(speeds) if acts_on_axes else f[0] * math.hypot(*speeds)
            return float(b @ (speeds * speeds) + slid + force @ speeds)

        for scale in (0.0, 0.9, 1.1, 2.0):
            assert spent(best) <= spent(scale * best)


@pytest.mark.parametrize("sensor", range(len(SENSORS)))
def test_readings_are_wrong_by_at_most_half_the_resolution(sensor: int) -> None:
    for number in range(10):
        code = encode(
            (sensor, number), np.random.default_rng(number).random(size("plain")).tolist()
        )
        case = path_case_of(f"plain:{code}")
        assert case.sensor == sensor
        _, trace = attack_path("certified", case)
        r = case.numbers["resolution"] / 2.0
        rounding = 1e-12 * (1.0 + np.abs(trace[:, 1]).max())
        assert np.abs(trace[:, 2] - trace[:, 1]).max() <= r + rounding


def size(certificate: str) -> int:
    return dimensions(CERTIFICATES[certificate])


@pytest.mark.parametrize("certificate", CERTIFICATES)
def test_a_case_is_made_again_from_its_name(certificate: str) -> None:
    code = encode((2, 7), np.random.default_rng(3).random(size(certificate)).tolist())
    for name in (f"{certificate}:11", f"{certificate}:{code}"):
        case = path_case_of(name)
        assert case == path_case_of(name)
        dissipation_of(case)  # refuses what is out of range
        times = plan_of(case).times
        read_ns, write_ns = times[:, ground.READ], times[:, ground.WRITE]
        assert (np.diff(read_ns) > 0).all()
        assert (write_ns >= read_ns).all()
        assert (write_ns[:-1] < read_ns[1:]).all()
        first, trace = attack_path("certified", case)
        again, trace_again = replay_path("certified", name)
        assert first == again
        assert np.array_equal(trace, trace_again, equal_nan=True)


@pytest.mark.parametrize("name", ["", "plain", "plain:", "plain:-1", "plain:c00", "plain:x"])
def test_a_name_that_is_no_case_is_refused(name: str) -> None:
    with pytest.raises(ConfigError, match=r"expected as case|no certificate"):
        path_case_of(name)


def test_the_campaign_reports_what_holds_and_what_leaks() -> None:
    reported: list[tuple[int, int]] = []
    document = run_certificates(
        ["certified"], ["own_axes"], 40, 40, 1, 0, lambda *progress: reported.append(progress)
    )
    (row,) = document["certificates"]
    assert reported[-1] == (document["runs"], document["runs"])
    assert row["holds"]
    assert row["runs"] == 80
    assert row["without"]["runs"] == 40
    again: PathResult = replay_path("certified", row["without"]["case"])[0]
    assert again.margin == row["without"]["margin_min_j"]
    assert run_certificates(["certified"], ["own_axes"], 40, 40, 1, 2) == document
    text = page(document, "the command")
    assert f"| {row['summary']} | `certified` | 80 | 0 |" in text
    assert f"`certified {row['without']['case']}`" in text


def test_what_is_no_certificate_is_refused() -> None:
    with pytest.raises(ConfigError, match="known are plain"):
        run_certificates(["certified"], ["unheard"], 1, 0)
    with pytest.raises(ConfigError, match="only a certified law"):
        run_certificates(["aol"], ["plain"], 1, 0)
    with pytest.raises(ConfigError, match="runs must be >= 1"):
        run_certificates(["certified"], ["plain"], 0, 0)


def test_the_command_attacks_a_certificate_and_shows_a_run_again(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    options = ["audit", "--runs", "20", "--search", "0", "--workers", "0", "--certificate", "plain"]
    done = CliRunner().invoke(main, [*options, "--law", "certified", "--json"])
    assert done.exit_code == 0, done.output
    document = json.loads(done.stdout)
    assert [row["law"] for row in document["laws"]] == ["certified"]
    assert [row["certificate"] for row in document["certificates"]] == ["plain"]
    broken = dataclasses.replace(LAWS["none"], is_certified=True)
    monkeypatch.setitem(LAWS, "certified", broken)
    done = CliRunner().invoke(main, [*options, "--law", "certified"])
    assert done.exit_code == 1, done.output
    assert "BROKEN" in done.stdout
    monkeypatch.undo()
    picture = tmp_path / "run.png"
    again = ["audit", "replay", "certified", "plain:3"]
    done = CliRunner().invoke(main, [*again, "--output", str(picture), "--json"])
    assert done.exit_code == 0, done.output
    assert json.loads(done.stdout)["margin"] == replay_path("certified", "plain:3")[0].margin
    assert picture.read_bytes().startswith(b"\x89PNG")
    shown = CliRunner().invoke(main, again).stdout
    (limit,) = re.findall(r"^hold_limit +(\S+) s$", shown, re.MULTILINE)
    assert 1.02e-3 <= float(limit) <= 2.5e-3
    assert re.search(r"^axes +[123]$", shown, re.MULTILINE)
    done = CliRunner().invoke(main, [*again, "--duration", "1 s"])
    assert "has a length of its own" in done.output
