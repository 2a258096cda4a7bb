"""Punctuality of a process: scheduling, placement, memory, and waiting for an instant.

How it works:

1. The chain of nodes (device, controller, environment) lives on *one* core, because waking a
   process on another core costs more than the messages themselves; launcher and recorder stay
   off that core (:func:`choose_core`, :func:`leave_core`).
2. On that core the nodes run under SCHED_FIFO, the device above the controller above the
   environment (:data:`forcebound.roles.ROLES`). Never without a reserved core: FIFO
   processes that wander between cores are slower than ordinary ones.
3. The kernel may be late by the timer slack, 50 us by default; 1 ns costs nothing and needs no
   right.
4. A page fault or a garbage collection in the loop costs more than the loop: memory is locked
   where the limits allow it, the objects that exist are frozen, and the collector is switched off.
   The nodes make no reference cycles, so nothing grows.
5. An instant is met by sleeping until shortly before and spinning the rest (:func:`wait_until`).
   A FIFO process that spins lets nobody else run on its core, so the spin is short, and shorter
   still when the wait is short.

Nothing here is required for a correct run, only for a punctual one. What is not permitted becomes a
:class:`~forcebound.roles.Fact`, with what to do about it, and the run goes on.
"""

import ctypes
import gc
import os
import time
from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from forcebound.errors import ConfigError
from forcebound.roles import ROLES, Fact

PR_SET_PDEATHSIG = 1  # <linux/prctl.h>
PR_SET_TIMERSLACK = 29  # <linux/prctl.h>
MCL_CURRENT, MCL_FUTURE, MCL_ONFAULT = 1, 2, 4  # <asm-generic/mman.h>
CAP_IPC_LOCK = 14  # <linux/capability.h>

# What to do where it is not permitted.
PERMIT_FIFO = (
    "add '@realtime - rtprio 95' to /etc/security/limits.d/ and yourself to that group, "
    "or give CAP_SYS_NICE"
)
PERMIT_AWAKE = "give this user the right to write /dev/cpu_dma_latency"
PERMIT_LOCK = "add '@realtime - memlock unlimited' to /etc/security/limits.d/, or give CAP_IPC_LOCK"

CPU_LATENCY = "/dev/cpu_dma_latency"  # <kernel: admin-guide/pm/cpuidle, PM QoS>

TIMER_SLACK_NS = 1  # smallest that is not "the default of 50 us"

MAX_SPIN_SHARE = 8  # a wait is spun for at most this fraction of it, 1/8

_libc = ctypes.CDLL(None, use_errno=True)


@dataclass(frozen=True)
class Settings:
    """Requested scheduling of a process."""

    policy: str = "fifo"  # or "other": ordinary scheduling
    core: int | None = None  # that the chain of nodes shares; None: any, and then never SCHED_FIFO
    lock_memory: bool = True  # whether pages in use stay in memory
    deep_sleep: bool = True  # whether idle processors may sleep deeply; waking then takes longer
    spin_ns: int = 30_000  # before an instant, when the sleep ends and the spinning begins


def choose_core(
    requested: str | int, allowed: Collection[int] | None = None, taken: Sequence[int | None] = ()
) -> int | None:
    """Return the core for the chain of nodes; None for ``"none"``, no reserved core.

    For ``"auto"`` it is the highest of those that the fewest other graphs have ``taken``, because
    core 0 takes most interrupts. ``allowed`` are by default the cores that the kernel says.

    Raises:
        ConfigError: If the core is not one of those allowed.
    """
    cores = sorted(os.sched_getaffinity(0) if allowed is None else allowed)
    if requested == "none":
        return None
    if requested == "auto":
        return max(cores, key=lambda core: (-taken.count(core), core))
    if requested not in cores:
        known = ", ".join(str(core) for core in cores)
        raise ConfigError(
            f"realtime.cores: this process may not run on core {requested}; "
            f"use one of {known}, or auto, or none"
        )
    return int(requested)


def leave_core(core: int | None) -> set[int]:
    """Leave ``core`` to others if there is another one; return the cores used until now."""
    before = os.sched_getaffinity(0)
    rest = before - {core}
    if core is not None and rest and rest != before:
        os.sched_setaffinity(0, rest)
    return before


@contextmanager
def on_cores(cores: Collection[int]) -> Iterator[None]:
    """Use ``cores`` during the body, as do the processes that it starts; none: the present ones."""
    before = os.sched_getaffinity(0)
    os.sched_setaffinity(0, cores or before)
    try:
        yield
    finally:
        os.sched_setaffinity(0, before)


def enter(settings: Settings, role: str) -> list[Fact]:
    """Make this process as punctual as it is permitted to be; return what was set and what not.

    Call it before the ZeroMQ context exists: its input and output thread inherits what is set here.
    A role that is no node (the recorder, an emulator) is kept off the nodes' core and scheduled
    ordinarily.
    """
    _libc.prctl(PR_SET_TIMERSLACK, ctypes.c_ulong(TIMER_SLACK_NS))
    if role not in ROLES or not ROLES[role].priority:
        leave_core(settings.core)
        return []
    facts = [_pin(settings.core), _schedule(settings, role)]
    if settings.lock_memory:
        facts.append(_lock_memory())
    if not settings.deep_sleep:
        facts.append(_stay_awake())
    return facts


def be_ordinary() -> None:
    """Leave SCHED_FIFO: who still works on this core must not wait for the end of this process."""
    os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))


def freeze_garbage() -> None:
    """Set aside all objects that there are, and switch the cyclic garbage collector off.

    Call it last before the loop, when everything that lives long exists. Some hundred objects of
    garbage of the start stay: to look for them takes 50 ms.
    """
    gc.freeze()
    gc.disable()


@contextmanager
def without_garbage_collection() -> Iterator[None]:
    """Keep the cyclic garbage collector out of a loop that makes no cycles, then as it was."""
    was_on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_on:
            gc.enable()


def wait_until(time_ns: int, spin_ns: int) -> int:
    """Sleep until shortly before an instant of the monotonic clock, then spin; return the time.

    Returns at once if the instant has passed. A caught signal does not shorten the wait. At least
    seven eighths of the wait are slept, because while this process spins under SCHED_FIFO, the
    processes on the same core whose answer it waits for do not run.
    """
    now = time.monotonic_ns()
    wait_ns = time_ns - now
    if wait_ns > 0:
        time.sleep((wait_ns - min(spin_ns, wait_ns // MAX_SPIN_SHARE)) * 1e-9)
        now = time.monotonic_ns()
    while now < time_ns:
        now = time.monotonic_ns()
    return now


def die_with_parent(signal_number: int) -> None:
    """Ask the kernel to send this process a signal when the process that started it is gone.

    A parent that died before this call is not noticed: compare ``os.getppid()`` afterwards.
    """
    _libc.prctl(PR_SET_PDEATHSIG, ctypes.c_ulong(signal_number))


def permits_fifo() -> bool:
    """Return whether this process may use SCHED_FIFO, by doing so for an instant."""
    policy, parameters = os.sched_getscheduler(0), os.sched_getparam(0)
    highest = max(role.priority for role in ROLES.values())
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(highest))
    except OSError:
        return False
    os.sched_setscheduler(0, policy, parameters)
    return True


def memory_lock_limit() -> int | None:
    """Return how much memory this process may lock, in bytes; None: as much as there is."""
    import resource  # Unix only, and only here and below

    hard = resource.getrlimit(resource.RLIMIT_MEMLOCK)[1]
    unlimited = hard == resource.RLIM_INFINITY or _has_capability(CAP_IPC_LOCK)
    return None if unlimited else hard


def _pin(core: int | None) -> Fact:
    if core is None:
        fast = "one core for the chain is about twice as fast"
        return Fact("any_core", f"on any core (realtime.cores: none); {fast}")
    try:
        os.sched_setaffinity(0, {core})
    except OSError as error:
        advice = "choose another one with realtime.cores"
        return Fact("core_refused", f"not on core {core}: {error.strerror}; {advice}")
    return Fact("core", f"on core {core}", is_hindrance=False)


def _schedule(settings: Settings, role: str) -> Fact:
    ordinary = "ordinary scheduling"
    if settings.policy != "fifo":
        return Fact("fifo_not_wanted", f"{ordinary} (realtime.policy: other)")
    if settings.core is None or os.sched_getaffinity(0) != {settings.core}:
        why = "because SCHED_FIFO without a core of its own is slower"
        return Fact("fifo_without_core", f"{ordinary}, {why}")
    priority = ROLES[role].priority
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    except PermissionError:
        why = "because SCHED_FIFO is not permitted: expect late ticks"
        return Fact("fifo_not_permitted", f"{ordinary}, {why}; {PERMIT_FIFO}")
    except OSError as error:
        why = f"because SCHED_FIFO is refused here: {error.strerror}"
        return Fact("fifo_refused", f"{ordinary}, {why}")
    return Fact("fifo", f"SCHED_FIFO priority {priority}", is_hindrance=False)


def _lock_memory() -> Fact:
    # With a finite limit the call itself may succeed and a later allocation then fails.
    import resource

    limit = memory_lock_limit()
    if limit is not None:
        why = f"because the limit is {limit} B: expect rare late ticks"
        return Fact("memory_limited", f"memory not locked, {why}; {PERMIT_LOCK}")
    soft, hard = resource.getrlimit(resource.RLIMIT_MEMLOCK)
    if soft != hard == resource.RLIM_INFINITY:
        resource.setrlimit(resource.RLIMIT_MEMLOCK, (hard, hard))
    if _libc.mlockall(MCL_CURRENT | MCL_FUTURE | MCL_ONFAULT) != 0:
        return Fact("memory_refused", f"memory not locked: {os.strerror(ctypes.get_errno())}")
    return Fact("memory_locked", "memory locked", is_hindrance=False)


def _stay_awake() -> Fact:
    """Ask the kernel for no latency of waking; it holds for as long as this process lives."""
    try:
        descriptor = os.open(CPU_LATENCY, os.O_WRONLY | os.O_CLOEXEC)  # never closed: see above
        os.write(descriptor, bytes(4))
    except OSError as error:
        why = f"processors may sleep deeply: {error.strerror}"
        return Fact("awake_refused", f"{why}; {PERMIT_AWAKE}")
    return Fact("awake", "processors kept out of deep sleep", is_hindrance=False)


def _has_capability(number: int) -> bool:
    try:
        status = Path("/proc/self/status").read_text(encoding="ascii")
    except OSError:
        return False
    effective = next((line for line in status.splitlines() if line.startswith("CapEff:")), "0 0")
    return bool(int(effective.split()[1], 16) >> number & 1)
