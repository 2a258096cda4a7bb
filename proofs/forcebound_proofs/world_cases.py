"""Worlds and controllers under attack, in two and three axes, and the numbers of such a case.

Every world and controller that launch files know is attacked: its fields are drawn from their types
(:mod:`forcebound_proofs.field_ranges`), so a new one needs no line here. :data:`SPECIAL` has worlds
that need a file, more shapes, or go wrong. A surface lies near :data:`SURFACE`, as in the shipped
launch files, and there the hands are.

The name of a case is enough to repeat it: ``WORLD/CONTROLLER:SEED``, or ``WORLD/CONTROLLER:cCODE``
for one of a search.
"""

import random
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

from forcebound.errors import ConfigError
from forcebound.graph.document import SHIPPED
from forcebound.haptics.controllers import CONTROLLERS, ControllerModel
from forcebound.haptics.environments import ENVIRONMENTS, EnvironmentModel
from forcebound.haptics.environments.fixtures import (
    Fixtures,
    GuidancePath,
    GuidancePlane,
    WithFixtures,
    WorkspaceLimit,
)
from forcebound.haptics.environments.mujoco_scene import check_coupling
from forcebound.haptics.environments.solid import Shape
from forcebound.haptics.laws.dissipation import Watchdog
from forcebound_proofs.adversaries import ADVERSARIES
from forcebound_proofs.cases import NOISES, Range, decode, seed_of
from forcebound_proofs.field_ranges import made, ranges_of

Numbers: TypeAlias = Mapping[str, float]

SURFACE = 0.010  # m, on the first axis

#: Numbers of every case, SI units.
HAND_AND_DEVICE: dict[str, Range] = {
    "axes": Range(2.0, 3.999),  # its whole part
    "mass": Range(0.02, 0.5, is_logarithmic=True),
    "damping": Range(0.01, 3.0, is_logarithmic=True),
    "damping_ratio": Range(0.3, 3.0, is_logarithmic=True),  # of each axis to the one before
    "friction": Range(0.003, 1.0, is_logarithmic=True),
    "friction_ratio": Range(0.3, 3.0, is_logarithmic=True),
    "resolution": Range(1e-6, 2e-4, is_logarithmic=True, zero_share=0.2),
    "saturation": Range(3.0, 30.0),
    "watchdog": Range(0.0, 2.999),  # its whole part: an index in WATCHDOGS
    "excess_hold": Range(0.0, 1.5, zero_share=0.2),  # in periods above one
    "reply_wait": Range(0.05, 0.9),  # share of the period
    "late_rate": Range(5.0, 200.0, is_logarithmic=True, zero_share=0.4),  # Hz
    "lateness": Range(0.5e-3, 6e-3, is_logarithmic=True),
    "write_jitter": Range(1e-5, 2e-4, is_logarithmic=True, zero_share=0.4),
    "hand_mass": Range(0.01, 1.0, is_logarithmic=True),
    "hand_stiffness": Range(20.0, 2000.0, is_logarithmic=True),
    "hand_damping": Range(0.1, 10.0, is_logarithmic=True, zero_share=0.3),
    "pressing": Range(-0.005, 0.02),  # m, along the first axis: middle of the motion
    "amplitude": Range(1e-4, 0.02, is_logarithmic=True),  # m, along the first axis
    "sideways": Range(1e-4, 0.02, is_logarithmic=True),  # m, along the others
    "frequency": Range(1.0, 25.0, is_logarithmic=True),  # Hz, of the first axis
    "detuning": Range(0.3, 3.0, is_logarithmic=True),  # frequency of each axis over the one before
    "link_delay": Range(1e-4, 0.03, is_logarithmic=True, zero_share=0.3),  # s, each way
    "delay_jitter": Range(1e-4, 0.01, is_logarithmic=True, zero_share=0.4),
    "loss": Range(0.0, 0.5, zero_share=0.4),
}

WATCHDOGS: tuple[Watchdog, ...] = ("silent", "reporting", "guarding")

OPEN_BOX = Path(__file__).parent / "open_box.obj"  # a face is missing
BOXES = SHIPPED / "push_boxes.xml"  # needs the extra mujoco
BOXES_STEP = 1e-3  # s
HALF = 0.03  # m, of a box

GROOVE = (
    Shape("box", position=(SURFACE + HALF, 0.0, 0.0), size=(2 * HALF, 2 * HALF, 2 * HALF)),
    Shape(
        "cylinder",
        position=(SURFACE, 0.0, 0.0),
        radius=0.3 * HALF,
        length=3 * HALF,
        is_removed=True,
    ),
)
WEDGE = (
    Shape("plane", position=(SURFACE, 0.0, 0.0), axis=(-1.0, 1.0, 0.3)),
    Shape("plane", position=(SURFACE, 0.0, 0.0), axis=(-1.0, -0.5, -1.0)),
)
FIXTURES = Fixtures(
    plane=GuidancePlane(point=(SURFACE, 0.0), normal=(0.2, 1.0, 0.0), stiffness=3000.0),
    path=GuidancePath(points=((0.0, 0.0), (0.02, 0.01), (0.02, -0.01)), stiffness=5000.0),
    workspace=WorkspaceLimit(low=(0.0, -0.005), high=(0.02, 0.005), stiffness=10_000.0),
)


class World(NamedTuple):
    """A kind of environment, the fields that are not drawn, and what stands beside it."""

    kind: Any
    values: Mapping[str, Any] = {}
    fixtures: Fixtures | None = None
    check: Callable[[Any], object] = lambda model: None  # ConfigError: fields do not go together


#: Worlds that are not just an environment of launch files with its fields drawn.
SPECIAL: dict[str, World] = {
    **{name: World(kind) for name, kind in ADVERSARIES.items()},
    "bodies": World(
        ENVIRONMENTS["bodies"],
        {"file": BOXES},
        check=lambda model: check_coupling(model, BOXES_STEP),
    ),
    "fixtures": World(ENVIRONMENTS["solid"], fixtures=FIXTURES),
    "mesh_with_hole": World(
        ENVIRONMENTS["mesh"],
        {
            "file": OPEN_BOX,
            "may_be_open": True,
            "scale": HALF,
            "position": (SURFACE, 0.0, 0.0),
            "orientation": (1.0, 0.2, 0.1, 0.3),
        },
    ),
    "solid_with_groove": World(ENVIRONMENTS["solid"], {"shapes": GROOVE}),
    "wedge": World(ENVIRONMENTS["solid"], {"shapes": WEDGE}),
}
NEED_MORE = ("coupling", "recorded")  # a second hand, a recording


def worlds() -> list[str]:
    """Return the names of all worlds under attack."""
    return sorted({*ENVIRONMENTS, *SPECIAL} - {*NEED_MORE})


def world_named(name: str) -> World:
    """Return a world.

    Raises:
        ConfigError: If there is none of this name.
    """
    check_name("world", name, worlds())
    return SPECIAL[name] if name in SPECIAL else World(ENVIRONMENTS[name])


class WorldScenario(NamedTuple):
    """Definition of a run, without the law."""

    world: str
    controller: str
    seed: int  # of the links and of late ticks
    numbers: Numbers  # by the keys of :func:`numbers_of`

    @property
    def axes(self) -> int:
        """Number of axes."""
        return int(self.numbers["axes"])

    def fields(self, section: str) -> dict[str, float]:
        """Return the numbers of a section, by the paths of its fields."""
        start = f"{section}."
        return {
            name.removeprefix(start): number
            for name, number in self.numbers.items()
            if name.startswith(start)
        }

    def environment(self) -> EnvironmentModel:
        """Return the environment."""
        world = world_named(self.world)
        kind, values, _, check = world
        model: EnvironmentModel = made(kind, self.fields("environment"), values, check)
        return model if world.fixtures is None else WithFixtures(model, world.fixtures)

    def open_controller(self) -> Any:
        """Return a new controller."""
        model: ControllerModel = made(CONTROLLERS[self.controller], self.fields("controller"))
        return model.open(self.axes)


def numbers_of(world: str, controller: str) -> dict[str, Range]:
    """Return the ranges of the numbers of a case: hand and device, environment, controller.

    Raises:
        ConfigError: If there is no such world or controller.
    """
    check_name("controller", controller, list(CONTROLLERS))
    kind, values, *_ = world_named(world)
    return _numbers_of(kind, tuple(values), CONTROLLERS[controller])


@cache
def _numbers_of(kind: type, given: tuple[str, ...], controller: type) -> dict[str, Range]:
    found = dict(HAND_AND_DEVICE)
    for section, ranges in (
        ("environment", ranges_of(kind, given)),
        ("controller", ranges_of(controller)),
    ):
        found |= {f"{section}.{path}": one for path, one in ranges.items()}
    return found


def check_name(what: str, name: str, known: list[str]) -> None:
    """Check that a world or controller is under attack.

    Raises:
        ConfigError: If it is not.
    """
    if name not in known:
        raise ConfigError(f"no {what} {name!r} is under attack; known are {', '.join(known)}")


def case_of(name: str) -> WorldScenario:
    """Return the case of a name.

    Raises:
        ConfigError: If it is none.
    """
    title, _, rest = name.partition(":")
    world, _, controller = title.partition("/")
    ranges, seed = numbers_of(world, controller), seed_of(rest)
    if seed is not None:
        draw = random.Random(seed)
        drawn = {name: one.at(draw.random()) for name, one in ranges.items()}
        return WorldScenario(world, controller, seed, drawn)
    (noise,), numbers = decode(rest, (NOISES,), ranges)
    return WorldScenario(world, controller, noise, numbers)
