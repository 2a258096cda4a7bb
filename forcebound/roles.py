"""The roles of the processes of a run, one row each, and what each of them is called."""

import signal
from dataclasses import dataclass
from typing import Final

DEVICE: Final = "device"
CONTROLLER: Final = "controller"
ENVIRONMENT: Final = "environment"
RECORDER: Final = "recorder"
LAUNCHER: Final = "launcher"  # starts and ends the others; it is not one of them

LOST = 75  # exit status of a device process that has lost its device and may have it again


@dataclass(frozen=True)
class Role:
    """Scheduling, start, end and display of the processes of one role."""

    priority: int  # of SCHED_FIFO on the nodes' core; 0: ordinary, off that core: it is no node
    stop_group: int  # when it is ended: group 0 first, the next when all of the former are gone
    is_restarted: bool  # whether it is started again if it ends by itself while the graph runs
    death_signal: signal.Signals  # what the kernel sends it when its launcher is gone
    colour: int  # of its name in the terminal, an ANSI code


# In the order in which they start. The device is ended first, so that the force is zero before the
# nodes on which it depends are gone; the recorder last, so that it has everything. These two have
# something to finish at the launcher's death (zero force; the recording), the others have not.
# Without device or recorder there is nothing to go on with: they are not restarted. A device with
# ``on_loss: wait`` is, when the user says that it is in order.
ROLES: dict[str, Role] = {
    ENVIRONMENT: Role(30, 1, True, signal.SIGKILL, 35),
    CONTROLLER: Role(40, 1, True, signal.SIGKILL, 33),
    DEVICE: Role(50, 0, False, signal.SIGTERM, 36),
    RECORDER: Role(0, 2, False, signal.SIGTERM, 32),
}

STOP_GROUPS = sorted({role.stop_group for role in ROLES.values()})


@dataclass(frozen=True)
class Fact:
    """One thing that makes a process punctual, or that could not be had."""

    code: str
    sentence: str  # with what to do about it
    is_hindrance: bool = True  # whether ticks may be late because of it
