"""Analysis of a study's data: percentages, tests, psychometric functions, checks.

It needs scipy and statsmodels, the extra ``study``.
"""

import hashlib
import math
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations
from pathlib import Path
from statistics import NormalDist, fmean, stdev
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from forcebound.errors import ConfigError
from forcebound.files import read_text
from forcebound.graph.document import MAX_BYTES
from forcebound.graph.problems import Problems
from forcebound.lab.engine import Row
from forcebound.lab.study.data import ABOUT, STUDY, TRIALS, read_participant, read_trials
from forcebound.lab.study.order import next_trial, staircase
from forcebound.lab.study.plan import Pairs, Staircase, StudyFile, read_study
from forcebound.lab.study.psychometric import Fit, fit
from forcebound.lab.views import groups
from forcebound.units import split_quantity, to_si

Group: TypeAlias = tuple[Any, ...]  # block, counted condition, the other one


@dataclass(frozen=True)
class Data:
    """All answered trials of a study but those of the training, by participant."""

    study: StudyFile
    name: str
    kind: str  # person, rehearsal, simulated
    rows: list[Row]  # with the participant's identifier
    unfinished: Sequence[str] = ()  # participants with trials left

    @cached_property
    def groups(self) -> dict[Group, list[Row]]:
        """The rows of each comparison, by block in the order of the study file."""
        order = list(self.study.blocks)
        rows = sorted(self.rows, key=lambda row: order.index(row["block"]))
        return groups(rows, "block", "counted", "other")


class Shares(NamedTuple):
    """How often the counted stimulus was chosen, with participants as the unit."""

    mean: float
    sd: float  # of participants; NaN of a single one
    standard_error: float
    interval: tuple[float, float]  # 95 %, by t; of a single one exact, of their trials
    chosen: int
    trials: int
    p: float  # against one half, two-sided: one-sample t; of a single one the exact binomial
    sensitivity: float  # mean of the d' of two-interval forced choice


def load_data(folder: Path) -> Data:
    """Return the data in a study's folder.

    Raises:
        ConfigError: With the first problem of each participant; or if there are no data, or of
            several studies or kinds.
    """
    rows, abouts, problems, unfinished = list[Row](), list[Row](), list[str](), list[str]()
    files: dict[str, tuple[StudyFile, str]] = {}  # study and its settings, by the text
    for own in sorted({one.parent for name in (ABOUT, TRIALS) for one in folder.glob(f"*/{name}")}):
        try:
            about, text = read_participant(own), read_text(own / STUDY, "the study file", MAX_BYTES)
            if text not in files:
                study, root, _ = read_study(own / STUDY, Problems())
                files[text] = study, hashlib.sha256(repr(root.plain).encode()).hexdigest()
            study, settings = files[text]
            answered, _ = read_trials(study, own, about)
        except ConfigError as error:
            problems.append(str(error))
            continue
        rows += [{**row, "participant": own.name} for row in answered if row["phase"] == "main"]
        abouts.append({**vars(about), STUDY: settings})
        unfinished += [own.name] if next_trial(study, about.number, answered) else []
    for key in ("study", "digest", "kind", STUDY):
        owners = {
            value: [one["participant"] for one in of]
            for (value,), of in groups(abouts, key).items()
        }
        if len(owners) > 1:
            got = "; ".join(f"{value[:12]!r} of {', '.join(of)}" for value, of in owners.items())
            file = folder / "*" / (STUDY if key == STUDY else ABOUT)
            problems.append(f"{file}: {key}: expected the same of all participants, got {got}")
    if problems:
        words = f"mend this, or move those participants out of {folder} to analyse the others"
        raise ConfigError("\n".join([*problems, words]))
    if not rows:
        raise ConfigError(f"{folder} has no answered trials of a study")
    return Data(study, abouts[0]["study"], abouts[0]["kind"], rows, unfinished)


def by_participant(rows: Sequence[Row]) -> dict[str, list[Row]]:
    """Return the rows of each participant."""
    return {name: own for (name,), own in groups(rows, "participant").items()}


def shares(rows: Sequence[Row]) -> Shares:
    """Return how often the counted stimulus was chosen."""
    from scipy.stats import binomtest

    people = [_chosen(own) for own in by_participant(rows).values()]
    each, chosen, trials = [fmean(own) for own in people], sum(_chosen(rows)), len(rows)
    if len(each) > 1:
        spread, (low, high, p) = stdev(each), t_test(each, 0.5)
    else:
        test = binomtest(chosen, trials)
        spread, p, (low, high) = math.nan, float(test.pvalue), test.proportion_ci()
    error, d = spread / math.sqrt(len(each)), fmean(d_prime(sum(own), len(own)) for own in people)
    return Shares(fmean(each), spread, error, (float(low), float(high)), chosen, trials, p, d)


def t_test(values: Sequence[float], expected: float) -> tuple[float, float, float]:
    """Return the 95 % interval of a mean, and the two-sided p of a one-sample t test.

    p is NaN if all values are as expected, and 0 if they are all the same otherwise.
    """
    from scipy.stats import t

    error, off = stdev(values) / math.sqrt(len(values)), abs(fmean(values) - expected)
    reach = float(t.ppf(0.975, len(values) - 1)) * error
    size = off / error if error else math.inf if off else math.nan
    p = 2.0 * float(t.sf(size, len(values) - 1))
    return fmean(values) - reach, fmean(values) + reach, p


def contrasts(data: Data) -> Iterator[tuple[str, float, float, float, float]]:
    """Yield blocks that differ, with mean, 95 % interval and p of the participants' differences.

    A paired t test of how often the same counted stimulus was chosen.
    """
    for (one, first), (two, second) in combinations(data.groups.items(), 2):
        pair = by_participant(first), by_participant(second)
        both = [name for name in pair[0] if name in pair[1]]
        if one[1:] == two[1:] and len(both) > 1:
            by = [fmean(_chosen(pair[0][a])) - fmean(_chosen(pair[1][a])) for a in both]
            yield f"{one[1]}, {one[0]} less {two[0]}", fmean(by), *t_test(by, 0.0)


def _chosen(rows: Sequence[Row]) -> list[int]:
    return [int(row["chose_counted"]) for row in rows]


def d_prime(chosen: int, trials: int) -> float:
    """Return the sensitivity d' of two-interval forced choice, the square root of 2 times z.

    Half a trial is added to either side (log-linear correction), so that it is finite. Source:
    Macmillan and Creelman, Detection theory, 2nd edition, 2005, chapter 7; Hautus, Behavior
    Research Methods 27, 1995.
    """
    return math.sqrt(2.0) * NormalDist().inv_cdf((chosen + 0.5) / (trials + 1.0))


def mixed_model(data: Data) -> list[tuple[str, float, float]]:
    """Return the terms of a logistic mixed model: name, posterior mean and SD, in log odds.

    One fixed effect for each comparison, a random intercept for each participant; variational
    Bayes of statsmodels, with its priors. Empty with a single participant, or if all answers are
    the same.
    """
    if len(by_participant(data.rows)) < 2 or len(set(_chosen(data.rows))) < 2:
        return []
    from statsmodels.genmod.bayes_mixed_glm import BinomialBayesMixedGLM

    keys, people = list(data.groups), list(by_participant(data.rows))
    pairs = [(key, row) for key, rows in data.groups.items() for row in rows]
    answers = np.array([int(row["chose_counted"]) for _, row in pairs])
    fixed = np.array([[float(key == one) for one in keys] for key, _ in pairs])
    random = np.array([[float(row["participant"] == one) for one in people] for _, row in pairs])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of the optimiser; the SD says how sure it is
        model = BinomialBayesMixedGLM(answers, fixed, random, np.zeros(len(people), int))
        fit = model.fit_vb()
    names = [f"{block}: {counted} against {other}" for block, counted, other in keys]
    return list(zip(names, fit.fe_mean.tolist(), fit.fe_sd.tolist(), strict=True))


def psychometric(study: StudyFile, rows: Sequence[Row]) -> Fit:
    """Fit a psychometric function to the answers at all levels, in the unit of the standard.

    Constant stimuli: the share in which the level was chosen, from 0 to 1, whose middle is the
    level that feels as the standard. Staircase: the share of right answers over the difference
    from the standard, from one half at a difference of 0.
    """
    assert not isinstance(study.method, Pairs)
    is_climbed, standard = isinstance(study.method, Staircase), study.method.standard
    size = to_si(f"1 {split_quantity(standard)[1]}") or 1.0
    zero = to_si(standard) if is_climbed else None
    counts: dict[float, list[int]] = {}
    for row in rows:
        level = ((to_si(row["counted_level"]) or 0.0) - (zero or 0.0)) / size
        counts.setdefault(round(level, 12), []).append(int(row["chose_counted"]))
    levels = sorted(counts)
    chosen, trials = [sum(counts[x]) for x in levels], [len(counts[x]) for x in levels]
    return fit(levels, chosen, trials, is_climbed)


def reversal_means(study: StudyFile, rows: Sequence[Row]) -> dict[str, float]:
    """Return the mean of each participant's reversals after the last change of the step.

    They are differences from the standard, in its unit.
    """
    assert isinstance(study.method, Staircase)
    found, standard = {}, split_quantity(study.method.standard)[0]
    for name, own in by_participant(rows).items():
        turns = staircase(study.method, [bool(one) for one in _chosen(own)])[1]
        if len(turns) > study.method.coarse:
            found[name] = fmean(turns[study.method.coarse :]) - standard
    return found


def touches(rows: Sequence[Row], condition: str, name: str) -> list[float]:
    """Return a measure of all touches of a condition, such as ``stiffness``; without missing."""
    return [
        float(row[f"{name}_{place}"])
        for row in rows
        for place in (1, 2)
        if row[f"condition_{place}"] == condition and row[f"{name}_{place}"]
    ]


def expected_share(rows: Sequence[Row], weber: float, lapse: float) -> float:
    """Return how often an observer would choose the counted stimulus, by displayed stiffness.

    ``weber`` is the standard deviation of the difference as felt over the stiffness.
    """
    found = []
    for row in rows:
        if not (row["stiffness_1"] and row["stiffness_2"]):
            continue
        first, second = float(row["stiffness_1"]), float(row["stiffness_2"])
        spread = weber * math.sqrt(0.5 * (first**2 + second**2))
        size = first - second if row["counted_interval"] == "1" else second - first
        felt = NormalDist().cdf(size / spread) if spread else 0.5  # no force in either
        found.append(0.5 * lapse + (1.0 - lapse) * felt)
    return fmean(found) if found else math.nan


def checks(data: Data) -> dict[str, str]:
    """Return checks of the order and of the speed, in words."""
    from scipy.stats import binomtest

    firsts = sum(row["answer"] == "1" for row in data.rows)
    p = float(binomtest(firsts, len(data.rows)).pvalue)
    leading = sum(row["counted_interval"] == "1" for row in data.rows)
    begun = [own[0]["block"] for own in by_participant(data.rows).values()]
    counts = ", ".join(f"{block} {begun.count(block)}" for block in data.study.blocks)
    again = sum(int(row[f"touches_{place}"]) - 1 for row in data.rows for place in (1, 2))
    found = {
        "answer *first*": f"{firsts} of {len(data.rows)} trials (exact binomial p = {p:.3g})",
        "counted stimulus first": f"{leading} of {len(data.rows)} trials",
        "participants by first block": counts,
        "participants with trials left": ", ".join(data.unfinished) or "none",
        "touches repeated for their speed": f"{again}, besides {2 * len(data.rows)} that count",
    }
    for (block,), rows in groups(data.rows, "block").items():
        for name in dict.fromkeys(row["counted"] for row in rows) | dict.fromkeys(
            row["other"] for row in rows
        ):
            found[f"speed, {block}, {name}"] = _speed(rows, name)
    return found


def _speed(rows: Sequence[Row], condition: str) -> str:
    speeds = touches(rows, condition, "speed")
    if not speeds:
        return "not measured"
    spread = f" (SD {stdev(speeds) * 1e3:.1f})" if len(speeds) > 1 else ""
    return f"{fmean(speeds) * 1e3:.1f} mm/s{spread}"
