"""Delays and losses of links, against their definitions and those of netem."""

import math
from bisect import bisect_left
from collections.abc import Callable
from functools import partial
from itertools import pairwise
from statistics import NormalDist, fmean
from typing import Any

import pytest
from builders import MS, TimedPacket
from chance_tests import SURELY_NOT, EveryPacket, delays, is_likely, losses

from forcebound.network.chances import Draws
from forcebound.network.impairment import QUANTILES, GilbertElliott, Impairment, Outage
from forcebound.network.link import Link

# Delay


def test_correlation_is_the_recursion_of_netem() -> None:
    rho, count = 0.7, 2000
    found = delays(Impairment(0.01, 0.004, correlation=rho), count, seed=3)
    draw = Draws(3)["jitter"]
    u: float | None = None
    for delay_ns in found:
        new = draw()
        u = new if u is None else (1 - rho) * new + rho * u
        assert abs(delay_ns - (10 * MS + 4 * MS * (2 * u - 1))) <= 1


@pytest.mark.parametrize("rho", [0.0, 0.25, 0.9])
def test_successive_delays_are_correlated(rho: float) -> None:
    count = 20_000
    found = delays(Impairment(0.01, 0.004, correlation=rho), count, seed=5)
    mean = fmean(found)
    variance = fmean((delay - mean) ** 2 for delay in found)
    covariance = fmean((a - mean) * (b - mean) for a, b in pairwise(found))
    # Bartlett: the estimate of an AR(1) has the variance (1 - rho^2) / n; 4 sigma.
    assert abs(covariance / variance - rho) < 4 * math.sqrt((1 - rho**2) / count) + 1e-3
    expected = (4 * MS) ** 2 / 3 * (1 - rho) / (1 + rho)
    assert variance == pytest.approx(expected, rel=0.1)


def _pareto_cdf(x: float) -> float:
    return 1.0 - 1.0 / (0.75 * x + 1.5) ** 3


def _inverse(quantile: Callable[[float], float], x: float) -> float:
    """Return where ``quantile``, which rises, reaches ``x``."""
    steps = 2**20
    place = bisect_left(range(steps), x, key=lambda i: quantile(i / steps))
    return place / steps


CDFS: dict[str, Callable[[float], float]] = {
    "normal": NormalDist().cdf,
    "pareto": _pareto_cdf,
    "paretonormal": partial(_inverse, QUANTILES["paretonormal"]),
}


@pytest.mark.parametrize("name", ["normal", "pareto", "paretonormal"])
def test_deviations_have_the_named_distribution(name: Any) -> None:
    count = 2000
    cdf = CDFS[name]
    impairment = Impairment(delay=1.0, jitter=0.01, distribution=name)
    sample = sorted((delay - 1000 * MS) / (10 * MS) for delay in delays(impairment, count))
    inner = [(i, x) for i, x in enumerate(sample) if abs(x) < 3.99]  # the tables end at 4
    distance = max(max((i + 1) / count - cdf(x), cdf(x) - i / count) for i, x in inner)
    # Dvoretzky, Kiefer, Wolfowitz, with Massart's constant.
    assert 2 * math.exp(-2 * count * distance**2) > SURELY_NOT
    assert max(sample) <= 4.0 + 1e-7


def test_quantiles_are_those_of_the_tables_of_tc() -> None:
    """First, middle and last entries of iproute2's normal, pareto and paretonormal tables."""
    assert QUANTILES["normal"](0.5) == 0.0
    assert QUANTILES["normal"](0.0) == -4.0
    assert round(8192 * QUANTILES["pareto"](0.0)) == -5461
    assert QUANTILES["pareto"](1 - 16 / 65536) == 4.0
    middle = 3 * QUANTILES["pareto"](0.5) / 4
    assert QUANTILES["paretonormal"](0.5) == middle
    assert QUANTILES["pareto"](0.5) == pytest.approx(4 / 3 * (2 ** (1 / 3) - 1.5))


# Loss


def test_bursts_of_gilbert_elliott_are_geometric() -> None:
    p, r, count = 0.02, 0.25, 20_000
    lost = losses(Impairment(gemodel=GilbertElliott(p, r)), count)
    assert not lost[0]
    assert is_likely([not second for first, second in pairwise(lost) if first], r)
    assert is_likely([second for first, second in pairwise(lost) if not first], p)
    lengths = [len(run) for run in "".join("x" if is_lost else " " for is_lost in lost).split()]
    for length in (1, 2, 5):
        reached = [run >= length for run in lengths]
        if length > 1:
            assert is_likely(reached, (1 - r) ** (length - 1))


def test_both_states_of_gilbert_elliott_lose_by_their_own_probability() -> None:
    always_bad = GilbertElliott(p=1.0, r=0.0, h=0.7, k=0.0)
    lost = losses(Impairment(gemodel=always_bad), 4000)
    assert lost[0]  # it begins good, and the good state here loses all
    assert is_likely(lost[1:], 0.3)
    always_good = GilbertElliott(p=0.0, r=1.0, h=0.0, k=0.9)
    assert is_likely(losses(Impairment(gemodel=always_good), 4000), 0.1)


def test_outages_lose_what_arrives_in_them_and_nothing_else() -> None:
    outages = (Outage(0.010, 0.005), Outage(0.013, 0.004), Outage(0.030, 0.0))
    link: Link[TimedPacket] = EveryPacket(Impairment(delay=0.002, outages=outages), 1)
    start_ns = 7_000 * MS  # counted from the first packet, whatever the clock says
    for seq in range(40):
        link.accept(start_ns + seq * MS, TimedPacket(seq, 0))
    arrived = [packet.seq for packet in link.due(10**15)]
    assert arrived == [*range(10), *range(17, 40)]
    assert link.lost == 7


def test_an_outage_that_is_set_later_is_not_in_the_past() -> None:
    link: Link[TimedPacket] = EveryPacket(Impairment(delay=0.002), 1)
    for seq in range(100):
        if seq == 60:
            link.change(Impairment(delay=0.002, outages=(Outage(0.010, 0.005),)))
        if seq == 65:  # another value does not begin them again
            link.change(Impairment(delay=0.001, outages=(Outage(0.010, 0.005),)))
        link.accept(seq * MS, TimedPacket(seq, 0))
    arrived = [packet.seq for packet in link.due(10**15)]
    assert arrived == [*range(70), *range(75, 100)]
