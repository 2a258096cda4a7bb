"""Findings of the doctor on a machine without a running graph."""

import json
from collections.abc import Iterable
from pathlib import Path

import pytest
from click.testing import CliRunner

from forcebound.cli import main
from forcebound.hardware.ports import SerialPort
from forcebound.network.keys import new_key
from forcebound.observe import machine, runs
from forcebound.observe.findings import Finding

TMP, GB = Path("/tmp"), 1_000_000_000


def only(found: Finding | Iterable[Finding]) -> Finding:
    (finding,) = [found] if isinstance(found, Finding) else found
    return finding


@pytest.mark.parametrize(
    "found",
    [
        machine.scheduling(True),
        machine.memory_lock(None),
        machine.kernel("6.12.0-rt", True),
        machine.processors(4),
        machine.load(0.1, 4),
        machine.frequency("performance"),
        machine.timers(1e-9),
        machine.clock_source("tsc"),
        machine.libzmq("4.3.5", True),
        machine.space(TMP, 10 * GB),
        machine.port(SerialPort("/dev/ttyACM0", is_permitted=True)),
    ],
)
def test_what_is_as_it_should_be_needs_no_advice(found: Finding | Iterable[Finding]) -> None:
    finding = only(found)
    assert finding.severity == "fine"
    assert not finding.advice


@pytest.mark.parametrize(
    ("found", "severity", "kind", "seen", "advice"),
    [
        (machine.scheduling(False), "note", "no_fifo", "not permitted", "rtprio 95"),
        (machine.memory_lock(65536), "note", "no_memory_lock", "64 KiB", "memlock unlimited"),
        (machine.throttling("0"), "note", "no_rt_time", "no time at all", "sysctl"),
        (machine.kernel("6.12", False), "note", "no_preempt_rt", "without PREEMPT_RT", "kernel"),
        (machine.processors(1), "note", "few_cores", "1 may be used", "2 or more"),
        (machine.load(3.0, 4), "note", "high_load", "3.0 processes", "taskset"),
        (machine.steal((500, 5), (1500, 35)), "note", "steal", "took 3%", "shares its"),
        (machine.frequency("powersave"), "note", "slow_governor", "powersave", "cpupower"),
        (machine.timers(4e-3), "note", "coarse_timers", "4 ms", "HIGH_RES"),
        (machine.clock_source("hpet"), "note", "slow_clock", "hpet", "echo tsc"),
        (machine.libzmq("4.3.5", False), "note", "no_curve", "without CURVE", "pip install"),
        (machine.space(TMP, None), "problem", "no_runtime_folder", "cannot be", "XDG_RUNTIME_DIR"),
        (machine.space(TMP, 1_000_000), "problem", "no_space", "1.0 MB", "XDG_RUNTIME_DIR"),
        (machine.space(TMP, 100_000_000), "note", "little_space", "100 MB", "XDG_RUNTIME_DIR"),
        (
            machine.port(SerialPort("/dev/ttyACM0", is_permitted=False, group="dialout")),
            "note",
            "port_of_group",
            "may not be opened by this user",
            "usermod --append --groups dialout",
        ),
        (
            machine.port(SerialPort("/dev/ttyACM0", is_permitted=False)),
            "note",
            "port_of_nobody",
            "root alone",
            machine.UDEV_RULE,
        ),
    ],
)
def test_what_could_be_better_is_said_with_how(
    found: Finding | Iterable[Finding], severity: str, kind: str, seen: str, advice: str
) -> None:
    finding = only(found)
    assert (finding.severity, finding.kind) == (severity, kind)
    assert seen in finding.seen
    assert advice in finding.advice


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
    assert document["findings"][0]["kind"] == "no_runtime_folder"


def test_without_a_graph_the_command_examines_the_machine(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(runs, "running", dict)
    monkeypatch.setattr("forcebound.realtime.permits_fifo", lambda: False)
    done = CliRunner().invoke(main, ["doctor"])
    assert done.exit_code == 0
    first, *lines = done.stdout.splitlines()
    assert first == "this machine; no graph runs"
    finding = machine.scheduling(False)
    assert f"note     scheduling: {finding.seen}" in lines
    assert f"         -> {finding.advice}" in lines
    assert lines[-1] == "no problem found"


def test_steal_of_two_percent_is_no_finding(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(machine, "_read", lambda path: "cpu  10 0 20 900 5 1 2 62 7 0\ncpu0 1")
    assert machine.processor_times() == (1000, 62)
    assert not list(machine.steal((0, 0), (1000, 20)))
    monkeypatch.setattr(machine, "_read", lambda path: "")  # not Linux's, or hidden
    assert not list(machine.steal(machine.processor_times(), machine.processor_times()))
