"""Colours of figures: one for each quantity and for each law, the same everywhere.

They are Okabe and Ito's, which people with any colour vision can tell apart, and a grey; the
``viscous`` variants of a law are a darker shade of its colour. Source: Okabe, Ito, Color universal
design, 2008.
"""

from collections.abc import Sequence

PHYSICAL = "#0072B2"  # blue: physical quantities
COMMANDED = "#E69F00"  # orange: commanded force, and the environment's own stiffness
ESTIMATED = "#009E73"  # green: estimates of the law
NOT_PASSIVE = "#D55E00"  # vermilion: not passive; faults
PHASE = "#56B4E9"  # sky blue: every other phase
NEUTRAL = "#7F7F7F"  # grey: surfaces, bounds, zero lines

#: One for each axis, in order.
AXIS_COLOURS: tuple[str, ...] = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00")
AXIS_COLOURS += ("#882255", "#000000")

LAW_COLOURS = {
    "less_conservative": "#0072B2",
    "aol": "#56B4E9",
    "more_conservative": "#E69F00",
    "certified": "#009E73",
    "certified_fading": "#CC79A7",
    "tdpa": "#D55E00",
    "none": "#7F7F7F",
    "less_conservative_viscous": "#00395A",
    "more_conservative_viscous": "#7A5400",
    "energy_tank": "#000000",
}


def colours_of(names: Sequence[object]) -> list[str]:
    """Return the colours of the lines of a figure: a law's own, else one after the other."""
    others = iter(range(len(names)))
    return [LAW_COLOURS.get(str(name)) or f"C{next(others) % 10}" for name in names]
