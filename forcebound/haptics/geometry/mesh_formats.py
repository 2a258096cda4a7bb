"""Points and triangles in OBJ, STL and PLY files: as the format says, or refused with the place.

trimesh reads PLY and binary STL; what it would take for another solid is looked for before and
after. Of OBJ, two statements matter here, vertices and faces, and they are read here: each of six
libraries gave another solid without a word, or crashed, on files that usual programs write.
"""

import io
import logging
import re
from collections.abc import Callable, Iterator, Sequence
from itertools import chain
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from forcebound.errors import ConfigError
from forcebound.extras import needed
from forcebound.files import content_of

Array: TypeAlias = "np.ndarray[Any, Any]"

MOST_CORNERS = 1000  # of a face that is not convex; the time to cut it grows with their square
FLAT = 1e-9  # of a face's area, beyond which a triangle of it looks the other way
LONGEST = 80  # characters of a line in an error
#: Statements of OBJ that make no surface. Those of curved surfaces are not among them.
PASSED = re.compile("v[ntp]|[goslp]|mg|(use|map)(mtl|map|lib)|mtllib|lod|bevel|._interp|.+_obj")
_FACET_BEGINS = re.compile(rb"^[ \t]*(facet\b)", re.IGNORECASE | re.MULTILINE)
_FACET = re.compile(
    rb"facet\s+normal(\s+\S+){3}\s+outer\s+loop(\s+vertex(\s+[-+.\de]+){3}){3}\s+endloop\s+endfacet\s",
    re.IGNORECASE,
)
_VERTEX = re.compile(rb"\bvertex\s+(\S+)\s+(\S+)\s+(\S+)", re.IGNORECASE)
_NAME = re.compile(rb"^([ \t]*(?:end)?solid)\b.*", re.IGNORECASE | re.MULTILINE)
_NO_NUMBER = re.compile(rb"[^-+.\dEe\sNnAaIiFf]")  # nan and inf are some
_REALS = (b"float", b"double", b"float32", b"float64")  # of a PLY file
_ELEMENT = re.compile(rb"^element[ \t]+(\w+)[ \t]+(\d+)", re.MULTILINE)

_logger = logging.getLogger(__name__)


def triangles_in(file: Path, data: bytes) -> tuple[Array, Array]:
    """Return points, shape (n, 3), and triangles, three numbers of points each, shape (m, 3).

    Faces with more corners are cut. ``data`` is the content of ``file``, whose suffix says the
    format. ConfigError, with line or face, if it does not follow its format.
    """
    with content_of(file):
        points, faces = {".obj": _obj, ".stl": _stl, ".ply": _ply}[file.suffix.lower()](file, data)
        return np.asarray(points, float).reshape(-1, 3), np.asarray(faces, int).reshape(-1, 3)


def _wrong(place: object, expected: str, got: object) -> ConfigError:
    text = got if isinstance(got, str) else repr(got)[:LONGEST]
    return ConfigError(f"{place}: expected {expected}, got {text}", field="file")


def _obj(file: Path, data: bytes) -> tuple[Any, Any]:
    """Read the vertices and faces of an OBJ file; a negative index counts back from its line."""
    points: list[list[float]] = []
    faces: list[list[int]] = []
    lines: list[int] = []
    for line, words in _statements(data):
        expected = "a statement of polygons (v, f, vn, vt, g, ...): export a mesh of polygons"
        try:
            if words[0] == "v":
                expected = "v and 3 numbers with a decimal point (then a colour, or the weight 1)"
                if len(words) not in (4, 5, 7, 8) or (len(words) == 5 and float(words[4]) != 1.0):
                    raise ValueError
                points.append([float(word) for word in words[1:4]])
            elif words[0] == "f":
                expected = f"f and 3 corners or more, by vertices from 1 on, or from -{len(points)}"
                found = [int(word.partition("/")[0]) for word in words[1:]]
                faces.append([at + len(points) if at < 0 else at - 1 for at in found])
                lines.append(line)
                if len(found) < 3 or min(faces[-1]) < 0:
                    raise ValueError
            elif not PASSED.fullmatch(words[0]):
                raise ValueError
        except ValueError:
            raise _wrong(f"{file}:{line}", expected, " ".join(words)[:LONGEST]) from None
    return points, _cut(np.array(points), faces, lambda face: f"{file}:{lines[face]}")


def _statements(data: bytes) -> Iterator[tuple[int, list[str]]]:
    """Yield the words of the statements in an OBJ file without comments, with their (last) line."""
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = data.decode("latin-1")  # names; numbers look the same
    begun = ""
    for number, line in enumerate(re.split("\r\n?|\n", text), 1):
        begun += line.partition("#")[0].strip()
        if begun.endswith("\\"):  # it goes on in the next line
            begun = begun[:-1] + " "
        elif words := begun.split():
            yield number, words
            begun = ""
    if begun:
        yield number, begun.split()


def _stl(file: Path, data: bytes) -> tuple[Array, Array]:
    """Read an STL file; its first word does not say whether it is text, since many lie."""
    load_stl_binary = needed("an STL file", "trimesh.exchange.stl").load_stl_binary

    data = data.removeprefix(b"\xef\xbb\xbf")
    count = int.from_bytes(data[80:84], "little")
    rest = len(data) - 84 - 50 * count
    if 0 < rest < 50:
        _logger.warning("%s: %d bytes after its last triangle are passed over", file, rest)
        data = data[:-rest]
    elif rest and (data.lstrip()[:5].lower() != b"solid" or b"\0" in data):
        expected = f"{84 + 50 * count:,} bytes for the {count:,} triangles of its header"
        raise _wrong(file, f"{expected} (or text that begins with solid)", f"{len(data):,}")
    elif rest:
        count = 0
        data = _NAME.sub(rb"\1", re.sub(b"\r\n?", b"\n", data))  # a name may be vertex
        for count, found in enumerate(_FACET_BEGINS.finditer(data), 1):  # noqa: B007
            if not _FACET.match(data, found.start(1)):
                line = data.count(b"\n", 0, found.start(1)) + 1
                expected = "a facet of 3 vertices, each of 3 numbers with a decimal point"
                raise _wrong(f"{file}:{line}", expected, data[found.start(1) :][:LONGEST])
        if not data.rstrip().lower().endswith(b"endsolid"):
            raise _wrong(file, "endsolid after the last facet, as in a whole file", "none")
        words = chain.from_iterable(found.groups() for found in _VERTEX.finditer(data))
        corners = np.fromiter(map(float, words), float)
        if len(corners) != 9 * count:
            got = f"{len(corners) // 3:,} in {count:,} lines that begin with facet"
            raise _wrong(file, "3 vertices for each facet, which begins a line", got)
        return corners, np.arange(3 * count)
    return load_stl_binary(io.BytesIO(data)).get("vertices", ()), np.arange(3 * count)


def _ply(file: Path, data: bytes) -> tuple[Array, Any]:
    """Read a PLY file; without faces it is one of points."""
    load_ply = needed("a PLY file", "trimesh.exchange.ply").load_ply

    head, end, body = data.partition(b"end_header")
    counts = {name.decode(): int(count) for name, count in _ELEMENT.findall(head)}
    if counts.get("tristrips"):
        raise _wrong(file, "faces", "strips of triangles: export a mesh of triangles")
    if is_text := b"format ascii" in head:
        if bad := _NO_NUMBER.search(body):
            line = data.count(b"\n", 0, len(head + end) + bad.start()) + 1
            row = data.split(b"\n")[line - 1]
            raise _wrong(f"{file}:{line}", "numbers with a decimal point", row)
        rows = [row for row in body.splitlines() if row.strip()]
        if len(rows) != sum(counts.values()):
            raise _wrong(file, f"a row for each of {counts} in its header", f"{len(rows):,} rows")
        _check_rows(file, head, rows)
        body = b"\n" + b"\n".join(rows)
    ascii_head = head.decode("ascii", "replace").encode("ascii", "replace")  # of any comments
    head = re.sub(rb"\bvertex_index\b", b"vertex_indices", ascii_head)
    try:
        read: Any = load_ply(io.BytesIO(head + end + body))
        elements = read["metadata"]["_ply_raw"]
        points = np.column_stack([elements["vertex"]["data"][axis].ravel() for axis in "xyz"])
        faces: Any = elements["face"]["data"]["vertex_indices"] if counts.get("face") else ()
        if not is_text and len(faces):
            if (faces["f0"] != faces["f1"].shape[1]).any():
                raise ValueError("faces of several kinds")
            faces = faces["f1"]
    except (ValueError, LookupError, UnboundLocalError) as error:  # of trimesh
        expected = "as many bytes as its header says, and faces of one kind unless it is text"
        raise _wrong(file, expected, f"another file ({error}): export triangles") from error
    return points, _cut(points, faces, lambda face: f"{file}: face {face + 1}")


def _check_rows(file: Path, head: bytes, rows: Sequence[bytes]) -> None:
    """Refuse a row of a PLY text that has not the numbers which its header says."""
    first = 0
    for element in re.split(rb"^\s*element\s+", head, flags=re.MULTILINE)[1:]:
        (_, count, *_), *properties = [
            line.split() for line in element.splitlines() if line.split()
        ]
        kinds = [words[1:] for words in properties if words[0] == b"property"]
        last = first + int(count)
        for number, row in enumerate(rows[first:last], first + 1):
            cells, used = row.split(), 0
            for kind, *types in kinds:
                many = cells[used : used + 1]
                used += 1
                if kind == b"list" and many and many[0].isdigit():
                    listed = cells[used : used + int(many[0])]
                    is_whole = types[1] not in _REALS
                    used += int(many[0]) if not is_whole or all(map(_is_whole, listed)) else 0
            if used != len(cells):
                raise _wrong(f"{file}: row {number}", "the numbers that the header says", row)
        first = last


def _is_whole(cell: bytes) -> bool:
    return cell.removeprefix(b"-").isdigit()


def _cut(points: Array, faces: Sequence[Sequence[int]], place: Callable[[int], str]) -> Array:
    """Return the triangles of faces.

    A face is cut as a fan from its first corner. Where the triangles of a fan look opposite ways,
    their area is not that of the face, which is not convex: then it is cut by its ears.
    """
    if not len(faces):
        return np.zeros((0, 3), int)
    sizes = np.array([len(face) for face in faces])
    corners = np.fromiter(chain.from_iterable(faces), int)
    starts, cuts = np.cumsum(sizes) - sizes, sizes - 2
    for bad in np.nonzero((corners < 0) | (corners >= len(points)))[0][:1]:
        face = int(np.searchsorted(starts, bad, "right")) - 1
        got = f"number {corners[bad] + 1} of {len(points)}"
        raise _wrong(place(face), "a vertex that there is", got)
    if cuts.min() < 1:
        raise _wrong(place(int(cuts.argmin())), "3 corners or more", str(sizes.min()))
    owner = np.repeat(np.arange(len(sizes)), cuts)
    begin = np.cumsum(cuts) - cuts  # first triangle of each face
    first, ahead = starts[owner], np.arange(len(owner)) - begin[owner]
    triangles: Array = corners[np.stack([first, first + ahead + 1, first + ahead + 2], axis=1)]
    a, b, c = points[triangles].transpose(1, 0, 2)
    areas = np.cross(b - a, c - a)
    whole = np.add.reduceat(areas, begin)
    fan = np.add.reduceat(np.linalg.norm(areas, axis=1), begin)
    is_nothing = np.linalg.norm(whole, axis=1) < FLAT * fan  # both halves of a bow
    away = (areas * whole[owner]).sum(axis=1) < -FLAT * (whole**2).sum(axis=1)[owner]
    for face in np.union1d(owner[away], np.nonzero(is_nothing)[0]):
        mine = corners[starts[face] :][: sizes[face]]
        can_be_cut = len(mine) <= MOST_CORNERS and not is_nothing[face]
        ears = _ears(points[mine], whole[face]) if can_be_cut else None
        if ears is None:
            expected = f"a face that does not cross itself, convex if above {MOST_CORNERS} corners"
            raise _wrong(place(face), expected, f"one of {len(mine)} corners: export triangles")
        triangles[begin[face] :][: cuts[face]] = mine[ears]
    return triangles


def _ears(polygon: Array, normal: Array) -> list[tuple[int, int, int]] | None:
    """Cut a polygon, shape (n, 3), by its ears; None: it crosses itself.

    An ear is a triangle of three neighbours without another corner in it. All of them look the way
    of the polygon, so their areas add up to its area.

    Source: G. H. Meisters, Polygons have ears, American Mathematical Monthly 82(6), 1975.
    """
    axis = int(np.abs(normal).argmax())
    u, v = np.roll(polygon, -axis, axis=1)[:, 1:].T
    flat = u + 1j * np.sign(normal[axis]) * v

    def turn(a: Array, b: Array, c: Array) -> Array:
        return np.imag((b - a).conjugate() * (c - a))

    left, ears = list(range(len(flat))), list[tuple[int, int, int]]()
    while len(left) > 2:
        for ear in zip(left[-1:] + left[:-1], left, left[1:] + left[:1], strict=True):
            a, b, c = flat[list(ear)]
            if turn(a, b, c) < -FLAT * abs(normal[axis]):
                continue
            p = flat[left]
            within = (turn(a, b, p) >= 0) & (turn(b, c, p) >= 0) & (turn(c, a, p) >= 0)
            if not (within & (p != a) & (p != b) & (p != c)).any():
                break
        else:
            return None
        ears.append(ear)
        left.remove(ear[1])
    return ears
