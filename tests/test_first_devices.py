"""The shipped first devices: without a law active, with the certified one felt."""

import pytest

from forcebound.graph.loader import load
from forcebound.lab.feel import simulated_graph
from forcebound.run.virtual import run_virtual

FILES = ("five_bar_wall", "knob_wall", "haply_2diy", "odrive_knob")
DURATION = 3.0  # s; the hand rests in the wall after one


@pytest.mark.parametrize("name", FILES)
def test_without_a_law_the_hand_oscillates_and_receives_energy(name: str) -> None:
    summary = run_virtual(simulated_graph(name, ["law:=none"]), DURATION).summary
    assert summary["true_energy_min_j"] < -0.02
    assert not summary["at_rest"]
    more = summary["stiffness_n_per_m"]["felt"] > 1.005 * summary["stiffness_n_per_m"]["asked"]
    assert (summary["displayed_stiffness_share"] is None) == more
    assert ("displayed_stiffness_share" in summary["undefined"]) == more
    assert any("not known, since" in line for line in summary["verdict"]) == more


@pytest.mark.parametrize("name", FILES)
def test_with_the_certified_law_the_hand_rests_and_feels_the_wall(name: str) -> None:
    config = simulated_graph(name)
    run = run_virtual(config, DURATION)
    summary = run.summary
    assert summary["true_energy_min_j"] >= 0.0
    assert summary["at_rest"]
    share = summary["displayed_stiffness_share"]
    assert share == pytest.approx(
        summary["stiffness_n_per_m"]["felt"] / summary["stiffness_n_per_m"]["asked"]
    )
    assert share >= 0.9
    # In rest the force is the stiffness felt times the depth, and the hand's spring holds it, but
    # for friction.
    force = run.columns.applied_force[-1, 0]
    depth = summary["penetration_at_rest_m"]
    assert force == pytest.approx(share * 2000.0 * depth, rel=0.1)
    spring = run.columns.hand_force[-1, 0]
    assert abs(spring - force) < 0.3  # N: 4 mN m at 60 mm and both motors, 10 mN m at 40 mm


@pytest.mark.parametrize("name", ["haply_2diy", "odrive_knob"])
def test_a_port_and_its_emulator_have_the_same_limit(name: str) -> None:
    devices = [load(name, [f"device:={port}"]).only.device for port in ("emulated", "/dev/ttyACM0")]
    assert {device.longest_force for device in devices} == {0.03}


@pytest.mark.parametrize("name", ["servo_wall", "dynamixel_arm", "feetech_arm"])
def test_a_servo_arm_gives_energy_without_a_law_and_rests_with_one(name: str) -> None:
    free = run_virtual(simulated_graph(name, ["law:=none"]), DURATION).summary
    assert free["true_energy_min_j"] < -0.02
    assert not free["at_rest"]
    bounded = run_virtual(simulated_graph(name), DURATION).summary
    assert bounded["true_energy_min_j"] >= 0.0
    assert bounded["at_rest"]
    assert bounded["stiffness_n_per_m"]["felt"] > 0.5  # N m/rad
