"""Endpoints at which the processes of a run meet on one machine."""

from pathlib import Path

from forcebound.messages.packets import TOPIC_OF, Event

_IPC = "ipc://"


def topic_endpoint(run_dir: Path, topic: str) -> str:
    """Return where the packets of a topic are published in a run on one machine."""
    return f"{_IPC}{run_dir}/{topic}"


def remote_endpoint(run_dir: Path, topic: str) -> str:
    """Return where packets of a topic that come from another machine are passed on."""
    return f"{_IPC}{run_dir}/{topic}-remote"


def event_endpoint(run_dir: Path, name: str) -> str:
    """Return where the process ``name`` of a run publishes what happens to it."""
    return f"{_IPC}{run_dir}/{TOPIC_OF[Event]}-{name}"


def control_endpoint(run_dir: Path, name: str) -> str:
    """Return where the process ``name`` of a run answers requests."""
    return f"{_IPC}{_control(run_dir, name)}"


def has_control(run_dir: Path, name: str) -> bool:
    """Return whether the process ``name`` of a run has made the place where it answers."""
    return _control(run_dir, name).exists()


def _control(run_dir: Path, name: str) -> Path:
    return run_dir / f"control-{name}"
