"""The virtual coupling: what its proxy does, and when it is passive by itself."""

import logging

import pytest
from builders import MS, reply, state

from forcebound.graph.loader import load, load_tried
from forcebound.haptics.controllers import ControllerModel
from forcebound.haptics.controllers.direct import DirectController
from forcebound.haptics.controllers.virtual_coupling import OpenVirtualCoupling, VirtualCoupling
from forcebound.results.summary import summarize
from forcebound.run.virtual import run_virtual

SURFACE = 0.01  # m


def touch(
    opened: OpenVirtualCoupling, stiffness: float, depth: float, first: int = 0, ticks: int = 300
) -> list[float]:
    """Forces on the way from 5 mm before a wall to a depth in it, then at rest there."""
    forces = []
    for tick in range(first, first + ticks):
        position = SURFACE + min(depth, -0.005 + (tick - first) * 1e-4)
        force = opened.on_state(state(tick, position), tick * MS)
        (asked,), _ = opened.query(state(tick, position))
        opened.on_reply(reply(tick, max(stiffness * (asked - SURFACE), 0.0)), tick * MS)
        forces.append(0.0 if force is None else force[0])
    return forces


@pytest.mark.parametrize("mass", [0.0, 0.05])
@pytest.mark.parametrize("stiffness", [100.0, 2_000.0, 100_000.0])
def test_the_hand_feels_coupling_and_wall_in_series(stiffness: float, mass: float) -> None:
    coupling = VirtualCoupling(stiffness=500.0, damping=5.0, mass=mass)
    forces = touch(coupling.open(1), stiffness, 0.004)
    series = 500.0 * stiffness / (500.0 + stiffness)
    assert forces[-1] == pytest.approx(series * 0.004, rel=0.01)
    assert max(forces) < 1.5 * forces[-1]


def test_a_proxy_with_mass_is_felt_by_a_hand_that_speeds_up() -> None:
    opened = VirtualCoupling(stiffness=500.0, damping=5.0, mass=0.1).open(1)
    acceleration = 2.0
    for tick in range(400):
        time = tick * 1e-3
        now = state(tick, 0.5 * acceleration * time**2, velocity=acceleration * time)
        force = opened.on_state(now, tick * MS)
        opened.query(now)
        opened.on_reply(reply(tick, 0.0), tick * MS)
    assert force == pytest.approx((0.1 * acceleration,), rel=0.02)


def test_a_wall_that_is_gone_lets_the_proxy_go() -> None:
    opened = VirtualCoupling(stiffness=500.0).open(1)
    touch(opened, 10_000.0, 0.004)
    assert touch(opened, 0.0, 0.004, first=300, ticks=20)[-1] == pytest.approx(0.0, abs=1e-3)


def test_without_answers_the_force_fades_and_the_proxy_returns_to_the_hand() -> None:
    opened = VirtualCoupling(hold=0.1, fade=0.05).open(1)
    touch(opened, 10_000.0, 0.004)
    forces = []
    for tick in range(300, 500):
        forces.append(opened.on_state(state(tick, 0.014), tick * MS))
        opened.query(state(tick, 0.014))
    assert forces[90] == pytest.approx((250.0 * 0.004,), rel=0.05)
    assert forces[-1] is None
    assert opened.query(state(500, 0.014)) == ((0.014,), (0.0,))


def test_a_coupling_is_passive_by_itself_up_to_the_limit_of_its_device() -> None:
    damping, period, delay = 0.27, 1e-3, 0.4e-3
    limit = (damping - 0.02) / (0.5 * period + delay)
    assert not VirtualCoupling(limit * 0.999, 0.02).cautions(damping, period, delay)
    (sentence,) = VirtualCoupling(limit * 1.001, 0.02).cautions(damping, period, delay)
    assert f"up to {limit:.3g} N/m" in sentence


@pytest.mark.parametrize(
    ("controller", "least", "most"),
    [
        (DirectController(), -1.0, -1e-3),
        (VirtualCoupling(), -1e-6, 1e-3),
        (VirtualCoupling(stiffness=2000.0), -1.0, -1e-3),  # else the caution is about nothing
    ],
)
def test_without_a_law_a_soft_coupling_tames_a_wall_with_which_the_hand_gets_energy(
    controller: ControllerModel, least: float, most: float
) -> None:
    config = load("released_hand", ["law:=none", "stiffness:=20 N/mm"])
    result = run_virtual(config.with_hand(controller=controller), 2.0)
    assert least < summarize(result.columns, result.document)["true_energy_min_j"] <= most


def test_the_caution_is_said_when_a_launch_file_is_loaded(
    tmp_path_factory: pytest.TempPathFactory, caplog: pytest.LogCaptureFixture
) -> None:
    file = tmp_path_factory.mktemp("launch") / "coupled.yaml"
    text = "forcebound: 1\ninclude: stiff_wall.yaml\ncontroller: {{kind: virtual_coupling{}}}\n"
    with caplog.at_level(logging.WARNING):
        file.write_text(text.format(""))
        load_tried(file)
        assert not caplog.messages
        file.write_text(text.format(", stiffness: 2 N/mm"))
        load_tried(file)
    assert "controller: stiffness 2000 N/m and damping 0.02 N s/m" in caplog.messages[-1]
