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

from forcebound.recordings.recording import read

PAGE = (Path(__file__).parent.parent / "docs/demonstrations.md").read_text(encoding="utf-8")
FILE = re.compile(
    r"^```(?:yaml|python|xml)\n((?:# |<!-- )(\S+)(?: -->)?\n.*?)^```$", re.MULTILINE | re.DOTALL
)
COMMAND = re.compile(r"^(forcebound .*?)(?: +#.*)?$", re.MULTILINE)
SHELL = re.compile(r"^```sh\n(.*?)^```$", re.MULTILINE | re.DOTALL)


@pytest.fixture(scope="module")
def printed(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, str]]:
    """A folder with the files of the page, and what each of its commands printed there."""
    folder: Path = tmp_path_factory.mktemp("page")
    for text, name in FILE.findall(PAGE):
        (folder / name).write_text(text, encoding="utf-8")
    found = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        for block in SHELL.findall(PAGE):
            for command in COMMAND.findall(block):
                done = invoke(*shlex.split(command)[1:])
                assert done.exit_code == 0, (command, done.output)
                found[command] = done.output
    return folder, found


def test_the_mapping_that_the_page_shows_is_the_one_that_is_printed(
    printed: tuple[Path, dict[str, str]],
) -> None:
    _, outputs = printed
    (shown,) = re.findall(r"^```text\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)
    (output,) = (text for command, text in outputs.items() if "--lerobot" in command)
    assert [line.removesuffix(", ...") for line in shown.splitlines()] == [
        line[: len(given.removesuffix(", ..."))]
        for line, given in zip(output.splitlines(), shown.splitlines(), strict=True)
    ]


def test_the_block_moved_and_pandas_and_h5py_read_the_numbers_of_the_recordings(
    printed: tuple[Path, dict[str, str]],
) -> None:
    folder, _ = printed
    rows = pd.read_parquet(folder / "push_lerobot/data")
    with h5py.File(folder / "push.hdf5") as file:
        for number, name in enumerate(("slow", "usual", "fast")):
            demo, recording = file[f"data/demo_{number}"], read(folder / f"{name}.mcap")
            assert demo.attrs["recording"] == f"{name}.mcap"
            stamps = demo["time_ns"][:].tolist()
            packets: list[Any] = recording.packets("device_state")
            states = {packet.time_ns: packet for packet in packets}
            assert demo["obs/state"][:].tolist() == [list(states[t].position) for t in stamps]
            answers: list[Any] = recording.packets("environment_reply")
            replies = {packet.device_time_ns: packet for packet in answers}
            world = demo["obs/environment_state"]
            names = [label.removeprefix("signals.") for label in world.attrs["names"]]
            assert names[:3] == ["qpos_block_x", "qpos_block_y", "qpos_block_z"]
            assert world[:].tolist() == [[replies[t].signals[n] for n in names] for t in stamps]
            assert world[-1, 0] - world[0, 0] > 0.01  # m
            assert np.abs(world[:, names.index("contact_block_x")]).max() > 0.01  # N
            of = rows[rows["episode_index"] == number]
            frames = [list(states[t].position) for t in of["time_ns"]]
            assert np.array_equal(
                np.stack(list(of["observation.state"])), np.array(frames, np.float32)
            )


def test_the_programs_of_the_page_run(printed: tuple[Path, dict[str, str]]) -> None:
    folder, _ = printed
    for name in ("load.py", "arrays.py"):
        done = subprocess.run(
            [sys.executable, name], cwd=folder, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stderr
        assert done.stdout.count("\n") >= 2
