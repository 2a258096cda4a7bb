"""Files as other programs write them: read as their format says, or refused with the place."""

import struct
from pathlib import Path

import numpy as np
import pytest

from forcebound.errors import ConfigError
from forcebound.haptics.geometry.mesh_file import Mesh, read_mesh, read_points

Faces = list[tuple[int, ...]]
Points = list[tuple[float, float, float]]
Outline = list[tuple[float, float]]

POINTS: Points = [(x, y, z) for x in (0.02, 0.04) for y in (-0.01, 0.01) for z in (-0.01, 0.01)]
QUADS: Faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
TRIANGLES: Faces = [t for a, b, c, d in QUADS for t in ((a, b, c), (a, c, d))]
CUBE = (8000.0, 2400.0)  # mm3, mm2
TWO = (16000.0, 4800.0)


def measures(mesh: Mesh) -> tuple[float, float]:
    """Volume in mm3 and area in mm2."""
    a, b, c = mesh.corners.transpose(1, 0, 2)
    volume = np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6.0
    return volume * 1e9, np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2.0 * 1e6


def prism(outline: Outline) -> tuple[Points, Faces]:
    """A polygon, counter-clockwise in mm, 10 mm thick; its caps are single faces."""
    n = len(outline)
    points = [(x / 1e3, y / 1e3, z) for z in (0.0, 0.01) for x, y in outline]
    sides = [(k, (k + 1) % n, (k + 1) % n + n, k + n) for k in range(n)]
    return points, [tuple(range(n - 1, -1, -1)), tuple(range(n, 2 * n)), *sides]


def vertices(points: Points = POINTS, form: str = "v %.7g %.7g %.7g\n") -> str:
    return "".join(form % point for point in points)


def faces(of: Faces = QUADS, first: int = 1, corner: str = "{}") -> str:
    return "".join(f"f {' '.join(corner.format(i + first) for i in face)}\n" for face in of)


def ply(points: Points = POINTS, of: Faces = QUADS, rows: str | None = None) -> str:
    header = (
        f"ply\nformat ascii 1.0\nelement vertex {len(points)}\nproperty float x\nproperty float y\n"
        f"property float z\nelement face {len(of)}\nproperty list uchar int vertex_indices\n"
    )
    face_rows = "".join(f"{len(face)} {' '.join(map(str, face))}\n" for face in of)
    return header + "end_header\n" + (rows or vertices(points, "%.7g %.7g %.7g\n") + face_rows)


def binary_ply(points: Points = POINTS, of: Faces = QUADS) -> bytes:
    head = ply(points, of, rows="\n").strip().replace("ascii", "binary_little_endian") + "\n"
    packed = [struct.pack("<3f", *point) for point in points]
    packed += [struct.pack(f"<B{len(face)}i", len(face), *face) for face in of]
    return head.encode() + b"".join(packed)


def facets(points: Points = POINTS) -> str:
    rows = ""
    for face in TRIANGLES:
        corners = vertices([points[corner] for corner in face], "vertex %.7g %.7g %.7g\n")
        rows += f"facet normal 0 0 0\nouter loop\n{corners}endloop\nendfacet\n"
    return rows


def stl(name: str = "part", points: Points = POINTS) -> str:
    return f"solid {name}\n{facets(points)}endsolid {name}\n"


def binary_stl(head: bytes = b"", count: int = 12) -> bytes:
    corners = b"".join(
        struct.pack("<12fH", 0, 0, 0, *(x for corner in face for x in POINTS[corner]), 0)
        for face in TRIANGLES
    )
    return head.ljust(80, b"\0") + struct.pack("<I", count) + corners


PLAIN = vertices() + faces()
OTHER: Points = [(x - 0.06, y, z) for x, y, z in POINTS]
U: Outline = [(0, 0), (30, 0), (30, 30), (20, 30), (20, 10), (10, 10), (10, 30), (0, 30)]
ARROW: Outline = [(0, 0), (20, 10), (0, 20), (8, 10)]
STAR: Outline = [
    ((20, 8)[k % 2] * np.cos(np.pi * k / 12), (20, 8)[k % 2] * np.sin(np.pi * k / 12))
    for k in range(24)
]
KEYHOLE: tuple[Points, Faces] = (  # a plate with a hole, whose caps are cut to it
    prism([(0, 0), (30, 0), (30, 30), (0, 30), (10, 10), (10, 20), (20, 20), (20, 10)])[0],
    [
        (4, 7, 6, 5, 4, 0, 3, 2, 1, 0),
        (8, 9, 10, 11, 8, 12, 13, 14, 15, 12),
        *((k, (k + 1) % 4, (k + 1) % 4 + 8, k + 8) for k in range(4)),
        *((4 + k, 4 + (k + 1) % 4, 12 + (k + 1) % 4, 12 + k) for k in range(4)),
    ],
)
SIDES = 2.0 * (np.hypot(20, 10) + np.hypot(8, 10)) * 10.0  # mm2, of the arrow
OBJ: dict[str, tuple[str, tuple[float, float]]] = {
    "indices that count backwards": (vertices() + faces(first=-8), CUBE),
    "backwards, object by object": (
        f"o a\n{vertices()}{faces(first=-8)}o b\n{vertices(OTHER)}{faces(first=-8)}",
        TWO,
    ),
    "backwards, each face after its corners": (
        "".join(vertices([POINTS[i] for i in face]) + "f -4 -3 -2 -1\n" for face in QUADS),
        CUBE,
    ),
    "a vertex of no face at the end": (vertices() + faces(first=-8) + "v 9 9 9\n", CUBE),
    "materials": ("mtllib a.mtl\n" + PLAIN.replace("f", "usemtl a\nf"), CUBE),
    "groups": (f"g a\n{PLAIN}g b\ns off\n{vertices(OTHER)}{faces(first=9)}", TWO),
    "a byte order mark": ("\ufeff" + PLAIN, CUBE),
    "tabs and spaces": (PLAIN.replace(" ", "\t").replace("f", "  f\t"), CUBE),
    "comments at the end": (PLAIN.replace("\n", " # 1 2\n").replace("# 1", "#1"), CUBE),
    "lines that go on": (PLAIN.replace("f 1 2", "f 1 \\\r\n 2").replace("v ", "v \\\n"), CUBE),
    "a last line that goes on": (PLAIN[:-1] + " \\", CUBE),
    "a comment that ends as if it went on": ("# C:\\parts\\\n" + PLAIN, CUBE),
    "old line ends": (PLAIN.replace("\n", "\r"), CUBE),
    "mixed corners": (
        f"vt 0 0\nvn 0 0 1\n{vertices()}{faces(QUADS[:2], corner='{}/1')}"
        f"{faces(QUADS[2:4], corner='{}//1')}{faces(TRIANGLES[8:], corner='{}/1/1')}",
        CUBE,
    ),
    "colours": (vertices(form="v %g %g %g 0.5 0.5 0.5\n") + faces(), CUBE),
    "a face with six corners beside three with texture": (
        (lambda mesh: vertices(mesh[0]) + faces(mesh[1][:2]) + faces(mesh[1][2:], corner="{}/1"))(
            prism([(10 * np.cos(k * np.pi / 3), 10 * np.sin(k * np.pi / 3)) for k in range(6)])
        ),
        (1500.0 * np.sqrt(3.0), 300.0 * np.sqrt(3.0) + 600.0),
    ),
    "a U": ((lambda mesh: vertices(mesh[0]) + faces(mesh[1]))(prism(U)), (7000.0, 3000.0)),
    "an arrow": (
        (lambda mesh: vertices(mesh[0]) + faces(mesh[1]))(prism(ARROW)),
        (1200.0, 240.0 + SIDES),
    ),
    "a plate with a hole": (vertices(KEYHOLE[0]) + faces(KEYHOLE[1]), (8000.0, 3200.0)),
}


@pytest.mark.parametrize("kind", OBJ)
def test_an_obj_file_is_read_as_its_format_says(tmp_path: Path, kind: str) -> None:
    text, expected = OBJ[kind]
    path = tmp_path / "part.obj"
    path.write_bytes(text.encode())
    mesh = read_mesh(path)
    assert mesh.is_closed
    assert measures(mesh) == pytest.approx(expected, rel=1e-5)


def test_names_in_latin_1_are_passed_over(tmp_path: Path) -> None:
    for name, text in {"a.obj": f"o Gehäuse\n{PLAIN}", "a.stl": stl("Gehäuse")}.items():
        (tmp_path / name).write_bytes(text.encode("latin-1"))
        assert measures(read_mesh(tmp_path / name)) == pytest.approx(CUBE)
    header = ply().replace("element vertex", "comment Gehäuse\nelement vertex")
    (tmp_path / "a.ply").write_bytes(header.encode("latin-1"))
    assert measures(read_mesh(tmp_path / "a.ply")) == pytest.approx(CUBE)


@pytest.mark.parametrize("turn", range(4))
@pytest.mark.parametrize("outline", [U, ARROW, STAR])
def test_a_face_that_is_not_convex_is_cut_right_from_any_corner_in_any_plane(
    tmp_path: Path, outline: Outline, turn: int
) -> None:
    points, polygons = prism([*outline[turn:], *outline[:turn]])
    axes = np.linalg.qr(np.random.default_rng(turn).normal(size=(3, 3)))[0]
    axes *= np.sign(np.linalg.det(axes))
    turned: Points = [tuple(row) for row in (np.array(points) @ axes).tolist()]
    x, y = np.array(outline).T
    area = abs(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2.0
    around = np.hypot(x - np.roll(x, -1), y - np.roll(y, -1)).sum()
    contents = {"a.obj": vertices(turned) + faces(polygons), "a.ply": ply(turned, polygons)}
    for name, text in contents.items():
        (tmp_path / name).write_text(text)
        found = measures(read_mesh(tmp_path / name))
        assert found == pytest.approx((10.0 * area, 2.0 * area + 10.0 * around), rel=1e-4)


@pytest.mark.parametrize(
    ("data", "expected"),
    [
        (stl().encode(), CUBE),
        (b"\xef\xbb\xbf  \r\n" + stl().replace("\n", "\r\n").upper().encode(), CUBE),
        (stl("vertex facet endsolid normal").encode(), CUBE),
        ((stl("a") + stl("a", OTHER)).encode(), TWO),
        (stl().replace("\n", "\r").encode(), CUBE),
        (stl().replace("normal 0 0 0", "normal -1.#IND 1.#QNAN nan").encode(), CUBE),
        (
            stl().replace("\n", " ").replace("part", "\n").replace("facet ", "facet\n").encode(),
            CUBE,
        ),
        (binary_stl(b"solid of a program that lies"), CUBE),
        (binary_stl(b"solid") + b"\r\n", CUBE),
    ],
)
def test_an_stl_file_is_read_as_its_format_says(
    tmp_path: Path, data: bytes, expected: tuple[float, float]
) -> None:
    path = tmp_path / "part.STL"
    path.write_bytes(data)
    assert measures(read_mesh(path)) == pytest.approx(expected, rel=1e-5)


def test_bytes_after_the_last_triangle_are_said(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = tmp_path / "longer.stl"
    path.write_bytes(binary_stl() + b"\0\0")
    assert measures(read_mesh(path)) == pytest.approx(CUBE, rel=1e-5)
    assert f"{path}: 2 bytes" in caplog.text


@pytest.mark.parametrize(
    "data",
    [
        ply(of=TRIANGLES[:2] + QUADS[1:]).replace("element", "obj_info a\r\nelement", 1),
        ply().replace("vertex_indices", "vertex_index").replace("\n", "\r\n"),
        binary_ply(),
        binary_ply(of=list(TRIANGLES)),
    ],
)
def test_a_ply_file_is_read_as_its_format_says(tmp_path: Path, data: str | bytes) -> None:
    path = tmp_path / "part.ply"
    path.write_bytes(data.encode() if isinstance(data, str) else data)
    assert measures(read_mesh(path)) == pytest.approx(CUBE, rel=1e-5)


def test_a_scan_far_from_its_origin_is_not_turned_inside_out(tmp_path: Path) -> None:
    path = tmp_path / "scan.obj"
    far: Points = [(x + 5e5, y + 5e6, z + 100.0) for x, y, z in POINTS]
    path.write_text(vertices(far, "v %.6f %.6f %.6f\n") + faces())
    a, b, c = read_mesh(path).corners.transpose(1, 0, 2)
    outward = (a + b + c) / 3.0 - (5e5 + 0.03, 5e6, 100.0)
    assert (np.cross(b - a, c - a) * outward).sum(axis=1).min() > 0.0


REFUSED: dict[str, tuple[str, str | bytes, tuple[str, ...]]] = {
    "decimal commas": ("obj", PLAIN.replace(".", ","), (":1:", "0,02", "decimal point")),
    "an index of no vertex": ("obj", PLAIN + "f 1 2 40\n", (":15:", "40 of 8")),
    "an index 0": ("obj", PLAIN + "f 0 1 2\n", (":15:", "f 0 1 2")),
    "an index before the first": ("obj", PLAIN + "f -9 1 2\n", (":15:", "-8", "-9")),
    "a weight": ("obj", PLAIN + "v 1 2 3 2\n", (":15:", "weight")),
    "two coordinates": ("obj", PLAIN + "v 1 2\n", (":15:", "3 numbers", "v 1 2")),
    "two corners": ("obj", PLAIN + "f 1 2\n", (":15:", "3 corners")),
    "a curved surface": ("obj", PLAIN + "surf 0 1 0 1 1 2 3 4\n", (":15:", "surf")),
    "what is no statement": ("obj", PLAIN + "v0.1 2 3\n", (":15:", "v0.1")),
    "a face that crosses itself": ("obj", PLAIN + "f 1 2 3 4\n", (":15:", "cross itself")),
    "another format": ("obj", stl(), (":1:", "solid part")),
    "facets with decimal commas": ("stl", stl().replace("0.01", "0,01"), (":2:", "decimal point")),
    "facets of four corners": (
        "stl",
        stl().replace("endloop", "vertex 0 0 0\nendloop", 1),
        (":2:", "3 vertices"),
    ),
    "a facet without numbers": ("stl", stl().replace("0.04", "nan"), (":16:", "vertex")),
    "an end that is missing": ("stl", stl()[:-300], ("facet",)),
    "a solid without its end": ("stl", stl("a") + "solid b\n" + facets(OTHER), ("endsolid",)),
    "a header of more triangles": ("stl", binary_stl(count=13), ("13 triangles", "734", "684")),
    "a header of fewer": ("stl", binary_stl(count=11), ("11 triangles", "634", "684")),
    "rows with decimal commas": ("ply", ply().replace("0.02", "0,02"), (":10:", "0,02")),
    "fewer rows": ("ply", ply().rpartition("4 1 5")[0], ("'face': 6", "13 rows")),
    "more rows": ("ply", ply() + "4 1 5 7 3\n", ("15 rows",)),
    "a face of more corners than numbers": (
        "ply",
        ply().replace("4 1 5 7 3", "5 1 5 7 3"),
        ("row 14", "5 1 5 7 3"),
    ),
    "a face of fewer": ("ply", ply().replace("4 1 5 7 3", "3 1 5 7 3"), ("row 14",)),
    "half an index": ("ply", ply().replace("4 1 5 7 3", "4 1 5.6 7 3"), ("row 14", "5.6")),
    "a vertex of four numbers": ("ply", ply().replace("\n4 0", " 1\n4 0", 1), ("row 8",)),
    "an index beyond": ("ply", ply(of=[*QUADS[:5], (1, 5, 70, 3)]), ("face 6", "71 of 8")),
    "an index below 0": ("ply", ply(of=[*QUADS[:5], (1, 5, -1, 3)]), ("face 6", "0 of 8")),
    "faces of another name": ("ply", ply().replace("vertex_indices", "corners"), ("faces",)),
    "corners of another name": ("ply", ply().replace("float x", "float a"), ("'x'",)),
    "a header without end": ("ply", "ply\n", ("header",)),
    "strips": ("ply", ply().replace("element face", "element tristrips"), ("strips",)),
    "binary faces of several kinds": (
        "ply",
        binary_ply(of=[QUADS[0], (0, 1, 3), (0, 2, 6, 4, 5)]),  # as long as three of four corners
        ("faces of one kind", "export triangles"),
    ),
    "points": ("ply", ply(of=[]), ("0 triangles", "8 points", "point_cloud")),
}


@pytest.mark.parametrize("kind", REFUSED)
def test_a_file_that_would_be_another_solid_is_refused_with_its_place(
    tmp_path: Path, kind: str
) -> None:
    suffix, data, words = REFUSED[kind]
    path = tmp_path / f"part.{suffix}"
    path.write_bytes(data.encode() if isinstance(data, str) else data)
    with pytest.raises(ConfigError) as caught:
        read_mesh(path, may_be_open=True)
    for word in (str(path), *words):
        assert word in str(caught.value)
    assert "bug in forcebound" not in str(caught.value)


def test_a_cloud_of_points_is_as_long_as_its_header_says(tmp_path: Path) -> None:
    path = tmp_path / "cloud.ply"
    path.write_text(ply(of=[]))
    assert read_points(path, None).points == pytest.approx(np.array(POINTS))
    path.write_text(ply(of=[]).replace("vertex 8", "vertex 9"))
    with pytest.raises(ConfigError, match="8 rows"):
        read_points(path, None)
