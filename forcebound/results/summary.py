"""Summary of a run: its figures as one JSON document.

A figure that the run or the launch file does not define is ``None``, never NaN, so that a summary
is always valid JSON.
"""

from collections.abc import Sequence
from itertools import zip_longest

import numpy as np

from forcebound.messages.events import PHASE_BEGINS
from forcebound.messages.packets import Event
from forcebound.messages.topology import Document
from forcebound.recordings.launched import Launched
from forcebound.recordings.telemetry import TelemetryColumns
from forcebound.results.cells import Summary
from forcebound.results.figures import FIGURES, Figure
from forcebound.results.samples import ALWAYS, SIZE, Samples
from forcebound.results.ticks import answered_share

#: Figures of one law; a run that changed it has them for each law.
OF_ONE_LAW = tuple(one.key for one in FIGURES if one.needs not in (ALWAYS, SIZE))

_OF_A_PHASE = ("loop_delay_ms", "reply_age_ms", "peak_force_n")


def summarize(
    columns: TelemetryColumns,
    config: Document,
    events: Sequence[Event] = (),
    explains: bool = True,
) -> Summary:
    """Return the figures of a run by key, ready for JSON; ``docs/results.md`` lists them.

    ``undefined`` has the reasons, by key, why a figure of a law is missing.

    Args:
        columns: Telemetry of the run.
        config: The launch file as resolved for the run, in SI numbers.
        events: Of the run.
        explains: Whether causes of little force are looked for, which takes a second or more.

    Raises:
        ConfigError: If the launch file describes a surface that does not fit the run.
    """
    return figures_of(Samples(columns, config, events, explains))


def axes_and_units(run: Launched) -> Summary:
    """Return what a summary says of named axes: their kinds, and units that its keys do not say."""
    if not run.axes:
        return {}
    turned = {one.key: run.shown(one.unit).si for one in FIGURES}
    units = {one.key: turned[one.key] for one in FIGURES if turned[one.key] != one.unit.si}
    return {"axes": {axis.name: axis.kind for axis in run.axes}, "units": units}


def figures_of(run: Samples, figures: Sequence[Figure] = FIGURES) -> Summary:
    """Return figures of a run, as :func:`summarize`."""
    lacks = run.lacks()
    found: Summary = {}
    undefined = {}
    for figure in figures:
        missing = [lacks[need] for need in figure.needs.of_run.split() if need in lacks]
        found[figure.key] = value = None if missing else figure.value(run)
        if missing or (value is None and figure.key in OF_ONE_LAW):
            undefined[figure.key] = (*missing, figure.needs.otherwise)[0]
    return {**found, **axes_and_units(run.launched), "undefined": undefined}


def summarize_phases(
    columns: TelemetryColumns, events: Sequence[Event], config: Document
) -> list[Summary]:
    """Return the figures of each phase of a scripted run, ready for JSON.

    Args:
        columns: Telemetry of the run.
        events: Of the run; they hold the start of each phase.
        config: The launch file as resolved for the run.
    """
    begins = [event for event in events if event.event == PHASE_BEGINS]
    phases = []
    for event, following in zip_longest(begins, begins[1:]):
        end_ns = 2**63 - 1 if following is None else following.time_ns
        inside = (columns.time_ns >= event.time_ns) & (columns.time_ns < end_ns)
        if inside.any():
            name = event.data.get("name", "")
            phases.append({"name": name} | _phase(columns.slice(inside), config))
    return phases


def _phase(part: TelemetryColumns, config: Document) -> Summary:
    run = Samples(part, config)
    energy = part.true_energy[np.isfinite(part.true_energy)]
    return {
        "start_s": float(part.elapsed[0]),
        "duration_s": float(part.elapsed[-1] - part.elapsed[0]),
        "answered_share": answered_share(part),
        "force_share": float(np.mean(part.engagement > 0.0)),
        **{figure.key: figure.value(run) for figure in FIGURES if figure.key in _OF_A_PHASE},
        "true_energy_min_j": float(energy.min()) if energy.size else None,
        **axes_and_units(run.launched),
        "deadline_misses": int(part.deadline_misses[-1] - part.deadline_misses[0]),
    }
