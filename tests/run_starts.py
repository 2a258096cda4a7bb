"""The beginning of a run as events and actions, for tests of the lifecycle."""

from typing import TypeAlias

from forcebound.run.actions import Action, Engage, Engaged, LifecycleEvent, Reported, TimeLimits
from forcebound.run.lifecycle import Lifecycle

NODES = ("environment", "controller", "device", "recorder")
LIMITS = TimeLimits(start_ns=100, engage_ns=10, stop_ns=20, recorder_stop_ns=50, kill_ns=5)

Step: TypeAlias = tuple[int, LifecycleEvent | None, list[Action]]  # time in ns, event, actions

READY = [Reported(name, ()) for name in NODES]
RUNNING: list[Step] = [
    *((1, event, []) for event in READY[:-1]),
    (2, READY[-1], [Engage("device")]),
    (3, Engaged("device"), []),
]


def running(duration_ns: int | None = None) -> Lifecycle:
    """Return a run whose force is engaged since 3 ns."""
    lifecycle = Lifecycle(NODES, duration_ns, 0, LIMITS)
    for time_ns, event, actions in RUNNING:
        assert lifecycle.advance(time_ns, event) == actions
    return lifecycle
