"""Fitness of this machine for live runs: what it permits, and what could be better.

:func:`look` asks the machine, :func:`examine` judges the answers. Nothing that is merely slow or
late is a problem: a live run is correct on any machine, and punctual on a good one.
"""

import os
import platform
import shutil
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from forcebound import realtime
from forcebound.errors import ConfigError
from forcebound.folders import runtime_folder
from forcebound.hardware.ports import SerialPort, listed
from forcebound.monitor.findings import Finding
from forcebound.network import keys, sockets

FEW_CORES = 2  # the chain of nodes has one of its own, all others share the rest
SMALL_SPACE = 200_000_000  # B in the runtime folder; a recording of some minutes
NO_SPACE = 10_000_000  # B, with which no run can begin
COARSE_CLOCK = 1e-6  # s; without high-resolution timers a clock steps by milliseconds
#: Of udev: gives serial ports on USB to a group, as most distributions do.
UDEV_RULE = 'KERNEL=="ttyACM[0-9]*|ttyUSB[0-9]*", GROUP="dialout", MODE="0660"'
SLOW_CLOCKS = ("hpet", "acpi_pm", "jiffies", "refined-jiffies")  # microseconds to read, or coarse


@dataclass(frozen=True)
class Machine:
    """Properties of a machine that matter to a live run; None or an empty text: not known."""

    permits_fifo: bool
    lock_limit: int | None  # memory that may be locked, in B; None: as much as there is
    cores: int  # that this process may use
    load: float  # mean number of processes that wanted to run in the last minute
    rt_runtime: float | None  # share of a second that SCHED_FIFO may use a core, 0 to 1
    timer_slack_ns: int | None  # how much later the kernel may wake an ordinary process
    clock_resolution: float  # of the monotonic clock, in s
    clock_source: str  # of the kernel's clock, such as tsc
    governor: str  # of the frequency of the cores, such as powersave
    has_preempt_rt: bool
    kernel: str  # its release
    python: tuple[int, int, int]
    zmq: str  # version of libzmq
    has_curve: bool  # whether libzmq can encrypt
    runtime: Path  # folder for run directories
    free: int | None  # room in it, in B; None: it cannot be used
    key_folder: Path
    key_problems: tuple[tuple[str, str], ...] = ()  # why keys cannot be used, and what to do
    ports: tuple[SerialPort, ...] = ()


def look() -> Machine:
    """Return the properties of this machine."""
    folder = keys.key_folder()
    try:
        runtime = runtime_folder() or Path(tempfile.gettempdir())
    except OSError:  # none of the usual ones can be used
        runtime = Path("/tmp")
    version, has_curve = sockets.library()
    slack = _read("/proc/self/timerslack_ns")
    core = max(os.sched_getaffinity(0))
    return Machine(
        permits_fifo=realtime.permits_fifo(),
        lock_limit=realtime.memory_lock_limit(),
        cores=len(os.sched_getaffinity(0)),
        load=os.getloadavg()[0],
        rt_runtime=_rt_runtime(),
        timer_slack_ns=int(slack) if slack else None,
        clock_resolution=time.clock_getres(time.CLOCK_MONOTONIC),
        clock_source=_read("/sys/devices/system/clocksource/clocksource0/current_clocksource"),
        governor=_read(f"/sys/devices/system/cpu/cpu{core}/cpufreq/scaling_governor"),
        has_preempt_rt=_read("/sys/kernel/realtime") == "1" or "PREEMPT_RT" in platform.version(),
        kernel=platform.release(),
        python=sys.version_info[:3],
        zmq=version,
        has_curve=has_curve,
        runtime=runtime,
        free=_free(runtime),
        key_folder=folder,
        key_problems=_key_problems(folder),
        ports=tuple(listed()),
    )


def examine(machine: Machine) -> list[Finding]:
    """Return the findings about a machine, first what prevents live runs."""
    order = ("problem", "note", "fine")
    findings = [
        *_scheduling(machine),
        *_clocks(machine),
        *_software(machine),
        *_ports(machine),
    ]
    return sorted(findings, key=lambda finding: order.index(finding.severity))


def _judge(is_fine: bool, where: str, fine: str, note: str, **data: Any) -> Finding:
    return Finding("fine", fine, where, data) if is_fine else Finding("note", note, where, data)


def _scheduling(machine: Machine) -> Iterator[Finding]:
    yield _judge(machine.permits_fifo, "scheduling", "fifo", "no_fifo")
    limit, share = machine.lock_limit, machine.rt_runtime
    yield _judge(limit is None, "memory", "memory_lock", "no_memory_lock", limit=limit)
    if share is not None:
        yield _judge(share > 0.0, "RT throttling", "rt_throttling", "no_rt_time", share=share)
    release, cores = machine.kernel, machine.cores
    yield _judge(machine.has_preempt_rt, "kernel", "kernel", "no_preempt_rt", release=release)
    yield _judge(cores >= FEW_CORES, "cores", "cores", "few_cores", cores=cores)
    yield _judge(machine.load <= cores / 2, "load", "load", "high_load", load=machine.load)
    if machine.governor:
        is_fast = machine.governor != "powersave"
        governor = machine.governor
        yield _judge(is_fast, "frequency", "governor", "slow_governor", governor=governor)


def _clocks(machine: Machine) -> Iterator[Finding]:
    resolution, source = machine.clock_resolution, machine.clock_source
    is_fine = resolution <= COARSE_CLOCK
    yield _judge(is_fine, "timers", "timers", "coarse_timers", resolution=resolution)
    if machine.timer_slack_ns is not None:
        data = {"slack": machine.timer_slack_ns * 1e-9}
        yield Finding("fine", "timer_slack", "timer slack", data)
    if source:
        is_fast = source not in SLOW_CLOCKS
        yield _judge(is_fast, "clock source", "clock_source", "slow_clock", source=source)


def _software(machine: Machine) -> Iterator[Finding]:
    yield Finding("fine", "python", "Python", {"version": ".".join(map(str, machine.python))})
    yield _judge(machine.has_curve, "libzmq", "libzmq", "no_curve", version=machine.zmq)
    yield _runtime_folder(machine)
    for problem, action in machine.key_problems:
        yield Finding("note", "unsafe_keys", "keys", {"problem": problem, "action": action})
    if not machine.key_problems:
        yield Finding("fine", "keys", "keys", {"folder": str(machine.key_folder)})


def _ports(machine: Machine) -> Iterator[Finding]:
    for port in machine.ports:
        data = {"port": str(port), "group": port.group, "rule": UDEV_RULE}
        kind = "port_of_group" if port.group else "port_of_nobody"
        yield _judge(port.is_permitted, port.path, "port", kind, **data)


def _runtime_folder(machine: Machine) -> Finding:
    where, free = "runtime folder", machine.free
    data = {"folder": str(machine.runtime), "free": free}
    if free is None:
        return Finding("problem", "no_runtime_folder", where, data)
    if free < NO_SPACE:
        return Finding("problem", "no_space", where, data)
    return _judge(free >= SMALL_SPACE, where, "space", "little_space", **data)


def _rt_runtime() -> float | None:
    runtime = _read("/proc/sys/kernel/sched_rt_runtime_us")
    period = _read("/proc/sys/kernel/sched_rt_period_us")
    if not runtime or not period:
        return None
    return 1.0 if int(runtime) < 0 else int(runtime) / int(period)


def _free(folder: Path) -> int | None:
    try:
        return shutil.disk_usage(folder).free if os.access(folder, os.W_OK | os.X_OK) else None
    except OSError:
        return None


def _key_problems(folder: Path) -> tuple[tuple[str, str], ...]:
    try:
        entries = [entry for entry in keys.list_keys(folder) if entry.problem]
    except ConfigError as error:
        return ((error.problem, error.action),)
    except OSError as error:
        return ((f"cannot read {folder}: {error.strerror}", ""),)
    return tuple((entry.problem, entry.action) for entry in entries)


def _read(path: str) -> str:
    try:
        return Path(path).read_text(encoding="ascii").strip()
    except (OSError, ValueError):
        return ""
