"""Where the processes of a run meet on one machine."""

from pathlib import Path

from forcebound.messages.packets import (
    TOPIC_OF,
    Event,
)


def topic_endpoint(run_dir: Path, topic: str) -> str:
    """Return where the packets of a topic are published in a run on one machine."""
    return f"ipc://{run_dir}/{topic}"


def remote_endpoint(run_dir: Path, topic: str) -> str:
    """Return where packets of a topic that come from another machine are passed on."""
    return f"ipc://{run_dir}/{topic}-remote"


def event_endpoint(run_dir: Path, name: str) -> str:
    """Return where the process ``name`` of a run publishes what happens to it."""
    return f"ipc://{run_dir}/{TOPIC_OF[Event]}-{name}"


def control_endpoint(run_dir: Path, name: str) -> str:
    """Return where the process ``name`` of a run answers requests."""
    return f"ipc://{run_dir}/control-{name}"
