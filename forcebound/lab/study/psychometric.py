"""Psychometric functions: a cumulative normal with lapses, by Bayes on a grid.

Source: Schütt, Harmeling, Macke and Wichmann, Painfree and accurate Bayesian estimation of
psychometric functions for (potentially) overdispersed data, Vision Research 122, 2016: priors from
the range of the levels. Ours is the binomial model without overdispersion.
"""

from collections.abc import Sequence
from itertools import pairwise
from statistics import NormalDist
from typing import Any, NamedTuple

import numpy as np

PSES, SIGMAS, LAPSES = 80, 60, 25  # points of the grid
MOST_LAPSES = 0.4
LAPSE_PRIOR = 10.0  # Beta(1, 10)
NEGLIGIBLE = 1e-4  # of the highest density; beyond it the grid is not refined


JND75 = NormalDist().inv_cdf(0.75)  # of a difference with 75 % right answers, over sigma


class Fit(NamedTuple):
    """Psychometric function of a condition in a block; means of the posterior.

    The intervals are credible ones of 95 %.
    """

    levels: list[float]  # in the unit of the standard; for a staircase differences from it
    chosen: list[int]
    trials: list[int]
    pse: float  # the level that is chosen in 50 %; 0 for a staircase
    pse_interval: tuple[float, float]
    sigma: float  # standard deviation of the normal: from the PSE to 84 %, without lapses
    sigma_interval: tuple[float, float]
    lapse: float  # lambda: what the upper end lacks to 1 and the lower end to 0


def fit(levels: list[float], chosen: list[int], trials: list[int], is_difference: bool) -> Fit:
    """Return the function that fits how often each level was chosen.

    It is ``lapse + (1 - 2 lapse) * normal((level - pse) / sigma)``. For differences of a forced
    choice with a right answer, the PSE is 0: an observer without a bias who feels no difference is
    right in one half of the trials.

    The prior is flat for the PSE, to half the range beyond the levels, and for the logarithm of
    sigma, from a third of the smallest step to the range, or twice the largest difference.
    """
    scale = max(levels) - min(levels) or abs(levels[0]) or 1.0
    step = min((b - a for a, b in pairwise(levels)), default=scale)
    pse = np.linspace(min(levels) - scale / 2, max(levels) + scale / 2, PSES)
    widest = 2.0 * max(levels) if is_difference else scale
    pse, sigma = np.zeros(1) if is_difference else pse, np.geomspace(step / 3, widest, SIGMAS)
    for _ in range(2):  # the second time where the posterior is
        posterior, lapse = _posterior(levels, chosen, trials, pse, sigma)
        of_pse = _marginal(pse, posterior.sum((1, 2)))
        of_sigma = _marginal(sigma, posterior.sum((0, 2)))
        pse = pse if is_difference else np.linspace(*of_pse[2], PSES)
        sigma = np.geomspace(*of_sigma[2], SIGMAS)
    lapses = _marginal(lapse, posterior.sum((0, 1)))[0]
    return Fit(levels, chosen, trials, of_pse[0], of_pse[1], of_sigma[0], of_sigma[1], lapses)


def _posterior(
    levels: Sequence[float], chosen: Sequence[int], trials: Sequence[int], pse: Any, sigma: Any
) -> tuple[Any, Any]:
    """Return the posterior by PSE, sigma and lapse, its highest 1; and the lapses."""
    from scipy.special import ndtr, xlog1py, xlogy

    lapse = np.linspace(0.0, MOST_LAPSES, LAPSES)
    shape = len(pse), SIGMAS, LAPSES
    logarithm = np.broadcast_to((LAPSE_PRIOR - 1.0) * np.log1p(-lapse), shape)
    for level, count, total in zip(levels, chosen, trials, strict=True):
        normal = ndtr((level - pse[:, None]) / sigma)[:, :, None]
        share = lapse + (1.0 - 2.0 * lapse) * normal
        logarithm = logarithm + xlogy(count, share) + xlog1py(total - count, -share)
    return np.exp(logarithm - logarithm.max()), lapse


def _marginal(values: Any, density: Any) -> tuple[float, tuple[float, float], tuple[Any, Any]]:
    """Return mean, 95 % interval, and the ends of where a density is not negligible.

    The ends are one point further.
    """
    low, high = np.interp((0.025, 0.975), np.cumsum(density) / density.sum(), values)
    (places,) = np.nonzero(density > NEGLIGIBLE * density.max())
    ends = values[max(places[0] - 1, 0)], values[min(places[-1] + 1, len(values) - 1)]
    return float((values * density).sum() / density.sum()), (float(low), float(high)), ends
