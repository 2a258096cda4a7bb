"""The packets that have golden bytes, any other packets, and what decoding makes of bytes."""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, get_args

import msgpack
import pytest
from hypothesis import strategies as st
from msgspec import UNSET, UnsetType
from msgspec.structs import replace

from forcebound.errors import PacketError
from forcebound.messages.codec import decode, encode
from forcebound.messages.packets import (
    MAX_AXES,
    MAX_COUNT,
    MAX_ENERGY,
    MAX_NAME,
    SIGNAL_NAME,
    TOPIC_OF,
    DeviceState,
    EnergyTransfer,
    EnvironmentQuery,
    EnvironmentReply,
    Event,
    ForceCommand,
    Packet,
    Quaternion,
    Scene,
    SceneObject,
    Shape,
    Telemetry,
    Vector,
    field_types,
)

HERE = Path(__file__).parent
PAGE = (HERE.parent / "docs" / "protocol.md").read_text(encoding="utf-8")

TICK_NS = 123456789012345
STATE = DeviceState(
    seq=7,
    time_ns=TICK_NS,
    elapsed=0.0,
    position=(0.0125,),
    velocity=(0.25,),
    force=(-1.5,),
)
QUERY = EnvironmentQuery(
    seq=300,
    time_ns=123456789112345,
    device_seq=7,
    device_time_ns=TICK_NS,
    elapsed=0.5,
    position=(0.0125, -0.002),
    velocity=(0.25, 0.0),
    environment=None,
    orientation=(0.5, -0.5, 0.5, 0.5),
    buttons=5,
    measured_force=(-0.5, 0.0),
    hand="left",
)
REPLY = EnvironmentReply(
    seq=41,
    time_ns=9876543210,
    device_seq=7,
    device_time_ns=TICK_NS,
    query_seq=300,
    query_time_ns=123456789112345,
    force=(25.0, 0.0),
    environment="wall-7f3a",
    proxy=(0.01, -0.002),
    normal=(-1.0, 0.0),
    hand="left",
)
COMMAND = ForceCommand(
    seq=70000,
    time_ns=123456789312345,
    device_seq=7,
    device_time_ns=TICK_NS,
    force=(25.0,),
    reply_time_ns=123456749012345,
)
TELEMETRY = Telemetry(
    seq=7,
    time_ns=123456789412345,
    elapsed=0.5,
    position=(0.0126,),
    commanded_force=(8.5,),
    applied_force=(1.25,),
    force_limit=1.25,
    estimated_energy=0.001,
    true_energy=None,
    true_position=None,
    hand_force=None,
    engagement=1.0,
    device_seq=7,
    loop_delay=0.0004,
    deadline_misses=0,
    rejected={"not_finite": 1},
    read_ns=123456789400000,
    write_ns=123456789412345,
    ahead_ns=250,
    reply_age=0.0404,
    given_energy=0.25,
)
TRANSFER = EnergyTransfer(
    seq=7,
    time_ns=123456789412345,
    ledger=123456000000001,
    given=0.25,
    spare=-0.0625,
    seen_ledger=123455000000001,
    seen=0.5,
    hand="left",
)
SCENE = Scene(
    seq=12,
    time_ns=9876543210,
    objects=(
        SceneObject("ball", "sphere", (0.01, 0.0, 0.5), size=(0.05,), is_fixed=False),
        SceneObject("floor", "plane"),
    ),
    proxies={"left": (0.01, -0.002)},
)
EVENT = Event(
    seq=2,
    time_ns=123456789512345,
    node="controller",
    event="environment_serves",
    is_fault=False,
    message="environment wall-7f3a serves now",
    data={"environment": "wall-7f3a"},
)
SIMULATED_TELEMETRY = replace(
    TELEMETRY,
    true_energy=0.1,
    true_position=(0.1,),
    hand_force=(0.1,),
    joints=(0.1,),
    torques=(0.1,),
    cut_position=(0.1,),
    velocity=(0.1,),
)
GOLDEN: dict[str, Packet] = {
    "device_state": STATE,
    "environment_query": QUERY,
    "environment_reply": REPLY,
    "force_command": COMMAND,
    "telemetry": TELEMETRY,
    "energy_transfer": TRANSFER,
    "scene": SCENE,
    "event": EVENT,
}
REASONS = ("malformed", "version", "value")

numbers = st.floats()
counts = st.integers(0, MAX_COUNT)
names = st.text(min_size=1, max_size=MAX_NAME).filter(str.isprintable)
lengths = st.floats(allow_nan=False, allow_infinity=False)
points = st.tuples(lengths, lengths, lengths)
signals = st.dictionaries(st.from_regex(SIGNAL_NAME, fullmatch=True), numbers, max_size=4)
objects = st.builds(
    SceneObject,
    names,
    st.sampled_from(get_args(Shape)),
    points,
    st.tuples(lengths, lengths, lengths, lengths),
    st.lists(lengths, max_size=3).map(tuple),
    st.booleans(),
    st.booleans(),
    st.none() | names,
    st.none() | st.just("0" * 64),
    st.lists(points, max_size=4).map(tuple),
)


@st.composite
def packets(draw: st.DrawFn, kind: type[Packet] | None = None) -> Packet:
    """Any packet, of 1 to 8 axes."""
    chosen: type[Packet] = kind or draw(st.sampled_from(list(TOPIC_OF)))
    vectors = st.tuples(*[numbers] * draw(st.integers(1, MAX_AXES)))
    strategies: dict[Any, st.SearchStrategy[Any]] = {
        int: counts,
        float: numbers,
        Vector: vectors,
        int | None: st.none() | counts,
        float | None: st.none() | numbers,
        Vector | None: st.none() | vectors,
        Vector | UnsetType: st.just(UNSET) | vectors,
        str: names,
        bool: st.booleans(),
        str | None: st.none() | names,
        Quaternion | None: st.none() | st.tuples(*[numbers] * 4),
        tuple[SceneObject, ...]: st.lists(objects, max_size=3).map(tuple),
        Mapping[str, str]: st.dictionaries(st.text(max_size=20), st.text(max_size=40), max_size=16),
        Mapping[str, Vector]: st.dictionaries(names, vectors, max_size=3),
        Mapping[str, int]: st.dictionaries(st.text(max_size=20), counts, max_size=32),
        Mapping[str, float] | UnsetType: st.just(UNSET) | signals,
    }
    values = {name: draw(strategies[hint]) for name, hint in field_types(chosen).items()}
    if chosen is EnergyTransfer:
        values["given"] = draw(st.floats(0.0, MAX_ENERGY))
        values["seen"] = draw(st.none() | st.floats(0.0, MAX_ENERGY))
    if chosen is EnvironmentReply and values["normal"] is None:
        values["proxy"] = None
    elif chosen is EnvironmentReply and values["proxy"] is None:
        values["normal"] = None
    return chosen(**values)


def same(one: Packet, other: Packet) -> bool:
    """Equal, where not-a-number equals itself."""
    return repr(one) == repr(other)


def golden_bytes(text: str) -> bytes:
    """Bytes of an annotated hex dump: what follows a # is a comment."""
    return bytes.fromhex(re.sub(r"#.*", "", text))


def as_map(packet: Packet) -> dict[str, Any]:
    message: dict[str, Any] = msgpack.unpackb(encode(packet))
    return message


def refusal(data: bytes, expected: type[Packet] | None = None) -> PacketError:
    with pytest.raises(PacketError) as caught:
        decode(data, expected)
    return caught.value


def outcome(data: bytes, *expected: type[Packet]) -> Packet | PacketError:
    """What decoding gives; any other exception is a failure."""
    try:
        return decode(data, *expected)
    except PacketError as error:
        return error


def is_sound(result: Packet | PacketError) -> bool:
    return result.reason in REASONS if isinstance(result, PacketError) else type(result) in TOPIC_OF


def refused_map(message: Any, expected: type[Packet] | None = None) -> PacketError:
    return refusal(msgpack.packb(message), expected)
