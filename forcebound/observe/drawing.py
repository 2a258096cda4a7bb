"""The running graph as a drawing: text, Mermaid, or a picture, with the measured rates."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from forcebound.observe.streams import measure_streams
from forcebound.run.run_directory import RunDocument

WIDTH, HALF_BOX = 2.6, 0.55  # between the nodes of a picture, which stand in the order of the chain


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


def draw(edges: Sequence[Edge], output: Path) -> None:
    """Write a picture; the suffix of ``output`` (.svg or .png) gives its format."""
    from matplotlib.figure import Figure

    from forcebound.results.plots import save

    figure = Figure(figsize=(8.0, 2.2), layout="constrained")
    axes = figure.add_subplot()
    names = list(dict.fromkeys(edge.sender for edge in edges))
    places = {name: k * WIDTH for k, name in enumerate(names)}
    axes.set(xlim=(-0.7, places[names[-1]] + 0.7), ylim=(-0.8, 0.8))
    axes.axis("off")
    for sender, receiver, topic, rate in edges:
        forth = 1.0 if places[sender] < places[receiver] else -1.0
        start, end = places[sender] + HALF_BOX * forth, places[receiver] - HALF_BOX * forth
        y = 0.16 * forth  # the arrows of a pair are apart
        axes.annotate("", (end, y), (start, y), arrowprops={"arrowstyle": "-|>"})
        words, where = f"{topic}\n{rate:.0f} Hz", "bottom" if forth > 0 else "top"
        axes.text(0.5 * (start + end), y * 1.3, words, ha="center", va=where, fontsize=8)
    box = {"boxstyle": "round,pad=0.5", "facecolor": "white", "edgecolor": "black"}
    for name, x in places.items():
        axes.text(x, 0.0, name, ha="center", va="center", bbox=box)
    save(figure, output)
