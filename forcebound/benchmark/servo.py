"""Benchmark of the servo: punctuality of wake-ups against a C loop, and cost of a tick.

1. Wake-up: :func:`forcebound.realtime.wait_until` on an absolute schedule against ``pacing.c``,
   built on the spot, for each scheduling class that is permitted; same core, same class, same
   priority, alternately.
2. Tick: the real device node on real sockets (:mod:`forcebound.benchmark.servo_tick`), at the given
   rate and at 4 kHz, in the best class that is permitted.
"""

import contextlib
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from forcebound.benchmark.figures import Measured, compare, judge, plan, report
from forcebound.benchmark.workers import (
    READY,
    WARMUP,
    collect,
    compile_c,
    conditions,
    module,
    started,
)
from forcebound.processes import PROCESSES
from forcebound.realtime import choose_core

WAKE_UP_TARGET = 1.0  # ratio to C, p50 and p99
TICK_TARGET_US = 60.0  # p99
PROCESSOR_TARGET = 0.12  # share of one processor at 1 kHz
FAST_RATE = 4000.0  # Hz, to be held without a miss

_TICK_SHARE = 0.4  # of the duration, for the two tick contestants together


def run(duration: float, rate: float, progress: Callable[[str], None]) -> dict[str, Any]:
    """Run the benchmark; see :meth:`forcebound.benchmark.Benchmark.run`."""
    surroundings = conditions()
    policies: list[str] = surroundings["policies"]
    core = choose_core("auto")
    assert core is not None
    with tempfile.TemporaryDirectory(prefix="forcebound-") as folder:
        program = compile_c("pacing.c", Path(folder))
        pairs = _wake_ups(program, core, policies, duration * (1 - _TICK_SHARE), rate, progress)
        policy = policies[-1]
        ticks = {
            f"tick_{each_rate:.0f}_hz": _ticks(
                core, policy, duration * _TICK_SHARE / 2, each_rate, progress
            )
            for each_rate in dict.fromkeys((rate, FAST_RATE))
        }
    contestants = {name: one for pair in pairs.values() for name, one in pair.items()} | ticks
    comparisons = _compare_wake_ups(pairs) | _judge_ticks(ticks, rate)
    surroundings |= {"core": core, "tick_policy": policy}
    return report("servo", duration, rate, contestants, comparisons, surroundings)


def _wake_ups(
    program: Path,
    core: int,
    policies: list[str],
    duration: float,
    rate: float,
    progress: Callable[[str], None],
) -> dict[str, dict[str, Measured]]:
    """Return, for each policy, ours and the limit by name, in this order."""
    pairs = {
        policy: {
            f"wake_up_{policy}": Measured(f"wake-up, {policy}"),
            f"wake_up_{policy}_c": Measured(f"C loop, {policy}"),
        }
        for policy in policies
    }
    rounds, count = plan(duration, 2 * len(policies), rate)
    period_ns = round(1e9 / rate)
    takes = (WARMUP + count) / rate
    for number in range(rounds):
        for policy, (ours, limit) in ((p, pair.values()) for p, pair in pairs.items()):
            progress(f"round {number + 1} of {rounds}: wake-ups, {policy}")
            arguments = (core, policy, period_ns, count)
            collect(module("pacing", *arguments), takes, ours)
            priority = PROCESSES["device"].priority
            limit_arguments = (core, policy, priority, period_ns, WARMUP, count)
            collect([str(program), *map(str, limit_arguments)], takes, limit)
    return pairs


def _ticks(
    core: int, policy: str, duration: float, rate: float, progress: Callable[[str], None]
) -> Measured:
    measured = Measured(f"tick at {rate:.0f} Hz, {policy}")
    _, count = plan(duration, 1, rate)
    count = max(count, round(duration * rate))
    progress(f"ticks at {rate:.0f} Hz, {policy}")
    with contextlib.ExitStack() as stack:
        folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="forcebound-"))
        arguments = (folder, core, policy, round(1e9 / rate), count)
        stack.enter_context(started(module("servo_tick", "controller", *arguments)))
        command = module("servo_tick", "device", *arguments)
        collect(command, READY + (WARMUP + count) / rate, measured)
    return measured


def _compare_wake_ups(pairs: dict[str, dict[str, Measured]]) -> dict[str, dict[str, Any]]:
    compared = {}
    for policy, pair in pairs.items():
        ours, limit = pair.values()
        for name, target in (("p50", WAKE_UP_TARGET), ("p99", WAKE_UP_TARGET), ("p99_9", None)):
            compared[f"wake_up_{policy}_{name}"] = compare(ours, limit, name, target)
        share = ours.processor_share
        what = f"{ours.label}, processor share"
        compared[f"wake_up_{policy}_processor"] = judge(what, share, "share", None)
    return compared


def _judge_ticks(ticks: dict[str, Measured], rate: float) -> dict[str, dict[str, Any]]:
    judged = {}
    for name, one in ticks.items():
        is_fast = name != f"tick_{rate:.0f}_hz"
        p99 = one.at("p99") / 1e3
        judged[f"{name}_p99"] = judge(
            f"{one.label}, p99", p99, "us", None if is_fast else TICK_TARGET_US
        )
        judged[f"{name}_processor"] = judge(
            f"{one.label}, processor share",
            one.processor_share,
            "share",
            PROCESSOR_TARGET if rate == 1000.0 and not is_fast else None,
        )
        judged[f"{name}_missed"] = judge(f"{one.label}, ticks missed", one.missed, "ticks", 0.0)
    return judged
