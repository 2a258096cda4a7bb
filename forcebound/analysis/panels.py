"""Panels of a figure: position, force, energy, loop delay, force over penetration."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from forcebound.analysis.colours import COMMANDED, ESTIMATED, NEUTRAL, PHYSICAL
from forcebound.analysis.energy import largest_fall
from forcebound.analysis.surface import Floats, Surface, penetration, surface_of_run
from forcebound.files import printable
from forcebound.messages.packets import Event
from forcebound.telemetry import TelemetryColumns

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Run: TypeAlias = tuple[str, TelemetryColumns, Mapping[str, Any]]  # label, telemetry, launch file

LONGEST_NAME = 60  # characters
MOST_SLOPES = 3  # a wall may change its stiffness all the time
AROUND_CONTACT = (-20.0, 150.0)  # ms about the first contact, range of the panel "contact"
LARGEST = 1e100  # in a panel's unit; matplotlib cannot scale to what is near the largest float


def in_figure(text: str, longest: int = LONGEST_NAME) -> str:
    """Return a name from outside for a figure, where a dollar sign would begin a formula."""
    return printable(text, longest).replace("$", r"\$")


@dataclass(frozen=True)
class View:
    """Data of a panel: the samples of a run since the force engaged."""

    time: Floats  # s
    columns: TelemetryColumns
    shown: slice  # samples since the force engaged
    axis: int  # that of the surface, which the panels of a position show
    wall: Surface | None  # as it was at each sample of the run

    @property
    def axes(self) -> int:
        """Number of axes of the run."""
        return int(self.columns.position.shape[1])

    @property
    def last_axis(self) -> int:
        """Number of the last axis."""
        return self.axes - 1

    def along(self, force: Floats) -> Floats:
        """Return the shown samples of a force; of several axes its magnitude, as its limit is."""
        shown = force[self.shown]
        return shown[:, 0] if self.axes == 1 else np.linalg.norm(shown, axis=1)


def view_of(run: Run, events: Sequence[Event] = ()) -> View:
    """Return the samples of a run since the force engaged.

    Args:
        run: The run.
        events: Of the run; they say when the surface was moved.

    Raises:
        ConfigError: If the launch file describes a surface that does not fit the run.
    """
    _, columns, config = run
    wall = surface_of_run(columns, events, config)
    if wall is not None:
        penetration(columns, wall)  # raises for an axis that the run does not have
    start = int(np.searchsorted(columns.time, 0.0)) if (columns.engagement > 0.0).any() else 0
    shown = slice(start, None)
    return View(columns.time[shown], columns, shown, wall.axis if wall else 0, wall)


def _line(axes: Axes, x: Floats, y: Floats, label: str, **style: Any) -> None:
    drawn = (np.abs(x) <= LARGEST) & (np.abs(y) <= LARGEST)
    if drawn.any():  # hardware has no ground truth: neither line nor legend entry
        axes.plot(x, np.where(drawn, y, np.nan), label=label, **style)


def _draw_position(axes: Axes, view: View) -> None:
    columns, shown, axis = view.columns, view.shown, view.axis
    if view.wall is not None:
        wall = np.asarray(view.wall.position)[shown] * 1e3
        style: dict[str, Any] = {"color": NEUTRAL, "linestyle": "--", "linewidth": 1.0}
        if np.unique(wall).size == 1 and abs(wall[0]) <= LARGEST:
            axes.axhline(float(wall[0]), label="surface", **style)
        else:
            _line(axes, view.time, wall, "surface", drawstyle="steps-post", **style)
    true_position = columns.true_position[shown, axis] * 1e3
    _line(axes, view.time, true_position, "true", color=PHYSICAL, linewidth=2.2, alpha=0.45)
    position = columns.position[shown, axis] * 1e3
    _line(axes, view.time, position, "reading", color="black", linewidth=0.6)


def _draw_force(axes: Axes, view: View) -> None:
    columns = view.columns
    limit = np.clip(columns.force_limit[view.shown], 0.0, LARGEST)
    axes.fill_between(
        view.time, -limit, limit, label="limit force", color=NEUTRAL, alpha=0.25, linewidth=0.0
    )
    commanded = view.along(columns.commanded_force)
    _line(axes, view.time, commanded, "commanded", color=COMMANDED, linewidth=0.8)
    applied = view.along(columns.applied_force)
    _line(axes, view.time, applied, "applied", color=PHYSICAL, linewidth=1.1)


def _draw_energy(axes: Axes, view: View) -> None:
    axes.axhline(0.0, color=NEUTRAL, linewidth=0.8)
    estimated = view.columns.estimated_energy[view.shown] * 1e3
    _line(axes, view.time, estimated, "estimated", color=ESTIMATED, linewidth=1.0)
    true = view.columns.true_energy[view.shown] * 1e3
    _line(axes, view.time, true, "true", color=PHYSICAL, linewidth=1.4)
    fall = largest_fall(view.time, true)
    if fall is not None:
        text = f"minimum {true.min() + 0.0:.2f} mJ, largest fall {fall.energy:.2f} mJ"
        # pad: above the triangle of a fault
        axes.set_title(text, fontsize=7, color=NEUTRAL, loc="right", pad=5.0)


def _draw_delay(axes: Axes, view: View) -> None:
    delay = view.columns.loop_delay[view.shown] * 1e3
    _line(axes, view.time, delay, "state\nto force", color=PHYSICAL, linewidth=0.6)


def _draw_force_over_penetration(axes: Axes, view: View) -> None:
    if view.wall is None:
        return
    depth = penetration(view.columns, view.wall)[view.shown] * 1e3
    slopes = _slopes(view, depth)
    for slope in slopes:
        axes.axline(
            (0.0, 0.0),
            slope=slope,
            label="wall" if len(slopes) == 1 else f"wall, {slope:.3g} N/mm",
            color=COMMANDED,
            linestyle="--",
            linewidth=1.0,
        )
    applied = view.columns.applied_force[view.shown, view.axis]
    _line(axes, depth, applied, "applied", color=PHYSICAL, linewidth=0.8)
    deepest = float(depth.max(initial=0.0, where=depth <= LARGEST))
    if deepest > 0.0:  # without the long way to the surface, on which no force acts
        axes.set_xlim(-0.2 * deepest, 1.05 * deepest)


def _slopes(view: View, depth: Floats) -> list[float]:
    """Return the stiffnesses of the wall in contact, in N/mm: all, or the least and the largest."""
    if view.wall is None or view.wall.stiffness is None:
        return []
    stiffness = np.asarray(view.wall.stiffness)[view.shown]
    seen = np.unique(stiffness[depth > 0.0] if (depth > 0.0).any() else stiffness[:1])
    seen = seen[np.abs(seen) <= LARGEST] * 1e-3
    return seen.tolist() if seen.size <= MOST_SLOPES else [float(seen[0]), float(seen[-1])]


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
    shows: str = ""  # what of a run of several axes


_AXIS = "axis {view.axis} (axes 0 to {view.last_axis})"

PANELS: dict[str, Panel] = {
    "position": Panel(_draw_position, "position (mm)", shows=_AXIS),
    "force": Panel(_draw_force, "force (N)", shows="magnitude over {view.axes} axes"),
    "contact": Panel(_draw_contact, "force (N)", "time since first contact (ms)", shows=_AXIS),
    "energy": Panel(_draw_energy, "energy (mJ)"),
    "loop_delay": Panel(_draw_delay, "loop delay (ms)"),
    "force_over_penetration": Panel(
        _draw_force_over_penetration, "force (N)", "penetration (mm)", shows=_AXIS
    ),
}
