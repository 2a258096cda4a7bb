"""Table 1: rate-hardness and displayed stiffness of every law at both speeds, over many trials.

The paper has one trial of a person for each law and speed. Here one hand makes many, which differ
in what nobody can set; a cell is their median, with 10 and 90 %. The hand was fitted to the trials'
distances over eleven of the 20 cells. Four others were fitted without one law each, and predict it;
no fit uses the viscous more conservative law.
"""

import math
from collections.abc import Iterable
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from forcebound.results.colours import COMMANDED, ESTIMATED, NEUTRAL, PHYSICAL
from forcebound.results.surface import Floats
from forcebound_proofs.drawing import LOG_TICKS, plain
from forcebound_proofs.paper.outcome import Number, Outcome
from forcebound_proofs.paper.setup import (
    CERTIFIED,
    HAND,
    LEFT_OUT,
    PAPER_LAWS,
    SPEEDS,
    USER_STUDY,
    Hand,
    Runs,
    wall_command,
)

COLUMNS = (  # quantity and speed, in the order of the paper's table
    ("rate_hardness", "high"),
    ("displayed_stiffness", "high"),
    ("rate_hardness", "low"),
    ("displayed_stiffness", "low"),
)

# N/mm; source: paper, Table 1.
PAPER: dict[str, tuple[float, float, float, float]] = {
    "less_conservative_viscous": (3.06, 0.71, 7.87, 0.69),
    "less_conservative": (6.05, 2.28, 8.02, 4.09),
    "aol": (6.02, 2.47, 8.25, 4.44),
    "more_conservative_viscous": (0.54, 0.54, 0.54, 0.54),
    "more_conservative": (1.29, 0.68, 2.16, 1.13),
}

HEIGHTS = {law: row for row, law in enumerate((*CERTIFIED[::-1], *reversed(PAPER_LAWS)), start=1)}
WORDS = {"rate_hardness": "rate-hardness", "displayed_stiffness": "displayed stiffness"}


@dataclass(frozen=True)
class Row:
    """One cell of the table, in N/mm: the paper's single trial, and ours."""

    law: str
    quantity: str
    speed: str
    paper: float | None  # None: the law is not in the paper
    median: float
    p10: float
    p90: float
    below_paper: float | None  # share of our trials

    @property
    def is_inside(self) -> bool:
        """Whether the paper's value, which has two digits, lies between 10 and 90 % of ours."""
        return self.paper is not None and self.p10 - 0.005 <= self.paper <= self.p90 + 0.005

    def number(self, note: str = "") -> Number:
        """Return the cell as a number of the experiment."""
        words = f"{WORDS[self.quantity]}, {self.speed} speed{note}"
        return Number(words, "N/mm", self.median, self.paper, self.law, (self.p10, self.p90))


def paper_value(law: str, quantity: str, speed: str) -> float | None:
    """Return a cell of the paper's table, in N/mm; None for a law that is not in it."""
    return PAPER[law][COLUMNS.index((quantity, speed))] if law in PAPER else None


def percentiles(values: Floats) -> tuple[float, float, float]:
    """Return median, 10 and 90 %."""
    median, low, high = np.quantile(values, (0.5, 0.1, 0.9)).tolist()
    return median, low, high


def rows(runs: Runs, laws: Iterable[str] = PAPER_LAWS, hand: Hand = HAND) -> list[Row]:
    """Return the cells of the table; of the paper's laws all 20."""
    table = []
    for law in laws:
        for quantity, speed in COLUMNS:
            ours, paper = runs.trials(law, speed, hand)[quantity], paper_value(law, quantity, speed)
            below = None if paper is None else float(np.mean(ours < paper))
            table.append(Row(law, quantity, speed, paper, *percentiles(ours), below))
    return table


def left_out_rows(runs: Runs) -> list[Row]:
    """Return the 20 cells, those of each law with the hand that was fitted to the other laws."""
    return [row for law, hand in LEFT_OUT.items() for row in rows(runs, [law], hand)]


def rms_log_error(cells: Iterable[Row]) -> float:
    """Return the root of the mean squared logarithm of our median over the paper's cell."""
    errors = [math.log(row.median / row.paper) for row in cells if row.paper is not None]
    return math.sqrt(sum(error * error for error in errors) / len(errors))


def trial_errors(runs: Runs) -> Floats:
    """Return the root-mean-square logarithmic error over the 20 cells of each trial alone."""
    errors = [
        np.log(runs.trials(law, speed)[quantity] / PAPER[law][column])
        for law in PAPER_LAWS
        for column, (quantity, speed) in enumerate(COLUMNS)
    ]
    each: Floats = np.sqrt(np.mean(np.square(errors), axis=0))
    return each


def run(runs: Runs) -> Outcome:
    """Reproduce the table."""
    for speed in SPEEDS:  # law by law: the compiled loop keeps the motions of 64 hands
        for law in (*PAPER_LAWS, *CERTIFIED):
            runs.trials(law, speed)
    table, certified, left_out = rows(runs), rows(runs, CERTIFIED), left_out_rows(runs)
    error, predicted = rms_log_error(table), rms_log_error(left_out)
    median, low, high = percentiles(trial_errors(runs))
    inside = sum(row.is_inside for row in table)
    by_law = {law: rms_log_error(row for row in left_out if row.law == law) for law in LEFT_OUT}
    speeds = {
        name: percentiles(runs.trials("more_conservative", name)["contact_speed"])
        for name in SPEEDS
    }
    return Outcome(
        title=f"rate-hardness and displayed stiffness of every law, {len(runs.tried)} trials",
        paper="Five laws at a high and a low approach speed, wall of 10 N/mm; single trials.",
        finding=(
            f"Root-mean-square logarithmic error of the medians {error:.3f} over all 20 cells, of "
            f"single trials {median:.3f} ({low:.3f} to {high:.3f}, 10 to 90 %); {inside} of the "
            "paper's 20 cells lie between 10 and 90 % of ours. One hand, fitted with eight "
            "numbers, meets the wall at "
            f"{speeds['high'][0] * 1e3:.0f} and {speeds['low'][0] * 1e3:.0f} mm/s. Four hands "
            f"fitted without one law each predict it: {predicted:.3f} over the 20 cells, by "
            f"law {min(by_law.values()):.3f} to {max(by_law.values()):.3f}."
        ),
        numbers=[
            *(row.number() for row in [*table, *certified]),
            *(row.number(", predicted from the other laws") for row in left_out),
            *user_study(runs),
            *turns(runs),
        ],
        drawing=draw(table, left_out, certified),
        commands=[wall_command(law, SPEEDS["high"]) for law in ("less_conservative", "certified")],
        document={
            "table1": [asdict(row) for row in table],
            "table1_left_out": [asdict(row) for row in left_out],
            "table1_certified": [asdict(row) for row in certified],
            "rms_log_error": error,
            "single_trial_rms_log_error": {"median": median, "p10": low, "p90": high},
            "left_out_rms_log_error": predicted,
            "left_out_rms_log_error_by_law": by_law,
            "setup": {
                "hand": asdict(HAND),
                "left_out": {law: asdict(hand) for law, hand in LEFT_OUT.items()},
                "trials": [asdict(trial) for trial in runs.tried],
                "contact_speed_m_per_s": speeds,
            },
        },
    )


def user_study(runs: Runs) -> list[Number]:
    """Return where the more conservative law rests, with the averages of the paper's user study.

    The study's hands are other ones, and nothing was fitted to it.
    """
    numbers, law = [], "more_conservative"
    for speed, paper in USER_STUDY.items():
        of = f"from 2 s on, {speed} speed (paper: mean of its user study, not fitted)"
        depth, force = (runs.trials(law, speed)[f"resting_{it}"] for it in ("depth", "force"))
        numbers.append(spread_of(f"penetration {of}", "mm", depth, law, paper.depth * 1e3))
        numbers.append(spread_of(f"force {of}", "N", force, law, paper.force))
    return numbers


def turns(runs: Runs) -> list[Number]:
    """Return how often the hand turns after contact; nothing was fitted to it."""
    words = "turning points in the first half second of contact"
    return [
        spread_of(f"{words}, {speed} speed", "1", runs.trials(law, speed)["turns"], law)
        for law in PAPER_LAWS
        for speed in SPEEDS
    ]


def spread_of(
    words: str, unit: str, values: Floats, law: str, paper: float | None = None
) -> Number:
    """Return the median of all trials as a number, with its spread."""
    median, low, high = percentiles(values)
    return Number(words, unit, median, paper, law, (low, high))


def draw(table: list[Row], left_out: list[Row], certified: list[Row]) -> Figure:
    """Draw the table: per column the paper's numbers and ours, on one logarithmic scale."""
    drawing = Figure(figsize=(13.5, 4.0), dpi=150, layout="constrained")
    grid = drawing.subplots(1, len(COLUMNS), sharey=True, sharex=True)
    for axes, column in zip(grid, COLUMNS, strict=True):
        axes.axvline(0.54, color=NEUTRAL, linewidth=1.0, linestyle="--", label="2B")
        axes.axvline(10.0, color=NEUTRAL, linewidth=1.0, linestyle=":", label="wall")
        here = [
            [row for row in cells if (row.quantity, row.speed) == column]
            for cells in (table, left_out, certified)
        ]
        _draw_column(axes, *here)
        axes.set_xscale("log")
        axes.set_xlim(0.4, 13.0)
        axes.set_xticks(LOG_TICKS, [f"{tick:g}" for tick in LOG_TICKS])
        axes.minorticks_off()
        axes.set_yticks(list(HEIGHTS.values()), [name.replace("_", " ") for name in HEIGHTS])
        axes.set_title(f"{WORDS[column[0]]}, {column[1]} speed", fontsize=10)
        plain(axes, "N/mm")
    handles, labels = (one for axes in grid[:1] for one in axes.get_legend_handles_labels())
    drawing.legend(handles, labels, loc="outside lower center", ncols=6, frameon=False, fontsize=9)
    return drawing


def _draw_column(axes: Axes, table: list[Row], left_out: list[Row], certified: list[Row]) -> None:
    def dots(cells: list[Row], label: str, marker: str, **style: Any) -> None:
        heights = [HEIGHTS[row.law] for row in cells]
        axes.plot([row.median for row in cells], heights, marker, label=label, **style)

    for cells, colour in ((table, PHYSICAL), (certified, ESTIMATED)):
        for row in cells:
            axes.plot([row.p10, row.p90], [HEIGHTS[row.law]] * 2, color=colour, linewidth=2.0)
    white: dict[str, Any] = {"markerfacecolor": "white", "markersize": 9}
    dots(left_out, "ours, predicted from the other laws", "o", color=PHYSICAL, **white)
    dots(table, "ours: median, 10 to 90 %", "o", color=PHYSICAL, markersize=5)
    dots(certified, "ours, certified law", "s", color=ESTIMATED, markersize=5)
    papers = [replace(row, median=row.paper or math.nan) for row in table]
    dots(papers, "paper: one trial", "D", color=COMMANDED, markersize=6)
