"""Endpoints of the processes of a run on one machine."""

from pathlib import Path

from forcebound.messages.packets import TOPIC_OF, Event

_IPC = "ipc://"


def topic_endpoint(run_dir: Path, topic: str) -> str:
    """Return the endpoint of a topic's packets in a run on one machine."""
    return f"{_IPC}{run_dir}/{topic}"


def remote_endpoint(run_dir: Path, topic: str) -> str:
    """Return the endpoint of a topic's packets that come from another machine."""
    return f"{_IPC}{run_dir}/{topic}-remote"


def event_endpoint(run_dir: Path, name: str) -> str:
    """Return the endpoint of the events of the process ``name`` of a run."""
    return f"{_IPC}{run_dir}/{TOPIC_OF[Event]}-{name}"


def control_endpoint(run_dir: Path, name: str) -> str:
    """Return the endpoint at which the process ``name`` of a run answers requests."""
    return f"{_IPC}{_control(run_dir, name)}"


def has_control(run_dir: Path, name: str) -> bool:
    """Return whether the process ``name`` of a run has bound its control endpoint."""
    return _control(run_dir, name).exists()


def _control(run_dir: Path, name: str) -> Path:
    return run_dir / f"control-{name}"
