"""Strokes: they begin outside, go into what a scene shows, then across."""

import math

import pytest

from forcebound.haptics.environments.strokes import ACROSS, INWARDS, strokes
from forcebound.messages.packets import SceneObject

BALL = SceneObject("ball", "sphere", (0.02, 0.3, -0.1), size=(0.05,))
BOX = SceneObject("box", "box", (0.0, 0.0, 0.1), (0.5, 0.5, 0.5, 0.5), (0.1, 0.2, 0.02))
OBJECTS = [
    BALL,
    BOX,
    SceneObject("rod", "cylinder", size=(0.01, 0.4)),
    SceneObject("floor", "plane", (0.0, 0.0, -0.05)),
    SceneObject("bunny", "mesh", file="bunny.stl"),
    SceneObject("path", "path", points=((0.0, 0.1, 0.0), (0.0, 0.1, 0.1))),
]


@pytest.mark.parametrize("target", OBJECTS, ids=lambda target: target.name)
@pytest.mark.parametrize("axes", [1, 2, 3])
def test_a_stroke_leads_into_its_object_and_then_across(target: SceneObject, axes: int) -> None:
    for stroke in strokes([target], axes, 5):
        assert len(stroke) == INWARDS + 1 + ACROSS
        assert {len(vector) for tip in stroke for vector in tip[:2]} == {axes}
        times = [tip.elapsed for tip in stroke]
        assert times == sorted(set(times))
        begin, middle, end = stroke[0], stroke[INWARDS], stroke[-1]
        inwards = [m - b for m, b in zip(middle.position, begin.position, strict=True)]
        sideways = [e - m for e, m in zip(end.position, middle.position, strict=True)]
        assert sum(map(math.prod, zip(inwards, sideways, strict=True))) == pytest.approx(0.0)
        assert math.hypot(*inwards) >= 0.0199


def test_of_several_objects_each_is_stroked_and_of_none_nothing() -> None:
    assert len(list(strokes(OBJECTS, 3, 9))) == 9
    assert list(strokes([], 3, 9)) == []
