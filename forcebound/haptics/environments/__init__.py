"""Virtual environments: the force that answers a position.

An environment is a frozen dataclass of its parameters, the *model*, whose ``open`` returns the
:class:`Environment` that the environment node asks. A model that keeps no state inherits
:class:`StatelessEnvironment` and has a method ``force``; any other inherits
:class:`EnvironmentModel` and has a method ``open``.

To add an environment: copy ``mass_spring.py`` to ``my_environment.py``, add one line to
``ENVIRONMENTS``; ``tests/test_environments.py`` tests it with all the others, and launch files know
it as ``environment: {kind: my_environment}`` with the fields of its dataclass as parameters. Or
name a custom file (docs/write-your-own-environment.md).

A force is positive when it resists motion in the positive direction, so a wall that the hand
pushes into answers a positive force.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from typing import Any

from forcebound.errors import ConfigError
from forcebound.haptics.parts import PartShape, Table, overridden
from forcebound.haptics.parts.signals import Publisher, Publishing
from forcebound.haptics.parts.user_module import describe_user_error
from forcebound.messages.packets import Contact, SceneObject, Vector


def check_hand(name: str, hands: tuple[str, ...], field: str) -> None:
    """Raise ConfigError, about a field, if there is no hand of this name."""
    if name not in hands:
        known = ", ".join(hands)
        raise ConfigError(f"there is no hand {name!r}; the graph has {known}", field=field)


FAR = 10.0  # m: a hand that is farther away is taken to be there


def within_reach(coordinate: float) -> float:
    """Return a coordinate of a hand, in m, at most ``FAR`` from the origin."""
    return coordinate if -FAR < coordinate < FAR else min(max(coordinate, -FAR), FAR)


class Environment(Publisher, ABC):
    """An open environment, which may keep state from one query to the next.

    The same queries, in the same order from ``open`` on, have the same answers; ``contact`` and
    ``scene`` change none of them. Only ``force`` has no default.
    """

    @abstractmethod
    def force(self, user: str, position: Vector, velocity: Vector, elapsed: float) -> Vector:
        """Return the force on a hand, in N, one entry per axis.

        Args:
            user: Name of the hand that asks; "hand", if the launch file has no ``hands``.
            position: Of the device, in m, shape ``(axes,)``.
            velocity: Of the device, in m/s, same shape.
            elapsed: Time since the force engaged, in s; 0 before.
        """

    def expect(self, users: Collection[str]) -> None:
        """Prepare for hands of these names: what takes long then stalls no hand when one joins.

        It is called right after ``open``. Other hands may come, too.
        """

    def take_readings(self, user: str, buttons: int | None, measured_force: Vector | None) -> None:
        """Take what else a hand's device reads, right before each :meth:`force` of this hand.

        Args:
            user: Name of the hand.
            buttons: Bit i is 1 while button i is down; None: the device has none.
            measured_force: Of the hand on the tip, by a force sensor, in N, one entry per axis;
                positive into the environment. None: it has no sensor.
        """

    def leave(self, user: str) -> None:
        """Let the contact of a hand give no force to others: its queries have ended.

        If they return, the hand takes part again. It is noticed at a query of another hand.
        """

    def contact(self, user: str) -> Contact | None:
        """Return the contact of a hand at its last query; None: free motion, or unknown."""
        return None

    def scene(self) -> tuple[SceneObject, ...] | None:
        """Return what there is to draw now; None: nothing, ever.

        It is called at most 30 times a second, or after each step of a task of gymnasium, and may
        be called before the first query.
        """
        return None

    def mujoco(self) -> tuple[Any, Any] | None:
        """Return the world as MuJoCo has it, its MjModel and MjData; None: it is none of MuJoCo."""
        return None

    def change(self, model: Any) -> bool:
        """Take over the parameters of another model of the same kind, and keep the state.

        Return whether it did; if not, the environment is closed, and ``model`` opened in its place.
        """
        return False

    def reset(self) -> bool:
        """Begin again as after ``open``, with the hands where they are, for another episode.

        Return whether it did; if not, the environment is closed, and opened again.
        """
        return False

    def close(self) -> None:
        """Release what ``open`` took; called once."""


class SharedClock:
    """The time of a world that hands share: that of the hand whose time goes fastest.

    Each hand counts from when its force engaged, so a hand that comes later, comes back or
    begins again joins the time of the world as it is.
    """

    def __init__(self) -> None:
        self._time = 0.0  # s
        self._users: dict[str, tuple[float, float]] = {}  # their time, and that of the world ahead

    def at(self, user: str, elapsed: float) -> float:
        """Return the time of the world at a query, in s: 0 at the first; it never goes back."""
        before, ahead = self._users.get(user, (math.inf, 0.0))
        if elapsed < before:
            ahead = self._time - elapsed
        self._users[user] = (elapsed, ahead)
        self._time = max(self._time, elapsed + ahead)
        return self._time

    def leave(self, user: str) -> None:
        """Let a hand join again at its next query."""
        self._users.pop(user, None)


class EnvironmentModel(Publishing, ABC):
    """Parameters of a kind of environment: a frozen dataclass."""

    @abstractmethod
    def open(self, axes: int) -> Environment:
        """Return a new instance in its initial state, for vectors of this many entries."""

    def check_hands(self, hands: tuple[str, ...]) -> None:
        """Check that it can serve hands of these names; ConfigError if not."""

    def check_axes(self, axes: int) -> None:
        """Check that it can be opened for so many axes; ConfigError if not."""

    def check_files(self) -> None:
        """Read the files that the parameters name; ConfigError if one cannot be used."""


class StatelessEnvironment(EnvironmentModel, Environment):
    """A model whose force depends on nothing but the query: model and instance are one."""

    def open(self, axes: int) -> Environment:
        """Return itself, with nothing published."""
        vars(self).pop("published", None)
        return self


def may_report_contacts(model: EnvironmentModel) -> bool:
    """Return whether an instance of a model may report contacts; only the instance knows."""
    return not isinstance(model, StatelessEnvironment) or "contact" in overridden(
        model, Environment
    )


@contextmanager
def _users_code(call: str) -> Iterator[None]:
    """Turn what code of a user raises into a ConfigError that names the call."""
    try:
        yield
    except ConfigError:
        raise
    except Exception as error:
        raise ConfigError(f"environment: {call}: {describe_user_error(error)}") from error


def open_environment(
    model: EnvironmentModel, axes: int, users: Collection[str] = ()
) -> Environment:
    """Return an instance of a model for hands of these names.

    ConfigError if it cannot be used, or its code fails.
    """
    with _users_code(f"open({axes})"):
        opened = model.open(axes)
        opened.published.declare(model.declared())
        if users:
            opened.expect(users)
        return opened


def change_environment(
    opened: Environment, model: EnvironmentModel, axes: int, users: Collection[str] = ()
) -> Environment:
    """Return an instance with the parameters of ``model``, of the kind of ``opened``.

    If it raises ConfigError, as :func:`open_environment`, ``opened`` is as it was.
    """
    with _users_code("change"):
        if opened.change(model):
            return opened
    new = open_environment(model, axes, users)
    opened.close()
    return new


ENVIRONMENTS: Table[type[EnvironmentModel]] = Table(
    "environments",
    {
        "wall": "forcebound.haptics.environments.walls:Wall",
        "damped_wall": "forcebound.haptics.environments.walls:DampedWall",
        "time_varying_wall": "forcebound.haptics.environments.walls:TimeVaryingWall",
        "power_law_wall": "forcebound.haptics.environments.walls:PowerLawWall",
        "damper": "forcebound.haptics.environments.walls:Damper",
        "solid": "forcebound.haptics.environments.solid:Solid",
        "distance_field": "forcebound.haptics.environments.solids_of_files:DistanceField",
        "point_cloud": "forcebound.haptics.environments.solids_of_files:PointCloud",
        "mass_spring": "forcebound.haptics.environments.mass_spring:MassSpring",
        "cart_pendulum": "forcebound.haptics.environments.cart_pendulum:CartPendulum",
        "coupling": "forcebound.haptics.environments.coupling:Coupling",
        "bodies": "forcebound.haptics.environments.bodies:Bodies",
        "recorded": "forcebound.haptics.environments.recorded:RecordedEnvironment",
        "membrane": "forcebound.haptics.environments.membrane:Membrane",
        "mesh": "forcebound.haptics.environments.solids_of_files:TriangleMesh",
        "active_wall": "forcebound.haptics.environments.walls:ActiveWall",
    },
    PartShape("forcebound.haptics.environments:EnvironmentModel"),
)
