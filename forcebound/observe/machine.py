"""Fitness of this machine for live runs: what it permits, and what could be better.

Each rule judges what it is given, and :func:`examine` asks the machine. Nothing that is merely slow
or late is a problem: a live run is correct on any machine, and punctual on a good one.
"""

import os
import platform
import shutil
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from forcebound import realtime
from forcebound.errors import ConfigError
from forcebound.folders import runtime_folder
from forcebound.hardware.ports import SerialPort, listed
from forcebound.network import keys, sockets
from forcebound.observe.findings import Finding, fine, note, problem

FEW_CORES = 2  # the chain of nodes has one of its own, all others share the rest
SMALL_SPACE = 200_000_000  # B in the runtime folder; a recording of some minutes
NO_SPACE = 10_000_000  # B, with which no run can begin
STEAL_S = 0.5  # s, in which steal is measured at least
LARGE_STEAL = 0.02  # of all processors' time
COARSE_CLOCK = 1e-6  # s; without high-resolution timers a clock steps by milliseconds
CLOCK_SOURCE = "/sys/devices/system/clocksource/clocksource0/current_clocksource"
SLOW_CLOCKS = ("hpet", "acpi_pm", "jiffies", "refined-jiffies")  # microseconds to read, or coarse
#: Of udev: gives serial ports on USB to a group, as most distributions do.
UDEV_RULE = 'KERNEL=="ttyACM[0-9]*|ttyUSB[0-9]*", GROUP="dialout", MODE="0660"'


def examine() -> list[Finding]:
    """Return the findings about this machine, first what prevents live runs."""
    cores = len(os.sched_getaffinity(0))
    version, has_curve = sockets.library()
    folder = runtime_folder() or Path(tempfile.gettempdir())
    governor = f"/sys/devices/system/cpu/cpu{max(os.sched_getaffinity(0))}/cpufreq/scaling_governor"
    is_punctual = _read("/sys/kernel/realtime") == "1" or "PREEMPT_RT" in platform.version()
    findings = [
        scheduling(realtime.permits_fifo()),
        memory_lock(realtime.memory_lock_limit()),
        *throttling(_read("/proc/sys/kernel/sched_rt_runtime_us")),
        kernel(platform.release(), is_punctual),
        processors(cores),
        load(os.getloadavg()[0], cores),
        *frequency(_read(governor)),
        timers(time.clock_getres(time.CLOCK_MONOTONIC)),
        *clock_source(_read(CLOCK_SOURCE)),
        fine("python", "Python", ".".join(map(str, sys.version_info[:3]))),
        libzmq(version, has_curve),
        space(folder, free(folder)),
        *key_folder(keys.key_folder()),
        *map(port, listed()),
    ]
    order = ("problem", "note", "fine")
    return sorted(findings, key=lambda finding: order.index(finding.severity))


def scheduling(permits_fifo: bool) -> Finding:
    """Judge whether a process may use SCHED_FIFO."""
    if permits_fifo:
        words = "SCHED_FIFO is permitted: a node runs as soon as it has something to do"
        return fine("fifo", "scheduling", words)
    words = "SCHED_FIFO is not permitted: under load ticks are late"
    return note("no_fifo", "scheduling", words, realtime.PERMIT_FIFO)


def memory_lock(limit: int | None) -> Finding:
    """Judge how much memory may be locked, in B; None: all."""
    if limit is None:
        return fine("memory_lock", "memory", "may be locked: no tick waits for a page")
    words = f"at most {limit / 1024:.0f} KiB may be locked: sometimes a tick waits for a page"
    return note("no_memory_lock", "memory", words, realtime.PERMIT_LOCK)


def throttling(runtime_us: str) -> Iterator[Finding]:
    """Judge ``sched_rt_runtime_us``; empty: not known."""
    if runtime_us == "0":
        words = "SCHED_FIFO gets no time at all (sched_rt_runtime_us is 0)"
        command = "sudo sysctl kernel.sched_rt_runtime_us=950000"
        yield note("no_rt_time", "RT throttling", words, command=command)


def kernel(release: str, has_preempt_rt: bool) -> Finding:
    """Judge the kernel."""
    if has_preempt_rt:
        return fine("kernel", "kernel", f"{release}, PREEMPT_RT: wakes up within some 10 us")
    words = f"{release}, without PREEMPT_RT: mostly punctual, rarely late by milliseconds"
    action = "if that is too late for you, a kernel with PREEMPT_RT (Debian: linux-image-rt-amd64)"
    return note("no_preempt_rt", "kernel", words, action)


def processors(cores: int) -> Finding:
    """Judge how many cores this process may use."""
    if cores >= FEW_CORES:
        return fine("cores", "cores", f"{cores} may be used")
    words = f"{cores} may be used, by all processes"
    return note("few_cores", "cores", words, f"use a machine with {FEW_CORES} or more")


def load(mean: float, cores: int) -> Finding:
    """Judge the mean number of processes that were ready to run in the last minute."""
    words = f"{mean:.1f} processes were ready to run in the last minute"
    if mean <= cores / 2:
        return fine("load", "load", words)
    action = "end what is not needed (top), or keep it off the highest core (taskset, isolcpus)"
    return note("high_load", "load", f"{words}: ticks may be late", action)


def processor_times() -> tuple[int, int]:
    """Return the time of all processors since boot, and what of it the host took, in ticks."""
    times = [int(word) for word in _read("/proc/stat").partition("\n")[0].split()[1:9]]
    return sum(times), sum(times[7:])  # user nice system idle iowait irq softirq steal


def steal(before: tuple[int, int], after: tuple[int, int]) -> Iterator[Finding]:
    """Judge what the host of a virtual machine took between two :func:`processor_times`."""
    total, stolen = (new - old for old, new in zip(before, after, strict=True))
    if stolen > LARGE_STEAL * total:
        words = (
            f"the host took {stolen / total:.0%} of the processors' time: late ticks, less force"
        )
        yield note("steal", "steal", words, "use a machine that shares its processors less")


def frequency(governor: str) -> Iterator[Finding]:
    """Judge the governor of the cores' frequency; empty: not known."""
    if governor == "powersave":
        words = f"{governor}: the cores may be slow when a tick comes"
        command = "sudo cpupower frequency-set -g performance"
        yield note("slow_governor", "frequency", words, command=command)
    elif governor:
        yield fine("governor", "frequency", governor)


def timers(resolution: float) -> Finding:
    """Judge the resolution of the monotonic clock, in s."""
    if resolution <= COARSE_CLOCK:
        return fine("timers", "timers", "of high resolution")
    words = f"timers step by {1e3 * resolution:g} ms: no servo of 1 kHz"
    action = "a kernel with CONFIG_HIGH_RES_TIMERS, not started with highres=off"
    return note("coarse_timers", "timers", words, action)


def clock_source(source: str) -> Iterator[Finding]:
    """Judge the kernel's clock source; empty: not known."""
    if source in SLOW_CLOCKS:
        words = f"{source}: each reading of the clock costs a microsecond or more"
        action = "if available_clocksource in this folder has tsc"
        command = f"sudo sh -c 'echo tsc >{CLOCK_SOURCE}'"
        yield note("slow_clock", "clock source", words, action, command)
    elif source:
        yield fine("clock_source", "clock source", source)


def libzmq(version: str, has_curve: bool) -> Finding:
    """Judge whether libzmq can encrypt."""
    if has_curve:
        return fine("libzmq", "libzmq", f"{version}, with CURVE encryption")
    words = f"{version}, without CURVE: no environment on another machine"
    command = "pip install --force-reinstall --only-binary pyzmq pyzmq"
    return note("no_curve", "libzmq", words, command=command)


def free(folder: Path) -> int | None:
    """Return the room in a folder, in B; None: it cannot be written."""
    can_write = os.access(folder, os.W_OK | os.X_OK)
    return shutil.disk_usage(folder).free if can_write else None


def space(folder: Path, room: int | None) -> Finding:
    """Judge the room in the runtime folder, as of :func:`free`."""
    advice = (
        "make room, or name another folder",
        "XDG_RUNTIME_DIR=FOLDER forcebound launch FILE",
    )
    if room is None:
        words = f"{folder} cannot be written: no run can begin"
        return problem("no_runtime_folder", "runtime folder", words, *advice)
    if room < NO_SPACE:
        words = f"{1e-6 * room:.1f} MB are free in {folder}: no run can begin"
        return problem("no_space", "runtime folder", words, *advice)
    if room < SMALL_SPACE:
        words = f"{1e-6 * room:.0f} MB are free in {folder}: for minutes of recording"
        return note("little_space", "runtime folder", words, *advice)
    return fine("space", "runtime folder", f"{1e-9 * room:.1f} GB are free in {folder}")


def key_folder(folder: Path) -> list[Finding]:
    """Judge the keys in a folder."""
    try:
        problems = [(one.problem, one.action) for one in keys.list_keys(folder) if one.problem]
    except ConfigError as error:
        problems = [(error.problem, error.action)]
    except OSError as error:
        problems = [(f"cannot read {folder}: {error.strerror}", "")]
    findings = [note("unsafe_keys", "keys", words, action) for words, action in problems]
    return findings or [fine("keys", "keys", f"nothing wrong in {folder}")]


def port(found: SerialPort) -> Finding:
    """Judge whether this user may open a serial port."""
    if found.is_permitted:
        return fine("port", found.path, str(found))
    if found.group:
        words = f"{found} may not be opened by this user"
        action = "join the group that may, then log in again"
        command = f"sudo usermod --append --groups {found.group} $USER"
        return note("port_of_group", found.path, words, action, command)
    words = f"{found} may be opened by root alone"
    action = "a rule of udev gives it to the group dialout, which you join; then replug it"
    command = (
        f"sudo tee /etc/udev/rules.d/60-forcebound.rules <<< '{UDEV_RULE}';"
        " sudo udevadm control --reload; sudo usermod --append --groups dialout $USER"
    )
    return note("port_of_nobody", found.path, words, action, command)


def _read(path: str) -> str:
    try:
        return Path(path).read_text(encoding="ascii").strip()
    except OSError:
        return ""
