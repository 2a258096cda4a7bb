"""Attacks along any path: the ground truth by hand, and leaks are seen where there are some."""

import json
import math
from collections.abc import Iterable
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
from forcebound_proofs.attack import MARGIN, RANDOM, SEARCH, Budget, Series, attack_named
from forcebound_proofs.audit import Options, replay, run
from forcebound_proofs.paths.arm import walk_at_tip
from forcebound_proofs.paths.campaign import WITHOUT, drawn
from forcebound_proofs.paths.certificates import CERTIFICATES, finished
from forcebound_proofs.paths.draft import plain
from forcebound_proofs.paths.run import PathResult, Walk
from forcebound_proofs.paths.search import Program, Restart
from forcebound_proofs.paths.truth import (
    AXES,
    COPIES,
    Device,
    Floats,
    set_force,
    walk,
    work_along_path,
    worst_hold,
)
from forcebound_proofs.sensitivity import MISTAKES, device_of, stated_by

pytestmark = pytest.mark.no_cover  # attacks by the thousand would take twice the time

CERTIFIED = ("certified", "certified_fading")
PAPERS = ("none", "less_conservative", "more_conservative", "aol", "tdpa")


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
def test_no_straight_move_is_worse_than_the_worst_hold(
    axes: int, along: bool, presliding: float
) -> None:
    random, every = np.random.default_rng(2), devices(axes, presliding)
    every[0].is_along_path = along
    force = np.array([2.0, -1.0, 0.0]) * (np.arange(AXES) < axes)
    lowest = worst_hold(every, [0.0], [force], [1e-3], math.inf)
    every[0].target[:] = force
    tried = []
    for _ in range(3000):
        move = random.normal(size=AXES) * 5e-3 * (np.arange(AXES) < axes)
        every[1] = every[0]
        tried.append(walk(every[1], 1e-3, move))
    assert lowest <= min(tried)
    assert lowest == pytest.approx(min(tried), rel=0.05)


def attacked(certificate: str, law: str, left_out: bool = False, restarts: int = 1) -> Restart:
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
    return restart.margin(restart.worst.result)


def daily(names: Iterable[str], *chosen: str) -> list[Any]:
    """Return parameters of which all but some are campaigns."""
    return [one if one in chosen else pytest.param(one, marks=pytest.mark.slow) for one in names]


@pytest.mark.parametrize("law", daily(CERTIFIED, "certified"))
@pytest.mark.parametrize("certificate", daily(sorted(CERTIFICATES), "all", "guarding", "plain"))
def test_no_certificate_leaks(certificate: str, law: str) -> None:
    assert worst(attacked(certificate, law)) >= -ENERGY_TOLERANCE


@pytest.mark.slow
@pytest.mark.parametrize("law", PAPERS)
def test_the_laws_of_the_paper_leak(law: str) -> None:
    found = attacked("plain", law, restarts=4)
    assert found.worst is not None
    assert found.worst.result.lowest_j < -1e-5


@pytest.mark.parametrize(
    "certificate",
    daily(sorted(name for name in CERTIFICATES if CERTIFICATES[name].left_out), "gain"),
)
def test_a_number_that_is_left_out_is_found(certificate: str) -> None:
    assert worst(attacked(certificate, "certified", left_out=True, restarts=4)) < -1e-6


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
    device, energy, lowest_ends = every[0], 0.0, []
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
        lowest_ends.append(energy + worst_hold(every, [delay], [(*force, 0.0)], [limit], math.inf))
        energy += walk(device, delay, step * 0.4)
        set_force(device, (*force, 0.0))
        energy += walk(device, limit - delay, step * 0.6)
    assert force[1] > 1.0 or law != "certified"
    assert min(lowest_ends) >= -ENERGY_TOLERANCE


def test_a_run_is_repeated_by_its_name() -> None:
    paths = attack_named("paths")
    kinds = {RANDOM: "lag", SEARCH: WITHOUT + "lag"}
    series = [Series("paths", "certified", of, kind, 2, 40) for kind, of in kinds.items()]
    rows = [row for one in series for row in one.rows()]
    for row in rows:
        assert replay("certified", row["case"])[MARGIN] == row[MARGIN]
    (shown,) = paths.summary(rows)
    assert shown["runs"] == shown["without"]["runs"] == 40
    assert f"| {rows[1]['case']} |" in "\n".join(paths.section([shown]))
    attack, case = paths, paths.make("lag:r2.7")
    outcome = attack.run("certified", case, is_traced=True)
    assert len(outcome.trace["time"]) == outcome.details["samples"] - 1  # none at the first reading


@pytest.mark.parametrize("name", ["all:r3.82", "gain_and_weight:r1.2", "joints:r1.65"])
def test_what_once_broke_a_certificate_no_longer_does(name: str) -> None:
    assert replay("certified", f"paths:{name}")[MARGIN] >= -ENERGY_TOLERANCE


def test_every_certificate_is_attacked_with_and_without_its_number() -> None:
    found = attack_named("paths").series((), (), Budget(150, 700))
    stated = [one for one in found if not one.target.startswith(WITHOUT)]
    assert sum(one.runs for one in stated) == 850 * len(CERTIFICATES) * len(CERTIFIED)
    assert {one.target for one in stated} == set(CERTIFICATES)
    without = {one.target.removeprefix(WITHOUT) for one in found if one not in stated}
    assert without == {name for name, one in CERTIFICATES.items() if one.left_out}


def test_a_name_that_is_no_run_and_a_law_without_certificates_are_refused() -> None:
    paths = attack_named("paths")
    for name in ("plain:", "plain:3", "plain:s3", "plain:x3.1", "nothing:s1.1"):
        with pytest.raises(ConfigError):
            paths.make(name)
    with pytest.raises(ConfigError, match="'aol'"):
        paths.series(["aol"], ["plain"], Budget(1, 0))
    with pytest.raises(ConfigError, match="'unheard'"):
        paths.series(["certified"], ["unheard"], Budget(1, 0))


PHANTOM = "phantom_premium_1_5"


@pytest.mark.parametrize(
    ("mistake", "most"),
    [
        ("nothing", None),
        ("delay_400us", -1e-4),
        pytest.param("any_hand", None, marks=pytest.mark.slow),
        pytest.param("look_50us", -1e-4, marks=pytest.mark.slow),
        pytest.param("drop_50us", -1e-4, marks=pytest.mark.slow),
        pytest.param("readings_4r", -1e-4, marks=pytest.mark.slow),
        pytest.param("wrong_readings_any_speed", -1e-3, marks=pytest.mark.slow),
    ],
)
def test_a_broken_promise_costs_energy_and_a_kept_one_none(
    mistake: str, most: float | None
) -> None:
    lowest = 0.0
    for seed in range(3):
        random = np.random.default_rng(seed)
        device = device_of(PHANTOM, mistake, random, "certified")
        found = Restart(device, 100, energy_alone=True)
        found.at_random(random, 30)
        found.search(random, 60)
        lowest = min(lowest, worst(found))
    assert lowest >= -ENERGY_TOLERANCE if most is None else lowest < most


def test_the_device_states_its_own_numbers_and_each_mistake_is_reported_once() -> None:
    device = stated_by(PHANTOM)
    assert [device[name] for name in ("damping", "friction", "saturation")] == [0.27, 0.12, 8.5]
    with pytest.raises(ConfigError, match="'unheard'"):
        stated_by("unheard")
    words = ["audit", "sensitivity", "--runs", "2", "--workers", "0", "--json"]
    document = json.loads(CliRunner().invoke(main, words).stdout)
    assert document == run({"sensitivity": ()}, (), Options(runs=0, searched=2, workers=0))
    found = [row["target"] for row in document["sensitivity"]]
    assert found == [f"{PHANTOM}/{mistake}" for mistake in MISTAKES]


# The two leaks of an earlier ledger: the attack finds them in a ledger that has them


class ForgetsForcesOnTheirWay(ForceBounder):
    """A ledger in which a force that does not act yet at the next reading never acts."""

    def settle(self, applied: Any, time_ns: int | None = None) -> None:
        self._ledger.waiting = 0
        super().settle(applied, time_ns)


@pytest.mark.parametrize(
    ("bounder", "leaks"), [(ForgetsForcesOnTheirWay, True), (ForceBounder, False)]
)
def test_a_force_on_its_way_that_is_forgotten_is_found(
    bounder: type[ForceBounder], leaks: bool
) -> None:
    lowest = 0.0
    for seed in range(4):
        random = np.random.default_rng(seed)
        restart = drawn("write_delay", "certified", random)
        case = restart.case
        restart.bounder = bounder(case.law, case.stated, case.axes)
        restart.at_random(random, 100)
        lowest = min(lowest, worst(restart))
    assert lowest < -1e-4 if leaks else lowest >= -ENERGY_TOLERANCE


TURN = 40  # samples of a ledger


class BeginsAgain:
    """Another ledger begins every ``TURN`` samples, after so many without a force."""

    def __init__(self, pause: int) -> None:
        self.pause = pause

    def begins(self, index: int, time_ns: int) -> bool:
        return index % TURN == 0

    def ends(self, index: int) -> bool:
        return index % TURN >= TURN - self.pause

    def credit(self, bounder: ForceBounder, time_ns: int) -> float:
        return 0.0

    def debit(self, bounder: ForceBounder, time_ns: int, commanded: tuple[float, ...]) -> float:
        return 0.0


class LedgersInTurn(Restart):
    pause = 1

    def run(
        self, program: Program, vector: Floats, trace: list[tuple[float, ...]] | None = None
    ) -> PathResult:
        genes, start = program.genes(vector)
        found = Walk(self.case, genes, self.bounder, start, trace, BeginsAgain(self.pause))
        for index in range(len(found.plan)):
            if index % TURN == 0:
                found.account.energy = 0.0  # each ledger must keep its hand's energy above zero
            found.step(index)
        return found.result()


@pytest.mark.parametrize(("pause", "leaks"), [(1, True), (30, False)])
def test_a_ledger_that_begins_while_a_lagging_motor_still_has_a_force_is_found(
    pause: int, leaks: bool
) -> None:
    """With a lag of three periods 30 periods leave next to nothing; the node waits longer."""
    lowest = 0.0
    for seed in range(2):
        random = np.random.default_rng(seed)
        draft = plain(random, 1)
        draft.fields["lag"] = draft.device.lag = 3.0 * draft.fields["period"]
        restart = LedgersInTurn(finished("certified", draft), 3 * TURN)
        restart.pause = pause
        restart.search(random, 120)
        lowest = min(lowest, worst(restart))
    assert lowest < -1e-5 if leaks else lowest >= -ENERGY_TOLERANCE


def test_the_table_of_the_docs_has_the_rows_of_the_command_that_prints_it() -> None:
    page = (Path(__file__).parents[2] / "proofs/docs/evidence.md").read_text(encoding="utf-8")
    *_, table = page.partition("| what is wrong | lowest energy found |\n|---|---|\n")
    rows = table.partition("\n\n")[0].splitlines()
    assert [row.split(" | ")[0].removeprefix("| ") for row in rows] == [
        one.summary for one in MISTAKES.values()
    ]
