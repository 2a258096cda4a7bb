"""The launcher as a process of its own: killed, interrupted, robbed of its nodes."""

import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from live_graph import children_of, is_alive
from waiting import PATIENCE, until

from forcebound.messages.packets import Telemetry
from forcebound.network import sockets
from forcebound.network.sockets import Network
from forcebound.process import control_endpoint
from forcebound.recording import read
from forcebound.recordings.rerun import device_of
from forcebound.recordings.verification import verify

NODES = ("environment", "controller", "device", "recorder")


class Launched:
    """``forcebound launch`` as a process of its own, with a run_dir for its run directory."""

    def __init__(self, run_dir: Path, *words: str) -> None:
        self.run_dir = run_dir
        self.record = run_dir / "run.mcap"
        command = [sys.executable, "-m", "forcebound", "launch", "stiff_wall.yaml", *words]
        self.process = subprocess.Popen(
            [*command, "--duration", "600 s", "--record", str(self.record), "--json"],
            env={**os.environ, "XDG_RUNTIME_DIR": str(run_dir)},
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )

    @property
    def run_dirs(self) -> list[Path]:
        return list(self.run_dir.glob("forcebound-*"))

    def wait_until_engaged(self) -> dict[str, int]:
        """Return the process ids by name of a run whose force is engaged."""
        until(lambda: len(self.run_dirs) == 1, "a run directory")
        with Network() as network:
            client = network.control_client(control_endpoint(self.run_dirs[0], "device"))
            status: dict[str, Any] = {}

            def engaged() -> bool:
                assert self.process.poll() is None, self.process.communicate()
                client.ask({"request": "status"})
                sockets.wait((client.descriptor,), 100_000_000)
                status.update(client.answer() or {})
                return bool(status.get("engaged"))

            until(engaged, "an engaged force")
        names = {}
        for pid in children_of(self.process.pid):
            words = Path(f"/proc/{pid}/cmdline").read_bytes().split(b"\0")
            names[words[words.index(b"node") + 1].decode()] = pid
        assert set(names) == set(NODES)
        return names

    def telemetry(self) -> list[Telemetry]:
        return [p for p in read(self.record).packets("telemetry") if isinstance(p, Telemetry)]


@pytest.fixture
def launched(run_dir: Path) -> Iterator[Launched]:
    launched = Launched(run_dir)
    try:
        yield launched
    finally:
        children = children_of(launched.process.pid)
        launched.process.kill()
        launched.process.communicate()
        until(lambda: not any(map(is_alive, children)), "the processes of the run to be gone")


@pytest.mark.live
def test_nothing_survives_a_launcher_that_is_killed(launched: Launched) -> None:
    pids = launched.wait_until_engaged()
    launched.process.kill()
    until(lambda: not any(map(is_alive, pids.values())), "the processes to be gone")
    until(lambda: launched.run_dirs == [], "the run directory to be gone")
    assert launched.telemetry()[-1].applied_force == (0.0,)
    recording = read(launched.record)
    assert recording.complete
    assert verify(recording, device_of(recording)).is_same  # its forces follow from its inputs


@pytest.mark.live
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupt_ends_the_run_with_zero_force_and_a_result(
    launched: Launched, number: int
) -> None:
    pids = launched.wait_until_engaged()
    launched.process.send_signal(number)
    out, _ = launched.process.communicate(timeout=PATIENCE)
    assert launched.process.returncode == 0
    assert json.loads(out)["samples"] > 0
    assert launched.telemetry()[-1].applied_force == (0.0,)
    assert not any(map(is_alive, pids.values()))
    assert launched.run_dirs == []


@pytest.mark.live
@pytest.mark.parametrize("victim", ["device", "recorder"])
def test_a_device_or_recorder_that_dies_ends_the_run_and_is_named(
    launched: Launched, victim: str
) -> None:
    pids = launched.wait_until_engaged()
    os.kill(pids[victim], signal.SIGKILL)
    out, err = launched.process.communicate(timeout=PATIENCE)
    assert launched.process.returncode == 1
    assert f"{victim} ended unexpectedly, with signal SIGKILL" in err
    assert "Traceback" not in err
    assert out == ""
    assert not any(map(is_alive, pids.values()))
    assert launched.run_dirs == []
    if victim == "device":
        assert read(launched.record).complete


@pytest.mark.live
def test_a_peer_that_paused_causes_no_stale_force_afterwards(launched: Launched) -> None:
    pids = launched.wait_until_engaged()
    for pause in ("environment", "controller"):
        os.kill(pids[pause], signal.SIGSTOP)
        sockets.wait((), 500_000_000)
        os.kill(pids[pause], signal.SIGCONT)
        sockets.wait((), 500_000_000)
    launched.process.send_signal(signal.SIGINT)
    launched.process.communicate(timeout=PATIENCE)
    assert launched.process.returncode == 0
    delays = [p.loop_delay for p in launched.telemetry() if any(p.commanded_force)]
    assert delays
    assert max(delay for delay in delays if delay is not None) < 0.1  # the age limit


@pytest.mark.live
@pytest.mark.parametrize("closed", ["2>&-", "<&- >&- 2>&-"])
def test_a_run_without_standard_streams_goes_on_to_its_end(run_dir: Path, closed: str) -> None:
    record = run_dir / "run.mcap"
    words = f"-m forcebound launch stiff_wall.yaml --duration '0.3 s' --record {record}"
    done = subprocess.run(
        ["sh", "-c", f"exec {sys.executable} {words} {closed}"],
        env={**os.environ, "XDG_RUNTIME_DIR": str(run_dir)},
        timeout=PATIENCE,
        check=False,
    )
    assert done.returncode == 0
    assert record.stat().st_size > 0
    assert list(run_dir.iterdir()) == [record]
