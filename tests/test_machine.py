"""Findings of the doctor on a machine without a running graph."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from forcebound.cli import main
from forcebound.hardware.ports import SerialPort
from forcebound.monitor import machine, runs
from forcebound.monitor.machine import Machine
from forcebound.network.keys import new_key

GOOD = Machine(
    permits_fifo=True,
    lock_limit=None,
    cores=4,
    load=0.1,
    rt_runtime=0.95,
    timer_slack_ns=50_000,
    clock_resolution=1e-9,
    clock_source="tsc",
    governor="performance",
    has_preempt_rt=True,
    kernel="6.12.0-rt",
    python=(3, 12, 1),
    zmq="4.3.5",
    has_curve=True,
    runtime=Path("/tmp"),
    free=10_000_000_000,
    key_folder=Path("/home/me/keys"),
)


def test_a_good_machine_is_fine_in_all_respects() -> None:
    findings = machine.examine(GOOD)
    assert {finding.severity for finding in findings} == {"fine"}
    assert not any(finding.advice for finding in findings)
    assert len({finding.kind for finding in findings}) == len(findings)


@pytest.mark.parametrize(
    ("change", "severity", "kind", "seen", "advice"),
    [
        ({"permits_fifo": False}, "note", "no_fifo", "not permitted", "rtprio 95"),
        ({"lock_limit": 65536}, "note", "no_memory_lock", "at most 64 KiB", "memlock unlimited"),
        ({"rt_runtime": 0.0}, "note", "no_rt_time", "no time at all", "sysctl"),
        ({"has_preempt_rt": False}, "note", "no_preempt_rt", "without PREEMPT_RT", "kernel"),
        ({"cores": 1}, "note", "few_cores", "1 may be used", "2 or more"),
        ({"load": 3.0}, "note", "high_load", "3.0 processes", "taskset"),
        ({"governor": "powersave"}, "note", "slow_governor", "powersave", "cpupower"),
        ({"clock_resolution": 4e-3}, "note", "coarse_timers", "4 ms", "HIGH_RES"),
        ({"clock_source": "hpet"}, "note", "slow_clock", "hpet", "echo tsc"),
        ({"has_curve": False}, "note", "no_curve", "without CURVE", "pip install"),
        ({"free": None}, "problem", "no_runtime_folder", "cannot be written", "XDG_RUNTIME_DIR"),
        ({"free": 1_000_000}, "problem", "no_space", "1.0 MB are free", "XDG_RUNTIME_DIR"),
        ({"free": 100_000_000}, "note", "little_space", "100 MB are free", "XDG_RUNTIME_DIR"),
        (
            {"key_problems": (("others can replace the keys in /k", "chmod 700 /k"),)},
            "note",
            "unsafe_keys",
            "others can replace the keys in /k",
            "chmod 700 /k",
        ),
        (
            {"ports": (SerialPort("/dev/ttyACM0", is_permitted=False, group="dialout"),)},
            "note",
            "port_of_group",
            "may not be opened by this user",
            "usermod --append --groups dialout",
        ),
        (
            {"ports": (SerialPort("/dev/ttyACM0", is_permitted=False),)},
            "note",
            "port_of_nobody",
            "root alone",
            'KERNEL=="ttyACM[0-9]*|ttyUSB[0-9]*", GROUP="dialout"',
        ),
    ],
)
def test_what_could_be_better_is_said_with_how(
    change: dict[str, Any], severity: str, kind: str, seen: str, advice: str
) -> None:
    worst = machine.examine(replace(GOOD, **change))[0]
    assert (worst.severity, worst.kind) == (severity, kind)
    assert seen in worst.seen
    assert advice in worst.advice


def test_what_the_kernel_does_not_say_is_left_out() -> None:
    findings = machine.examine(
        replace(GOOD, rt_runtime=None, timer_slack_ns=None, clock_source="", governor="")
    )
    kinds = {finding.kind for finding in findings}
    assert kinds.isdisjoint({"rt_throttling", "timer_slack", "clock_source", "governor"})


def test_this_machine_can_run_what_these_tests_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("FORCEBOUND_KEYS", str(tmp_path))
    seen = machine.look()
    assert seen.cores >= 1
    assert seen.zmq.startswith("4.")
    assert seen.key_problems == ()
    assert "problem" not in {finding.severity for finding in machine.examine(seen)}


def test_keys_that_others_can_replace_are_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    new_key("device-lab", tmp_path)
    tmp_path.chmod(0o777)
    monkeypatch.setenv("FORCEBOUND_KEYS", str(tmp_path))
    findings = {finding.kind: finding for finding in machine.examine(machine.look())}
    assert findings["unsafe_keys"].action.startswith(f"chmod 700 {tmp_path}")


def test_a_temporary_folder_that_is_not_there_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "missing"))
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path / "missing"))
    assert machine.look().free is None


def test_without_a_graph_the_command_examines_the_machine(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(runs, "running", list)
    monkeypatch.setattr(machine, "look", lambda: replace(GOOD, permits_fifo=False))
    done = CliRunner().invoke(main, ["doctor"])
    assert done.exit_code == 0
    first, note, advice, *rest = done.stdout.splitlines()
    assert first == "this machine; no graph runs"
    assert note.startswith("note     scheduling: SCHED_FIFO is not permitted")
    assert advice.startswith("         -> add '@realtime - rtprio 95'")
    assert rest[-1] == "no problem found"
    monkeypatch.setattr(machine, "look", lambda: replace(GOOD, free=None))
    done = CliRunner().invoke(main, ["doctor", "--json"])
    assert done.exit_code == 1
    document = json.loads(done.stdout)
    assert document["graph"] is None
    assert document["is_well"] is False
    assert document["findings"][0]["kind"] == "no_runtime_folder"
