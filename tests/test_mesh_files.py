"""Meshes from files: what is read, and which are refused."""

import hashlib
from pathlib import Path
from typing import Any

import meshes
import numpy as np
import pytest
import trimesh

from forcebound.errors import ConfigError
from forcebound.haptics.geometry import mesh_file
from forcebound.haptics.geometry.mesh_file import read_mesh, smoothed

BOX = meshes.box()


def saved(mesh: meshes.Mesh, path: Path) -> Path:
    vertices, faces = mesh
    trimesh.Trimesh(vertices, faces, process=False).export(path)
    return path


@pytest.mark.parametrize("suffix", [".stl", ".obj", ".ply"])
def test_every_kind_of_file_gives_the_same_triangles(tmp_path: Path, suffix: str) -> None:
    path = saved(BOX, tmp_path / f"box{suffix}")
    mesh = read_mesh(path)
    assert mesh.is_closed
    assert mesh.digest == hashlib.sha256(path.read_bytes()).hexdigest()
    ours, expected = (np.sort(c.reshape(-1, 9), axis=0) for c in (mesh.corners, BOX[0][BOX[1]]))
    assert ours == pytest.approx(expected, abs=1e-9)


def test_the_unit_is_scaled_and_inside_out_is_turned(tmp_path: Path) -> None:
    vertices, faces = BOX
    inside_out = read_mesh(saved((1e3 * vertices, faces[:, ::-1]), tmp_path / "box.ply"), 0.001)
    for corners in inside_out.corners:
        normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
        assert normal @ corners.mean(axis=0) > 0.0
    assert np.ptp(inside_out.corners) == pytest.approx(0.125)


def test_smoothed_normals_are_round_on_a_sphere_and_sharp_on_a_box(tmp_path: Path) -> None:
    ball = read_mesh(saved(meshes.sphere(0.05, 4), tmp_path / "ball.ply"))
    outward = ball.corners / np.linalg.norm(ball.corners, axis=2, keepdims=True)
    assert (smoothed(ball) * outward).sum(axis=2).min() > 0.999
    box = read_mesh(saved(BOX, tmp_path / "box.ply"))
    assert np.abs(smoothed(box)).max(axis=2).min() == pytest.approx(1.0)


def test_degenerate_triangles_go_where_two_corners_are_one(tmp_path: Path) -> None:
    vertices, faces = BOX
    faces = np.vstack([faces, [(0, 0, 1), (5, 5, 5)]])
    assert len(read_mesh(saved((vertices, faces), tmp_path / "box.ply")).corners) == 12


def refused(path: Path, *words: str, **keys: Any) -> None:
    with pytest.raises(ConfigError) as caught:
        read_mesh(path, **keys)
    message = str(caught.value)
    assert str(path) in message
    for word in words:
        assert word in message


def test_a_hole_is_said_with_its_place(tmp_path: Path) -> None:
    vertices, faces = BOX
    path = saved((vertices, faces[:-1]), tmp_path / "open.ply")
    refused(path, "is not closed", "3 edges belong to one triangle alone", "0.0625", "may_be_open")
    assert not read_mesh(path, may_be_open=True).is_closed


def test_a_triangle_wound_the_other_way_is_said(tmp_path: Path) -> None:
    vertices, faces = BOX
    turned = faces.copy()
    turned[0] = turned[0][::-1]
    refused(
        saved((vertices, turned), tmp_path / "turned.ply"), "do not agree which side is outside"
    )


def test_triangles_that_face_both_ways_are_said(tmp_path: Path) -> None:
    vertices, faces = BOX
    path = saved((vertices, np.concatenate([faces, faces[:, ::-1]])), tmp_path / "two_sided.ply")
    refused(path, "both ways", "may_be_open")
    assert not read_mesh(path, may_be_open=True).is_closed


def test_what_looks_like_millimetres_is_said(tmp_path: Path) -> None:
    path = saved((1e3 * BOX[0], BOX[1]), tmp_path / "mm.stl")
    refused(path, "125 x 125 x 125 m", "looks like millimetres", "`scale: 0.001`")
    assert np.ptp(read_mesh(path, scale=1.0).corners) == pytest.approx(125.0)
    refused(path, "1.25e-07", "less than 1 mm", scale=1e-9)


def test_too_many_triangles_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mesh_file, "MOST_TRIANGLES", 11)
    refused(saved(BOX, tmp_path / "box.ply"), "12 triangles", "1 to 11", "simplify")


def test_no_triangles_and_no_numbers_are_refused(tmp_path: Path) -> None:
    nothing = tmp_path / "points.obj"
    nothing.write_text("v 0 0 0\nv 1 0 0\n")
    refused(nothing, "0 triangles")
    flat = tmp_path / "flat.obj"
    flat.write_text("v 0 0 0\nv 1 0 0\nf 1 2 2\n")
    refused(flat, "no triangles", "points or lines")
    not_a_number = tmp_path / "nan.obj"
    not_a_number.write_text("v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    refused(not_a_number, "1 points", "the first is number 1")


@pytest.mark.parametrize("suffix", [".stl", ".obj", ".ply"])
@pytest.mark.parametrize("data", [b"", b"\0" * 90, b"solid x\nfacet", b"ply\nformat ascii 1.0\n"])
def test_a_damaged_file_is_one_sentence(tmp_path: Path, suffix: str, data: bytes) -> None:
    path = tmp_path / f"damaged{suffix}"
    path.write_bytes(data)
    refused(path)


def test_what_is_no_file_of_a_mesh_is_said(tmp_path: Path) -> None:
    refused(tmp_path / "gone.stl", "cannot read the mesh", "No such file")
    refused(tmp_path / "box.step", "expected mesh (.stl, .obj, .ply), got .step")
    (tmp_path / "folder.stl").mkdir()
    refused(tmp_path / "folder.stl", "a folder")
