"""Worlds and controllers under attack, in two and three axes, and the numbers of such a case.

To add a world: one line in :data:`WORLDS`, a function from the numbers of a case to its model. A
surface lies near 0 m, where the hands are. Every controller that launch files know is attacked;
:data:`CONTROLLERS` says how the numbers choose its parameters.

The name of a case is enough to repeat it: ``WORLD/CONTROLLER:SEED``, or
``WORLD/CONTROLLER:cCODE`` for one of a search.
"""

import random
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

from forcebound.errors import ConfigError
from forcebound.graph.document import SHIPPED
from forcebound.haptics.controllers import CONTROLLERS as CONTROLLER_KINDS
from forcebound.haptics.controllers import ControllerModel
from forcebound.haptics.environments import ENVIRONMENTS, EnvironmentModel
from forcebound.haptics.environments.fixtures import (
    Fixtures,
    GuidancePath,
    GuidancePlane,
    WithFixtures,
    WorkspaceLimit,
)
from forcebound.haptics.environments.solid import Shape
from forcebound.haptics.geometry.proxy import Surface
from forcebound.haptics.laws.dissipation import Watchdog
from forcebound.lab.cases import by_logarithm
from forcebound_proofs.adversaries import (
    Adversary,
    ExplodingBody,
    HoledWall,
    JumpingProxy,
    RandomForce,
    VelocityPusher,
)
from forcebound_proofs.cases import NOISES, Range, decode, seed_of

Numbers: TypeAlias = Mapping[str, float]

#: Numbers of every case, SI units.
NUMBERS: dict[str, Range] = {
    "axes": Range(2.0, 3.999),  # its whole part
    "mass": Range(0.02, 0.5, is_logarithmic=True),
    "damping": Range(0.01, 3.0, is_logarithmic=True),
    "damping_ratio": Range(0.3, 3.0, is_logarithmic=True),  # of each axis to the one before
    "friction": Range(0.003, 1.0, is_logarithmic=True),
    "friction_ratio": Range(0.3, 3.0, is_logarithmic=True),
    "resolution": Range(1e-6, 2e-4, is_logarithmic=True, zeros=1, zero_share=0.2),
    "saturation": Range(3.0, 30.0),
    "watchdog": Range(0.0, 2.999),  # its whole part: an index in WATCHDOGS
    "excess_hold": Range(0.0, 1.5, zero_share=0.2),  # in periods above one
    "reply_wait": Range(0.05, 0.9),  # share of the period
    "late_rate": Range(5.0, 200.0, is_logarithmic=True, zeros=1, zero_share=0.4),  # Hz
    "lateness": Range(0.5e-3, 6e-3, is_logarithmic=True),
    "write_jitter": Range(1e-5, 2e-4, is_logarithmic=True, zeros=1, zero_share=0.4),
    "hand_mass": Range(0.01, 1.0, is_logarithmic=True),
    "hand_stiffness": Range(20.0, 2000.0, is_logarithmic=True),
    "hand_damping": Range(0.1, 10.0, is_logarithmic=True, zeros=1, zero_share=0.3),
    "pressing": Range(-0.005, 0.02),  # m, along the first axis: middle of the motion
    "amplitude": Range(1e-4, 0.02, is_logarithmic=True),  # m, along the first axis
    "sideways": Range(1e-4, 0.02, is_logarithmic=True),  # m, along the others
    "frequency": Range(1.0, 25.0, is_logarithmic=True),  # Hz, of the first axis
    "detuning": Range(0.3, 3.0, is_logarithmic=True),  # frequency of each axis over the one before
    "link_delay": Range(1e-4, 0.03, is_logarithmic=True, zeros=1, zero_share=0.3),  # s, each way
    "delay_jitter": Range(1e-4, 0.01, is_logarithmic=True, zeros=1, zero_share=0.4),
    "loss": Range(0.0, 0.5, zeros=1, zero_share=0.4),
    "stiffness": Range(100.0, 30_000.0, is_logarithmic=True),  # of the world
    "share_1": Range(0.0, 1.0),  # what they mean is up to world and controller
    "share_2": Range(0.0, 1.0),
    "share_3": Range(0.0, 1.0),
    "share_4": Range(0.0, 1.0),
}

WATCHDOGS: tuple[Watchdog, ...] = ("silent", "reporting", "guarding")


def _log(numbers: Numbers, share: int, low: float, high: float) -> float:
    return by_logarithm(low, high, numbers[f"share_{share}"])


def _environment(kind: str, **values: Any) -> EnvironmentModel:
    make: Any = ENVIRONMENTS[kind]
    model: EnvironmentModel = make(**values)
    return model


def _surface(n: Numbers) -> Surface:
    """Return how a surface feels: friction, that may stick and slip, viscosity, a magnet."""
    friction = 1.5 * n["share_2"]
    return Surface(
        friction=friction,
        static_friction=friction * (1.0 + n["share_3"]),
        stick_slip=0.1 * max(n["share_3"] - 0.5, 0.0),
        viscosity=20.0 * max(n["share_4"] - 0.5, 0.0),
        magnet=0.01 * max(n["share_4"] - 0.8, 0.0),
    )


def _solid(n: Numbers) -> EnvironmentModel:
    """Return a sphere, a box with a groove, or a wedge of two planes, their surface near 0 m."""
    size = by_logarithm(5e-3, 0.1, abs(2.0 * n["share_1"] - 1.0))
    edge = 2.0 * size
    shapes = (
        (Shape("sphere", position=(size, 0.0, 0.0), radius=size),),
        (
            Shape("box", position=(size, 0.0, 0.0), size=(edge, edge, edge)),
            Shape("cylinder", radius=0.3 * size, length=3.0 * size, is_removed=True),
        ),
        (Shape("plane", axis=(-1.0, 1.0, 0.3)), Shape("plane", axis=(-1.0, -0.5, -1.0))),
    )[int(2.999 * n["share_1"])]
    return _environment(
        "solid", shapes=shapes, stiffness=n["stiffness"], damping=10.0 * n["share_3"],
        surface=_surface(n),
    )  # fmt: skip


def _of_file(kind: str, n: Numbers, file: Path | None = None, **values: Any) -> EnvironmentModel:
    return _environment(
        kind, file=file, stiffness=n["stiffness"], damping=10.0 * n["share_3"],
        surface=_surface(n), **values,
    )  # fmt: skip


def _fixtures(n: Numbers) -> EnvironmentModel:
    """Return a solid with a path and a plane that draw the hand, and a workspace that ends."""
    reach = _log(n, 1, 1e-3, 0.05)
    fixtures = Fixtures(
        plane=GuidancePlane(normal=(0.2, 1.0, 0.0), stiffness=n["stiffness"], reach=reach),
        path=GuidancePath(
            points=((-0.01, 0.0), (0.01, 0.01), (0.01, -0.01)),
            stiffness=0.5 * n["stiffness"], reach=reach,
        ),
        workspace=WorkspaceLimit(
            low=(-0.01, -0.005), high=(0.01, 0.005),
            stiffness=n["stiffness"], damping=20.0 * n["share_2"],
        ),
    )  # fmt: skip
    return WithFixtures(_solid(n), fixtures)


BACK = (0.042, 0.0, 0.008)  # m, of the rabbit: its back is near 0 m
OPEN_BOX = Path(__file__).parent / "open_box.obj"  # a face is missing

BOXES = SHIPPED / "push_boxes.xml"  # needs the extra mujoco


def _bodies(n: Numbers) -> EnvironmentModel:
    """Return twenty boxes, on a coupling that is at most as stiff as MuJoCo can integrate."""
    mass = _log(n, 2, 1e-3, 0.1)
    return _environment(
        "bodies",
        file=BOXES,
        stiffness=min(n["stiffness"], 0.99e6 * mass),  # the scene's time step is 1 ms
        damping=20.0 * n["share_1"],
        probe_mass=mass,
    )


WORLDS: dict[str, Callable[[Numbers], EnvironmentModel]] = {
    "active_wall": lambda n: _environment(
        "active_wall", stiffness=n["stiffness"], damping=-100.0 * n["share_1"], position=0.0
    ),
    "damped_wall": lambda n: _environment(
        "damped_wall", stiffness=n["stiffness"], damping=50.0 * n["share_1"], position=0.0
    ),
    "exploding_body": lambda n: Adversary(
        partial(ExplodingBody, n["stiffness"], _log(n, 1, 1e-3, 1.0), _log(n, 2, 1e-3, 1.0))
    ),
    "holed_wall": lambda n: Adversary(
        lambda axes: HoledWall(
            n["stiffness"], _log(n, 1, 1e-4, 0.01), n["share_2"], int(1000.0 * n["share_3"])
        )
    ),
    "jumping_proxy": lambda n: Adversary(
        lambda axes: JumpingProxy(
            n["stiffness"], _log(n, 1, 1e-4, 0.05), _log(n, 2, 5e-4, 0.1), int(1e3 * n["share_3"])
        )
    ),
    "mass_spring": lambda n: _environment(
        "mass_spring", stiffness=n["stiffness"], mass=_log(n, 1, 0.01, 1.0),
        spring=_log(n, 2, 10.0, 1e4), damping=10.0 * n["share_3"], position=0.0,
    ),
    "random_force": lambda n: RandomForce(
        30.0 * n["share_1"], _log(n, 2, 5e-4, 0.1), int(1000.0 * n["share_3"])
    ),
    "solid": _solid,
    "fixtures": _fixtures,
    "mesh": lambda n: _of_file("mesh", n, position=BACK),
    "distance_field": lambda n: _of_file("distance_field", n, position=BACK),
    "point_cloud": lambda n: _of_file("point_cloud", n, position=BACK),
    "mesh_with_hole": lambda n: _of_file(
        "mesh", n, OPEN_BOX, scale=_log(n, 1, 0.01, 0.1), may_be_open=True,
        position=(0.0, 0.0, 0.0), orientation=(1.0, 0.2, 0.1, 0.3),
    ),
    "bodies": _bodies,
    "velocity_pusher": lambda n: VelocityPusher(30.0 * n["share_1"]),
}  # fmt: skip

#: How the numbers of a case choose the parameters of a controller; others have their defaults.
CONTROLLERS: dict[str, Callable[[Numbers], dict[str, float]]] = {
    "local_model": lambda n: {"power": _log(n, 4, 1e-3, 1e3)},
    "scaled": lambda n: {
        "motion_scale": _log(n, 3, 0.1, 10.0),
        "force_scale": _log(n, 4, 0.1, 10.0),
        "border": 0.01,
        "border_rate": _log(n, 2, 0.1, 100.0),
    },
    "virtual_coupling": lambda n: {
        "stiffness": _log(n, 3, 10.0, 1e4),
        "damping": _log(n, 4, 1e-3, 10.0),
        "mass": max(n["share_2"] - 0.5, 0.0),
    },
}


def controller_of(kind: str, numbers: Numbers) -> ControllerModel:
    """Return a controller of this kind."""
    make: Any = CONTROLLER_KINDS[kind]
    model: ControllerModel = make(**(CONTROLLERS[kind](numbers) if kind in CONTROLLERS else {}))
    return model


class WorldScenario(NamedTuple):
    """Definition of a run, without the law."""

    name: str  # see the module's docstring
    world: str
    controller: str
    seed: int  # of the links and of late ticks
    numbers: Numbers  # by the keys of NUMBERS

    @property
    def axes(self) -> int:
        """Number of axes."""
        return int(self.numbers["axes"])


def check_name(what: str, name: str, table: Mapping[str, object]) -> None:
    """Check that a world or controller is under attack.

    Raises:
        ConfigError: If it is not.
    """
    if name not in table:
        raise ConfigError(f"no {what} {name!r} is under attack; known are {', '.join(table)}")


def case_of(name: str) -> WorldScenario:
    """Return the case of a name.

    Raises:
        ConfigError: If it is none.
    """
    title, _, rest = name.partition(":")
    world, _, controller = title.partition("/")
    check_name("world", world, WORLDS)
    check_name("controller", controller, CONTROLLER_KINDS)
    seed = seed_of(rest)
    if seed is not None:
        draw = random.Random(seed)
        drawn = {name: one.draw(draw) for name, one in NUMBERS.items()}
        return WorldScenario(name, world, controller, seed, drawn)
    (noise,), numbers = decode(rest, (NOISES,), NUMBERS)
    return WorldScenario(name, world, controller, noise, numbers)
