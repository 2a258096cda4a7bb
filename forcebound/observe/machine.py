"""Fitness of this machine for live runs: what it permits, and what could be better.

:func:`look` asks the machine, :func:`judge` judges what it says. Nothing that is merely slow or
late is a problem: a live run is correct on any machine, and punctual on a good one.
"""

import os
import platform
import shutil
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from forcebound import realtime
from forcebound.errors import ConfigError, DeviceError
from forcebound.folders import runtime_folder
from forcebound.hardware import inverse_service
from forcebound.hardware.ports import SerialPort, listed
from forcebound.network import keys, sockets
from forcebound.observe.findings import Finding, fine, note, problem

FEW_CORES = 2  # the chain of nodes has one of its own, all others share the rest
SMALL_SPACE = 200_000_000  # B in the runtime folder; a recording of some minutes
NO_SPACE = 10_000_000  # B, with which no run can begin
STEAL_S = 0.5  # s, in which steal is measured at least
LARGE_STEAL = 0.02  # of all processors' time
CLOCK_SOURCE = "/sys/devices/system/clocksource/clocksource0/current_clocksource"
SLOW_CLOCKS = ("hpet", "acpi_pm", "jiffies", "refined-jiffies")  # microseconds to read, or coarse
OPEN_TO_ALL = "communication/bind_all_interfaces"
SERVICE_SETTINGS = "/etc/haply-inverse-service/haply-inverse-service-config.json"
#: Of udev: gives serial ports on USB to a group, as most distributions do.
UDEV_RULE = 'KERNEL=="ttyACM[0-9]*|ttyUSB[0-9]*", GROUP="dialout", MODE="0660"'


@dataclass(frozen=True)
class Machine:
    """What this machine says of itself; an empty text: not known."""

    permits_fifo: bool
    lock_limit: int | None  # B of memory that may be locked; None: all
    fifo_us: str  # of each second, for SCHED_FIFO: sched_rt_runtime_us
    kernel: str  # its release
    has_preempt_rt: bool
    cores: int  # that this process may use
    load: float  # mean number of processes that were ready to run in the last minute
    governor: str  # of a core's frequency
    clock_source: str
    libzmq: str  # its version
    has_curve: bool
    folder: Path  # of run directories
    room: int | None  # B there; None: it cannot be written


def examine() -> list[Finding]:
    """Return the findings about this machine, first what prevents live runs."""
    ports = listed()
    findings = [*judge(look()), *key_folder(), *map(port, ports), *haply_service(ports)]
    findings += filter(None, (rule(one) for one in ports for rule in (modem_manager, latency)))
    order = ("problem", "note", "fine")
    return sorted(findings, key=lambda finding: order.index(finding.severity))


def look() -> Machine:
    """Return what this machine says of itself."""
    cores = os.sched_getaffinity(0)
    version, has_curve = sockets.library()
    folder = runtime_folder() or Path(tempfile.gettempdir())
    can_write = os.access(folder, os.W_OK | os.X_OK)
    return Machine(
        permits_fifo=realtime.permits_fifo(),
        lock_limit=realtime.memory_lock_limit(),
        fifo_us=_read("/proc/sys/kernel/sched_rt_runtime_us"),
        kernel=platform.release(),
        has_preempt_rt=_read("/sys/kernel/realtime") == "1" or "PREEMPT_RT" in platform.version(),
        cores=len(cores),
        load=os.getloadavg()[0],
        governor=_read(f"/sys/devices/system/cpu/cpu{max(cores)}/cpufreq/scaling_governor"),
        clock_source=_read(CLOCK_SOURCE),
        libzmq=version,
        has_curve=has_curve,
        folder=folder,
        room=shutil.disk_usage(folder).free if can_write else None,
    )


def judge(here: Machine) -> Iterator[Finding]:
    """Give the findings about a machine: what could be better with what to do, and what is fine."""
    bad = {finding.where: finding for finding in _flaws(here)}
    good = {
        "scheduling": "SCHED_FIFO is permitted: a node runs as soon as it has something to do",
        "memory": "may be locked: no tick waits for a page",
        "kernel": f"{here.kernel}, PREEMPT_RT: wakes up within some 10 us",
        "cores": f"{here.cores} may be used",
        "load": f"{here.load:.1f} processes were ready to run in the last minute",
        "frequency": here.governor,
        "clock source": here.clock_source,
        "libzmq": f"{here.libzmq}, with CURVE encryption",
        "runtime folder": f"{1e-9 * (here.room or 0):.1f} GB are free in {here.folder}",
    }
    yield from bad.values()
    for where, words in good.items():
        if words and where not in bad:
            yield fine(where.replace(" ", "_"), where, words)


def _flaws(here: Machine) -> Iterator[Finding]:
    if not here.permits_fifo:
        words = "SCHED_FIFO is not permitted: under load ticks are late"
        yield note("no_fifo", "scheduling", words, realtime.PERMIT_FIFO)
    elif here.fifo_us == "0":
        words = "SCHED_FIFO gets no time at all (sched_rt_runtime_us is 0)"
        command = "sudo sysctl kernel.sched_rt_runtime_us=950000"
        yield note("no_rt_time", "scheduling", words, command=command)
    if here.lock_limit is not None:
        words = (
            f"at most {here.lock_limit / 1024:.0f} KiB may be locked: a tick may wait for a page"
        )
        yield note("no_memory_lock", "memory", words, realtime.PERMIT_LOCK)
    if not here.has_preempt_rt:
        words = f"{here.kernel}, without PREEMPT_RT: mostly punctual, rarely late by milliseconds"
        action = "if that is too late for you, a kernel with it (Debian: linux-image-rt-amd64)"
        yield note("no_preempt_rt", "kernel", words, action)
    if here.cores < FEW_CORES:
        words = f"{here.cores} may be used, by all processes"
        yield note("few_cores", "cores", words, f"use a machine with {FEW_CORES} or more")
    if here.load > here.cores / 2:
        words = f"{here.load:.1f} processes were ready to run in the last minute: late ticks"
        action = "end what is not needed (top), or keep it off the highest core (taskset, isolcpus)"
        yield note("high_load", "load", words, action)
    if here.governor == "powersave":
        words = f"{here.governor}: the cores may be slow when a tick comes"
        command = "sudo cpupower frequency-set -g performance"
        yield note("slow_governor", "frequency", words, command=command)
    if here.clock_source in SLOW_CLOCKS:
        words = f"{here.clock_source}: each reading of the clock costs a microsecond or more"
        action = "if available_clocksource in this folder has tsc"
        command = f"sudo sh -c 'echo tsc >{CLOCK_SOURCE}'"
        yield note("slow_clock", "clock source", words, action, command)
    if not here.has_curve:
        words = f"{here.libzmq}, without CURVE: no environment on another machine"
        command = "pip install --force-reinstall --only-binary pyzmq pyzmq"
        yield note("no_curve", "libzmq", words, command=command)
    if here.room is None or here.room < SMALL_SPACE:
        is_enough = here.room is not None and here.room >= NO_SPACE
        what = (
            f"{1e-6 * here.room:.1f} MB are free in" if here.room is not None else "no writing in"
        )
        then = "minutes of recording" if is_enough else "no run can begin"
        action = "make room, or name another folder"
        command = "XDG_RUNTIME_DIR=FOLDER forcebound launch FILE"
        report, kind = (note, "little_space") if is_enough else (problem, "no_space")
        words = f"{what} in {here.folder}: {then}"
        yield report(kind, "runtime folder", words, action, command)


def key_folder(folder: Path | None = None) -> list[Finding]:
    """Judge the keys in a folder; None: the user's."""
    try:
        folder = folder or keys.key_folder()
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
    action, group, rule = "join the group that may, then log in again", found.group or "dialout", ""
    if not found.group:
        action = "a rule of udev gives it to the group dialout, which you join; then replug it"
        rule = f"sudo tee /etc/udev/rules.d/60-forcebound.rules <<< '{UDEV_RULE}';"
        rule += " sudo udevadm control --reload; "
    command = f"{rule}sudo usermod --append --groups {group} $USER"
    kind = "port_of_group" if found.group else "port_of_nobody"
    return note(kind, found.path, f"{found} may not be opened by this user", action, command)


def modem_manager(
    found: SerialPort, processes: Path = Path("/proc"), udev: Path = Path("/run/udev/data")
) -> Finding | None:
    """Judge whether ModemManager writes to the port of a device, as to those of modems."""
    runs = any(_read(f"{one}/comm") == "ModemManager" for one in processes.glob("[0-9]*"))
    if not runs or not found.seems:
        return None
    with suppress(OSError):
        number = os.stat(found.path).st_rdev
        known = udev / f"c{os.major(number)}:{os.minor(number)}"
        if "ID_MM_DEVICE_IGNORE=1" in known.read_text(errors="replace"):
            return None
    words = f"{found}: ModemManager runs, and may write to it when it is plugged in"
    rule = 'SUBSYSTEM=="tty", ENV{ID_MM_DEVICE_IGNORE}="1"'
    command = f"sudo tee /etc/udev/rules.d/61-forcebound.rules <<< '{rule}'"
    action = "let it ignore serial ports, if none of them is a modem; then replug the device"
    return note("modem_manager", found.path, words, action, command)


def latency(
    found: SerialPort, devices: Path = Path("/sys/bus/usb-serial/devices")
) -> Finding | None:
    """Judge how long the converter at a port keeps a short answer for more bytes to come."""
    timer = devices / os.path.basename(os.path.realpath(found.path)) / "latency_timer"
    if (waits := _read(str(timer))) in ("", "1"):
        return None
    words = f"{found} keeps a short answer for {waits} ms: a tick of servos takes as long"
    action = "set its latency timer to 1 ms, each time after it was plugged in"
    return note("latency_timer", found.path, words, action, f"echo 1 | sudo tee {timer}")


def haply_service(
    ports: Sequence[SerialPort], address: str = inverse_service.LOCAL
) -> Iterator[Finding]:
    """Judge the service of an Inverse3; nothing if there is neither device nor service."""
    where, soon = f"Haply service at {address}", inverse_service.SOON
    try:
        version = inverse_service.check_version(address, soon)
        is_open = inverse_service.setting(address, OPEN_TO_ALL, bool, soon)
    except DeviceError as error:
        if any(found.seems == "haply_inverse3" for found in ports):
            words = f"an Inverse3 seems to be plugged in, but {error}"
            yield problem("no_haply_service", where, words)
        return
    if is_open:
        words = f"listens to the whole network ({OPEN_TO_ALL}): everybody there can move the device"
        action = f"set it to false in {SERVICE_SETTINGS}, and restart the service"
        yield problem("haply_open", where, words, action)
    found = ", ".join(each.serial_number for each in inverse_service.listed(address)) or "none"
    yield fine("haply_service", where, f"version {version}, Inverse3: {found}")


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


def _read(path: str) -> str:
    try:
        return Path(path).read_text(encoding="ascii").strip()
    except OSError:
        return ""
