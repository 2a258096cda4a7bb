"""Episodes of a live recording: events, a world that begins again, a force that never jumps."""

import os
import sys
import time
import tty
from contextlib import closing
from itertools import pairwise
from pathlib import Path
from typing import cast

import numpy as np
import pytest
from builders import MS, query
from fakes import answer, device_node
from invoking import invoke
from launch_texts import written

import forcebound as fb
from forcebound.errors import ConfigError
from forcebound.haptics.environments.mass_spring import MassSpring
from forcebound.messages.control import Accepted, Engage, Episodes, Refused, Release, ResetWorld
from forcebound.messages.packets import DeviceState, EnvironmentReply, Telemetry
from forcebound.nodes.environment import EnvironmentNode
from forcebound.observe.episodes import buttons_of, mark, watch
from forcebound.observe.page.controls import Controls
from forcebound.recordings.clock import CLOCK_END, UTC_OFFSET, UTC_OFFSET_AT, utc_ns
from forcebound.recordings.recording import Recorder, read

PRESSES = ", ".join(
    f"{{ button: {k % 2}, start: {0.7 * k + 0.7:g} s, end: {0.7 * k + 1:g} s }}" for k in range(60)
)
FILE = f"""\
forcebound: 1
include: push_mass.yaml
operator: {{ kind: following, points: [[14 mm]], presses: [{PRESSES}] }}
"""


class KeptError(Exception):
    """An episode was kept."""


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A live recording of episodes: by Python, by the page, and by buttons."""
    folder = tmp_path_factory.mktemp("episodes")
    path: Path = folder / "run.mcap"
    with fb.launch(written(folder, FILE), record=path) as graph:
        assert graph.episode("start") == Episodes(begun=1, kept=0, is_open=True)
        with pytest.raises(ConfigError, match="keep or discard"):
            graph.episode("start")
        with pytest.raises(ConfigError):
            graph.episode("stop")  # type: ignore[arg-type]
        with pytest.raises(ConfigError):
            graph.point([0.01])  # this hand follows no pointer
        with closing(Controls(graph.run_dir, folder)) as page:
            assert page.act({"do": "episode", "action": "discard"}) is None
            assert "start" in str(page.act({"do": "episode", "action": "keep"}))
            assert page.count_episodes()["begun"] == 1

        def act(action: str) -> None:
            try:
                found = mark(graph.run_dir, action)  # type: ignore[arg-type]
            except ConfigError:
                return
            if action == "keep" and found.kept:
                raise KeptError

        with pytest.raises(KeptError):
            watch(graph.run_dir, "hand", buttons_of("start=0,keep=1"), act)
        keyboard, terminal = os.openpty()
        with pytest.MonkeyPatch.context() as patch, os.fdopen(terminal) as stdin:
            patch.setattr(sys, "stdin", stdin)
            to_cbreak = tty.setcbreak

            def typed_once_it_listens(descriptor: int) -> None:
                to_cbreak(descriptor)
                os.write(keyboard, b"s")

            patch.setattr(tty, "setcbreak", typed_once_it_listens)

            def act_by_key(action: str) -> None:
                act(action)
                os.write(keyboard, b"q")

            watch(graph.run_dir, None, {}, act_by_key)
        os.close(keyboard)
        graph.wait(0.3)
    return path


def test_the_recording_has_each_episode_and_whether_it_was_kept(recorded: Path) -> None:
    found = [
        (event.event, event.data["episode"], event.data.get("kept"))
        for event in fb.read(recorded).events
        if event.event.startswith("episode")
    ]
    assert found == [
        ("episode_begins", "0", None),
        ("episode_ends", "0", "false"),
        ("episode_begins", "1", None),
        ("episode_ends", "1", "true"),
        ("episode_begins", "2", None),
    ]
    output = invoke("plot", recorded, "-o", recorded.with_suffix(".png")).output
    assert "1 kept of 3, and one without an end" in output


def test_the_world_begins_again_and_the_force_ramps_from_zero(recorded: Path) -> None:
    recording = read(recorded)
    begins = [one.time_ns for one in fb.read(recorded).events if one.event == "episode_begins"]
    replies = cast("list[EnvironmentReply]", recording.packets("environment_reply"))
    ticks = cast("list[Telemetry]", recording.packets("telemetry"))
    for begin, before in zip(begins[1:], begins, strict=False):
        faces = [cast(dict[str, float], one.signals)["face"] for one in replies
                 if before < one.time_ns < begin]  # fmt: skip
        reset = len(faces) - 1 - faces[::-1].index(0.010)  # where it rests
        assert max(faces[:reset]) > 0.0101
        assert next(one for one in ticks if one.time_ns > begin).engagement == 0.0
    engage_time = recording.launch["device"]["engage_time"]
    zero_ns, drops = ticks[0].time_ns, 0
    for one, other in pairwise(ticks):
        drops += one.engagement > 0.0 == other.engagement
        zero_ns = other.time_ns if other.engagement == 0.0 else zero_ns
        assert other.engagement <= (other.time_ns - zero_ns) * 1e-9 / engage_time + 1e-9
    assert drops >= 1  # of three starts and a discard, those that met a force


def test_the_recording_with_episodes_is_verified_to_the_bit(recorded: Path) -> None:
    assert invoke("replay", recorded, "--verify").exit_code == 0


def test_the_wall_clock_of_a_live_recording_is_that_of_the_machine(recorded: Path) -> None:
    recording = read(recorded)
    now = time.time_ns() - time.monotonic_ns()
    seen = recording.telemetry.time_ns
    np.testing.assert_allclose(utc_ns(recording, seen) - seen, now, atol=50_000_000)


def test_the_offset_of_the_clocks_drifts_evenly_between_both_ends(tmp_path: Path) -> None:
    ends = [{UTC_OFFSET_AT: str(at), UTC_OFFSET: str(10**18 + at // 1000)} for at in (0, 10**13)]
    recorder = Recorder(tmp_path / "run.mcap", ends[0])
    recorder.close(ends[1])
    recording = read(tmp_path / "run.mcap")
    assert utc_ns(recording, 5 * 10**12) == 10**18 + 5 * 10**12 + 5 * 10**9
    cut = (tmp_path / "run.mcap").read_bytes()
    (tmp_path / "cut.mcap").write_bytes(cut[: cut.index(CLOCK_END.encode())])
    assert utc_ns(read(tmp_path / "cut.mcap"), 5) == 10**18 + 5
    Recorder(tmp_path / "virtual.mcap", {}).close()
    with pytest.raises(ConfigError):
        utc_ns(read(tmp_path / "virtual.mcap"), 5)


def test_a_released_device_writes_zero_until_it_engages_and_then_ramps() -> None:
    node, device = device_node(engage_time=0.004)
    node.engage()

    def forces(first: int, last: int) -> list[float]:
        for k in range(first, last):
            (state,) = node.step(k * MS, [])
            assert isinstance(state, DeviceState)
            node.step(k * MS + 400_000, [answer(state, (2.0,))])
        return [force[0] for _, force in device.written[first:last]]

    assert forces(0, 6) == pytest.approx([0.0, 0.5, 1.0, 1.5, 2.0, 2.0])
    assert node.handle(Release()) == Accepted()
    assert forces(6, 9) == [0.0, 0.0, 0.0]
    node.handle(Engage())
    assert forces(9, 12) == pytest.approx([0.0, 0.5, 1.0])


def test_a_world_that_fails_to_begin_again_says_why(monkeypatch: pytest.MonkeyPatch) -> None:
    node = EnvironmentNode(MassSpring(position=0.0))
    node.step(0, [query(0, 0.002)])
    assert node.handle(ResetWorld()) == Accepted()

    def fails(self: MassSpring, axes: int) -> None:
        raise RuntimeError("no memory")

    monkeypatch.setattr(MassSpring, "open", fails)
    refused = node.handle(ResetWorld())
    assert isinstance(refused, Refused)
    assert "no memory" in refused.error
    assert node.step(1000, [query(1, 0.002)])  # as it was


def test_buttons_of_a_device_without_any_are_refused(tmp_path: Path) -> None:
    file = written(tmp_path, "forcebound: 1\ninclude: push_mass.yaml\n")
    with fb.launch(file) as graph, pytest.raises(ConfigError):
        watch(graph.run_dir, "hand", buttons_of("start=0"), lambda _: None)


def test_buttons_are_actions_with_bits() -> None:
    assert buttons_of("start=0, keep=3") == {0: "start", 3: "keep"}
    for wrong in ("begin=0", "start", "start=x"):
        with pytest.raises(ConfigError):
            buttons_of(wrong)
