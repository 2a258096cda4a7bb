"""Runs of attacks are the same runs for ever: margins recorded in the earlier code, to the bit."""

import pytest

from forcebound_proofs.attack import MARGIN, Series
from forcebound_proofs.audit import replay

RECORDED = (
    ("tdpa", "laws:176", -5.083156385209929),
    ("certified", "laws:176", 0.0),
    ("aol", "laws:420", -54.71788568435147),
    ("less_conservative", "laws:602", -0.14254847938784265),
    ("tdpa", "laws:c2188q6t00jrvqrp053a93bn7n9drvvoh59e7a6edijf42", -11.925181118301426),
    (
        "less_conservative_viscous",
        "laws:c2262as3adbevvr24j43giopsrg2p7rfvt70k73omffkrv",
        -82.38080687090748,
    ),
    ("certified", "paths:guarding:s3.17", 0.0),
    ("certified", "paths:all:r3.82", 0.0),
    ("certified", "paths:without_guarding_late:s3.2", -1.61644372004418e-06),
    ("certified", "paths:without_lag:s4.135", -0.02327466093300938),
    ("certified", "paths:without_glitches:s2.9", -15.25554911777584),
    ("certified_fading", "paths:energy_transfer:r3.20", 8.470329472543003e-22),
    ("certified", "paths:without_energy_transfer:s3.156", -0.008996496727714038),
    ("tdpa", "paths:plain:s1.20", -0.0016106535864768897),
)


@pytest.mark.parametrize(("law", "name", "margin"), RECORDED)
def test_a_name_means_the_run_that_it_always_meant(law: str, name: str, margin: float) -> None:
    assert replay(law, name)[MARGIN] == margin


@pytest.mark.parametrize(
    ("law", "pair", "seed", "last"),
    [
        ("certified", "late_wall/leading", 1, "c03eisgjvojofpvmj8vajlvsvvdfpdj3vu0pb44ubn94de"),
        ("tdpa", "late_spring/quantised", 2, "c509pnsni0m5ji2hnf00vgmtdrvs98i200vnno5hoo91nf"),
    ],
)
def test_a_search_of_the_laws_goes_the_way_that_it_always_went(
    law: str, pair: str, seed: int, last: str
) -> None:
    rows = Series("laws", law, pair, "search", seed, 26).rows()
    assert rows[-1]["case"] == f"laws:{last}"


@pytest.mark.parametrize(
    ("mistake", "kind", "seed", "margin"),
    [
        ("look_50us", "search", 1, -0.0024371467387639956),
        ("look_50us", "random", 2, -0.0004100663776236222),
    ],
)
def test_a_search_for_a_wrong_number_goes_the_way_that_it_always_went(
    mistake: str, kind: str, seed: int, margin: float
) -> None:
    target = f"phantom_premium_1_5/{mistake}"
    (row,) = Series("sensitivity", "certified", target, kind, seed, 20).rows()
    assert row[MARGIN] == margin
