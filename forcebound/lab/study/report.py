"""The report of a study: Markdown with tables, and pictures."""

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from statistics import NormalDist, fmean

import numpy as np
from matplotlib.figure import Figure

from forcebound.files import check_writable
from forcebound.lab.engine import Row
from forcebound.lab.study import analysis
from forcebound.lab.study.analysis import Data, Shares
from forcebound.lab.study.plan import Pairs, Staircase
from forcebound.lab.study.psychometric import JND75, Fit
from forcebound.lab.views import table
from forcebound.results.colours import NEUTRAL, PHYSICAL
from forcebound.results.plots import blank, plain, save
from forcebound.units import split_quantity

WEBERS, LAPSES = (0.1, 0.23, 0.34, 0.5, 1.0), (0.0, 0.02, 0.1)  # 0.34: if 0.23 were at 75 %


def write_report(folder: Path) -> Path:
    """Write ``report.md`` and its pictures into a study's folder; return the page.

    Raises:
        ConfigError: If there are no data, or the folder cannot be written.
    """
    data, page = analysis.load_data(folder), folder / "report.md"
    check_writable(page, "the report")
    lines = [*_head(data)]
    found = {key: analysis.shares(rows) for key, rows in data.groups.items()}
    if isinstance(data.study.method, Pairs):
        save(_bars(data, found), folder / "report.png")
        lines += ["![Percentages with standard errors](report.png)", "", *_percentages(data, found)]
        lines += [*_touches(data), *_observers(data)]
    else:
        fits = {key: analysis.psychometric(data.study, rows) for key, rows in data.groups.items()}
        save(_curves(data, fits), folder / "report.png")
        lines += ["![Psychometric functions](report.png)", "", *_thresholds(data, fits)]
    lines += ["## Checks", "", *(f"* {name}: {one}" for name, one in analysis.checks(data).items())]
    page.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return page


def _head(data: Data) -> Iterator[str]:
    people = len(analysis.by_participant(data.rows))
    yield f"# {data.name}"
    yield ""
    yield data.study.description
    yield ""
    yield f"Participants: {people} (**{data.kind}**). Answered trials: {len(data.rows)}."
    if data.kind == "simulated":
        yield "The simulated observers are identical; their spread says nothing about that between"
        yield "people. Do not plan a sample size with it."
    yield ""


def _percentages(data: Data, found: dict[analysis.Group, Shares]) -> Iterator[str]:
    """Yield how often the counted stimulus was chosen, with the tests."""
    terms, is_one = analysis.mixed_model(data), len(analysis.by_participant(data.rows)) < 2
    yield "## Chosen as the answer"
    yield ""
    heads = ["block", "counted", "mean (SD), %", "standard error, %", "95 %", "p against 50 %"]
    heads += ["published (SD), %", "all trials", "d'", "log odds, mixed model (SD)"]
    rows = []
    for number, ((block, counted, other), one) in enumerate(found.items()):
        theirs = data.study.published.get(block)
        rows.append(
            [
                *(block, f"{counted} against {other}"),
                f"{_percent(one.mean)} ({_percent(one.sd)})",
                _percent(one.standard_error),
                *(" to ".join(map(_percent, one.interval)), f"{one.p:.2g}"),
                f"{_percent(theirs.chosen)} ({_percent(theirs.sd)})" if theirs else "",
                *(f"{one.chosen} of {one.trials}", f"{one.sensitivity:.2f}"),
                f"{terms[number][1]:.2f} ({terms[number][2]:.2f})" if terms else "",
            ]
        )
    yield from table(heads, rows)
    yield ""
    yield _TESTS[is_one]
    yield ""
    for name, mean, low, high, p in analysis.contrasts(data):
        interval = f"95 % {100 * low:.2f} to {100 * high:.2f}"
        yield f"* {name}: {100 * mean:+.2f} % ({interval}), p = {p:.2g}"
    yield ""


_TESTS = (
    "95 % and p are of participants' percentages (one-sample t test). d' is the mean of their d',"
    " each with the log-linear correction (half a trial is added to either side). A difference of"
    " blocks, if there are several, is a paired t test of participants.",
    "One participant: 95 % and p are exact binomial ones of the trials, and say nothing about other"
    " people. d' has the log-linear correction (half a trial is added to either side).",
)


def _percent(share: float) -> str:
    return "–" if np.isnan(share) else f"{100 * share:.2f}"


def _touches(data: Data) -> Iterator[str]:
    """Yield the measures: means over the touches of each condition, and of both."""
    yield "## Touches"
    yield ""
    rows = []
    for (block, counted, other), own in data.groups.items():
        for name, conditions in (
            (counted, [counted]),
            (other, [other]),
            ("both", [counted, other]),
        ):
            means = [
                fmean(
                    [x for one in conditions for x in analysis.touches(own, one, key)] or [np.nan]
                )
                for key in ("penetration", "force", "stiffness")
            ]
            rows.append([block, name, *_in_units(*means)])
        theirs = data.study.published.get(block)
        if theirs:
            units = _in_units(theirs.penetration, theirs.force, theirs.stiffness)
            rows.append([block, "published", *units])
    yield from table(["block", "condition", "penetration, mm", "force, N", "stiffness, N/mm"], rows)
    yield ""


def _in_units(penetration: float, force: float, stiffness: float) -> list[str]:
    return [f"{1e3 * penetration:.2f}", f"{force:.2f}", f"{1e-3 * stiffness:.2f}"]


def _observers(data: Data) -> Iterator[str]:
    """Yield the choices of ideal observers of these stiffnesses."""
    yield "## By Weber fraction and lapse rate"
    yield ""
    yield "What an observer would choose who compares the displayed stiffness of these touches, %."
    yield "The Weber fraction is the point of 84 % right answers."
    yield ""
    rows = [
        [block, counted, f"{100 * lapse:g} %"]
        + [f"{100 * analysis.expected_share(own, weber, lapse):.1f}" for weber in WEBERS]
        for (block, counted, _), own in data.groups.items()
        for lapse in LAPSES
    ]
    yield from table(["block", "counted", "lapses", *map(str, WEBERS)], rows)
    yield ""


def _thresholds(data: Data, fits: dict[analysis.Group, Fit]) -> Iterator[str]:
    """Yield the thresholds of all participants together, and of each."""
    is_climbed = isinstance(data.study.method, Staircase)
    yield "## Thresholds"
    yield ""
    yield f"In {_unit(data)}. {_MEANINGS[is_climbed]} {_LAMBDA}"
    yield ""
    rows = []
    for key, own in data.groups.items():
        each = {name: analysis.psychometric(data.study, one) for name, one in _people(own)}
        turns = analysis.reversal_means(data.study, own) if is_climbed else {}
        for name, fit in {"all": fits[key], **each}.items():
            rows.append([*key[:2], name, sum(fit.trials), *_fitted(data, fit)])
            if is_climbed:
                rows[-1].append(f"{turns[name]:.4g}" if name in turns else "")
    heads = ["block", "condition", "participant", "trials", *_FITTED[is_climbed]]
    yield from table(heads, rows)
    yield ""


def _fitted(data: Data, fit: Fit) -> list[str]:
    """Return the cells of a fit: PSE of constant stimuli, JND, Weber fraction, lapse rate."""
    is_climbed = isinstance(data.study.method, Staircase)
    standard = split_quantity(getattr(data.study.method, "standard", "0"))[0]
    factor = JND75 if is_climbed else 1.0
    pairs = [] if is_climbed else [(fit.pse, fit.pse_interval)]
    pairs.append(
        (factor * fit.sigma, (factor * fit.sigma_interval[0], factor * fit.sigma_interval[1]))
    )
    shown = [f"{mean:.4g} [{low:.4g}, {high:.4g}]" for mean, (low, high) in pairs]
    weber = f"{fit.sigma / abs(standard):.3g}" if standard else ""
    return [*shown, *([f"{fit.sigma:.4g}"] if is_climbed else []), weber, f"{fit.lapse:.3g}"]


_FITTED = (
    ["PSE [95 %]", "JND [95 %]", "Weber fraction", "lapse, lambda"],
    ["JND75 [95 %]", "sigma", "Weber fraction", "lapse, lambda", "mean of reversals"],
)
_MEANINGS = (
    "PSE is the level that feels as the standard; JND is sigma, the difference from there to 84 %.",
    "JND75 is the difference from the standard with 75 % right answers; sigma, that with 84 %, is"
    " JND75 / 0.674. At a difference of 0 an observer is right in 50 %, so that neither is below 0."
    " The mean of the reversals after the last change of step tends to 70.7 % only when the"
    " staircase is long and its steps are small beside sigma: use the fit.",
)
_LAMBDA = (
    "The Weber fraction is sigma over the standard. Levels are those commanded. All are without"
    " lapses; lambda is what the curve lacks to 100 %, half of the share of guesses. *all* takes"
    " the trials as if of one person."
)


def _unit(data: Data) -> str:
    return split_quantity(getattr(data.study.method, "standard", "0"))[1] or "plain numbers"


def _people(rows: Sequence[Row]) -> Iterable[tuple[str, list[Row]]]:
    people = analysis.by_participant(rows)
    return people.items() if len(people) > 1 else ()


def _bars(data: Data, found: dict[analysis.Group, Shares]) -> Figure:
    """Draw the paper's Fig. 23: means with standard errors, the published beside ours."""
    drawing = blank(5.0, 4.0)
    axes, people = drawing.subplots(), len(analysis.by_participant(data.rows))
    sides = [(0.0, PHYSICAL, f"ours, {people} {data.kind}")]
    sides += [(0.38, NEUTRAL, "published")] if data.study.published else []
    for shift, colour, label in sides:
        for place, ((block, _, _), one) in enumerate(found.items()):
            mean, error = one.mean, one.standard_error
            if shift:
                theirs = data.study.published[block]
                mean, error = theirs.chosen, theirs.sd / np.sqrt(theirs.people)
            name, size = None if place else label, (100 * mean, 0.36)
            axes.bar(place + shift, *size, yerr=100 * error, capsize=4, color=colour, label=name)
    axes.axhline(50.0, color=NEUTRAL, linestyle=":")
    names = [f"{counted}\n{block}" for block, counted, _ in found]
    axes.set_xticks([place + 0.19 for place in range(len(found))], names)
    axes.set(ylabel="chosen as the answer (%)", ylim=(0.0, 105.0))
    axes.legend(frameon=False, loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2)
    plain(axes)
    return drawing


def _curves(data: Data, fits: dict[analysis.Group, Fit]) -> Figure:
    """Draw the psychometric functions of all participants together."""
    drawing = blank(6.0, 4.0)
    axes, is_climbed = drawing.subplots(), isinstance(data.study.method, Staircase)
    for number, ((block, counted, _), fit) in enumerate(fits.items()):
        x = np.linspace(0.0 if is_climbed else min(fit.levels), max(fit.levels), 200)
        normal = np.array([NormalDist(fit.pse, fit.sigma).cdf(one) for one in x])
        share = fit.lapse + (1.0 - 2.0 * fit.lapse) * normal
        axes.plot(x, 100 * share, color=f"C{number}", label=f"{block}: {counted}")
        shares = 100 * np.array(fit.chosen) / np.array(fit.trials)
        axes.scatter(fit.levels, shares, 3.0 * np.sqrt(fit.trials), color=f"C{number}")
    names = ("difference from the standard", "right answers") if is_climbed else ("level", "chosen")
    axes.set(xlabel=f"{names[0]} ({_unit(data)})", ylabel=f"{names[1]} (%)", ylim=(-3.0, 103.0))
    axes.legend(frameon=False)
    plain(axes)
    return drawing
