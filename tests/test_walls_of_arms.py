"""Walls and limits in place of the hand on an arm, against mechanics and independent axes."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from launch_texts import written

from forcebound.errors import ConfigError
from forcebound.graph.loader import load
from forcebound.haptics.devices import Truth
from forcebound.haptics.devices.desktop_arm import DesktopArm
from forcebound.haptics.devices.five_bar import FiveBar
from forcebound.haptics.devices.knob import Knob
from forcebound.haptics.devices.phantom import PhantomPremium15
from forcebound.haptics.devices.serial_arm import SerialArm
from forcebound.haptics.hands.hands import WallInPlace

TICK_NS = 1_000_000
DEVICES: dict[str, Any] = {
    "desktop_arm": DesktopArm(friction=0.0),
    "five_bar": FiveBar(friction=0.0),
    "knob": Knob(joints=2, friction=0.0),
    "planar": SerialArm(friction=0.0),
    "spatial": SerialArm(joints=3, friction=0.0),
    "independent axes": PhantomPremium15(axes=2, friction=0.0),
}


class Pushed:
    """A simulated device whose tip a force of the motors pushes, in N; it gets it all the time."""

    def __init__(self, model: Any, wall: WallInPlace, force: tuple[float, ...]) -> None:
        self.device = model.open(wall, 1.0)
        self.force = (force + (0.0,) * model.axes)[: model.axes]
        self.ticks = 0
        self.device.engage(0)

    def run(self, seconds: float) -> list[Truth]:
        """Return the ground truth of each tick."""
        truths = []
        for _ in range(round(1e3 * seconds)):
            self.ticks += 1
            reading = self.device.read(self.ticks * TICK_NS)
            resisted = tuple([-f for f in self.force])
            kinematics = self.device.kinematics
            torque = resisted if kinematics is None else kinematics.torque(reading, resisted)
            self.device.write(self.ticks * TICK_NS, torque)
            truths.append(self.device.truth())
        return truths


@pytest.mark.parametrize("name", sorted(DEVICES))
@pytest.mark.parametrize(
    ("gap", "force"),
    [(0.004, (0.5, 0.0)), ((None, -0.003), (0.0, -0.4)), ((0.004, -0.003), (0.5, -0.4))],
    ids=["wall", "floor", "corner"],
)
def test_at_rest_the_tip_is_in_by_the_force_over_the_stiffness(
    name: str, gap: Any, force: tuple[float, float]
) -> None:
    wall = WallInPlace(stiffness=800.0, damping=4.0, gap=gap)
    pushed = Pushed(replace(DEVICES[name], resolution=0.0), wall, force)
    last = pushed.run(3.0)[-1]
    for axis, (way, pushing) in enumerate(zip([*wall.walls, math.nan], force, strict=False)):
        if not math.isnan(way):
            assert last.position[axis] - way == pytest.approx(pushing / 800.0, rel=1e-3)
            assert last.hand_force[axis] == pytest.approx(-pushing, rel=1e-3)
    assert math.hypot(*last.velocity[: len(wall.walls)]) < 1e-3


@pytest.mark.parametrize("name", sorted(set(DEVICES) - {"independent axes"}))
def test_the_energy_of_the_wall_and_the_load_is_that_of_their_force_on_the_tip(name: str) -> None:
    """Thrown against a wall: what the tip gave and took, by forces and by the sum in the joints."""
    model = replace(DEVICES[name], substep=1e-5)
    wall = WallInPlace(mass=0.1, stiffness=500.0, damping=1.0, gap=0.002)
    pushed = Pushed(model, wall, (0.6, 0.0))
    energy, before = 0.0, None
    deepest = 0.0
    for truth in pushed.run(0.4):
        if before is not None:
            moved = [b - a for a, b in zip(before.position, truth.position, strict=True)]
            mean = [0.5 * (a + b) for a, b in zip(before.hand_force, truth.hand_force, strict=True)]
            energy += math.fsum(f * x for f, x in zip(mean, moved, strict=True))
        deepest, before = max(deepest, truth.position[0] - 0.002), truth
    assert before is not None
    load = 0.05 * math.fsum(v * v for v in before.velocity)
    assert deepest > 1e-3
    assert before.energy == pytest.approx(energy - load, abs=0.02 * 250.0 * deepest**2)


def test_a_knob_at_a_long_lever_meets_the_wall_of_an_independent_axis() -> None:
    axis = PhantomPremium15(resolution=0.0)
    knob = Knob(
        lever=1.0,
        inertia=axis.mass,
        damping=axis.damping,
        friction=axis.friction,
        resolution=0.0,
        saturation=axis.saturation,
        substep=axis.substep,
    )
    wall = WallInPlace(mass=0.2, stiffness=1000.0, damping=3.0, gap=0.003)
    for force in (0.8, -0.8):
        met = replace(wall, gap=math.copysign(0.003, force))
        both = [Pushed(one, met, (force,)).run(0.5) for one in (axis, knob)]
        for plain, turned in zip(*both, strict=True):
            assert turned.position == pytest.approx(plain.position, abs=1e-12)
            assert turned.hand_force == pytest.approx(plain.hand_force, abs=1e-9)
            # Where it turns back within a step, the two stop another mass.
            assert turned.energy == pytest.approx(plain.energy, abs=1e-8)


def test_a_limit_of_a_joint_is_a_spring_that_gives_back_what_it_got() -> None:
    stiffness, limits = 20.0, ((-0.5, 0.2), (-0.1, 0.5))
    wall = WallInPlace(
        stiffness=0.0, joint_limits=limits, joint_stiffness=stiffness, joint_damping=0.0
    )
    model = Knob(joints=2, friction=0.0, resolution=0.0)
    torque = (0.1, -0.2)
    pushed = Pushed(model, wall, tuple(t / model.lever for t in torque))
    last = pushed.run(3.0)[-1]
    angles = [x / model.lever for x in last.position]
    over = [t / stiffness for t in torque]
    assert angles == pytest.approx([0.2 + over[0], -0.1 + over[1]], abs=1e-6)
    assert last.hand_force == (0.0, 0.0)  # of the tip alone
    # Into the limits: what the joints took of them is minus what the springs hold.
    stored = 0.5 * stiffness * math.fsum(x * x for x in over)
    assert last.energy == pytest.approx(-stored, rel=1e-3)
    pushed.force = (0.0, 0.0)
    assert pushed.run(1.0)[-1].energy == pytest.approx(0.0, abs=0.01 * stored)


@pytest.mark.parametrize(
    ("device", "keys", "place", "named"),
    [
        ("kind: serial_arm", "gap: [1 mm, null, 2 mm]", "4:1", "3 axes"),
        ("kind: serial_arm", "start: 2 m", "5:20", "2000"),
        ("kind: serial_arm", "joint_limits: [[-1 rad, 1 rad]]", "5:27", "2 pairs"),
        ("kind: serial_arm", "joint_limits: [[0 rad, 1 rad], [0 rad, 1 rad]]", "5:27", "joint 1"),
        ("kind: knob", "joint_limits: [[1 rad, -1 rad]]", "5:27", "lower angle first"),
        ("kind: phantom_premium_1_5", "joint_limits: [[-1 rad, 1 rad]]", "5:27", "no tip"),
        ("kind: five_bar", "joint_stiffness: 0 N m/rad", "5:30", "> 0 N m/rad"),
    ],
)
def test_what_an_arm_cannot_meet_is_said_with_its_place(
    device: str, keys: str, place: str, named: str, tmp_path: Path
) -> None:
    operator = f"operator: {{ kind: wall,\n            {keys} }}"
    text = f"forcebound: 1\ninclude: stiff_wall.yaml\ndevice: {{ {device} }}\n{operator}\n"
    with pytest.raises(ConfigError) as caught:
        load(written(tmp_path, text))
    assert f"graph.yaml:{place}: " in str(caught.value)
    assert named in str(caught.value)
