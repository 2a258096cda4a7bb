"""The path of each operator."""

import math
from dataclasses import replace
from pathlib import Path

import pytest

from forcebound.errors import ConfigError
from forcebound.haptics.devices.phantom import PhantomPremium15
from forcebound.haptics.hands.hands import (
    ChirpHand,
    Press,
    PressingHand,
    SinusoidalHand,
    StrokingHand,
    TremblingHand,
)
from forcebound.haptics.hands.paths import FollowingHand, TrajectoryHand

CORNER = ((0.0, 0.0), (0.03, 0.0), (0.03, 0.04))


@pytest.fixture
def path_file(tmp_path: Path) -> Path:
    file = tmp_path / "path.csv"
    file.write_text("time,x,y\n0,0,0\n1,0.01,0\n\n3,0.01,0.02\n")
    return file


def test_the_pressing_hand_approaches_at_its_speed_and_stays() -> None:
    hand = PressingHand(start=-0.01, end=0.014, approach_speed=0.2)
    assert hand.target(0.0) == (-0.01,)
    assert hand.target(0.05)[0] == pytest.approx(0.0)
    assert hand.target(0.12)[0] == pytest.approx(0.014)
    assert hand.target(5.0) == (0.014,)
    assert PressingHand(start=(-0.01,), end=(0.014,)).target(0.05) == hand.target(0.05)


def test_a_hand_that_does_not_approach_is_refused() -> None:
    with pytest.raises(ValueError, match=r"approach_speed must be > 0 m/s, got 0 m/s"):
        PressingHand(approach_speed=0)


def test_the_pressing_hand_reaches_straight_along_any_direction() -> None:
    hand = PressingHand(start=(0.01, 0.0, 0.0), end=(0.01, 0.03, -0.04), approach_speed=0.1)
    assert hand.target(0.0) == (0.01, 0.0, 0.0)
    assert hand.target(0.25) == pytest.approx((0.01, 0.015, -0.02))
    assert hand.target(9.0) == (0.01, 0.03, -0.04)


def test_a_place_with_fewer_axes_than_the_other_is_at_0_on_the_rest() -> None:
    hand = PressingHand(start=-0.03, end=(0.0, 0.04), approach_speed=0.1)
    assert hand.target(0.0) == (-0.03, 0.0)
    assert hand.target(0.25) == pytest.approx((-0.015, 0.02))


@pytest.mark.parametrize("place", [(), (0.0,) * 9])
def test_a_place_has_as_many_numbers_as_a_device_can_have_axes(place: tuple[float, ...]) -> None:
    with pytest.raises(ConfigError, match=r"end must be one number, or 1 to 8 .*, got [09]"):
        PressingHand(end=place)


def test_the_stroking_hand_moves_in_and_then_to_and_fro_about_the_end() -> None:
    hand = StrokingHand(
        start=(0.0, 0.0, 0.03), end=(0.0, 0.0, 0.0), approach_speed=0.1, stroke=(0.01, -0.02)
    )
    assert hand.target(0.15) == pytest.approx((0.0, 0.0, 0.015))
    for cycles, share in ((0.0, 0.0), (0.25, 1.0), (0.75, -1.0), (3.25, 1.0)):
        place = hand.target(0.3 + cycles / hand.frequency)
        assert place == pytest.approx((0.01 * share, -0.02 * share, 0.0), abs=1e-12)


def test_the_sinusoidal_hand_swings_about_its_centre() -> None:
    hand = SinusoidalHand(centre=0.01, amplitude=0.004, frequency=2.0)
    assert hand.target(0.0)[0] == pytest.approx(0.006)
    assert hand.target(0.25)[0] == pytest.approx(0.014)
    assert hand.target(0.125)[0] == pytest.approx(0.010)


def test_the_tremor_is_a_force_of_the_spring_about_the_path() -> None:
    calm = PressingHand(start=0.0, end=0.1, approach_speed=0.2)
    hand = TremblingHand(
        stiffness=50.0, start=0.0, end=0.1, approach_speed=0.2, tremor=0.5, tremor_frequency=5.0
    )
    assert hand.target(0.0) == (0.0,)
    for time, share in ((0.05, 1.0), (0.1, 0.0), (0.15, -1.0), (2.05, 1.0)):
        force = hand.stiffness * (hand.target(time)[0] - calm.target(time)[0])
        assert force == pytest.approx(0.5 * share, abs=1e-9)
        ahead = replace(hand, tremor_phase=0.5 * math.pi)  # by a quarter of the 0.2 s cycle
        calmer = hand.target(time + 0.05)[0] - calm.target(time + 0.05)[0]
        assert ahead.target(time)[0] - calm.target(time)[0] == pytest.approx(calmer)


def test_a_tremor_of_two_axes_circles() -> None:
    hand = TremblingHand(stiffness=50.0, start=0.0, end=0.0, tremor=(0.5, 0.5, 0.0))
    for time in (0.0, 0.01, 0.05, 1.23):
        x, y, z = hand.target(time)
        assert math.hypot(x, y) == pytest.approx(0.01)
        assert z == 0.0


@pytest.mark.parametrize(("time", "frequency"), [(0.0, 1.0), (5.0, 10.0), (9.9, 95.5), (12.0, 100)])
def test_the_frequency_of_the_chirp_rises_by_the_same_factor_and_stays(
    time: float, frequency: float
) -> None:
    hand = ChirpHand(centre=0.0, amplitude=1.0, lowest=1.0, highest=100.0, sweep_time=10.0)
    before, now, after = (hand.target(time + shift)[0] for shift in (-1e-5, 0.0, 1e-5))
    speed = (after - now) / 1e-5 if time == 0.0 else (after - before) / 2e-5
    assert math.hypot(speed / (2.0 * math.pi * frequency), now) == pytest.approx(1.0, rel=2e-3)


def test_the_trajectory_is_followed_in_straight_lines(path_file: Path) -> None:
    hand = TrajectoryHand(file=path_file)
    assert hand.target(-1.0) == (0.0, 0.0)
    assert hand.target(0.5) == pytest.approx((0.005, 0.0))
    assert hand.target(2.0) == pytest.approx((0.01, 0.01))
    assert hand.target(9.0) == (0.01, 0.02)


def test_the_following_hand_goes_from_point_to_point_at_its_speed_and_stays() -> None:
    hand = FollowingHand(points=CORNER, speed=0.1)
    assert hand.target(0.0) == (0.0, 0.0)
    assert hand.target(0.15) == pytest.approx((0.015, 0.0))
    assert hand.target(0.5) == pytest.approx((0.03, 0.02))
    assert hand.target(9.0) == (0.03, 0.04)


def test_a_path_that_repeats_returns_straight_to_its_first_point() -> None:
    hand = FollowingHand(points=CORNER, speed=0.1, repeat=True)
    assert hand.target(0.7 + 0.25) == pytest.approx((0.015, 0.02))
    assert hand.target(1.2 * 5 + 0.15) == pytest.approx((0.015, 0.0))


def test_a_path_may_stay_at_one_point_and_visit_a_point_twice() -> None:
    assert FollowingHand(points=((0.01,),), repeat=True).target(3.0) == (0.01,)
    hand = FollowingHand(points=((0.0,), (0.0,), (0.01,)), speed=0.1)
    assert hand.target(0.0) == (0.0,)
    assert hand.target(0.05) == pytest.approx((0.005,))


def test_a_hand_presses_buttons_at_their_times_and_the_device_reports_them() -> None:
    presses = (Press(button=0, start=0.01, end=0.03), Press(button=2, start=0.02, end=0.04))
    hand = FollowingHand(points=CORNER, presses=presses)
    assert [hand.buttons(time) for time in (0.0, 0.01, 0.02, 0.03, 0.04)] == [0, 1, 5, 4, 0]
    device = PhantomPremium15().open(hand, hold_limit=1e-3)
    device.read(5_000_000)
    assert device.buttons() == 0
    device.engage(10_000_000)
    device.read(30_000_000)
    assert device.buttons() == 5
    without = PhantomPremium15().open(FollowingHand(points=CORNER), hold_limit=1e-3)
    assert without.buttons() is None


def test_a_press_that_ends_before_it_begins_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"end must be after start, 2 s, got 1 s"):
        Press(start=2.0, end=1.0)


def test_odd_points_are_refused() -> None:
    with pytest.raises(ConfigError, match="needs points, got none"):
        FollowingHand(points=())
    with pytest.raises(ConfigError, match=r"point 2 must have 1 to 8 numbers.*, got 0"):
        FollowingHand(points=((0.0,), ()))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "got no line of numbers"),
        ("t,x\n0,zero\n", r"path.csv:2: expected time in s"),
        ("t,x\n0,0\n0,1\n", r"path.csv:3: time must increase"),
        ("t,x\n0,nan\n", r"path.csv:2: expected .*, got '0,nan'"),
        ("t,x\n0,1,2\n", r"path.csv:2: expected .*, got '0,1,2'"),
    ],
)
def test_a_bad_trajectory_file_is_refused_with_its_line(
    tmp_path: Path, text: str, message: str
) -> None:
    file = tmp_path / "path.csv"
    file.write_text(text)
    with pytest.raises(ConfigError, match=message):
        TrajectoryHand(file=file)
