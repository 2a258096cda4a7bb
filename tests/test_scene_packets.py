"""Scenes and contacts on the wire, in recordings and in virtual time."""

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgpack
import numpy as np
import pytest
from launch_texts import GOOD, written
from mcap.reader import make_reader
from msgspec.structs import replace

from forcebound.errors import ConfigError, PacketError
from forcebound.graph.loader import load, load_tried
from forcebound.messages.codec import MAX_BYTES, MAX_SCENE_BYTES, decode, encode
from forcebound.messages.packets import (
    MAX_LENGTH,
    DeviceState,
    EnvironmentReply,
    Packet,
    Scene,
    SceneObject,
)
from forcebound.recordings.recording import Recorder, read
from forcebound.run.virtual import run_virtual
from forcebound.testing import parts

BALL = SceneObject("ball", "sphere", (0.1, 0.0, 0.0), size=(0.05,), is_fixed=False)
BUNNY = SceneObject("bunny", "mesh", file="bunny.stl", digest="0123456789abcdef" * 4)
PATH = SceneObject("path", "path", points=((0.0, 0.0, 0.0), (0.0, 0.0, 1.0)))
SCENE = Scene(0, 5, (BALL, BUNNY, PATH), {"": (0.1,)})
STATE = DeviceState(0, 0, 0.0, (0.1,), (0.0,), (0.0,), (0.5, -0.5, 0.5, 0.5), 3)
REPLY = EnvironmentReply(0, 0, 0, 0, 0, 0, (1.0,), "e", (0.01,), (-1.0,))


def refusal(message: dict[str, Any]) -> str:
    with pytest.raises(PacketError) as caught:
        decode(msgpack.packb(message))
    assert caught.value.reason == "value"
    return str(caught.value)


def scene_with(**changes: Any) -> dict[str, Any]:
    """The map of a scene of one ball with changes; None takes a key away."""
    message: dict[str, Any] = msgpack.unpackb(encode(replace(SCENE, objects=(BALL,))))
    ball = message["objects"][0] | changes
    return message | {"objects": [{k: v for k, v in ball.items() if v is not None}]}


# --- The wire ------------------------------------------------------------------------------------


def test_only_what_is_unusual_of_an_object_is_sent() -> None:
    message: dict[str, Any] = msgpack.unpackb(encode(replace(SCENE, objects=(PATH,))))
    assert message["objects"][0].keys() == {"name", "shape", "points"}


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"name": None}, "missing required field `name`"),
        ({"shape": "cone"}, "objects[0].shape"),
        ({"position": [0.0, 0.0]}, "objects[0].position"),
        ({"size": [0.1] * 4}, "objects[0].size"),
        ({"size": [math.inf]}, "finite numbers"),
        ({"points": [[0.0, math.nan, 0.0]]}, "finite numbers"),
        ({"points": [[0.0] * 3] * (MAX_LENGTH + 1)}, "objects[0].points"),
        ({"digest": "0" * 63}, "objects[0].digest"),
        ({"name": "a\nb"}, "printable text"),
        ({"file": "\x1b[2J"}, "printable text"),
        ({"is_fixed": 1}, "objects[0].is_fixed"),
    ],
)
def test_an_object_that_is_none_is_refused(changes: dict[str, Any], said: str) -> None:
    assert said in refusal(scene_with(**changes))


def test_a_scene_may_be_longer_than_other_packets_but_not_for_ever() -> None:
    box = SceneObject(
        "box", "box", (0.1, 0.1, 0.1), (0.5, 0.5, 0.5, 0.5), (0.1,) * 3, is_fixed=False
    )
    boxes = tuple(replace(box, name=f"box {place}") for place in range(MAX_LENGTH))
    data = encode(replace(SCENE, objects=boxes))
    assert MAX_BYTES < len(data) < MAX_SCENE_BYTES / 2
    assert decode(data) == decode(data, Scene) == replace(SCENE, objects=boxes)
    long = encode(replace(SCENE, objects=tuple(replace(b, file="x" * 500) for b in boxes)))
    for expected in (None, Scene, DeviceState):
        with pytest.raises(PacketError, match="expected at most"):
            decode(long, expected)
    with pytest.raises(PacketError, match=f"at most {MAX_BYTES} bytes"):
        decode(data, DeviceState)
    telemetry = msgpack.packb(msgpack.unpackb(encode(STATE)) | {"more": "x" * MAX_BYTES})
    with pytest.raises(PacketError):
        decode(telemetry)


@pytest.mark.parametrize("key", ["proxy", "normal"])
def test_a_contact_is_whole(key: str) -> None:
    message: dict[str, Any] = msgpack.unpackb(encode(REPLY))
    half = {"proxy": "normal", "normal": "proxy"}[key]
    assert f"got {half} alone" in refusal(message | {key: None})
    assert "vectors of one length" in refusal(message | {key: [0.0, 0.0]})


# --- Recordings ----------------------------------------------------------------------------------


def test_scenes_contacts_and_what_a_device_senses_come_back(tmp_path: Path) -> None:
    nowhere = replace(STATE, orientation=(math.nan, 0.0, 0.0, 0.0))
    lost = replace(REPLY, proxy=(math.nan,))
    sent: list[Packet] = [STATE, nowhere, REPLY, lost, SCENE, replace(SCENE, proxies={})]
    with Recorder(tmp_path / "run.mcap", {}) as recorder:
        for packet in sent:
            recorder.write(packet)
    recording = read(tmp_path / "run.mcap")
    back = [p for topic in ("device_state", "environment_reply", "scene")
            for p in recording.packets(topic)]  # fmt: skip
    assert repr(back) == repr(sent)  # repr: not-a-number equals itself


# --- Virtual time --------------------------------------------------------------------------------

PAD = Path(parts.__file__).read_text()


@pytest.mark.parametrize(
    ("right", "wrong", "said"),
    [
        (
            "self.touched = None",
            "self.touched = Contact((0.0, 0.0), (-1.0, 0.0))",
            "contact() after force",
        ),
        ("(self.pad.position, 0.0, 0.0)", "(self.pad.position,)", "scene() before the first query"),
    ],
)
def test_a_world_that_tells_nonsense_is_refused_before_the_run(
    tmp_path: Path, right: str, wrong: str, said: str
) -> None:
    written(tmp_path, PAD.replace(right, wrong), "pad.py")
    with pytest.raises(ConfigError) as caught:
        load_tried(written(tmp_path, GOOD.replace("kind: wall", "kind: pad.py")))
    assert f"environment: {said}" in str(caught.value)


@dataclass(frozen=True)
class Run:
    columns: Any
    recorded: Path


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    folder = tmp_path_factory.mktemp("pad")
    written(folder, PAD, "pad.py")
    config = load(written(folder, GOOD.replace("kind: wall", "kind: pad.py")))
    without = run_virtual(config, 1.0).columns
    run_virtual(config, 1.0, folder / "run.mcap")
    return Run(without, folder / "run.mcap")


def test_a_run_in_virtual_time_knows_its_contacts_with_and_without_a_recording(run: Run) -> None:
    columns = run.columns
    assert columns.is_answered[:-2].all()  # queries take 2 ms
    inside = ~np.isnan(columns.proxy[:, 0])
    assert 0 < inside.sum() < len(inside)
    assert (columns.proxy[inside] == 0.01).all()
    assert (columns.normal[inside] == -1.0).all()
    recorded = read(run.recorded).telemetry
    assert np.array_equal(recorded.proxy, columns.proxy, equal_nan=True)
    assert np.array_equal(recorded.position, columns.position)


def test_a_recorded_scene_follows_the_proxy(run: Run) -> None:
    scenes = [p for p in read(run.recorded).packets("scene") if isinstance(p, Scene)]
    assert [scene.proxies for scene in scenes[:2]] == [{}, {"hand": (0.01,)}]
    assert {scene.objects[0].shape for scene in scenes} == {"plane"}
    with run.recorded.open("rb") as file:
        written_scenes = [m for _, c, m in make_reader(file).iter_messages() if c.topic == "/scene"]
    assert len(written_scenes) == len(scenes)
    assert json.loads(written_scenes[0].data)["objects"][0]["name"] == "pad"
