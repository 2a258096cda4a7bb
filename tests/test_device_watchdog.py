"""Hold limit, watchdog and write delay of the simulated device."""

from dataclasses import replace
from typing import Any

import pytest
from builders import MS

from forcebound.haptics.devices.phantom import PhantomPremium15
from forcebound.haptics.devices.simulated import SimulatedDevice

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


def test_a_guarding_watchdog_leaves_the_force_on_up_to_its_limit() -> None:
    coarse = replace(FREE, resolution=1.0, watchdog_limit=20e-3)
    assert place_of_cut(pushed(coarse, hold_limit=2e-3), 20 * MS) == 0.0


def test_a_guard_starts_again_with_each_force() -> None:
    device = SimulatedDevice(replace(FREE, write_delay=3e-4), None, hold_limit=1.5e-3)
    device.read(0)
    device.write(0, (-1.0,))
    device.read(1_020_000)
    device.write(1_020_000, (1.0,))  # acts from 1.32 ms on; back where it began at 3.36 ms
    device.read(50 * MS)
    assert place_of_cut(device, 3_370_000) == pytest.approx(0.5 * 10 * 1.02e-3**2, rel=0.03)


@pytest.mark.parametrize(
    ("stated", "held"),
    [
        ({"watchdog": "silent"}, 2e-3),
        ({"watchdog": "none"}, 50e-3),
        ({"watchdog": "none", "watchdog_limit": 20e-3}, 20e-3),
    ],
)
def test_what_does_not_report_holds_a_force_for_its_time(stated: Any, held: float) -> None:
    device = pushed(replace(FREE, **stated), hold_limit=2e-3)
    assert device.truth().velocity[0] == pytest.approx(10 * held)
    assert device.cut() is None


@pytest.mark.parametrize("tolerance", [0.0, 0.25])
def test_a_force_that_has_moved_back_is_dropped_as_late_as_the_tolerance_permits(
    tolerance: float,
) -> None:
    device = pushed(replace(FREE, watchdog_tolerance=tolerance), hold_limit=2e-3)
    held = 2e-3 * (1 + tolerance)
    assert place_of_cut(device, round(held * 1e9)) == pytest.approx(0.5 * 10 * held**2)
    assert device.truth().velocity[0] == pytest.approx(10 * held)


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
    device.read(1_500_000)
    device.write(1_500_000, (-1.0,))  # acts from 2.3 ms on
    device.read(2_300_000)
    assert place_of_cut(device, 1_800_000) == pytest.approx(0.5 * 10 * 1e-3**2)
    assert device.truth().velocity[0] == pytest.approx(10 * 1e-3)
