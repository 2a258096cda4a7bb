"""Addresses of the sockets of a run with one hand."""

from pathlib import Path

from forcebound.messages.packets import Event
from forcebound.messages.topology import ONE_HAND, endpoint


def topic_endpoint(run_dir: Path, name: str) -> str:
    return endpoint(run_dir, ONE_HAND.named(name)[0])


def remote_endpoint(run_dir: Path, topic: str) -> str:
    return endpoint(run_dir, ONE_HAND.forwarded(topic))


def event_endpoint(run_dir: Path, process: str) -> str:
    return endpoint(run_dir, ONE_HAND.sent(process, Event))


def control_endpoint(run_dir: Path, process: str) -> str:
    return endpoint(run_dir, ONE_HAND.nodes[process])


LAUNCHER_SOCKET = ONE_HAND.nodes["launcher"].socket
LAUNCHERS = f"forcebound-*/{LAUNCHER_SOCKET}"  # of all runs in a folder
