"""Damaged and malicious recordings: one sentence, in bounded time and memory."""

import json
import tracemalloc
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import lz4.frame
import pytest
import zstandard
from builders import telemetry_packet
from click.testing import CliRunner, Result
from mcap.data_stream import RecordBuilder
from mcap.records import Channel, Chunk, Footer, Message, Metadata
from msgspec.structs import asdict

from forcebound import mcap_file
from forcebound.cli import main
from forcebound.errors import ConfigError
from forcebound.graph.loader import load
from forcebound.graph.resolved import to_document
from forcebound.mcap_file import MAGIC, MAX_RECORD
from forcebound.messages.topology import flat
from forcebound.recordings.delay_traces import read_trace
from forcebound.recordings.recording import read

LAUNCH = flat(to_document(load("stiff_wall")))
MIB = 1 << 20


def telemetry(tick: int, **changes: Any) -> dict[str, Any]:
    packet = telemetry_packet(
        tick,
        position=(0.01 + 1e-5 * tick,),
        commanded_force=(1.0,),
        applied_force=(0.5,),
        true_position=(0.01,),
        hand_force=(0.5,),
        rejected={"age": 1},
    )
    recorded = {name: value for name, value in asdict(packet).items() if value is not None}
    return recorded | changes


def event(tick: int, **changes: Any) -> dict[str, Any]:
    packet = {"seq": tick, "time_ns": 1_000_000 * tick, "node": "device", "event": "late"}
    return packet | {"is_fault": True, "message": "", "data": {"name": "quiet"}} | changes


def message(channel: int, document: Any) -> bytes:
    data = document if isinstance(document, bytes) else json.dumps(document).encode()
    builder: Any = RecordBuilder()  # mcap leaves its methods unannotated
    Message(channel, 0, data, 0, 0).write(builder)
    return bytes(builder.end())


def chunk(
    content: bytes,
    compression: str = "",
    packed: bytes | None = None,
    size: int | None = None,
    crc: int | None = None,
) -> Chunk:
    return Chunk(
        compression,
        content if packed is None else packed,
        0,
        0,
        zlib.crc32(content) if crc is None else crc,
        len(content) if size is None else size,
    )


def write(path: Path, *records: Any, launch: Any = LAUNCH) -> Path:
    """Write a file of records, from nobody's recorder."""
    builder: Any = RecordBuilder()
    text = launch if isinstance(launch, str) else json.dumps(launch)
    for record in (Metadata("forcebound", {"launch": text}), *records, Footer(0, 0, 0)):
        record.write(builder)
    path.write_bytes(MAGIC + builder.end() + MAGIC)
    return path


def recorded(path: Path, *messages: bytes, launch: Any = LAUNCH) -> Path:
    """Write a file with one plain chunk: channels and some messages."""
    builder: Any = RecordBuilder()
    for number, topic in enumerate(("telemetry", "event"), start=1):
        Channel(number, f"/{topic}", "json", {}, 0).write(builder)
    return write(path, chunk(builder.end() + b"".join(messages)), launch=launch)


def run(ticks: int = 20) -> list[bytes]:
    return [message(1, telemetry(tick)) for tick in range(ticks)]


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "run.mcap"


def use(command: str, path: Path) -> Result:
    """Run ``plot`` or ``delay`` on a recording; whatever it holds, no exception gets out."""
    result = CliRunner().invoke(main, [command, str(path)])
    assert result.exception is None or isinstance(result.exception, SystemExit), result.exc_info
    assert "Traceback" not in result.output
    return result


def test_a_file_made_here_is_read(path: Path) -> None:
    recorded(path, *run(), message(2, event(3)))
    recording = read(path)
    assert recording.complete
    assert recording.telemetry.seq.size == 20
    assert use("delay", path).exit_code == 0


# --- Compressed bombs, and lengths that lie ------------------------------------------------------


def bomb(size: int) -> Chunk:
    """Return a chunk that holds one record of zeros, which nobody knows."""
    content = b"\x7f" + (size - 9).to_bytes(8, "little") + bytes(size - 9)
    return chunk(content, "zstd", zstandard.compress(content))


def many_bombs() -> tuple[Chunk, ...]:
    return (bomb(MAX_RECORD),) * 3


def one_large_bomb() -> tuple[Chunk, ...]:
    return (bomb(MAX_RECORD + 1),)


@pytest.mark.parametrize("chunks", [one_large_bomb, many_bombs])
def test_a_bomb_is_refused_in_bounded_memory(
    path: Path, chunks: Callable[[], tuple[Chunk, ...]]
) -> None:
    write(path, *chunks())
    assert path.stat().st_size < 50_000
    tracemalloc.start()
    with pytest.raises(ConfigError, match="unpacks"):
        _ = read(path).complete
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 3 * MAX_RECORD


def a_chunk_of(compression: str, packed: bytes) -> Chunk:
    return chunk(bytes(1000), compression, packed)


@pytest.mark.parametrize(
    "damaged",
    [
        a_chunk_of("zstd", zstandard.compress(bytes(100 * MIB))),  # more than it says
        a_chunk_of("zstd", zstandard.compress(bytes(10))),  # less than it says
        a_chunk_of("zstd", b"nothing"),
        a_chunk_of("zstd", b""),
        a_chunk_of("lz4", lz4.frame.compress(bytes(100 * MIB))),
        a_chunk_of("lz4", b"nothing"),
        a_chunk_of("lz4", lz4.frame.compress(bytes(1000))[:-8]),
        a_chunk_of("brotli", b"nothing"),
        chunk(b"\x05" + (2**63).to_bytes(8, "little")),  # a message longer than the chunk
        chunk(b"\x05" + (3).to_bytes(8, "little") + bytes(3)),  # one without its head
        chunk(b"\x04" + (3).to_bytes(8, "little") + bytes(3)),  # a channel without its head
        chunk(b"\x05"),
        chunk(bytes(9), crc=1),
    ],
)
def test_a_damaged_chunk_ends_what_is_read(path: Path, damaged: Chunk) -> None:
    builder: Any = RecordBuilder()
    Channel(1, "/telemetry", "json", {}, 0).write(builder)
    good = chunk(builder.end() + b"".join(run()))
    write(path, good, damaged, good)
    recording = read(path)
    assert not recording.complete
    assert recording.telemetry.seq.size == 20


@pytest.mark.parametrize("compression", ["zstd", "lz4", ""])
def test_every_compression_of_mcap_is_read(path: Path, compression: str) -> None:
    builder: Any = RecordBuilder()
    Channel(1, "/telemetry", "json", {}, 0).write(builder)
    content = builder.end() + b"".join(run())
    pack: dict[str, Callable[[bytes], bytes]] = {
        "zstd": zstandard.compress,
        "lz4": lz4.frame.compress,
        "": bytes,
    }
    write(path, chunk(content, compression, pack[compression](content)))
    assert read(path).complete
    assert read(path).telemetry.seq.size == 20


def test_a_record_longer_than_its_file_is_damage(path: Path) -> None:
    recorded(path, *run())
    data = path.read_bytes()
    path.write_bytes(data[:8] + b"\x0c" + (2**64 - 1).to_bytes(8, "little") + data[17:])
    with pytest.raises(ConfigError, match="not a recording"):
        read(path)


def test_a_file_that_grows_faster_than_it_is_read_ends_where_it_ended(path: Path) -> None:
    builder: Any = RecordBuilder()
    chunk(b"".join(run())).write(builder)
    more = bytes(builder.end())
    recorded(path, *run())
    footer = 9 + 20 + len(MAGIC)
    path.write_bytes(path.read_bytes()[:-footer] + more)
    count = 0
    with path.open("ab") as file:
        for one in mcap_file.readable(path, ["telemetry"]):
            count += isinstance(one, tuple)
            file.write(more)
            file.flush()
    assert count == 40


# --- Values --------------------------------------------------------------------------------------

DEEP = b'{"a":' * 50_000 + b"1" + b"}" * 50_000


@pytest.mark.parametrize(
    "document",
    [
        telemetry(3, seq=2**63),
        telemetry(3, seq=1.5),
        telemetry(3, position=[]),
        telemetry(3, position=[0.0] * 9),
        telemetry(3, position=["0"]),
        telemetry(3, rejected=[]),
        telemetry(3, elapsed=True),
        json.dumps(telemetry(3)).replace("0.01", "1e999", 1).encode(),
        DEEP,
        b"",
        b"[]",
        b"\xff",
    ],
)
def test_a_message_that_is_no_packet_is_refused(path: Path, document: Any) -> None:
    recorded(path, *run(3), message(1, document))
    with pytest.raises(ConfigError, match="telemetry does not match"):
        _ = read(path).telemetry
    with pytest.raises(ConfigError):
        read_trace(path)


def test_axes_that_change_are_refused(path: Path) -> None:
    other = telemetry(3, position=[0.0, 0.0], commanded_force=[0.0, 0.0], applied_force=[0.0, 0.0])
    recorded(path, *run(3), message(1, other))
    with pytest.raises(ConfigError, match="1 and 2 axes"):
        _ = read(path).telemetry


@pytest.mark.parametrize(
    "launch",
    [
        "",
        "[]",
        "[" * 100_000 + "]" * 100_000,
        '{"device": [], "environment": {}}',
        {"device": {"law": 5}},
        {"device": {"sources": 5.0}},
        {"environment": {"kind": "wall", "position": "here"}},
        {"phases": 5},
    ],
)
def test_a_launch_file_that_is_none_is_refused(path: Path, launch: Any) -> None:
    recorded(path, *run(), launch=launch)
    result = use("plot", path)
    assert result.exit_code == 2
    assert result.output.startswith("forcebound: ")


def test_what_no_reader_has_foreseen_is_a_sentence_too(path: Path) -> None:
    launch = {**LAUNCH, "phases": [{"set": 5.0}]}
    recorded(path, *run(), message(2, event(3, event="phase")), launch=launch)
    result = use("plot", path)
    assert result.exit_code == 2
    assert "cannot make sense of" in result.output


def test_events_that_say_nothing_are_drawn(path: Path) -> None:
    changes: list[dict[str, Any]] = [
        {"event": "phase", "data": {}},
        {"event": "link_counted", "data": {}},
        {"event": "link_counted", "data": {"link": "force_command", "lost": "many"}},
        {"data": {"suppressed": "-"}},
        {"data": {"suppressed": "9" * 400}},
        {"event": "parameter_set", "data": {"environment.position": "nan"}},
        {"event": "parameter_set", "data": {"environment.position": "1e308"}},
        {"event": "_hidden"},
    ]
    recorded(path, *run(), *(message(2, event(n, **some)) for n, some in enumerate(changes)))
    assert use("plot", path).exit_code == 0


@pytest.mark.parametrize("value", [1e308, None])
def test_numbers_that_are_no_motion_give_figures_all_the_same(
    path: Path, value: float | None
) -> None:
    vectors = ("position", "true_position", "commanded_force", "applied_force")
    numbers = ("elapsed", "force_limit", "estimated_energy", "true_energy", "loop_delay")
    wild = {name: [value] for name in vectors} | dict.fromkeys(numbers, value)
    recorded(path, *run(10), message(1, telemetry(10, **wild)), *run(20)[11:])
    result = CliRunner().invoke(main, ["plot", "--json", str(path)])
    assert json.loads(result.stdout)["runs"][0]["samples"] == 20


@pytest.mark.parametrize("name", ["[/bold] [red]law[/]", r"$\frac{$", "\x1b[2J\x07" + "x" * 5000])
def test_names_from_outside_are_shown_as_they_are(path: Path, name: str) -> None:
    launch = {**LAUNCH, "device": {**LAUNCH["device"], "law": name}}
    phases = [message(2, event(n, event="phase", data={"name": name[:400]})) for n in (0, 9)]
    fault = message(2, event(5, event=name[:60]))
    last = message(1, telemetry(20, rejected={name: 1}))
    recorded(path, *run(), last, *phases, fault, launch=launch)
    result = use("plot", path)
    assert result.exit_code == 0
    assert name[:8] in result.output or not name.isprintable()
    assert "\x1b" not in result.output
    assert len(result.output) < 20_000
