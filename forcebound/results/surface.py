r"""What a run touched: how deep the tip lay behind the surface, and along which normal.

An environment that knows where it is touched says so with each answer: the proxy :math:`p`, where
the tip would be if it could enter nothing, and the outward unit normal :math:`n` there. With the
position x that was asked about, depth and force along the normal are

.. math:: d = (p - x) \cdot n , \qquad F_n = -F \cdot n ,

also of a surface that is curved, is moved, or changes. For an environment that does not say it, the
launch file may describe a flat wall across an axis. Behind the controller ``scaled`` both are taken
to where the hand feels them.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from forcebound.errors import ConfigError
from forcebound.messages.events import PARAMETERS_SET, PHASE_BEGINS
from forcebound.messages.packets import Event
from forcebound.messages.topology import Document
from forcebound.recordings.telemetry import TelemetryColumns

Floats: TypeAlias = NDArray[np.float64]
Mask: TypeAlias = NDArray[np.bool_]


class Scale(NamedTuple):
    """Where a hand feels the environment, and how: behind the controller `scaled`, elsewhere."""

    motion: float = 1.0  # path in the environment over path of the hand
    force: float = 1.0  # on the hand over that of the environment
    origin: float = 0.0  # m, in the environment on each axis, where the hand is at 0 m

    def place(self, place: Floats) -> Floats:
        """Return where a hand feels a place of the environment, in m."""
        return (place - self.origin) / self.motion


class Wall(NamedTuple):
    """Flat surface across an axis, which the launch file describes, at each sample."""

    axis: int
    position: Floats  # m, (n,)


@dataclass(frozen=True)
class Touch:
    """The surface that a run touched, at each of its samples."""

    depth: Floats  # m, (n,), of the reading along the normal; outside: < 0, or 0 if unknown
    true_depth: Floats  # m, (n,), the same of the true position; NaN where that is unknown
    normal: Floats  # (n, axes), outward
    stiffness: Floats | None  # N/m, (n,); None where force is not this times depth
    proxy: Floats | None = None  # m, (n, axes), NaN in free motion; None: a wall
    wall: Wall | None = None  # None: the environment reports the proxy

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
    columns: TelemetryColumns, events: Sequence[Event], config: Document
) -> Touch | None:
    """Return what a run touched where the hand is; None if that is not known.

    Args:
        columns: Telemetry of the run, with the contacts that its environment reported.
        events: Of the run: what begins a phase, and what has changed a parameter.
        config: The launch file as resolved for the run; reads ``controller``, ``environment`` and
            ``phases``.

    Raises:
        ConfigError: If the launch file describes a surface that does not fit the run.
    """
    scale = scale_of(config)
    if scale is None:
        return None
    is_said = bool(np.isfinite(columns.proxy).all(axis=1).any())
    wall = None if is_said else _wall_of_run(columns, events, config, scale)
    if not is_said and wall is None:
        return None
    stiffness = stiffness_of_run(columns, events, config)
    if stiffness is not None:
        stiffness = scale.motion * scale.force * stiffness
    if wall is None:
        return _touch_of_contacts(columns, scale, stiffness)
    normal = np.zeros(columns.position.shape)
    normal[:, wall.axis] = -1.0
    depth, true_depth = (
        one[:, wall.axis] - wall.position for one in (columns.position, columns.true_position)
    )
    return Touch(depth, true_depth, normal, stiffness, wall=wall)


def _touch_of_contacts(columns: TelemetryColumns, scale: Scale, stiffness: Floats | None) -> Touch:
    """What the environment reported for each tick, or of the newest one before it that it answered.

    In free motion the surface is the plane that was touched last, or will be touched first: a hand
    that leaves it has a negative depth there, so that a bounce can be seen.
    """
    proxy = scale.place(columns.proxy[_last(columns.is_answered, 0)])
    touching: Mask = np.asarray(np.isfinite(proxy).all(axis=1))
    plane = _last(touching, int(np.argmax(touching)))
    normal = columns.normal[_last(columns.is_answered, 0)][plane]
    length = np.linalg.norm(normal, axis=1, keepdims=True)  # shorter than 1 in fewer than 3 axes
    normal = normal / np.where(length > 0.0, length, 1.0)
    deepest = np.where(touching, np.inf, 0.0)  # a tip that touches nothing is not behind a surface
    depth, true_depth = (
        np.minimum(_dot(proxy[plane] - one, normal), deepest)
        for one in (columns.position, columns.true_position)
    )
    return Touch(depth, true_depth, normal, stiffness, proxy)


def _last(mask: Mask, before: int) -> NDArray[np.intp]:
    """Return for each sample the last one up to it that is in the mask; ``before`` if none is."""
    last = np.maximum.accumulate(np.where(mask, np.arange(mask.size), -1))
    return np.where(last < 0, before, last)


def _dot(one: Floats, other: Floats) -> Floats:
    return np.asarray(np.einsum("ij,ij->i", one, other))


def scale_of(config: Document) -> Scale | None:
    """Return the scale of a run; None if it moves: with a clutch, or rate control at a border.

    Raises:
        ConfigError: If it is not in plain SI numbers.
    """
    controller = config.get("controller", {})
    if controller.get("kind") != "scaled":
        return Scale()
    if controller.get("clutch_button") is not None or controller.get("border"):
        return None
    motion, force = controller.get("motion_scale", 1.0), controller.get("force_scale", "auto")
    scale = Scale(motion, motion if force == "auto" else force, controller.get("origin", 0.0))
    if not all(isinstance(number, int | float) for number in scale) or motion == 0.0:
        raise ConfigError(f"the controller's scales must be numbers, and not 0, got {scale}")
    return scale


def _wall_of_run(
    columns: TelemetryColumns, events: Sequence[Event], config: Document, scale: Scale
) -> Wall | None:
    """Return the flat wall of a run where the hand feels it; None if there is none."""
    first = _position(config.get("environment", {}))
    if first is None:
        return None
    axis = int(_number(config["environment"], "axis", "a whole number") or 0)
    axes = columns.position.shape[1]
    if not 0 <= axis < axes:
        raise ConfigError(f"environment.axis is {axis}, but the run has {axes} axes, from 0")
    position = np.full(columns.time.shape, first, dtype=np.float64)
    for since, environment in _environments(columns, events, config):
        now = _position(environment)
        if now is not None:
            position[since] = now
    return Wall(axis, scale.place(position))


def _position(environment: Document) -> float | None:
    """Return where the launch file says the wall is, in m; None: it describes none.

    A position with a number for each axis is no flat wall across an axis. In a user's own file a
    parameter of that name may mean something else, such as a centre.
    """
    position = environment.get("position")
    if isinstance(position, list | tuple):
        return None
    if ".py" in str(environment.get("kind")) and not isinstance(position, int | float):
        return None
    return _number(environment, "position", "m")


def stiffness_of_run(
    columns: TelemetryColumns, events: Sequence[Event], config: Document
) -> Floats | None:
    """Return the stiffness of the environment at each sample, in N/m, NaN where it has none.

    Returns:
        Shape ``(n,)``; None if it never has one number that is force over depth.
    """
    stiffness = np.full(columns.time.shape, math.nan)
    for since, environment in _environments(columns, events, config):
        value = environment.get("stiffness")
        is_linear = isinstance(value, int | float) and "exponent" not in environment
        rate = _number(environment, "stiffness_rate", "N/m/s") or 0.0
        stiffness[since] = value if is_linear else math.nan
        stiffness[since] += rate * columns.elapsed[since]
    return stiffness if np.isfinite(stiffness).any() else None


def _environments(
    columns: TelemetryColumns, events: Sequence[Event], config: Document
) -> Iterator[tuple[slice, Document]]:
    """Yield each state of the environment's parameters, and the samples since it began.

    A phase begins with the parameters of the launch file and sets its own; an event has the new
    values as text. A recording that begins later has the values of then, and no phases: events
    alone say what they change.
    """
    now = launched = config.get("environment", {})
    phases: Iterator[Document] = iter(config.get("phases", ()))
    yield slice(None), now
    for event in events:
        if event.event == PHASE_BEGINS and config.get("phases"):
            now = launched | _of_environment(next(phases, {}).get("set") or {})
        elif event.event == PARAMETERS_SET:
            now = now | _of_environment({n: _value(text) for n, text in event.data.items()})
        else:
            continue
        yield slice(int(np.searchsorted(columns.time_ns, event.time_ns)), None), now


def _of_environment(settings: Document) -> Document:
    prefix = "environment."
    return {n.removeprefix(prefix): v for n, v in settings.items() if n.startswith(prefix)}


def _value(text: str) -> float | str:
    try:
        return float(text)
    except ValueError:
        return text


def _number(environment: Document, key: str, unit: str) -> float | None:
    value = environment.get(key)
    if value is not None and not isinstance(value, int | float):
        raise ConfigError(f"environment.{key} must be a number ({unit}), got {value!r}")
    return value
