"""The codec: any bytes but those of a packet are rejected, with a reason."""

import tracemalloc
from collections.abc import Mapping
from typing import Any

import msgpack
import pytest
from golden_packets import (
    COMMAND,
    GOLDEN,
    QUERY,
    REASONS,
    REPLY,
    SIMULATED_TELEMETRY,
    STATE,
    TELEMETRY,
    as_map,
    is_sound,
    numbers,
    outcome,
    packets,
    refusal,
    refused_map,
    same,
)
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from forcebound.errors import PacketError
from forcebound.messages.codec import MAX_BYTES, decode, encode
from forcebound.messages.packets import (
    MAX_AXES,
    MAX_COUNT,
    TOPIC_OF,
    TOPICS,
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


@given(packets(), packets(), st.data())
def test_spliced_frames_give_a_packet_that_comes_back_or_a_refusal(
    one: Packet, other: Packet, data: st.DataObject
) -> None:
    head, tail = encode(one), encode(other)
    cut = data.draw(st.integers(0, len(head)))
    joint = data.draw(st.integers(0, len(tail)))
    result = outcome(head[:cut] + data.draw(st.binary(max_size=8)) + tail[joint:])
    assert is_sound(result)
    if not isinstance(result, PacketError):
        assert same(decode(encode(result)), result)


@given(st.binary(max_size=300), st.sampled_from(list(TOPIC_OF)))
def test_whatever_is_expected_any_bytes_give_it_or_a_refusal(
    data: bytes, kind: type[Packet]
) -> None:
    result = outcome(data, kind)
    if isinstance(result, PacketError):
        assert result.reason in REASONS
    else:
        assert type(result) is kind


def test_every_shorter_frame_is_malformed(packet: Packet) -> None:
    data = encode(packet)
    assert {refusal(data[:length]).reason for length in range(len(data))} == {"malformed"}


def test_trailing_bytes_are_malformed(packet: Packet) -> None:
    assert refusal(encode(packet) + b"\0").reason == "malformed"


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"\xc1",  # never used in msgpack
        b"\x91" * 3000 + b"\0",  # too deep
        b"\x81\xa1a" * 1300 + b"\0",  # maps within maps
        b"\xdd\xff\xff\xff\xff",  # claims 4 G entries
        b"\xdf\xff\xff\xff\xff",
        b"\xdb\xff\xff\xff\xff",  # claims 4 GB of text
        b"\xc6\xff\xff\xff\xff",
        b"\xc9\xff\xff\xff\xff\x01",
        b"\x81\xa1a\xdc\x00\x41" + b"\0" * 65,  # an array longer than any in a packet
        b"\xde\x00\x41" + b"".join(b"\xa1%c\0" % i for i in range(65)),
        b"\x81\xa1\xff\0",  # a key that is not UTF-8
        b"\x81\x01\x01",  # a key that is not text
        b"\x81\x91\x01\x01",  # a key that cannot be a key
        b"\x81\xa1a\xc7\x0c\xff" + b"\xff" * 12,  # a time stamp out of range
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


def test_hostile_nesting_allocates_little() -> None:
    data = (b"\xdc\x00\x40" * 2000)[:MAX_BYTES]  # arrays of 64 within arrays of 64
    refusal(data)
    tracemalloc.start()
    try:
        refusal(data)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 2_000_000


@pytest.mark.parametrize("version", [0, VERSION + 1, -1, "1", 1.0, True, None])
def test_another_version_is_refused_as_such(packet: Packet, version: object) -> None:
    error = refused_map(as_map(packet) | {"version": version})
    assert error.reason == "version"
    assert f"expected version {VERSION}" in str(error)
    assert repr(version) in str(error)


def test_another_version_may_have_other_keys() -> None:
    assert refused_map({"version": VERSION + 1, "name": "state"}).reason == "version"


def test_every_key_is_needed(packet: Packet) -> None:
    for key in as_map(packet):
        message = as_map(packet)
        del message[key]
        error = refused_map(message, type(packet))
        assert error.reason == "keys"
        assert repr(key) in str(error) or key == "packet"


def test_no_other_key_is_accepted(packet: Packet) -> None:
    error = refused_map(as_map(packet) | {"stiffness": 1.0})
    assert error.reason == "keys"
    assert "unknown 'stiffness'" in str(error)


def test_a_misspelt_key_is_named(packet: Packet) -> None:
    message = as_map(packet)
    message["time"] = message.pop("time_ns")
    error = refused_map(message)
    assert error.reason == "keys"
    assert "missing 'time_ns' and unknown 'time'" in str(error)


def test_a_key_given_twice_is_refused(packet: Packet) -> None:
    message = as_map(packet)
    body = b"".join(msgpack.packb(key) + msgpack.packb(value) for key, value in message.items())
    count = len(message) + 1
    for head in (b"\x80", b"\xde\0\0", b"\xdf\0\0\0\0"):
        if count < 16 or len(head) > 1:
            data = head[:-1] + bytes([head[-1] | count]) + body + msgpack.packb("seq") + b"\x09"
            error = refusal(data)
            assert error.reason == "keys"
            assert "duplicate key" in str(error)


def test_a_key_given_twice_does_not_stand_in_for_a_missing_one(packet: Packet) -> None:
    for missing in as_map(packet):
        pairs = [(key, value) for key, value in as_map(packet).items() if key != missing]
        pairs.append(("time_ns" if missing == "seq" else "seq", 9))
        body = b"".join(msgpack.packb(key) + msgpack.packb(value) for key, value in pairs)
        error = refusal(msgpack.Packer().pack_map_header(len(pairs)) + body, type(packet))
        assert error.reason == "keys"


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
def test_an_unknown_packet_is_refused_with_the_known_names(name: object) -> None:
    error = refused_map(as_map(STATE) | {"packet": name})
    assert error.reason == "keys"
    assert all(topic in str(error) for topic in TOPICS)


def test_another_packet_than_expected_is_refused(packet: Packet) -> None:
    for kind in TOPIC_OF:
        if kind is not type(packet):
            error = refusal(encode(packet), kind)
            assert error.reason == "keys"
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
    Mapping[str, int]: [[], 0, "age", {"age": -1}, {"age": True}, {"age": 0.5}, {"age": None}],
}


def test_every_key_refuses_what_does_not_fit(packet: Packet) -> None:
    for name, hint in field_types(type(packet)).items():
        kinds = [kind for kind in UNFIT if hint in (kind, kind | None)]
        unfit = [value for kind in kinds for value in UNFIT[kind]]
        if hint in UNFIT:
            unfit.append(None)
        assert unfit
        for value in unfit:
            error = refused_map(as_map(packet) | {name: value})
            assert error.reason == "value", (name, value)
            assert f"{TOPIC_OF[type(packet)]}: {name}" in str(error)
            assert " must be " in str(error)


def test_a_refused_value_is_named_with_what_was_expected_and_what_came() -> None:
    message = as_map(TELEMETRY) | {"device_seq": -1}
    assert str(refused_map(message)) == ("telemetry: device_seq must be `int` >= 0, got -1")


@pytest.mark.parametrize("value", [b"\0" * 200, msgpack.ExtType(5, b"12345678")])
def test_packed_arrays_of_floats_are_refused_as_values(value: object) -> None:
    error = refused_map(as_map(COMMAND) | {"force": value})
    assert error.reason == "value"
    assert "force must be `array`" in str(error)


@pytest.mark.parametrize(
    "packet", [STATE, QUERY, REPLY, SIMULATED_TELEMETRY], ids=lambda p: type(p).__name__
)
def test_the_vectors_of_a_packet_have_one_length(packet: Packet) -> None:
    message = as_map(packet)
    vectors = [
        name for name, hint in field_types(type(packet)).items() if hint in (Vector, Vector | None)
    ]
    for key in vectors:
        error = refused_map(message | {key: [*message[key], 0.0]})
        assert error.reason == "value"
        assert "vectors of one length" in str(error)


def test_a_deep_value_is_refused_as_a_value() -> None:
    message = as_map(COMMAND)
    del message["force"]
    rest = b"".join(msgpack.packb(key) + msgpack.packb(value) for key, value in message.items())
    for depth in (900, 1000):  # the second is too deep for the stack where nothing is expected yet
        deep = msgpack.packb("force") + b"\x91" * depth + b"\x00"
        for body in (deep + rest, rest + deep):
            error = refusal(b"\x88" + body)
            assert error.reason == "value"
            assert len(str(error)) < 400


def test_refusals_stay_short_whatever_came() -> None:
    message = as_map(COMMAND)
    for key, value in [("force", "x" * 3000), ("packet", "y" * 3000), ("z" * 3000, 0)]:
        assert len(str(refused_map(message | {key: value}))) < 400
