"""Real-time settings: what is set, denied and reported. No test decides by timing."""

import json
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest
from waiting import TIMEOUT

from forcebound import realtime
from forcebound.errors import ConfigError
from forcebound.messages.topology import ONE_HAND
from forcebound.roles import ROLES

PROGRAM = """
import gc, json, os, sys
from forcebound import realtime
asked = json.loads(sys.argv[1])
role = asked.pop("role")
facts = realtime.enter(realtime.Settings(**asked), role)
realtime.freeze_garbage()
print(json.dumps({
    "facts": {fact.code: fact.sentence for fact in facts},
    "policy": os.sched_getscheduler(0),
    "priority": os.sched_getparam(0).sched_priority,
    "cores": sorted(os.sched_getaffinity(0)),
    "collects": gc.isenabled(),
    "frozen": gc.get_freeze_count() > 0,
}))
"""


def enter(role: str, **settings: Any) -> dict[str, Any]:
    """Return what a process of its own became."""
    asked = json.dumps({"role": role, **settings})
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, asked], capture_output=True, check=True, timeout=TIMEOUT
    )
    return dict(json.loads(done.stdout))


CORES = sorted(os.sched_getaffinity(0))
GONE = max(CORES) + 1000


@pytest.mark.parametrize(
    ("asked", "cores", "taken", "chosen"),
    [
        ("auto", (0, 1, 2), [], 2),  # the first takes the interrupts
        ("auto", (0, 1, 2), [2], 1),
        ("auto", (0, 1), [0, 1, None], 1),
        ("auto", (0, 1), [0, 1, 1], 0),
        (1, (0, 1, 2), [1], 1),  # as the launch file says
        ("none", (0, 1), [], None),
    ],
)
def test_a_core_is_the_highest_that_no_other_graph_has_or_the_one_asked_for(
    asked: Any, cores: tuple[int, ...], taken: list[int | None], chosen: int | None
) -> None:
    assert realtime.choose_core(asked, cores, taken=taken) == chosen


def test_a_core_that_is_not_ours_is_refused_with_those_that_are() -> None:
    with pytest.raises(ConfigError, match="core 7; use one of 0, 1, or auto, or none"):
        realtime.choose_core(7, {0, 1})


@pytest.mark.parametrize("spin_ns", [0, 20_000, 10_000_000])
def test_a_wait_never_ends_before_its_instant(spin_ns: int) -> None:
    instant_ns = time.monotonic_ns() + 2_000_000
    assert realtime.wait_until(instant_ns, spin_ns) >= instant_ns


def test_a_wait_for_the_past_does_not_sleep(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(time, "sleep", lambda seconds: pytest.fail("slept"))
    now_ns = time.monotonic_ns()
    assert realtime.wait_until(now_ns - 1, 100_000) >= now_ns


def test_most_of_a_wait_is_slept_however_long_the_spin(monkeypatch: pytest.MonkeyPatch) -> None:
    now_ns, slept = 5_000_000, []

    def sleep(seconds: float) -> None:
        nonlocal now_ns
        slept.append(seconds)
        now_ns += 800_000

    monkeypatch.setattr(time, "sleep", sleep)
    monkeypatch.setattr(time, "monotonic_ns", lambda: now_ns)
    assert realtime.wait_until(5_800_000, 10_000_000_000) == 5_800_000
    assert slept == [pytest.approx(7 / 8 * 800e-6)]


@pytest.mark.live
@pytest.mark.parametrize("role", ONE_HAND.loop)
def test_a_node_of_the_chain_runs_as_it_says(role: str) -> None:
    became = enter(role, core=CORES[-1])
    assert became["cores"] == [CORES[-1]]
    assert str(CORES[-1]) in became["facts"]["core"]
    if became["policy"] == os.SCHED_FIFO:
        assert became["priority"] == ROLES[role].priority
        assert str(became["priority"]) in became["facts"]["fifo"]
    else:
        assert {"fifo_not_permitted", "fifo_refused"} & set(became["facts"])
    assert {"memory_locked", "memory_limited", "memory_refused"} & set(became["facts"])
    assert became["frozen"]
    assert not became["collects"]


@pytest.mark.live
@pytest.mark.parametrize(
    ("core", "policy", "facts"),
    [
        (None, "fifo", ["any_core", "fifo_without_core"]),
        (CORES[-1], "other", ["core", "fifo_not_wanted"]),
        (GONE, "fifo", ["core_refused", "fifo_without_core"]),
    ],
)
def test_without_a_core_or_on_request_there_is_no_fifo(
    core: int | None, policy: str, facts: list[str]
) -> None:
    became = enter("device", core=core, policy=policy, lock_memory=False)
    assert became["policy"] == os.SCHED_OTHER
    assert became["cores"] == ([core] if core == CORES[-1] else CORES)
    assert list(became["facts"]) == facts
    assert str(GONE) in became["facts"].get("core_refused", str(GONE))


@pytest.mark.live
def test_the_recorder_keeps_off_the_core_of_the_chain() -> None:
    became = enter("recorder", core=CORES[-1])
    assert became["policy"] == os.SCHED_OTHER
    assert became["cores"] == (CORES[:-1] or CORES)


def test_processors_are_kept_awake_only_on_request_and_a_refusal_is_a_hindrance(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    latency = tmp_path / "cpu_dma_latency"
    monkeypatch.setattr(realtime, "CPU_LATENCY", str(latency))
    assert not {"awake", "awake_refused"} & set(enter("device", core=None)["facts"])
    settings = realtime.Settings(policy="other", lock_memory=False, deep_sleep=False)
    (refused,) = [f for f in realtime.enter(settings, "device") if f.code == "awake_refused"]
    assert refused.is_hindrance
    latency.touch()
    (awake,) = [f for f in realtime.enter(settings, "device") if f.code == "awake"]
    assert not awake.is_hindrance
    assert latency.read_bytes() == bytes(4)
