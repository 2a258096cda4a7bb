"""The running graph as a drawing: text, Mermaid, or a picture, with the measured rates."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from forcebound.monitor.streams import StreamFigures
from forcebound.topology import ONE_HAND

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Places of the nodes of a picture, and how far the arrows of a pair are apart.
_X, _APART = dict(zip(reversed(ONE_HAND.loop), (0.0, 2.6, 5.2), strict=True)), 0.16


def edges(rates: Mapping[str, StreamFigures]) -> list[tuple[str, str, str, float]]:
    """Return sender, receiver, topic and rate (Hz) of each link."""
    return [
        (link.sender, str(link.receiver), link.name, rates[link.name].rate_hz)
        for link in ONE_HAND.links
    ]


def as_text(rates: Mapping[str, StreamFigures]) -> str:
    """Return one line for each link."""
    rows = edges(rates)
    width = max(len(sender) for sender, *_ in rows)
    return "\n".join(
        f"{sender:<{width}} ── {topic} {rate:.0f} Hz ──▶ {receiver}"
        for sender, receiver, topic, rate in rows
    )


def as_mermaid(rates: Mapping[str, StreamFigures]) -> str:
    """Return a Mermaid flowchart, for Markdown."""
    lines = ["flowchart LR"]
    for sender, receiver, topic, rate in edges(rates):
        lines.append(f'    {sender} -- "{topic}<br/>{rate:.0f} Hz" --> {receiver}')
    return "\n".join(lines)


def draw(rates: Mapping[str, StreamFigures], output: Path) -> None:
    """Write a picture; the suffix of ``output`` (.svg or .png) gives its format.

    Raises:
        OSError: If it cannot be written.
    """
    from forcebound.analysis.plots import save

    save(_figure(rates), output)


def _figure(rates: Mapping[str, StreamFigures]) -> "Figure":
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.0, 2.2), layout="constrained")
    axes = figure.add_subplot()
    axes.set(xlim=(-0.7, 5.9), ylim=(-0.8, 0.8))
    axes.axis("off")
    box = {"boxstyle": "round,pad=0.5", "facecolor": "white", "edgecolor": "black"}
    for sender, receiver, topic, rate in edges(rates):
        forth = 1.0 if _X[sender] < _X[receiver] else -1.0
        start, end = _X[sender] + 0.55 * forth, _X[receiver] - 0.55 * forth
        y = _APART * forth
        axes.annotate("", (end, y), (start, y), arrowprops={"arrowstyle": "-|>"})
        words, where = f"{topic}\n{rate:.0f} Hz", "bottom" if forth > 0 else "top"
        axes.text(0.5 * (start + end), y * 1.3, words, ha="center", va=where, fontsize=8)
    for name, x in _X.items():
        axes.text(x, 0.0, name, ha="center", va="center", bbox=box)
    return figure
