"""Flat surface that a launch file describes, and how deep the readings lie behind it."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from forcebound.errors import ConfigError
from forcebound.messages.packets import Event
from forcebound.nodes.events import PARAMETERS_SET, PHASE_BEGINS
from forcebound.telemetry import TelemetryColumns

Floats: TypeAlias = NDArray[np.float64]
Mask: TypeAlias = NDArray[np.bool_]


class Scale(NamedTuple):
    """Where a hand feels the environment, and how: behind the controller `scaled`, elsewhere."""

    motion: float = 1.0  # way in the environment over way of the hand
    force: float = 1.0  # on the hand over that of the environment
    origin: float = 0.0  # m, in the environment on each axis, where the hand is at 0 m

    def place(self, place: Floats) -> Floats:
        """Return where a hand feels a place of the environment, in m."""
        return (place - self.origin) / self.motion

    def stiffness(self, stiffness: Floats | None) -> Floats | None:
        """Return how stiff a stiffness of the environment feels, in N/m."""
        return None if stiffness is None else self.motion * self.force * stiffness


@dataclass(frozen=True)
class Surface:
    """Flat surface of the environment of a run, or of each of its samples.

    ``param set`` and phases move it and change it while the run goes on: then position and
    stiffness have shape ``(n,)``; see :func:`surface_of_run`.
    """

    position: float | Floats  # m
    axis: int
    stiffness: float | Floats | None  # N/m; None where force is not this times depth


def scale_of(config: Mapping[str, Any]) -> Scale | None:
    """Return the scale of a run; None if it moves: with a clutch, or rate control at a border.

    Args:
        config: The launch file as resolved for the run; reads ``controller``.

    Raises:
        ConfigError: If it is not in plain SI numbers.
    """
    controller = config.get("controller") or {}
    if controller.get("kind") != "scaled":
        return Scale()
    if controller.get("clutch_button") is not None or controller.get("border"):
        return None
    motion, force = controller.get("motion_scale", 1.0), controller.get("force_scale", "auto")
    scale = Scale(motion, motion if force == "auto" else force, controller.get("origin", 0.0))
    if not all(isinstance(number, int | float) for number in scale) or motion == 0.0:
        raise ConfigError(f"the controller's scales must be numbers, and not 0, got {scale}")
    return scale


def surface(config: Mapping[str, Any]) -> Surface | None:
    """Return the flat surface that the launch file describes; None for another environment.

    In a user's own environment (``kind: my_file.py``) a parameter of these names may mean
    something else, such as a centre: a value that is not a number is ignored there. A position with
    one number for each axis is no flat surface across an axis.

    Args:
        config: The launch file as resolved for the run; reads ``environment``.

    Raises:
        ConfigError: If position, stiffness or axis are not plain SI numbers.
    """
    environment = config.get("environment") or {}
    if ".py" in str(environment.get("kind")):
        environment = {k: v for k, v in environment.items() if isinstance(v, int | float)}
    if isinstance(environment.get("position"), list | tuple):
        return None
    position = _number(environment, "position", "m")
    if position is None:
        return None
    axis = _number(environment, "axis", "a whole number") or 0
    return Surface(position, int(axis), _number(environment, "stiffness", "N/m"))


def surface_of_run(
    columns: TelemetryColumns, events: Sequence[Event], config: Mapping[str, Any]
) -> Surface | None:
    """Return the surface as the hand felt it at each sample; None if there is none, or no scale.

    Args:
        columns: Telemetry of the run.
        events: Of the run: what begins a phase, and what has changed a parameter.
        config: The launch file as resolved for the run; reads ``controller``, ``environment`` and
            ``phases``.

    Raises:
        ConfigError: As :func:`surface`.
    """
    wall, scale = surface(config), scale_of(config)
    if wall is None or scale is None:
        return None
    position = np.full(columns.time.shape, wall.position, dtype=np.float64)
    for since, environment in _environments(columns, events, config):
        now = surface({"environment": environment})
        if now is not None:
            position[since] = now.position
    stiffness = scale.stiffness(stiffness_of_run(columns, events, config))
    return Surface(scale.place(position), wall.axis, stiffness)


def stiffness_of_run(
    columns: TelemetryColumns, events: Sequence[Event], config: Mapping[str, Any]
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
    columns: TelemetryColumns, events: Sequence[Event], config: Mapping[str, Any]
) -> Iterator[tuple[slice, dict[str, Any]]]:
    """Yield each state of the environment's parameters, and the samples since it began.

    A phase begins with the parameters of the launch file and sets its own; an event has the new
    values as text. A recording that begins later has the values of then, and no phases: events
    alone say what they change.
    """
    launched = dict(config.get("environment") or {})
    phases: Iterator[Mapping[str, Any]] = iter(config.get("phases") or ())
    now = launched
    yield slice(None), now
    for event in events:
        if event.event == PHASE_BEGINS and config.get("phases"):
            now = launched | _of_environment(next(phases, {}).get("set") or {})
        elif event.event == PARAMETERS_SET:
            now = now | _of_environment({n: _value(text) for n, text in event.data.items()})
        else:
            continue
        yield slice(int(np.searchsorted(columns.time_ns, event.time_ns)), None), now


def _of_environment(settings: Mapping[str, Any]) -> dict[str, Any]:
    prefix = "environment."
    return {n.removeprefix(prefix): v for n, v in settings.items() if n.startswith(prefix)}


def _value(text: str) -> float | str:
    try:
        return float(text)
    except ValueError:
        return text


def _number(environment: Mapping[str, Any], key: str, unit: str) -> float | None:
    value = environment.get(key)
    if value is not None and not isinstance(value, int | float):
        raise ConfigError(f"environment.{key} must be a number ({unit}), got {value!r}")
    return value


def penetration(columns: TelemetryColumns, wall: Surface) -> Floats:
    """Return the depth of the reading behind the surface, in m, shape ``(n,)``; outside: < 0.

    Raises:
        ConfigError: If the run has no such axis.
    """
    axes = columns.position.shape[1]
    if not 0 <= wall.axis < axes:
        raise ConfigError(f"environment.axis is {wall.axis}, but the run has {axes} axes, from 0")
    return columns.position[:, wall.axis] - wall.position
