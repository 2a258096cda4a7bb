"""The codec: golden bytes, and what other languages write."""

import math
import re
from types import MappingProxyType

import msgpack
import numpy as np
import pytest
from golden_packets import (
    COMMAND,
    GOLDEN,
    HERE,
    PAGE,
    STATE,
    TELEMETRY,
    as_map,
    golden_bytes,
    packets,
    same,
)
from hypothesis import given
from msgspec.structs import replace

from forcebound.messages.codec import MAX_BYTES, decode, encode
from forcebound.messages.packets import (
    MAX_AXES,
    MAX_COUNT,
    TOPIC_OF,
    TOPICS,
    Packet,
    field_types,
)


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
    assert rows == [
        name for name in field_types(type(packet)) if name not in ("seq", "time_ns", "hand")
    ]


@pytest.mark.parametrize("kind", TOPIC_OF, ids=TOPICS)
def test_what_is_encoded_comes_back(kind: type[Packet]) -> None:
    @given(packets(kind))
    def round_trip(packet: Packet) -> None:
        data = encode(packet)
        assert same(decode(data), packet)
        assert same(decode(data, kind), packet)

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


# What other languages write


@pytest.mark.parametrize("key", ["position", "velocity", "force"])
def test_integers_in_vectors_become_floats(key: str) -> None:
    message = as_map(replace(STATE, position=(0.0, 0.5), velocity=(0.0, 0.5)))
    message |= {"force": [0.0, 0.5], key: [0, -3]}
    vector = getattr(decode(msgpack.packb(message)), key)
    assert vector == (0.0, -3.0)
    assert [type(number) for number in vector] == [float, float]


def test_single_precision_is_accepted() -> None:
    message = as_map(COMMAND) | {"force": [0.5]}
    data = msgpack.packb(message, use_single_float=True)
    assert decode(data) == replace(COMMAND, force=(0.5,))


def test_the_order_of_the_keys_is_free(packet: Packet) -> None:
    message = as_map(packet)
    assert decode(msgpack.packb(dict(reversed(message.items())))) == packet


@pytest.mark.parametrize("number", [math.nan, math.inf, -math.inf])
def test_numbers_that_are_not_finite_are_left_to_the_safety_chain(number: float) -> None:
    sent = replace(COMMAND, force=(number,))
    assert same(decode(encode(sent)), sent)
