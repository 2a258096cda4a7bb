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

from forcebound import realtime
from forcebound.errors import ConfigError
from forcebound.folders import runtime_folder
from forcebound.hardware.ports import SerialPort, listed
from forcebound.monitor.findings import Data, Finding
from forcebound.network import keys, sockets

FEW_CORES = 2  # the chain of nodes has one of its own, all others share the rest
SMALL_SPACE = 200_000_000  # B in the runtime folder; a recording of some minutes
NO_SPACE = 10_000_000  # B, with which no run can begin
COARSE_CLOCK = 1e-6  # s; without high-resolution timers a clock steps by milliseconds
CLOCK_SOURCE = "/sys/devices/system/clocksource/clocksource0/current_clocksource"
#: Of udev: gives serial ports on USB to a group, as most distributions do.
UDEV_RULE = 'KERNEL=="ttyACM[0-9]*|ttyUSB[0-9]*", GROUP="dialout", MODE="0660"'
SLOW_CLOCKS = ("hpet", "acpi_pm", "jiffies", "refined-jiffies")  # microseconds to read, or coarse


@dataclass(frozen=True)
class Machine:
    """Properties of a machine that matter to a live run; None or an empty text: not known."""

    permits_fifo: bool
    lock_limit: int | None  # memory that may be locked, in B; None: as much as there is
    cores: int  # that this process may use
    load: float  # mean number of processes that were ready to run in the last minute
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
        clock_source=_read(CLOCK_SOURCE),
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
        *_processors(machine),
        *_clocks(machine),
        *_software(machine),
        *_ports(machine),
    ]
    return sorted(findings, key=lambda finding: order.index(finding.severity))


def _fine(kind: str, where: str, seen: str, **data: float | str | None) -> Finding:
    return Finding("fine", kind, where, seen, data=data)


def _note(
    kind: str,
    where: str,
    seen: str,
    action: str = "",
    command: str = "",
    **data: float | str | None,
) -> Finding:
    return Finding("note", kind, where, seen, action, command, data)


def _scheduling(machine: Machine) -> Iterator[Finding]:
    if machine.permits_fifo:
        words = "SCHED_FIFO is permitted: a node runs as soon as it has something to do"
        yield _fine("fifo", "scheduling", words)
    else:
        words = "SCHED_FIFO is not permitted: under load ticks are late"
        yield _note("no_fifo", "scheduling", words, realtime.PERMIT_FIFO)
    limit, share = machine.lock_limit, machine.rt_runtime
    if limit is None:
        yield _fine("memory_lock", "memory", "may be locked: no tick waits for a page")
    else:
        words = f"at most {limit / 1024:.0f} KiB may be locked: sometimes a tick waits for a page"
        yield _note("no_memory_lock", "memory", words, realtime.PERMIT_LOCK, limit=limit)
    if share is not None and share > 0.0:
        words = f"SCHED_FIFO gets {share:.0%} of a core; the chain needs less than half"
        yield _fine("rt_throttling", "RT throttling", words, share=share)
    elif share is not None:
        words = "SCHED_FIFO gets no time at all (sched_rt_runtime_us is 0)"
        command = "sudo sysctl kernel.sched_rt_runtime_us=950000"
        yield _note("no_rt_time", "RT throttling", words, command=command)
    release = machine.kernel
    if machine.has_preempt_rt:
        words = f"{release}, PREEMPT_RT: wakes up within some 10 us"
        yield _fine("kernel", "kernel", words, release=release)
    else:
        words = f"{release}, without PREEMPT_RT: mostly punctual, rarely late by milliseconds"
        real = "a kernel with PREEMPT_RT (Debian: linux-image-rt-amd64)"
        action = f"if that is too late for you, {real}"
        yield _note("no_preempt_rt", "kernel", words, action, release=release)


def _processors(machine: Machine) -> Iterator[Finding]:
    cores, load = machine.cores, machine.load
    words = f"{cores} may be used"
    if cores >= FEW_CORES:
        yield _fine("cores", "cores", words, cores=cores)
    else:
        action = "use a machine with 2 or more"
        yield _note("few_cores", "cores", f"{words}, by all processes", action, cores=cores)
    words = f"{load:.1f} processes were ready to run in the last minute"
    if load <= cores / 2:
        yield _fine("load", "load", words, load=load)
    else:
        action = "end what is not needed (top), or keep it off the highest core (taskset, isolcpus)"
        yield _note("high_load", "load", f"{words}: ticks may be late", action, load=load)
    governor = machine.governor
    if governor == "powersave":
        words = f"{governor}: the cores may be slow when a tick comes"
        command = "sudo cpupower frequency-set -g performance"
        yield _note("slow_governor", "frequency", words, command=command)
    elif governor:
        yield _fine("governor", "frequency", governor)


def _clocks(machine: Machine) -> Iterator[Finding]:
    resolution, source = machine.clock_resolution, machine.clock_source
    if resolution <= COARSE_CLOCK:
        yield _fine("timers", "timers", "of high resolution", resolution=resolution)
    else:
        words = f"timers step by {1e3 * resolution:g} ms: no servo of 1 kHz"
        action = "a kernel with CONFIG_HIGH_RES_TIMERS, not started with highres=off"
        yield _note("coarse_timers", "timers", words, action, resolution=resolution)
    if machine.timer_slack_ns is not None:
        words = f"{machine.timer_slack_ns * 1e-3:g} us here; the nodes set theirs to 1 ns"
        slack = machine.timer_slack_ns * 1e-9
        yield _fine("timer_slack", "timer slack", words, slack=slack)
    if source in SLOW_CLOCKS:
        words = f"{source}: each reading of the clock costs a microsecond or more"
        action = "if available_clocksource in this folder has tsc"
        command = f"sudo sh -c 'echo tsc >{CLOCK_SOURCE}'"
        yield _note("slow_clock", "clock source", words, action, command)
    elif source:
        yield _fine("clock_source", "clock source", source)


def _software(machine: Machine) -> Iterator[Finding]:
    yield _fine("python", "Python", ".".join(map(str, machine.python)))
    if machine.has_curve:
        yield _fine("libzmq", "libzmq", f"{machine.zmq}, with CURVE encryption")
    else:
        words = f"{machine.zmq}, without CURVE: no environment on another machine"
        command = "pip install --force-reinstall --only-binary pyzmq pyzmq"
        yield _note("no_curve", "libzmq", words, command=command)
    yield _runtime_folder(machine)
    for problem, action in machine.key_problems:
        yield _note("unsafe_keys", "keys", problem, action)
    if not machine.key_problems:
        yield _fine("keys", "keys", f"nothing wrong in {machine.key_folder}")


def _runtime_folder(machine: Machine) -> Finding:
    where, free, folder = "runtime folder", machine.free, machine.runtime
    action = "make room, or name another folder"
    command = "XDG_RUNTIME_DIR=FOLDER forcebound launch FILE"
    data: Data = {"folder": str(folder), "free": free}
    if free is None:
        words = f"{folder} cannot be written: no run can begin"
        return Finding("problem", "no_runtime_folder", where, words, action, command, data)
    if free < NO_SPACE:
        words = f"{1e-6 * free:.1f} MB are free in {folder}: no run can begin"
        return Finding("problem", "no_space", where, words, action, command, data)
    if free < SMALL_SPACE:
        words = f"{1e-6 * free:.0f} MB are free in {folder}: for minutes of recording"
        return Finding("note", "little_space", where, words, action, command, data)
    return Finding("fine", "space", where, f"{1e-9 * free:.1f} GB are free in {folder}", data=data)


def _ports(machine: Machine) -> Iterator[Finding]:
    for port in machine.ports:
        if port.is_permitted:
            yield _fine("port", port.path, str(port))
        elif port.group:
            words = f"{port} may not be opened by this user"
            action = "join the group that may, then log in again"
            command = f"sudo usermod --append --groups {port.group} $USER"
            yield _note("port_of_group", port.path, words, action, command, group=port.group)
        else:
            words = f"{port} may be opened by root alone"
            action = "a rule of udev gives it to the group dialout, which you join; then replug it"
            command = (
                f"sudo tee /etc/udev/rules.d/60-forcebound.rules <<< '{UDEV_RULE}';"
                " sudo udevadm control --reload; sudo usermod --append --groups dialout $USER"
            )
            yield _note("port_of_nobody", port.path, words, action, command)


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
