"""Distances on grids: of meshes, whose exact answers are known, and from files."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import meshes
import numpy as np
import pytest

from forcebound.errors import ConfigError
from forcebound.haptics.environments.solids_of_files import DistanceField
from forcebound.haptics.geometry.grid import BAND, GRID, Grid, mesh_grid
from forcebound.haptics.geometry.implicit import ImplicitSolid
from forcebound.haptics.geometry.mesh_file import Mesh
from forcebound.haptics.geometry.proxy import Surface
from forcebound.haptics.geometry.vectors import pad3

STILL = (0.0, 0.0, 0.0)
UPRIGHT = (1.0, 0.0, 0.0, 0.0)
SPACING = 0.001
RADIUS = 0.02


def _mesh(shape: meshes.Mesh) -> Mesh:
    vertices, faces = shape
    return Mesh(vertices, faces, True, "")


def _places(grid: Grid) -> Any:
    points = np.moveaxis(np.indices(grid.values.shape), 0, -1)
    return points * grid.place[3] + grid.place[:3]


def _to_sphere(places: Any) -> Any:
    return np.linalg.norm(places, axis=-1) - RADIUS


def _array(file: Path, distance: Any = _to_sphere, edge: float = 0.03) -> DistanceField:
    """A world of distances that are computed, not measured."""
    axis = np.arange(-edge, edge, SPACING)
    places = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), -1)
    np.save(file, distance(places))
    return DistanceField(
        file, spacing=SPACING, origin=(-edge, -edge, -edge), position=STILL, orientation=UPRIGHT
    )


def test_a_grid_has_the_distances_to_its_mesh_within_its_band() -> None:
    grid = mesh_grid(_mesh(meshes.sphere(RADIUS, 5)), SPACING)
    exact = _to_sphere(_places(grid))
    within = np.abs(exact) < (BAND - 0.2) * SPACING
    assert np.abs(grid.values - exact)[within].max() < 4e-5  # m; the facets are as flat as that
    assert (grid.values[exact < -BAND * SPACING - 4e-5] == -np.float32(BAND * SPACING)).all()
    assert (grid.values[exact > BAND * SPACING] == np.float32(BAND * SPACING)).all()


def test_what_two_parts_of_a_mesh_both_enclose_is_inside() -> None:
    vertices, faces = meshes.box(0.01, 0.01, 0.01)
    both = np.concatenate([vertices, vertices + 0.005]), np.concatenate([faces, faces + 8])
    grid = mesh_grid(_mesh(both), SPACING)
    places = _places(grid)
    inside = (np.abs(places) < 0.0098).all(-1) | (np.abs(places - 0.005) < 0.0098).all(-1)
    outside = (np.abs(places) > 0.0102).any(-1) & (np.abs(places - 0.005) > 0.0102).any(-1)
    assert (grid.values[inside] < 0.0).all()
    assert (grid.values[outside] > 0.0).all()


@pytest.mark.parametrize(("is_shaded", "off"), [(False, 0.04), (True, 0.004)])
def test_depth_and_direction_on_a_sphere_are_exact_to_the_grid(
    tmp_path: Path, is_shaded: bool, off: float
) -> None:
    # Between two points of the grid a sphere sags by (1 mm)^2 / 8 R = 6 um, and each cell is a
    # facet that is off by up to 1 mm / 2 R = 0.025 along each axis; shading takes that away.
    surface = Surface(force_shading=is_shaded)
    world = replace(_array(tmp_path / "sphere.npy"), surface=surface).open(3)
    for angle in np.linspace(0.0, 2.0, 20).tolist():
        place = (0.0, 0.018 * math.sin(angle), 0.018 * math.cos(angle))
        world.force("", (0.0, 1.5 * place[1], 1.5 * place[2]), STILL, 0.0)
        force = world.force("", place, STILL, 1.0)
        assert math.hypot(*force) == pytest.approx(2.0, rel=0.01)
        out = (0.0, -math.sin(angle), -math.cos(angle))
        assert np.dot(force, out) / math.hypot(*force) > math.cos(off)


def test_what_touches_the_border_goes_on_beyond_it(tmp_path: Path) -> None:
    world = _array(tmp_path / "ground.npy", lambda places: places[..., 2]).open(3)
    world.force("", (0.5, 0.2, 0.01), STILL, 0.0)
    assert world.force("", (0.5, 0.2, -0.002), STILL, 1.0) == pytest.approx(
        (0.0, 0.0, -2.0), abs=1e-3
    )


def test_nothing_outside_near_the_proxy_is_closer_to_a_deep_tip(tmp_path: Path) -> None:
    grid = mesh_grid(_mesh(meshes.bumpy(4)), SPACING)
    solid = ImplicitSolid(GRID, grid, dip=SPACING / 20)
    random, proxy = np.random.default_rng(1), (0.0, 0.0, 0.06)
    for angle in np.linspace(0.0, 6.0, 200).tolist():
        tip = (0.01, 0.04 * math.sin(angle), 0.04 * math.cos(angle))
        proxy, _ = solid.slide(proxy, tip)
        near = (np.array(proxy) + random.normal(0.0, 2e-4, (50, 3))).tolist()
        outside = [math.dist(one, tip) for one in near if solid.distance(pad3(one)) > 0.0]
        assert min(outside) > math.dist(proxy, tip) - 3e-5


@pytest.mark.parametrize(
    ("array", "words"),
    [
        (np.zeros((3, 3)), r"has the shape \(3, 3\): expected a grid of three axes"),
        (np.full((3, 3, 3), math.nan), r"has 27 entries .* no finite numbers, the first at \[0, 0"),
        (np.ones((3, 3, 3)), "distances from 1 to 1 m: the surface is where they change"),
        (np.arange(27.0).reshape(3, 3, 3) - 9, "changes by 9e.03 times the spacing .* in m"),
    ],
)
def test_an_array_that_is_no_distance_field_is_refused(
    tmp_path: Path, array: Any, words: str
) -> None:
    np.save(tmp_path / "wrong.npy", array)
    with pytest.raises(ConfigError, match=rf"wrong\.npy.*{words}"):
        DistanceField(tmp_path / "wrong.npy", spacing=SPACING).check_files()


def test_what_makes_no_grid_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"mine\.npy needs `spacing`"):
        DistanceField(tmp_path / "mine.npy")
    with pytest.raises(ConfigError, match=r"cannot read the grid .*mine\.npy: No such file"):
        DistanceField(tmp_path / "mine.npy", spacing=SPACING).check_files()
    (tmp_path / "text.npy").write_text("words")
    with pytest.raises(ConfigError, match=r"cannot make sense of .*text\.npy"):
        DistanceField(tmp_path / "text.npy", spacing=SPACING).check_files()
    with pytest.raises(ConfigError, match=r"0\.01 mm makes a grid of .* use at least 0\.\d+ mm"):
        DistanceField(spacing=1e-5).check_files()
