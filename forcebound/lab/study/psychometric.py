"""Psychometric functions: a cumulative normal with lapses, by Bayes on a grid.

Source: Schütt, Harmeling, Macke and Wichmann, Painfree and accurate Bayesian estimation of
psychometric functions for (potentially) overdispersed data, Vision Research 122, 2016: priors from
the range of the levels. Ours is the binomial model without overdispersion.
"""

from collections.abc import Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

THRESHOLDS, SIGMAS, LAPSES = 80, 60, 25  # points of the grid
MOST_LAPSES = 0.4
LAPSE_PRIOR = 10.0  # Beta(1, 10)
NEGLIGIBLE = 1e-4  # of the highest density; beyond it the grid is not refined


class Fit(NamedTuple):
    """Psychometric function of a condition in a block; means of the posterior."""

    levels: list[float]  # in the unit of the standard, which they are for a staircase less
    chosen: list[int]
    trials: list[int]
    threshold: float  # 50 % of constant stimuli; 75 % of a staircase
    interval: tuple[float, float]  # 95 %, credible
    sigma: float  # standard deviation of the normal
    lapse: float


def fit(levels: list[float], chosen: list[int], trials: list[int], guess: float | None) -> Fit:
    """Return the function that fits how often each level was chosen.

    It is ``guess + (1 - guess - lapse) * normal``; ``guess`` None: as often as a lapse. The prior
    is flat for the threshold, to half the range beyond the levels, and for the logarithm of sigma,
    from a third of the smallest step to the range.
    """
    scale = max(levels) - min(levels) or abs(levels[0]) or 1.0
    step = min((b - a for a, b in pairwise(levels)), default=scale)
    threshold = np.linspace(min(levels) - scale / 2, max(levels) + scale / 2, THRESHOLDS)
    sigma = np.geomspace(step / 3, scale, SIGMAS)
    for _ in range(2):  # the second time where the posterior is
        posterior, lapse = _posterior(levels, chosen, trials, guess, threshold, sigma)
        by_threshold, by_sigma = posterior.sum((1, 2)), posterior.sum((0, 2))
        best = _mean(threshold, by_threshold), _mean(sigma, by_sigma)
        spread = np.cumsum(by_threshold) / by_threshold.sum()
        low, high = np.interp((0.025, 0.975), spread, threshold)
        threshold = np.linspace(*_ends(threshold, by_threshold), THRESHOLDS)
        sigma = np.geomspace(*_ends(sigma, by_sigma), SIGMAS)
    lapses = _mean(lapse, posterior.sum((0, 1)))
    return Fit(levels, chosen, trials, best[0], (float(low), float(high)), best[1], lapses)


def _posterior(
    levels: Sequence[float],
    chosen: Sequence[int],
    trials: Sequence[int],
    guess: float | None,
    threshold: Any,
    sigma: Any,
) -> tuple[Any, Any]:
    """Return the posterior by threshold, sigma and lapse, its highest 1; and the lapses."""
    from scipy.special import ndtr, xlog1py, xlogy

    lapse = np.linspace(0.0, MOST_LAPSES, LAPSES)
    least = lapse if guess is None else guess
    logarithm = np.broadcast_to(
        (LAPSE_PRIOR - 1.0) * np.log1p(-lapse), (THRESHOLDS, SIGMAS, LAPSES)
    )
    for level, count, total in zip(levels, chosen, trials, strict=True):
        normal = ndtr((level - threshold[:, None]) / sigma)[:, :, None]
        share = least + (1.0 - least - lapse) * normal
        logarithm = logarithm + xlogy(count, share) + xlog1py(total - count, -share)
    return np.exp(logarithm - logarithm.max()), lapse


def _mean(values: Any, density: Any) -> float:
    return float((values * density).sum() / density.sum())


def _ends(values: Any, density: Any) -> tuple[float, float]:
    """Return the ends of where a density is not negligible, one point further."""
    (places,) = np.nonzero(density > NEGLIGIBLE * density.max())
    return values[max(places[0] - 1, 0)], values[min(places[-1] + 1, len(values) - 1)]
