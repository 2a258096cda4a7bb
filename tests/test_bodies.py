"""Rigid bodies in MuJoCo: what the hand feels, what moves, and scenes that cannot be used."""

import math
import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from launch_texts import problems_of, written

from forcebound.errors import ConfigError
from forcebound.graph.loader import load
from forcebound.haptics.environments import mujoco_scene, open_environment
from forcebound.haptics.environments.bodies import Bodies
from forcebound.haptics.environments.contract import check
from forcebound.run.virtual import run_virtual

FLOOR = """<mujoco><option timestep="0.001"/><worldbody>
<geom name="floor" type="plane" size="1 1 0.1" friction="0.5 0.005 0.0001"/>
{more}</worldbody></mujoco>"""
BOX = """<body name="box" pos="0.02 0 0.01"><freejoint/>
<geom name="box" type="box" size="0.01 0.01 0.01" mass="0.1" friction="0.5 0.005 0.0001"/></body>"""


def opened(folder: Path, more: str = "", axes: int = 3, **parameters: Any) -> Any:
    file = folder / "scene.xml"
    file.write_text(FLOOR.format(more=more))
    return open_environment(Bodies(file, **parameters), axes)


def moved(scene: Any, start: float, end: float, duration: float, z: float) -> list[tuple[Any, ...]]:
    """The forces on a hand that goes along x."""
    ticks = round(duration * 1e3)
    speed = (end - start) / duration
    return [
        scene.force("", (start + speed * i * 1e-3, 0.0, z), (speed, 0.0, 0.0), i * 1e-3)
        for i in range(ticks)
    ]


def test_floor_bears_the_hand_with_the_stiffness_of_the_coupling(tmp_path: Path) -> None:
    scene = opened(tmp_path, stiffness=800.0)
    for i in range(500):
        force = scene.force("", (0.0, 0.0, 0.002), (0.0, 0.0, 0.0), i * 1e-3)
    # The probe, a ball of 5 mm, lies on the floor: 3 mm above the hand. Positive z resists.
    assert force == pytest.approx((0.0, 0.0, -800.0 * 0.003), rel=0.05, abs=1e-3)
    contact = scene.contact("")
    assert contact.normal == pytest.approx((0.0, 0.0, 1.0), abs=1e-3)
    assert contact.proxy[2] == pytest.approx(0.005, abs=2e-4)


def test_free_motion_at_constant_speed_costs_no_force(tmp_path: Path) -> None:
    forces = moved(opened(tmp_path), -0.1, 0.1, 2.0, z=0.05)
    assert np.abs(np.array(forces[500:])).max() < 1e-9


def test_a_box_slides_when_pushed_with_the_force_of_its_friction(tmp_path: Path) -> None:
    scene = opened(tmp_path, BOX)
    forces = np.array(moved(scene, -0.01, 0.03, 2.0, z=0.008))
    box = next(one for one in scene.scene() if one.name == "box")
    assert not box.is_fixed
    assert box.position[0] == pytest.approx(0.03 + 0.005 + 0.01, abs=2e-3)  # before the probe
    assert forces[-400:, 0].mean() == pytest.approx(0.5 * 0.1 * 9.81, rel=0.1)


def test_scene_says_what_there_is_to_draw(tmp_path: Path) -> None:
    turned = BOX.replace('pos="0.02 0 0.01"', 'pos="0.02 0 0.01" euler="0 0 90"')
    objects = {one.name: one for one in opened(tmp_path, turned).scene()}
    assert set(objects) == {"floor", "box"}
    assert objects["floor"].shape == "plane"
    assert objects["floor"].is_fixed
    assert objects["box"].size == pytest.approx((0.02, 0.02, 0.02))
    half = math.sqrt(0.5)
    assert objects["box"].orientation == pytest.approx((half, 0.0, 0.0, half))


def test_new_stiffness_leaves_the_bodies_where_they_are(tmp_path: Path) -> None:
    scene = opened(tmp_path, BOX)
    moved(scene, -0.01, 0.03, 2.0, z=0.008)
    before = scene.scene()
    scene.change(Bodies(tmp_path / "scene.xml", stiffness=500.0))
    assert scene.scene() == before
    scene.change(Bodies(tmp_path / "scene.xml", probe_mass=0.02))  # a new scene
    assert scene.scene() != before


@pytest.mark.parametrize("tool", [None, "box"])
def test_bodies_that_fly_apart_begin_again(
    tmp_path: Path, tool: str | None, caplog: pytest.LogCaptureFixture
) -> None:
    scene = opened(tmp_path, BOX, tool=tool)
    moved(scene, -0.01, 0.0, 0.1, z=0.008)
    began = scene.scene()
    for again in (0.2, 0.4):
        scene._data.qvel[:] = 1e12
        force = scene.force("", (0.0, 0.0, 0.008), (0.0, 0.0, 0.0), again)
        assert all(map(math.isfinite, force))
        assert scene.scene()[1].position == pytest.approx(began[1].position, abs=1e-3)
        held_still = scene.force("", (0.0, 0.0, 0.008), (0.0, 0.0, 0.0), again + 0.001)
        assert abs(held_still[2]) < 5.0  # the probe is at the hand again
    assert caplog.text.count("the bodies flew apart") == 1


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("<mujoco><option timestep='1e-320'/></mujoco>", "timestep: expected"),
        (None, "scene.xml: No such file or directory; expected a scene in MJCF"),
        ("<mujoco><bla/></mujoco>", "unrecognized element Element 'bla'"),
        ("no xml", "scene.xml: XML"),
        (FLOOR.format(more="").replace("0.001", "0.01"), "is too much for a probe of 10 g"),
    ],
)
def test_a_scene_that_cannot_be_used_is_told_with_its_file(
    tmp_path: Path, text: str | None, words: str
) -> None:
    file = tmp_path / "scene.xml"
    if text is not None:
        file.write_text(text)
    with pytest.raises(ConfigError) as told:
        open_environment(Bodies(file), 3)
    assert words in str(told.value)
    graph = written(tmp_path, "include: push_boxes.yaml\nenvironment: {file: scene.xml}\n")
    assert words in problems_of(graph)


NESTED = "<replicate count='1000' offset='1 0 0'>"


@pytest.mark.parametrize(
    "text",
    [
        '<mujoco><include file="pipe.stl"/></mujoco>',
        f"<mujoco><worldbody>{NESTED * 4}<geom size='1'/>{'</replicate>' * 4}</worldbody></mujoco>",
    ],
)
def test_a_scene_without_end_is_refused_in_bounded_time(
    tmp_path: Path, text: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(mujoco_scene, "SECONDS", 2.0)
    os.mkfifo(tmp_path / "pipe.stl")
    with pytest.raises(ConfigError, match="took too long"):
        open_environment(Bodies(written(tmp_path, text, "scene.xml")), 3)


def test_a_scene_that_takes_too_much_memory_is_refused(tmp_path: Path) -> None:
    file = written(tmp_path, '<mujoco><size memory="60G"/></mujoco>', "scene.xml")
    with pytest.raises(ConfigError, match=r"scene.xml: .*memory"):
        open_environment(Bodies(file), 3)


def test_a_scene_is_a_regular_file(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "scene.xml")
    with pytest.raises(ConfigError, match="it is a pipe"):
        open_environment(Bodies(tmp_path / "scene.xml"), 3)


def test_a_hand_pushes_twenty_boxes_and_gets_no_energy() -> None:
    config = replace(load("push_boxes"), duration=1.0)
    columns = run_virtual(config).columns
    assert columns.true_energy.min() >= -1e-9
    assert columns.applied_force[:, 0].max() > 0.5  # five rows were pushed


SLIDE = """<body name="weight" pos="0.1 0.2 0.3"><joint type="slide" axis="0 0 1"/>
<geom name="ball" size="0.01" mass="0.2" solref="0.002 1"/>
<site name="top" pos="0 0 0.01"/></body>"""
LEVER = """<body name="lever" pos="0.3 0 0.1"><joint axis="0 0 1" stiffness="5" damping="0.1"/>
<geom type="capsule" size="0.005" fromto="0 0 0 0.1 0 0" mass="0.05"/>
<site name="end" pos="0.1 0 0"/></body>"""
MOCAP = """<body name="finger" mocap="true" pos="0 0 0.02" euler="0 0 30">
<geom name="finger" size="0.005"/></body>"""


def held(scene: Any, place: tuple[float, ...], duration: float = 1.0) -> Any:
    """The force on a hand that is taken from 0 m to a place within half of the time."""
    ticks = round(duration * 1e3)
    for i in range(ticks):
        share = min(2.0 * i / ticks, 1.0)
        force = scene.force("", tuple(share * x for x in place), (0.0,) * len(place), i * 1e-3)
    return force


@pytest.mark.parametrize("tool", ["weight", "top"])
def test_hand_bears_the_weight_of_its_tool(tmp_path: Path, tool: str) -> None:
    scene = opened(tmp_path, SLIDE, tool=tool, damping=20.0)
    assert scene.force("", (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.0) == (0.0, 0.0, 0.0)
    # The slide holds it in x and y, where the hand pulls on the coupling.
    expected = (1000.0 * 0.002, 0.0, 0.2 * 9.81)
    assert held(scene, (0.002, 0.0, 0.01)) == pytest.approx(expected, rel=1e-2, abs=1e-3)


def test_a_lever_resists_with_its_spring_behind_the_coupling(tmp_path: Path) -> None:
    force = held(opened(tmp_path, LEVER, tool="end"), (0.0, 0.001, 0.0), 2.0)
    springs = 1.0 / (1.0 / 1000.0 + 0.1**2 / 5.0)  # coupling and lever in series
    assert force[1] == pytest.approx(springs * 0.001, rel=1e-2)


def test_a_mocap_body_is_a_tool_that_feels_the_floor(tmp_path: Path) -> None:
    scene = opened(tmp_path, MOCAP, tool="finger", stiffness=800.0)
    assert held(scene, (0.01, 0.0, -0.010)) == pytest.approx((0.0, 0.0, 0.0), abs=1e-3)
    # Its ball of 5 mm meets the floor 15 mm below where the file has it.
    force = held(opened(tmp_path, MOCAP, tool="finger"), (0.0, 0.0, -0.018))
    assert force == pytest.approx((0.0, 0.0, -1000.0 * 0.003), rel=0.05, abs=1e-2)


def test_a_mocap_body_takes_along_what_is_welded_to_it(tmp_path: Path) -> None:
    file = tmp_path / "scene.xml"
    gripper = (
        '<body name="gripper" pos="0 0 0.02"><freejoint/><geom size="0.003" mass="0.1"/></body>'
    )
    text = FLOOR.format(
        more=MOCAP.replace('"0.005"', '"0.005" contype="0" conaffinity="0"') + gripper
    )
    weld = '<equality><weld body1="finger" body2="gripper" solref="0.004 1"/></equality></mujoco>'
    file.write_text(text.replace("</mujoco>", weld))
    scene: Any = open_environment(Bodies(file, tool="finger"), 3)
    force = held(scene, (0.02, 0.01, 0.03), 3.0)
    assert force == pytest.approx((0.0, 0.0, 0.1 * 9.81), abs=1e-2)
    [drawn] = [one for one in scene.scene() if one.name.startswith("gripper")]
    assert drawn.position == pytest.approx((0.02, 0.01, 0.03), abs=2e-3)  # where the hand is


def test_scene_and_contact_of_a_tool_are_in_the_coordinates_of_the_hand(tmp_path: Path) -> None:
    table = (
        '<geom name="table" type="box" pos="0.1 0.2 0.25" size="0.05 0.05 0.01" solref="0.002 1"/>'
    )
    scene = opened(tmp_path, table + SLIDE, tool="weight")
    held(scene, (0.0, 0.0, -0.035))
    [drawn] = [one for one in scene.scene() if one.name == "table"]
    assert drawn.position == pytest.approx((0.0, 0.0, -0.05))
    contact = scene.contact("")
    assert contact.proxy == pytest.approx((0.0, 0.0, -0.03), abs=3e-4)  # the ball on the table
    assert contact.normal == pytest.approx((0.0, 0.0, 1.0), abs=1e-3)


@pytest.mark.parametrize("name", ["tup", "box", "world", "floor"])
def test_a_tool_is_a_site_or_body_that_moves(tmp_path: Path, name: str) -> None:
    still = '<body name="box"><geom size="0.01"/></body>'
    with pytest.raises(ConfigError) as caught:
        opened(tmp_path, still + SLIDE, tool=name)
    assert caught.value.field == "tool"
    assert repr(name) in str(caught.value)
    assert str(caught.value).endswith("known: weight, top")


def test_a_held_arm_keeps_the_contract_and_gives_no_energy() -> None:
    config = load("hold_arm")
    assert check(config.environment.model, (1, 3), None, 60).violations == ()
    columns = run_virtual(replace(config, duration=2.0)).columns
    assert columns.true_energy.min() >= -1e-9
    # Hand of 300 N/m with its target at 30 mm, coupling, block against the wall at 18 mm.
    assert columns.applied_force[-1, 0] == pytest.approx(0.012 / (1 / 300 + 1 / 1000), rel=0.02)


def test_defaults_and_mocap_bodies_of_the_file_are_not_those_of_the_hand(tmp_path: Path) -> None:
    text = FLOOR.format(more=MOCAP).replace('type="plane"', 'type="plane" contype="1"')
    joint = '<joint armature="1" frictionloss="5" limited="true" range="-1e-3 1e-3"/>'
    defaults = f'<default>{joint}<geom contype="0" conaffinity="0"/></default>'
    file = written(tmp_path, text.replace("<worldbody>", defaults + "<worldbody>"), "scene.xml")
    scene: Any = open_environment(Bodies(file, stiffness=800.0), 3)
    force = held(scene, (0.0, 0.0, 0.002))
    assert force == pytest.approx((0.0, 0.0, -800.0 * 0.003), rel=0.05, abs=1e-2)
    [finger] = [one for one in scene.scene() if one.name == "finger"]
    assert finger.position == pytest.approx((0.0, 0.0, 0.02))


ARM = """<mujoco><option timestep="0.001" gravity="0 0 0"/><worldbody>
<body name="target" mocap="true" pos="0 0 0.1"><geom type="sphere" size="0.005"/></body>
<body name="lever" pos="0 0.2 0"><joint name="hinge" axis="0 0 1" damping="0.1"/>
<geom type="capsule" fromto="0 0 0 0.1 0 0" size="0.01" mass="0.1"/><site name="end" pos="0.1 0 0"/>
</body><body name="grip" pos="0 0 0.1"><freejoint/><geom type="box" size="0.01 0.01 0.01" mass="0.1"
contype="0" conaffinity="0"/></body><body name="mark" mocap="true"/></worldbody>
<actuator><position joint="hinge" kp="5"/></actuator>
<equality><weld body1="target" body2="grip" solref="0.004 1"/></equality>
<keyframe><key name="rest"/>
<key name="up" qpos="1.5707963 0.05 0 0.1 1 0 0 0" ctrl="1.5707963" mpos="0.05 0 0.1 0 0 0.3"/>
<key name="turned" mquat="0.7 0.7 0 0 1 0 0 0"/></keyframe></mujoco>"""


def at(scene: Any, body: str) -> Any:
    return scene._data.body(body).xpos


@pytest.mark.parametrize("tool", [None, "target", "end"])
def test_a_scene_begins_in_the_keyframe_that_is_named(tmp_path: Path, tool: str | None) -> None:
    file = written(tmp_path, ARM, "scene.xml")
    placed: Any = open_environment(Bodies(file, tool=tool), 3)
    assert placed._data.qpos[placed._scene.joint("hinge").qposadr[0]] == 0.0
    scene: Any = open_environment(Bodies(file, tool=tool, key="up"), 3)
    for _ in range(2):
        assert all(
            scene.force("", (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.0) == (0.0,) * 3 for _ in "ab"
        )
        assert scene._data.qpos[scene._scene.joint("hinge").qposadr[0]] == pytest.approx(np.pi / 2)
        assert scene._data.site("end").xpos == pytest.approx((0.0, 0.3, 0.0), abs=1e-6)
        assert at(scene, "target") == pytest.approx((0.05, 0.0, 0.1), abs=1e-6)
        assert at(scene, "grip") == pytest.approx((0.05, 0.0, 0.1), abs=1e-6)
        assert at(scene, "mark") == pytest.approx((0.0, 0.0, 0.3), abs=1e-6)
        scene._start_again()
    held(scene, (0.0, 0.0, 0.0), 0.5)  # nothing jumps or creeps away
    assert at(scene, "grip") == pytest.approx((0.05, 0.0, 0.1), abs=1e-4)
    assert scene._data.site("end").xpos == pytest.approx((0.0, 0.3, 0.0), abs=1e-4)
    if tool == "target":
        held(scene, (0.02, 0.0, 0.0), 1.0)
        assert at(scene, "grip") == pytest.approx((0.07, 0.0, 0.1), abs=1e-3)


@pytest.mark.parametrize(
    ("key", "words"), [("down", "known: rest, up, turned"), ("turned", "keeps its orientation")]
)
def test_a_keyframe_that_cannot_be_used_is_said(tmp_path: Path, key: str, words: str) -> None:
    file = written(tmp_path, ARM, "scene.xml")
    with pytest.raises(ConfigError, match="key: ") as caught:
        open_environment(Bodies(file, tool="target", key=key), 3)
    assert words in str(caught.value)


def test_a_robot_in_urdf_is_a_scene(tmp_path: Path) -> None:
    inertia = '<inertia ixx="1e-4" iyy="1e-4" izz="1e-4" ixy="0" ixz="0" iyz="0"/>'
    link = f'<link name="{{}}"><inertial><mass value="0.1"/>{inertia}</inertial></link>'
    joint = (
        '<joint name="slide" type="prismatic"><parent link="base"/><child link="tip"/>'
        '<axis xyz="1 0 0"/><limit lower="-1" upper="1" effort="9" velocity="9"/></joint>'
    )
    text = f'<robot name="r">{link.format("base")}{link.format("tip")}{joint}</robot>'
    file = written(tmp_path, text, "robot.urdf")
    scene: Any = open_environment(Bodies(file, tool="tip"), 3)
    assert held(scene, (0.02, 0.0, 0.0), 2.0) == pytest.approx((0.0, 0.0, 0.0), abs=1e-2)
    assert at(scene, "tip")[0] == pytest.approx(0.02, abs=1e-3)


STATE = (
    BOX
    + """<body name="arm-2" pos="0 0.3 0.2"><joint type="hinge"/>
<geom name="link" size="0.01" mass="0.1"/></body>"""
)


def test_the_state_of_a_scene_is_in_its_signals(tmp_path: Path) -> None:
    chosen = ("qpos", "qvel", "box", "contact box", "contact floor")
    scene = opened(tmp_path, STATE, record=chosen)
    moved(scene, -0.1, -0.1, 0.5, z=0.1)
    found = scene.published.numbers
    assert set(found) == {signal.name for signal in scene._model.declared()}
    assert [found[f"qpos_box_{axis}"] for axis in "xyz"] == pytest.approx((0.02, 0, 0.01), abs=1e-3)
    assert found["box_z"] == pytest.approx(found["qpos_box_z"], abs=1e-6)
    weight = 0.1 * 9.81  # N; the floor bears it
    assert found["contact_box_z"] == pytest.approx(weight, rel=0.01)
    assert found["contact_floor_z"] == pytest.approx(-weight, rel=0.01)
    assert "qpos_arm_2" in found
    units = {signal.name: signal.unit for signal in scene._model.declared()}
    assert (units["qpos_arm_2"], units["qvel_box_wx"], units["box_vx"]) == ("rad", "rad/s", "m/s")


def test_the_state_goes_with_a_pushed_body_and_back_at_a_reset(tmp_path: Path) -> None:
    scene = opened(tmp_path, BOX, record=("qpos", "box"))
    moved(scene, -0.01, 0.02, 0.5, z=0.01)
    found = scene.published.numbers
    before = found["box_x"]
    assert before > 0.021
    assert found["box_vx"] > 0.0
    assert found["qpos_box_x"] >= before  # one step ahead
    away = (-0.05, 0.0, 0.1), (0.0, 0.0, 0.0)
    for tick in range(500, 1000):
        scene.force("", *away, tick * 1e-3)
    assert scene.reset()
    force = scene.force("", *away, 1.0)
    assert found["qpos_box_x"] == pytest.approx(0.02, abs=1e-4)
    assert force == pytest.approx((0.0, 0.0, 0.0), abs=1e-6)
    assert not scene.published.events


def test_a_body_that_a_reset_puts_where_a_hand_is_makes_an_event(tmp_path: Path) -> None:
    scene = opened(tmp_path, BOX)
    moved(scene, -0.01, 0.02, 0.5, z=0.01)  # the box is pushed out of its place
    assert scene.reset()
    ((event, _, is_fault),) = scene.published.events
    assert (event, is_fault) == ("in_the_way", False)


SENSED = (
    STATE.replace('<joint type="hinge"/>', '<joint name="turn"/>')
    + """<body><joint name="slide" type="slide"/><geom size="0.01"/></body></worldbody>
<sensor><jointpos name="grip" joint="slide"/><jointpos name="angle" joint="turn"/>
<jointvel name="speed" joint="turn"/><jointactuatorfrc name="push" joint="slide"/></sensor>
<worldbody>"""
)


def test_a_sensor_of_a_joint_has_the_unit_of_its_type(tmp_path: Path) -> None:
    scene = opened(tmp_path, SENSED, record=("sensors",))
    units = {signal.name.removeprefix("sensor_"): signal.unit for signal in scene._model.declared()}
    assert units == {"grip": "m", "angle": "rad", "speed": "rad/s", "push": "N"}


@pytest.mark.parametrize(("name", "right"), [("boks", "box"), ("grip", "sensors")])
def test_a_name_that_the_state_does_not_have_is_refused(
    tmp_path: Path, name: str, right: str
) -> None:
    with pytest.raises(ConfigError, match=rf"expected .*\b{right}\b") as error:
        opened(tmp_path, SENSED, record=(name,))
    assert error.value.field == "record"
    assert "world" not in str(error.value).partition("got")[0]
