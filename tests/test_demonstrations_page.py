"""docs/demonstrations.md: its files and commands, as a reader types them."""

import re
import shlex
import subprocess
import sys
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pandas as pd
import pytest
from invoking import invoke
from live_graph import PROCESSES_OF_THEIR_OWN

from forcebound.recordings.recording import read

DOCS = Path(__file__).parent.parent / "docs"
PAGE = (DOCS / "demonstrations.md").read_text(encoding="utf-8")
ARMS = (DOCS / "teleoperation.md").read_text(encoding="utf-8")
#: Of the two arms: a slow bus, so that no busy machine is too slow for it.
PATIENT = {"rate": "50 Hz", "timeout": "5 s", "write_delay": "60 ms", "watchdog_limit": "1 s"}
FILE = re.compile(
    r"^```(?:yaml|python|xml)\n((?:# |<!-- )(\S+)(?: -->)?\n.*?)^```$", re.MULTILINE | re.DOTALL
)
COMMAND = re.compile(r"^(forcebound .*?)(?: +#.*)?$", re.MULTILINE)
SHELL = re.compile(r"^```sh\n(.*?)^```$", re.MULTILINE | re.DOTALL)


pytestmark = PROCESSES_OF_THEIR_OWN


@pytest.fixture(scope="module")
def printed(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, str]]:
    """A folder with the files of the page, and what each program and command printed there."""
    folder: Path = tmp_path_factory.mktemp("page")
    for text, name in FILE.findall(PAGE):
        (folder / name).write_text(text, encoding="utf-8")
    for text, name in FILE.findall(ARMS):
        (folder / name).write_text(text, encoding="utf-8")
    arm = (folder / "arm.yaml").read_text(encoding="utf-8").splitlines()
    kept = [line for line in arm if line.partition(":")[0] not in PATIENT]
    slow = [f"{name}: {value}" for name, value in PATIENT.items()]
    (folder / "arm.yaml").write_text("\n".join([*kept, *slow, ""]), encoding="utf-8")
    found = {one: run(folder, one) for one in ("demonstrate.py", "of_the_pair.py")}
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        for block in SHELL.findall(PAGE):
            for command in COMMAND.findall(block):
                done = invoke(*shlex.split(command)[1:])
                assert done.exit_code == 0, (command, done.output)
                found[command] = done.output
    return folder, found


def run(folder: Path, program: str) -> str:
    """Return what a program of the page prints."""
    words = [sys.executable, program]
    done = subprocess.run(words, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def without_counts(text: str) -> str:
    return re.sub(r"rows: \d+", "rows", text)


def test_three_episodes_are_kept_and_the_mapping_is_that_of_the_page(
    printed: tuple[Path, dict[str, str]],
) -> None:
    _, outputs = printed
    assert "3 kept of 4" in outputs["demonstrate.py"]
    (shown,) = re.findall(r"^```text\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)
    (output,) = (text for command, text in outputs.items() if "push_lerobot" in command)
    pairs = zip(
        without_counts(shown).splitlines(), without_counts(output).splitlines(), strict=True
    )
    for line, given in pairs:
        assert given.startswith(line.removesuffix("..."))


def test_pandas_and_h5py_read_the_numbers_of_the_recording(
    printed: tuple[Path, dict[str, str]],
) -> None:
    folder, _ = printed
    rows = pd.read_parquet(folder / "push_lerobot/data")
    recording = read(folder / "push.mcap")
    packets: list[Any] = recording.packets("device_state")
    states = {packet.time_ns: packet for packet in packets}
    answers: list[Any] = recording.packets("environment_reply")
    replies = {packet.device_time_ns: packet for packet in answers}
    with h5py.File(folder / "push.hdf5") as file:
        for count, number in enumerate((0, 2, 3)):
            demo = file[f"data/demo_{count}"]
            assert demo.attrs["episode"] == number
            stamps = demo["time_ns"][:].tolist()
            assert demo["obs/state"][:].tolist() == [list(states[t].position) for t in stamps]
            world = demo["obs/environment_state"]
            names = [label.removeprefix("signals.") for label in world.attrs["names"]]
            assert names[:3] == ["qpos_block_x", "qpos_block_y", "qpos_block_z"]
            start = world[0, :3]  # m: of the file, but for how far it sinks into the table
            np.testing.assert_allclose(start, (0.02, 0.0, 0.01), atol=2e-4)
            assert world[-1, 0] - start[0] > 0.01
            assert min(world[:, 0]) > start[0] - 1e-4
            answered = [(row, t) for row, t in enumerate(stamps) if t in replies]
            assert answered
            for row, t in answered:
                assert world[row].tolist() == [replies[t].signals[name] for name in names]
            of = rows[rows["episode_index"] == count]
            frames = [list(states[t].position) for t in of["time_ns"]]
            assert np.array_equal(
                np.stack(list(of["observation.state"])), np.array(frames, np.float32)
            )


def test_the_data_set_of_two_arms_has_the_leader_as_action_and_the_follower_as_state(
    printed: tuple[Path, dict[str, str]],
) -> None:
    folder, _ = printed
    rows = pd.read_parquet(folder / "demo/data")
    assert rows["episode_index"].unique().tolist() == [0]
    recording = read(folder / "demo.mcap")
    for feature, hand in (("action", "leader"), ("observation.state", "follower")):
        packets: list[Any] = recording.packets(f"{hand}/device_state")
        there = {tuple(np.asarray(one.position, np.float32).tolist()) for one in packets}
        assert {tuple(row.tolist()) for row in rows[feature]} <= there


def test_the_programs_of_the_page_load_it(printed: tuple[Path, dict[str, str]]) -> None:
    folder, _ = printed
    assert run(folder, "load.py").count("the block moved by") == 3
    assert re.findall(r"^\d", run(folder, "arrays.py"), re.MULTILINE) == ["0", "2", "3"]
    joined = run(folder, "camera.py")  # no row is without a picture
    assert ("picture" in joined, "NaN" in joined) == (True, False)
