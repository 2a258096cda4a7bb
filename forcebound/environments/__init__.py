"""Virtual environments: the force that answers a position.

An environment is a frozen dataclass of its parameters, the *model*. One that keeps no state has a
method ``force``. One that does has ``open(axes)``, which returns an :class:`Environment`.
:func:`open_environment` opens either.

To add an environment: copy ``wall.py`` to ``my_environment.py``, add one line to ``ENVIRONMENTS``;
``tests/test_environments.py`` tests it with all the others, and launch files know it as
``environment: {kind: my_environment}`` with the fields of its dataclass as parameters. Or name a
file of one's own (docs/write-your-own-environment.md).

A force is positive when it resists motion in the positive direction, so a wall that the hand
pushes into answers a positive force.
"""

from typing import Protocol, TypeAlias, runtime_checkable

from forcebound.errors import ConfigError
from forcebound.messages.packets import Contact, SceneObject, Vector
from forcebound.parts import Form, Table
from forcebound.parts.user_module import describe_user_error


class StatelessEnvironment(Protocol):
    """A model whose force depends on nothing but the question: it is its own instance."""

    def force(self, position: Vector, velocity: Vector, elapsed: float) -> Vector:
        """Return the force; see :meth:`Environment.force`."""
        ...


class Environment(StatelessEnvironment, Protocol):
    """An open environment, which may keep state from one question to the next.

    The same questions, in the same order from ``open`` on, have the same answers. It may have a
    method ``change(model)`` too, which takes over other parameters while a graph runs and keeps
    the state; without it, an environment whose parameters change is opened anew.
    """

    def force(self, position: Vector, velocity: Vector, elapsed: float) -> Vector:
        """Return the force, in N, one entry per axis.

        Args:
            position: Of the device, in m, shape ``(axes,)``.
            velocity: Of the device, in m/s, same shape.
            elapsed: Time since the force engaged, in s; 0 before.
        """
        ...

    def close(self) -> None:
        """Release what ``open`` took; called once."""
        ...


class EnvironmentExtras(Protocol):
    """Optional methods of an open :class:`Environment`; one that is absent is not asked.

    Both are asked between two calls of ``force`` and change none of its answers.
    """

    def contact(self) -> Contact | None:
        """Return what the last question touched; None: free motion."""
        ...

    def scene(self) -> tuple[SceneObject, ...]:
        """Return what there is to draw now; asked at most 30 times a second.

        It may be asked before the first question.
        """
        ...


@runtime_checkable
class StatefulEnvironment(Protocol):
    """A model whose instances keep state."""

    def open(self, axes: int) -> Environment:
        """Return a new instance in its initial state, for vectors of this many entries."""
        ...


EnvironmentModel: TypeAlias = StatelessEnvironment | StatefulEnvironment


def may_tell_contacts(model: EnvironmentModel) -> bool:
    """Return whether an instance of a model may have a method ``contact``; only it knows."""
    return isinstance(model, StatefulEnvironment) or hasattr(model, "contact")


class _Stateless:
    """A model without state as an open environment."""

    def __init__(self, model: StatelessEnvironment) -> None:
        self.change(model)

    def change(self, model: StatelessEnvironment) -> None:
        self.force = model.force
        self.contact = getattr(model, "contact", None)
        self.scene = getattr(model, "scene", None)

    def close(self) -> None:
        pass


def open_environment(model: EnvironmentModel, axes: int) -> Environment:
    """Return an instance of a model.

    Args:
        model: With or without state.
        axes: Number of axes of the device.

    Raises:
        ConfigError: If the model cannot be used, or its own code fails.
    """
    if not isinstance(model, StatefulEnvironment):
        return _Stateless(model)
    try:
        return model.open(axes)
    except ConfigError:
        raise
    except Exception as error:
        raise ConfigError(f"environment: open({axes}): {describe_user_error(error)}") from error


def change_environment(opened: Environment, model: EnvironmentModel, axes: int) -> Environment:
    """Return an instance with the parameters of ``model``, of the same kind as ``opened``.

    Raises:
        ConfigError: As :func:`open_environment`; ``opened`` is then as it was.
    """
    change = getattr(opened, "change", None)
    if change is None:
        new = open_environment(model, axes)
        opened.close()
        return new
    try:
        change(model)
    except ConfigError:
        raise
    except Exception as error:
        raise ConfigError(f"environment: change: {describe_user_error(error)}") from error
    return opened


ENVIRONMENTS: Table[type[EnvironmentModel]] = Table(
    "environments",
    {
        "wall": "forcebound.environments.wall:Wall",
        "damped_wall": "forcebound.environments.damped_wall:DampedWall",
        "time_varying_wall": "forcebound.environments.time_varying_wall:TimeVaryingWall",
        "power_law_wall": "forcebound.environments.power_law_wall:PowerLawWall",
        "damper": "forcebound.environments.damper:Damper",
        "solid": "forcebound.environments.solid:Solid",
        "distance_field": "forcebound.environments.distance_field:DistanceField",
        "point_cloud": "forcebound.environments.point_cloud:PointCloud",
        "mass_spring": "forcebound.environments.mass_spring:MassSpring",
        "bodies": "forcebound.environments.bodies:Bodies",
        "exploding_body": "forcebound.environments.proxy_adversary:ExplodingBody",
        "holed_wall": "forcebound.environments.proxy_adversary:HoledWall",
        "jumping_proxy": "forcebound.environments.proxy_adversary:JumpingProxy",
        "recorded": "forcebound.environments.recorded:RecordedEnvironment",
        "mesh": "forcebound.environments.mesh:TriangleMesh",
        "active_wall": "forcebound.environments.adversary:ActiveWall",
        "negative_damper": "forcebound.environments.adversary:NegativeDamper",
        "random_force": "forcebound.environments.adversary:RandomForce",
        "velocity_pusher": "forcebound.environments.adversary:VelocityPusher",
    },
    Form(methods={"force": 3, "open": 1}),
)
