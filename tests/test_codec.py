"""The codec: golden bytes; any other bytes give a packet or a rejection."""

import math
import re
import tracemalloc
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any, get_args

import msgpack
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from forcebound.errors import PacketError
from forcebound.messages.codec import MAX_BYTES, decode, encode
from forcebound.messages.packets import (
    MAX_AXES,
    MAX_COUNT,
    MAX_NAME,
    TOPIC_OF,
    TOPICS,
    VERSION,
    DeviceState,
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
)
COMMAND = ForceCommand(
    seq=70000, time_ns=123456789312345, device_seq=7, device_time_ns=TICK_NS, force=(25.0,)
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
)
SCENE = Scene(
    seq=12,
    time_ns=9876543210,
    objects=(
        SceneObject("ball", "sphere", (0.01, 0.0, 0.5), size=(0.05,), is_fixed=False),
        SceneObject("floor", "plane"),
    ),
    proxy=(0.01, -0.002),
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
SIMULATED_TELEMETRY = replace(TELEMETRY, true_energy=0.1, true_position=(0.1,), hand_force=(0.1,))
GOLDEN: dict[str, Packet] = {
    "device_state": STATE,
    "environment_query": QUERY,
    "environment_reply": REPLY,
    "force_command": COMMAND,
    "telemetry": TELEMETRY,
    "scene": SCENE,
    "event": EVENT,
}
REASONS = ("malformed", "version", "keys", "value")

numbers = st.floats()
counts = st.integers(0, MAX_COUNT)
names = st.text(min_size=1, max_size=MAX_NAME).filter(str.isprintable)
lengths = st.floats(allow_nan=False, allow_infinity=False)
points = st.tuples(lengths, lengths, lengths)
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
    """Any packet, of 1 to 6 axes."""
    chosen: type[Packet] = kind or draw(st.sampled_from(list(TOPIC_OF)))
    vectors = st.tuples(*[numbers] * draw(st.integers(1, MAX_AXES)))
    strategies: dict[Any, st.SearchStrategy[Any]] = {
        int: counts,
        float: numbers,
        Vector: vectors,
        int | None: st.none() | counts,
        float | None: st.none() | numbers,
        Vector | None: st.none() | vectors,
        str: names,
        bool: st.booleans(),
        str | None: st.none() | names,
        Quaternion | None: st.none() | st.tuples(*[numbers] * 4),
        tuple[SceneObject, ...]: st.lists(objects, max_size=3).map(tuple),
        Mapping[str, str]: st.dictionaries(st.text(max_size=20), st.text(max_size=40), max_size=16),
        Mapping[str, int]: st.dictionaries(st.text(max_size=20), counts, max_size=32),
    }
    values = {name: draw(strategies[hint]) for name, hint in field_types(chosen).items()}
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


@pytest.fixture(params=sorted(GOLDEN))
def packet(request: pytest.FixtureRequest) -> Packet:
    return GOLDEN[request.param]


# The promised bytes


def test_every_topic_has_golden_bytes() -> None:
    assert sorted(path.stem for path in (HERE / "golden").glob("*.hex")) == sorted(TOPICS)
    assert sorted(GOLDEN) == sorted(TOPICS)


def test_a_packet_has_its_golden_bytes(packet: Packet) -> None:
    data = golden_bytes((HERE / "golden" / f"{TOPIC_OF[type(packet)]}.hex").read_text())
    assert encode(packet).hex() == data.hex()
    assert decode(data) == packet


def test_the_page_shows_the_golden_bytes(packet: Packet) -> None:
    text = (HERE / "golden" / f"{TOPIC_OF[type(packet)]}.hex").read_text()
    assert text in PAGE


def test_the_page_has_a_row_for_every_key(packet: Packet) -> None:
    section = PAGE.split(f"### `{TOPIC_OF[type(packet)]}`")[1].split("\n##")[0]
    rows = re.findall(r"^\| `(\w+)` \|", section, re.MULTILINE)
    assert rows == [name for name in field_types(type(packet)) if name not in ("seq", "time_ns")]


@pytest.mark.parametrize("kind", TOPIC_OF, ids=TOPICS)
def test_what_is_encoded_comes_back(kind: type[Packet]) -> None:
    @given(packets(kind))
    def round_trip(packet: Packet) -> None:
        data = encode(packet)
        assert same(decode(data), packet)
        assert same(decode(memoryview(data), kind), packet)

    round_trip()


def test_the_largest_packet_fits() -> None:
    widest = (1e300,) * MAX_AXES
    packet = replace(
        TELEMETRY,
        seq=MAX_COUNT,
        time_ns=MAX_COUNT,
        device_seq=MAX_COUNT,
        deadline_misses=MAX_COUNT,
        position=widest,
        commanded_force=widest,
        applied_force=widest,
        true_position=widest,
        hand_force=widest,
        rejected={f"a_reason_with_a_name_{i:02}": MAX_COUNT for i in range(32)},
    )
    data = encode(packet)
    assert len(data) < MAX_BYTES / 2
    assert decode(data) == packet


def test_numbers_and_maps_of_other_libraries_are_encoded() -> None:
    odd = replace(TELEMETRY, position=(np.float64(0.0126),), rejected=MappingProxyType({"age": 1}))
    assert decode(encode(odd)) == replace(TELEMETRY, rejected={"age": 1})


def test_what_is_no_number_is_not_encoded() -> None:
    with pytest.raises(TypeError, match="got array"):
        encode(replace(COMMAND, force=np.zeros(1)))


def test_only_packets_are_encoded() -> None:
    no_packet: Any = "force_command"
    with pytest.raises(KeyError):
        encode(no_packet)


# What other languages write


@pytest.mark.parametrize("key", ["position", "velocity", "force"])
def test_integers_in_vectors_become_floats(key: str) -> None:
    message = as_map(replace(STATE, position=(0.0, 0.5), velocity=(0.0, 0.5)))
    message |= {"force": [0.0, 0.5], key: [0, -3]}
    vector = getattr(decode(msgpack.packb(message)), key)
    assert vector == (0.0, -3.0)
    assert [type(number) for number in vector] == [float, float]


def test_an_integer_for_a_number_becomes_a_float() -> None:
    state = decode(msgpack.packb(as_map(STATE) | {"elapsed": 2}))
    assert state == replace(STATE, elapsed=2.0)
    assert isinstance(state, DeviceState)
    assert type(state.elapsed) is float


def test_single_precision_is_accepted() -> None:
    message = as_map(COMMAND) | {"force": [0.5]}
    data = msgpack.packb(message, use_single_float=True)
    assert decode(data) == replace(COMMAND, force=(0.5,))


def test_the_order_of_the_keys_is_free(packet: Packet) -> None:
    message = as_map(packet)
    assert decode(msgpack.packb(dict(reversed(message.items())))) == packet


@pytest.mark.parametrize("head", ["de", "df"])
def test_longer_map_heads_are_accepted(head: str) -> None:
    message = as_map(COMMAND)
    count = len(message).to_bytes(2 if head == "de" else 4, "big")
    data = bytes.fromhex(head) + count + encode(COMMAND)[1:]
    assert decode(data) == COMMAND


@pytest.mark.parametrize("number", [math.nan, math.inf, -math.inf])
def test_numbers_that_are_not_finite_are_left_to_the_safety_chain(number: float) -> None:
    sent = replace(COMMAND, force=(number,))
    assert same(decode(encode(sent)), sent)


# What is refused


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
            error = refusal(b"\x87" + body)
            assert error.reason == "value"
            assert len(str(error)) < 400


def test_refusals_stay_short_whatever_came() -> None:
    message = as_map(COMMAND)
    for key, value in [("force", "x" * 3000), ("packet", "y" * 3000), ("z" * 3000, 0)]:
        assert len(str(refused_map(message | {key: value}))) < 400
