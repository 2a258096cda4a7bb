"""The named networks: the delay of each packet in a minute, one packet each ms.

The links are those of a graph with this seed, ``links: {environment_query: {preset: NAME}}``. Its
packets are delayed alike in virtual time, and live but for the jitter of their arrivals.
"""

import io
from pathlib import Path

import click
import numpy as np
from matplotlib.figure import Figure
from PIL import Image

from forcebound.network.chances import Chances, Draws
from forcebound.network.link import link_seed
from forcebound.network.presets import PRESETS

MINUTE, PERIOD_NS = 60_000, 1_000_000  # packets, and the time between them
COLOURS = 64  # of the picture


def delays_of(preset: str, seed: int = 1) -> np.ndarray:
    """Return the delays of a minute, in ms; nan: lost."""
    chances = Chances(PRESETS[preset](), Draws(link_seed(seed, "environment_query")))
    fates = [chances.next(packet * PERIOD_NS) for packet in range(MINUTE)]
    return (
        np.array([np.nan if f.is_lost or f.delay_ns is None else f.delay_ns for f in fates]) / 1e6
    )


@click.command()
@click.option("--out", default="docs/networks.png", type=click.Path(path_type=Path))
def main(out: Path) -> None:
    """Draw the delay of each named network over a minute, and print its percentiles."""
    figure = Figure(figsize=(11.0, 6.0), layout="constrained")
    panels = figure.subplots(2, 3, sharex=True).flat
    seconds = np.arange(MINUTE) * PERIOD_NS * 1e-9
    click.echo("| preset | p50 (ms) | p90 | p99 | max | lost |\n|---|---|---|---|---|---|")
    for panel, preset in zip(panels, PRESETS, strict=True):
        delays = delays_of(preset)
        shares = " | ".join(f"{one:.3g}" for one in np.nanpercentile(delays, [50, 90, 99, 100]))
        click.echo(f"| `{preset}` | {shares} | {100.0 * np.isnan(delays).mean():.2g} % |")
        panel.plot(seconds, delays, linewidth=0.6)
        panel.set(title=preset, ylim=(0.0, 1.15 * float(np.nanmax(delays))))
        panel.grid(alpha=0.3)
    figure.supxlabel("time (s)")
    figure.supylabel("delay one way (ms)")
    drawn = io.BytesIO()
    figure.savefig(drawn, dpi=110, format="png")
    picture = Image.open(drawn).convert("RGB")
    picture.quantize(COLOURS, dither=Image.Dither.NONE).save(out, optimize=True)
