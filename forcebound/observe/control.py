"""Requests to the processes of a running graph; stopping and starting a node."""

import time
from collections.abc import Mapping
from pathlib import Path

from forcebound.errors import ConfigError, RunError
from forcebound.messages.control import (
    Answer,
    DeviceStatus,
    GetStatus,
    LauncherStatus,
    Refused,
    Request,
    ResumeDevice,
    StartNode,
    StopNode,
)
from forcebound.messages.topology import HAND, endpoint, node_name
from forcebound.network import sockets
from forcebound.network.sockets import Network
from forcebound.roles import DEVICE, LAUNCHER
from forcebound.run.run_directory import graph_in, has_launcher

ANSWER_TIMEOUT = 5.0  # s for an answer to a request; milliseconds are usual
STOP_TIMEOUT = 10.0  # s until a node has ended; after 2 s it is killed
START_TIMEOUT = 60.0  # s until a node answers; a cold start on a busy machine
POLL_NS = 50_000_000  # between two looks


def ask(
    run_dir: Path, name: str, request: Request, timeout: float = ANSWER_TIMEOUT
) -> Answer | None:
    """Return the answer of a process of a running graph; None if there is none in ``timeout`` s."""
    return ask_all(run_dir, {name: request}, timeout)[name]


def ask_all(
    run_dir: Path, requests: Mapping[str, Request], timeout: float
) -> dict[str, Answer | None]:
    """Return the answers of processes to a request each, asked at once; see :func:`ask`."""
    answers: dict[str, Answer | None] = dict.fromkeys(requests)
    with Network() as network:
        nodes = graph_in(run_dir).nodes
        waiting = {
            name: network.control_client(endpoint(run_dir, nodes[name])) for name in requests
        }
        unsent = set(requests)
        end = time.monotonic() + timeout
        while True:
            unsent -= {name for name in unsent if waiting[name].ask(requests[name])}
            answers |= {name: client.answer() for name, client in waiting.items()}
            waiting = {name: waiting[name] for name in waiting if answers[name] is None}
            unsent &= waiting.keys()
            if not waiting or time.monotonic() >= end:
                return answers
            sockets.wait([client.descriptor for client in waiting.values()], POLL_NS)


def chosen_hand(run_dir: Path, hand: str | None) -> str:
    """Return the name of a hand of a graph; None: the only one. ConfigError if it is not there."""
    known = graph_in(run_dir).hands
    if hand is None and len(known) == 1:
        return known[0]
    if hand in known:
        return hand
    got = "" if hand is None else f"; there is no hand {hand!r}"
    raise ConfigError(f"which hand? This graph has {', '.join(known)}{got}")


def device_status(
    run_dir: Path, timeout: float = ANSWER_TIMEOUT, hand: str = HAND
) -> DeviceStatus | None:
    """Return the status of a hand's device in a running graph; None: it does not answer."""
    answer = ask(run_dir, graph_in(run_dir).of_role(DEVICE, hand), GetStatus(), timeout)
    return answer if isinstance(answer, DeviceStatus) else None


def ask_launcher(run_dir: Path, request: Request) -> LauncherStatus:
    """Return the launcher's answer to one request.

    Raises:
        ConfigError: If it refuses, or there is no launcher; the message says why.
        RunError: If it does not answer.
    """
    if not has_launcher(run_dir):
        raise ConfigError(
            f"no launcher answers in {run_dir}: it is still starting, or an environment by itself"
            " runs there; stop that with Ctrl-C in its terminal"
        )
    answer = ask(run_dir, LAUNCHER, request, ANSWER_TIMEOUT)
    if isinstance(answer, Refused):
        raise ConfigError(answer.error)
    if not isinstance(answer, LauncherStatus):
        raise RunError(
            f"the launcher of the graph in {run_dir} has not answered for {ANSWER_TIMEOUT:g} s: "
            "is it ending, or suspended (Ctrl-Z)?"
        )
    return answer


def stop_node(run_dir: Path, node: str) -> None:
    """Stop a node of a running graph, until :func:`start_node`; return when it has ended.

    Raises:
        ConfigError: If the launcher refuses.
        RunError: If it does not answer, or the node does not reach its state in time.
    """
    _change_state(run_dir, StopNode(node), node, "stopped", STOP_TIMEOUT)


def start_node(run_dir: Path, node: str) -> None:
    """Start a node that was stopped; return when it answers. Errors are as of :func:`stop_node`."""
    _change_state(run_dir, StartNode(node), node, "running", START_TIMEOUT)


def resume_device(run_dir: Path, hand: str | None = None) -> None:
    """Open a lost device again; return when it answers. Errors are as of :func:`stop_node`.

    ``hand`` is the one that it belongs to; None: the only one.
    """
    device = graph_in(run_dir).of_role(DEVICE, chosen_hand(run_dir, hand))
    _change_state(run_dir, ResumeDevice(device), device, "running", START_TIMEOUT)


def await_law(run_dir: Path, law: str, hand: str = HAND) -> None:
    """Return when a law bounds, which a hand's device takes as soon as it holds no force."""
    end = time.monotonic() + ANSWER_TIMEOUT
    while (status := device_status(run_dir, hand=hand)) is None or status.law != law:
        if time.monotonic() > end:
            device = node_name(hand, "device")
            raise RunError(f"the {device} will take the law {law}, but still holds a force")
        sockets.wait((), POLL_NS)


def _change_state(run_dir: Path, request: Request, node: str, goal: str, timeout: float) -> None:
    answer = ask_launcher(run_dir, request)
    end = time.monotonic() + timeout
    while True:
        state = answer.nodes[node].state
        if state == goal:
            return
        if state == "lost":
            raise RunError(f"{node} is still lost; the launcher's log says why. Then try again")
        if answer.phase != "running":
            raise RunError(f"the run has ended; {node} is {state}")
        if time.monotonic() > end:
            raise RunError(f"{node} is still {state} after {timeout:g} s; its log may say why")
        sockets.wait((), POLL_NS)
        if not has_launcher(run_dir):
            raise RunError(f"the run has ended; {node} was {state}")
        answer = ask_launcher(run_dir, GetStatus())
