"""A mass on a spring: rest, oscillation, energy, and parameters that change."""

import math
from dataclasses import replace

import numpy as np
import pytest

from forcebound.graph.loader import load
from forcebound.haptics.environments import Environment
from forcebound.haptics.environments.mass_spring import MassSpring
from forcebound.results.plots import figure
from forcebound.results.summary import summarize
from forcebound.run.results import RunResult
from forcebound.run.virtual import run_virtual

MODEL = MassSpring(mass=0.2, spring=300.0, damping=8.0, stiffness=2000.0, position=0.010)
MS = 1e-3


def held(slab: Environment, place: float, start: float, duration: float) -> list[float]:
    """The forces on a hand at rest, one a millisecond."""
    ticks = range(round(duration / MS))
    return [slab.force("", (place,), (0.0,), start + i * MS)[0] for i in ticks]


def test_at_rest_both_springs_bear_the_same_force() -> None:
    slab = MODEL.open(1)
    force = held(slab, 0.022, 0.0, 3.0)[-1]
    assert force == pytest.approx(0.012 * 300.0 * 2000.0 / 2300.0, rel=1e-3)
    contact = slab.contact("")
    assert contact is not None
    assert contact.proxy[0] == pytest.approx(0.010 + force / 300.0, rel=1e-3)
    assert contact.normal == (-1.0,)


def test_free_slab_oscillates_at_its_frequency_and_loses_no_energy() -> None:
    slab = replace(MODEL, damping=0.0).open(3)
    slab.force("", (0.02, 0.0, 0.0), (0.0, 0.0, 0.0), 0.0)
    slab.force("", (0.02, 0.0, 0.0), (0.0, 0.0, 0.0), 0.02)  # pushed
    faces = []
    for i in range(4000):
        assert slab.force("", (-0.1, 0.0, 0.0), (0.0, 0.0, 0.0), 0.02 + i * MS) == (0.0, 0.0, 0.0)
        assert slab.contact("") is None
        faces.append(slab.scene()[0].position[0])
    middle = 0.010 + 0.005  # of the drawn slab
    rises = [i for i in range(1, 4000) if faces[i - 1] < middle <= faces[i]]
    period = (rises[-1] - rises[0]) / (len(rises) - 1) * MS
    assert period == pytest.approx(2.0 * math.pi * math.sqrt(0.2 / 300.0), rel=0.01)
    assert max(faces[-200:]) == pytest.approx(max(faces[100:300]), rel=1e-3)


@pytest.mark.parametrize("place", [1e9, -1e9])
def test_one_absurd_reading_does_not_last(place: float) -> None:
    slab, calm = MODEL.open(1), MODEL.open(1)
    for one in (slab, calm):
        held(one, 0.022, 0.0, 1.0)
    slab.force("", (place,), (0.0,), 1.0 + MS)
    assert held(slab, 0.022, 1.0 + 2 * MS, 3.0)[-1] == pytest.approx(
        held(calm, 0.022, 1.0 + 2 * MS, 3.0)[-1], rel=1e-6
    )


def test_new_stiffness_leaves_the_slab_where_it_is() -> None:
    slab = MODEL.open(1)
    held(slab, 0.022, 0.0, 3.0)
    before = slab.scene()
    slab.change(replace(MODEL, spring=600.0))
    assert slab.scene() == before
    assert held(slab, 0.022, 3.0, 3.0)[-1] == pytest.approx(
        0.012 * 600.0 * 2000.0 / 2600.0, rel=1e-3
    )


@pytest.fixture(scope="module")
def pushed() -> RunResult:
    """A hand that has pushed it until both rest."""
    return run_virtual(load("push_mass", ["law:=certified"]))


def test_figures_and_pictures_are_those_of_the_face_where_it_is(pushed: RunResult) -> None:
    columns, document = pushed.columns, pushed.document
    figures = summarize(columns, document)
    force = columns.applied_force[-1, 0]  # 2.9 N: the face has gone by 10 mm
    assert figures["displayed_stiffness_n_per_m"] == pytest.approx(2000.0, rel=1e-3)
    assert figures["penetration_at_rest_m"] == pytest.approx(force / 2000.0, rel=0.01)
    assert figures["wall_error_rms_n"] < 0.05
    lines = {line.get_label(): line for line in figure([("", columns, document)]).axes[0].lines}
    assert "surface" not in lines
    proxy = np.asarray(lines["proxy"].get_ydata(), float)
    assert proxy[-1] == pytest.approx(10.0 + 1e3 * force / 300.0, rel=0.01)


def test_a_hand_pushes_it_and_both_come_to_rest(pushed: RunResult) -> None:
    columns = pushed.columns
    depth = columns.true_position[-1, 0] - 0.010
    hand = 950.0 * (0.024 - columns.true_position[-1, 0])
    assert hand == pytest.approx(depth * 300.0 * 2000.0 / 2300.0, abs=0.13)  # friction: 0.12 N
    assert columns.true_energy.min() >= -1e-9
