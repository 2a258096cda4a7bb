"""How a surface feels, on a half-space whose answers are known by heart."""

import itertools
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from forcebound.errors import ConfigError
from forcebound.haptics.geometry.proxy import HapticSurface, Surface
from forcebound.haptics.geometry.vectors import Pose, Vector3

STIFFNESS = 1000.0  # N/m
STILL = (0.0, 0.0, 0.0)


class Ground:
    """Everything behind x = 0 is solid."""

    def slide(self, proxy: Vector3, goal: Vector3) -> tuple[Vector3, Vector3 | None]:
        return (goal, None) if goal[0] <= 0.0 else ((0.0, goal[1], goal[2]), (-1.0, 0.0, 0.0))

    def distance(self, point: Vector3) -> float:
        return -point[0]

    def closest(self, point: Vector3) -> tuple[Vector3, Vector3]:
        return (0.0, point[1], point[2]), (-1.0, 0.0, 0.0)

    def shade(self, point: Vector3, normal: Vector3) -> Vector3:
        return (-math.cos(0.1), math.sin(0.1), 0.0)


def _ground(damping: float = 0.0, **how: Any) -> HapticSurface:
    surface = HapticSurface(Ground(), replace(Surface(), **how), STIFFNESS, damping)
    surface.touch((-0.01, 0.0, 0.0), STILL)
    return surface


def _stroke(surface: HapticSurface, depth: float, way: list[float]) -> list[tuple[float, ...]]:
    return [surface.touch((depth, y, 0.0), STILL) for y in way]


def test_the_force_is_stiffness_times_depth_along_the_normal() -> None:
    assert _ground().touch((0.002, 0.3, -0.1), STILL) == pytest.approx((2.0, 0.0, 0.0))


def test_a_solid_that_is_placed_elsewhere_pushes_and_drags_there() -> None:
    # The outward normal -x is turned to -y; the surface is at y = 0.1.
    pose = Pose((0.0, 0.1, 0.0), (math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)))
    surface = HapticSurface(Ground(), Surface(friction=0.5), STIFFNESS, 2.0, pose)
    surface.touch((0.3, 0.09, 0.0), STILL)
    surface.touch((0.3, 0.102, 0.0), STILL)
    force = surface.touch((0.35, 0.102, 0.0), (0.0, 0.1, 0.0))
    assert force == pytest.approx((1.0, 2.2, 0.0))
    assert surface.touched is not None
    assert surface.touched.proxy == pytest.approx((0.349, 0.1, 0.0))
    assert surface.touched.normal == pytest.approx((0.0, -1.0, 0.0))
    moved = Pose((0.0, 0.09, 0.0), pose.orientation)  # over the proxy
    surface.change(Ground(), Surface(), STIFFNESS, 0.0, moved)
    assert surface.touch((0.35, 0.102, 0.0), STILL) == pytest.approx((0.0, 12.0, 0.0))


def test_a_device_that_begins_inside_feels_nothing_until_it_has_left() -> None:
    surface = HapticSurface(Ground(), Surface(), STIFFNESS, 0.0)
    assert surface.touch((0.002, 0.0, 0.0), STILL) == STILL
    assert surface.touched is None
    surface.touch((-0.002, 0.0, 0.0), STILL)
    assert surface.touch((0.002, 0.0, 0.0), STILL)[0] == pytest.approx(2.0)


def test_damping_pushes_out_and_never_pulls_in() -> None:
    surface = _ground(damping=10.0)
    assert surface.touch((0.002, 0.0, 0.0), (0.1, 0.0, 0.0))[0] == pytest.approx(3.0)
    assert surface.touch((0.002, 0.0, 0.0), (-0.1, 0.0, 0.0))[0] == pytest.approx(1.0)
    assert surface.touch((0.002, 0.0, 0.0), (-1.0, 0.0, 0.0))[0] == 0.0


def test_a_tip_sticks_within_the_static_cone_and_slides_on_the_dynamic_one() -> None:
    surface = _ground(friction=0.3, static_friction=0.5)
    (force,) = _stroke(surface, 0.002, [0.0])
    assert force == (2.0, 0.0, 0.0)
    stuck, still_stuck, slipped, sliding = _stroke(surface, 0.002, [0.0005, 0.00099, 0.00101, 0.1])
    assert stuck[1] == pytest.approx(0.5)
    assert still_stuck[1] == pytest.approx(0.99)
    assert slipped[1] == pytest.approx(0.3 * slipped[0])
    assert sliding[1] == pytest.approx(0.3 * sliding[0])
    # Turning round: it sticks at once, and holds up to the static cone on the other side.
    *_, held, gone = _stroke(surface, 0.002, [0.099, 0.1 - 0.0006 - 0.00099, 0.09])
    assert held[1] == pytest.approx(-0.99)
    assert gone[1] == pytest.approx(-0.6)


def test_a_slow_stroke_judders_and_a_fast_one_does_not() -> None:
    way = [0.00005 * step for step in range(200)]
    slow = _ground(friction=0.3, static_friction=0.6, stick_slip=0.02)
    forces = [slow.touch((0.001, y, 0.0), (0.0, 0.01, 0.0))[1] for y in way][20:]
    slips = sum(after < before for before, after in itertools.pairwise(forces))
    assert 25 <= slips <= 31  # once every 0.3 mm of 9 mm
    assert max(forces) == pytest.approx(0.6, abs=0.05)
    assert min(forces) == pytest.approx(0.3, abs=0.05)
    fast = _ground(friction=0.3, static_friction=0.6, stick_slip=0.02)
    smooth = [fast.touch((0.001, y, 0.0), (0.0, 0.05, 0.0))[1] for y in way][20:]
    assert smooth == pytest.approx([0.3] * len(smooth))


def test_viscosity_resists_motion_along_the_surface_only() -> None:
    force = _ground(viscosity=3.0).touch((0.001, 0.0, 0.0), (0.5, 0.1, -0.2))
    assert force == pytest.approx((1.0, 0.3, -0.6))


def test_a_magnet_holds_what_has_touched_until_its_reach() -> None:
    surface = _ground(magnet=0.003)
    assert surface.touch((-0.002, 0.0, 0.0), STILL) == STILL  # not touched yet
    surface.touch((0.001, 0.0, 0.0), STILL)
    assert surface.touch((-0.002, 0.1, 0.0), STILL) == pytest.approx((-2.0, 0.0, 0.0))
    assert surface.touched is not None
    assert surface.touch((-0.004, 0.1, 0.0), STILL) == STILL
    assert surface.touch((-0.002, 0.1, 0.0), STILL) == STILL


def test_force_shading_turns_the_normal_force() -> None:
    force = _ground(force_shading=True).touch((0.002, 0.0, 0.0), STILL)
    assert force == pytest.approx((2.0 * math.cos(0.1), -2.0 * math.sin(0.1), 0.0))


def _ramp(folder: Path) -> Path:
    ramp = np.abs(np.linspace(-1, 1, 100, endpoint=False)).repeat(100).reshape(100, 100)
    np.save(folder / "ramp.npy", ramp)
    return folder / "ramp.npy"


def test_a_texture_lies_below_the_surface_and_pushes_downhill(tmp_path: Path) -> None:
    # Rows are along z on a face across x: from 1 at z = 0 down to 0 at half a tile, and up again.
    surface = _ground(texture=_ramp(tmp_path), texture_height=0.001, texture_size=0.01)
    on_top = surface.touch((0.002, 0.0033, 0.0), STILL)
    assert on_top[0] == pytest.approx(2.0)
    half_down = surface.touch((0.002, 0.0033, 0.0025), STILL)
    assert half_down == pytest.approx((1.5, 0.0, -1.5 * 0.2))  # downhill: along z, not resisted


def test_a_round_trip_over_a_texture_costs_nothing_and_gains_nothing(tmp_path: Path) -> None:
    surface = _ground(texture=_ramp(tmp_path), texture_height=0.001, texture_size=0.01)
    angles = np.linspace(0, 2 * math.pi, 20_001)
    path = np.stack(
        [0.003 + 0.001 * np.sin(3 * angles), 0.01 * np.sin(angles), 0.01 * np.cos(angles)], 1
    )
    assert abs(_work(surface, path)) < 1e-5  # J; a millimetre of spring and relief hold 3e-3


def _work(surface: HapticSurface, path: object) -> float:
    """Energy that the hand puts in, by the trapezoidal rule, in J."""
    places = np.asarray(path)
    forces = np.array([surface.touch(tuple(place), STILL) for place in places.tolist()])
    return float(np.sum((forces[1:] + forces[:-1]) / 2 * np.diff(places, axis=0)))


def test_a_closed_stroke_with_friction_costs_the_friction() -> None:
    depth, radius, friction = 0.002, 0.05, 0.4
    angles = np.linspace(0, 4 * math.pi, 20_001)
    circles = np.stack(
        [np.full_like(angles, depth), radius * np.cos(angles), radius * np.sin(angles)], 1
    )
    surface = _ground(friction=friction)
    _work(surface, circles)  # until it slides
    lost = _work(surface, circles)
    # The proxy is behind by mu d and runs on a circle that is smaller by 1e-4.
    expected = friction * STIFFNESS * depth * 4 * math.pi * radius
    assert lost == pytest.approx(expected, rel=0.01)


@pytest.mark.parametrize(
    ("how", "words"),
    [
        ({"friction": 0.5, "static_friction": 0.4}, "static_friction must be at least friction"),
        ({"friction": -0.5}, "friction must be >= 0"),
        ({"texture_size": 0.0}, "texture_size must be > 0 m"),
    ],
)
def test_a_wrong_surface_is_refused(how: dict[str, Any], words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        _ground(**how)


def test_what_is_no_height_map_is_refused(tmp_path: Path) -> None:
    text = tmp_path / "words.png"
    text.write_text("these are words")
    with pytest.raises(ConfigError, match=r"words\.png cannot be read .*give a picture"):
        _ground(texture=text)
    with pytest.raises(ConfigError, match=r"cannot read the height map .*there\.png: No such file"):
        _ground(texture=tmp_path / "there.png")
    np.save(tmp_path / "nan.npy", np.full((3, 3), math.nan))
    with pytest.raises(ConfigError, match=r"nan\.npy has .*entries that are no finite numbers"):
        _ground(texture=tmp_path / "nan.npy")


def test_a_picture_is_a_height_map_with_white_on_top(tmp_path: Path) -> None:
    from matplotlib import image

    picture = np.zeros((2, 2))
    picture[0, 0] = 1.0  # top left: the highest row of the picture is the last of the map
    image.imsave(tmp_path / "dots.png", picture, cmap="gray")
    dots = tmp_path / "dots.png"
    surface = _ground(texture=dots, texture_height=0.001, texture_size=0.02)
    assert surface.touch((0.002, 0.0, 0.01), STILL)[0] == pytest.approx(2.0)
    assert surface.touch((0.002, 0.01, 0.0), STILL)[0] == pytest.approx(1.0)
