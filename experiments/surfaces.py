"""What the worlds with a surface do, in one figure: `docs/surfaces.png`.

The proxy on a solid of shapes, on distances on a grid and on a cloud of points, each in a slice;
and the force over the way for friction, stick-slip, a relief and a magnet. Worlds are asked as the
environment node asks them, along ways that are drawn here.
"""

import itertools
import math
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from forcebound.haptics.environments.solid import Shape, Solid
from forcebound.haptics.environments.solids_of_files import DistanceField, PointCloud
from forcebound.haptics.environments.touching import OpenTouchable, Touchable
from forcebound.haptics.geometry.proxy import Surface
from forcebound.haptics.geometry.vectors import Vector3

STILL = (0.0, 0.0, 0.0)
STIFFNESS = 1000.0  # N/m
GROUND = Shape("plane", axis=(-1.0, 0.0, 0.0))  # solid behind x = 0
SHAFT = Shape("cylinder", (0.0, -0.03, 0.0), (1.0, 0.0, 0.0), 0.0, 0.008, None, 0.04, True)
LOG = Shape("cylinder", (0.005, 0.02, 0.0), radius=0.02, length=0.1)
SHAPES = (GROUND, LOG, SHAFT)
TIP, PROXY = "tab:blue", "tab:red"


def follow(model: Touchable, way: Any, speed: float = 0.0) -> tuple[Any, Any]:
    """Return the forces and proxies of a world along a way, each of shape (n, 3)."""
    world = OpenTouchable(model, 3)
    forces, proxies = [], []
    for place in np.asarray(way).tolist():
        forces.append(world.force("", tuple(place), (0.0, speed, 0.0), 1.0))
        contact = world.contact("")
        proxies.append(tuple(place) if contact is None else contact.proxy)
    return np.array(forces), np.array(proxies)


def along(corners: Sequence[Vector3], step: float = 0.0002) -> Any:
    """Return points along straight lines from corner to corner."""
    parts = []
    for start, end in itertools.pairwise(corners):
        count = max(2, round(math.dist(start, end) / step))
        parts.append(np.linspace(start, end, count))
    return np.concatenate(parts)


def draw_slice(axes: Axes, model: Any, way: Any, extent: tuple[float, ...], title: str) -> None:
    """Draw solid, tip and proxy in a plane across z; up is where the hand comes from."""
    z = float(way[0][2])
    low_y, high_y, low_x, high_x = extent
    y, x = np.meshgrid(np.linspace(low_y, high_y, 240), np.linspace(low_x, high_x, 240))
    solid = model.solid()
    places = np.stack([x, y, np.full_like(x, z)], -1).reshape(-1, 3).tolist()
    local = [model.pose.local(tuple(place)) for place in places]
    away = np.array([solid.distance(place) for place in local]).reshape(x.shape)
    axes.contourf(1e3 * y, -1e3 * x, away, levels=[-1.0, 0.0], colors=["0.8"])
    if isinstance(model, DistanceField):
        levels = [-0.003, -0.002, -0.001, 0.001, 0.002, 0.003]
        axes.contour(1e3 * y, -1e3 * x, away, levels=levels, colors="0.5", linewidths=0.5)
    _, proxies = follow(model, way)
    for place, proxy in list(zip(way, proxies, strict=True))[::12]:
        ends = np.array([place, proxy])
        axes.plot(1e3 * ends[:, 1], -1e3 * ends[:, 0], color="0.4", linewidth=0.6)
    axes.plot(1e3 * way[:, 1], -1e3 * way[:, 0], color=TIP, label="tip")
    axes.plot(1e3 * proxies[:, 1], -1e3 * proxies[:, 0], color=PROXY, label="proxy")
    axes.set(title=title, xlabel="y (mm)", ylabel="-x (mm)", aspect="equal")
    axes.legend(loc="upper right", fontsize="small")


def draw_friction(axes: Axes) -> None:
    """Draw the force along the surface over strokes to and fro."""
    way = along(
        [(-0.001, 0.0, 0.0), (0.002, 0.0, 0.0), (0.002, 0.008, 0.0), (0.002, -0.002, 0.0)], 2e-5
    )
    for stick_slip, label in ((0.0, "sticks at the turn"), (0.05, "stick-slip")):
        surface = Surface(friction=0.4, static_friction=0.6, stick_slip=stick_slip)
        forces, _ = follow(Solid((GROUND,), stiffness=STIFFNESS, surface=surface), way, speed=0.02)
        axes.plot(1e3 * way[:, 1], forces[:, 1], label=label)
    for coefficient in (0.4, 0.6, -0.4, -0.6):
        axes.axhline(2.0 * coefficient, color="0.6", linewidth=0.6, linestyle="--")
    title = "friction 0.4, static 0.6, pressed with 2 N"
    axes.set(title=title, xlabel="y (mm)", ylabel="force along y (N)")
    axes.legend(fontsize="small")


def draw_relief(axes: Axes, folder: Path) -> None:
    """Draw the force over waves of a height map."""
    np.save(folder / "waves.npy", np.tile(np.cos(2 * math.pi * np.arange(64) / 64), (2, 1)))
    surface = Surface(texture=folder / "waves.npy", texture_height=0.0004, texture_size=0.004)
    way = along([(-0.001, 0.0, 0.0), (0.002, 0.0, 0.0), (0.002, 0.012, 0.0)], 2e-5)
    forces, _ = follow(Solid((GROUND,), stiffness=STIFFNESS, surface=surface), way)
    sliding = way[:, 1] > 0.0
    for axis, label in ((0, "across the surface"), (1, "along it")):
        axes.plot(1e3 * way[sliding, 1], forces[sliding, axis], label=label)
    axes.set(title="waves of 0.4 mm, pressed by 2 mm", xlabel="y (mm)", ylabel="force (N)")
    axes.legend(fontsize="small")


def draw_magnet(axes: Axes) -> None:
    """Draw the force of a magnet on the way in and out."""
    way = along([(-0.005, 0.0, 0.0), (0.002, 0.0, 0.0), (-0.005, 0.0, 0.0)], 2e-5)
    forces, _ = follow(Solid((GROUND,), stiffness=STIFFNESS, surface=Surface(magnet=0.003)), way)
    half = len(way) // 2
    for part, label in ((slice(half), "on the way in"), (slice(half, None), "on the way out")):
        axes.plot(1e3 * way[part, 0], forces[part, 0], label=label)
    axes.set(title="magnet of 3 mm", xlabel="x (mm)", ylabel="force along x (N)")
    axes.legend(fontsize="small")


@click.command()
@click.option("--out", default="docs/surfaces.png", type=click.Path(path_type=Path))
def main(out: Path) -> None:
    """Draw what the worlds with a surface do."""
    figure = Figure(figsize=(13.0, 8.0), dpi=90, layout="constrained")
    (shapes, grid, cloud), (friction, relief, magnet) = figure.subplots(2, 3)
    corners = [(-0.02, 0.05), (0.006, 0.05), (0.006, 0.034), (-0.009, 0.024), (-0.009, 0.012)]
    corners += [(0.006, 0.005), (0.006, -0.03), (0.028, -0.03), (0.028, -0.045)]
    way = along([(x, y, 0.0) for x, y in corners])
    draw_slice(shapes, Solid(SHAPES), way, (-0.06, 0.06, -0.04, 0.04), "solid: plane, log, shaft")
    back = along([(0.0, -0.025, -0.008), (0.018, -0.025, -0.008), (0.018, 0.025, -0.008)])
    extent = (-0.035, 0.035, -0.005, 0.06)
    draw_slice(
        grid, DistanceField(spacing=0.001), back, extent, "distance_field: 1 mm, lines each mm"
    )
    points = PointCloud(radius=0.003)
    draw_slice(cloud, points, back - (0.003, 0.0, 0.0), extent, "point_cloud: radius 3 mm")
    draw_friction(friction)
    with tempfile.TemporaryDirectory() as folder:
        draw_relief(relief, Path(folder))
    draw_magnet(magnet)
    figure.savefig(out)
