"""Solids of shapes, against exact answers."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from forcebound.errors import ConfigError
from forcebound.haptics.environments import open_environment
from forcebound.haptics.environments.contract import check
from forcebound.haptics.environments.solid import Shape, Solid
from forcebound.haptics.environments.touching import OpenTouchable
from forcebound.haptics.geometry.proxy import Surface
from forcebound.haptics.geometry.vectors import Vector3, pad3

STIFFNESS = 1000.0
STILL = (0.0, 0.0, 0.0)

SPHERE = Shape("sphere", radius=0.05)
GROUND = Shape("plane")  # solid below z = 0
BOX = Shape("box", size=(0.04, 0.04, 0.04))
PLATE = Shape("box", size=(0.1, 0.1, 0.001))
SHAFT = Shape("cylinder", radius=0.01, length=0.04, is_removed=True)  # 20 mm deep in the ground
ROOF = Shape("box", size=(0.1, 0.05, 0.05), axis=(0.0, 1.0, 1.0))  # an edge along x on top
COLUMN = Shape("cylinder", radius=0.02, length=0.1)
LUMPS = (GROUND, SPHERE, Shape("sphere", position=(0.06, 0.0, 0.02), radius=0.03), SHAFT)


def _open(*shapes: Shape, **surface: Any) -> OpenTouchable:
    world = open_environment(Solid(shapes, stiffness=STIFFNESS, surface=Surface(**surface)), 3)
    assert isinstance(world, OpenTouchable)
    return world


def _touched(world: OpenTouchable, *way: Vector3) -> tuple[Vector3, Vector3, Vector3]:
    """Force, proxy and normal at the end of a way."""
    for place in way:
        force = world.force("", place, STILL, 1.0)
    contact = world.contact("")
    assert contact is not None
    return pad3(force), pad3(contact.proxy), pad3(contact.normal)


CONTACTS = {
    "sphere": ((SPHERE,), (0.0, 0.03, 0.06), (0.0, 0.024, 0.032), (0.0, 0.03, 0.04)),
    "box's face": ((BOX,), (0.01, 0.0, 0.03), (0.012, -0.004, 0.017), (0.012, -0.004, 0.02)),
    "plate": ((PLATE,), (0.0, 0.0, 0.01), (0.01, 0.02, -0.0004), (0.01, 0.02, 0.0005)),
    "behind a plate": ((PLATE,), (0.0, 0.0, 0.01), (0.01, 0.02, -0.02), (0.01, 0.02, 0.0005)),
    "column": ((COLUMN,), (0.03, 0.0, 0.0), (0.012, 0.009, 0.01), (0.016, 0.012, 0.01)),
    "column's end": ((COLUMN,), (0.01, 0.0, 0.06), (0.01, 0.005, 0.048), (0.01, 0.005, 0.05)),
    "slope of a roof": (
        (ROOF,),
        (0.0, -0.03, 0.03),
        (0.01, -0.016, 0.016),
        (0.01, -0.025 / math.sqrt(2), 0.025 / math.sqrt(2)),
    ),
    "concave edge": ((GROUND, BOX), (0.03, 0.0, 0.01), (0.016, 0.003, -0.005), (0.02, 0.003, 0.0)),
    "concave corner": (
        (GROUND, BOX, Shape("box", position=(0.04, 0.05, 0.0), size=(0.1, 0.07, 0.1))),
        (0.03, 0.0, 0.01),
        (0.016, 0.018, -0.005),
        (0.02, 0.015, 0.0),
    ),
    "floor of a shaft": (
        (GROUND, SHAFT),
        (0.0, 0.0, 0.01),
        (0.003, 0.002, -0.025),
        (0.003, 0.002, -0.02),
    ),
    "edge of its floor": (
        (GROUND, SHAFT),
        (0.0, 0.0, 0.01),
        (0.012, 0.009, -0.03),
        (0.008, 0.006, -0.02),
    ),
    "sphere on the ground": (
        (GROUND, SPHERE),
        (0.06, 0.0, 0.01),
        (0.024, 0.032, -0.002),
        (0.03, 0.04, 0.0),
    ),
}


@pytest.mark.parametrize("name", CONTACTS)
def test_depth_and_direction_are_exact(name: str) -> None:
    shapes, outside, inside, expected = CONTACTS[name]
    # Straight in, and in little steps as a hand does.
    steps = [
        tuple(a + (b - a) * n / 50 for a, b in zip(outside, inside, strict=True)) for n in range(51)
    ]
    for way in ((outside, inside), steps):
        world = _open(*shapes)
        force, proxy, normal = _touched(world, *way)
        rests = [_touched(world, inside)[1] for _ in range(20)]
        assert max(math.dist(one, proxy) for one in rests) < 1e-9  # it does not oscillate
        assert proxy == pytest.approx(expected, abs=2e-9)
        assert force == pytest.approx(
            [STIFFNESS * (x - p) for x, p in zip(inside, expected, strict=True)], abs=1e-5
        )
        out = np.subtract(expected, inside) / math.dist(expected, inside)
        assert normal == pytest.approx(out, abs=1e-5)


def test_a_proxy_slides_over_a_rim_into_a_shaft() -> None:
    world = _open(GROUND, SHAFT)
    _touched(world, (0.03, 0.0, 0.01), (0.02, 0.0, -0.002))
    assert world.force("", (0.005, 0.0, -0.002), STILL, 1.0) == STILL
    assert world.contact("") is None


@pytest.mark.parametrize("friction", [0.1, 1.0])
@pytest.mark.parametrize(
    ("shapes", "way"),
    [
        (
            (SPHERE,),
            [(0.0, 0.046 * math.sin(a), 0.046 * math.cos(a)) for a in np.linspace(0, 2, 99)],
        ),
        ((BOX,), [(x, 0.5 * x, 0.018) for x in np.linspace(-0.015, 0.015, 99)]),
        ((ROOF,), [(x, 0.01, 0.022) for x in np.linspace(-0.04, 0.04, 99)]),
        (
            (GROUND, Shape("sphere", radius=0.05, is_removed=True)),
            [(0.0, 0.053 * math.sin(a), -0.053 * math.cos(a)) for a in np.linspace(-1, 1, 99)],
        ),
    ],
    ids=["sphere", "box", "wedge", "bowl"],
)
def test_a_sliding_tip_feels_the_angle_of_friction(
    shapes: tuple[Shape, ...], way: list[Vector3], friction: float
) -> None:
    world = _open(*shapes, friction=friction)
    world.force("", (way[0][0], way[0][1], 0.0 if GROUND in shapes else 0.1), STILL, 0.0)
    for place in way:
        force, _, normal = _touched(world, place)
    push = -float(np.dot(force, normal))
    drag = math.dist(force, [-push * n for n in normal])
    assert math.atan2(drag, push) == pytest.approx(math.atan(friction), rel=0.01)


_steps = st.lists(st.tuples(*[st.floats(-0.02, 0.02)] * 3), min_size=1, max_size=60)


def _walk(shapes: tuple[Shape, ...], steps: Any, pull: float, **surface: Any) -> None:
    """Random steps, pulled back to the middle; the proxy never enters, and never turns away."""
    model = Solid(shapes, stiffness=STIFFNESS, surface=Surface(**surface))
    solid, world = model.solid(), model.open(3)
    place, before = np.array([0.08, 0.0, 0.09]), None
    world.force("", tuple(place), STILL, 0.0)
    for step in steps:
        place = place * pull + step
        force = world.force("", tuple(place.tolist()), STILL, 1.0)
        contact = world.contact("")
        proxy = tuple(place) if contact is None else contact.proxy
        assert solid.distance(pad3(proxy)) > -1e-8
        if before is not None:
            assert math.dist(place, proxy) <= math.dist(place, before) + 1e-7
        assert np.linalg.norm(force) == pytest.approx(STIFFNESS * math.dist(place, proxy), abs=1e-9)
        before = proxy


@given(_steps, st.sampled_from([0.0, 0.4, 1.5]))
@settings(deadline=None)
def test_the_proxy_never_enters_and_moves_towards_the_device(steps: Any, friction: float) -> None:
    _walk(LUMPS, steps, 0.98, friction=friction)


@pytest.mark.slow
@pytest.mark.parametrize(("friction", "scale"), [(0.0, 0.005), (0.4, 0.0005), (1.5, 0.05)])
def test_a_long_random_walk_never_enters(friction: float, scale: float) -> None:
    steps = np.random.default_rng(1).normal(0.0, scale, (20_000, 3))
    _walk(LUMPS, steps, 0.999, friction=friction)


def test_every_combination_keeps_the_contract() -> None:
    surface = Surface(
        friction=0.3, static_friction=0.6, stick_slip=0.01, viscosity=1.0, magnet=0.002
    )
    world = Solid(
        (GROUND, BOX, SPHERE, SHAFT, COLUMN), stiffness=1e4, damping=10.0, surface=surface
    )
    assert check(world, axes=(1, 2, 3, 6)).violations == ()


def test_parameters_change_and_the_proxy_stays() -> None:
    world = _open(BOX)
    _touched(world, (0.0, 0.0, 0.03), (0.0, 0.0, -0.015))  # nearer to the lower face
    world.change(Solid((BOX,), stiffness=2 * STIFFNESS))
    force, proxy, _ = _touched(world, (0.0, 0.0, -0.015))
    assert proxy == pytest.approx((0.0, 0.0, 0.02))
    assert force == pytest.approx((0.0, 0.0, -2 * STIFFNESS * 0.035))
    # A face that moves over the proxy takes it along.
    world.change(Solid((Shape("box", size=(0.05, 0.05, 0.05)),)))
    assert _touched(world, (0.0, 0.0, -0.015))[1] == pytest.approx((0.0, 0.0, 0.025))


def test_the_scene_shows_every_shape() -> None:
    scene = Solid((GROUND, BOX, SHAFT)).scene()
    assert [one.name for one in scene] == ["plane_1", "box_2", "cylinder_3"]
    assert [one.size for one in scene] == [(), (0.04, 0.04, 0.04), (0.01, 0.04)]
    assert [one.is_removed for one in scene] == [False, False, True]


def test_an_axis_and_a_turn_place_a_box() -> None:
    # Its own z to x; before that a quarter turn about z: the long edge from x to y.
    box = Shape("box", size=(0.08, 0.04, 0.02), axis=(1.0, 0.0, 0.0), turn=math.pi / 2)
    world = _open(box)
    for outside, inside, face in (
        ((0.02, 0.0, 0.0), (0.009, 0.0, 0.0), (0.01, 0.0, 0.0)),
        ((0.0, 0.05, 0.0), (0.0, 0.039, 0.0), (0.0, 0.04, 0.0)),
        ((0.0, 0.0, 0.03), (0.0, 0.0, 0.019), (0.0, 0.0, 0.02)),
    ):
        assert _touched(world, outside, inside)[1] == pytest.approx(face, abs=1e-9)
        for back in (outside, (0.1, 0.1, 0.1)):
            world.force("", back, STILL, 1.0)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Solid(()), "shapes must list 1 to 64 shapes, got 0"),
        (lambda: Solid((SHAFT,)), "removed from nothing"),
        (lambda: Shape("sphere", radius=0.0), "radius must be > 0 m, got 0 m"),
        (lambda: Shape("sphere"), "a sphere needs radius"),
        (lambda: Shape("box", size=(0.1, 0.1, 0.1), radius=0.1), "a box has no radius"),
        (lambda: Shape("box", size=(0.1, 0.1, 0.0)), "size must be > 0 m along each edge"),
        (lambda: Shape("plane", axis=(0.0, 0.0, 0.0)), "axis must point somewhere"),
    ],
)
def test_shapes_that_make_no_solid_are_refused(make: Any, words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        make()


def test_fewer_axes_feel_the_components_along_them() -> None:
    for axes in (1, 2):
        world = open_environment(
            Solid((Shape("sphere", position=(0.05, 0.0, 0.0), radius=0.04),)), axes
        )
        rest = (0.0,) * (axes - 1)
        world.force("", (0.0, *rest), (0.0,) * axes, 0.0)
        assert world.force("", (0.012, *rest), (0.0,) * axes, 1.0) == pytest.approx((2.0, *rest))
