"""Identification of simulated devices, whose truth is known, in virtual time."""

import dataclasses
import math
from typing import Any

import numpy as np
import pytest

from forcebound.errors import DeviceError
from forcebound.graph.servo import ServoSettings, dissipation_of
from forcebound.haptics.devices import Device, DeviceModel
from forcebound.haptics.devices.five_bar import FiveBar
from forcebound.haptics.devices.phantom import PhantomPremium15
from forcebound.haptics.devices.true_values import TrueAxes, TrueJoints, WeakSpot
from forcebound.lab.identification import document, estimators, gain
from forcebound.lab.identification.estimators import Bounded, Point
from forcebound.lab.identification.procedure import Found, Plan, identify
from forcebound.lab.identification.rig import VirtualClock
from forcebound.messages.packets import Vector
from forcebound_proofs.identified_devices import ARM, KNOB, Altered, Weighted

SHORT = dataclasses.replace(KNOB, levels=(0.4, 1.0), pushes=2, strokes=4)


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


class Coupled(FiveBar):
    """As if its axes were those of an arm's tip."""

    has_coupled_axes = True


def found_of(model: DeviceModel, plan: Plan, altered: type[Altered] | None = None) -> Found:
    device: Any = model.open(None, 1.25e-3)
    if altered is not None:
        device = altered(device)
    return identify(device, model, VirtualClock(), plan)


@pytest.mark.no_cover  # too many samples, as those below
def test_less_friction_in_a_corner_is_found_out() -> None:
    middle = FiveBar().angles((0.0, 0.0))
    assert middle is not None
    spot = WeakSpot(centre=(middle[0] + 0.25, middle[1] + 0.25), radius=0.15, share=0.5)
    plan = dataclasses.replace(ARM, poses=(0.0, 1.0), pushes=2, strokes=4)
    found = found_of(FiveBar(truth=TrueJoints(weak_spot=spot), substep=2.5e-4), plan)
    for axis in found.axes:
        assert 0.7 * 0.5 * 4e-3 <= axis.friction.lower <= 0.5 * 4e-3
        weakest = min(axis.friction_of_parts, key=lambda cell: axis.friction_of_parts[cell])
        assert weakest[0] == 1  # the other axis at its far end
        assert weakest[1] >= ARM.parts - 3  # and this one, too


@pytest.mark.no_cover
def test_weight_and_cogging_are_no_friction() -> None:
    weight = PhantomPremium15(truth=TrueAxes(weight=0.05), substep=2.5e-4)
    plan = dataclasses.replace(KNOB, pushes=2, strokes=4)
    (axis,) = found_of(weight, plan).axes
    assert axis.load.estimate == pytest.approx(0.05, abs=1e-3)
    assert 0.05 <= axis.load.upper <= 0.055
    assert 0.9 * 0.12 <= axis.friction.lower <= 0.12
    (axis,) = found_of(PhantomPremium15(substep=2.5e-4), plan, Cogging).axes
    assert axis.load.upper >= 0.012  # means over parts of 5 mm
    assert 0.9 * 0.27 <= axis.damping.lower <= 0.27
    assert 0.9 * 0.12 <= axis.friction.lower <= 0.12


def test_a_motor_of_the_wrong_sign_is_found_before_anything_else() -> None:
    with pytest.raises(DeviceError, match="axis 2 has the wrong sign"):
        found_of(FiveBar(), ARM, Reversed)
    with pytest.raises(DeviceError, match="moves axis 2: motors or encoders are swapped"):
        found_of(FiveBar(), ARM, Swapped)


class Interrupted(Altered):
    """A device whose user presses Ctrl-C at a tick."""

    def __init__(self, device: Device, ticks: int) -> None:
        super().__init__(device)
        self.ticks = ticks
        self.forces: list[Vector] = []

    def seen(self, reading: Vector) -> Vector:
        self.ticks -= 1
        if self.ticks == 0:
            raise KeyboardInterrupt
        return reading

    def acting(self, force: Vector) -> Vector:
        self.forces.append(force)
        return force


@pytest.mark.parametrize("ticks", [1500, 6000, 27_000])
def test_an_interrupted_identification_leaves_no_force(ticks: int) -> None:
    model = PhantomPremium15(substep=1e-3)
    device = Interrupted(model.open(None, 1.25e-3), ticks)
    with pytest.raises(KeyboardInterrupt):
        identify(device, model, VirtualClock(), KNOB)
    assert any(force != (0.0,) for force in device.forces)
    assert device.forces[-1] == (0.0,)


def test_what_does_not_move_or_flies_off_ends_it() -> None:
    with pytest.raises(DeviceError, match="does not move at a force"):
        found_of(PhantomPremium15(), dataclasses.replace(KNOB, force=0.1))
    falling = PhantomPremium15(truth=TrueAxes(weight=0.5))
    with pytest.raises(DeviceError, match="away from where it began"):
        found_of(falling, KNOB)


def test_a_lag_is_distinguished_from_none_and_then_no_watchdog_guards() -> None:
    plan = dataclasses.replace(KNOB, levels=(0.4, 1.0), pushes=2)
    slow = PhantomPremium15(truth=TrueAxes(lag=3e-4), substep=2.5e-4)
    for model, lag in ((slow, 3e-4), (PhantomPremium15(substep=2.5e-4), 0.0)):
        found = found_of(model, plan)
        (axis,) = found.axes
        assert axis.lag is not None
        assert axis.lag.lower <= lag <= axis.lag.upper <= lag + 3e-5
        stated = document.identified_model(model, found)
        assert (stated.lag >= lag, stated.watchdog == "reporting") == (True, lag > 0.0)
        dissipation_of(stated, ServoSettings())


def test_motors_of_different_gains_state_how_different_they_are() -> None:
    gain = (1.1, 0.9)
    model = FiveBar(truth=TrueJoints(gain=gain), substep=2.5e-4)
    device = Weighted(model.open(None, 1.25e-3), gain, 0.02)
    plan = dataclasses.replace(ARM, weight=0.02, poses=(0.0,), pushes=2, strokes=4)
    found = identify(device, model, VirtualClock(), plan, device.listen)
    stated = document.identified_model(model, found)
    assert 0.1 <= stated.gain_error <= 0.12
    uncertain = dataclasses.replace(model, attenuates="freely")  # has no proof with either
    stated_then = document.identified_model(uncertain, found)
    assert (stated_then.gain_error, stated_then.lag, set(stated_then.presliding)) == (0, 0, {0})
    assert stated_then.damping == stated.damping
    assert "gain_error" not in stated_then.sources
    as_tip = document.identified_model(Coupled(friction=(1e-3, 1.0), resolution=1e-2), found)
    assert as_tip.friction == (1e-3, stated.friction[1])  # only ever more careful
    assert as_tip.resolution == (1e-2, 1e-2)
    assert as_tip.sources["friction"] == "assumed"
    for damping, friction in zip(stated.damping, stated.friction, strict=True):
        assert 0.9 * 1e-3 <= damping <= 1e-3  # and not that over the gain, as a motor sees it
        assert 0.9 * 4e-3 <= friction <= 4e-3


def test_a_weight_that_is_not_hung_leaves_the_gain_unmeasured(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(gain, "USER_TIMEOUT", 5.0)
    lines: list[str] = []
    model = PhantomPremium15(substep=1e-3)
    for weight in (0.1, 1.0):
        plan = dataclasses.replace(SHORT, weight=weight)
        found = identify(model.open(None, 1.25e-3), model, VirtualClock(), plan, lines.append)
        assert found.gain == ()
        assert "gain_error" not in document.numbers_of(model, found)
    assert any("it should be" in line for line in lines)
    assert any("no weight was seen" in line for line in lines)


class StallingClock(VirtualClock):
    """A machine that stands still once."""

    def __init__(self, at: float, seconds: float) -> None:
        super().__init__()
        self._at_ns, self._stall_ns = round(1e9 * at), round(1e9 * seconds)

    def wait_until(self, time_ns: int) -> None:
        if time_ns >= self._at_ns:
            time_ns, self._stall_ns = time_ns + self._stall_ns, 0
        super().wait_until(time_ns)


def test_a_stall_of_the_machine_while_a_force_is_on_ends_it_without_force() -> None:
    model = PhantomPremium15(watchdog="none", watchdog_limit=100.0, substep=1e-3)
    device = Interrupted(model.open(None, 1.25e-3), ticks=0)
    with pytest.raises(DeviceError, match=r"late by 60 ms"):
        identify(device, model, StallingClock(8.0, 0.06), SHORT)
    assert device.forces[-1] == (0.0,)


def points(damping: float, friction: float, noise: float) -> list[Point]:
    rng = np.random.default_rng(1)
    speeds = [speed for speed in (0.1, 0.5, 1.0, 2.0) for _ in range(4)]
    return [
        Point((0, part), v, damping * v + friction + noise * rng.standard_normal(), 0.0)
        for part in range(3)
        for v in speeds
    ]


def test_damping_and_friction_of_a_line_with_an_outlier_or_without() -> None:
    seen = points(2.0, 5.0, 0.01)
    damping = estimators.slope(seen)
    assert damping.lower < 2.0 < damping.upper
    friction, parts = estimators.friction(seen, damping)
    assert friction.lower < 5.0 < friction.upper
    assert len(parts) == 3
    seen[7] = seen[7]._replace(loss=20.0)
    assert estimators.slope(seen).estimate == pytest.approx(2.0, abs=0.03)


def test_friction_that_falls_with_the_speed_lowers_the_line() -> None:
    falling = [Point((0, 0), v, 5.0 - 2.0 * v, 0.0) for v in (0.1, 0.1, 1.0, 1.0)]
    assert estimators.below_all(falling, 0.0, 4.9) == pytest.approx(3.0)


def test_a_noisy_encoder_has_a_coarser_resolution() -> None:
    moving = np.linspace(0.0, 50.0, 101)
    assert estimators.resolution(moving, np.array([3.0, 3.5, 3.0])).upper == pytest.approx(0.5)
    assert estimators.resolution(moving, np.array([3.0, 4.5, 3.0])).upper == pytest.approx(2.0)


def test_a_yielding_that_no_push_has_shown_may_still_be_there() -> None:
    found = estimators.presliding(np.zeros(20), 0.8, Bounded(1.0, 0.9, 1.1), 2e-3)
    assert found.estimate == found.lower == 0.0
    assert 0.2e-3 < found.upper < 2e-3


@dataclasses.dataclass(frozen=True, kw_only=True)
class Commanded(FiveBar):
    """An arm whose motors are commanded by a number of each joint."""

    torque_constant: tuple[float, ...] = (0.5, 0.4)

    @property
    def torque_scale(self) -> str:
        return "torque_constant"


def test_a_number_that_scales_the_torque_of_each_joint_is_corrected_by_the_gains() -> None:
    gain = (1.3, 0.8)
    model = Commanded(truth=TrueJoints(gain=gain), substep=2.5e-4, gain_error=0.3)
    device = Weighted(model.open(None, 1.25e-3), gain, 0.02)
    plan = dataclasses.replace(ARM, weight=0.02, poses=(0.0,), pushes=2, strokes=4)
    found = identify(device, model, VirtualClock(), plan, device.listen)
    stated = document.identified_model(model, found)
    assert stated.torque_constant == pytest.approx((0.5 * 1.3, 0.4 * 0.8), rel=0.02)
    assert stated.sources["torque_constant"] == "measured"
    assert stated.gain_error <= 0.02
    for damping, friction in zip(stated.damping, stated.friction, strict=True):
        assert 0.88 * 1e-3 <= damping <= 1e-3
        assert 0.88 * 4e-3 <= friction <= 4e-3
    one = document.identified_model(model, dataclasses.replace(found, gain=(found.gain[0], None)))
    assert one.torque_constant == (stated.torque_constant[0], 0.4)
    assert one.gain_error == 0.3  # of the motor that was not measured, as stated
    assert "torque_constant" not in one.sources
