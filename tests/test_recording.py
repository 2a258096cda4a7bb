"""Recordings: exact packets, a killed recorder, other readers of MCAP."""

import json
import math
import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from builders import full_telemetry
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.writer import Writer
from msgspec.structs import replace

from forcebound.errors import ConfigError
from forcebound.messages.events import EventLog
from forcebound.messages.packets import (
    TOPIC_OF,
    DeviceState,
    EnvironmentQuery,
    EnvironmentReply,
    ForceCommand,
    Packet,
    Scene,
    SceneObject,
    Telemetry,
    field_types,
    meanings,
)
from forcebound.messages.topology import ONE_HAND
from forcebound.recordings.recording import Recorder, Recording, read
from forcebound.recordings.schema import schema

METADATA = {"seed": "1", "launch": '{"device": {"law": "certified"}}'}


def packets(ticks: int = 5) -> list[Packet]:
    """Return what a graph publishes in some ticks."""
    result: list[Packet] = []
    for tick in range(ticks):
        time_ns = 1_000_000 * tick
        echo = (tick, time_ns)
        result += [
            DeviceState(tick, time_ns, 1e-3 * tick, (0.1,), (-0.2,), (0.0,)),
            EnvironmentQuery(tick, time_ns + 1, *echo, 1e-3 * tick, (0.1,), (-0.2,), None),
            EnvironmentReply(tick, time_ns + 2, *echo, tick, time_ns + 1, (1.5,), "e"),
            ForceCommand(tick, time_ns + 3, *echo, (1.5,)),
            full_telemetry(tick),
        ]
    ball = SceneObject("ball", "sphere", (0.1, 0.0, 0.0), size=(0.05,), points=((0.0, 0.0, 1.0),))
    result.append(Scene(0, 5, (ball, SceneObject("floor", "plane")), {"": (0.1,)}))
    result.append(EventLog("device").emit(7, "force_engages", "answers come", {"name": "value"}))
    return result


def record(path: Path, sent: list[Packet]) -> Recording:
    with Recorder(path, METADATA) as recorder:
        for packet in sent:
            recorder.write(packet)
    return read(path)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "run.mcap"


# --- What was written is read back ---------------------------------------------------------------


def test_every_packet_comes_back_as_it_was(path: Path) -> None:
    sent = packets()
    recording = record(path, sent)
    for kind, topic in TOPIC_OF.items():
        assert recording.packets(topic) == [p for p in sent if type(p) is kind]
    assert recording.complete
    assert recording.metadata == METADATA


numbers = st.floats(allow_nan=False, allow_infinity=False)
vectors = st.lists(numbers, min_size=1, max_size=6).map(tuple)


@settings(max_examples=25, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    position=vectors,
    energy=st.none() | numbers,
    truth=st.none() | vectors,
    tick=st.none() | st.integers(0, 2**63 - 1),
    rejected=st.dictionaries(st.text(max_size=5), st.integers(0, 2**63 - 1), max_size=3),
)
def test_any_finite_telemetry_comes_back_exactly(
    path: Path,
    position: tuple[float, ...],
    energy: float | None,
    truth: tuple[float, ...] | None,
    tick: int | None,
    rejected: dict[str, int],
) -> None:
    packet = replace(
        full_telemetry(),
        position=position,
        true_energy=energy,
        true_position=truth,
        device_seq=tick,
        rejected=rejected,
    )
    assert record(path, [packet]).packets("telemetry") == [packet]


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_a_number_that_is_not_finite_becomes_null_and_is_read_as_nan(
    path: Path, value: float
) -> None:
    sent = replace(full_telemetry(), position=(value, 0.5), estimated_energy=value)
    (packet,) = record(path, [sent]).packets("telemetry")
    assert isinstance(packet, Telemetry)
    assert math.isnan(packet.position[0])
    assert packet.position[1] == 0.5
    assert math.isnan(packet.estimated_energy)
    with path.open("rb") as file:
        ((_, _, message),) = make_reader(file).iter_messages()
    document = json.loads(message.data, parse_constant=pytest.fail)  # NaN is no JSON
    assert document["position"] == [None, 0.5]


def test_the_same_packets_and_metadata_give_the_same_bytes(tmp_path: Path) -> None:
    one, other = tmp_path / "one.mcap", tmp_path / "other.mcap"
    record(one, packets())
    record(other, packets())
    assert one.read_bytes() == other.read_bytes()


def test_the_clock_offset_shifts_the_log_times_and_not_the_packets(path: Path) -> None:
    with Recorder(path, {}, clock_offset_ns=10**18) as recorder:
        recorder.write(full_telemetry(3))
    with path.open("rb") as file:
        ((_, channel, message),) = make_reader(file).iter_messages()
    assert channel.topic == "/telemetry"
    assert message.log_time == 10**18 + full_telemetry(3).time_ns
    assert read(path).packets("telemetry") == [full_telemetry(3)]


# --- Other tools can read it ---------------------------------------------------------------------


@pytest.mark.parametrize("kind", TOPIC_OF)
def test_a_schema_describes_every_field_with_one_plain_type(kind: type[Packet]) -> None:
    properties = schema(kind)["properties"]
    assert list(properties) == list(field_types(kind))
    for name, field in properties.items():
        # Foxglove refuses lists of types, and objects without "properties".
        assert field["type"] in ("integer", "number", "string", "boolean", "array", "object")
        assert meanings(kind)[name].text in field["description"]
        assert field["type"] != "object" or field["properties"] == {}


def test_a_message_fits_its_schema_with_and_without_optional_values(path: Path) -> None:
    nothing: dict[str, Any] = dict.fromkeys(
        ("true_energy", "true_position", "hand_force", "device_seq", "loop_delay")
    )
    record(path, [full_telemetry(), replace(full_telemetry(1), **nothing)])
    with path.open("rb") as file:
        messages = list(make_reader(file).iter_messages())
    types = {"integer": int, "number": float, "array": list, "object": dict}
    for described, _, message in messages:
        assert described is not None
        rules = json.loads(described.data)
        document = json.loads(message.data)
        assert set(rules["required"]) <= set(document) <= set(rules["properties"])
        for name, value in document.items():
            assert type(value) is types[rules["properties"][name]["type"]]
    assert len(messages) == 2
    assert not set(nothing) & set(json.loads(messages[1][2].data))


def test_every_topic_has_its_channel_even_if_nothing_came(path: Path) -> None:
    record(path, [])
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    assert {c.topic for c in summary.channels.values()} == {f"/{name}" for name in ONE_HAND.names}


# --- Cut, damaged and wrong files ----------------------------------------------------------------


def test_what_was_flushed_is_there_without_a_close(path: Path) -> None:
    recorder = Recorder(path, METADATA)
    assert read(path).metadata == METADATA
    recorder.write(full_telemetry(0))
    recorder.flush()
    recorder.write(full_telemetry(1))
    recording = read(path)
    assert not recording.complete
    assert recording.metadata == METADATA
    assert recording.packets("telemetry") == [full_telemetry(0)]
    recorder.close()
    recorder.close()  # closes it once
    assert read(path).complete


def test_a_killed_recorder_leaves_what_it_flushed(path: Path) -> None:
    program = (
        "import os, signal, sys; from forcebound.recordings.recording import Recorder;"
        "from forcebound.messages.packets import ForceCommand;"
        "r = Recorder(sys.argv[1], {'seed': '1'});"
        "r.write(ForceCommand(0, 0, 0, 0, (1.0,))); r.flush();"
        "r.write(ForceCommand(1, 1, 1, 1, (2.0,)));"
        "os.kill(os.getpid(), signal.SIGKILL)"
    )
    result = subprocess.run([sys.executable, "-c", program, os.fspath(path)], check=False)
    assert result.returncode == -signal.SIGKILL
    recording = read(path)
    assert not recording.complete
    assert recording.packets("force_command") == [ForceCommand(0, 0, 0, 0, (1.0,))]


def test_a_damaged_byte_is_noticed(path: Path) -> None:
    recording = record(path, packets(100))
    assert recording.complete
    data = bytearray(path.read_bytes())
    data[len(data) // 3] ^= 0xFF  # inside the only chunk
    path.write_bytes(data)
    assert not read(path).complete


def test_a_file_with_a_broken_end_is_read_and_not_called_complete(path: Path) -> None:
    record(path, packets())
    path.write_bytes(path.read_bytes()[:-8] + b"whatever")
    recording = read(path)
    assert not recording.complete
    assert len(recording.packets("telemetry")) == 5


def test_an_mcap_file_of_another_program_is_refused(path: Path) -> None:
    with path.open("wb") as file:
        writer: Any = Writer(file)  # mcap leaves its methods unannotated
        writer.start()
        writer.finish()
    with pytest.raises(ConfigError, match="not a recording of forcebound"):
        read(path)


@pytest.mark.parametrize("content", [b"", b"time,position\n0,0.1\n"])
def test_a_file_of_another_kind_is_refused(path: Path, content: bytes) -> None:
    path.write_bytes(content)
    with pytest.raises(ConfigError, match="is not a"):
        read(path)


def test_a_recording_without_telemetry_says_so_when_asked_for_it(path: Path) -> None:
    recording = record(path, [p for p in packets() if type(p) is not Telemetry])
    assert len(recording.packets("device_state")) == 5
    with pytest.raises(ConfigError, match="has no telemetry"):
        _ = recording.telemetry
    path.write_bytes(path.read_bytes()[:-20])
    with pytest.raises(ConfigError, match="cut or damaged"):
        _ = read(path).telemetry


def test_an_unknown_topic_lists_the_known_ones(path: Path) -> None:
    with pytest.raises(ConfigError, match="no topic 'forces'; there are device_state"):
        record(path, []).packets("forces")


def test_a_message_of_another_version_is_explained(path: Path) -> None:
    negative = ForceCommand(-1, 0, 0, 0, (1.0,))  # writing does not check
    with pytest.raises(ConfigError, match="of force_command does not match the packet"):
        record(path, [negative]).packets("force_command")


def test_a_path_that_cannot_be_written_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="cannot write the recording"):
        Recorder(tmp_path / "no" / "folder.mcap", {})


def test_a_recording_gives_its_telemetry_as_columns(path: Path) -> None:
    columns = record(path, packets()).telemetry
    assert columns.seq.tolist() == [0, 1, 2, 3, 4]
    assert columns.true_energy.tolist() == [1 / 3] * 5
