"""The running graph as text or as a Mermaid flowchart, with the measured rates."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from forcebound.observe.streams import measure_streams
from forcebound.run.run_directory import RunDocument


class Edge(NamedTuple):
    """A link with its measured rate."""

    sender: str
    receiver: str
    topic: str
    rate_hz: float


def measure_edges(run: Path, duration: float) -> list[Edge]:
    """Return the links of a running graph with their rates over ``duration`` s."""
    links = RunDocument.read(run).graph.links
    figures = measure_streams(run, [link.name for link in links], duration)
    return [
        Edge(link.sender, str(link.receiver), link.name, figures[link.name].rate_hz)
        for link in links
    ]


def as_text(edges: Sequence[Edge]) -> str:
    """Return one line for each link."""
    width = max(len(edge.sender) for edge in edges)
    return "\n".join(
        f"{sender:<{width}} ── {topic} {rate:.0f} Hz ──▶ {receiver}"
        for sender, receiver, topic, rate in edges
    )


def as_mermaid(edges: Sequence[Edge]) -> str:
    """Return a Mermaid flowchart, for Markdown."""
    lines = (
        f'    {sender} -- "{topic}<br/>{rate:.0f} Hz" --> {receiver}'
        for sender, receiver, topic, rate in edges
    )
    return "\n".join(("flowchart LR", *lines))
