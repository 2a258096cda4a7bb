"""What the live page draws of the files of a scene."""

import hashlib
from pathlib import Path

import numpy as np
import pytest

from forcebound.haptics.geometry.mesh_file import read_mesh
from forcebound.observe.page.scene_files import MOST, coarse, content

LAUNCH = Path(__file__).parent.parent / "launch"


def test_a_coarse_mesh_has_few_triangles_in_the_same_place() -> None:
    mesh = read_mesh(LAUNCH / "rabbit.ply")
    assert len(mesh.faces) > 2 * 500
    corners = coarse(mesh, 500)
    assert 100 < len(corners) <= 500
    size = float(np.ptp(mesh.vertices, axis=0).max())
    for whole, seen in zip(
        (mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)),
        (corners.min(axis=(0, 1)), corners.max(axis=(0, 1))),
        strict=True,
    ):
        assert seen == pytest.approx(whole, abs=0.1 * size)
    assert np.array_equal(coarse(mesh, len(mesh.faces)), mesh.corners)


def test_a_page_draws_a_part_of_a_large_cloud_and_nothing_of_a_file_that_has_changed(
    tmp_path: Path,
) -> None:
    file = tmp_path / "cloud.npy"
    points = np.random.default_rng(5).uniform(-1.0, 1.0, (2 * MOST + 1, 3))
    np.save(file, points)
    digest = hashlib.sha256(file.read_bytes()).hexdigest()
    cloud = {"shape": "points", "file": str(file), "size": [0.1], "digest": digest}
    drawn = content(cloud)
    assert drawn is not None
    assert np.array(drawn["points"]) == pytest.approx(0.1 * points[::3], abs=1e-6)
    assert content({**cloud, "digest": "0" * 64}) is None
