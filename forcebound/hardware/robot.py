"""A robot by a class of its user's that knows nothing of forcebound: joints, read and written.

::

    class MyRobot:
        def __init__(self, port): ...       # connects; `arguments` of the launch file, by keyword
        def get_positions(self): ...        # one number per joint, new from the bus
        def set_torques(self, torques): ... # a list; positive accelerates towards larger positions
        def get_velocities(self): ...       # optional, as are currents: of the last positions
        def get_currents(self): ...
        def stop(self): ...                 # optional: the last call, after zero torques

How its calls, times and failures are treated: :mod:`forcebound.hardware.driven`.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

from forcebound.errors import ConfigError, DeviceError
from forcebound.haptics.devices import Source
from forcebound.haptics.hands import Operator
from forcebound.haptics.laws.dissipation import (
    AngleOfJoints,
    DampingOfJoints,
    OfAxes,
    TorqueOfJoints,
)
from forcebound.haptics.parts import user_module
from forcebound.hardware.driven import Caller, DrivenModel, OpenDriven, Units
from forcebound.quantities import POSITIVE, AngularSpeed, Ratio, Torque

OPENING = 30.0  # s, for the constructor: it may look for a port, and calibrate
ASSUMED: Mapping[str, Source] = dict.fromkeys(
    ("damping", "friction", "resolution", "saturation", "largest_speed"), "assumed"
)
IN_RAD = {"rad": 1.0, "deg": math.pi / 180.0, "turns": math.tau}


@dataclass(frozen=True, kw_only=True)
class Robot(DrivenModel):
    """Parameters of a robot.

    Damping and friction are assumed, those of the weakest joint of a small servo arm:
    ``forcebound identify`` measures them.

    Attributes:
        class: Its class, ``my_robot.py:MyRobot``; the file may import files beside it.
        arguments: Of the constructor, by their names.
        positions: Unit of the positions, and of the velocities per s, for joints that turn;
            m for prismatic joints.
        commands: What ``set_torques`` takes: torque of the motor, in N m; current, in A; counts,
            whole numbers.
        gear: Turns of a motor for a turn of its joint; one number, or one of each joint.
        torque_constant: Of the motors, in N m/A, for current and counts; likewise.
        counts_per_ampere: Likewise, for counts.
    """

    class_: Path
    arguments: Mapping[str, Any] = field(default_factory=dict, hash=False)
    positions: Literal["rad", "deg", "turns"] = "rad"
    commands: Literal["torque", "current", "counts"] = "torque"
    gear: OfAxes[Annotated[Ratio, POSITIVE]] = 1.0
    torque_constant: OfAxes[Annotated[Ratio, POSITIVE]] = 1.0
    counts_per_ampere: OfAxes[Annotated[Ratio, POSITIVE]] = 1.0
    damping: DampingOfJoints = 0.01
    friction: TorqueOfJoints = 0.03
    resolution: AngleOfJoints = math.tau / 4096  # data sheet of common servos
    saturation: Annotated[Torque, POSITIVE] = 1.0
    largest_speed: Annotated[AngularSpeed, POSITIVE] | None = 30.0  # a servo without load: 11
    sources: Mapping[str, Source] = field(default_factory=lambda: ASSUMED, hash=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        self.units()
        if not user_module.names_file(str(self.class_)):
            raise ConfigError(
                f"class: expected FILE.py:NAME, such as my_robot.py:MyRobot, got {self.class_}",
                field="class",
            )

    @property
    def torque_scale(self) -> str:
        """Of motors whose torque is not commanded as such."""
        return "" if self.commands == "torque" else "torque_constant"

    @property
    def own_code(self) -> str:
        return str(self.class_)

    def units(self) -> Units:
        """Return what positions and commands of the class are in rad and N m."""
        gear, constant, counts = (
            self.of_joints(name, 1.0) for name in ("gear", "torque_constant", "counts_per_ampere")
        )
        commands = [1.0 / one for one in gear]
        if self.commands != "torque":
            commands = [each / one for each, one in zip(commands, constant, strict=True)]
        if self.commands == "counts":
            commands = [each * one for each, one in zip(commands, counts, strict=True)]
        turned = IN_RAD[self.positions]
        positions = tuple(1.0 if name in self.prismatic else turned for name in self.joints)
        return Units(positions, tuple(commands), self.commands == "counts")

    def check_files(self) -> None:
        _class_of(self.class_)

    def open(self, operator: Operator | None, hold_limit: float) -> OpenDriven:
        make, caller = _class_of(self.class_), Caller(self.timeout)
        name = f"{make.__name__}({', '.join(f'{n}={v!r}' for n, v in self.arguments.items())})"
        try:
            made = caller.call(name, lambda: make(**self.arguments), timeout=OPENING)
        except DeviceError:
            caller.end()
            raise
        return OpenDriven(self, caller, made.answer, self.units())


def _class_of(kind: Path) -> Callable[..., Any]:
    """Return the class of a kind; ConfigError, with the line, if it cannot be loaded."""

    def fits(part: object) -> bool:
        return all(hasattr(part, name) for name in ("get_positions", "set_torques"))

    expected = "a class with get_positions() and set_torques(torques)"
    with user_module.user_code("class", "class"):
        found: Callable[..., Any] = user_module.load(str(kind), Path(), fits, expected)
    if not fits(found):
        raise ConfigError(f"class: {kind.name} is not {expected}", field="class")
    return found
