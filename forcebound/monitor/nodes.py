"""The nodes of a graph on this machine, their states, and the environment that serves."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from forcebound.config.graph import GraphConfig
from forcebound.errors import ConfigError
from forcebound.launch.run_directory import RunDocument
from forcebound.monitor.control import statuses
from forcebound.network import sockets
from forcebound.processes import LAUNCHER, NODES

ENVIRONMENT, CONTROLLER = "environment", "controller"

SERVING_NS = 100_000_000  # in which an environment that serves replies, unless it is very slow
WAITING_REPLIES = 1  # of an environment that waits, in this time
UNKNOWN = "unknown"  # state of a process that no launcher watches, or whose launcher is silent


@dataclass(frozen=True)
class Present:
    """The nodes of one run directory."""

    nodes: frozenset[str]  # those that belong to this machine, whether they run or not
    reachable: frozenset[str]  # those of them that have a control socket, or a launcher
    states: Mapping[str, str]  # as the launcher says, see docs/protocol.md; UNKNOWN without one
    answers: Mapping[str, Mapping[str, Any]]  # of those that answered, the launcher included
    is_graph: bool = True  # False: only an environment, for a graph elsewhere
    # The environment that serves in place of the one here; None: that is not so. An environment
    # here that is silent may be the one that serves.
    serving: str | None = None


def present(run_dir: Path, config: GraphConfig | None = None) -> Present:
    """Return the nodes of a run directory; ``config`` says if the environment belongs elsewhere."""
    try:
        is_graph = RunDocument.read(run_dir).is_graph
    except ConfigError:
        is_graph = True
    found = statuses(run_dir, (*NODES, LAUNCHER))
    answers = {name: answer for name, answer in found.items() if answer is not None}
    launched = answers.get(LAUNCHER, {}).get("nodes")
    if launched is not None:
        states = {name: str(node["state"]) for name, node in launched.items()}
        nodes = reachable = frozenset(NODES) & states.keys()
    else:
        reachable = frozenset(found.keys() - {LAUNCHER})
        states = dict.fromkeys(reachable, UNKNOWN)
        nodes = frozenset(NODES if is_graph else {ENVIRONMENT})
        if is_graph and config is not None and config.remote is not None:
            nodes -= {ENVIRONMENT} - reachable
    serving = _serving(run_dir, states, answers, is_graph)
    return Present(nodes, reachable, states, answers, is_graph, serving)


def _serving(
    run_dir: Path,
    states: Mapping[str, str],
    answers: Mapping[str, Mapping[str, Any]],
    is_graph: bool,
) -> str | None:
    own = answers.get(ENVIRONMENT)
    if not is_graph:
        return None if own is None else own.get("refused_for")
    controller = answers.get(CONTROLLER, {})
    serving = controller.get("environment")
    if serving is None or (own is None and states.get(ENVIRONMENT) != "stopped"):
        return None
    if own is not None and own.get("name") == serving:
        return None
    sockets.wait((), SERVING_NS)
    later = statuses(run_dir, [CONTROLLER]).get(CONTROLLER) or {}
    replies = _replies(later) - _replies(controller)
    return str(serving) if replies > WAITING_REPLIES else None  # else it has gone, with its lease


def _replies(controller: Mapping[str, Any]) -> int:
    return int(controller.get("received", {}).get("environment_reply", 0))
