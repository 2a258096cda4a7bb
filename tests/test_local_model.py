"""The local model: what it learns, what it shows, and when its force ends."""

import math
from dataclasses import replace
from random import Random

import pytest
from builders import MS, reply, state
from msgspec import structs

from forcebound.haptics.controllers.local_model import LocalModel, OpenLocalModel
from forcebound.haptics.controllers.plane import (
    NEAR,
    Asked,
    Plane,
    PlaneEstimator,
    SpringDamper,
    along,
    dot,
)
from forcebound.haptics.controllers.shown_plane import ShownPlane
from forcebound.messages.packets import Contact, EnvironmentReply, Vector

TILTED: Vector = (0.6, 0.0, 0.8)
WALL = Plane((1.0,), 0.01, 5000.0)
RELEASE_TICKS = 5
RELEASE = 1e-3 * RELEASE_TICKS  # s


def answer(plane: Plane, asked: Asked) -> Vector:
    """What an environment of this plane answers: spring, damper, friction against the motion."""
    depth = plane.depth(asked.position)
    speed = dot(asked.velocity, plane.inwards)
    pressed = max(plane.stiffness * depth + plane.damping * speed, 0.0) if depth > 0.0 else 0.0
    slip = along(asked.velocity, plane.inwards, -speed)
    length = math.hypot(*slip)
    share = plane.friction * pressed / length if length > 0.0 else 0.0
    return along(tuple([share * v for v in slip]), plane.inwards, pressed)


def learned(plane: Plane, *, reports: bool = False, noise: float = 0.0, grid: float = 0.0) -> Plane:
    """The estimate after a press of 0.2 s to and fro that begins in free motion."""
    estimator, random = PlaneEstimator(0.9, 1e6, RELEASE), Random(3)
    outwards = tuple([-u for u in plane.inwards])
    axes = len(outwards)
    for tick in range(200):
        time = tick * 1e-3
        depth = 0.003 * math.sin(40.0 * time) - 0.0005
        speed = 0.12 * math.cos(40.0 * time)
        slip = tuple([0.02 * time * (axis == 1) for axis in range(axes)])
        position = along(slip, plane.inwards, plane.offset + depth)
        if grid:
            position = tuple([grid * round(x / grid) for x in position])
        velocity = along(tuple([0.02 * (axis == 1) for axis in range(axes)]), plane.inwards, speed)
        asked = Asked(position, velocity, tick * MS)
        force = answer(plane, asked)
        if noise and any(force):
            force = tuple([f + random.gauss(0.0, noise) for f in force])
        touches = plane.depth(position) > 0.0
        proxy = along(position, plane.inwards, -plane.depth(position))
        contact = Contact(proxy, outwards) if reports and touches else None
        estimator.take(asked, force, contact)
    assert estimator.plane is not None
    return estimator.plane


@pytest.mark.parametrize("damping", [0.0, 4.0])
@pytest.mark.parametrize("inwards", [(1.0,), (-1.0,), TILTED])
def test_a_plane_is_recovered_exactly_from_its_forces(inwards: Vector, damping: float) -> None:
    plane = Plane(inwards, 0.01, 8000.0, damping)
    found = learned(plane)
    assert found.inwards == pytest.approx(plane.inwards, abs=1e-9)
    assert found.stiffness == pytest.approx(plane.stiffness, rel=1e-4)
    assert found.damping == pytest.approx(plane.damping, abs=1e-3)
    assert found.offset == pytest.approx(plane.offset, abs=1e-7)


def test_friction_and_tilt_are_distinguished_where_the_normal_is_reported() -> None:
    plane = Plane(TILTED, 0.01, 8000.0, 0.0, 0.3)
    found = learned(plane, reports=True)
    assert found.inwards == TILTED
    assert found.friction == pytest.approx(0.3, rel=0.05)
    assert found.stiffness == pytest.approx(8000.0, rel=1e-4)


def test_noise_and_steps_of_the_encoder_leave_a_few_percent() -> None:
    found = learned(Plane((1.0,), 0.01, 5000.0), noise=0.05, grid=3e-5)
    assert found.stiffness == pytest.approx(5000.0, rel=0.1)
    assert found.offset == pytest.approx(0.01, abs=1e-4)


def touched() -> tuple[PlaneEstimator, Plane]:
    """An estimator that has touched ``WALL``, and its plane."""
    estimator = PlaneEstimator(0.9, 1e6, RELEASE)
    for depth in (-0.001, 0.001, 0.002):
        asked = Asked((0.01 + depth,), (0.0,), round(depth * 1e9))
        estimator.take(asked, answer(WALL, asked))
    assert estimator.plane is not None
    return estimator, estimator.plane


def test_a_free_answer_just_behind_the_surface_moves_it_there_and_nothing_else() -> None:
    estimator, before = touched()
    estimator.take(Asked((0.0103,), (0.0,), 5 * MS), (0.0,))
    assert estimator.plane == before.at(0.0103)
    estimator.take(Asked((0.005,), (0.0,), 6 * MS), (0.0,))
    assert estimator.plane == before.at(0.0103)


@pytest.mark.parametrize(("depth", "ticks"), [(NEAR + 1e-5, 1), (1e-5, RELEASE_TICKS + 1)])
def test_free_answers_far_behind_the_surface_or_for_long_end_it(depth: float, ticks: int) -> None:
    estimator, before = touched()
    for tick in range(ticks):
        assert estimator.plane is not None
        estimator.take(Asked((0.01 + depth,), (0.0,), (5 + tick) * MS), (0.0,))
    assert estimator.plane is None
    asked = Asked((0.012,), (0.0,), 50 * MS)
    estimator.take(asked, answer(WALL, asked))
    assert estimator.plane is not None
    assert estimator.plane.stiffness == before.stiffness  # it is remembered


def test_single_free_answers_with_free_motion_between_them_leave_the_surface() -> None:
    estimator, before = touched()
    for tick in (5, 500):
        estimator.take(Asked((0.0101,), (0.0,), tick * MS), (0.0,))
        estimator.take(Asked((0.005,), (0.0,), (tick + 1) * MS), (0.0,))
    assert estimator.plane == before.at(0.0101)


def test_two_samples_that_contradict_the_estimate_begin_another_one() -> None:
    spring = SpringDamper(0.9)
    for depth in (1e-3, 2e-3, 3e-3):
        spring.add(depth, 0.0, 1e4 * depth)
    spring.add(1e-4, 0.0, 0.1)
    assert spring.stiffness == pytest.approx(1e4, rel=0.1)  # one may be an error
    spring.add(1e-4, 0.0, 0.1)
    assert spring.stiffness == pytest.approx(1e3, rel=0.1)


def test_a_constant_force_is_no_stiff_wall() -> None:
    estimator = PlaneEstimator(0.9, 1e6, RELEASE)
    for tick in range(100):
        estimator.take(Asked((0.001 * tick,), (1.0,), tick * MS), (2.0,))
    assert estimator.plane is not None
    assert estimator.plane.stiffness < 10.0


def test_a_plane_that_appears_around_the_hand_gives_no_force_until_the_hand_goes_on() -> None:
    shown = ShownPlane(0.0, 1)
    assert shown.force(WALL, (0.014,), (0.0,), 1e-3) == (0.0,)
    assert shown.force(WALL, (0.0141,), (0.0,), 1e-3) == pytest.approx((0.5,))
    assert shown.force(WALL, (0.014,), (0.0,), 1e-3) == pytest.approx((0.0,))
    assert shown.force(WALL, (0.010,), (0.0,), 1e-3) == (0.0,)
    assert shown.force(WALL, (0.011,), (0.0,), 1e-3) == pytest.approx((5.0,))


def test_a_plane_that_appears_around_the_hand_gives_the_power_that_is_allowed() -> None:
    shown = ShownPlane(0.01, 1)
    for _ in range(10):
        (force,) = shown.force(WALL, (0.014,), (0.0,), 1e-3)
    assert force**2 / (2.0 * WALL.stiffness) == pytest.approx(0.01 * 10e-3)


def test_a_stiffer_plane_stores_no_more_than_the_softer_did() -> None:
    shown = ShownPlane(0.0, 1)
    shown.force(WALL, (0.010,), (0.0,), 1e-3)
    (before,) = shown.force(WALL, (0.012,), (0.0,), 1e-3)
    (after,) = shown.force(replace(WALL, stiffness=20_000.0), (0.012,), (0.0,), 1e-3)
    assert after**2 / 20_000.0 == pytest.approx(before**2 / 5000.0)


def work_of(power: float, seed: int, steps: int = 20_000) -> float:
    """Least work that a hand has put in, in J, while planes change at random about it."""
    random, shown = Random(seed), ShownPlane(power, 2)
    position: Vector = (0.0, 0.0)
    plane = Plane((1.0, 0.0), 0.0, 1000.0)
    force: Vector = (0.0, 0.0)
    direction, work, least = 0.0, 0.0, 0.0
    for step in range(steps):
        if step % 50 == 0:
            angle, friction = random.uniform(0.0, 6.3), random.choice([0.0, 0.3])
            inwards = (math.cos(angle), math.sin(angle))
            stiffness = random.uniform(200.0, 5000.0)
            offset = dot(position, inwards) + random.uniform(-0.003, 0.003)
            plane = Plane(inwards, offset, stiffness, random.choice([0.0, 2.0]), friction)
            force = shown.force(plane, position, (0.0, 0.0), 0.0)
            direction = random.uniform(0.0, 6.3)
            if random.random() < 0.5 and any(force):  # the hand takes what is in the spring
                direction = math.atan2(-force[1], -force[0])
        moved = (1e-5 * math.cos(direction), 1e-5 * math.sin(direction))
        position = along(position, moved, 1.0)
        velocity = tuple([x / 1e-3 for x in moved])
        after = shown.force(plane, position, velocity, 1e-3)
        work += 0.5 * (dot(force, moved) + dot(after, moved))
        force = after
        least = min(least, work + power * step * 1e-3)
    return least


@pytest.mark.parametrize("power", [0.0, 0.02])
def test_planes_that_change_at_random_give_the_hand_no_more_than_is_allowed(power: float) -> None:
    """Up to the damping force at a step, which the trapezoid takes for half a step too long."""
    assert work_of(power, seed=1) > -2e-6


def far(model: LocalModel, delay: int, depth_at_end: float = 0.002) -> OpenLocalModel:
    """A local model after 300 ticks of a slow press, the wall ``delay`` ticks away."""
    opened = model.open(1)
    pending: list[tuple[int, EnvironmentReply]] = []
    for tick in range(300):
        position = 0.005 + (0.005 + depth_at_end) * tick / 299
        opened.on_state(state(tick, position), tick * MS)
        (asked,), _ = opened.query(state(tick, position))
        pending.append((tick + delay, reply(tick, max(5000.0 * (asked - 0.01), 0.0))))
        while pending and pending[0][0] <= tick:
            opened.on_reply(pending.pop(0)[1], tick * MS)
    return opened


@pytest.mark.parametrize("delay", [0, 1, 40, 100])
def test_a_wall_that_is_known_before_the_hand_comes_is_shown_without_delay(delay: int) -> None:
    opened = far(LocalModel(power=0.0), delay)
    assert opened.on_state(state(300, 0.0125), 300 * MS) == pytest.approx((12.5,), rel=1e-3)


def test_the_environment_is_asked_no_deeper_than_the_margin_behind_what_is_known() -> None:
    opened = far(LocalModel(), 40, depth_at_end=-0.0002)
    opened.on_state(state(300, 0.0099), 300 * MS)
    (asked,), _ = opened.query(state(300, 0.0099))
    assert asked == pytest.approx(0.011, abs=1e-5)


def test_the_force_fades_when_answers_stay_away_and_then_there_is_none() -> None:
    opened = far(LocalModel(hold=0.1, fade=0.05), 0)
    forces = [opened.on_state(state(tick, 0.012), tick * MS) for tick in range(300, 460)]
    assert forces[98] == pytest.approx((10.0,), rel=1e-3)
    assert forces[124] == pytest.approx((5.0,), rel=1e-3)
    assert forces[150:] == [None] * 10


def test_an_answer_that_is_too_old_is_none() -> None:
    opened = LocalModel(age_limit=0.2).open(1)
    for tick in range(1000):
        opened.on_state(state(tick, 0.005), tick * MS)
        opened.query(state(tick, 0.005))
        if tick >= 250:
            opened.on_reply(reply(tick - 250, 0.0), tick * MS)
    assert opened.on_state(state(1000, 0.005), 1000 * MS) is None


def test_a_stiffness_that_changes_is_followed_and_nothing_winds_up_where_nothing_is_new() -> None:
    found = SpringDamper(0.9)
    for sample in range(10_000):
        found.add(1e-3 * (1 + sample % 3), 0.0, 2.0 * (1 + sample % 3))
    assert found.stiffness == pytest.approx(2000.0)
    for sample in range(400):
        depth, speed = 1e-3 * (1 + sample % 3), 0.1 * (sample % 2)
        found.add(depth, speed, 5000.0 * depth + 3.0 * speed)
    assert found.stiffness == pytest.approx(5000.0, rel=0.01)
    assert found.damping == pytest.approx(3.0, rel=0.05)


def test_a_device_that_starts_again_finds_a_model_that_knows_nothing_of_before() -> None:
    opened = far(LocalModel(), 0)
    again = structs.replace(state(0, 0.012), time_ns=10_000 * MS)
    assert opened.on_state(again, 10_000 * MS) is None
    opened.query(again)
    opened.on_reply(reply(0, 0.0), 10_000 * MS)
    then = structs.replace(state(1, 0.012), time_ns=10_001 * MS)
    assert opened.on_state(then, 10_001 * MS) == (0.0,)


def test_answers_that_come_twice_late_or_to_no_question_do_no_harm() -> None:
    opened = far(LocalModel(), 0)
    before = opened.on_state(state(300, 0.012), 300 * MS)
    late = opened.on_state(state(290, 0.012), 300 * MS)  # and is no new start
    assert late == pytest.approx(before, rel=1e-3)
    opened.query(state(300, 0.012))
    for answered in (reply(290, 99.0), reply(5000, 99.0), reply(10, 99.0)):
        opened.on_reply(answered, 300 * MS)
    assert opened.on_state(state(301, 0.012), 301 * MS) == pytest.approx(before, rel=1e-3)


@pytest.mark.parametrize("scale", [1e-9, 1.0, 1e6, 1e300])
def test_an_environment_that_lies_makes_no_number_that_is_none(scale: float) -> None:
    random, opened = Random(1), LocalModel().open(2)
    for tick in range(500):
        place = (random.uniform(-0.1, 0.1), random.uniform(-0.1, 0.1))
        now = state(tick, *place, velocity=1.0)
        force = opened.on_state(now, tick * MS)
        position, velocity = opened.query(now)
        assert all(map(math.isfinite, (*position, *velocity, *(force or ()))))
        lie = (scale * random.uniform(-1, 1), scale * random.uniform(-1, 1))
        opened.on_reply(reply(tick, *lie), tick * MS)
