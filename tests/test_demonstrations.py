"""Episodes, and data sets of them, read back by h5py, zarr, pandas and pyarrow."""

import json
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pandas as pd
import pyarrow.parquet as parquet
import pytest
import zarr
from builders import MS, reply, state, telemetry_packet
from invoking import invoke
from msgspec.structs import replace

from forcebound.errors import ConfigError
from forcebound.graph.loader import load
from forcebound.messages.events import EPISODE_BEGINS, EPISODE_ENDS, EventLog
from forcebound.messages.packets import Event, Packet
from forcebound.observe import runs
from forcebound.recordings import learning_files, lerobot_dataset
from forcebound.recordings.clock import UTC_OFFSET, UTC_OFFSET_AT
from forcebound.recordings.demonstrations import DataSet
from forcebound.recordings.episodes import Episode, episodes_of
from forcebound.recordings.recording import Recorder, Recording, read
from forcebound.run.run_directory import RunDocument
from forcebound.run.virtual import run_virtual_hands

OFFSET = 1_800_000_000 * 10**9  # ns, of UTC
TOPICS = ("device_state", "telemetry", "environment_query", "environment_reply", "force_command")
#: ms of begin and end, and whether it is kept; None: no end.
EPISODES = [(100, 180, True), (190, 230, False), (240, 290, True), (300, None, False)]
JOINTS = ["base", "shoulder", "elbow", "forearm", "wrist", "hand", "gripper"]


def events_of(episodes: Sequence[tuple[int, int | None, bool]]) -> list[Event]:
    log = EventLog("launcher")
    found = []
    for number, (begin, end, kept) in enumerate(episodes):
        data = {"episode": str(number)}
        found.append(log.emit(begin * MS, EPISODE_BEGINS, "begins", data))
        if end is not None:
            data["kept"] = "true" if kept else "false"
            found.append(log.emit(end * MS, EPISODE_ENDS, "ends", data))
    return found


def demonstrated(
    folder: Path, launch: str, *changes: str, episodes: Sequence[tuple[int, int | None, bool]] = ()
) -> Path:
    """Record a run in virtual time, with episodes in it, as a live one has them."""
    config, plain = load(launch, changes), folder / "plain.mcap"
    run_virtual_hands(config, 0.35, plain)
    recording = read(plain)
    packets: list[Packet] = [*recording.stream("event"), *events_of(episodes)]
    for one in recording.by_hand.values():
        packets += one.stream(*TOPICS)
    path = folder / f"{launch}.mcap"
    metadata = recording.metadata | {UTC_OFFSET: str(OFFSET), UTC_OFFSET_AT: "0"}
    with Recorder(path, metadata, graph=config.graph) as recorder:
        for packet in sorted(packets, key=lambda packet: packet.time_ns):
            recorder.write(packet)
    return path


def recorded(path: Path, packets: Sequence[Packet], launch: str = "{}") -> Recording:
    with Recorder(path, {"launch": launch}) as recorder:
        for packet in packets:
            recorder.write(packet)
    return read(path)


@pytest.fixture(scope="module")
def pair(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording of two arms with four episodes, two of which were kept."""
    return demonstrated(tmp_path_factory.mktemp("pair"), "joint_arms", episodes=EPISODES)


def column(recording: Recording, topic: str, field: str) -> dict[int, Any]:
    """Return the values of a field by tick."""
    key = "device_seq" if topic == "environment_reply" else "seq"
    return {getattr(one, key): getattr(one, field) for one in recording.stream(topic)}


# --- Episodes ------------------------------------------------------------------------------------


def test_episodes_are_what_was_begun_and_only_an_end_keeps_one(tmp_path: Path) -> None:
    recording = recorded(tmp_path / "run.mcap", events_of(EPISODES))
    assert episodes_of(recording) == [
        Episode(0, 100 * MS, 180 * MS, kept=True, is_open=False),
        Episode(1, 190 * MS, 230 * MS, kept=False, is_open=False),
        Episode(2, 240 * MS, 290 * MS, kept=True, is_open=False),
        Episode(3, 300 * MS),
    ]
    again = recorded(tmp_path / "again.mcap", events_of([(1, None, False), (2, 3, True)]))
    first, second = episodes_of(again)
    assert (first.kept, first.is_open, first.end_ns) == (False, True, 2 * MS)
    assert second.kept


def test_a_recording_without_episodes_is_one(tmp_path: Path) -> None:
    (one,) = episodes_of(recorded(tmp_path / "run.mcap", [state(0, 0.1)]))
    assert (one.number, one.kept, one.is_open) == (0, True, False)


# --- The numbers ---------------------------------------------------------------------------------


def test_hdf5_has_the_numbers_of_the_kept_episodes_to_the_bit(pair: Path, tmp_path: Path) -> None:
    done = invoke("export", pair, "--hdf5", tmp_path / "demos.hdf5")
    assert done.exit_code == 0, done.output
    assert "left out: episode 1" in done.output
    assert "left out: episode 3" in done.output
    hands = {hand: read(pair, hand=hand) for hand in ("leader", "follower")}
    stamps = column(hands["follower"], "device_state", "time_ns")
    with h5py.File(tmp_path / "demos.hdf5", swmr=True) as file:
        assert list(file["data"]) == ["demo_0", "demo_1"]
        about = dict(file["data"].attrs)
        assert (about["fps"], about["total"]) == (1000.0, 80 + 50)
        for name, (begin, end, number) in {
            "demo_0": (100, 180, 0),
            "demo_1": (240, 290, 2),
        }.items():
            demo = file["data"][name]
            ticks = [k for k, time_ns in stamps.items() if begin * MS <= time_ns < end * MS]
            assert demo.attrs["num_samples"] == len(ticks) == end - begin
            assert demo.attrs["episode"] == number
            assert demo["time_ns"][:].tolist() == [stamps[k] for k in ticks]
            assert demo["utc_ns"][:].tolist() == [OFFSET + stamps[k] for k in ticks]
            assert demo["timestamp"][:] == pytest.approx(np.arange(len(ticks)) * 1e-3, abs=1e-12)
            for place, hand, topic, field in (
                ("actions", "leader", "device_state", "position"),
                ("obs/state", "follower", "device_state", "position"),
                ("obs/velocity", "follower", "device_state", "velocity"),
            ):
                values = column(hands[hand], topic, field)
                assert demo[place][:].tolist() == [list(values[k]) for k in ticks], place
            applied, commanded = (
                column(hands["follower"], "telemetry", f"{which}_force")
                for which in ("applied", "commanded")
            )
            efforts = demo["obs/effort"][:].tolist()
            assert efforts == [[*applied[k], *commanded[k]] for k in ticks]
            assert any(map(any, efforts))
        described = demo["obs/effort"].attrs
        assert list(described["names"][:7]) == [f"follower.applied_force.{j}" for j in JOINTS]
        assert set(described["units"]) == {"N m"}
        assert described["meanings"][1].startswith("shoulder: ")


def test_a_hand_alone_acts_by_where_it_is_in_the_next_row(tmp_path: Path) -> None:
    run = demonstrated(tmp_path, "touch_sphere", episodes=[(50, 60, True)])
    (one,) = DataSet([read(run)]).demonstrations()
    positions = column(read(run), "device_state", "position")
    state = one.features["state"].tolist()
    assert state == [list(positions[k]) for k in range(50, 59)]
    assert one.features["action"].tolist() == [list(positions[k]) for k in range(51, 60)]


def test_a_column_is_that_of_the_first_table_unless_the_text_names_one(tmp_path: Path) -> None:
    packets: list[Packet] = [state(k, 0.01 * k) for k in range(5)]
    packets += [
        telemetry_packet(k, position=(1.0 + k,), time_ns=k * MS + MS // 2) for k in range(5)
    ]
    texts = ["position", "telemetry.position", "device_state.position", "telemetry.time_ns"]
    chosen = {"all": texts, "action": [], "state": [], "effort": [], "velocity": []}
    data = DataSet([recorded(tmp_path / "run.mcap", packets)], chosen, fps=1000)
    (one,) = data.demonstrations()
    first, *others = one.features["all"].T.tolist()
    assert first == [0.01 * k for k in range(5)]
    written = [float(k * MS + MS // 2) for k in range(5)]
    assert others == [[1.0 + k for k in range(5)], first, written]
    assert len(set(data.features["all"]["names"])) == 4


def test_stamps_in_utc_are_those_of_all_episodes_or_of_none(pair: Path, tmp_path: Path) -> None:
    virtual = tmp_path / "virtual.mcap"
    run_virtual_hands(load("joint_arms"), 0.05, virtual)
    data = DataSet([read(pair), read(virtual)])
    assert ["utc_ns" in one.stamps for one in data.demonstrations()] == [False] * 3
    assert f"utc_ns, since {virtual}" in str(data)
    assert "utc_ns" not in str(DataSet([read(pair)]))


def test_a_recording_that_a_graph_still_writes_is_not_called_incomplete(
    pair: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(pair.read_bytes()[:-2000])
    words = ("export", cut, "--csv", tmp_path / "tables", "--overwrite")
    assert "recording incomplete" in invoke(*words).stderr
    document = RunDocument(launcher=0, core=None, record=str(cut), recorded=[])
    monkeypatch.setattr(runs, "running", lambda: {tmp_path: document})
    assert "still records" in invoke(*words).stderr


def test_a_frame_has_the_last_tick_at_or_before_it(pair: Path) -> None:
    data = DataSet([read(pair)], fps=30)
    one, _ = data.demonstrations()
    assert one.stamps["timestamp"].tolist() == [0.0, 1 / 30, 2 / 30]
    assert one.stamps["time_ns"].tolist() == [100 * MS, 133 * MS, 166 * MS]
    positions = column(read(pair, hand="leader"), "device_state", "position")
    assert one.features["action"].tolist() == [list(positions[k]) for k in (100, 133, 166)]


def test_every_tick_gets_the_newest_state_of_the_world_that_was_answered(tmp_path: Path) -> None:
    def answer(tick: int, level: float) -> Packet:
        return replace(reply(tick, 0.0), signals={"level": level})

    packets: list[Packet] = [answer(3, 0.3), answer(1, 0.1), answer(6, 0.6)]
    packets += [state(k, 0.01 * k) for k in range(9)]
    recording = recorded(tmp_path / "run.mcap", packets)
    chosen = {"state": ["position"], "action": [], "velocity": [], "effort": []}
    (one,) = DataSet([recording], chosen, fps=1000).demonstrations()
    assert one.features["environment_state"][:, 0].tolist() == [0.1, 0.1, 0.3, 0.3, 0.3, *[0.6] * 3]
    assert one.features["state"][:, 0].tolist() == [0.01 * k for k in range(1, 9)]


def test_a_device_that_returned_counts_again_and_its_forces_stay_with_their_ticks(
    tmp_path: Path,
) -> None:
    packets: list[Packet] = []
    for count in (*range(5), *range(20, 25)):
        tick = count % 20
        packets.append(replace(state(count, 0.1 * count), seq=tick))
        packets.append(telemetry_packet(count, seq=tick, applied_force=(float(count),)))
    chosen = {"force": ["applied_force"], "action": [], "effort": [], "velocity": []}
    recording = recorded(tmp_path / "run.mcap", packets)
    (one,) = DataSet([recording], chosen, fps=1000).demonstrations()
    at = one.stamps["time_ns"] // MS
    assert set(at) == {*range(5), *range(20, 25)}
    assert one.features["force"][:, 0].tolist() == at.tolist()


# --- Formats -------------------------------------------------------------------------------------


def test_zarr_is_flat_with_the_ends_of_the_episodes_in_format_2(pair: Path, tmp_path: Path) -> None:
    done = invoke("export", pair, pair, "--zarr", tmp_path / "demos")
    assert done.exit_code == 0, done.output
    assert json.loads((tmp_path / "demos/.zgroup").read_text()) == {"zarr_format": 2}
    root: Any = zarr.open_group(tmp_path / "demos", mode="r")
    assert root["meta/episode_ends"][:].tolist() == [80, 130, 210, 260]
    demonstrations = list(DataSet([read(pair)] * 2).demonstrations())
    for name in ("action", "state", "velocity", "effort", "environment_state"):
        expected = np.concatenate([one.features[name] for one in demonstrations])
        assert root["data"][name].dtype == np.float64
        assert np.array_equal(root["data"][name][:], expected)
    stamps = np.concatenate([one.stamps["time_ns"] for one in demonstrations])
    assert np.array_equal(root["data/time_ns"][:], stamps)
    assert root["data/action"].attrs["units"] == ["rad"] * 7


def test_lerobot_has_the_numbers_in_float32_and_a_row_for_each_episode(
    pair: Path, tmp_path: Path
) -> None:
    folder = tmp_path / "demos"
    words = ("--lerobot", folder, "--fps", 1000, "--task", "press the wall")
    done = invoke("export", pair, *words, "--feature", "button=leader.engagement")
    assert done.exit_code == 0, done.output
    table = pd.read_parquet(folder / "data/chunk-000/file-000.parquet")
    demonstrations = list(DataSet([read(pair)]).demonstrations())
    for name, feature in (("action", "action"), ("observation.effort", "effort")):
        expected = np.concatenate([one.features[feature] for one in demonstrations])
        assert np.array_equal(np.stack(list(table[name])), expected.astype(np.float32))
    stamps = np.concatenate([one.stamps["time_ns"] for one in demonstrations])
    assert table["time_ns"].tolist() == stamps.tolist()
    assert table["utc_ns"].tolist() == (stamps + OFFSET).tolist()
    assert table["index"].tolist() == list(range(130))
    assert table["frame_index"].tolist() == [*range(80), *range(50)]
    assert table["episode_index"].tolist() == [0] * 80 + [1] * 50
    assert table["observation.button"].dtype == np.float32  # one number: no list
    tasks = pd.read_parquet(folder / "meta/tasks.parquet")
    assert tasks.iloc[0].name == "press the wall"
    assert int(tasks.loc["press the wall"].task_index) == 0
    episodes = pd.read_parquet(folder / "meta/episodes/chunk-000/file-000.parquet")
    assert episodes["length"].tolist() == [80, 50]
    assert episodes["dataset_to_index"].tolist() == [80, 130]
    schema = parquet.read_schema(folder / "data/chunk-000/file-000.parquet")
    info = json.loads((folder / "meta/info.json").read_text())
    assert (info["codebase_version"], info["fps"], info["total_frames"]) == ("v3.0", 1000, 130)
    assert info["features"].keys() == set(schema.names)
    assert info["features"]["action"]["names"] == [f"leader.position.{j}" for j in JOINTS]
    for name, feature in info["features"].items():
        kind, shape = schema.field(name).type, feature["shape"]
        if shape != [1]:
            assert kind.list_size == shape[0]
            kind = kind.value_type
        assert pd.api.types.pandas_dtype(kind.to_pandas_dtype()) == np.dtype(feature["dtype"])


def test_the_statistics_of_lerobot_are_those_of_all_rows(pair: Path, tmp_path: Path) -> None:
    data = DataSet([read(pair)])
    learning_files.write(data, "lerobot", tmp_path / "demos")
    stats = json.loads((tmp_path / "demos/meta/stats.json").read_text())
    table = pd.read_parquet(tmp_path / "demos/data/chunk-000/file-000.parquet")
    for name in ("action", "observation.effort", "observation.environment_state"):
        rows, found = np.stack(list(table[name])).astype(np.float64), stats[name]
        assert found["count"] == [130]
        for key in ("min", "max", "mean", "std"):
            expected = getattr(np, key)(rows, axis=0)
            assert found[key] == pytest.approx(expected, rel=1e-4, abs=1e-7), (name, key)
        assert all(a <= b for a, b in zip(found["q01"], found["q99"], strict=True))


def test_a_long_lerobot_data_set_has_several_files(
    pair: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(lerobot_dataset, "FILE_SIZE_MB", 0)
    learning_files.write(DataSet([read(pair)]), "lerobot", tmp_path / "demos")
    files = sorted((tmp_path / "demos/data").rglob("*.parquet"))
    assert [path.name for path in files] == ["file-000.parquet", "file-001.parquet"]
    assert [parquet.read_metadata(path).num_rows for path in files] == [80, 50]
    episodes = pd.read_parquet(tmp_path / "demos/meta/episodes/chunk-000/file-000.parquet")
    assert episodes["data/file_index"].tolist() == [0, 1]


# --- What is refused -----------------------------------------------------------------------------


def test_what_is_there_stays_unless_one_says_so_and_only_a_data_set_is_replaced(
    pair: Path, tmp_path: Path
) -> None:
    photos = tmp_path / "photos"
    photos.mkdir()
    (photos / "one.png").write_text("mine")
    for form in ("--zarr", "--lerobot"):
        for more in ([], ["--overwrite"]):
            refused = invoke("export", pair, form, photos, "--fps", 30, *more)
            assert refused.exit_code == 2, refused.output
    assert (photos / "one.png").read_text() == "mine"
    for form in ("hdf5", "zarr", "lerobot"):
        place = tmp_path / form
        words = ("export", pair, f"--{form}", place, "--fps", 30)
        assert invoke(*words).exit_code == 0
        assert place.exists()
        assert invoke(*words).exit_code == 2
        assert invoke(*words, "--overwrite").exit_code == 0


def test_without_a_kept_episode_there_is_nothing_to_write(tmp_path: Path) -> None:
    run = demonstrated(tmp_path, "stiff_wall", episodes=[(10, 20, False), (30, None, False)])
    output = tmp_path / "demos.hdf5"
    refused = invoke("export", run, "--hdf5", output)
    assert (refused.exit_code, output.exists()) == (2, False)
    assert "--all" in refused.stderr
    assert invoke("export", run, "--hdf5", output, "--all").exit_code == 0
    with h5py.File(output) as file:
        assert [file["data"][demo].attrs["episode"] for demo in file["data"]] == [0, 1]


def test_recordings_of_other_hands_are_no_one_data_set(pair: Path, tmp_path: Path) -> None:
    other = demonstrated(tmp_path, "stiff_wall")
    with pytest.raises(ConfigError, match="differ"):
        DataSet([read(pair), read(other)])


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (["--feature", "action=leader.posture"], "applied_force"),
        (["--feature", "action=position"], "leader.position"),
        (["--feature", "action"], "NAME="),
        (["--feature", "a/b=leader.position"], "NAME="),
        (["--csv", "tables"], "--hdf5"),
        (["--lerobot", "demos"], "--fps"),
    ],
)
def test_a_wrong_word_gets_a_sentence_that_has_the_right_one(
    pair: Path, tmp_path: Path, words: list[str], named: str
) -> None:
    refused = invoke("export", pair, "--hdf5", tmp_path / "demos.hdf5", *words)
    assert refused.exit_code == 2
    assert named in re.sub(r"\s+", " ", refused.stderr)


def test_a_missing_package_is_named_with_the_extra(
    pair: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(learning_files, "find_spec", lambda name: None)
    for form in ("hdf5", "zarr", "lerobot"):
        with pytest.raises(ConfigError, match=r"forcebound\[export\]"):
            learning_files.write(DataSet([read(pair)]), form, tmp_path / form)
