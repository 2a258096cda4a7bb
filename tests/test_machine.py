"""Findings of the doctor on a machine without a running graph."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from forcebound.cli import main
from forcebound.hardware.ports import SerialPort
from forcebound.network.keys import new_key
from forcebound.observe import machine, runs
from forcebound.observe.machine import Machine

GOOD = Machine(
    permits_fifo=True,
    lock_limit=None,
    fifo_us="950000",
    kernel="6.12.0-rt",
    has_preempt_rt=True,
    cores=4,
    load=0.1,
    governor="performance",
    clock_source="tsc",
    libzmq="4.3.5",
    has_curve=True,
    folder=Path("/tmp"),
    room=10_000_000_000,
)


def test_what_is_as_it_should_be_needs_no_advice() -> None:
    findings = [*machine.judge(GOOD), machine.port(SerialPort("/dev/ttyACM0", is_permitted=True))]
    assert len(findings) == 10
    assert {(finding.severity, finding.advice) for finding in findings} == {("fine", "")}


@pytest.mark.parametrize(
    ("change", "severity", "kind", "seen", "advice"),
    [
        ({"permits_fifo": False}, "note", "no_fifo", "not permitted", "rtprio 95"),
        ({"lock_limit": 65536}, "note", "no_memory_lock", "64 KiB", "memlock unlimited"),
        ({"fifo_us": "0"}, "note", "no_rt_time", "no time at all", "sysctl"),
        ({"has_preempt_rt": False}, "note", "no_preempt_rt", "without PREEMPT_RT", "kernel"),
        ({"cores": 1}, "note", "few_cores", "1 may be used", "2 or more"),
        ({"load": 3.0}, "note", "high_load", "3.0 processes", "taskset"),
        ({"governor": "powersave"}, "note", "slow_governor", "powersave", "cpupower"),
        ({"clock_source": "hpet"}, "note", "slow_clock", "hpet", "echo tsc"),
        ({"has_curve": False}, "note", "no_curve", "without CURVE", "pip install"),
        ({"room": None}, "problem", "no_space", "no run", "XDG_RUNTIME_DIR"),
        ({"room": 1_000_000}, "problem", "no_space", "1.0 MB", "XDG_RUNTIME_DIR"),
        ({"room": 100_000_000}, "note", "little_space", "100.0 MB", "XDG_RUNTIME_DIR"),
    ],
)
def test_what_could_be_better_is_said_with_how(
    change: dict[str, Any], severity: str, kind: str, seen: str, advice: str
) -> None:
    here = replace(GOOD, **change)
    [finding] = [one for one in machine.judge(here) if one.severity != "fine"]
    assert (finding.severity, finding.kind) == (severity, kind)
    assert seen in finding.seen
    assert advice in finding.advice
    assert len(list(machine.judge(here))) == 9


@pytest.mark.parametrize(
    ("group", "kind", "advice"),
    [
        ("dialout", "port_of_group", "usermod --append --groups dialout"),
        ("", "port_of_nobody", machine.UDEV_RULE),
    ],
)
def test_a_port_that_may_not_be_opened_is_said_with_how(group: str, kind: str, advice: str) -> None:
    finding = machine.port(SerialPort("/dev/ttyACM0", is_permitted=False, group=group))
    assert (finding.severity, finding.kind) == ("note", kind)
    assert advice in finding.advice


@pytest.mark.parametrize(("timer", "is_found"), [("16\n", True), ("1\n", False), (None, False)])
def test_a_converter_that_keeps_answers_is_said_with_how_to_set_it(
    tmp_path: Path, timer: str | None, is_found: bool
) -> None:
    device = tmp_path / "ttyUSB7"
    device.mkdir()
    if timer is not None:
        (device / "latency_timer").write_text(timer)
    finding = machine.latency(SerialPort("/dev/ttyUSB7"), tmp_path)
    assert (finding is not None) == is_found
    if finding is not None:
        assert finding.severity == "note"
        assert f"echo 1 | sudo tee {device}/latency_timer" in finding.advice


def test_keys_that_others_can_replace_are_reported(tmp_path: Path) -> None:
    new_key("device-lab", tmp_path)
    tmp_path.chmod(0o777)
    (finding,) = machine.key_folder(tmp_path)
    assert finding.action.startswith(f"chmod 700 {tmp_path}")


def test_a_runtime_folder_that_is_not_there_is_a_problem_and_ends_the_command_with_1(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(runs, "running", dict)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "missing"))
    monkeypatch.setattr("forcebound.folders.SESSIONS", tmp_path)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path / "missing"))
    done = CliRunner().invoke(main, ["doctor", "--json"])
    assert done.exit_code == 1
    document = json.loads(done.stdout)
    assert document["graph"] is None
    assert document["is_well"] is False
    assert document["findings"][0]["kind"] == "no_space"


def test_without_a_graph_the_command_examines_the_machine(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(runs, "running", dict)
    monkeypatch.setattr("forcebound.realtime.permits_fifo", lambda: False)
    done = CliRunner().invoke(main, ["doctor"])
    assert done.exit_code == 0
    first, *lines = done.stdout.splitlines()
    assert first == "this machine; no graph runs"
    [finding] = [one for one in machine.judge(machine.look()) if one.kind == "no_fifo"]
    assert f"note     scheduling: {finding.seen}" in lines
    assert f"         -> {finding.advice}" in lines
    assert lines[-1] == "no problem found"


def test_steal_of_two_percent_is_no_finding(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(machine, "_read", lambda path: "cpu  10 0 20 900 5 1 2 62 7 0\ncpu0 1")
    assert machine.processor_times() == (1000, 62)
    assert not list(machine.steal((0, 0), (1000, 20)))
    (found,) = machine.steal((500, 5), (1500, 35))
    assert (found.severity, found.kind) == ("note", "steal")
    assert "3%" in found.seen
    monkeypatch.setattr(machine, "_read", lambda path: "")  # not Linux's, or hidden
    assert not list(machine.steal(machine.processor_times(), machine.processor_times()))
