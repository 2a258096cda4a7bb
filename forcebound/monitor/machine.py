"""Is this machine fit for live runs? What it permits, and how to make it more punctual.

:func:`look` asks the machine, :func:`examine` judges the answers. Nothing that is merely slow or
late is a problem: a live run is correct on any machine, and punctual on a good one.
"""

import os
import platform
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from forcebound import realtime
from forcebound.errors import ConfigError
from forcebound.monitor.findings import Finding
from forcebound.network import keys, sockets

FEW_CORES = 2  # the chain of nodes has one of its own, all others share the rest
SMALL_SPACE = 200_000_000  # B in the temporary folder; a recording of some minutes
NO_SPACE = 10_000_000  # B, with which no run can begin
COARSE_CLOCK = 1e-6  # s; without high-resolution timers a clock steps by milliseconds
SLOW_CLOCKS = ("hpet", "acpi_pm", "jiffies", "refined-jiffies")  # microseconds to read, or coarse


@dataclass(frozen=True)
class Machine:
    """What a machine says of itself.

    Attributes:
        permits_fifo: Whether SCHED_FIFO is permitted.
        lock_limit: Memory that may be locked, in B; None: as much as there is.
        cores: Number of cores that this process may use.
        load: Mean number of processes that wanted to run in the last minute.
        rt_runtime: Share of a second that SCHED_FIFO may use a core, 0 to 1; None: not known.
        timer_slack_ns: How much later than asked the kernel may wake an ordinary process, in ns.
        clock_resolution: Of the monotonic clock, in s.
        clock_source: What the kernel's clock counts, such as ``tsc``; empty: not known.
        governor: Of the frequency of the cores, such as ``powersave``; empty: not known.
        has_preempt_rt: Whether the kernel is built with PREEMPT_RT.
        kernel: Its release.
        python: Version.
        zmq: Version of libzmq.
        has_curve: Whether libzmq can encrypt.
        temporary: Folder for run directories.
        free: Room in it, in B; None: it cannot be used.
        key_folder: Where keys are kept.
        key_problems: Why keys cannot be used, each with what to do; empty: nothing is wrong.
    """

    permits_fifo: bool
    lock_limit: int | None
    cores: int
    load: float
    rt_runtime: float | None
    timer_slack_ns: int | None
    clock_resolution: float
    clock_source: str
    governor: str
    has_preempt_rt: bool
    kernel: str
    python: tuple[int, int, int]
    zmq: str
    has_curve: bool
    temporary: Path
    free: int | None
    key_folder: Path
    key_problems: tuple[tuple[str, str], ...] = ()


def look() -> Machine:
    """Return what this machine says of itself."""
    folder = keys.key_folder()
    try:
        temporary = Path(tempfile.gettempdir())
    except OSError:  # it has tried all there are
        temporary = Path("/tmp")
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
        temporary=temporary,
        free=_free(temporary),
        key_folder=folder,
        key_problems=_key_problems(folder),
    )


def examine(machine: Machine) -> list[Finding]:
    """Return what there is to say about a machine, what prevents live runs first."""
    order = ("problem", "note", "fine")
    findings = [
        *_scheduling(machine),
        *_cores(machine),
        *_clocks(machine),
        *_software(machine),
        *_folders(machine),
    ]
    return sorted(findings, key=lambda finding: order.index(finding.severity))


def _scheduling(machine: Machine) -> Iterator[Finding]:
    if machine.permits_fifo:
        text = "SCHED_FIFO is permitted: a node runs as soon as it has something to do"
        yield Finding("fine", "fifo", "scheduling", text)
    else:
        text = "SCHED_FIFO is not permitted: on a busy machine ticks come late"
        yield Finding("note", "no_fifo", "scheduling", text, realtime.PERMIT_FIFO)
    if machine.lock_limit is None:
        yield Finding("fine", "memory_lock", "memory", "may be locked: no tick waits for a page")
    else:
        text = f"at most {machine.lock_limit // 1024} KiB may be locked: now and then a tick waits"
        text += " for a page"
        yield Finding("note", "no_memory_lock", "memory", text, realtime.PERMIT_LOCK)
    share = machine.rt_runtime
    if share == 0.0:
        text = "SCHED_FIFO gets no time at all (sched_rt_runtime_us is 0)"
        action = "sudo sysctl kernel.sched_rt_runtime_us=950000"
        yield Finding("note", "rt_throttling", "RT throttling", text, action)
    elif share is not None:
        text = f"SCHED_FIFO gets at most {share:.0%} of a core; the chain needs less than half"
        yield Finding("fine", "rt_throttling", "RT throttling", text)
    if machine.has_preempt_rt:
        text = f"{machine.kernel}, PREEMPT_RT: wakes up within some 10 us"
        yield Finding("fine", "kernel", "kernel", text)
    else:
        text = f"{machine.kernel}, without PREEMPT_RT: mostly punctual, rarely late by milliseconds"
        action = "a kernel with PREEMPT_RT (Debian: apt install linux-image-rt-amd64), if that is"
        yield Finding("note", "no_preempt_rt", "kernel", text, f"{action} too late for you")


def _cores(machine: Machine) -> Iterator[Finding]:
    text = f"{machine.cores} may be used"
    if machine.cores < FEW_CORES:
        text += ": launcher, recorder and all others share it with the chain of nodes"
        yield Finding("note", "few_cores", "cores", text, "use a machine with 2 cores or more")
    else:
        yield Finding("fine", "cores", "cores", text)
    text = f"{machine.load:.1f} processes wanted to run in the last minute"
    if machine.load > machine.cores / 2:
        action = "end what is not needed (top), or keep it off the highest core (taskset, isolcpus)"
        yield Finding("note", "load", "load", f"{text}: ticks may be late", action)
    else:
        yield Finding("fine", "load", "load", text)
    if machine.governor == "powersave":
        text = "powersave: the cores may be slow when a tick comes"
        action = "sudo cpupower frequency-set -g performance"
        yield Finding("note", "governor", "frequency", text, action)
    elif machine.governor:
        yield Finding("fine", "governor", "frequency", machine.governor)


def _clocks(machine: Machine) -> Iterator[Finding]:
    if machine.clock_resolution > COARSE_CLOCK:
        text = f"timers step by {machine.clock_resolution * 1e3:g} ms: no servo of 1 kHz"
        action = "a kernel with CONFIG_HIGH_RES_TIMERS, not started with highres=off"
        yield Finding("note", "coarse_timers", "timers", text, action)
    else:
        yield Finding("fine", "timers", "timers", "of high resolution")
    if machine.timer_slack_ns is not None:
        text = f"{machine.timer_slack_ns / 1e3:g} us here; the nodes set theirs to 1 ns"
        yield Finding("fine", "timer_slack", "timer slack", text)
    source = machine.clock_source
    if source in SLOW_CLOCKS:
        text = f"{source}: each look at the clock costs a microsecond or more"
        action = "echo tsc | sudo tee /sys/devices/system/clocksource/clocksource0/"
        action += "current_clocksource, if available_clocksource there has it"
        yield Finding("note", "slow_clock", "clock source", text, action)
    elif source:
        yield Finding("fine", "clock_source", "clock source", source)


def _software(machine: Machine) -> Iterator[Finding]:
    version = ".".join(map(str, machine.python))
    yield Finding("fine", "python", "Python", version)
    if machine.has_curve:
        yield Finding("fine", "libzmq", "libzmq", f"{machine.zmq}, with CURVE encryption")
    else:
        text = f"{machine.zmq}, without CURVE: no environment on another machine"
        action = "pip install --force-reinstall --only-binary pyzmq pyzmq"
        yield Finding("note", "no_curve", "libzmq", text, action)


def _folders(machine: Machine) -> Iterator[Finding]:
    where, free = "temporary folder", machine.free
    action = "make room, or name another folder: TMPDIR=FOLDER forcebound launch ..."
    if free is None:
        text = f"{machine.temporary} cannot be written: no run can begin"
        yield Finding("problem", "no_temporary_folder", where, text, action)
    elif free < NO_SPACE:
        text = f"{free / 1e6:.1f} MB are free in {machine.temporary}: no run can begin"
        yield Finding("problem", "no_space", where, text, action)
    elif free < SMALL_SPACE:
        text = f"{free / 1e6:.0f} MB are free in {machine.temporary}: for minutes of recording"
        yield Finding("note", "little_space", where, text, action)
    else:
        text = f"{free / 1e9:.1f} GB are free in {machine.temporary}"
        yield Finding("fine", "space", where, text)
    for text, action in machine.key_problems:
        yield Finding("note", "unsafe_keys", "keys", text, action)
    if not machine.key_problems:
        text = f"nothing wrong in {machine.key_folder}"
        yield Finding("fine", "keys", "keys", text)


def _rt_runtime() -> float | None:
    runtime = _read("/proc/sys/kernel/sched_rt_runtime_us")
    period = _read("/proc/sys/kernel/sched_rt_period_us")
    if not runtime or not period:
        return None
    return 1.0 if int(runtime) < 0 else int(runtime) / int(period)


def _free(folder: Path) -> int | None:
    try:
        if not os.access(folder, os.W_OK | os.X_OK):
            return None
        disk = os.statvfs(folder)
    except OSError:
        return None
    return disk.f_bavail * disk.f_frsize


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
