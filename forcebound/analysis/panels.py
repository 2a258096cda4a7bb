"""Panels of a figure: position, force, energy, loop delay, force over penetration.

The colours are Okabe and Ito's, which people with any colour vision can tell apart; the same
quantity has the same colour in every panel.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from forcebound.analysis.surface import Floats, Surface, penetration, surface
from forcebound.telemetry import TelemetryColumns

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Run: TypeAlias = tuple[str, TelemetryColumns, Mapping[str, Any]]  # label, telemetry, launch file

# Source: Okabe, Ito, Color universal design, 2008.
PHYSICAL = "#0072B2"  # blue: physical quantities
COMMANDED = "#E69F00"  # orange: commanded force, and the environment's own stiffness
ESTIMATED = "#009E73"  # green: estimates of the law
NOT_PASSIVE = "#D55E00"  # vermilion: not passive; faults
PHASE = "#56B4E9"  # sky blue: every other phase
NEUTRAL = "#7F7F7F"  # grey: surfaces, bounds, zero lines

AROUND_CONTACT = (-20.0, 150.0)  # ms about the first contact, range of the panel "contact"


@dataclass(frozen=True)
class View:
    """Data of a panel: the samples of a run since the force engaged, along one axis."""

    time: Floats  # s
    columns: TelemetryColumns
    shown: slice  # samples since the force engaged
    axis: int
    wall: Surface | None


def view_of(run: Run) -> View:
    """Return the samples of a run since the force engaged.

    Raises:
        ConfigError: If the launch file describes a surface that does not fit the run.
    """
    _, columns, config = run
    wall = surface(config)
    if wall is not None:
        penetration(columns, wall)  # raises for an axis that the run does not have
    start = int(np.searchsorted(columns.time, 0.0)) if (columns.engagement > 0.0).any() else 0
    shown = slice(start, None)
    return View(columns.time[shown], columns, shown, wall.axis if wall else 0, wall)


def _line(axes: Axes, x: Floats, y: Floats, label: str, **style: Any) -> None:
    if np.isfinite(y).any():  # hardware has no ground truth: neither line nor legend entry
        axes.plot(x, y, label=label, **style)


def _draw_position(axes: Axes, view: View) -> None:
    columns, shown, axis = view.columns, view.shown, view.axis
    if view.wall is not None:
        surface_line = view.wall.position * 1e3
        axes.axhline(surface_line, label="surface", color=NEUTRAL, linestyle="--", linewidth=1.0)
    true_position = columns.true_position[shown, axis] * 1e3
    _line(axes, view.time, true_position, "true", color=PHYSICAL, linewidth=2.2, alpha=0.45)
    position = columns.position[shown, axis] * 1e3
    _line(axes, view.time, position, "reading", color="black", linewidth=0.6)


def _draw_force(axes: Axes, view: View) -> None:
    columns, shown, axis = view.columns, view.shown, view.axis
    limit = columns.force_limit[shown]
    axes.fill_between(
        view.time, -limit, limit, label="limit force", color=NEUTRAL, alpha=0.25, linewidth=0.0
    )
    commanded = columns.commanded_force[shown, axis]
    _line(axes, view.time, commanded, "commanded", color=COMMANDED, linewidth=0.8)
    applied = columns.applied_force[shown, axis]
    _line(axes, view.time, applied, "applied", color=PHYSICAL, linewidth=1.1)


def _draw_energy(axes: Axes, view: View) -> None:
    axes.axhline(0.0, color=NEUTRAL, linewidth=0.8)
    estimated = view.columns.estimated_energy[view.shown] * 1e3
    _line(axes, view.time, estimated, "estimated", color=ESTIMATED, linewidth=1.0)
    true = view.columns.true_energy[view.shown] * 1e3
    _line(axes, view.time, true, "true", color=PHYSICAL, linewidth=1.4)


def _draw_delay(axes: Axes, view: View) -> None:
    delay = view.columns.loop_delay[view.shown] * 1e3
    _line(axes, view.time, delay, "state\nto force", color=PHYSICAL, linewidth=0.6)


def _draw_force_over_penetration(axes: Axes, view: View) -> None:
    if view.wall is None:
        return
    depth = penetration(view.columns, view.wall)[view.shown] * 1e3
    if view.wall.stiffness is not None:
        axes.axline(
            (0.0, 0.0),
            slope=view.wall.stiffness * 1e-3,
            label="wall",
            color=COMMANDED,
            linestyle="--",
            linewidth=1.0,
        )
    applied = view.columns.applied_force[view.shown, view.axis]
    _line(axes, depth, applied, "applied", color=PHYSICAL, linewidth=0.8)
    deepest = float(depth.max()) if depth.size else 0.0
    if deepest > 0.0:  # without the long way to the surface, on which no force acts
        axes.set_xlim(-0.2 * deepest, 1.05 * deepest)


def _draw_contact(axes: Axes, view: View) -> None:
    columns, shown, axis = view.columns, view.shown, view.axis
    if view.wall is None:
        return
    contact = penetration(columns, view.wall)[shown] > 0.0
    if not contact.any():
        return
    since = (view.time - view.time[int(np.argmax(contact))]) * 1e3
    seen = (since >= AROUND_CONTACT[0]) & (since <= AROUND_CONTACT[1])
    commanded = columns.commanded_force[shown, axis]
    _line(axes, since[seen], commanded[seen], "commanded", color=COMMANDED, linewidth=0.8)
    applied = columns.applied_force[shown, axis]
    _line(axes, since[seen], applied[seen], "applied", color=PHYSICAL, linewidth=1.1)
    axes.set_xlim(*AROUND_CONTACT)


@dataclass(frozen=True)
class Panel:
    """One row of a figure."""

    draw: Callable[[Axes, View], None]
    label: str
    x_label: str = "time since the force engaged (s)"


PANELS: dict[str, Panel] = {
    "position": Panel(_draw_position, "position (mm)"),
    "force": Panel(_draw_force, "force (N)"),
    "contact": Panel(_draw_contact, "force (N)", "time since first contact (ms)"),
    "energy": Panel(_draw_energy, "energy (mJ)"),
    "loop_delay": Panel(_draw_delay, "loop delay (ms)"),
    "force_over_penetration": Panel(_draw_force_over_penetration, "force (N)", "penetration (mm)"),
}
