r"""What a run touched: how deep the tip lay behind the surface, and along which normal.

An environment that knows where it is touched says so with each answer: the proxy :math:`p`, where
the tip would be if it could enter nothing, and the outward unit normal :math:`n` there. With the
position x that was asked about, depth and force along the normal are

.. math:: d = (p - x) \cdot n , \qquad F_n = -F \cdot n ,

whatever the surface has done meanwhile: it may be curved, be moved, or change. Of an environment
that does not say it, the launch file may describe a flat wall across an axis. Behind the controller
``scaled`` both are taken to where the hand feels them.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from forcebound.analysis.surface import (
    Floats,
    Mask,
    Scale,
    penetration,
    scale_of,
    stiffness_of_run,
    surface_of_run,
)
from forcebound.messages.packets import Event
from forcebound.telemetry import TelemetryColumns


@dataclass(frozen=True)
class Touch:
    """The surface that a run touched, at each of its samples."""

    depth: Floats  # m, (n,), of the reading along the normal; outside: < 0, or 0 if unknown
    true_depth: Floats  # m, (n,), the same of the true position; NaN where that is unknown
    normal: Floats  # (n, axes), outward
    stiffness: float | Floats | None  # N/m; None where force is not this times depth
    proxy: Floats | None  # m, (n, axes), NaN in free motion; None: a flat wall, of the launch file

    @property
    def constant_stiffness(self) -> float | None:
        """The stiffness, in N/m, if it is the same at each sample."""
        known = np.unique([] if self.stiffness is None else self.stiffness)
        return float(known[0]) if known.size == 1 and np.isfinite(known[0]) else None

    def along(self, force: Floats) -> Floats:
        """Return the part of a force, (n, axes), against the normal, in N: how much it pushes."""
        return -_dot(force, self.normal)

    def across(self, force: Floats) -> Floats:
        """Return the size of the part of a force, (n, axes), across the normal, in N."""
        along = _dot(force, self.normal)[:, np.newaxis] * self.normal
        return np.asarray(np.linalg.norm(force - along, axis=1))


def touch_of_run(
    columns: TelemetryColumns, events: Sequence[Event], config: Mapping[str, Any]
) -> Touch | None:
    """Return what a run touched where the hand is; None if nobody says it.

    Args:
        columns: Telemetry of the run, with the contacts that its environment said.
        events: Of the run: what begins a phase, and what has changed a parameter.
        config: The launch file as resolved for the run; reads ``controller``, ``environment`` and
            ``phases``.

    Raises:
        ConfigError: If the launch file describes a surface that does not fit the run.
    """
    scale = scale_of(config)
    if scale is None:
        return None
    if np.isfinite(columns.proxy).all(axis=1).any():
        stiffness = scale.stiffness(stiffness_of_run(columns, events, config))
        return _touch_of_contacts(columns, scale, stiffness)
    wall = surface_of_run(columns, events, config)
    if wall is None:
        return None
    depth = penetration(columns, wall)
    normal = np.zeros(columns.position.shape)
    normal[:, wall.axis] = -1.0
    true_depth = columns.true_position[:, wall.axis] - wall.position
    return Touch(depth, true_depth, normal, wall.stiffness, None)


def _touch_of_contacts(columns: TelemetryColumns, scale: Scale, stiffness: Floats | None) -> Touch:
    """What the environment said of each tick, or of the newest one before it that it answered.

    In free motion the surface is the plane that was touched last, or will be touched first: a hand
    that leaves it has a negative depth there, so that a bounce can be seen.
    """
    proxy = scale.place(columns.proxy[_last(columns.is_told, 0)])
    touching: Mask = np.asarray(np.isfinite(proxy).all(axis=1))
    plane = _last(touching, int(np.argmax(touching)))
    normal = columns.normal[_last(columns.is_told, 0)][plane]
    length = np.linalg.norm(normal, axis=1, keepdims=True)  # shorter than 1 in fewer than 3 axes
    normal = normal / np.where(length > 0.0, length, 1.0)
    deepest = np.where(touching, np.inf, 0.0)  # who touches nothing is not behind a surface
    return Touch(
        np.minimum(_dot(proxy[plane] - columns.position, normal), deepest),
        np.minimum(_dot(proxy[plane] - columns.true_position, normal), deepest),
        normal,
        stiffness,
        proxy,
    )


def _last(mask: Mask, before: int) -> NDArray[np.intp]:
    """Return for each sample the last one up to it that is in the mask; ``before`` if none is."""
    last = np.maximum.accumulate(np.where(mask, np.arange(mask.size), -1))
    return np.where(last < 0, before, last)


def _dot(one: Floats, other: Floats) -> Floats:
    return np.asarray(np.einsum("ij,ij->i", one, other))
