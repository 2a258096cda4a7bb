"""Identification of simulated devices, whose truth is known, in virtual time."""

import dataclasses
import math
from typing import Any

import numpy as np
import pytest

from experiments.identification_bounds import evaluate, is_reached, judge
from forcebound.devices import Device, DeviceModel
from forcebound.devices.five_bar import FiveBar
from forcebound.devices.phantom import PhantomPremium15
from forcebound.devices.stated_joints import TrueJoints
from forcebound.devices.true_values import TrueAxes, WeakSpot
from forcebound.errors import DeviceError
from forcebound.identification import estimators
from forcebound.identification.clock import VirtualClock
from forcebound.identification.estimators import Point
from forcebound.identification.procedure import Found, Plan, identify
from forcebound.messages.packets import Vector

KNOB = Plan(reach=0.03, force=4.25)
ARM = Plan(reach=0.35, force=0.06)


class Altered:
    """A device whose readings or forces something changes."""

    kinematics = None

    def __init__(self, device: Device) -> None:
        self._device = device
        self.axes = device.axes
        self.reading: Vector = (0.0,) * device.axes

    def engage(self, time_ns: int) -> None:
        self._device.engage(time_ns)

    def read(self, time_ns: int) -> Vector:
        self.reading = self._device.read(time_ns)
        return self.seen(self.reading)

    def write(self, time_ns: int, force: Vector) -> Vector:
        self._device.write(time_ns, self.acting(force))
        return force

    def truth(self) -> None:
        return None

    def close(self) -> None:
        self._device.close()

    def seen(self, reading: Vector) -> Vector:
        return reading

    def acting(self, force: Vector) -> Vector:
        return force


class Cogging(Altered):
    """Its motor has a force of its own that depends on the place: 20 mN, each 7 mm."""

    def acting(self, force: Vector) -> Vector:
        return (force[0] + 0.02 * math.sin(2.0 * math.pi * self.reading[0] / 7e-3),)


class Reversed(Altered):
    """The motor of its second axis is connected the wrong way round."""

    def acting(self, force: Vector) -> Vector:
        return (force[0], -force[1])


class Swapped(Altered):
    """The cables of its motors are swapped."""

    def acting(self, force: Vector) -> Vector:
        return (force[1], force[0])


def found_of(model: DeviceModel, plan: Plan, altered: type[Altered] | None = None) -> Found:
    device: Any = model.open(None, 1.25e-3)
    if altered is not None:
        device = altered(device)
    return identify(device, model, VirtualClock(), plan)


def test_bounds_hold_and_are_narrow() -> None:
    document = evaluate([judge(seed) for seed in (2, 4)])
    assert not document["failed"]
    assert is_reached(document), document["numbers"]


@pytest.mark.slow
def test_bounds_hold_in_many_identifications() -> None:
    document = evaluate([judge(seed) for seed in range(1, 101)])
    assert not document["failed"]
    assert is_reached(document), document["numbers"]


def test_less_friction_in_a_corner_is_found_out() -> None:
    middle = FiveBar().angles((0.0, 0.0))
    assert middle is not None
    spot = WeakSpot(centre=(middle[0] + 0.25, middle[1] + 0.25), radius=0.15, share=0.5)
    found = found_of(FiveBar(truth=TrueJoints(weak_spot=spot), substep=2.5e-4), ARM)
    for axis in found.axes:
        assert 0.7 * 0.5 * 4e-3 <= axis.friction.lower <= 0.5 * 4e-3
        weakest = min(axis.friction_of_parts, key=lambda cell: axis.friction_of_parts[cell])
        assert weakest[0] == len(ARM.poses) - 1  # the other axis at its far end
        assert weakest[1] >= ARM.parts - 3  # and this one, too


def test_weight_and_cogging_are_no_friction() -> None:
    weight = PhantomPremium15(truth=TrueAxes(weight=0.05), substep=2.5e-4)
    (axis,) = found_of(weight, KNOB).axes
    assert axis.load.estimate == pytest.approx(0.05, abs=1e-3)
    assert 0.05 <= axis.load.upper <= 0.055
    assert 0.9 * 0.12 <= axis.friction.lower <= 0.12
    (axis,) = found_of(PhantomPremium15(substep=2.5e-4), KNOB, Cogging).axes
    assert axis.load.upper >= 0.012  # means over parts of 5 mm
    assert 0.9 * 0.27 <= axis.damping.lower <= 0.27
    assert 0.9 * 0.12 <= axis.friction.lower <= 0.12


def test_a_motor_of_the_wrong_sign_is_found_before_anything_else() -> None:
    with pytest.raises(DeviceError, match="axis 2 has the wrong sign"):
        found_of(FiveBar(), ARM, Reversed)
    with pytest.raises(DeviceError, match="moves axis 2: motors or encoders are swapped"):
        found_of(FiveBar(), ARM, Swapped)


def test_what_does_not_move_or_flies_off_ends_it() -> None:
    with pytest.raises(DeviceError, match="does not move at a force"):
        found_of(PhantomPremium15(), dataclasses.replace(KNOB, force=0.1))
    falling = PhantomPremium15(truth=TrueAxes(weight=0.5))
    with pytest.raises(DeviceError, match="away from where it began"):
        found_of(falling, KNOB)


def points(damping: float, friction: float, noise: float) -> list[Point]:
    rng = np.random.default_rng(1)
    speeds = [speed for speed in (0.1, 0.5, 1.0, 2.0) for _ in range(4)]
    return [
        Point((0, part), v, damping * v + friction + noise * rng.standard_normal(), 0.0)
        for part in range(3)
        for v in speeds
    ]


def test_damping_and_friction_of_a_line() -> None:
    seen = points(2.0, 5.0, 0.01)
    damping = estimators.slope(seen)
    assert damping.lower < 2.0 < damping.upper
    friction, parts = estimators.friction(seen, damping)
    assert friction.lower < 5.0 < friction.upper
    assert len(parts) == 3


def test_an_outlier_hardly_changes_the_damping() -> None:
    seen = points(2.0, 5.0, 0.01)
    seen[7] = dataclasses.replace(seen[7], loss=20.0)
    assert estimators.slope(seen).estimate == pytest.approx(2.0, abs=0.03)


def test_friction_that_falls_with_the_speed_lowers_the_line() -> None:
    falling = [Point((0, 0), v, 5.0 - 2.0 * v, 0.0) for v in (0.1, 0.1, 1.0, 1.0)]
    assert estimators.below_all(falling, 0.0, 4.9) == pytest.approx(3.0)


def test_a_noisy_encoder_has_a_coarser_resolution() -> None:
    moving = np.linspace(0.0, 50.0, 101)
    assert estimators.resolution(moving, np.array([3.0, 3.5, 3.0])).upper == pytest.approx(0.5)
    assert estimators.resolution(moving, np.array([3.0, 4.5, 3.0])).upper == pytest.approx(2.0)


def test_a_yielding_that_no_push_has_shown_may_still_be_there() -> None:
    found = estimators.presliding(np.zeros(20), 0.8, 1.0, 1.1, 2e-3)
    assert found.estimate == found.lower == 0.0
    assert 0.2e-3 < found.upper < 2e-3


def test_quantiles_of_student() -> None:
    assert estimators.student(4) == pytest.approx(7.173)
    assert estimators.student(1e9) == pytest.approx(3.09, abs=1e-3)
    assert estimators.student(9) == pytest.approx(4.297, abs=0.02)  # not in the table
