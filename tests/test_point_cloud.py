"""Clouds of points, on shapes whose answers are known."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from forcebound.errors import ConfigError
from forcebound.haptics.environments.solids_of_files import PointCloud
from forcebound.haptics.geometry.proxy import Surface
from forcebound.haptics.geometry.vectors import pad3

STILL = (0.0, 0.0, 0.0)
UPRIGHT = (1.0, 0.0, 0.0, 0.0)
RADIUS = 0.03  # of the sphere that the points lie on


def _sphere(count: int = 5000) -> Any:
    """Points spread evenly over a sphere (Fibonacci's spiral)."""
    height = 1.0 - 2.0 * (np.arange(count) + 0.5) / count
    turn = np.arange(count) * math.pi * (3.0 - math.sqrt(5.0))
    across = np.sqrt(1.0 - height**2)
    return RADIUS * np.stack([across * np.cos(turn), across * np.sin(turn), height], 1)


def _cloud(folder: Path, points: Any, **how: Any) -> PointCloud:
    np.save(folder / "points.npy", points)
    return PointCloud(folder / "points.npy", position=STILL, orientation=UPRIGHT, **how)


def _skin(model: PointCloud, direction: Any) -> float:
    """How far the skin is from the origin in a direction."""
    solid, low, high = model.solid(), 0.02, 0.04
    while high - low > 1e-9:
        middle = (low + high) / 2
        inside = solid.distance(pad3((middle * direction).tolist())) < 0.0
        low, high = (middle, high) if inside else (low, middle)
    return low


def test_the_skin_is_smooth_and_lies_by_about_the_radius_of_a_point_outside(tmp_path: Path) -> None:
    model = _cloud(tmp_path, _sphere(), radius=0.0015)
    directions = np.random.default_rng(1).normal(size=(50, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    away = np.array([_skin(model, one) for one in directions]) - RADIUS
    assert 0.0015 < away.mean() < 0.0025
    assert np.ptp(away) < 0.0001  # neighbours are 1.5 mm apart


def test_depth_direction_and_angle_of_friction_on_a_sphere(tmp_path: Path) -> None:
    model = _cloud(tmp_path, _sphere(), radius=0.003)
    smooth, rough = model.open(3), replace(model, surface=Surface(friction=0.4)).open(3)
    skin = sum(_skin(model, np.array(one)) for one in np.eye(3)) / 3
    for world in (smooth, rough):
        world.force("", (0.0, 0.0, 0.04), STILL, 0.0)
    for angle in np.linspace(0.0, 2.0, 200).tolist():
        place = (0.0, (skin - 0.002) * math.sin(angle), (skin - 0.002) * math.cos(angle))
        force = smooth.force("", place, STILL, 1.0)
        assert math.hypot(*force) == pytest.approx(2.0, rel=0.01)
        assert -np.dot(force, place) / math.hypot(*force) / math.hypot(*place) > math.cos(0.02)
        force = rough.force("", place, STILL, 1.0)
        contact = rough.contact("")
        assert contact is not None
        push = -float(np.dot(force, contact.normal))
        if angle > 0.5:
            drag = math.sqrt(math.hypot(*force) ** 2 - push**2)
            assert drag / push == pytest.approx(0.4, rel=0.01)


def _random_sphere(count: int, seed: int) -> Any:
    points = np.random.default_rng(seed).normal(size=(count, 3))
    return RADIUS * points / np.linalg.norm(points, axis=1, keepdims=True)


@pytest.mark.parametrize("count", [3_000, 30_000])
def test_no_straight_press_falls_through_random_points(
    tmp_path: Path, count: int, caplog: pytest.LogCaptureFixture
) -> None:
    model = _cloud(tmp_path, _random_sphere(count, seed=1))
    for out in _random_sphere(60, seed=2) / RADIUS:
        world = model.open(3)
        for depth in np.arange(-0.015, 0.0101, 0.0005):
            force = world.force("", tuple(((RADIUS - depth) * out).tolist()), STILL, 0.0)
        assert math.hypot(*force) > 10.0  # 10 mm below the points, and the skin is outside of them
    assert not caplog.records


def test_a_radius_too_small_for_the_points_warns_of_holes(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    _cloud(tmp_path, _random_sphere(3_000, seed=1), radius=0.0015).open(3)
    (warning,) = caplog.records
    assert "holes" in warning.getMessage()
    assert "4.3" in warning.getMessage()  # mm, a radius without


def test_a_fast_tip_does_not_get_through(tmp_path: Path) -> None:
    model = _cloud(tmp_path, _sphere())
    solid, world = model.solid(), model.open(3)
    random, place = np.random.default_rng(1), np.array([0.0, 0.0, 0.05])
    for _ in range(1500):
        world.force("", tuple(place.tolist()), STILL, 1.0)
        contact = world.contact("")
        proxy = pad3(place.tolist()) if contact is None else pad3(contact.proxy)
        assert solid.distance(proxy) > -1e-8
        assert math.hypot(*proxy) > RADIUS
        place = 0.98 * place + random.normal(0.0, 0.005, 3)


def test_the_scene_names_the_file(tmp_path: Path) -> None:
    (shown,) = _cloud(tmp_path, _sphere(100), scale=2.0).scene()
    assert (shown.shape, shown.size, shown.file) == (
        "points",
        (2.0,),
        str(tmp_path / "points.npy"),
    )
    assert shown.digest is not None
    assert len(shown.digest) == 64


@pytest.mark.parametrize(
    ("points", "how", "words"),
    [
        (np.zeros((5, 2)), {}, r"has the shape \(5, 2\): expected 2 to 5,000,000 rows of x, y"),
        (np.zeros((1, 3)), {}, r"has the shape \(1, 3\)"),
        (np.full((3, 3), math.nan), {}, "has 3 points whose coordinates are no finite numbers"),
        (
            1000 * _sphere(),
            {},
            "would measure 60 x 60 x 60 m: it looks like millimetres",
        ),
    ],
)
def test_a_file_that_is_no_cloud_is_refused(
    tmp_path: Path, points: Any, how: Any, words: str
) -> None:
    with pytest.raises(ConfigError, match=rf"points\.npy {words}"):
        _cloud(tmp_path, points, **how).check_files()


def test_points_far_apart_for_their_radius_lie_in_wider_cubes(tmp_path: Path) -> None:
    points = np.array([[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]])
    solid = _cloud(tmp_path, points, radius=1e-4).solid()
    assert solid.distance((3e-5, 0.0, 0.0)) == pytest.approx(-7e-5)
    assert solid.distance((1.0, 1.0, 1.0002)) == pytest.approx(1e-4)


def test_what_makes_no_cloud_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"must be > 0 m"):
        _cloud(tmp_path, _sphere(), radius=0.0)
    with pytest.raises(ConfigError, match=r"words\.txt: expected points"):
        PointCloud(tmp_path / "words.txt").check_files()
    with pytest.raises(ConfigError, match=r"cannot read the points .*none\.npy: No such file"):
        PointCloud(tmp_path / "none.npy").check_files()
