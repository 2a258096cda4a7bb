"""The ledger for devices as they are: costs of holds by brute force, and each number's effect."""

import math
from dataclasses import replace
from itertools import accumulate, pairwise
from typing import Any

import numpy as np
import pytest
from bounding_traces import PHANTOM, forces, run, steady
from builders import MS
from hypothesis import given
from hypothesis import strategies as st

from forcebound.compiled import new_records
from forcebound.errors import ConfigError
from forcebound.haptics.laws import Dissipation, ForceBounder
from forcebound.haptics.laws.dissipation import Attenuates, Watchdog
from forcebound.haptics.laws.hold_cost import hold_cost, lagging_cost, rigid_cost
from forcebound.haptics.laws.sample import AxisConstants
from forcebound.haptics.laws.waveform import Motor, mean_force, penalty, retarget
from forcebound.haptics.laws.waveform import run as run_motor

PRESS = [2e-4 * min(n, 30) for n in range(1, 200)]  # m, into a wall and rest there
NAN = (math.nan,)


def pressed(device: Dissipation, asked: float = 9.0) -> list[float]:
    return forces(run("certified", device, steady(PRESS, [asked] * len(PRESS))))


# Costs, by brute force


@given(
    force=st.floats(0, 8),
    friction=st.floats(0, 1),
    way=st.floats(0, 2e-3),
    damping=st.floats(0.05, 3),
    duration=st.floats(1e-4, 5e-3),
)
def test_the_cost_of_a_hold_is_that_of_its_worst_displacement(
    force: float, friction: float, way: float, damping: float, duration: float
) -> None:
    furthest = force * duration / damping
    ways = [furthest * k / 2000 for k in range(2001)]
    worst = max(force * d - friction * max(d - way, 0) - damping * d * d / duration for d in ways)
    cost = hold_cost(force, friction, way, damping, duration)
    assert worst <= cost + 1e-15
    assert cost <= worst + 1e-3 * (force + friction) * furthest
    assert rigid_cost(force, friction, damping, duration) == pytest.approx(
        hold_cost(force, friction, 0.0, damping, duration)
    )


@given(
    before=st.floats(0, 8),
    after=st.floats(0, 8),
    lag=st.floats(1e-5, 3e-3),
    share=st.floats(0, 1),
)
def test_a_lagging_hold_costs_no_more_wherever_it_is_cut(
    before: float, after: float, lag: float, share: float
) -> None:
    damping, duration, steps = 0.27, 1.25e-3, 4000
    cut = share * duration
    dt = (cut + 8 * lag) / steps
    worst, at_cut = 0.0, before
    for n in range(steps):
        t = (n + 0.5) * dt
        if t < cut:
            force = at_cut = after + (before - after) * math.exp(-t / lag)
        else:
            force = at_cut * math.exp(-(t - cut) / lag)
        worst += force * force * dt / (4 * damping)
    assert worst <= lagging_cost(before, after, damping, duration, lag) * 1.01 + 1e-9


@given(
    old=st.floats(-4, 4),
    new=st.floats(-4, 4),
    share=st.floats(0.01, 0.99),
    way=st.floats(-1e-3, 1e-3),
    friction=st.floats(0, 0.5),
)
def test_a_step_within_an_interval_costs_no_more_than_its_penalty(
    old: float, new: float, share: float, way: float, friction: float
) -> None:
    dt, damping = 2e-3, 0.27
    axis = AxisConstants(damping, friction, 0.0, 0.0, 0.0, 0.0, 0.0)
    motor = new_records(Motor)[0]
    for force, part in ((old, share), (new, 1 - share)):
        retarget(motor, force, 0.0, force == old)
        run_motor(motor, part * dt, 0.0)
    claimed = damping * way**2 / dt + friction * abs(way) + mean_force(motor, dt, 0.0) * way
    claimed -= penalty(motor, dt, 0.0, 1.0, way, axis)
    for k in range(-200, 201):
        at_step = share * way + k * 2.5e-5
        rest = way - at_step
        loss = damping * (at_step**2 / (share * dt) + rest**2 / ((1 - share) * dt))
        loss += friction * (abs(at_step) + abs(rest))
        assert loss + old * at_step + new * rest >= claimed - 1e-12


# Each number of a device


@pytest.mark.parametrize(
    "worse",
    [
        {"presliding": 6e-5},
        {"gain_error": 0.05},
        {"lag": 1e-4},
        {"write_delay": 1e-4},
        {"watchdog_tolerance": 0.1},
        {"weight_error": 0.02},
        {"energy_cap": 5e-3},
        {"watchdog": "guarding", "guard_period": 5e-5},
    ],
)
def test_what_a_device_does_not_do_exactly_costs_force(worse: dict[str, Any]) -> None:
    exact, poor = pressed(PHANTOM), pressed(replace(PHANTOM, **worse))
    assert 0.3 * exact[-1] < poor[-1] < exact[-1]


@pytest.mark.parametrize("watchdog", ["reporting", "none"])
def test_a_punctual_hold_is_the_same_with_any_watchdog(watchdog: Watchdog) -> None:
    other = replace(PHANTOM, watchdog=watchdog, watchdog_limit=0.1, allowance=10.0)
    assert pressed(other) == pressed(PHANTOM)


def test_the_cap_that_comes_by_itself_never_limits_below_the_saturation() -> None:
    far = [2e-3 * n for n in range(1, 2000)]  # 4 m at 2 m/s
    assert forces(run("certified", PHANTOM, steady(far, [0.0] * 1998 + [9.0])))[-1] == 8.5
    bounder = ForceBounder("certified", PHANTOM)
    for n, x in enumerate(far):
        bounder.settle(bounder.bound((n + 1) * MS, (x,), (0.0,)))
    assert bounder.estimated_energy == pytest.approx((8.5 - 0.12) ** 2 / (4 * 216.0))


def test_the_better_axis_of_a_pair_is_used() -> None:
    pair = replace(PHANTOM, damping=(0.27, 2.7), friction=(0.12, 0.4))
    worst = replace(PHANTOM, damping=(0.27, 0.27), friction=(0.12, 0.12))
    trace = [(MS, (0.0, x), (0.0, 9.0)) for x in PRESS]
    assert (
        run("certified", pair, trace, 2)[-1].limit > 2 * run("certified", worst, trace, 2)[-1].limit
    )


def test_motors_with_different_gains_are_paid_for() -> None:
    """Work on one axis and against another cancels in a ledger that knows one gain."""
    device = Dissipation(
        damping=0.27,
        friction=(0.12, 0.12),
        resolution=0.0,
        period=1e-3,
        hold_limit=1e-3,
        saturation=8.5,
        gain_error=0.1,
    )
    bounder = ForceBounder("certified", device, 2)
    position, energy, gains = [0.0, 0.0], 0.0, (1.1, 0.9)
    for n in range(1500):
        asked = 0.0 if n < 50 else 8.5
        force = bounder.bound((n + 1) * MS, tuple(position), (asked, asked))
        bounder.settle(force)
        assert bounder.estimated_energy <= energy + 1e-12
        moves = (3e-4, 3e-4) if n < 50 else (-5e-6, 5e-6)
        for i, d in enumerate(moves):
            position[i] += d
            energy += 0.27 * d * d / 1e-3 + 0.12 * abs(d) + gains[i] * force[i] * d


def test_strokes_around_a_ball_keep_their_force_with_gains_that_are_not_known() -> None:
    """In along one axis, out along another: the work of the axes drifts apart without end."""
    device = Dissipation(
        damping=0.27,
        friction=0.12,
        resolution=0.0,
        period=1e-3,
        hold_limit=1e-3,
        saturation=8.5,
        gain_error=0.05,
    )
    bounder = ForceBounder("certified", device, 2)
    bounder.start(0, (0.06, 0.0))
    angles = np.linspace(0.0, np.pi / 2.0, 600)
    surface = 0.037 * np.stack((np.cos(angles), np.sin(angles)), axis=1)
    corners = ((0.06, 0.0), surface[0], surface[-1], (0.0, 0.06), (0.06, 0.06), (0.06, 0.0))
    ways = [np.linspace(begin, end, 300)[1:] for begin, end in pairwise(corners)]
    stroke = np.concatenate((ways[0], surface, *ways[2:]))
    asked = got = 0.0
    for n, position in enumerate(np.tile(stroke, (30, 1)).tolist(), 1):
        distance = math.hypot(*position)
        push = 1000.0 * max(0.04 - distance, 0.0)
        force = bounder.bound(
            n * MS, tuple(position), tuple(-push * x / distance for x in position)
        )
        bounder.settle(force)
        if n > 29 * len(stroke):
            asked, got = asked + push, got + math.hypot(*force)
    assert got > 0.99 * asked


# Readings that cannot be


def test_a_refused_reading_does_not_forget_the_force_that_acted() -> None:
    device = replace(PHANTOM, resolution=0.0, hold_limit=1e-3)
    bounder = ForceBounder("certified", device)
    x, energy, time_ns = 0.0, 0.0, 0
    for _ in range(20):
        x, time_ns = x + 2e-4, time_ns + MS
        energy += 0.27 * 0.2**2 * 1e-3 + 0.12 * 2e-4
        bounder.settle(bounder.bound(time_ns, (x,), (0.0,)))
    for _ in range(20):
        force = bounder.bound(time_ns := time_ns + MS, (x,), (8.5,))[0]
        bounder.settle((force,))
        d = max(force - 0.12, 0.0) * 1e-3 / (2 * 0.27)
        x -= d
        energy += 0.27 * d * d / 1e-3 + 0.12 * d - force * d
        bounder.settle((min(force, bounder.bound(time_ns := time_ns + MS, NAN, (8.5,))[0]),))
        bounder.settle(bounder.bound(time_ns := time_ns + MS, (x,), (0.0,)))
        assert bounder.estimated_energy <= energy + 1e-12
        assert energy >= -1e-12
    assert bounder.refused_readings == 20


def test_a_glitch_of_one_sample_is_refused_and_earns_nothing() -> None:
    device = replace(PHANTOM, largest_speed=1.0)
    bounder = ForceBounder("certified", device)
    for n in range(1, 20):
        reading = 0.1 if n == 10 else 0.0
        force = bounder.bound(n * MS, (reading,), (9.0,))
        bounder.settle(force)
        assert abs(force[0]) <= 0.12
    assert bounder.refused_readings == 1
    assert ForceBounder("certified", PHANTOM).refused_readings == 0


def test_a_wrong_reading_that_agrees_with_a_refused_true_one_is_refused() -> None:
    """The hand is faster than stated: a true reading is refused, then a wrong one is near to it."""
    device = replace(PHANTOM, largest_speed=5.0, hold_limit=1e-3)
    bounder = ForceBounder("certified", device)
    x, energy, force, before = 0.0, 0.0, 0.0, 0
    errors = [0.0] * 30 + [0.0, 5.02e-3, 0.0, 0.0, 0.0]
    moves = [1e-3] * 30 + [5.06e-3, 0.0, 0.0, 0.0, 0.0]
    for n, (move, error) in enumerate(zip(moves, errors, strict=True), start=1):
        x += move
        energy += 0.27 * move**2 / 1e-3 + 0.12 * move + force * move
        force = bounder.bound(n * MS, (x + error,), (0.0 if n < 30 else -8.5,))[0]
        bounder.settle((force,))
        if bounder.refused_readings == before:
            assert bounder.estimated_energy <= energy
        before = bounder.refused_readings
        assert max(abs(force) - 0.12, 0.0) ** 2 * 1e-3 / (4 * 0.27) <= energy
    assert bounder.refused_readings == 2


def test_a_device_that_really_is_elsewhere_counts_without_credit() -> None:
    device = replace(PHANTOM, largest_speed=1.0)
    bounder = ForceBounder("certified", device)
    for n in range(1, 120):
        bounder.settle(bounder.bound(n * MS, (0.1 if n >= 10 else 0.0,), (9.0,)))
    assert bounder.refused_readings == 99  # until 1 m/s goes so far
    assert bounder.estimated_energy < 0.0
    bounder.settle(bounder.bound(120 * MS, (0.1005,), (9.0,)))
    assert bounder.estimated_energy > 0.0


def test_the_drift_of_the_weight_is_paid_in_full_at_the_least_gain() -> None:
    least = replace(PHANTOM, gain_error=0.1, energy_cap=1.0)
    way = PRESS[-1]
    energies = []
    for error in (0.0, 0.05):
        device = replace(least, weight_error=error)
        energies.append(run("certified", device, steady(PRESS, [0.05] * len(PRESS)))[-1].energy)
    assert energies[0] - energies[1] >= 0.05 * (way + PHANTOM.coarsest_resolution)


# Late ticks


def late(
    device: Dissipation, lateness_ns: int, reports: bool = False
) -> tuple[float, ForceBounder]:
    """Press, rest, and let one write be late; return the share of the limit that is left."""
    bounder = ForceBounder("certified", device)
    time_ns = 0
    for x in PRESS:
        bounder.settle(bounder.bound(time_ns := time_ns + MS, (x,), (9.0,)))
    before, rest = bounder.limit, (PRESS[-1],)
    if reports:
        bounder.report_cut(time_ns + round(device.hold_limit * 1e9), rest)
    bounder.settle(bounder.bound(time_ns + MS + lateness_ns, rest, (9.0,)))
    return bounder.limit / before, bounder


def test_a_reported_cut_takes_nearly_nothing_from_a_hand_at_rest() -> None:
    left, bounder = late(replace(PHANTOM, watchdog="reporting"), 2 * MS, reports=True)
    assert 0.97 < left <= 1.0
    assert bounder.overruns == 1


@pytest.mark.parametrize(
    "watchdog", [{"watchdog": "reporting"}, {"watchdog": "guarding", "guard_period": 5e-5}]
)
@pytest.mark.parametrize(
    "stamp_ns", [0, -1, -200_000], ids=["at the write", "before", "long before"]
)
@pytest.mark.parametrize("duration_ns", [MS, 3 * MS], ids=["punctual", "late"])
def test_a_cut_that_is_stamped_before_a_write_does_not_undo_its_force(
    watchdog: dict[str, Any], stamp_ns: int, duration_ns: int
) -> None:
    """The hand goes with the force, which gives all that it can until it is dropped."""
    device = replace(PHANTOM, **watchdog, resolution=0.0, hold_limit=1e-3)
    bounder = ForceBounder("certified", device)
    for n in range(1, 20):
        bounder.settle(bounder.bound(n * MS, (2e-4 * n,), (0.0,)))
    force = bounder.bound(20 * MS, (4e-3,), (8.5,))[0]
    bounder.settle((force,))
    energy = bounder.estimated_energy
    bounder.report_cut(20 * MS + stamp_ns, (4e-3,))
    way = (force - 0.12) * 1e-3 / (2 * 0.27)
    bounder.bound(20 * MS + duration_ns, (4e-3 - way,), (0.0,))
    bounder.settle((0.0,))
    truth = energy + 0.27 * way**2 / 1e-3 + 0.12 * way - force * way
    assert bounder.estimated_energy <= truth + 1e-12


def test_a_cut_at_a_late_write_is_one_of_the_force_before_it() -> None:
    """The new force acts from its write on, as without the report."""
    device = replace(PHANTOM, watchdog="reporting", write_delay=4e-4)
    energies = []
    for reports in (True, False):
        bounder = ForceBounder("certified", device)
        for n, x in enumerate(PRESS, start=1):
            bounder.settle(bounder.bound(n * MS, (x,), (9.0,)), n * MS + 100_000)
        if reports:
            bounder.report_cut(199 * MS + 100_000, (PRESS[-1],))
        bounder.settle(bounder.bound(200 * MS, (PRESS[-1] - 1e-4,), (9.0,)))
        energies.append(bounder.estimated_energy)
    assert energies[0] == energies[1]


def test_a_force_that_is_guarded_costs_a_hand_at_rest_nothing() -> None:
    left, bounder = late(replace(PHANTOM, watchdog="guarding", guard_period=5e-5), 50 * MS)
    assert left == pytest.approx(1.0)
    assert bounder.overruns == 1


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({}, "guard_period above 0 s and below the period, 0.001 s, got 0.0 s"),
        ({"guard_period": 1e-3}, "below the period"),
        ({"guard_period": 5e-5, "lag": 1e-4}, "use watchdog 'reporting'"),
        ({"guard_period": 5e-5, "write_delay": 1e-4}, "use watchdog 'reporting'"),
    ],
)
def test_a_guard_looks_more_often_than_the_servo(wrong: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        replace(PHANTOM, watchdog="guarding", **wrong)


def test_a_cut_that_ought_to_have_been_reported_is_not_taken_for_a_hold() -> None:
    told, _ = late(replace(PHANTOM, watchdog="reporting"), 2 * MS, reports=True)
    silent, _ = late(replace(PHANTOM, watchdog="reporting"), 2 * MS)
    assert silent < 0.9 * told


def test_a_force_that_stays_on_costs_a_hand_at_rest_nothing_but_is_counted() -> None:
    device = replace(PHANTOM, watchdog="none", watchdog_limit=0.01, allowance=0.05)
    left, bounder = late(device, 2 * MS)
    assert left == pytest.approx(1.0)
    assert 0.0 < bounder.largest_allowance <= 0.05
    assert bounder.allowance_repaid


def test_without_an_allowance_the_longest_hold_is_planned_for() -> None:
    strict = replace(PHANTOM, watchdog="none", watchdog_limit=0.01)
    longer = replace(PHANTOM, hold_limit=0.01)
    assert pressed(strict) == pressed(longer)
    with pytest.raises(ConfigError, match="watchdog_limit"):
        replace(PHANTOM, watchdog="none")


def test_a_hold_limit_may_change_from_hold_to_hold() -> None:
    bounder = ForceBounder("certified", PHANTOM)
    limits = []
    for n, x in enumerate(PRESS):
        if n == 150:
            bounder.set_hold_limit(5e-3)
        bounder.settle(bounder.bound((n + 1) * MS, (x,), (9.0,)))
        limits.append(bounder.limit)
    assert limits[150] < 0.6 * limits[149]
    bounder.settle(bounder.bound(204 * MS, (PRESS[-1],), (9.0,)))
    assert bounder.overruns == 0


# A motor that attenuates


def held(attenuates: Attenuates, least_share: float = 0.0) -> list[float]:
    """Return the limit while a hand rests against a force, after it has moved freely, in N."""
    device = replace(PHANTOM, attenuates=attenuates, least_share=least_share)
    bounder = ForceBounder("certified", device)
    bounder.start(0, (0.0,))
    limits = []
    for n in range(1, 1200):
        x = 3e-5 * round(min(n, 200) * 2e-4 / 3e-5)
        bounder.settle(bounder.bound(n * MS, (x,), (0.0 if n < 200 else PHANTOM.saturation,)))
        limits.append(bounder.limit)
    return limits[200:]


def test_a_steady_force_lasts_as_the_share_of_it_is_certain() -> None:
    whole, per_write, freely = held("never"), held("per_write"), held("freely")
    friction, resolution, cost = 0.12, 3e-5, PHANTOM.hold_limit / (4.0 * 0.27)
    assert whole[-1] == pytest.approx(whole[0])
    assert all(a > b > c for a, b, c in zip(whole[1:], per_write[1:], freely[1:], strict=True))
    assert freely[-1] == pytest.approx(2.0 * friction, rel=0.01)
    # A hold costs what a step of the encoder hides.
    drained = resolution * (0.5 * per_write[10] - friction)
    energies = [cost * (f - friction) ** 2 for f in per_write[10:12]]
    assert energies[0] - energies[1] == pytest.approx(drained, rel=0.02)


def test_a_force_that_friction_carries_whatever_its_share_lasts() -> None:
    lasting = 0.12 / 0.05  # N
    limits = held("freely", least_share=0.9)
    assert limits[0] > lasting
    assert min(limits) >= lasting * (1.0 - 1e-9)


@pytest.mark.parametrize("attenuates", ["per_write", "freely"])
def test_a_force_that_resists_earns_nothing_and_one_that_pushes_is_charged(
    attenuates: Attenuates,
) -> None:
    device = replace(PHANTOM, friction=0.0, resolution=0.0, energy_cap=1.0, attenuates=attenuates)
    bounder, energies = ForceBounder("certified", device), []
    bounder.start(0, (0.0,))
    ways = [*[0.01] * 3, 0.02, -0.02]
    for n, x in enumerate(accumulate(ways), 1):
        bounder.settle(bounder.bound(n * MS, (x,), (1.0 if n >= 3 else 0.0,)))
        energies.append(bounder.estimated_energy)
    loss = 0.27 * 0.02**2 / 1e-3
    assert energies[3] - energies[2] == pytest.approx(loss)
    assert energies[4] - energies[3] == pytest.approx(loss - 0.02)


def test_a_ledger_pays_for_a_hand_that_trembles_within_a_hold() -> None:
    """Out by u while there is no force, back by u with it: the best u for two half periods."""
    b, friction, period, force = 0.27, 0.12, 1e-3, 1.0
    u = (force - 2.0 * friction) * period / (8.0 * b)
    energy = 2.0 * b * u**2 / (period / 2.0) + 2.0 * friction * u - force * u
    device = replace(PHANTOM, resolution=0.0, attenuates="freely")
    bounder, energies = ForceBounder("certified", device), []
    bounder.start(0, (0.0,))
    for n in range(1, 110):
        x = min(n, 100) * 2e-4
        bounder.settle(bounder.bound(n * MS, (x,), (force if n >= 100 else 0.0,)))
        energies.append(bounder.estimated_energy)
    assert energies[105] - energies[104] == pytest.approx(energy)
    assert energy < -1e-4


# Descriptions that cannot be


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"damping": (0.27, 0.3)}, "friction of each axis"),
        ({"gain_error": 1.0}, "gain_error"),
        ({"largest_speed": 0.0}, "largest_speed"),
        ({"watchdog": "loud"}, "watchdog"),
        ({"attenuates": "often"}, "attenuates"),
        ({"attenuates": "freely", "lag": 1e-4}, "lag"),
        ({"attenuates": "freely", "presliding": 1e-5}, "per_write"),
        (
            {"attenuates": "per_write", "presliding": 1e-5, "watchdog": "none"}
            | {"watchdog_limit": 0.02},
            "no watchdog",
        ),
        ({"attenuates": "per_write", "hand_speed": 1.0}, "hand_speed"),
        ({"attenuates": "freely", "gain_error": 0.1}, "gain_error"),
        ({"attenuates": "per_write", "weight": (0.0, 0.1)}, "weight"),
        ({"attenuates": "per_write", "watchdog": "guarding", "guard_period": 5e-5}, "guarding"),
        ({"write_delay": 1e-4, "watchdog": "guarding", "guard_period": 5e-5}, "guarding"),
    ],
)
def test_a_description_that_cannot_be_is_refused(wrong: dict[str, Any], words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        replace(PHANTOM, **wrong)


def test_numbers_that_do_not_fit_the_axes_are_refused() -> None:
    with pytest.raises(ConfigError, match="friction of each axis"):
        ForceBounder("certified", replace(PHANTOM, presliding=1e-5), 2)
    with pytest.raises(ConfigError, match="friction of each axis"):
        ForceBounder("certified", replace(PHANTOM, attenuates="freely"), 2)
    for axes, field in ((3, "friction"), (2, "damping")):
        device = replace(PHANTOM, friction=(0.1, 0.1), damping=(0.2, 0.2, 0.2))
        with pytest.raises(ConfigError, match=f"one number, or {axes}") as raised:
            ForceBounder("certified", device, axes)
        assert raised.value.field == field
    with pytest.raises(ConfigError, match="must hold the error of the weight"):
        ForceBounder("certified", replace(PHANTOM, weight_error=0.2))
