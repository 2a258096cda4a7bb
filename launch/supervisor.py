"""How the processes of a run are started, watched and ended.

What to do when is decided by :mod:`forcebound.launch.lifecycle`; here it is done. One loop, no
thread: it sleeps until a process writes a line, ends, or answers, until a signal comes, or until
the lifecycle's next deadline.

No process survives the launcher, however it ends: each asks the kernel for a signal at its death
(:mod:`forcebound.launch.worker`). Each is in a session of its own, so that Ctrl-C in the terminal
reaches the launcher alone, which then stops them in order.
"""

import os
import selectors
import signal
import subprocess
import sys
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack, suppress
from pathlib import Path
from types import FrameType, TracebackType
from typing import Any, Self

from forcebound.errors import RunError
from forcebound.launch.lifecycle import (
    Action,
    Ended,
    Engage,
    Engaged,
    Event,
    Interrupted,
    Kill,
    Lifecycle,
    Limits,
    Phase,
    Reported,
)
from forcebound.network.sockets import Network
from forcebound.process import control_endpoint

ASK_INTERVAL_NS = 20_000_000  # between two requests to a node that has not answered as hoped
LAST_CHANCE = 2.0  # s from SIGTERM to SIGKILL when the launcher itself fails
TAIL_LINES = 20  # of a node's log, in the message of a failure
CHUNK = 65_536  # bytes
MAX_LINE = 65_536  # bytes without a line end that are kept

COLOURS = {"device": 36, "controller": 33, "environment": 35, "recorder": 32}  # ANSI


class Signals:
    """Catches what ends a run, and the death of children, as bytes on a descriptor."""

    ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)

    def __init__(self) -> None:
        self.descriptor, self._wake_descriptor = os.pipe()
        os.set_blocking(self.descriptor, False)
        os.set_blocking(self._wake_descriptor, False)
        self._before: dict[int, Any] = {}
        self._wake_before = -1

    def __enter__(self) -> Self:
        self._wake_before = signal.set_wakeup_fd(self._wake_descriptor, warn_on_full_buffer=False)
        for number in (*self.ENDING, signal.SIGCHLD):
            self._before[number] = signal.signal(number, self._caught)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)
        signal.set_wakeup_fd(self._wake_before)
        os.close(self.descriptor)
        os.close(self._wake_descriptor)

    def take(self) -> bool:
        """Forget what has come; return whether something that ends the run was among it."""
        try:
            numbers = os.read(self.descriptor, CHUNK)
        except BlockingIOError:
            return False
        return any(number in self.ENDING for number in numbers)

    def _caught(self, number: int, frame: FrameType | None) -> None:
        """Let the byte on the descriptor do the work."""


class Child:
    """One process of the run, and what it says."""

    def __init__(self, name: str, command: Sequence[str], say: Callable[[str, str], None]) -> None:
        self.name = name
        self.tail: deque[str] = deque(maxlen=TAIL_LINES)
        self._say = say
        self._partial = b""
        self.process = subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            start_new_session=True,
            env={**os.environ, "PYTHONUNBUFFERED": "1"},
        )
        assert self.process.stdout is not None
        self.descriptor = self.process.stdout.fileno()
        os.set_blocking(self.descriptor, False)

    def read(self) -> bool:
        """Pass on the whole lines that have come; return False at the end of the stream."""
        try:
            data = os.read(self.descriptor, CHUNK)
        except BlockingIOError:
            return True
        *lines, self._partial = (self._partial + data).split(b"\n")
        if not data or len(self._partial) > MAX_LINE:
            lines, self._partial = [*lines, *filter(None, [self._partial])], b""
        for line in lines:
            text = line.decode(errors="replace").rstrip()
            self.tail.append(text)
            self._say(self.name, text)
        return bool(data)

    def end(self) -> None:
        """End the process if it lives, which it does only after a mistake of ours; let go."""
        if self.process.poll() is None:
            self.process.terminate()
            try:
                self.process.wait(LAST_CHANCE)
            except subprocess.TimeoutExpired:
                self.process.kill()
                self.process.wait()
        assert self.process.stdout is not None
        self.process.stdout.close()


def say_on_stderr(name: str, line: str) -> None:
    """Write one line of a process to standard error, with its name in front.

    If nobody reads standard error any more, the run goes on in silence.
    """
    prefix = f"[{name}]"
    if sys.stderr.isatty():
        prefix = f"\033[{COLOURS.get(name, 0)}m{prefix}\033[0m"
    with suppress(OSError):
        sys.stderr.write(f"{prefix} {line}\n")


class Supervisor:
    """Runs the processes of one run to their end.

    Args:
        commands: The command line of each process by name, in the order in which they start.
        run_dir: Directory of the run's sockets.
        duration_ns: How long to run with an engaged force, in ns; None: until interrupted.
        limits: How long things may take.
        say: Called with the name and each line of a process.
    """

    def __init__(
        self,
        commands: Mapping[str, Sequence[str]],
        run_dir: Path,
        duration_ns: int | None,
        limits: Limits | None = None,
        say: Callable[[str, str], None] = say_on_stderr,
    ) -> None:
        self._commands = commands
        self._run_dir = run_dir
        self._duration_ns = duration_ns
        self._limits = limits or Limits()
        self._say = say
        self._children: dict[str, Child] = {}
        self._running: set[str] = set()

    def run(self) -> bool:
        """Start, watch and end the processes; return whether somebody interrupted the run.

        Raises:
            RunError: If a process ended by itself, did not become ready, or did not stop; the
                message holds its last lines. All processes are gone then, too.
        """
        with ExitStack() as stack:
            network = stack.enter_context(Network())
            signals = stack.enter_context(Signals())
            selector = stack.enter_context(selectors.DefaultSelector())
            selector.register(signals.descriptor, selectors.EVENT_READ)
            for name, command in self._commands.items():
                child = Child(name, command, self._say)
                stack.callback(child.end)
                selector.register(child.descriptor, selectors.EVENT_READ, child)
                self._children[name] = child
                self._running.add(name)
            self._clients = {
                name: network.control_client(control_endpoint(self._run_dir, name))
                for name in self._commands
            }
            now_ns = time.monotonic_ns()
            lifecycle = Lifecycle(list(self._commands), self._duration_ns, now_ns, self._limits)
            self._loop(lifecycle, selector, signals)
        if lifecycle.failure is not None:
            raise RunError(self._tell(lifecycle))
        return lifecycle.interrupted

    def _loop(
        self, lifecycle: Lifecycle, selector: selectors.BaseSelector, signals: Signals
    ) -> None:
        asked_ns = 0
        while lifecycle.phase is not Phase.OVER:
            now_ns = time.monotonic_ns()
            if now_ns - asked_ns >= ASK_INTERVAL_NS:
                asked_ns = now_ns
                self._ask(lifecycle)
            for key, _ in selector.select(self._timeout(lifecycle, now_ns)):
                if key.data is not None and not key.data.read():
                    selector.unregister(key.fd)
            events: list[Event | None] = [*self._answers(), *self._ends()]
            if signals.take():
                events.append(Interrupted())
            for event in events or [None]:
                for action in lifecycle.advance(time.monotonic_ns(), event):
                    self._do(action)

    def _timeout(self, lifecycle: Lifecycle, now_ns: int) -> float | None:
        if lifecycle.phase in (Phase.STARTING, Phase.ENGAGING):
            return ASK_INTERVAL_NS * 1e-9
        if lifecycle.deadline_ns is None:
            return None
        return max(0.0, (lifecycle.deadline_ns - now_ns) * 1e-9)

    def _ask(self, lifecycle: Lifecycle) -> None:
        if lifecycle.phase is Phase.STARTING:
            for name in lifecycle.not_ready:
                self._clients[name].ask({"request": "status"})
        elif lifecycle.phase is Phase.ENGAGING:
            self._clients["device"].ask({"request": "engage"})

    def _answers(self) -> list[Event]:
        events: list[Event] = []
        for name, client in self._clients.items():
            answer = client.answer()
            if answer is None:
                continue
            if "waiting_for" in answer:
                events.append(Reported(name, tuple(answer["waiting_for"])))
            elif answer.get("engaged") is True:
                events.append(Engaged())
        return events

    def _ends(self) -> list[Event]:
        events: list[Event] = []
        for name in sorted(self._running):
            child = self._children[name]
            status = child.process.poll()
            if status is not None:
                self._running.discard(name)
                child.read()  # what it said last, before the failure is told
                events.append(Ended(name, status))
        return events

    def _do(self, action: Action) -> None:
        match action:
            case Engage():
                self._clients["device"].ask({"request": "engage"})
            case Kill(name):
                self._children[name].process.kill()
            case _:
                self._children[action.node].process.terminate()

    def _tell(self, lifecycle: Lifecycle) -> str:
        failure = lifecycle.failure
        assert failure is not None
        tail = self._children[failure.node].tail if failure.node is not None else ()
        said = "".join(f"\n  {line}" for line in tail)
        return f"{failure.message}{'; its last lines:' if said else ''}{said}"
