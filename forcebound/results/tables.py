"""Tables of summaries in everyday units (N/mm, mm, mJ, ms), and words for the axes of maps."""

from collections.abc import Iterable, Sequence

from forcebound.results.cells import Summary, percentiles
from forcebound.results.figures import FIGURES
from forcebound.results.perception import Difference
from forcebound.units import MJ, N_M, PERCENT, Everyday, N


def summary_rows(summary: Summary) -> list[tuple[str, str]]:
    """Return a summary as rows of label and value.

    The labels do not depend on the run, except for those of the bounder and of several axes, so the
    rows of several runs go side by side into one table.
    """
    rows = [(figure.label, figure.text(summary)) for figure in FIGURES if figure.label]
    return [(label, cell) for label, cell in rows if cell]


def summary_table(
    summaries: Iterable[tuple[str, Summary]],
) -> tuple[Sequence[str], list[Sequence[str]]]:
    """Return head and rows of the figures of some runs, each with the label of its column."""
    shown = []  # a run that changed its law has a column for each of them, too
    for label, summary in summaries:
        shown.append((label, summary))
        for one in summary.get("laws", ()):
            shown.append((f"{one['law']}, from {one['start_s']:.3g} s", one))
    columns = [dict(summary_rows(summary)) for _, summary in shown]
    labels_of_rows = dict.fromkeys(label for column in columns for label in column)
    rows = [(label, *(column.get(label, "–") for column in columns)) for label in labels_of_rows]
    return ("", *(label for label, _ in shown)), list(rows)


def axes_of_figures() -> dict[str, tuple[str, Everyday]]:
    """Return by key the words of a figure for the axis of a map, and its unit."""
    return {one.key: (one.label, one.unit) for one in FIGURES if one.label and one.cell is None}


def difference_text(of: Difference) -> str:
    """Return a difference of two runs in words."""
    name = of.figure.rpartition("_n")[0].replace("_", " ")
    if of.is_perceptible is None:
        return f"{name} {of.difference:+.0%}; a hand was not at rest"
    felt = "a hand feels it" if of.is_perceptible else "a hand does not feel it"
    return f"{name} {of.difference:+.0%}; {felt} (from {of.weber_fraction:.0%}, {of.source})"


def phase_rows(phases: Sequence[Summary]) -> list[tuple[str, ...]]:
    """Return a table of phases, its head first; delays are p50/p99/max."""
    head = ("phase", "delay, ms", "age of reply, ms", "answered", "force on", "peak force")
    return [(*head, "minimum energy"), *map(_phase_row, phases)]


def _phase_row(phase: Summary) -> tuple[str, ...]:
    return (
        phase["name"],
        percentiles(phase["loop_delay_ms"], 1),
        percentiles(phase["reply_age_ms"], 1),
        PERCENT.show(phase["answered_share"]),
        PERCENT.show(phase["force_share"]),
        (N_M if "peak_force_n" in phase.get("units", ()) else N).show(phase["peak_force_n"]),
        MJ.show(phase["true_energy_min_j"]),
    )
