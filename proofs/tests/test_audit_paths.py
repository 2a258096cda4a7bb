"""Attacks along any path: the ground truth by hand, and leaks are seen where there are some."""

import json
import math
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from forcebound.cli import main
from forcebound.compiled import record_type
from forcebound.errors import ConfigError
from forcebound.haptics.laws import ENERGY_TOLERANCE, Dissipation, ForceBounder
from forcebound.lab.engine import rows_of_each
from forcebound_proofs.paths.arm import walk_at_tip
from forcebound_proofs.paths.campaign import (
    LOWEST,
    PathCase,
    cases,
    drawn,
    replay,
    section,
    summary,
)
from forcebound_proofs.paths.certificates import CERTIFICATES
from forcebound_proofs.paths.search import Restart
from forcebound_proofs.paths.truth import (
    AXES,
    COPIES,
    Device,
    set_force,
    strike,
    walk,
    work_along_path,
)
from forcebound_proofs.sensitivity import MISTAKES, device_of, run, stated_by

pytestmark = pytest.mark.no_cover  # attacks by the thousand would take twice the time

CERTIFIED = ("certified", "certified_fading")


def devices(axes: int, presliding: float = 0.0, lag: float = 0.0) -> Any:
    """Return a device at rest, alike on each axis, and its copies."""
    found = np.zeros(1 + COPIES, record_type(Device))
    device = found[0]
    device.damping[:axes], device.friction[:axes] = 0.27, 0.12
    device.presliding[:axes], device.gain[:] = presliding, 1.0
    device.axes, device.lag, device.fastest = axes, lag, math.inf
    return found


def test_a_straight_move_costs_damping_friction_and_work() -> None:
    device = devices(1)[0]
    device.target[0] = 3.0
    energy = walk(device, 1e-3, np.array([-2e-3, 0.0, 0.0]))
    assert energy == pytest.approx(0.27 * 4e-6 / 1e-3 + 0.12 * 2e-3 - 3.0 * 2e-3)


def test_a_lagging_amplifier_works_with_the_force_that_it_has() -> None:
    device = devices(1, lag=4e-4)[0]
    device.target[0], device.output[0] = 3.0, -1.0
    times = np.linspace(0.0, 1e-3, 100_001)
    forces = 3.0 - 4.0 * np.exp(-times / 4e-4)
    mean = float(np.mean((forces[1:] + forces[:-1]) / 2.0))
    energy = walk(device, 1e-3, np.array([1e-3, 0.0, 0.0]))
    assert energy == pytest.approx(0.27e-3 + 0.12e-3 + mean * 1e-3, rel=1e-8)
    assert device.output[0] == pytest.approx(forces[-1])


def test_a_vector_of_bristles_is_dragged_as_small_steps_drag_it() -> None:
    device = devices(2, presliding=2e-4)[0]
    device.bristle[:2] = (0.5e-4, -1.6e-4)
    move = np.array([3e-4, 2e-4, 0.0])
    bristle, work, steps = device.bristle.copy(), 0.0, 20_000
    for _ in range(steps):
        before = bristle
        bristle = bristle + move / steps
        bristle *= min(1.0, 2e-4 / float(np.linalg.norm(bristle)))
        work += 0.12 / 2e-4 * float((before + bristle) @ move) / 2.0 / steps
    assert work_along_path(device, move) == pytest.approx(work, rel=1e-5)
    assert device.bristle == pytest.approx(bristle, abs=1e-8)


def test_a_closed_cycle_of_presliding_gives_nothing_back() -> None:
    device = devices(2, presliding=2e-4)[0]
    corners = np.random.default_rng(1).normal(size=(50, AXES)) * 2e-4
    corners[:, 2] = 0.0
    corners[-1] = corners[0]
    total = sum(work_along_path(device, after - before) for before, after in pairwise(corners))
    stored = 0.12 / 2e-4 * float(device.bristle @ device.bristle) / 2.0
    assert total > stored > 0.0


@pytest.mark.parametrize("lag", [0.0, 3e-4])
def test_the_hand_loses_as_much_at_the_tip_as_in_the_joints(lag: float) -> None:
    """With ever smaller moves the tip's straight way and the joints' become one."""
    errors = []
    for size in (2e-3, 2e-5):
        both = devices(2, lag=lag)
        both[0].target[:2], both[0].output[:2] = (0.3, -0.2), (0.1, 0.1)
        both[1], move = both[0], np.array([size, 0.7 * size, 0.0])
        joints, tip = walk(both[0], 1e-3, move), walk_at_tip(both[1], 1e-3, move)
        for name in ("position", "bristle", "output", "target"):
            assert both[1][name] == pytest.approx(both[0][name])
        errors.append(abs(tip / joints - 1.0))
    assert errors[0] < 1e-3
    assert errors[1] < errors[0] / 10.0


@pytest.mark.parametrize("axes", [1, 2])
@pytest.mark.parametrize("along", [True, False])
@pytest.mark.parametrize("presliding", [0.0, 2e-4])
def test_no_straight_move_is_worse_than_the_strike(
    axes: int, along: bool, presliding: float
) -> None:
    random, every = np.random.default_rng(2), devices(axes, presliding)
    every[0].is_along_path = along
    force = np.array([2.0, -1.0, 0.0]) * (np.arange(AXES) < axes)
    lowest = strike(every, [0.0], [force], [1e-3], math.inf)
    every[0].target[:] = force
    tried = []
    for _ in range(3000):
        move = random.normal(size=AXES) * 5e-3 * (np.arange(AXES) < axes)
        every[1] = every[0]
        tried.append(walk(every[1], 1e-3, move))
    assert lowest <= min(tried)
    assert lowest == pytest.approx(min(tried), rel=0.05)


def attack(certificate: str, law: str, left_out: bool = False, restarts: int = 1) -> Restart:
    """Return the restart with the lowest energy of a few short ones."""
    found = []
    for seed in range(restarts):
        random = np.random.default_rng(seed)
        one = drawn(certificate, law, random, left_out)
        one.search(random, 150)
        one.at_random(random, 30)
        found.append(one)
    return min(found, key=worst)


def worst(restart: Restart) -> float:
    assert restart.worst is not None
    return restart.worst.result.worst


@pytest.mark.parametrize("law", CERTIFIED)
@pytest.mark.parametrize("certificate", sorted(CERTIFICATES))
def test_no_certificate_leaks(certificate: str, law: str) -> None:
    assert worst(attack(certificate, law)) >= -ENERGY_TOLERANCE


@pytest.mark.parametrize("law", ["none", "less_conservative", "more_conservative", "aol", "tdpa"])
def test_the_laws_of_the_paper_leak(law: str) -> None:
    assert attack("plain", law, restarts=4).lowest < -1e-5


@pytest.mark.parametrize(
    "certificate", sorted(name for name in CERTIFICATES if CERTIFICATES[name].left_out)
)
def test_a_number_that_is_left_out_is_found(certificate: str) -> None:
    assert worst(attack(certificate, "certified", left_out=True, restarts=4)) < -1e-6


@pytest.mark.parametrize("late_ns", [3_900_000, 5_000_000])
def test_a_late_hold_that_the_hardware_ended_counts_as_one_that_was_replaced(late_ns: int) -> None:
    """Without friction the worst hold leaks exactly what the bounder says."""
    damping, period, limit = 0.27, 1e-3, 4e-3
    stated = Dissipation(
        damping=damping, friction=0.0, resolution=0.0, saturation=8.5, period=period,
        hold_limit=period, watchdog="none", watchdog_limit=limit, allowance=1e-2,
    )  # fmt: skip
    bounder, energy, position, time_ns = ForceBounder("certified", stated), 0.0, 0.0, 0
    bounder.start(0, (0.0,))
    for _ in range(20):
        position, time_ns = position + 2e-4, time_ns + 1_000_000
        energy += damping * 2e-4**2 / period
        bounder.settle(bounder.bound(time_ns, (position,), (0.0,)))
    time_ns += 1_000_000
    force = bounder.bound(time_ns, (position,), (8.5,))
    bounder.settle(force)
    held = min(late_ns * 1e-9, limit)
    move = force[0] * held / (2.0 * damping)
    energy += damping * move**2 / held - force[0] * move
    bounder.settle(bounder.bound(time_ns + late_ns, (position - move,), (0.0,)))
    assert bounder.largest_allowance == pytest.approx(-energy)


@pytest.mark.parametrize("gains", [(0.9, 1.1), (1.1, 0.9), (0.9, 0.9), (1.1, 1.1)])
@pytest.mark.parametrize("law", CERTIFIED)
def test_the_old_force_costs_what_the_strongest_motor_can_do(
    law: str, gains: tuple[float, float]
) -> None:
    """One axis stores work; the other holds a force that acts on until the next takes effect.

    The force moves from axis to axis in steps so small that friction pays for them.
    """
    delay, limit, push, ramp = 4e-4, 1e-3, 4.0, 0.2
    stated = Dissipation(
        damping=0.27, friction=(0.12, 0.12), resolution=0.0, saturation=8.5, period=1e-3,
        hold_limit=limit, gain_error=0.1, write_delay=delay,
    )  # fmt: skip
    every, bounder = devices(2), ForceBounder(law, stated, 2)
    device, energy, struck = every[0], 0.0, []
    device.gain[:2] = gains
    bounder.start(0, (0.0, 0.0))
    force: tuple[float, ...] = (0.0, 0.0)
    for index in range(300):
        if index < 200:
            asked, step = (push, 0.0), np.array([5e-5, 0.0, 0.0])
        else:
            asked = (force[0] - ramp, 0.0) if force[0] > ramp else (0.0, force[1] + ramp)
            step = np.zeros(AXES)
        read_ns = (index + 1) * 1_000_000
        force = bounder.bound(read_ns, tuple(device.position[:2].tolist()), asked)
        bounder.settle(force, read_ns + round(delay * 1e9))
        struck.append(energy + strike(every, [delay], [(*force, 0.0)], [limit], math.inf))
        energy += walk(device, delay, step * 0.4)
        set_force(device, (*force, 0.0))
        energy += walk(device, limit - delay, step * 0.6)
    assert force[1] > 1.0 or law != "certified"
    assert min(struck) >= -ENERGY_TOLERANCE


def test_a_run_is_repeated_by_its_name_and_drawn(tmp_path: Path) -> None:
    found = rows_of_each([PathCase("lag", "certified", True, kind, 2, 40) for kind in "rs"])
    for row in found:
        document, trace = replay("certified", row["case"])
        assert document[LOWEST] == row[LOWEST]
        assert len(trace) == document["samples"] - 1  # the first reading has no force
    (shown,) = summary([{**found[0], "left_out": False}, found[1]])
    assert shown["runs"] == shown["without"]["runs"] == 40
    assert f"| {found[1]['case']} |" in "\n".join(section([shown]))
    picture = tmp_path / "run.png"
    again = ["audit", "replay", "certified", found[0]["case"]]
    done = CliRunner().invoke(main, [*again, "--output", str(picture), "--json"])
    assert json.loads(done.stdout)[LOWEST] == found[0][LOWEST]
    assert picture.read_bytes().startswith(b"\x89PNG")
    done = CliRunner().invoke(main, [*again, "--duration", "1 s"])
    assert "--duration" in done.stderr


@pytest.mark.parametrize("name", ["all:r3.82", "gain_and_weight:r1.2", "joints:r1.65"])
def test_what_once_broke_a_certificate_no_longer_does(name: str) -> None:
    assert replay("certified", name)[0][LOWEST] >= -ENERGY_TOLERANCE


def test_every_certificate_is_attacked_with_and_without_its_number() -> None:
    found = cases(CERTIFIED, list(CERTIFICATES), 150, 700)
    informed = [one for one in found if not one.left_out]
    assert sum(one.runs for one in informed) == 850 * len(CERTIFICATES) * len(CERTIFIED)
    assert {one.certificate for one in informed} == set(CERTIFICATES)
    without = {one.certificate for one in found if one.left_out}
    assert without == {name for name, one in CERTIFICATES.items() if one.left_out}


def test_a_name_that_is_no_run_and_a_law_without_certificates_are_refused() -> None:
    for name in ("plain:", "plain:3", "plain:s3", "plain:x3.1", "nothing:s1.1"):
        with pytest.raises(ConfigError):
            replay("certified", name)
    with pytest.raises(ConfigError, match="'aol'"):
        cases(["aol"], ["plain"], 1, 0)
    with pytest.raises(ConfigError, match="'unheard'"):
        cases(["certified"], ["unheard"], 1, 0)


PHANTOM = "phantom_premium_1_5"


@pytest.mark.parametrize(
    ("summary", "most"),
    [
        ("nothing is wrong", None),
        ("guarding, any hand: nothing is wrong", None),
        ("guarding, any hand: first look 50 us late", -1e-4),
        ("guarding, any hand: drops a force 50 us after the look", -1e-4),
        ("readings wrong by 4r", -1e-4),
        ("reading to writing 400 us", -1e-4),
        ("the same, no largest speed stated", -1e-3),
    ],
)
def test_a_broken_promise_costs_energy_and_a_kept_one_none(
    summary: str, most: float | None
) -> None:
    lowest = 0.0
    for seed in range(3):
        random = np.random.default_rng(seed)
        found = Restart(device_of(PHANTOM, summary, random), 100)
        found.at_random(random, 30)
        found.search(random, 60)
        lowest = min(lowest, found.lowest)
    assert lowest >= -ENERGY_TOLERANCE if most is None else lowest < most


def test_the_device_states_its_own_numbers_and_each_mistake_is_reported_once() -> None:
    device = stated_by(PHANTOM)
    assert [device[name] for name in ("damping", "friction", "saturation")] == [0.27, 0.12, 8.5]
    with pytest.raises(ConfigError, match="'unheard'"):
        stated_by("unheard")
    words = ["audit", "sensitivity", "--runs", "2", "--workers", "0", "--json"]
    document = json.loads(CliRunner().invoke(main, words).stdout)
    assert document == run(PHANTOM, 2, 0)
    assert [row["summary"] for row in document["mistakes"]] == list(MISTAKES)


def test_the_table_of_the_docs_has_the_rows_of_the_command_that_prints_it() -> None:
    page = (Path(__file__).parents[2] / "docs/assumptions.md").read_text(encoding="utf-8")
    *_, table = page.partition("| what is wrong | lowest energy found |\n|---|---|\n")
    rows = table.partition("\n\n")[0].splitlines()
    assert [row.split(" | ")[0].removeprefix("| ") for row in rows] == list(MISTAKES)
