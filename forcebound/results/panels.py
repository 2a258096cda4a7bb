"""Panels of a figure: position, force, energy, loop delay, force over penetration, path.

Of a run of several axes, positions are drawn by axis, under its name; forces as the size of the
whole vector, as their limit is; what is over penetration, along the normal of what was touched.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from forcebound.axes import Axis, AxisKind, common_kind, shown_on
from forcebound.files import printable
from forcebound.messages.packets import Event
from forcebound.messages.topology import Document
from forcebound.recordings.launched import launched
from forcebound.recordings.telemetry import TelemetryColumns
from forcebound.results.colours import AXIS_COLOURS, COMMANDED, ESTIMATED, NEUTRAL, PHYSICAL
from forcebound.results.energy import largest_fall
from forcebound.results.signals import Curve
from forcebound.results.surface import Floats, Touch, touch_of_run
from forcebound.units import MJ, MM, MS, N_MM, Everyday, N, S

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Run: TypeAlias = tuple[str, TelemetryColumns, Document]  # label, telemetry, launch file

TIME = "time since the force engaged"
LONGEST_NAME = 60  # characters
MOST_SLOPES = 3  # a wall may change its stiffness all the time
AROUND_CONTACT = (-20.0, 150.0)  # ms about the first contact, range of the panel "contact"
MOST_POINTS = 20_000  # of a curve over time; of more the extremes are drawn, in as many pieces
WIDE: dict[str, float] = {"linewidth": 2.6, "alpha": 0.5}  # of a curve that another may lie upon
DASHED: dict[str, str | float] = {"linestyle": "--", "linewidth": 1.0}
PIECES = 5_000  # 8 for each pixel of a PNG


def in_figure(text: str, longest: int = LONGEST_NAME) -> str:
    """Return a user's name for a figure, where a dollar sign would begin a formula."""
    return printable(text, longest).replace("$", r"\$")


@dataclass(frozen=True)
class View:
    """Data of a panel: the samples of a run since the force engaged."""

    time: Floats  # s
    columns: TelemetryColumns
    shown: slice  # samples since the force engaged
    touch: Touch | None  # what was touched, at each sample of the run
    signals: Sequence[Curve] = ()
    named_axes: Sequence[Axis] = ()

    @property
    def axes(self) -> int:
        """Number of axes of the run."""
        return int(self.columns.position.shape[1])

    @property
    def kind(self) -> AxisKind | None:
        """The kind of all axes; None if they differ."""
        return common_kind(self.named_axes)

    def name(self, axis: int, unit: Everyday) -> str:
        """Return the name of an axis; if axes differ, with what is its ``unit``."""
        each = self.named_axes[axis]
        name = in_figure(each.name)
        return name if self.kind else shown_on(each.kind, unit).label(name)

    def placed(self, positions: Floats) -> Floats:
        """Return shown positions, (n, axes), in the units for people."""
        factors = [shown_on(axis.kind, MM).factor for axis in self.named_axes]
        return np.asarray(positions * np.array(factors))

    @property
    def proxy(self) -> Floats:
        """The shown samples of the proxy, in m, shape ``(n, axes)``; NaN where it is unknown."""
        if self.touch is None or self.touch.proxy is None:
            return np.full_like(self.columns.position[self.shown], np.nan)
        return self.touch.proxy[self.shown]

    def size(self, force: Floats) -> Floats:
        """Return the shown samples of a force; of several axes its magnitude, as its limit is."""
        shown = force[self.shown]
        return shown[:, 0] if self.axes == 1 else np.linalg.norm(shown, axis=1)


def view_of(run: Run, events: Sequence[Event] = (), signals: Sequence[Curve] = ()) -> View:
    """Return the samples of a run since the force engaged; its events may move the surface.

    Raises:
        ConfigError: If the launch file describes a surface that does not fit the run.
    """
    _, columns, config = run
    start = int(np.searchsorted(columns.time, 0.0)) if (columns.engagement > 0.0).any() else 0
    shown = slice(start, None)
    touch = touch_of_run(columns, events, config)
    axes = launched(config).named_axes(columns.position.shape[1])
    return View(since_engaged(columns)[shown], columns, shown, touch, signals, axes)


def since_engaged(columns: TelemetryColumns) -> Floats:
    """Return when the samples were, in s since the force engaged, maybe before the recording."""
    time, elapsed = columns.time, columns.elapsed
    # A run begins with a tick before which all were missed, see operators.paths.began.
    if not time.size or columns.seq[0] == columns.deadline_misses[0] or elapsed[0] == 0.0:
        return time
    return time + float(elapsed[0] - time[0])


def _line(axes: Axes, x: Floats, y: Floats, label: str, **style: Any) -> None:
    if np.isfinite(y).any():  # hardware has no ground truth: neither line nor legend entry
        axes.plot(x, y, label=label, **style)


def _over_time(axes: Axes, view: View, y: Floats, label: str, **style: Any) -> None:
    """Draw a curve over time, see :func:`extremes`."""
    chosen = extremes(y)
    _line(axes, view.time[chosen], y[chosen], label, **style)


def extremes(values: Floats) -> NDArray[np.intp]:
    """Return the samples that are enough to draw a curve over time, oldest first.

    All; or the least and the largest of each of many pieces, which look the same: a pixel of an
    hour stands for thousands of samples. A piece without a number stays a gap.
    """
    if values.size <= MOST_POINTS:
        return np.arange(values.size)
    width = -(-values.size // PIECES)
    pieces = np.pad(values, (0, -values.size % width), constant_values=np.nan).reshape(-1, width)
    lowest = np.where(np.isnan(pieces), np.inf, pieces).argmin(axis=1)
    highest = np.where(np.isnan(pieces), -np.inf, pieces).argmax(axis=1)
    starts = width * np.arange(len(pieces))
    return np.unique(np.concatenate((starts + lowest, starts + highest)))


def _draw_position(axes: Axes, view: View) -> None:
    if view.touch is not None and view.touch.wall is not None:
        at = view.touch.wall.axis
        wall = view.touch.wall.position[view.shown] * view.placed(np.ones(view.axes))[at]
        label = "surface" if view.axes == 1 else f"surface, {view.name(at, MM)}"
        _over_time(axes, view, wall, label, drawstyle="steps-post", color=NEUTRAL, **DASHED)
    position, proxies = view.placed(view.columns.position[view.shown]), view.placed(view.proxy)
    if view.axes == 1:
        true = view.placed(view.columns.true_position[view.shown])[:, 0]
        _over_time(axes, view, true, "true", color=PHYSICAL, **WIDE)
        _over_time(axes, view, proxies[:, 0], "proxy", color=NEUTRAL, linewidth=1.4)
        _over_time(axes, view, position[:, 0], "reading", color="black", linewidth=0.6)
        return
    for axis in range(view.axes):
        colour, name = AXIS_COLOURS[axis % len(AXIS_COLOURS)], view.name(axis, MM)
        _over_time(axes, view, position[:, axis], name, color=colour, linewidth=0.9)
        _over_time(
            axes, view, proxies[:, axis], f"{name}, proxy", color=colour, linewidth=2.2, alpha=0.35
        )


def _draw_force(axes: Axes, view: View) -> None:
    if view.kind is None:  # lengths and angles have no common size, nor a common limit
        for axis in range(view.axes):
            applied, colour = view.columns.applied_force[view.shown, axis], AXIS_COLOURS[axis]
            _over_time(axes, view, applied, view.name(axis, N), color=colour, linewidth=0.9)
        return
    commanded, applied = (
        view.size(one) for one in (view.columns.commanded_force, view.columns.applied_force)
    )
    _over_time(axes, view, commanded, "commanded", color=COMMANDED, **WIDE)
    _over_time(axes, view, applied, "applied", color=PHYSICAL, linewidth=1.1)
    scale = axes.get_ylim()  # that of the forces: the limit may be far beyond
    limit = view.columns.force_limit[view.shown]
    chosen = extremes(limit)
    label = "limit force" if view.axes == 1 else "limit of the\nwhole vector"
    time, limit = view.time[chosen], limit[chosen]
    axes.fill_between(time, -limit, limit, label=label, color=NEUTRAL, alpha=0.25, linewidth=0.0)
    axes.set_ylim(scale)


def _draw_energy(axes: Axes, view: View) -> None:
    axes.axhline(0.0, color=NEUTRAL, linewidth=0.8)
    estimated, true = (
        one[view.shown] * 1e3 for one in (view.columns.estimated_energy, view.columns.true_energy)
    )
    _over_time(axes, view, estimated, "estimated", color=ESTIMATED, **WIDE)
    _over_time(axes, view, true, "true", color=PHYSICAL, linewidth=0.9)
    fall = largest_fall(view.time, true)
    if fall is not None:
        text = f"minimum {true.min() + 0.0:.2f} mJ, largest fall {fall.energy:.2f} mJ"
        axes.set_title(text, fontsize=7, color=NEUTRAL, loc="right", pad=5.0)  # pad: above faults


def _draw_delay(axes: Axes, view: View) -> None:
    delay = view.columns.loop_delay[view.shown] * 1e3
    age = view.columns.reply_age[view.shown] * 1e3
    if (age != delay)[np.isfinite(age)].any():  # of a controller that answers states by itself
        _over_time(axes, view, age, "age of\nthe reply", color=ESTIMATED, linewidth=0.9)
    _over_time(axes, view, delay, "state\nto force", color=PHYSICAL, linewidth=0.6)


def _draw_force_over_penetration(axes: Axes, view: View) -> None:
    if view.touch is None:
        return
    unit = shown_on(view.kind, MM)
    depth = view.touch.depth[view.shown] * unit.factor
    slopes = _slopes(view, depth)
    for slope in slopes:
        label = (
            "wall" if len(slopes) == 1 else f"wall, {slope:.3g} {shown_on(view.kind, N_MM).unit}"
        )
        wall = axes.axline((0.0, 0.0), slope=slope, label=label)
        wall.set(color=COMMANDED, **DASHED)
    applied = view.touch.along(view.columns.applied_force)[view.shown]
    _line(axes, depth, applied, "applied", color=PHYSICAL, linewidth=0.8)
    deepest = float(depth.max(initial=0.0))
    if deepest > 0.0:  # without the long way to the surface, on which no force acts
        axes.set_xlim(-0.2 * deepest, 1.05 * deepest)


def _slopes(view: View, depth: Floats) -> list[float]:
    """Return the stiffnesses of the wall in contact: all, or the least and the largest."""
    if view.touch is None or view.touch.stiffness is None:
        return []
    stiffness = view.touch.stiffness[view.shown] * shown_on(view.kind, N_MM).factor
    seen = np.unique(stiffness[depth > 0.0] if (depth > 0.0).any() else stiffness[:1])
    seen = seen[np.isfinite(seen)]
    return seen.tolist() if seen.size <= MOST_SLOPES else [float(seen[0]), float(seen[-1])]


def _draw_contact(axes: Axes, view: View) -> None:
    if view.touch is None or not (contact := view.touch.depth[view.shown] > 0.0).any():
        return
    since = (view.time - view.time[int(np.argmax(contact))]) * 1e3
    seen = (since >= AROUND_CONTACT[0]) & (since <= AROUND_CONTACT[1])
    commanded, applied = (
        view.touch.along(one)[view.shown][seen]
        for one in (view.columns.commanded_force, view.columns.applied_force)
    )
    _line(axes, since[seen], commanded, "commanded", color=COMMANDED, **WIDE)
    _line(axes, since[seen], applied, "applied", color=PHYSICAL, linewidth=1.1)
    axes.set_xlim(*AROUND_CONTACT)


def _draw_path(axes: Axes, view: View, up: int) -> None:
    """Draw the first axis to the right and another one up, in one scale."""
    if view.axes <= up or view.kind != "length":
        return
    position = view.columns.position[view.shown]
    tip, proxy = (one[:, (0, up)] * 1e3 for one in (position, view.proxy))
    _line(axes, proxy[:, 0], proxy[:, 1], "proxy", color=COMMANDED, linewidth=2.2, alpha=0.6)
    _line(axes, tip[:, 0], tip[:, 1], "tip", color=PHYSICAL, linewidth=0.8)
    axes.plot(*tip[:1].T, "o", label="start", color=NEUTRAL, markersize=4.0)
    axes.set_aspect("equal", adjustable="datalim")


def _draw_signals(axes: Axes, view: View, unit: str) -> None:
    time_ns = view.columns.time_ns[view.shown]
    for number, curve in enumerate(each for each in view.signals if each.about.unit == unit):
        time = (curve.time_ns - time_ns[:1]) * 1e-9 + view.time[:1]
        chosen = extremes(np.where(time >= 0.0, curve.values, np.nan))
        chosen = chosen[time[chosen] >= 0.0]
        label, colour = in_figure(curve.about.text), AXIS_COLOURS[number % len(AXIS_COLOURS)]
        _line(axes, time[chosen], curve.values[chosen], label, color=colour, linewidth=1.0)


@dataclass(frozen=True)
class Panel:
    """One row of a figure."""

    draw: Callable[[Axes, View], None]
    words: str
    unit: Everyday  # of lengths
    x_words: str = TIME
    x_unit: Everyday = S
    shows: str = ""  # what of a run of several axes

    def label(self, kind: AxisKind | None) -> str:
        """Return the label of its height, of axes of a kind."""
        return _label(self.words, self.unit, kind)

    def x_label(self, kind: AxisKind | None) -> str:
        """Return the label of its width."""
        return _label(self.x_words, self.x_unit, kind)


def _label(words: str, unit: Everyday, kind: AxisKind | None) -> str:
    if kind is None and unit in (MM, N):
        return words  # the units are with the names of the axes
    return shown_on(kind, unit).label("torque" if (kind, words) == ("angle", "force") else words)


_NORMAL = "along the normal"

PANELS: dict[str, Panel] = {
    "position": Panel(_draw_position, "position", MM),
    "force": Panel(_draw_force, "force", N, shows="magnitude over {view.axes} axes"),
    "contact": Panel(_draw_contact, "force", N, "time since first contact", MS, _NORMAL),
    "energy": Panel(_draw_energy, "energy", MJ),
    "loop_delay": Panel(_draw_delay, "loop delay", MS),
    "force_over_penetration": Panel(
        _draw_force_over_penetration, "force", N, "penetration", MM, _NORMAL
    ),
    "path_xy": Panel(partial(_draw_path, up=1), "y", MM, "x", MM),
    "path_xz": Panel(partial(_draw_path, up=2), "z", MM, "x", MM),
}


def signal_panels(signals: Iterable[Curve]) -> dict[str, Panel]:
    """Return a panel for each unit of the signals of some runs that have a number."""
    units = dict.fromkeys(one.about.unit for one in signals if not np.isnan(one.values).all())
    return {
        f"signals {unit}": Panel(
            partial(_draw_signals, unit=unit), "signals", Everyday(unit or "1", unit or "1")
        )
        for unit in units
    }
