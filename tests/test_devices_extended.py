"""The plant with presliding, lag and weight against mechanics."""

import math
from dataclasses import replace
from itertools import pairwise
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from forcebound.errors import ConfigError
from forcebound.graph.loader import from_document
from forcebound.graph.model import always, restore
from forcebound.graph.resolved import to_document
from forcebound.haptics.devices.phantom import PhantomPremium15
from forcebound.haptics.devices.plant import Axis, Moving, advance_extended
from forcebound.haptics.devices.simulated import SimulatedDevice
from forcebound.haptics.devices.true_values import TrueAxes
from forcebound.messages.packets import Vector

H = 5e-5  # s
AT_REST = Moving(0.0, 0.0, 0.0, 0.0, 0.0)


def friction_work(bristle: float, end: float, dx: float, friction: float, z: float) -> float:
    """Change of the stored energy, and what slides."""
    stored = 0.5 * friction / z * (end * end - bristle * bristle)
    return stored + friction * abs(dx - (end - bristle))


@given(
    forces=st.lists(st.floats(-8, 8), min_size=5, max_size=60),
    damping=st.floats(0.01, 3),
    friction=st.floats(0.001, 1),
    presliding=st.floats(1e-6, 1e-3),
    stiffness=st.floats(0, 2000),
    weight=st.floats(-1, 1),
    lag=st.sampled_from([0.0, 2e-5, 5e-4]),
)
@settings(max_examples=50)
def test_the_energy_balance_holds_to_rounding(
    forces: list[float],
    damping: float,
    friction: float,
    presliding: float,
    stiffness: float,
    weight: float,
    lag: float,
) -> None:
    """What hand, motor and weight give is kinetic, stored or lost, in each step."""
    mass, x, v, bristle, motor = 0.3, 0.0, 0.1, 0.0, 0.0
    axis = Axis(mass, damping, friction, presliding, weight, lag, stiffness, 1.0)
    for told in forces:
        x0, v0, bristle0, motor0 = x, v, bristle, motor
        before = Moving(x, v, 0.0, bristle, motor)
        after, _ = advance_extended(before, axis, 0.01, 0.012, H, H, told)
        x, v, work, bristle, motor = after
        dx = x - x0
        # The motor's own law: lag times its change is the force that it was short of.
        given_force = told + lag * (motor0 - motor) / H
        spent = damping * dx * dx / H + friction_work(bristle0, bristle, dx, friction, presliding)
        kinetic = 0.5 * mass * (v * v - v0 * v0)
        assert work - (weight + given_force) * dx == pytest.approx(spent + kinetic, abs=1e-13)
        assert abs(bristle) <= presliding


def slide(positions: list[float], friction: float, presliding: float) -> tuple[float, float]:
    """Work against the friction of a heavy mass that follows a path; and what it stores."""
    loss, bristle, x = 0.0, 0.0, 0.0
    for end in positions:
        mass = 1e9
        v = (end - x) / H
        axis = Axis(mass, 0.0, friction, presliding, 0.0, 0.0, 0.0, 0.0)
        end_of, _ = advance_extended(Moving(x, v, 0.0, bristle, 0.0), axis, 0.0, 0.0, H, H, 0.0)
        loss += friction_work(bristle, end_of.bristle, end_of.x - x, friction, presliding)
        x, bristle = end_of.x, end_of.bristle
    return loss, 0.5 * friction / presliding * bristle**2


def test_dither_within_the_presliding_loses_nothing() -> None:
    path = [1e-5 * math.sin(0.1 * k) for k in range(2001)]
    loss, stored = slide(path, friction=0.12, presliding=1.5e-5)
    assert loss == pytest.approx(stored, abs=1e-12)
    assert 0.12 * sum(abs(b - a) for a, b in pairwise(path)) > 1e-4


def test_a_wide_dither_loses_friction_times_the_way_beyond_twice_the_presliding() -> None:
    amplitude, z = 1e-4, 1.5e-5
    turns = [amplitude, -amplitude] * 50
    loss, stored = slide(turns, friction=0.12, presliding=z)
    ways = 0.12 * (amplitude - z + 99 * (2 * amplitude - 2 * z))
    assert loss - stored == pytest.approx(ways, rel=1e-6)


@given(st.lists(st.floats(-3e-4, 3e-4), min_size=1, max_size=50), st.floats(1e-7, 1e-4))
def test_friction_that_yields_never_gives_more_than_it_stores(
    path: list[float], presliding: float
) -> None:
    loss, stored = slide(path, friction=0.12, presliding=presliding)
    assert loss >= stored - 1e-12


def test_a_push_below_the_friction_moves_by_force_over_the_bristles_stiffness() -> None:
    moving, axis = AT_REST, Axis(0.1, 2.0, 0.12, 2e-5, 0.0, 0.0, 0.0, 0.0)
    for _ in range(4000):
        moving, _ = advance_extended(moving, axis, 0.0, 0.0, 1e-3, H, -0.06)
    assert moving.x == pytest.approx(1e-5)  # half the friction: half of 20 um
    assert abs(moving.v) < 1e-9


def test_a_push_above_the_friction_slides_as_without_presliding() -> None:
    moving, axis = AT_REST, Axis(0.1, 2.0, 0.5, 2e-5, 0.0, 0.0, 0.0, 0.0)
    for _ in range(2000):
        moving, _ = advance_extended(moving, axis, 0.0, 0.0, 1e-3, H, -2.0)
    assert moving.v == pytest.approx((2.0 - 0.5) / 2.0, rel=1e-6)


def test_a_smaller_presliding_comes_ever_closer_to_rigid_friction() -> None:
    def end(presliding: float) -> float:
        moving, axis = AT_REST, Axis(0.3, 0.27, 0.12, presliding, 0.0, 0.0, 0.0, 0.0)
        for k in range(300):
            told = -math.sin(0.02 * k)
            moving, _ = advance_extended(moving, axis, 0.0, 0.0, 1e-3, 1e-5, told)
        return moving.x

    rigid = end(0.0)
    errors = [abs(end(z) - rigid) for z in (1e-4, 1e-5, 1e-6)]
    assert errors[0] > errors[1] > errors[2]
    assert errors[2] < 3e-3 * abs(rigid)


def test_the_motor_lags_by_its_time_constant() -> None:
    lag, seconds, mass = 3e-4, 1e-3, 0.2
    axis = Axis(mass, 0.0, 0.0, 0.0, 0.0, lag, 0.0, 0.0)
    end, _ = advance_extended(AT_REST, axis, 0.0, 0.0, seconds, H, -2.0)
    decay = math.exp(-seconds / lag)
    assert end.motor_force == pytest.approx(-2.0 * (1 - decay))
    assert end.v == pytest.approx(2.0 / mass * (seconds - lag * (1 - decay)))


def test_a_weight_falls_with_the_acceleration_of_gravity() -> None:
    mass, seconds = 0.2, 0.1
    axis = Axis(mass, 0.0, 0.0, 0.0, -9.81 * mass, 0.0, 0.0, 0.0)
    end, _ = advance_extended(AT_REST, axis, 0.0, 0.0, seconds, H, 0.0)
    assert end.v == pytest.approx(9.81 * seconds)
    assert end.x == pytest.approx(0.5 * 9.81 * seconds**2)


# The simulated device has what it states, or what its truth says

PUSHED = PhantomPremium15(mass=0.1, damping=0.0, friction=0.0, resolution=0.0)


def speeds(model: PhantomPremium15, force: float = -1.0, seconds: float = 0.01) -> Vector:
    """Speed of each axis after a push with this force, held all the time."""
    device = SimulatedDevice(model, None, hold_limit=9.0)
    device.read(0)
    device.write(0, (force,) * model.axes)
    device.read(round(seconds * 1e9))
    return device.truth().velocity


def test_each_axis_has_its_own_damping_and_friction() -> None:
    model = replace(PUSHED, axes=2, damping=(1.0, 4.0), friction=(0.2, 0.5))
    assert speeds(model, force=-2.0, seconds=5.0) == pytest.approx((1.8, 0.375))


@pytest.mark.parametrize(
    ("stated", "truth", "speed"),
    [
        ({"gain_error": 0.05}, None, 0.105),
        ({"gain_error": 0.05}, TrueAxes(), 0.105),
        ({"gain_error": 0.05}, TrueAxes(gain=0.95), 0.095),
        ({"lag": 1e-3}, None, 0.1 - 10 * 1e-3 * (1 - math.exp(-10))),
        ({"lag": 1e-3}, TrueAxes(lag=2e-3), 0.1 - 10 * 2e-3 * (1 - math.exp(-5))),
    ],
)
def test_the_motor_is_at_the_upper_end_of_what_is_stated_or_where_it_truly_is(
    stated: dict[str, Any], truth: TrueAxes | None, speed: float
) -> None:
    assert speeds(replace(PUSHED, truth=truth, **stated)) == pytest.approx((speed,))


def test_true_damping_friction_and_presliding_may_differ_from_what_is_stated() -> None:
    truth = TrueAxes(damping=2.0, friction=0.5, presliding=1e-5)
    model = PhantomPremium15(mass=0.1, truth=truth)
    assert speeds(model, force=-2.0, seconds=2.0) == pytest.approx((0.75,), rel=1e-6)
    below = SimulatedDevice(model, None, hold_limit=9.0)
    below.read(0)
    below.write(0, (-0.25,))
    below.read(4_000_000_000)
    assert below.truth().position == pytest.approx((0.5e-5,))


def test_a_weight_is_compensated_until_the_watchdog_drops_the_force() -> None:
    model = replace(PUSHED, weight=0.981, watchdog="silent")
    device = SimulatedDevice(model, None, hold_limit=5e-3)
    device.read(0)
    device.read(1_000_000_000)  # no write yet
    device.write(1_000_000_000, (0.0,))
    device.read(1_005_000_000)
    assert device.truth().velocity == (0.0,)
    device.read(1_015_000_000)
    assert device.truth().velocity == pytest.approx((-9.81 * 0.01,))


def test_what_is_not_compensated_of_a_weight_acts() -> None:
    model = replace(PUSHED, weight=0.5, weight_error=0.1, truth=TrueAxes(weight=0.6))
    assert speeds(model, force=0.0) == pytest.approx((-0.1 / 0.1 * 0.01,))


def test_random_delays_and_cuts_stay_within_what_is_stated_and_repeat_by_their_seed() -> None:
    def effects(seed: int) -> list[tuple[int, int]]:
        truth = TrueAxes(random=True, seed=seed)
        model = replace(PUSHED, write_delay=4e-4, watchdog_tolerance=0.2, truth=truth)
        device = SimulatedDevice(model, None, hold_limit=2e-3)
        found = []
        for k in range(200):
            time_ns = 10_000_000 * k
            device.read(time_ns)
            device.write(time_ns, (0.1,))
            acts_ns = device.stamps()[1]
            device.read(time_ns + 9_000_000)
            cut = device.cut()
            assert cut is not None
            found.append((acts_ns - time_ns, cut[0] - acts_ns))
        return found

    delays, holds = zip(*effects(1), strict=True)
    assert 0 <= min(delays) < 4e4 < 3.6e5 < max(delays) <= 4e5
    assert 1.6e6 <= min(holds) < 1.65e6 < 2.35e6 < max(holds) <= 2.4e6
    assert effects(1) == effects(1) != effects(2)


@pytest.mark.parametrize("share", [0.85, 1.15])
def test_a_watchdog_may_truly_be_early_or_late(share: float) -> None:
    device = SimulatedDevice(replace(PUSHED, truth=TrueAxes(watchdog=share)), None, 2e-3)
    device.read(0)
    device.write(0, (0.1,))
    device.read(9_000_000)
    cut = device.cut()
    assert cut is not None
    assert cut[0] == round(share * 2e6)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"truth": TrueAxes(damping=(1.0, 2.0))}, "truth.damping must be one number, or 1"),
        ({"truth": TrueAxes(gain=(1.0, 1.1))}, "truth.gain must be one number, or 1"),
        ({"friction": (0.1, 0.2, 0.3)}, "friction must be one number, or 1"),
    ],
)
def test_numbers_of_another_number_of_axes_are_refused(
    changed: dict[str, Any], message: str
) -> None:
    with pytest.raises(ConfigError, match=message):
        replace(PhantomPremium15(), **changed)


def test_a_launch_file_states_true_values() -> None:
    device = {"kind": "phantom_premium_1_5", "friction": ["0.1 N"], "truth": {"gain": "103 %"}}
    document = {
        "forcebound": 1,
        "seed": 1,
        "duration": 1,
        "device": device,
        "environment": {"kind": "wall"},
    }
    config = from_document(document | {"controller": {"kind": "direct"}})
    assert config.only.device == PhantomPremium15(friction=(0.1,), truth=TrueAxes(gain=1.03))
    assert restore(to_document(config), always) == config
