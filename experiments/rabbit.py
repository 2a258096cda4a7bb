"""The rabbit of `touch_mesh`: a mesh with thin ears, a dent in its back, fur, and a plinth's edges.

Ellipsoids that melt into each other are cut into triangles by surface nets (S. F. F. Gibson,
Constrained elastic surface nets, MERL TR99-24, 1999): a vertex in each cell of a grid that the
surface passes, at the mean of where it crosses the cell's edges; a face for each crossed edge of
the grid. The plinth is a box of its own, with true edges. Units: m; z is up, x forward.
"""

from pathlib import Path
from typing import Any, TypeAlias

import click
import numpy as np
import trimesh

from forcebound.graph.loader import load
from forcebound.haptics.environments.solids_of_files import RABBIT, TriangleMesh

Array: TypeAlias = "np.ndarray[Any, Any]"

CELL = 1.6  # mm
LOW, HIGH = (-45.0, -30.0, -6.0), (52.0, 30.0, 96.0)  # mm
PLINTH = ((-40.0, -26.0, -6.0), (46.0, 26.0, 2.0))  # mm

# Centre and half axes, in mm; left and right where y is not 0.
BODY = (((0, 0, 24), (30, 19, 20)), ((30, 0, 48), (15, 12, 12)), ((-32, 0, 22), (7, 7, 7)))
LEGS = (((-10, 17, 13), (15, 7, 13)), ((26, 8, 8), (10, 5, 8)), ((18, 7, 20), (7, 6, 16)))
EARS, INNER_EARS = (((23, 7, 74), (2.6, 6, 19)),), (((26, 7, 75), (2.4, 3.5, 13)),)
DENT = (((-8, 0, 55.5), (16, 16, 16)),)
Ellipsoids: TypeAlias = tuple[tuple[tuple[float, ...], tuple[float, ...]], ...]


def distance(x: Array, y: Array, z: Array, ellipsoids: Ellipsoids, melt: float) -> Array:
    """Return about the distance to ellipsoids that melt together within ``melt``, in mm."""
    nearest = np.full(x.shape, np.inf)
    for centre, axes in ellipsoids:
        for side in (1, -1) if centre[1] else (1,):
            offset = (x - centre[0], y - side * centre[1], z - centre[2])
            once = np.sqrt(sum((o / a) ** 2 for o, a in zip(offset, axes, strict=True)))
            twice = np.sqrt(sum((o / a**2) ** 2 for o, a in zip(offset, axes, strict=True)))
            one = once * (once - 1.0) / np.maximum(twice, 1e-9)
            overlap = np.maximum(melt - np.abs(one - nearest), 0.0) / melt
            nearest = np.minimum(one, nearest) - 0.25 * melt * overlap**2
    return nearest


def rabbit(x: Array, y: Array, z: Array) -> Array:
    """Return about the distance to the rabbit, in mm; negative inside."""
    fur = 0.5 * np.sin(1.1 * x) * np.sin(1.1 * y) * np.sin(1.1 * z)
    body = distance(x, y, z, BODY + LEGS, melt=6.0) + fur / (1.0 + np.exp(0.5 * (x - 5.0)))
    ears = np.maximum(distance(x, y, z, EARS, 1.0), -distance(x, y, z, INNER_EARS, 1.0))
    return np.maximum(np.minimum(body, ears), -distance(x, y, z, DENT, 1.0))


def surface_net(values: Array) -> tuple[Array, Array]:
    """Return vertices, in cells, and triangles where values on a grid change their sign."""
    inside = values < 0.0
    total, count = np.zeros((*values.shape, 3)), np.zeros(values.shape)
    crossed = []
    for axis in range(3):
        low = [slice(None)] * 3
        high = [slice(None)] * 3
        low[axis], high[axis] = slice(None, -1), slice(1, None)
        one, other = values[tuple(low)], values[tuple(high)]
        places = np.argwhere(inside[tuple(low)] != inside[tuple(high)])
        index = tuple(places.T)
        share = one[index] / (one[index] - other[index])
        points = places.astype(float)
        points[:, axis] += share
        crossed.append((axis, places, inside[tuple(low)][index]))
        for step_u in (0, 1):
            for step_v in (0, 1):  # the four cells around an edge
                cells = places.copy()
                cells[:, (axis + 1) % 3] -= step_u
                cells[:, (axis + 2) % 3] -= step_v
                np.add.at(total, tuple(cells.T), points)
                np.add.at(count, tuple(cells.T), 1)
    used = count > 0
    number = np.full(values.shape, -1)
    number[used] = np.arange(used.sum())
    faces = []
    for axis, places, is_inside in crossed:
        u, v = np.eye(3, dtype=int)[(axis + 1) % 3], np.eye(3, dtype=int)[(axis + 2) % 3]
        around = (places, places - u, places - u - v, places - v)
        a, b, c, d = (number[tuple(cells.T)] for cells in around)
        quads = np.stack([a, b, c, d], axis=1)
        quads[~is_inside] = quads[~is_inside][:, ::-1]
        faces += [quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]
    return total[used] / count[used][:, None], np.vstack(faces)


def draw(picture: Path) -> None:
    """Draw the mesh, and the proxy of a tip that goes with the hand of `touch_mesh`."""
    import matplotlib.pyplot as plt
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    config = load("touch_mesh")
    model, hand = config.environment.model, config.only.operator
    assert isinstance(model, TriangleMesh)
    assert hand is not None
    world, tips, proxies = model.open(3), [], []
    for tick in range(2500):
        tip = tuple(hand.target(1e-3 * tick))
        world.force("", tip, (0.0, 0.0, 0.0), 1e-3 * tick)
        contact = world.contact("")
        tips.append(tip)
        proxies.append(tip if contact is None else contact.proxy)
    unit_vectors = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    turned = np.array([model.pose.turned(axis) for axis in unit_vectors])
    corners = model.content().corners @ turned + model.pose.position
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    light = normals @ (-0.7, 0.5, 0.5) / np.linalg.norm(normals, axis=1)
    figure = plt.figure(figsize=(6, 5))
    axes: Any = figure.add_subplot(projection="3d", computed_zorder=False)
    up = corners[..., (2, 1, 0)] * (1e3, 1e3, -1e3)  # the hand's -x is up
    colours = plt.get_cmap("bone")(0.35 + 0.6 * np.clip(light, 0.0, 1.0))
    axes.add_collection3d(Poly3DCollection(up, facecolors=colours, edgecolors=colours))
    for path, label, colour in ((proxies, "proxy", "tab:red"), (tips, "tip", "tab:blue")):
        x, y, z = (1e3 * np.array(path)).T
        axes.plot(z, y, -x, color=colour, linewidth=1.5, label=label)
    axes.set(xlim=(-45, 50), ylim=(-45, 45), zlim=(-60, 35), yticks=(-40, -20, 0, 20, 40))
    axes.set(xlabel="z (mm)", ylabel="y (mm)", zlabel="-x (mm)", box_aspect=(1, 1, 1))
    axes.view_init(25, 120)
    axes.legend(loc="upper left")
    figure.savefig(picture, dpi=90, bbox_inches="tight")


@click.command()
@click.option("--out", default=RABBIT, type=click.Path(path_type=Path), help="The mesh.")
@click.option("--picture", type=click.Path(path_type=Path), help="Draw it, too.")
def main(out: Path, picture: Path | None) -> None:
    """Make the rabbit of touch_mesh."""
    axes = [np.arange(low, high, CELL) for low, high in zip(LOW, HIGH, strict=True)]
    vertices, faces = surface_net(rabbit(*np.meshgrid(*axes, indexing="ij")))
    animal = trimesh.Trimesh(CELL * vertices + LOW, faces, process=False)
    plinth = trimesh.creation.box(bounds=PLINTH)
    mesh: Any = trimesh.util.concatenate([animal, plinth])
    mesh.apply_scale(0.001)
    out.write_bytes(mesh.export(file_type="ply"))
    click.echo(f"{out}: {len(mesh.faces)} triangles")
    if picture is not None:
        draw(picture)
