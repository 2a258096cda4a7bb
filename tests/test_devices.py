"""The simulated device against mechanics."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import pytest
from builders import MS
from hypothesis import given, settings
from hypothesis import strategies as st

from forcebound.errors import ConfigError
from forcebound.graph.servo import ServoSettings, dissipation_of
from forcebound.haptics.devices import DEVICES, Device, DeviceModel
from forcebound.haptics.devices.phantom import PhantomPremium15
from forcebound.haptics.devices.plant import Axis, Moving, advance_extended, quantise
from forcebound.haptics.devices.simulated import SimulatedDevice
from forcebound.haptics.hands import Operator
from forcebound.haptics.hands.hands import PressingHand
from forcebound.messages.packets import Vector


@dataclass(frozen=True)
class StillHand(Operator):
    """A hand that stays where it is."""

    mass: float = 0.1
    stiffness: float = 0.0
    damping: float = 0.0
    place: float = 0.0

    def target(self, elapsed: float) -> Vector:
        return (self.place,)


SIMULATED = [kind for kind in sorted(DEVICES) if "devices" in DEVICES[kind].__module__]


def run(device: SimulatedDevice, forces: list[float], period_ns: int = MS) -> list[float]:
    """Hold each force for one period; return the energies after each."""
    device.read(0)
    device.engage(0)
    energies = []
    for k, force in enumerate(forces):
        device.write(k * period_ns, (force,))
        device.read((k + 1) * period_ns)
        energies.append(device.truth().energy)
    return energies


@given(
    forces=st.lists(st.floats(-8, 8), min_size=5, max_size=60),
    damping=st.floats(0.01, 3),
    friction=st.floats(0, 1),
    stiffness=st.floats(0, 2000),
)
@settings(max_examples=50)
def test_the_energy_balance_holds_to_rounding(
    forces: list[float], damping: float, friction: float, stiffness: float
) -> None:
    """What hand and motor give is kinetic energy or loss; the loss is never negative."""
    mass, x, v, work, motor, losses = 0.3, 0.0, 0.1, 0.0, 0.0, 0.0
    start = 0.5 * mass * v * v
    for force in forces:
        x0 = x
        before = 0.5 * mass * v * v
        axis = Axis(mass, damping, friction, 0.0, 0.0, 0.0, stiffness, 1.0)
        at = Moving(x, v, 0.0, 0.0, 0.0)
        (x, v, step_work, *_), _ = advance_extended(at, axis, 0.01, 0.012, 5e-5, 5e-5, force)
        work += step_work
        motor -= force * (x - x0)
        loss = step_work - force * (x - x0) - (0.5 * mass * v * v - before)
        minimum = damping * (x - x0) ** 2 / 5e-5 + friction * abs(x - x0)
        assert loss >= minimum - 1e-15
        losses += loss
    assert work + motor == pytest.approx(0.5 * mass * v * v - start + losses, abs=1e-12)


def test_a_pushed_mass_accelerates_by_force_over_mass() -> None:
    model = PhantomPremium15(mass=0.1, damping=0.0, friction=0.0, resolution=0.0)
    device = SimulatedDevice(model, StillHand(mass=0.3), hold_limit=1.0)
    run(device, [-2.0] * 100)
    truth = device.truth()
    assert truth.velocity[0] == pytest.approx(2.0 / 0.4 * 0.1)
    assert device.kinetic_energy() == pytest.approx(0.5 * 0.1 * truth.velocity[0] ** 2)
    assert truth.position[0] == pytest.approx(0.5 * 2.0 / 0.4 * 0.1**2)


def test_it_sticks_while_the_force_stays_below_the_friction_and_slips_above() -> None:
    model = PhantomPremium15(friction=0.12)
    device = SimulatedDevice(model, StillHand(), hold_limit=1.0)
    run(device, [0.1199] * 200)
    assert device.truth().position == (0.0,)
    assert device.truth().velocity == (0.0,)
    slipping = SimulatedDevice(model, StillHand(), hold_limit=1.0)
    run(slipping, [0.1201] * 200)
    assert slipping.truth().position[0] < 0.0


def test_a_sliding_mass_stops_after_the_way_that_friction_allows() -> None:
    mass, friction, v = 0.2, 0.4, 0.5
    moving, axis = Moving(0.0, v, 0.0, 0.0, 0.0), Axis(mass, 0.0, friction, 0.0, 0.0, 0.0, 0.0, 0.0)
    for _ in range(2000):
        moving, _ = advance_extended(moving, axis, 0.0, 0.0, 1e-3, 5e-5, 0.0)
    assert moving.v == 0.0
    assert moving.x == pytest.approx(0.5 * mass * 0.5**2 / friction, rel=1e-3)


def test_a_hand_oscillates_with_the_frequency_of_its_spring() -> None:
    mass, stiffness = 0.25, 1000.0
    axis = Axis(mass, 0.0, 0.0, 0.0, 0.0, 0.0, stiffness, 0.0)
    moving, crossings, before = Moving(0.01, 0.0, 0.0, 0.0, 0.0), [], 0.01
    for k in range(2000):
        moving, _ = advance_extended(moving, axis, 0.0, 0.0, 1e-3, 5e-5, 0.0)
        if before > 0 >= moving.x:
            crossings.append(k + before / (before - moving.x))
        before = moving.x
    period = (crossings[-1] - crossings[0]) / (len(crossings) - 1) * 1e-3
    assert period == pytest.approx(2 * math.pi * math.sqrt(mass / stiffness), rel=1e-4)


def test_it_integrates_over_the_time_that_passed_whatever_the_reads_between() -> None:
    model = PhantomPremium15(resolution=0.0, friction=0.0)
    ends = []
    for reads in ([7_000_000], [1_300_000, 2_000_001, 6_999_999, 7_000_000]):
        device = SimulatedDevice(model, StillHand(stiffness=500.0, place=0.0), hold_limit=1.0)
        device.read(0)
        device.write(0, (-1.0,))
        for time_ns in reads:
            device.read(time_ns)
        ends.append(device.truth().position[0])
    assert ends[0] == pytest.approx(ends[1], rel=1e-3)
    assert ends[0] > 0


def test_the_reading_is_quantised_and_the_truth_is_not() -> None:
    device = SimulatedDevice(PhantomPremium15(resolution=3e-5), StillHand(), hold_limit=1.0)
    run(device, [-1.0] * 30)
    reading, truth = device.read(30 * MS)[0], device.truth().position[0]
    assert reading != truth
    assert abs(reading - truth) <= 1.5e-5
    assert reading / 3e-5 == pytest.approx(round(reading / 3e-5))


@given(st.floats(-1, 1), st.sampled_from([0.0, 1e-6, 3e-5, 2e-4]))
def test_quantisation_errs_by_half_a_step_at_most(x: float, resolution: float) -> None:
    assert abs(quantise(x, resolution) - x) <= resolution / 2 * (1 + 1e-9)


def test_a_hand_pressing_without_force_feedback_reaches_its_target_and_gives_energy() -> None:
    device = SimulatedDevice(PhantomPremium15(), PressingHand(), hold_limit=1.25e-3)
    energies = run(device, [0.0] * 2000)
    assert device.truth().position[0] == pytest.approx(0.014, abs=0.12 / 950)
    assert min(energies) >= -1e-12
    assert energies[-1] > 0.12 * 0.024 * 0.99  # at least friction times the way


def test_it_rests_until_it_is_engaged() -> None:
    device = SimulatedDevice(PhantomPremium15(), PressingHand(), hold_limit=1.25e-3)
    device.read(0)
    device.read(3_000 * MS)
    assert device.truth().position == (-0.010,)
    device.engage(3_000 * MS)
    device.read(3_100 * MS)
    assert device.truth().position[0] > 0.0


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("mass", 0.0),
        ("damping", -1.0),
        ("axes", 9),
        ("gain_error", 1.0),
        ("watchdog_tolerance", -0.1),
        ("largest_speed", 0.0),
        ("presliding", (1e-5, 1e-5)),
        ("presliding", -1e-5),
        ("sources", {"dampning": "measured"}),
    ],
)
def test_stated_numbers_without_meaning_are_refused(name: str, value: Any) -> None:
    with pytest.raises(ValueError, match=name):
        replace(PhantomPremium15(), **{name: value})


@pytest.mark.parametrize("kind", sorted(set(DEVICES) - {"program", "robot"}))  # of users' own
def test_a_device_that_ships_states_a_largest_speed_and_says_whether_it_was_measured(
    kind: str,
) -> None:
    make: Callable[..., DeviceModel] = DEVICES[kind]
    model = make()  # pyright: ignore[reportCallIssue]
    assert 0.0 < dissipation_of(model, ServoSettings()).largest_speed < math.inf
    assert model.sources["largest_speed"] == "assumed"


@dataclass(frozen=True)
class Bare(DeviceModel):
    """A device that states nothing of what drops a force."""

    axes: int = 1
    damping: float = 0.27
    friction: float = 0.12
    resolution: float = 3e-5
    saturation: float = 8.5

    def open(self, operator: Operator | None, hold_limit: float) -> Device:
        raise NotImplementedError


@pytest.mark.parametrize(
    ("stated", "error", "message"),
    [
        ({}, TypeError, "watchdog"),
        ({"watchdog": "loud"}, ConfigError, "watchdog"),
        ({"watchdog": "silent"}, ConfigError, "watchdog_tolerance"),
        ({"watchdog": "none"}, ConfigError, "watchdog_limit"),
        ({"watchdog": "guarding"}, ConfigError, "guard_period"),
    ],
)
def test_a_device_must_state_what_drops_a_force_that_nobody_renews(
    stated: dict[str, Any], error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message):
        dissipation_of(Bare(**stated), ServoSettings())
