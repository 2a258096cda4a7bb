"""The codec: any bytes but those of a packet are rejected, with a reason."""

from collections.abc import Mapping
from typing import Any

import msgpack
import pytest
from golden_packets import (
    COMMAND,
    GOLDEN,
    QUERY,
    REPLY,
    SIMULATED_TELEMETRY,
    STATE,
    as_map,
    is_sound,
    numbers,
    outcome,
    packets,
    refusal,
    refused_map,
)
from hypothesis import given
from hypothesis import strategies as st
from msgspec import UnsetType
from msgspec.structs import fields, replace

from forcebound.errors import PacketError
from forcebound.messages.codec import MAX_BYTES, decode, encode
from forcebound.messages.packets import (
    MAX_AXES,
    MAX_COUNT,
    MAX_SIGNALS,
    TOPIC_OF,
    VERSION,
    DeviceState,
    Packet,
    Quaternion,
    SceneObject,
    Vector,
    field_types,
)


@pytest.fixture(params=sorted(GOLDEN))
def packet(request: pytest.FixtureRequest) -> Packet:
    return GOLDEN[request.param]


@given(st.binary(max_size=300))
def test_any_bytes_give_a_packet_or_a_refusal(data: bytes) -> None:
    assert is_sound(outcome(data))


json_like = st.recursive(
    st.none() | st.booleans() | st.integers(-(2**63), 2**64 - 1) | numbers | st.text(max_size=8)
    | st.binary(max_size=8),
    lambda inner: st.lists(inner, max_size=7) | st.dictionaries(st.text(max_size=8), inner),
    max_leaves=10,
)  # fmt: skip


def as_accepted(value: Any, accepted: Any) -> Any:
    """Integers where a number is expected are taken for the nearest float 64."""
    if isinstance(accepted, float) and isinstance(value, int) and not isinstance(value, bool):
        return float(value)
    if isinstance(accepted, list) and isinstance(value, list) and len(accepted) == len(value):
        return [as_accepted(*pair) for pair in zip(value, accepted, strict=True)]
    return value


@given(packets(), st.data())
def test_any_value_gives_that_value_or_a_refusal(packet: Packet, data: st.DataObject) -> None:
    message = as_map(packet)
    key = data.draw(st.sampled_from(sorted(message)))
    message[key] = data.draw(json_like)
    result = outcome(msgpack.packb(message))
    assert is_sound(result)
    if not isinstance(result, PacketError):
        accepted = as_map(result)[key]
        given_ = as_accepted(message[key], accepted)
        assert repr(accepted) == repr(given_) or accepted == given_  # nan is not itself


@pytest.mark.parametrize("value", [7, -7, 2**53 + 1, 2**64 - 1])
def test_an_integer_is_taken_for_the_nearest_number(value: int) -> None:
    state = DeviceState(0, 0, 0.0, (0.0,), (0.0,), (0.0,))
    packet = decode(msgpack.packb(as_map(state) | {"elapsed": value, "position": [value]}))
    assert isinstance(packet, DeviceState)
    assert (packet.elapsed, packet.position) == (float(value), (float(value),))


@given(packets(), st.data())
def test_flipped_bits_give_a_packet_or_a_refusal(packet: Packet, data: st.DataObject) -> None:
    damaged = bytearray(encode(packet))
    for _ in range(data.draw(st.integers(1, 4))):
        bit = data.draw(st.integers(0, 8 * len(damaged) - 1))
        damaged[bit // 8] ^= 1 << bit % 8
    assert is_sound(outcome(bytes(damaged)))


def test_every_shorter_or_longer_frame_is_malformed(packet: Packet) -> None:
    data = encode(packet)
    cut = [data[:length] for length in range(len(data))]
    assert {refusal(wrong).reason for wrong in (*cut, data + b"\0")} == {"malformed"}


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"\xc1",  # never used in msgpack
        b"\x91" * 3000 + b"\0",  # too deep
        b"\x81\xa1a" * 1300 + b"\0",  # maps within maps
        b"\xdd\xff\xff\xff\xff",  # claims 4 G entries
        b"\xdb\xff\xff\xff\xff",  # claims 4 GB of text
        b"\x81\x01\x01",  # a key that is not text
        b"\x81\x91\x01\x01",  # a key that cannot be a key
        b"\x93\x01\x02\x03",
        b"\xa4text",
        b"\xc0",
        b"\xd4\x05\x00",  # an extension
        b"\xd6\xff\x00\x00\x00\x00",  # a time stamp
        bytes(MAX_BYTES + 1),
    ],
    ids=lambda data: data[:6].hex() or "empty",
)
def test_what_is_not_one_map_with_text_keys_is_malformed(data: bytes) -> None:
    assert refusal(data).reason == "malformed"


@pytest.mark.parametrize("version", [0, VERSION + 1, -1, "1", 1.0, True, None])
def test_another_version_is_refused_as_such(packet: Packet, version: object) -> None:
    error = refused_map(as_map(packet) | {"version": version})
    assert error.reason == "version"
    assert str(VERSION) in str(error)
    assert repr(version) in str(error)


def test_every_key_without_a_default_is_needed(packet: Packet) -> None:
    needed = {field.name for field in fields(type(packet)) if field.required}
    for key in as_map(packet):
        message = as_map(packet)
        del message[key]
        if key in needed or (key in ("proxy", "normal") and message.keys() & {"proxy", "normal"}):
            error = refused_map(message, type(packet))
            assert error.reason == "value"
            assert key in str(error)
        else:
            missing = decode(msgpack.packb(message), type(packet))
            assert missing == replace(packet, **_defaults(packet, key))


def _defaults(packet: Packet, key: str) -> dict[str, Any]:
    """What a missing key stands for; the name of the packet is no field."""
    known = {field.name: field for field in fields(type(packet))}
    return {} if key == "packet" else {key: getattr(type(packet)(*_least(packet)), known[key].name)}


def _least(packet: Packet) -> list[Any]:
    return [getattr(packet, field.name) for field in fields(type(packet)) if field.required]


def test_keys_that_this_version_does_not_know_are_ignored(packet: Packet) -> None:
    later = {"temperature": {"skin": 36.6}, "deep": [[{}]], "more": b"x"}
    assert decode(msgpack.packb(as_map(packet) | later)) == packet


def test_of_a_key_given_twice_the_last_counts() -> None:
    message = as_map(COMMAND)
    body = b"".join(msgpack.packb(key) + msgpack.packb(value) for key, value in message.items())
    data = msgpack.Packer().pack_map_header(len(message) + 1) + body
    assert decode(data + msgpack.packb("seq") + b"\x09") == replace(COMMAND, seq=9)


@pytest.mark.parametrize(
    "name", ["\x1b[2J", "wall\n[device] all is well", "\x00", "\x9b31m", "a\u202eb", "a\u2028b"]
)
def test_a_name_that_a_terminal_would_obey_is_refused(name: str) -> None:
    for packet in (REPLY, replace(QUERY, environment="wall")):
        error = refused_map(as_map(packet) | {"environment": name})
        assert error.reason == "value"
        assert str(error).isprintable()
    named = replace(REPLY, environment="Wand 7 – grün")
    assert decode(encode(named)) == named


@pytest.mark.parametrize("name", ["devicestate", "", None, 1, ["device_state"]])
def test_an_unknown_packet_is_refused(name: object) -> None:
    assert refused_map(as_map(STATE) | {"packet": name}).reason == "value"


def test_another_packet_than_expected_is_refused(packet: Packet) -> None:
    for kind in TOPIC_OF:
        if kind is not type(packet):
            error = refusal(encode(packet), kind)
            assert error.reason == "value"
            assert TOPIC_OF[kind] in str(error)
            assert TOPIC_OF[type(packet)] in str(error)


UNFIT: dict[Any, list[object]] = {
    int: [-1, MAX_COUNT + 1, 2**64 - 1, 1.0, True, False, "1", b"1", [1], {}],
    float: [True, "0.5", b"", [0.5], {}],
    Vector: [
        [],
        [0.0] * (MAX_AXES + 1),
        [True],
        [False, 0.0],
        [0, True],
        [None],
        ["0"],
        [[0.0]],
        [b""],
        0.0,
        "0",
        b"\0" * 8,
        {},
        {"x": 0.0},
    ],
    Quaternion: [[], [1.0, 0.0, 0.0], [1.0] * 5, [True, 0.0, 0.0, 0.0], [None] * 4, 1.0, {}],
    tuple[SceneObject, ...]: [{}, 0, "ball", [0], [{}], [None], [{"name": "ball"}]],
    bool: [0, 1, 1.0, "true", b"", [], {}],
    str: ["x" * 501, 0, b"name", ["name"], {}],
    Mapping[str, str]: [[], 0, "age", {"age": 1}, {"age": b"1"}, {"age": "x" * 501}],
    Mapping[str, Vector]: [[], 0, "left", {"left": 1.0}, {"left": []}, {"left": None}],
    Mapping[str, float] | UnsetType: [
        [],
        {"age": None},
        {"age": True},
        {"of the skin": 1.0},
        {"": 1.0},
        {f"n{i}": 1.0 for i in range(MAX_SIGNALS + 1)},
    ],
    Mapping[str, int]: [[], 0, "age", {"age": -1}, {"age": True}, {"age": 0.5}, {"age": None}],
}


def test_every_key_refuses_what_does_not_fit(packet: Packet) -> None:
    for name, hint in field_types(type(packet)).items():
        kinds = [kind for kind in UNFIT if hint in (kind, kind | None, kind | UnsetType)]
        unfit = [value for kind in kinds for value in UNFIT[kind]]
        if hint in UNFIT:
            unfit.append(None)
        assert unfit
        for value in unfit:
            error = refused_map(as_map(packet) | {name: value})
            assert error.reason == "value", (name, value)
            assert name in str(error)


@pytest.mark.parametrize(
    "packet", [STATE, QUERY, REPLY, SIMULATED_TELEMETRY], ids=lambda p: type(p).__name__
)
def test_the_vectors_of_a_packet_have_one_length(packet: Packet) -> None:
    message = as_map(packet)
    hints = (Vector, Vector | None, Vector | UnsetType)
    vectors = [name for name, hint in field_types(type(packet)).items() if hint in hints]
    for key in vectors:
        if key not in message:
            continue
        error = refused_map(message | {key: [*message[key], 0.0]})
        assert error.reason == "value"
        assert "vectors of one length" in str(error)


def test_a_deep_value_is_refused() -> None:
    message = as_map(COMMAND)
    del message["force"]
    rest = b"".join(msgpack.packb(key) + msgpack.packb(value) for key, value in message.items())
    head = msgpack.Packer().pack_map_header(len(message) + 1)
    for depth in (900, 1000):  # the second is too deep for the stack where nothing is expected yet
        deep = msgpack.packb("force") + b"\x91" * depth + b"\x00"
        for body in (deep + rest, rest + deep):
            error = refusal(head + body)
            assert error.reason in ("value", "malformed")
            assert len(str(error)) < 400


def test_refusals_stay_short_and_printable_whatever_came() -> None:
    message = as_map(COMMAND)
    for key, value in [("force", "x" * 3000), ("packet", "\x1b[2J" * 700)]:
        error = str(refused_map(message | {key: value}))
        assert len(error) < 400
        assert error.isprintable()
