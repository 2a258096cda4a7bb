"""Points and triangles in OBJ, STL and PLY files: as the format says, or refused with the place.

trimesh reads STL and PLY; what it would take for another solid is looked for before and after. Of
OBJ, two statements matter here, vertices and faces, and they are read here: of six libraries each
gave another solid without a word, or crashed, on files that usual programs write.
"""

import io
import logging
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from forcebound.errors import ConfigError
from forcebound.files import content_of

Array: TypeAlias = "np.ndarray[Any, Any]"

MOST_CORNERS = 1000  # of a face that is not convex; the time to cut it grows with their square
FLAT = 1e-9  # of a face's area, beyond which a triangle of it looks the other way
LONGEST = 80  # characters of a line in an error
#: Statements of OBJ that make no surface. Those of curved surfaces are not among them.
PASSED = re.compile(
    "v[ntp]|[goslp]|mg|use(mtl|map)|(mtl|map)lib|lod|bevel|[cd]_interp|(shadow|trace)_obj"
)
_NUMBERS = rb"(?:\s+[-+]?[\d.]+(?:e[-+]?\d+)?){3}"
_FACET = re.compile(
    rb"facet\s+normal(?:\s+\S+){3}\s+outer\s+loop(?:\s+vertex" + _NUMBERS + rb"){3}"
    rb"\s+endloop\s+endfacet\s",
    re.IGNORECASE,
)
_FACET_BEGINS = re.compile(rb"^[ \t]*(facet\b)", re.IGNORECASE | re.MULTILINE)
_NAME = re.compile(rb"^([ \t]*(?:end)?solid)\b.*", re.IGNORECASE | re.MULTILINE)
_NO_NUMBER = re.compile(rb"[^-+.\dEe\sNnAaIiFf]")  # nan and inf are some
_ELEMENT = re.compile(rb"^element[ \t]+(\w+)[ \t]+(\d+)", re.MULTILINE)

_logger = logging.getLogger(__name__)


def triangles_in(file: Path, data: bytes) -> tuple[Array, Array]:
    """Return points, shape (n, 3), and triangles, three numbers of points each, shape (m, 3).

    Faces with more corners are cut. ``data`` is the content of ``file``, whose suffix says the
    format. ConfigError, with line or face, if it does not follow its format.
    """
    reader = {".obj": _obj, ".stl": _stl, ".ply": _ply}[file.suffix.lower()]
    with content_of(file):
        points, faces = reader(file, data)
    return np.asarray(points, float).reshape(-1, 3), np.asarray(faces, int).reshape(-1, 3)


def _wrong(place: object, expected: str, got: object) -> ConfigError:
    text = got if isinstance(got, str) else repr(got)
    return ConfigError(f"{place}: expected {expected}, got {text[:LONGEST]}", field="file")


def _obj(file: Path, data: bytes) -> tuple[Any, Array]:
    """Read the vertices and faces of an OBJ file; a negative index counts back from its line."""
    points: list[list[float]] = []
    corners: list[int] = []
    sizes: list[int] = []
    lines: list[int] = []
    for line, text in _statements(data):
        name, *words = text.split()
        expected = "a statement of polygons (v, f, vn, vt, g, ...): export a mesh of polygons"
        try:
            if name == "v":
                expected = "v and 3 numbers with a decimal point (then a colour, or the weight 1)"
                if len(words) not in (3, 4, 6, 7) or (len(words) == 4 and float(words[3]) != 1.0):
                    raise ValueError
                points.append([float(word) for word in words[:3]])
            elif name == "f":
                expected = f"f and 3 corners or more, by vertices from 1 on, or from -{len(points)}"
                found = [int(word.partition("/")[0]) for word in words]
                found = [index + len(points) if index < 0 else index - 1 for index in found]
                if len(found) < 3 or min(found) < 0:
                    raise ValueError
                corners += found
                sizes.append(len(found))
                lines.append(line)
            elif not PASSED.fullmatch(name):
                raise ValueError
        except ValueError:
            raise _wrong(f"{file}:{line}", expected, repr(text)) from None
    faces = _cut(np.array(points), np.array(corners, int), np.array(sizes, int), file, lines)
    return points, faces


def _statements(data: bytes) -> Iterator[tuple[int, str]]:
    """Yield the statements of an OBJ file without comments, each with its (last) line."""
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = data.decode("latin-1")  # names; numbers look the same
    begun = ""
    for number, line in enumerate(re.split("\r\n?|\n", text), 1):
        begun += line.partition("#")[0].strip()
        if begun.endswith("\\"):  # it goes on in the next line
            begun = begun[:-1] + " "
        elif begun:
            yield number, begun
            begun = ""


def _stl(file: Path, data: bytes) -> tuple[Array, Array]:
    """Read an STL file; its first word does not say whether it is text, since many lie."""
    import trimesh

    data = data.removeprefix(b"\xef\xbb\xbf")
    count = int.from_bytes(data[80:84], "little")
    rest = len(data) - 84 - 50 * count
    if 0 <= rest < 50 and len(data) >= 84:
        if rest:
            _logger.warning("%s: %d bytes after its last triangle are passed over", file, rest)
        loaded = trimesh.load(io.BytesIO(data[: len(data) - rest]), file_type="stl", process=False)
    elif data.lstrip()[:5].lower() != b"solid" or b"\0" in data:
        expected = f"the {count:,} triangles of its header, {84 + 50 * count:,} bytes"
        raise _wrong(file, f"{expected} (or text that begins with solid)", f"{len(data):,} bytes")
    else:
        data = data.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
        begun = [found.start(1) for found in _FACET_BEGINS.finditer(data)]
        count = len(begun)
        for start in begun:
            if not _FACET.match(data, start):
                line = data.count(b"\n", 0, start) + 1
                expected = "a facet of 3 vertices, each of 3 numbers with a decimal point"
                raise _wrong(f"{file}:{line}", expected, repr(data[start : start + LONGEST])[1:])
        data = _NAME.sub(rb"\1", data)  # may have any words, such as vertex
        loaded = trimesh.load(io.BytesIO(data), file_type="stl_ascii", process=False)
    parts: Any = getattr(loaded, "geometry", {"": loaded}).values()
    found = np.concatenate([np.zeros((0, 3, 3)), *(one.vertices[one.faces] for one in parts)])
    if len(found) != count:
        raise _wrong(file, f"{count:,} triangles between solid and endsolid", f"{len(found):,}")
    return found, np.arange(3 * count)


def _ply(file: Path, data: bytes) -> tuple[Array, Array]:
    """Read a PLY file; without faces it is one of points."""
    from trimesh.exchange.ply import load_ply

    head, end, body = data.partition(b"end_header")
    counts = {name.decode(): int(count) for name, count in _ELEMENT.findall(head)}
    if counts.get("tristrips"):
        raise _wrong(file, "faces", "strips of triangles: export a mesh of triangles")
    is_text = re.search(rb"^format[ \t]+ascii", head, re.MULTILINE) is not None
    if is_text:
        if bad := _NO_NUMBER.search(body):
            line = data.count(b"\n", 0, len(head + end) + bad.start()) + 1
            row = data.split(b"\n")[line - 1].strip()
            raise _wrong(f"{file}:{line}", "numbers with a decimal point", repr(row)[1:])
        rows = [row for row in body.splitlines() if row.strip()]
        if len(rows) != sum(counts.values()):
            expected = f"a row for each of {counts}, as its header says"
            raise _wrong(file, expected, f"{len(rows):,} rows")
        body = b"\n" + b"\n".join(rows)
    head = head.decode("ascii", "replace").encode("ascii", "replace")  # names and comments
    mixed = "as many bytes as its header says, and faces of equally many corners unless it is text"
    try:
        raw = load_ply(io.BytesIO(head + end + body))["metadata"]["_ply_raw"]
    except ValueError as error:
        raise _wrong(file, mixed, f"another file ({error}): export triangles") from error
    points = np.column_stack([raw["vertex"]["data"][axis].ravel() for axis in "xyz"])
    if not counts.get("face"):
        return points, np.zeros((0, 3))
    columns = raw["face"]["data"]
    names = columns.keys() if is_text else columns.dtype.names
    name = next((name for name in ("vertex_indices", "vertex_index") if name in names), None)
    if name is None:
        raise _wrong(file, "faces with vertex_indices", ", ".join(names))
    found = columns[name] if is_text else columns[name]["f1"]  # the length of each list is f0
    if not is_text and (columns[name]["f0"] != found.shape[1]).any():
        raise _wrong(file, mixed, "faces of several kinds: export triangles")
    sizes = np.array([len(face) for face in found])
    return points, _cut(points, np.concatenate(list(found)), sizes, file)


def _cut(
    points: Array, corners: Array, sizes: Array, file: Path, lines: Sequence[int] | None = None
) -> Array:
    """Return the triangles of faces, whose numbers of corners are ``sizes``.

    A face is cut as a fan from its first corner. Where the triangles of a fan look opposite ways,
    their area is not that of the face, which is not convex: then it is cut by its ears.
    """

    def place(face: int) -> str:
        return f"{file}: face {face + 1}" if lines is None else f"{file}:{lines[face]}"

    if len(sizes) == 0:
        return np.zeros((0, 3), int)
    starts, cuts = np.cumsum(sizes) - sizes, sizes - 2
    (outside,) = np.nonzero((corners < 0) | (corners >= len(points)))
    for corner in outside[:1]:
        face = int(np.searchsorted(starts, corner, "right")) - 1
        least = 0 if lines is None else 1
        expected = f"vertices from {least} to {len(points) - 1 + least}"
        raise _wrong(place(face), expected, repr(int(corners[corner]) + least))
    if cuts.min() < 1:
        raise _wrong(place(int(cuts.argmin())), "3 corners or more", repr(int(sizes.min())))
    owner = np.repeat(np.arange(len(sizes)), cuts)
    begin = np.cumsum(cuts) - cuts  # first triangle of each face
    first, ahead = starts[owner], np.arange(len(owner)) - begin[owner]
    triangles: Array = corners[np.stack([first, first + ahead + 1, first + ahead + 2], axis=1)]
    a, b, c = points[triangles].transpose(1, 0, 2)
    areas = np.cross(b - a, c - a)
    whole = np.add.reduceat(areas, begin)
    away = (areas * whole[owner]).sum(axis=1) < -FLAT * (whole**2).sum(axis=1)[owner]
    fan = np.add.reduceat(np.linalg.norm(areas, axis=1), begin)
    is_nothing = np.linalg.norm(whole, axis=1) < FLAT * fan  # both halves of a bow
    for face in np.union1d(owner[away], np.nonzero(is_nothing)[0]):
        mine = corners[starts[face] : starts[face] + sizes[face]]
        can_be_cut = len(mine) <= MOST_CORNERS and not is_nothing[face]
        ears = _ears(points[mine], whole[face]) if can_be_cut else None
        if ears is None:
            expected = (
                f"a face that does not cross itself, or is convex beyond {MOST_CORNERS} corners"
            )
            raise _wrong(place(face), expected, f"one of {len(mine)} corners: export triangles")
        triangles[begin[face] : begin[face] + cuts[face]] = mine[ears]
    return triangles


def _ears(polygon: Array, normal: Array) -> list[tuple[int, int, int]] | None:
    """Cut a polygon, shape (n, 3), by its ears; None: it crosses itself.

    An ear is a triangle of three neighbours without another corner in it. All of them look the way
    of the polygon, so that their areas add up to its own.

    Source: G. H. Meisters, Polygons have ears, American Mathematical Monthly 82(6), 1975.
    """
    axis = int(np.abs(normal).argmax())
    flat = np.roll(polygon, -axis, axis=1)[:, 1:] * (1.0, np.sign(normal[axis]))
    least = -FLAT * abs(normal[axis])

    def turn(a: Array, b: Array, c: Array) -> Array:
        ab, ac = b - a, c - a
        twice: Array = ab[..., 0] * ac[..., 1] - ab[..., 1] * ac[..., 0]
        return twice

    left = list(range(len(flat)))
    ears: list[tuple[int, int, int]] = []
    while len(left) > 2:
        for k in range(len(left)):
            ear = (left[k - 1], left[k], left[(k + 1) % len(left)])
            a, b, c = flat[list(ear)]
            if turn(a, b, c) < least:
                continue
            rest = flat[left]
            within = np.minimum(turn(a, b, rest), np.minimum(turn(b, c, rest), turn(c, a, rest)))
            is_corner = (rest[:, None] == (a, b, c)).all(axis=2).any(axis=1)
            if not ((within >= 0.0) & ~is_corner).any():
                break
        else:
            return None
        ears.append(ear)
        left.pop(k)
    return ears
