"""The simulated device against mechanics."""

import math
from dataclasses import dataclass, replace
from typing import Any, Literal

import pytest
from builders import MS
from fakes import FakeDevice
from hypothesis import given, settings
from hypothesis import strategies as st

from forcebound.devices import DEVICES, DeviceModel
from forcebound.devices.guard import GuardedDevice
from forcebound.devices.phantom import PhantomPremium15
from forcebound.devices.plant import advance, quantise
from forcebound.devices.simulated import SimulatedDevice
from forcebound.errors import DeviceError
from forcebound.messages.packets import Vector
from forcebound.operators.pressing import PressingHand


@dataclass(frozen=True)
class StillHand:
    """A hand that stays where it is."""

    mass: float = 0.1
    stiffness: float = 0.0
    damping: float = 0.0
    place: float = 0.0

    def target(self, elapsed: float) -> Vector:
        return (self.place,)


SIMULATED = [kind for kind in sorted(DEVICES) if "devices" in DEVICES[kind].__module__]


@pytest.fixture(params=SIMULATED)
def model(request: pytest.FixtureRequest) -> DeviceModel:
    return DEVICES[request.param]()


def test_a_device_reads_and_applies_one_value_per_axis(model: DeviceModel) -> None:
    device = model.open(PressingHand(), hold_limit=1.25e-3)
    assert device.axes == model.axes
    assert len(device.read(0)) == model.axes
    assert device.write(0, (0.05,) * model.axes) == (0.05,) * model.axes


def test_a_device_never_applies_more_than_its_saturation(model: DeviceModel) -> None:
    device = model.open(PressingHand(), hold_limit=1.25e-3)
    for asked in (1e3, -1e30, math.inf, math.nan):
        applied = device.write(0, (asked,) * model.axes)
        assert math.hypot(*applied) <= model.saturation * (1 + 1e-12)


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
        x, v, step_work, _ = advance(
            x, v, 0.0, 0.01, 0.012, 5e-5, 5e-5, force, mass, damping, friction, stiffness, 1.0
        )
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
    assert truth.position[0] == pytest.approx(0.5 * 2.0 / 0.4 * 0.1**2)


def test_a_pushed_damped_mass_reaches_force_over_damping() -> None:
    model = PhantomPremium15(mass=0.1, damping=2.0, friction=0.5, resolution=0.0)
    device = SimulatedDevice(model, StillHand(mass=0.0), hold_limit=1.0)
    run(device, [-2.0] * 2000)
    assert device.truth().velocity[0] == pytest.approx((2.0 - 0.5) / 2.0, rel=1e-6)


def test_it_sticks_while_the_force_stays_below_the_friction_and_slips_above() -> None:
    model = PhantomPremium15(friction=0.12)
    device = SimulatedDevice(model, StillHand(), hold_limit=1.0)
    run(device, [0.1199] * 200)
    assert device.truth().position == (0.0,)
    assert device.truth().velocity == (0.0,)
    run(SimulatedDevice(model, StillHand(), hold_limit=1.0), [0.1201] * 200)
    slipping = SimulatedDevice(model, StillHand(), hold_limit=1.0)
    run(slipping, [0.1201] * 200)
    assert slipping.truth().position[0] < 0.0


def test_a_sliding_mass_stops_after_the_way_that_friction_allows() -> None:
    mass, friction, v = 0.2, 0.4, 0.5
    x, work = 0.0, 0.0
    for _ in range(2000):
        x, v, work, _ = advance(
            x, v, work, 0.0, 0.0, 1e-3, 5e-5, 0.0, mass, 0.0, friction, 0.0, 0.0
        )
    assert v == 0.0
    assert x == pytest.approx(0.5 * mass * 0.5**2 / friction, rel=1e-3)


def test_a_hand_oscillates_with_the_frequency_of_its_spring() -> None:
    mass, stiffness = 0.25, 1000.0
    x, v, work, crossings, before = 0.01, 0.0, 0.0, [], 0.01
    for k in range(2000):
        x, v, work, _ = advance(
            x, v, work, 0.0, 0.0, 1e-3, 5e-5, 0.0, mass, 0.0, 0.0, stiffness, 0.0
        )
        if before > 0 >= x:
            crossings.append(k + before / (before - x))
        before = x
    period = (crossings[-1] - crossings[0]) / (len(crossings) - 1) * 1e-3
    assert period == pytest.approx(2 * math.pi * math.sqrt(mass / stiffness), rel=1e-4)


def test_the_watchdog_drops_the_force_at_the_very_instant() -> None:
    model = PhantomPremium15(mass=0.1, damping=0.0, friction=0.0, resolution=0.0)
    device = SimulatedDevice(model, StillHand(mass=0.0), hold_limit=2e-3)
    device.read(0)
    device.write(0, (-1.0,))
    device.read(50 * MS)
    assert device.truth().velocity[0] == pytest.approx(1.0 / 0.1 * 2e-3)


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


def test_axes_without_a_target_rest_at_zero_and_can_be_pushed() -> None:
    device = SimulatedDevice(PhantomPremium15(axes=3), PressingHand(), hold_limit=1.0)
    assert device.read(0) == pytest.approx((-0.010, 0.0, 0.0), abs=1.5e-5)
    device.write(0, (0.0, -1.0, 0.0))
    device.read(20 * MS)
    assert device.truth().position[1] > 0.0
    assert device.truth().position[2] == 0.0


@pytest.mark.parametrize(
    ("name", "value", "unit"),
    [("mass", 0.0, "kg"), ("saturation", -1.0, "N"), ("substep", 0.0, "s"), ("damping", -1.0, "N")],
)
def test_parameters_without_meaning_are_refused(name: str, value: Any, unit: str) -> None:
    with pytest.raises(ValueError, match=f"{name} must be .* {unit}"):
        replace(PhantomPremium15(), **{name: value})


@pytest.mark.parametrize("axes", [0, 7])
def test_a_device_has_one_to_six_axes(axes: int) -> None:
    with pytest.raises(ValueError, match="axes must be 1 to 6"):
        PhantomPremium15(axes=axes)


# Hold limit, watchdog, write delay

FREE = PhantomPremium15(mass=0.1, damping=0.0, friction=0.0, resolution=0.0)


def pushed(model: PhantomPremium15, hold_limit: float) -> SimulatedDevice:
    """A device without hand or losses, pushed with 1 N from 0 to 50 ms: 10 m/s for each second."""
    device = SimulatedDevice(model, None, hold_limit)
    device.read(0)
    device.write(0, (-1.0,))
    device.read(50 * MS)
    return device


def place_of_cut(device: SimulatedDevice, time_ns: int) -> float:
    """The reading at a cut that was reported for this time."""
    report = device.cut()
    assert report is not None
    assert report[0] == time_ns
    return report[1][0]


def test_a_hold_limit_that_is_set_holds_from_the_next_write_on() -> None:
    device = pushed(FREE, hold_limit=2e-3)
    device.set_hold_limit(5e-3)
    device.read(60 * MS)
    assert device.truth().velocity[0] == pytest.approx(10 * 2e-3)
    device.write(60 * MS, (-1.0,))
    device.read(90 * MS)
    assert device.truth().velocity[0] == pytest.approx(10 * (2e-3 + 5e-3))


def test_a_reporting_watchdog_says_when_and_where_it_dropped_the_force() -> None:
    device = pushed(replace(FREE, watchdog="reporting"), hold_limit=2e-3)
    assert place_of_cut(device, 2 * MS) == pytest.approx(0.5 * 10 * 2e-3**2)
    device.write(50 * MS, (-1.0,))
    assert device.cut() is None  # none since the last write
    device.read(51 * MS)
    assert device.cut() is None


def test_a_guarding_watchdog_drops_a_late_force_when_a_reading_has_moved_back() -> None:
    device = pushed(replace(FREE, resolution=1e-4), hold_limit=2e-3)
    moved_back = 3_200_000  # ns: of the looks every 50 us the first after sqrt(2 * 50 um / 10 m/s²)
    assert place_of_cut(device, moved_back) == pytest.approx(1e-4)
    assert device.truth().velocity[0] == pytest.approx(10 * 3.2e-3)


def test_a_guarding_watchdog_drops_a_force_at_the_hold_limit_that_has_moved_back_before() -> None:
    assert place_of_cut(pushed(FREE, hold_limit=2e-3), 2 * MS) == pytest.approx(0.5 * 10 * 2e-3**2)


def test_a_guarding_watchdog_leaves_the_force_on_up_to_its_limit() -> None:
    coarse = replace(FREE, resolution=1.0, watchdog_limit=20e-3)
    assert place_of_cut(pushed(coarse, hold_limit=2e-3), 20 * MS) == 0.0


def test_a_guard_begins_anew_with_each_force() -> None:
    device = SimulatedDevice(replace(FREE, write_delay=3e-4), None, hold_limit=1.5e-3)
    device.read(0)
    device.write(0, (-1.0,))
    device.read(1_020_000)
    device.write(1_020_000, (1.0,))  # acts from 1.32 ms on; back where it began at 3.36 ms
    device.read(50 * MS)
    assert place_of_cut(device, 3_370_000) == pytest.approx(0.5 * 10 * 1.02e-3**2, rel=0.03)


def test_a_silent_watchdog_drops_the_force_and_reports_nothing() -> None:
    device = pushed(replace(FREE, watchdog="silent"), hold_limit=2e-3)
    assert device.truth().velocity[0] == pytest.approx(10 * 2e-3)
    assert device.cut() is None


@pytest.mark.parametrize(("limit", "held"), [("auto", 50e-3), (20e-3, 20e-3)])
def test_without_a_watchdog_a_force_stays_on_until_the_hardware_ends_it(
    limit: float | Literal["auto"], held: float
) -> None:
    device = pushed(replace(FREE, watchdog="none", watchdog_limit=limit), hold_limit=2e-3)
    assert device.truth().velocity[0] == pytest.approx(10 * held)
    assert device.cut() is None


def test_the_watchdog_is_as_late_as_its_tolerance_permits() -> None:
    device = pushed(replace(FREE, watchdog_tolerance=0.25), hold_limit=2e-3)
    assert device.truth().velocity[0] == pytest.approx(10 * 2.5e-3)


def test_a_force_acts_after_the_write_delay_and_the_one_before_until_then() -> None:
    device = SimulatedDevice(replace(FREE, write_delay=3e-4), None, hold_limit=2e-3)
    device.read(0)
    device.write(0, (-1.0,))
    assert device.stamps() == (0, 300_000)
    device.read(MS)
    assert device.truth().velocity[0] == pytest.approx(10 * 0.7e-3)
    device.write(MS, (0.0,))
    assert device.stamps() == (MS, MS + 300_000)
    device.read(10 * MS)
    assert device.truth().velocity[0] == pytest.approx(10 * 1e-3)


def test_the_hold_limit_counts_from_the_moment_when_the_force_acts() -> None:
    device = pushed(replace(FREE, write_delay=3e-4), hold_limit=2e-3)
    assert device.truth().velocity[0] == pytest.approx(10 * 2e-3)
    assert place_of_cut(device, 2_300_000) == pytest.approx(0.5 * 10 * 2e-3**2)


def test_a_force_can_be_cut_before_the_next_one_acts() -> None:
    device = SimulatedDevice(replace(FREE, write_delay=8e-4), None, hold_limit=1e-3)
    device.read(0)
    device.write(0, (-1.0,))  # acts from 0.8 to 1.8 ms
    device.write(1_500_000, (-1.0,))  # acts from 2.3 ms on
    device.read(2_300_000)
    assert place_of_cut(device, 1_800_000) == pytest.approx(0.5 * 10 * 1e-3**2)
    assert device.truth().velocity[0] == pytest.approx(10 * 1e-3)


@pytest.mark.parametrize(
    ("name", "value"),
    [
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


# The guard around a device of the user's own


class Crank:
    """Kinematics of a crank with an arm of 0.1 m."""

    def position(self, angles: Vector) -> Vector:
        return (0.1 * math.sin(angles[0]),)

    def torque(self, angles: Vector, force: Vector) -> Vector:
        if abs(math.cos(angles[0])) < 0.1:
            raise ValueError("the crank is at its dead centre")
        return (0.1 * math.cos(angles[0]) * force[0],)


class Extended(FakeDevice):
    """A device with all optional members."""

    kinematics = Crank()
    hold_limit = 0.0
    report: object = (5, (0.1,))
    fresh: Vector | None = (0.3,)

    def set_hold_limit(self, seconds: float) -> None:
        self.hold_limit = seconds

    def cut(self) -> Any:
        return self.report

    def stamps(self) -> tuple[int, int]:
        return 1, 2

    def fresh_reading(self) -> Vector | None:
        return self.fresh


def test_the_guard_passes_on_the_optional_members() -> None:
    device = Extended()
    guarded = GuardedDevice(device)
    assert guarded.set_hold_limit is not None
    assert guarded.cut is not None
    assert guarded.stamps is not None
    assert guarded.fresh_reading is not None
    assert guarded.kinematics is not None
    guarded.set_hold_limit(2e-3)
    assert device.hold_limit == 2e-3
    assert guarded.cut() == (5, (0.1,))
    assert guarded.stamps() == (1, 2)
    assert guarded.fresh_reading() == (0.3,)
    assert guarded.kinematics.position((0.0,)) == (0.0,)
    assert guarded.kinematics.torque((0.0,), (2.0,)) == (0.2,)


def test_the_guard_of_a_device_without_optional_members_has_none() -> None:
    guarded = GuardedDevice(FakeDevice())
    members = guarded.set_hold_limit, guarded.cut, guarded.stamps, guarded.fresh_reading
    assert (*members, guarded.kinematics) == (None,) * 5


@pytest.mark.parametrize("report", [(5,), (5, (0.1, 0.2)), (5, (math.nan,)), "soon"])
def test_the_guard_refuses_a_cut_without_a_time_and_a_reading(report: object) -> None:
    device = Extended()
    device.report = report
    cut = GuardedDevice(device).cut
    assert cut is not None
    with pytest.raises(DeviceError, match="failed in cut"):
        cut()


def test_the_guard_refuses_a_fresh_reading_that_is_no_number() -> None:
    device = Extended()
    fresh_reading = GuardedDevice(device).fresh_reading
    assert fresh_reading is not None
    device.fresh = None
    assert fresh_reading() is None
    device.fresh = (math.nan,)
    with pytest.raises(DeviceError, match="failed in fresh_reading"):
        fresh_reading()


def test_the_guard_reports_kinematics_that_fail() -> None:
    kinematics = GuardedDevice(Extended()).kinematics
    assert kinematics is not None
    with pytest.raises(DeviceError, match=r"failed in torque: .*dead centre"):
        kinematics.torque((math.pi / 2,), (1.0,))
