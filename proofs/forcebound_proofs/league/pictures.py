"""Pictures of the league: stiffness over delay, transparency over frequency, energy given."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from forcebound.lab.engine import Row
from forcebound.results.colours import LAW_COLOURS, NEUTRAL, NOT_PASSIVE
from forcebound.results.plots import save
from forcebound.results.surface import Floats
from forcebound.units import energy_in_words
from forcebound_proofs import drawing
from forcebound_proofs.attack import RANDOM, SEARCH
from forcebound_proofs.league.contest import CELL
from forcebound_proofs.league.methods import CERTIFIED
from forcebound_proofs.league.places import DELAYS, PHANTOM, SHAKER, SOFT_STIFFNESS, WALL, Place
from forcebound_proofs.league.scores import LITTLE, SCORES, cells, giving, leaks, lowest, worst

#: Of methods that are no laws of the maps: the muted scheme of P. Tol, 2021.
OTHERS = ("#882255", "#117733", "#999933", "#332288", "#AA4499", "#661100", "#44AA99")
LEAST = 1e-6  # J, at the left of the picture of energies
MARKERS = {
    CELL: ("o", "hands of the places"),
    RANDOM: ("s", "random attack"),
    SEARCH: ("D", "learned attack"),
}


def draw(rows: Sequence[Row], files: Mapping[str, Path]) -> None:
    """Draw the pictures to their files."""
    methods = list(dict.fromkeys(row["method"] for row in rows))
    others = iter(OTHERS * (1 + len(methods) // len(OTHERS)))
    colours = {name: LAW_COLOURS.get(name) or next(others) for name in methods}
    for name, picture in (
        ("stiffness", _stiffness),
        ("transparency", _transparency),
        ("energy", _energy),
    ):
        picture(rows, colours, files[name])


def _drawn(axes: Axes, method: str, colours: Mapping[str, str], x: Floats, y: Floats) -> None:
    style = {"marker": ".", "linewidth": 2.4 if method == CERTIFIED else 1.1}
    style |= {"linestyle": "-" if method in LAW_COLOURS else "--"}
    drawing.line(axes, x, y, method.replace("_", " "), colours[method], **style)


def _stiffness(rows: Sequence[Row], colours: Mapping[str, str], file: Path) -> None:
    """Two panels: methods that gave little energy, and the others; a ring where one gave some."""
    figure, panels = drawing.rows_of(2, height=3.4)
    played = cells(rows)
    at = [Place(PHANTOM, WALL, delay) for delay in DELAYS]  # one not played is a gap
    turns = np.arange(len(at), dtype=float)
    for method in colours:
        axes = panels[(method, PHANTOM) in giving(rows, LITTLE)]
        own = [played.get(place, {}).get(method, []) for place in at]
        felt = [(SCORES[0].of(one) or 0.0) / 1e3 if one else np.nan for one in own]
        values = np.array(felt)
        _drawn(axes, method, colours, turns, values)
        given = np.array([leaks(lowest(one)) for one in own])
        ring: dict[str, Any] = {"markersize": 10, "markeredgecolor": NOT_PASSIVE, "color": "none"}
        axes.plot(turns[given], values[given], "o", **ring)
    for axes, title in zip(
        panels,
        (f"gave a hand at most {energy_in_words(LITTLE)}", "gave more (ring: some of it here)"),
        strict=True,
    ):
        drawing.finish(axes, "stiffness felt (N/mm)", "delay each way")
        axes.set_yscale("symlog", linthresh=0.1)
        axes.set_xticks(turns, [place.network for place in at])
        axes.set_ylim(-0.01, 15.0)
        axes.axhline(10.0, color=NEUTRAL, linestyle=":", linewidth=1.0)
        axes.set_title(title, fontsize=9)
    save(figure, file)


def _transparency(rows: Sequence[Row], colours: Mapping[str, str], file: Path) -> None:
    """Two panels for each network: the ratio to the wall, and its phase."""
    shaken = [row for row in rows if row["hand"] == SHAKER and row["impedance.frequency_hz"]]
    networks = list(dict.fromkeys(row["network"] for row in shaken))
    figure, panels = drawing.rows_of(2 * max(len(networks), 1), height=3.2)
    for row in shaken:
        frequency, stiffness, damping = (
            np.asarray(row[f"impedance.{name}"], float)
            for name in ("frequency_hz", "stiffness_n_per_m", "damping_n_s_per_m")
        )
        ratio = (stiffness + 2j * np.pi * frequency * damping) / SOFT_STIFFNESS
        gaps = 1 + np.flatnonzero(frequency[1:] > 1.5 * frequency[:-1])  # a band is left out
        first = 2 * networks.index(row["network"])
        curves = np.abs(ratio), np.degrees(np.angle(ratio))
        for axes, values in zip(panels[first : first + 2], curves, strict=True):
            x, y = (np.insert(one, gaps, np.nan) for one in (frequency, values))
            _drawn(axes, row["method"], colours, x, y)
    for network, ratios, phases in zip(networks, panels[::2], panels[1::2], strict=False):
        _over_frequency(ratios, f"{network}: ratio", 1.0)
        ratios.set_yscale("log")
        _over_frequency(phases, f"{network}: phase (degrees)", 0.0)
    save(figure, file)


def _over_frequency(axes: Axes, label: str, perfect: float) -> None:
    drawing.finish(axes, label, "frequency (Hz)")
    axes.set_xscale("log")
    axes.axhline(perfect, color=NEUTRAL, linestyle=":", linewidth=1.0)


def _energy(rows: Sequence[Row], colours: Mapping[str, str], file: Path) -> None:
    """One row for each method and device, by the most that it gave; without a leak an empty one."""
    found = sorted(worst(rows), key=lambda one: one.energy, reverse=True)
    figure, (axes,) = drawing.rows_of(1, height=0.24 * len(found) + 0.8)
    for place, one in enumerate(found):
        for kind, (marker, _) in MARKERS.items():
            given = -(one.by_kind[kind] or 0.0)
            if leaks(-given):
                axes.plot(max(given, LEAST), place, marker, color=colours[one.method], markersize=6)
        if not one.leaks:
            axes.annotate("no leak found", (LEAST, place), fontsize=8, va="center", color=NEUTRAL)
    for marker, label in MARKERS.values():
        axes.plot([], [], marker, color=NEUTRAL, label=label)
    axes.set_xscale("log")
    axes.set_xlim(left=0.7 * LEAST)
    axes.set_ylim(-0.7, len(found) - 0.3)
    axes.set_yticks(
        range(len(found)), [f"{one.method.replace('_', ' ')}, {one.device}" for one in found]
    )
    drawing.plain(axes, "most energy given to a hand (J)")
    axes.legend(loc="lower right", fontsize=8)
    save(figure, file)
