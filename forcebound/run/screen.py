"""The terminal of a launcher: lines of its processes, and below them what it is doing just now."""

import shutil
import sys
from contextlib import suppress
from dataclasses import dataclass, field

from forcebound.roles import ROLES
from forcebound.run.actions import RunPhase
from forcebound.run.lifecycle import Lifecycle

ERASE = "\r\033[K"
LONG = 3  # s of a start, after which it is said why it may take long


@dataclass
class Screen:
    """Standard error. If it is closed, the run continues without output."""

    has_status: bool = False  # whether to show what the launcher does: somebody looks
    _status: str = field(default="", init=False)

    def show(self, name: str, line: str) -> None:
        """Write one line of a process, with its name in front."""
        prefix = f"[{name}]"
        if sys.stderr.isatty():
            role = name.rpartition("/")[2]
            colour = ROLES[role].colour if role in ROLES else 0
            prefix = f"\033[{colour}m{prefix}\033[0m"
        below = f"{ERASE}{prefix} {line}\n{self._status}" if self._status else f"{prefix} {line}\n"
        self._write(below)

    def status(self, words: str) -> None:
        """Show what the launcher is doing, in place of what it did; "": nothing."""
        if not self.has_status:
            return
        words = words[: shutil.get_terminal_size().columns - 1]  # what wraps cannot be erased
        if words != self._status:
            self._status = words
            self._write(f"{ERASE}{words}")

    def _write(self, text: str) -> None:
        with suppress(OSError):
            sys.stderr.write(text)
            sys.stderr.flush()


def doing(lifecycle: Lifecycle, seconds: float) -> str:
    """Return what a launcher is doing that has begun ``seconds`` ago; "": the graph runs."""
    if lifecycle.phase is RunPhase.STARTING:
        why = " (a first start compiles)" if seconds >= LONG else ""
        if lifecycle.silent:
            return f"starting {', '.join(lifecycle.silent)}, {seconds:.0f} s{why}"
        waiting = "; ".join(map(lifecycle.missing, lifecycle.not_ready))
        return f"waiting, {seconds:.0f} s: {waiting}"
    return {
        RunPhase.ENGAGING: "all ready: the force engages",
        RunPhase.STOPPING: "stopping: zero force, then the processes",
    }.get(lifecycle.phase, "")
