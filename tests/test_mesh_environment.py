"""The environment of a mesh: forces, contact, scene, live parameters, and a mesh with a hole."""

import dataclasses
import hashlib
import math
from pathlib import Path
from random import Random

import meshes
import pytest
import trimesh

from forcebound.errors import ConfigError
from forcebound.graph.loader import load
from forcebound.haptics.environments import open_environment
from forcebound.haptics.environments.contract import check
from forcebound.haptics.environments.solids_of_files import RABBIT, RABBIT_POSE, TriangleMesh
from forcebound.haptics.geometry.proxy import Surface
from forcebound.run.virtual import run_virtual

STILL = (0.0, 0.0, 0.0)


@pytest.fixture(scope="module")
def box(tmp_path_factory: pytest.TempPathFactory) -> TriangleMesh:
    """A box with its face towards the hand at x = 0.01 m."""
    path = tmp_path_factory.mktemp("meshes") / "box.stl"
    trimesh.Trimesh(*meshes.box(0.05, 0.04, 0.03), process=False).export(path)
    return TriangleMesh(path, position=(0.06, 0.0, 0.0), orientation=(1.0, 0.0, 0.0, 0.0))


def test_the_force_is_stiffness_times_depth_along_the_normal(box: TriangleMesh) -> None:
    opened = box.open(3)
    assert opened.force("", (0.0, 0.0, 0.0), STILL, 0.0) == (0.0, 0.0, 0.0)
    assert opened.contact("") is None
    assert opened.force("", (0.012, 0.01, 0.0), STILL, 0.1) == pytest.approx((2.0, 0, 0), abs=1e-3)
    contact = opened.contact("")
    assert contact is not None
    assert contact.proxy == pytest.approx((0.010, 0.01, 0.0), abs=1e-6)
    assert contact.normal == pytest.approx((-1.0, 0.0, 0.0), abs=1e-4)


def test_the_force_turns_with_the_mesh(box: TriangleMesh) -> None:
    quarter = (math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5))  # about z: x becomes y
    turned = dataclasses.replace(box, orientation=quarter, position=STILL)
    opened = open_environment(turned, 3)
    opened.force("", (0.0, -0.06, 0.0), STILL, 0.0)
    assert opened.force("", (0.01, -0.049, 0.0), STILL, 0.1) == pytest.approx((0, 1.0, 0), abs=1e-3)


def test_a_file_of_the_user_is_where_it_says_and_the_rabbit_where_its_back_is_felt(
    tmp_path: Path, box: TriangleMesh
) -> None:
    assert box.file is not None
    (shown,) = TriangleMesh(box.file).scene()
    assert shown.position == STILL
    assert shown.orientation == (1.0, 0.0, 0.0, 0.0)
    touched = load("touch_mesh", [f"mesh:={box.file}"]).environment.model
    assert isinstance(touched, TriangleMesh)
    assert touched.pose.position == STILL
    copied = tmp_path / "copy.ply"
    copied.write_bytes(RABBIT.read_bytes())
    for file in (None, RABBIT, copied):
        assert TriangleMesh(file).pose.position == RABBIT_POSE.position
        assert TriangleMesh(file, position=STILL).pose.position == STILL


def test_shading_rounds_the_facets_of_a_coarse_ball(tmp_path: Path) -> None:
    path = tmp_path / "ball.ply"
    trimesh.Trimesh(*meshes.sphere(0.05, 2), process=False).export(path)
    tilts = []
    for shading in (False, True):
        opened = open_environment(
            TriangleMesh(path, position=STILL, surface=Surface(force_shading=shading)), 3
        )
        opened.force("", (0.06, 0.0, 0.0), STILL, 0.0)
        worst = 0.0
        for k in range(60):
            angle = 0.02 * k
            x, y = 0.047 * math.cos(angle), 0.047 * math.sin(angle)
            force = opened.force("", (x, y, 0.004), STILL, 0.0)
            outward = math.hypot(x, y, 0.004)
            along = -(force[0] * x + force[1] * y + force[2] * 0.004) / outward
            worst = max(worst, math.acos(min(1.0, along / math.hypot(*force))))
        tilts.append(worst)
    assert tilts[1] < 0.3 * tilts[0]


def test_shading_leaves_a_sharp_valley_as_it_is(tmp_path: Path) -> None:
    path = tmp_path / "groove.ply"
    outline = [(0.0, 0.0), (-0.04, 0.04), (-0.04, -0.04), (0.04, -0.04), (0.04, 0.04)]
    trimesh.Trimesh(*meshes.prism(outline, 0.05), process=False).export(path)
    surface = Surface(force_shading=True)
    groove = TriangleMesh(path, position=STILL, orientation=(1.0, 0.0, 0.0, 0.0), surface=surface)
    opened = groove.open(3)
    opened.force("", (0.0, 0.03, 0.0), STILL, 0.0)
    force = opened.force("", (0.0, -0.002, 0.0), STILL, 0.0)
    assert force == pytest.approx((0.0, -2.0, 0.0), abs=1e-3)
    force = opened.force("", (0.004, 0.001, 0.0), STILL, 0.0)  # behind one slope alone
    assert force[0] == pytest.approx(-force[1], rel=1e-3)


def test_the_scene_names_the_file_and_its_digest() -> None:
    (rabbit,) = TriangleMesh().open(3).scene()
    assert rabbit.shape == "mesh"
    assert rabbit.file == str(RABBIT)
    assert rabbit.digest == hashlib.sha256(RABBIT.read_bytes()).hexdigest()
    assert RABBIT.stat().st_size < 300_000


def test_a_mesh_with_a_hole_gives_numbers_inside_and_out(tmp_path: Path) -> None:
    path = tmp_path / "open.ply"
    vertices, faces = meshes.box()
    trimesh.Trimesh(vertices, faces[1:], process=False).export(path)
    open_box = TriangleMesh(path, may_be_open=True, position=STILL, orientation=(1.0, 0, 0, 0))
    assert check(open_box, axes=(1, 3)).violations == ()
    opened, random = open_environment(open_box, 3), Random(1)
    for _ in range(500):
        x, y, z = (random.uniform(-0.08, 0.08) for _ in range(3))
        assert all(map(math.isfinite, opened.force("", (x, y, z), STILL, 1.0)))
    with pytest.raises(ConfigError, match="is not closed"):
        open_environment(dataclasses.replace(open_box, may_be_open=False), 3)


def test_stroking_a_torn_mesh_under_the_certified_law_stays_passive(tmp_path: Path) -> None:
    path = tmp_path / "torn.ply"
    rabbit = trimesh.load_mesh(RABBIT, process=False)
    torn = trimesh.Trimesh(rabbit.vertices, rabbit.faces[::3], process=False)  # more hole than mesh
    torn.export(path)
    config = load("touch_mesh", ["delay:=3 ms", "stiffness:=10 N/mm"])
    assert isinstance(config.environment.model, TriangleMesh)
    place, turned = RABBIT_POSE.position, RABBIT_POSE.orientation
    model = dataclasses.replace(
        config.environment.model,
        file=path,
        may_be_open=True,
        position=place,
        orientation=turned,
    )
    environment = dataclasses.replace(config.environment, model=model)
    outcome = run_virtual(dataclasses.replace(config, environment=environment, duration=1.0))
    assert outcome.summary["true_energy_min_j"] >= -1e-9
