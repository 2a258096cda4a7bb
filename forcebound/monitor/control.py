"""Requests to the processes of a running graph; stopping and starting a node."""

import time
from collections.abc import Collection, Iterable, Mapping
from pathlib import Path
from typing import Any

from forcebound.errors import ConfigError, RunError
from forcebound.network import sockets
from forcebound.network.sockets import Network
from forcebound.process import control_endpoint, has_control
from forcebound.processes import LAUNCHER

ANSWER_TIMEOUT = 5.0  # s for an answer to a request; milliseconds are usual
STATUS_TIMEOUT = 1.0  # s for a status; a node answers between two steps, so within milliseconds
STOP_TIMEOUT = 10.0  # s until a node has ended; after 2 s it is killed
START_TIMEOUT = 60.0  # s until a node answers; a cold start on a busy machine
POLL_NS = 50_000_000  # between two looks


def ask(
    run_dir: Path, name: str, request: Mapping[str, Any], timeout: float = ANSWER_TIMEOUT
) -> dict[str, Any] | None:
    """Return the answer of a process of a running graph; None if there is none in ``timeout`` s.

    Requests are on the page ``docs/protocol.md``, Control.
    """
    return ask_all(run_dir, (name,), request, timeout)[name]


def ask_all(
    run_dir: Path, names: Collection[str], request: Mapping[str, Any], timeout: float
) -> dict[str, dict[str, Any] | None]:
    """Return the answers of several processes to one request, asked at once; see :func:`ask`."""
    answers: dict[str, dict[str, Any] | None] = dict.fromkeys(names)
    with Network() as network:
        waiting = {name: network.control_client(control_endpoint(run_dir, name)) for name in names}
        unsent = set(names)
        end = time.monotonic() + timeout
        while True:
            unsent -= {name for name in unsent if waiting[name].ask(request)}
            answers |= {name: client.answer() for name, client in waiting.items()}
            waiting = {name: waiting[name] for name in waiting if answers[name] is None}
            unsent &= waiting.keys()
            if not waiting or time.monotonic() >= end:
                return answers
            sockets.wait([client.descriptor for client in waiting.values()], POLL_NS)


def statuses(run_dir: Path, names: Iterable[str]) -> dict[str, dict[str, Any] | None]:
    """Return the status of those processes that have a control socket; None: no answer."""
    known = [name for name in names if has_control(run_dir, name)]
    return ask_all(run_dir, known, {"request": "status"}, STATUS_TIMEOUT)


def ask_launcher(run_dir: Path, request: Mapping[str, Any]) -> dict[str, Any]:
    """Return the launcher's answer to one request; see :func:`ask`.

    Raises:
        ConfigError: If it refuses, or there is no launcher; the message says why.
        RunError: If it does not answer.
    """
    if not has_control(run_dir, LAUNCHER):
        raise ConfigError(
            f"no launcher answers in {run_dir}: it is still starting, or an environment by itself"
            " runs there; stop that with Ctrl-C in its terminal"
        )
    answer = ask(run_dir, LAUNCHER, request, ANSWER_TIMEOUT)
    if answer is None:
        raise RunError(
            f"the launcher of the graph in {run_dir} has not answered for {ANSWER_TIMEOUT:g} s: "
            "is it ending, or suspended (Ctrl-Z)?"
        )
    if "error" in answer:
        raise ConfigError(str(answer["error"]))
    return answer


def stop_node(run_dir: Path, node: str) -> None:
    """Stop a node of a running graph, until :func:`start_node`; return when it has ended.

    Raises:
        ConfigError: If the launcher refuses.
        RunError: If it does not answer, or the node does not end in time.
    """
    _change_state(run_dir, "stop_node", node, "stopped", STOP_TIMEOUT)


def start_node(run_dir: Path, node: str) -> None:
    """Start a node that was stopped; return when it answers. Errors are as of :func:`stop_node`."""
    _change_state(run_dir, "start_node", node, "running", START_TIMEOUT)


def resume_device(run_dir: Path) -> None:
    """Say that a lost device is in order; return when it answers. Errors are as of the others.

    Raises:
        ConfigError: If the device is not lost.
        RunError: If it cannot be opened, or the launcher does not answer.
    """
    _change_state(run_dir, "resume_device", "device", "running", START_TIMEOUT)


def await_law(run_dir: Path, law: str) -> None:
    """Return when a law bounds, which the device takes as soon as it holds no force.

    Raises:
        RunError: If it still does not.
    """
    end = time.monotonic() + ANSWER_TIMEOUT
    while (ask(run_dir, "device", {"request": "status"}) or {}).get("law") != law:
        if time.monotonic() > end:
            raise RunError(f"the device will take the law {law}, but still holds a force")
        sockets.wait((), POLL_NS)


def _change_state(run_dir: Path, request: str, node: str, wanted: str, timeout: float) -> None:
    answer = ask_launcher(run_dir, {"request": request, "node": node})
    end = time.monotonic() + timeout
    while True:
        state = str(answer["nodes"][node]["state"])
        if state == wanted:
            return
        if state == "lost":
            raise RunError(f"{node} is still lost; the launcher's log says why. Then try again")
        if answer["phase"] != "running":
            raise RunError(f"the run has ended meanwhile; {node} is {state}")
        if time.monotonic() > end:
            raise RunError(f"{node} is still {state} after {timeout:g} s; its log may say why")
        sockets.wait((), POLL_NS)
        if not has_control(run_dir, LAUNCHER):
            raise RunError(f"the run has ended meanwhile; {node} was {state}")
        answer = ask_launcher(run_dir, {"request": "status"})
