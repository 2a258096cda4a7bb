"""Arms: their kinematics, and the simulated ones against mechanics."""

import itertools
import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TypeAlias

import numpy as np
import pytest
from builders import MS
from hypothesis import given, settings
from hypothesis import strategies as st

from forcebound.errors import ConfigError, DeviceError
from forcebound.haptics.devices.desktop_arm import DesktopArm
from forcebound.haptics.devices.five_bar import FiveBar
from forcebound.haptics.devices.knob import Knob
from forcebound.haptics.devices.serial_arm import SerialArm
from forcebound.haptics.devices.simulated import SimulatedDevice
from forcebound.haptics.devices.true_values import TrueJoints
from forcebound.haptics.hands import Operator
from forcebound.haptics.hands.hands import PressingHand
from forcebound.messages.packets import Vector

Arm: TypeAlias = DesktopArm | FiveBar | SerialArm | Knob

ARMS: dict[str, Arm] = {
    "desktop": DesktopArm(),
    "five_bar": FiveBar(),
    "five_bar with one axis for both motors": FiveBar(base=0.0),
    "planar": SerialArm(),
    "planar, unequal": SerialArm(upper=0.2, lower=0.1),
    "spatial": SerialArm(joints=3),
    "knob": Knob(),
    "two knobs": Knob(joints=2, lever=0.05),
}

points = st.tuples(*[st.floats(-0.03, 0.03)] * 3)


def dot(one: Iterable[float], other: Iterable[float]) -> float:
    return math.fsum(a * b for a, b in zip(one, other, strict=True))


@pytest.fixture(params=sorted(ARMS))
def arm(request: pytest.FixtureRequest) -> Arm:
    return ARMS[request.param]


@given(point=points)
@settings(max_examples=30)
@pytest.mark.parametrize("name", sorted(ARMS))
def test_the_tip_is_where_the_angles_for_that_place_put_it(name: str, point: Vector) -> None:
    arm = ARMS[name]
    place = point[: arm.axes]
    angles = arm.angles(place)
    assert angles is not None
    assert arm.geometry().position(angles) == pytest.approx(place, abs=1e-12)


@given(point=points)
@settings(max_examples=30)
@pytest.mark.parametrize("name", sorted(ARMS))
def test_the_jacobian_is_the_derivative_of_the_position(name: str, point: Vector) -> None:
    arm, step = ARMS[name], 1e-5
    kinematics, angles = arm.geometry(), arm.angles(point[: arm.axes])
    assert angles is not None
    jacobian = kinematics.jacobian(angles)
    for joint in range(arm.axes):
        moved = [
            kinematics.position(tuple(a + side * step * (j == joint) for j, a in enumerate(angles)))
            for side in (1, -1)
        ]
        slope = [(after - before) / (2 * step) for after, before in zip(*moved, strict=True)]
        assert [row[joint] for row in jacobian] == pytest.approx(slope, abs=1e-8)


def test_torques_do_the_work_of_the_force_at_the_tip(arm: Arm) -> None:
    kinematics, angles = arm.geometry(), arm.angles((0.01, -0.02, 0.015)[: arm.axes])
    assert angles is not None
    force, speeds = (1.0, -2.0, 0.5)[: arm.axes], (0.3, 0.7, -0.4)[: arm.axes]
    torque = kinematics.torque(angles, force)
    velocity = [dot(row, speeds) for row in kinematics.jacobian(angles)]
    assert dot(torque, speeds) == pytest.approx(dot(force, velocity))


def test_known_poses_of_the_five_bar() -> None:
    """The elbows of the 2DIY at its encoders' zeros, 12 and 168 degrees."""
    apart = 0.038 + 2 * 0.07 * math.cos(math.radians(12))
    height = 0.07 * math.sin(math.radians(12)) + math.sqrt(0.09**2 - apart**2 / 4)
    tip = FiveBar().geometry().position((math.radians(12), math.radians(168)))
    assert tip == pytest.approx((0.0, height - 0.105))
    upright = FiveBar(base=0.0, origin=(0.0, 0.1)).angles((0.0, math.sqrt(0.09**2 - 0.07**2) - 0.1))
    assert upright == pytest.approx((0.0, math.pi))


def test_known_poses_of_the_serial_arm() -> None:
    planar = SerialArm(upper=0.2, lower=0.1, origin=(0.2, 0.1)).geometry()
    assert planar.position((0.0, 0.0)) == pytest.approx((0.1, -0.1))
    assert planar.position((math.pi / 2, -math.pi / 2)) == pytest.approx((-0.1, 0.1))
    assert planar.torque((math.pi / 2, -math.pi / 2), (0.0, 1.0)) == pytest.approx((0.1, 0.1))
    spatial = SerialArm(joints=3, upper=0.2, lower=0.1, origin=(0.2, 0.1)).geometry()
    turned = spatial.position((math.pi / 2, math.pi / 2, -math.pi / 2))
    assert turned == pytest.approx((-0.2, 0.1, 0.1))


def test_known_poses_of_the_desktop_arm() -> None:
    """The upper link level and the lower one down; then turned by a right angle and stretched."""
    arm = DesktopArm(upper=0.2, lower=0.1, origin=(-0.1, 0.2), workspace=(0.01, 0.01, 0.01))
    kinematics = arm.geometry()
    assert kinematics.position((0.0, 0.0, 0.0)) == pytest.approx((0.0, 0.0, 0.0))
    stretched = kinematics.position((math.pi / 2, 0.0, math.pi / 2))
    assert stretched == pytest.approx((0.3, 0.1, -0.2))
    # The motor of the lower link alone carries it, whatever the upper link does: a parallelogram.
    assert kinematics.torque((0.0, 0.0, 0.0), (0.0, 0.0, 1.0)) == pytest.approx((0.0, 0.0, 0.1))
    assert kinematics.torque((0.0, 0.0, 0.0), (0.0, 1.0, 0.0)) == pytest.approx((0.0, 0.2, 0.0))


def test_a_desktop_arm_reaches_its_workspace_without_a_singular_pose() -> None:
    arm = DesktopArm()
    kinematics = arm.geometry()
    for corner in itertools.product(*[(-0.5 * e, 0.0, 0.5 * e) for e in arm.workspace]):
        angles = arm.angles(corner)
        assert angles is not None
        volume = abs(np.linalg.det(kinematics.jacobian(angles)))
        assert volume > 0.1 * arm.upper**2 * arm.lower


WIDE = FiveBar(base=0.06)  # its elbows can come farther apart than the distal links reach


@dataclass(frozen=True)
class SinkingHand(Operator):
    """A hand that pulls the tip towards the motors."""

    mass: float = 0.1
    stiffness: float = 500.0
    damping: float = 2.0

    def target(self, elapsed: float) -> Vector:
        return (0.0, -0.1 * elapsed)


def test_a_five_bar_that_cannot_be_held_gets_no_torque() -> None:
    """Nor does a reading that is no possible pose make numbers that are not finite."""
    kinematics = WIDE.geometry()
    assert kinematics.torque((0.0, math.pi), (1.0, 1.0)) == (0.0, 0.0)
    assert all(map(math.isfinite, kinematics.position((0.0, math.pi))))


@pytest.mark.parametrize("kind", [FiveBar, SerialArm])
def test_an_origin_out_of_reach_is_refused(kind: type[FiveBar] | type[SerialArm]) -> None:
    with pytest.raises(ConfigError, match="origin: the arm does not reach"):
        kind(origin=(0.0, 0.5))


@pytest.mark.parametrize("model", [FiveBar(), SerialArm(joints=3)])
def test_a_hand_that_begins_out_of_reach_is_refused(model: FiveBar | SerialArm) -> None:
    with pytest.raises(DeviceError, match="the hand begins at"):
        model.open(PressingHand(start=-0.5), 1.25e-3)


def read_until(device: SimulatedDevice, end_ns: int) -> None:
    for time_ns in range(MS, end_ns, MS):
        device.read(time_ns)


def test_a_hand_that_pulls_a_five_bar_apart_ends_the_run() -> None:
    device = WIDE.open(SinkingHand(), 1.25e-3)
    device.read(0)
    device.engage(0)
    with pytest.raises(DeviceError, match="singular pose, its tip at"):
        read_until(device, 3000 * MS)


# The simulated arm

LOSSLESS = SerialArm(inertia=2e-3, damping=0.0, friction=0.0, resolution=0.0)


@dataclass(frozen=True)
class CirclingHand(Operator):
    """A hand that draws a circle in the plane of the first two coordinates."""

    mass: float = 0.2
    stiffness: float = 400.0
    damping: float = 2.0
    radius: float = 0.02

    def target(self, elapsed: float) -> Vector:
        angle = 2 * math.pi * 1.5 * elapsed
        return (self.radius * math.sin(angle), self.radius * (1 - math.cos(angle)))


def test_without_a_hand_a_torque_accelerates_each_joint_by_itself() -> None:
    device = LOSSLESS.open(None, hold_limit=1.0)
    angles = device.read(0)
    device.write(0, (-0.02, 0.05))
    turned = [after - before for after, before in zip(device.read(40 * MS), angles, strict=True)]
    assert turned == pytest.approx([0.5 * 10 * 0.04**2, -0.5 * 25 * 0.04**2])


def test_a_joint_sticks_below_its_friction_and_slips_above() -> None:
    model = replace(LOSSLESS, friction=(0.1, 0.02))
    device = model.open(None, hold_limit=1.0)
    before = device.read(0)
    device.write(0, (0.05, 0.05))
    after = device.read(40 * MS)
    assert after[0] == before[0]
    assert after[1] - before[1] == pytest.approx(-0.5 * 15 * 0.04**2)


def test_friction_that_yields_lets_a_joint_move_by_its_share() -> None:
    model = replace(LOSSLESS, damping=0.05, friction=0.1, presliding=1e-3)
    device = model.open(None, hold_limit=10.0)
    before = device.read(0)
    device.write(0, (0.05, 0.0))
    assert device.read(4000 * MS)[0] - before[0] == pytest.approx(-0.5e-3, rel=1e-6)


def test_the_truth_may_differ_from_what_an_arm_states() -> None:
    truth = TrueJoints(friction=(0.0, 0.1), gain=0.5)
    device = replace(LOSSLESS, truth=truth).open(None, hold_limit=1.0)
    before = device.read(0)
    device.write(0, (-0.04, -0.04))
    turned = [a - b for a, b in zip(device.read(40 * MS), before, strict=True)]
    assert turned == pytest.approx([0.5 * 10 * 0.04**2, 0.0])


def test_an_arm_has_the_same_watchdog_stamps_and_saturation() -> None:
    device = replace(LOSSLESS, write_delay=3e-4, saturation=0.1).open(None, hold_limit=2e-3)
    device.read(0)
    assert device.write(0, (3.0, 4.0)) == pytest.approx((0.06, 0.08))
    assert device.stamps() == (0, 300_000)
    device.read(5 * MS)
    cut = device.cut()
    assert cut is not None
    assert cut[0] == 2_300_000


def drawn(model: Arm, substep: float) -> list[tuple[float, float]]:
    """Energy that the device counts, and that the hand counts at the tip, in each substep."""
    device: SimulatedDevice = replace(model, substep=substep).open(CirclingHand(), hold_limit=9.0)
    device.read(0)
    device.engage(0)
    before, work, found = device.truth(), 0.0, []
    for k in range(1, round(0.6 / substep)):
        time_ns = round(k * substep * 1e9)
        device.read(time_ns)
        truth = device.truth()
        way = [b - a for a, b in zip(before.position, truth.position, strict=True)]
        work += dot(truth.hand_force, way)
        kinetic = 0.5 * CirclingHand.mass * dot(truth.velocity, truth.velocity)
        found.append((truth.energy, work - kinetic))
        before = truth
    return found


@pytest.mark.parametrize("model", [FiveBar(), SerialArm(), SerialArm(joints=3)])
def test_the_energy_in_the_joints_is_that_at_the_tip(model: FiveBar | SerialArm) -> None:
    """It is exact in the joints; the hand's count at the tip approaches it with the step."""
    errors = []
    for substep in (4e-5, 1e-5):
        pairs = drawn(model, substep)
        assert max(joints for joints, _ in pairs) > 1e-3
        errors.append(max(abs(joints - tip) for joints, tip in pairs))
    assert errors[0] < 1e-4
    assert errors[1] < 0.3 * errors[0]


def test_an_arm_without_a_force_only_takes_energy(arm: Arm) -> None:
    energies = [joints for joints, _ in drawn(arm, 5e-5)]
    assert min(energies) >= 0.0
    kinetic = 0.5 * arm.inertia * 400.0  # more than it ever has: 20 rad/s
    assert all(b >= a - kinetic for a, b in pairwise(energies))


@given(
    torques=st.lists(st.tuples(*[st.floats(-0.3, 0.3)] * 3), min_size=5, max_size=40),
    friction=st.floats(0.0, 0.02),
    presliding=st.sampled_from([0.0, 1e-3]),
)
@settings(max_examples=25)
@pytest.mark.parametrize("name", ["five_bar", "planar", "spatial"])
def test_the_energy_balance_holds_to_rounding(
    name: str, torques: list[Vector], friction: float, presliding: float
) -> None:
    """The energy is kinetic, stored, lost or given to the motors, counted from the angles alone."""
    h = 5e-5
    arm = replace(
        ARMS[name], friction=friction, presliding=presliding, resolution=0.0, saturation=1.0
    )
    damping, inertia = arm.damping, arm.inertia
    assert isinstance(damping, float)
    device = arm.open(CirclingHand(stiffness=3000.0), hold_limit=1.0)
    angles = device.read(0)
    device.engage(0)
    speeds, bristles, spent = [0.0] * arm.axes, [0.0] * arm.axes, 0.0
    for k, torque in enumerate(torques):
        held = device.write(50_000 * k, torque[: arm.axes])
        turned = device.read(50_000 * (k + 1))
        for j, (after, before) in enumerate(zip(turned, angles, strict=True)):
            way = after - before
            spent += (damping * way / h + held[j]) * way
            end = 2.0 * way / h - speeds[j]
            if presliding:
                bristle = min(max(bristles[j] + way, -presliding), presliding)
                spent += friction * abs(way - (bristle - bristles[j]))
                bristles[j] = bristle
            else:
                spent += friction * abs(way)
                if end * way <= 0.0:  # it stops, and loses what it still had
                    spent += 0.5 * inertia * end * end
                    end = 0.0
            speeds[j] = end
        angles = turned
    stored = sum(0.5 * friction / (presliding or 1.0) * z * z for z in bristles)
    kinetic = 0.5 * inertia * dot(speeds, speeds)
    assert device.truth().energy == pytest.approx(kinetic + stored + spent, rel=1e-9, abs=1e-13)
    assert device.kinetic_energy() == pytest.approx(kinetic, rel=1e-9, abs=1e-13)
