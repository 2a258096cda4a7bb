"""Tables of a recording's topics, and what is recovered of a cut one."""

import csv
import json
import math
from pathlib import Path
from typing import Any

import pytest
from builders import telemetry_packet
from invoking import invoke
from mcap.reader import make_reader

from forcebound.errors import ConfigError
from forcebound.messages.events import EventLog
from forcebound.messages.packets import ForceCommand, Packet, Scene, SceneObject
from forcebound.recordings.export import export
from forcebound.recordings.recording import Recorder, read
from forcebound.recordings.recovery import RECOVERED_NAME, recover

METADATA = {"seed": "1", "launch": "{}"}


def packets() -> list[Packet]:
    """Return two axes, no ground truth at first, an event, a scene; numbers that are hard."""
    two = (0.1, 1 / 3)
    return [
        telemetry_packet(0, position=two, commanded_force=two, applied_force=(math.nan, -0.0)),
        telemetry_packet(
            1,
            position=(1e-300, 2.0**60),
            commanded_force=two,
            applied_force=two,
            true_position=two,
            rejected={"age": 3},
        ),
        Scene(0, 5, (SceneObject("ball", "sphere", size=(0.05,)),)),
        EventLog("device").emit(7, "force_engages", 'so "answers", come', {"name": "value"}),
    ]


def record(path: Path, sent: list[Packet], flush: bool = False) -> Path:
    with Recorder(path, METADATA, clock_offset_ns=1_000) as recorder:
        for packet in sent:
            recorder.write(packet)
            if flush:
                recorder.flush()
    return path


def rows_of(file: Path) -> list[dict[str, str]]:
    with file.open(newline="", encoding="utf-8") as stream:
        return list(csv.DictReader(stream))


# --- Tables --------------------------------------------------------------------------------------


def test_csv_holds_the_numbers_of_the_packets_to_the_bit(tmp_path: Path) -> None:
    run = record(tmp_path / "run.mcap", packets())
    result = invoke("export", run, "--csv", tmp_path / "tables")
    assert result.exit_code == 0
    files = ("telemetry.csv", "scene.csv", "event.csv", "columns.csv")
    assert [Path(line).name for line in result.stdout.split()] == list(files)
    first, second = rows_of(tmp_path / "tables/telemetry.csv")
    assert (float(first["position[0]"]), float(first["position[1]"])) == (0.1, 1 / 3)
    assert (float(second["position[0]"]), float(second["position[1]"])) == (1e-300, 2.0**60)
    assert math.isnan(float(first["applied_force[0]"]))
    assert math.copysign(1.0, float(first["applied_force[1]"])) == -1.0
    assert (first["true_position[0]"], second["true_position[0]"]) == ("", "0.1")
    assert json.loads(second["rejected"]) == {"age": 3}
    assert "hand_force[0]" not in first  # no packet has it
    (event,) = rows_of(tmp_path / "tables/event.csv")
    assert event["message"] == 'so "answers", come'
    (scene,) = rows_of(tmp_path / "tables/scene.csv")
    assert json.loads(scene["objects"])[0]["name"] == "ball"


def test_every_column_has_its_unit_and_meaning(tmp_path: Path) -> None:
    export(read(record(tmp_path / "run.mcap", packets())), tmp_path)
    about = {(row["table"], row["column"]): row for row in rows_of(tmp_path / "columns.csv")}
    for topic in ("telemetry", "scene", "event"):
        for column in rows_of(tmp_path / f"{topic}.csv")[0]:
            assert about.pop((topic, column))["meaning"]
    assert about == {}
    units = {row["column"]: row["unit"] for row in rows_of(tmp_path / "columns.csv")}
    assert (units["position[1]"], units["estimated_energy"], units["seq"]) == ("m", "J", "")


def test_files_that_are_there_are_kept_unless_one_says_so(tmp_path: Path) -> None:
    run = record(tmp_path / "run.mcap", packets())
    kept = tmp_path / "event.csv"
    kept.write_text("mine")
    refused = invoke("export", run, "--csv", tmp_path)
    assert (refused.exit_code, kept.read_text()) == (2, "mine")
    assert "has event.csv: choose another folder, or add --overwrite" in refused.stderr
    assert not (tmp_path / "telemetry.csv").exists()
    assert invoke("export", run, "--csv", tmp_path, "--overwrite").exit_code == 0
    assert kept.read_text() != "mine"


def test_a_recording_without_packets_is_refused(tmp_path: Path) -> None:
    run = record(tmp_path / "run.mcap", [])
    assert "has no packet: nothing to export" in invoke("export", run, "--csv", tmp_path).stderr


# --- Recovery ------------------------------------------------------------------------------------


def content(path: Path) -> list[tuple[Any, ...]]:
    """Return the messages of a complete file as another reader sees them."""
    with path.open("rb") as file:
        return [
            (channel.topic, schema.name if schema else "", message.log_time, message.data)
            for schema, channel, message in make_reader(file).iter_messages()
        ]


def test_a_file_cut_anywhere_becomes_a_complete_one_with_all_that_is_readable(
    tmp_path: Path,
) -> None:
    sent: list[Packet] = [ForceCommand(k, k * 1_000, k, k, (0.1 * k,)) for k in range(8)]
    whole = record(tmp_path / "whole.mcap", sent, flush=True)
    data, cut, output = whole.read_bytes(), tmp_path / "cut.mcap", tmp_path / "out.mcap"
    counts = set()
    for length in range(0, len(data), 197):
        cut.write_bytes(data[:length])
        try:
            readable = read(cut).packets("force_command")
        except ConfigError:
            assert length < 1000  # not even the metadata
            continue
        found = recover(cut, output)
        recovered = read(output)
        assert recovered.complete
        assert recovered.metadata == METADATA
        assert recovered.packets("force_command") == readable == sent[: found.messages]
        assert content(output) == content(whole)[: found.messages]
        assert 0 <= found.lost_bytes < length
        assert found.duration == pytest.approx(max(found.messages - 1, 0) * 1e-6)
        counts.add(found.messages)
    assert counts >= {0, 8}
    assert len(counts) > 5


def test_what_was_lost_is_counted_and_kept_in_the_file(tmp_path: Path) -> None:
    cut = tmp_path / "cut.mcap"
    recorder = Recorder(cut, METADATA)
    for packet in packets():
        recorder.write(packet)
    recorder.flush()
    recorder.abandon()
    assert recover(cut, tmp_path / "one.mcap").lost_bytes == 0
    cut.write_bytes(cut.read_bytes() + b"\x06" + b"\xff" * 30)
    result = invoke("recover", cut, "-o", tmp_path / "two.mcap")
    assert "recovered: 4 messages" in result.stdout
    assert "lost: the last 31 bytes" in result.stdout
    with (tmp_path / "two.mcap").open("rb") as file:
        notes = {one.name: one.metadata for one in make_reader(file).iter_metadata()}
    assert notes[RECOVERED_NAME]["lost_bytes"] == "31"
    assert notes["forcebound"] == METADATA


def test_a_damaged_chunk_ends_what_is_recovered(tmp_path: Path) -> None:
    run = record(tmp_path / "run.mcap", packets(), flush=True)
    data = bytearray(run.read_bytes())
    at = data.rindex(b"zstd", 0, len(data) - 1000) + 30  # inside a later chunk
    data[at] ^= 0xFF
    run.write_bytes(data)
    readable = read(run)
    found = recover(run, tmp_path / "out.mcap")
    assert found.messages == sum(len(readable.packets(t)) for t in ("telemetry", "scene", "event"))
    assert 0 < found.messages < 4
    assert found.lost_bytes > 1000


def test_what_needs_no_recovery_and_what_is_there_are_left_alone(tmp_path: Path) -> None:
    run = record(tmp_path / "run.mcap", packets())
    output = tmp_path / "out.mcap"
    assert "is complete: there is nothing" in invoke("recover", run, "-o", output).stderr
    assert not output.exists()
    run.write_bytes(run.read_bytes()[:-8])
    assert "add --overwrite" in invoke("recover", run, "-o", run).stderr
    assert "is the recording itself" in invoke("recover", run, "-o", run, "--overwrite").stderr
    assert len(read(run).packets("telemetry")) == 2


def test_a_full_disk_is_told(tmp_path: Path) -> None:
    run = record(tmp_path / "run.mcap", packets(), flush=True)
    (tmp_path / "event.csv").symlink_to("/dev/full")
    full = invoke("export", run, "--csv", tmp_path, "--overwrite")
    assert full.exit_code == 2
    assert f"cannot write into the folder {tmp_path}: No space left on device" in full.stderr
    run.write_bytes(run.read_bytes()[:-50])
    full = invoke("recover", run, "-o", "/dev/full", "--overwrite")
    assert full.exit_code == 2
    assert "cannot write the recording /dev/full: No space left on device" in full.stderr
