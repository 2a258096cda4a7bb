"""The contract of every bounding law, and the play operator."""

import math
import struct
from dataclasses import replace
from itertools import pairwise
from typing import Any

import pytest
from bounding_traces import PHANTOM, Trace, forces, run, steady
from builders import MS
from hypothesis import given, settings
from hypothesis import strategies as st

from forcebound.errors import ConfigError
from forcebound.haptics.laws import LAWS, Dissipation, ForceBounder, Sample, play
from forcebound.haptics.laws.bounder import shorten
from forcebound.messages.packets import Vector

BOUNDING_LAWS = sorted(name for name, law in LAWS.items() if not law.adds_damping)
CERTIFIED_LAWS = sorted(name for name, law in LAWS.items() if law.is_certified)
PAPER_LAWS = sorted(name for name in LAWS if "conservative" in name)

light = settings(max_examples=25)

samples = st.lists(
    st.tuples(
        st.integers(1, 8 * MS),
        st.tuples(*[st.floats(-0.1, 0.1)] * 3),
        st.tuples(*[st.one_of(st.just(0.0), st.floats(-1e3, 1e3))] * 3),
    ),
    max_size=15,
)
devices = st.builds(
    Dissipation,
    damping=st.floats(0.01, 3.0),
    friction=st.floats(0.0, 1.0),
    resolution=st.sampled_from((0.0, 1e-6, 3e-5, 2e-4)),
    period=st.just(1e-3),
    hold_limit=st.floats(1e-3, 3e-3),
    saturation=st.floats(0.1, 30.0),
)


# What all laws promise


@pytest.mark.parametrize("law", BOUNDING_LAWS)
@light
@given(dissipation=devices, trace=samples, axes=st.integers(1, 3))
def test_the_force_is_never_more_than_asked_nor_than_the_limit_and_has_its_direction(
    law: str, dissipation: Dissipation, trace: Trace, axes: int
) -> None:
    for asked, force, limit, _ in run(law, dissipation, trace, axes):
        assert math.hypot(*force) <= min(math.hypot(*asked), limit)
        assert limit <= dissipation.saturation
        share = math.hypot(*force) / math.hypot(*asked) if any(asked) else 0.0
        for f, a in zip(force, asked, strict=True):
            assert f * a >= 0.0
            assert f == pytest.approx(share * a, rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("law", sorted(LAWS))
@light
@given(dissipation=devices, trace=samples, axes=st.integers(1, 3))
def test_all_numbers_stay_finite_within_the_saturation_and_the_same(
    law: str, dissipation: Dissipation, trace: Trace, axes: int
) -> None:
    rows = run(law, dissipation, trace, axes)
    for _, force, limit, energy in rows:
        assert math.hypot(*force) <= dissipation.saturation
        assert limit >= 0.0
        assert math.isfinite(energy)
    assert run(law, dissipation, trace, axes) == rows  # to the bit


@pytest.mark.parametrize("law", sorted(LAWS))
@light
@given(trace=samples.filter(bool))
def test_a_start_forgets_everything_before(law: str, trace: Trace) -> None:
    bounder = ForceBounder(law, PHANTOM)
    bounder.start(0, (0.5,))
    bounder.settle(bounder.bound(MS, (0.0,), (3.0,)))
    time_ns = 2 * MS
    bounder.start(time_ns, (0.0,))
    for elapsed_ns, position, asked in trace:
        time_ns += elapsed_ns
        bounder.settle(bounder.bound(time_ns, position[:1], asked[:1]))
    assert bounder.estimated_energy == run(law, PHANTOM, trace)[-1].energy


@pytest.mark.parametrize("law", sorted(LAWS))
@light
@given(dissipation=devices, trace=samples)
def test_the_functions_of_a_law_hide_no_state(
    law: str, dissipation: Dissipation, trace: Trace
) -> None:
    chosen = LAWS[law]
    device = chosen.device(dissipation)
    state = chosen.start(device)
    for elapsed_ns, position, asked in trace:
        dt = elapsed_ns / 1e9
        sample = Sample(abs(asked[0]), dt, abs(position[0]), *[0.0] * 7)
        first = chosen.limit(state, sample, device)
        assert chosen.limit(state, sample, device) == first
        state = first[0]


@pytest.mark.parametrize("law", sorted(LAWS))
@pytest.mark.parametrize("axis", [0, 1, 2])
@light
@given(trace=samples)
def test_motion_along_one_of_three_axes_gives_what_one_axis_gives(
    law: str, axis: int, trace: Trace
) -> None:
    exact = replace(PHANTOM, resolution=0.0)  # the price of a start knows the number of axes

    def along(value: float) -> Vector:
        return tuple(value if i == axis else 0.0 for i in range(3))

    in_three = [(dt, along(x[0]), along(f[0])) for dt, x, f in trace]
    for one, three in zip(run(law, exact, trace), run(law, exact, in_three, 3), strict=True):
        assert three[1][axis] == pytest.approx(one[1][0], rel=1e-6, abs=1e-6)
        assert three[3] == pytest.approx(one[3], rel=1e-6, abs=1e-9)


@pytest.mark.parametrize("law", sorted(LAWS))
@light
@given(trace=samples)
def test_a_mirrored_world_gives_mirrored_forces(law: str, trace: Trace) -> None:
    mirrored = [(dt, tuple(-x for x in q), tuple(-f for f in asked)) for dt, q, asked in trace]
    exact = replace(PHANTOM, resolution=0.0)
    for row, other in zip(run(law, exact, trace), run(law, exact, mirrored), strict=True):
        assert other[1][0] == -row[1][0]
        assert other[2:] == row[2:]


@pytest.mark.parametrize("law", PAPER_LAWS)
def test_without_motion_and_history_the_laws_of_the_paper_give_no_force(law: str) -> None:
    rows = run(law, PHANTOM, steady([0.0] * 5, [3.0, -3.0, 0.0, 1e-9, 8.5]))
    assert forces(rows) == [0.0] * 5


@pytest.mark.parametrize("law", ["aol", *CERTIFIED_LAWS])
def test_without_motion_and_history_the_exact_laws_give_at_most_friction(law: str) -> None:
    rows = run(law, PHANTOM, steady([0.0] * 5, [3.0, -3.0, 0.0, 1e-9, 8.5]))
    assert max(abs(f) for f in forces(rows)) == 0.12


@pytest.mark.parametrize("law", sorted(LAWS))
def test_a_force_that_was_written_weaker_enters_the_next_sample(law: str) -> None:
    trace = steady([1e-3, 2e-3, 3e-3], [5.0, 5.0, 5.0])
    weaker = run(law, PHANTOM, trace, applied=lambda force: (0.5 * force[0],))
    if law not in ("none", "tdpa"):
        assert weaker[1][3] != run(law, PHANTOM, trace)[1][3]


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_commanded_forces_that_are_not_finite_are_an_error(value: float) -> None:
    bounder = ForceBounder("certified", PHANTOM, axes=2)
    with pytest.raises(ValueError, match="finite"):
        bounder.bound(MS, (0.0, 0.0), (0.0, value))


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 1e200])
@pytest.mark.parametrize("law", sorted(LAWS))
def test_a_reading_that_cannot_be_is_counted_and_changes_nothing(law: str, value: float) -> None:
    """A refused reading once left an infinite ledger behind: 8.5 N for a hand at rest."""
    bounder = ForceBounder(law, PHANTOM, axes=2)
    bounder.start(0, (0.0, 0.0))
    bounder.settle(bounder.bound(MS, (value, 0.0), (1.0, 0.0)))
    assert bounder.refused_readings == 1
    force = bounder.bound(2 * MS, (0.0, 0.0), (9.0, 0.0))
    assert math.isfinite(bounder.estimated_energy)
    assert math.hypot(*force) <= (0.12 if law in CERTIFIED_LAWS else 8.5)


@pytest.mark.parametrize("time_ns", [5, 4, 1004])
def test_a_reading_no_later_than_the_last_is_refused(time_ns: int) -> None:
    bounder = ForceBounder("certified", PHANTOM)
    bounder.start(5, (0.0,))
    bounder.bound(time_ns, (0.01,), (9.0,))
    assert bounder.refused_readings == 1


def test_a_reading_just_after_a_cut_is_not_counted_as_refused() -> None:
    bounder = ForceBounder("certified", replace(PHANTOM, watchdog="reporting"))
    bounder.start(0, (0.0,))
    bounder.settle(bounder.bound(MS, (0.0,), (0.1,)))
    bounder.report_cut(3 * MS, (0.0,))
    bounder.settle(bounder.bound(3 * MS + 500, (0.0,), (0.1,)))
    assert bounder.refused_readings == 0
    bounder.settle(bounder.bound(3 * MS + 600, (0.0,), (0.1,)))
    bounder.settle(bounder.bound(4 * MS, (math.nan,), (0.1,)))
    assert bounder.refused_readings == 1


def test_vectors_of_another_length_are_refused() -> None:
    bounder = ForceBounder("certified", PHANTOM, axes=2)
    with pytest.raises(struct.error):
        bounder.start(0, (0.0,))
    with pytest.raises(struct.error):
        bounder.bound(MS, (0.0,), (0.0, 0.0))
    with pytest.raises(struct.error):
        bounder.bound(MS, (0.0, 0.0), (0.0,))
    with pytest.raises(struct.error):
        bounder.settle((0.0, 0.0, 0.0))


def test_an_unknown_law_is_refused_with_the_known_ones() -> None:
    with pytest.raises(ConfigError, match=r"'certifed'.*aol, certified, certified_fading"):
        ForceBounder("certifed", PHANTOM)
    with pytest.raises(ConfigError, match="axes must be 1 to 8"):
        ForceBounder("certified", PHANTOM, axes=0)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("damping", 0.0),
        ("damping", math.nan),
        ("friction", -0.1),
        ("resolution", math.inf),
        ("period", 0.0),
        ("hold_limit", 0.5e-3),
        ("saturation", -1.0),
    ],
)
def test_a_device_with_impossible_constants_is_refused(field: str, value: Any) -> None:
    with pytest.raises(ConfigError, match=field):
        replace(PHANTOM, **{field: value})


@pytest.mark.parametrize("length", [1e-300, 1e-12, 3.7, 1e200])
@pytest.mark.parametrize("limit", [0.0, 5e-324, 1e-13, 8.5])
def test_a_shortened_vector_is_not_longer_than_the_limit_by_a_single_bit(
    length: float, limit: float
) -> None:
    for angle in range(100):
        force = (length * math.cos(angle), length * math.sin(angle))
        assert math.hypot(*shorten(force, math.hypot(*force), limit)) <= max(limit, 0.0)


# The play operator

readings = st.lists(st.floats(-1.0, 1.0), min_size=1, max_size=50)


@light
@given(st.floats(-1.0, 1.0), st.lists(st.floats(-0.5, 0.5), max_size=30))
def test_the_play_operator_takes_chatter_within_its_width_for_rest(
    centre: float, offsets: list[float]
) -> None:
    y = centre
    for offset in offsets:
        y = play(centre + 0.5 * offset, y, 0.25 + 1e-12)
    assert y == centre


@light
@given(readings, st.lists(st.floats(-1.0, 1.0), min_size=50, max_size=50), st.floats(0.0, 0.3))
def test_no_signal_near_the_readings_has_a_shorter_path_but_for_the_start(
    values: list[float], errors: list[float], r: float
) -> None:
    truth = [q + r * e for q, e in zip(values, errors, strict=False)]
    path = sum(abs(b - a) for a, b in pairwise(truth))
    y, played = values[0], 0.0
    for q in values:
        moved = play(q, y, r)
        played += abs(moved - y)
        y = moved
    assert played <= path + r + 1e-9


@light
@given(readings, st.floats(0.0, 0.3))
def test_the_bounder_plays_as_the_play_operator_does(values: list[float], r: float) -> None:
    """With friction of 1 N alone the ledger is the path less the price of the start."""
    device = replace(PHANTOM, damping=1e-12, friction=1.0, resolution=2 * r)
    y = played = 0.0
    for q in values:
        moved = play(q, y, r)
        played += abs(moved - y)
        y = moved
    energy = run("certified", device, steady(values, [0.0] * len(values)))[-1][3]
    assert energy == pytest.approx(played - r, abs=1e-6)
