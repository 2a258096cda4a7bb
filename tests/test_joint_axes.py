"""Axes that are angles: units of launch files and of results, energies, coupling by joint."""

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from launch_texts import problems_of, written

import forcebound as fb
from forcebound.axes import Axis, lengths
from forcebound.errors import ConfigError
from forcebound.graph.loader import from_document, load
from forcebound.graph.model import restore
from forcebound.graph.parameters import change, parameters
from forcebound.graph.resolved import run_document, to_document
from forcebound.haptics.devices.joint_device import Joints
from forcebound.haptics.devices.knob import Knob
from forcebound.haptics.devices.phantom import PhantomPremium15
from forcebound.haptics.devices.serial_arm import SerialArm
from forcebound.haptics.environments.coupling import Coupling
from forcebound.haptics.environments.walls import Wall
from forcebound.haptics.hands.hands import PressingHand
from forcebound.messages.packets import DeviceState, Telemetry
from forcebound.observe.formatting import as_written
from forcebound.recordings.export import export
from forcebound.recordings.recording import read
from forcebound.recordings.schema import schema
from forcebound.results.panels import PANELS
from forcebound.results.tables import summary_rows
from forcebound.run.results import RunResult
from forcebound.run.virtual import run_virtual, run_virtual_hands

ARM = """\
forcebound: 1
description: three joints
seed: 1
duration: 0.5 s
device: { kind: joints, joints: [lift, elbow, wrist], law: certified }
operator: { kind: pressing, start: 0 deg, end: [20 deg, 10 deg, 5 deg], approach_speed: 90 deg/s }
environment: { kind: wall, position: 10 deg, stiffness: 5 N m/rad }
"""
MIXED = """\
forcebound: 1
description: a lift and a wrist
seed: 1
duration: 0.5 s
device:
  kind: joints
  joints: [lift, wrist]
  prismatic: [lift]
  inertia: [200 g, 1e-3 kg m^2]
  friction: [0.2 N, 20 mN m]
  resolution: [0.05 mm, 0.05 deg]
  largest_speed: null
operator: { kind: pressing, start: [0 mm, 0 deg], end: [20 mm, 20 deg], stiffness: 20 }
environment: { kind: damper, damping: 0.5 }
"""


def graph_of(device: Any, operator: Any, environment: Any, law: str) -> fb.Graph:
    servo = fb.Servo(law=law)
    hands = {"hand": fb.Hand(device=device, servo=servo, operator=operator)}
    return fb.Graph(seed=1, duration=0.4, hands=hands, environment=environment)


def columns_of(device: Any, operator: Any, environment: Any, law: str) -> Any:
    return run_virtual(graph_of(device, operator, environment, law), 0.4).columns


def on_a_lever(
    r: float, law: str, resolution: float, stiffness: float, speed: float | None = None
) -> tuple[Any, Any]:
    """Return the columns of a straight axis, and of a joint that is the same at a lever."""
    straight = PhantomPremium15(resolution=resolution, hand_speed=speed)
    hand = PressingHand(approach_speed=0.2)
    turned = Joints(
        joints=("hinge",),
        inertia=straight.mass * r * r,
        damping=0.27 * r * r,
        friction=0.12 * r,
        resolution=resolution / r,
        saturation=straight.saturation * r,
        largest_speed=5.0 / r,
        hand_speed=None if speed is None else speed / r,
    )
    round_hand = PressingHand(
        mass=hand.mass * r * r,
        stiffness=hand.stiffness * r * r,
        damping=hand.damping * r * r,
        start=-0.010 / r,
        end=0.014 / r,
        approach_speed=0.2 / r,
    )
    wall, round_wall = Wall(stiffness=stiffness), Wall(stiffness * r * r, position=0.010 / r)
    return columns_of(straight, hand, wall, law), columns_of(turned, round_hand, round_wall, law)


# --- Energies ------------------------------------------------------------------------------------


@settings(max_examples=8, deadline=None)
@given(
    power=st.integers(1, 6),
    law=st.sampled_from(["none", "certified"]),
    k=st.floats(500.0, 20_000.0),
    speed=st.sampled_from([None, 0.15, 2.0]),
)
def test_a_joint_has_the_energies_of_the_straight_axis_at_its_lever(
    power: int, law: str, k: float, speed: float | None
) -> None:
    straight, turned = on_a_lever(0.5**power, law, 3e-5, k, speed)
    np.testing.assert_array_equal(turned.true_energy, straight.true_energy)
    np.testing.assert_array_equal(turned.estimated_energy, straight.estimated_energy)
    np.testing.assert_array_equal(turned.position * 0.5**power, straight.position)


@settings(max_examples=4, deadline=None)
@given(r=st.floats(0.02, 0.5))
def test_at_any_lever_they_are_equal_within_rounding(r: float) -> None:
    straight, turned = on_a_lever(r, "certified", 0.0, 5000.0)
    np.testing.assert_allclose(turned.true_energy, straight.true_energy, rtol=1e-6, atol=1e-12)


@pytest.mark.parametrize("law", ["none", "certified"])
def test_a_knob_in_its_joint_does_to_the_hand_what_it_does_at_its_tip(law: str) -> None:
    r, hand = 0.5**5, PressingHand(mass=0.1, stiffness=400.0, damping=2.0)
    tip = columns_of(Knob(lever=r), hand, Wall(2000.0), law)
    wall = Wall(2000.0 * r * r, position=0.010 / r)
    joint = columns_of(Knob(lever=r, space="joints"), hand, wall, law)
    np.testing.assert_allclose(joint.true_energy, tip.true_energy, rtol=1e-9, atol=1e-15)
    np.testing.assert_allclose(joint.position, tip.joints, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(joint.applied_force, tip.torques, rtol=1e-9, atol=1e-12)


def test_an_arm_in_its_joints_shows_angles_and_takes_torques() -> None:
    arm = SerialArm(space="joints", resolution=0.0)
    assert [axis.kind for axis in arm.named_axes] == ["angle", "angle"]
    columns = columns_of(arm, PressingHand(), Wall(0.5, position=1e6), "certified")
    assert columns.position[0] == pytest.approx(arm.angles((-0.010, 0.0)), abs=1e-6)
    np.testing.assert_array_equal(columns.position[:-1], columns.true_position[:-1])


# --- Launch files --------------------------------------------------------------------------------


def test_quantities_are_read_in_the_unit_of_the_axes(tmp_path: Path) -> None:
    config = load(written(tmp_path, ARM))
    hand: Any = config.only.operator
    wall: Any = config.environment.model
    assert hand.end == pytest.approx(np.deg2rad((20, 10, 5)))
    assert (wall.position, wall.stiffness) == pytest.approx((np.deg2rad(10), 5.0))
    # Those of a hand for lengths, at a lever of 0.1 m.
    assert (hand.mass, hand.stiffness) == pytest.approx((2.75e-3, 9.5))


@pytest.mark.parametrize(
    ("text", "old", "new", "at", "kind"),
    [
        (ARM, "position: 10 deg", "position: 10 mm", "10 mm", "rad"),
        (ARM, "stiffness: 5 N m/rad", "stiffness: 5 N/mm", "5 N/mm", "N m/rad"),
        (ARM, "[20 deg, 10 deg", "[20 deg, 10 mm", "10 mm", "rad"),
        (ARM, "90 deg/s", "90 mm/s", "90 mm/s", "rad/s"),
        (MIXED, "end: [20 mm", "end: [20 deg", "20 deg", "in m"),
        (MIXED, "stiffness: 20", "stiffness: 20 N/m", "20 N/m", "a list"),
        (MIXED, "largest_speed: null", "hand_speed: 2", "2\n", "hand_speed|largest_speed"),
        (MIXED, "friction: [0.2 N, 20 mN m]", "friction: 0.2", "0.2\n", "friction"),
        (MIXED, "prismatic: [lift]", "prismatic: [lft]", "[lft]", "lift, wrist"),
    ],
)
def test_a_quantity_of_the_other_kind_is_refused_at_its_place(
    tmp_path: Path, text: str, old: str, new: str, at: str, kind: str
) -> None:
    changed = text.replace(old, new)
    before = changed[: changed.index(at, changed.index(new))]
    line, column = before.count("\n") + 1, len(before) - before.rfind("\n")
    problems = problems_of(written(tmp_path, changed))
    assert re.search(rf"graph\.yaml:{line}:{column}: .*({kind})", problems), problems


def test_a_wrong_device_is_no_reason_to_refuse_angles(tmp_path: Path) -> None:
    with pytest.raises(ConfigError) as raised:
        load(written(tmp_path, ARM.replace("law: certified", "lw: certified")))
    assert "deg" not in str(raised.value)


def test_hands_in_one_environment_have_axes_of_the_same_kinds() -> None:
    hands = {
        "leader": fb.Hand(device=Joints(joints=("elbow",))),
        "follower": fb.Hand(device=PhantomPremium15()),
    }
    with pytest.raises(ConfigError, match=r"length.* angle"):
        fb.Graph(seed=1, duration=1.0, hands=hands, environment=Coupling())


def test_names_and_kinds_of_axes_are_in_the_document_of_a_run(tmp_path: Path) -> None:
    config = load(written(tmp_path, ARM))
    document = json.loads(json.dumps(to_document(config)))
    assert document["hands"]["hand"]["axes"][1] == {"name": "elbow", "kind": "angle"}
    assert from_document(document) == config
    apart = restore(json.loads(json.dumps(run_document(config)))).only
    assert apart.named_axes == tuple(Axis(n, "angle") for n in ("lift", "elbow", "wrist"))
    assert "axes" not in to_document(load("stiff_wall"))["hands"]["hand"]
    document["hands"]["hand"]["axes"][1]["name"] = "knee"
    with pytest.raises(ConfigError, match="axes"):
        from_document(document)


def test_a_parameter_is_shown_in_its_unit_and_taken_back(tmp_path: Path) -> None:
    config, name = load(written(tmp_path, ARM)), "environment.stiffness"
    shown = as_written(config, {name: parameters(config)[name]})[name]
    assert shown == "5 N m/rad"
    assert change(config, {name: "7 N m/rad"}) != config
    with pytest.raises(ConfigError, match="N m/rad"):
        change(config, {name: "7 N/mm"})


# --- Results -------------------------------------------------------------------------------------


def result_of(folder: Path, text: str) -> RunResult:
    run_virtual(load(written(folder, text)), 0.5, folder / "run.mcap")
    return RunResult.from_recording(folder / "run.mcap")


def test_results_tables_and_plots_speak_in_the_unit_of_the_axes(tmp_path: Path) -> None:
    result = result_of(tmp_path, ARM)
    summary = result.summary
    assert summary["units"]["peak_penetration_m"] == "rad"
    assert summary["axes"]["elbow"] == "angle"
    rows = dict(summary_rows(summary))
    assert rows["peak force"].endswith("N m")
    assert rows["peak penetration"].endswith("rad")
    assert PANELS["position"].label("angle") == "position (rad)"
    assert PANELS["force"].label("angle") == "torque (N m)"
    run = fb.read(tmp_path / "run.mcap")
    assert run.figures.peak_force.unit == "N m"
    assert [axis.name for axis in run.axes] == ["lift", "elbow", "wrist"]


def test_of_lengths_and_angles_there_is_no_common_size(tmp_path: Path) -> None:
    summary = result_of(tmp_path, MIXED).summary
    assert summary["peak_force_n"] is None
    assert summary["final_speed_m_per_s"] is None
    assert set(summary["peak_force_by_axis"]) == {"lift", "wrist"}
    assert summary["true_energy_min_j"] is not None


def test_columns_and_schemas_say_the_unit_of_each_axis(tmp_path: Path) -> None:
    result_of(tmp_path, ARM)
    export(read(tmp_path / "run.mcap"), tmp_path / "csv")
    described = (tmp_path / "csv" / "columns.csv").read_text().splitlines()
    assert any(row.startswith("telemetry,position[1],rad,elbow:") for row in described)
    assert any(row.startswith("telemetry,force_limit,N m,") for row in described)
    axes = (Axis("lift"), Axis("wrist", "angle"))
    assert schema(DeviceState, axes=axes)["properties"]["position"]["unit"] == "m or rad"
    assert schema(Telemetry)["properties"]["position"]["unit"] == "m"


# --- Coupling ------------------------------------------------------------------------------------


def test_each_joint_has_a_scale_an_offset_and_a_stiffness_of_its_own() -> None:
    model = Coupling(stiffness=(8.0, 2.0), damping=0.0, scale=(1.0, -0.5), offset=(0.0, 0.1))
    coupled = model.open(2)
    coupled.force("leader", (0.2, 0.4), (0.0, 0.0), 0.0)
    on_follower = coupled.force("follower", (0.1, 0.3), (0.0, 0.0), 0.0)
    on_leader = coupled.force("leader", (0.2, 0.4), (0.0, 0.0), 0.0)
    errors = (0.2 - 0.1, -0.5 * 0.4 + 0.1 - 0.3)
    assert on_follower == pytest.approx((-8.0 * errors[0], -2.0 * errors[1]))
    assert on_leader == pytest.approx((8.0 * errors[0], 2.0 * -0.5 * errors[1]))


@pytest.mark.parametrize("field", ["stiffness", "damping", "scale", "force_scale"])
def test_a_coupling_takes_one_number_or_one_of_each_axis(field: str, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=field):
        replace(Coupling(), **{field: cast("Any", (1.0, 1.0))}).open(3)
    path = tmp_path / "arms.yaml"
    unit = {"stiffness": " N m/rad", "damping": " N m s"}.get(field, "")
    numbers = f"[1{unit}, 1{unit}]"
    path.write_text(
        f"forcebound: 1\ninclude: joint_arms.yaml\nenvironment: {{{field}: {numbers}}}\n"
    )
    with pytest.raises(ConfigError, match=rf"arms.yaml:3:\d+: environment: {field}"):
        load(path)
    with pytest.raises(ConfigError, match="force_scale"):
        Coupling(scale=(1.0, 1.0), force_scale=(1.0, -1.0))


@pytest.mark.parametrize("delay", ["0 ms", "20 ms"])
def test_arms_of_seven_joints_are_coupled_and_passive(delay: str) -> None:
    config = replace(load("joint_arms", [f"delay:={delay}"]), duration=2.0)
    assert len(config.hands["leader"].named_axes) == 7
    results = run_virtual_hands(config)
    leader, follower = (results[name].columns for name in ("leader", "follower"))
    together = leader.true_energy + follower.true_energy
    assert leader.true_energy.min() >= -1e-9
    assert together.min() >= -1e-9
    if delay == "0 ms":  # at rest each torque is that of the joint's spring
        error = leader.position[-1] - follower.position[-1]
        np.testing.assert_allclose(leader.applied_force[-1], 8.0 * error, atol=0.02)
        assert np.abs(follower.position[-1, 1:]).min() > 0.1
        wall = 10.0 * (follower.true_position[-1, 0] - np.deg2rad(15))
        assert abs(wall - 8.0 * error[0]) < 0.06  # friction of the joint


def test_unnamed_axes_are_lengths() -> None:
    assert [axis.name for axis in lengths(4)] == ["x", "y", "z", "axis 4"]
    assert PhantomPremium15(axes=8).named_axes == lengths(8)
