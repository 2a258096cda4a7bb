"""Cases of attacks: names, codes, and the search for the lowest objective."""

import math

import numpy as np
import pytest

from forcebound.errors import ConfigError
from forcebound_proofs.cases import NOISES, Range, decode, encode, search, seed_of
from forcebound_proofs.views import least, share, verdict


def test_a_code_names_the_numbers_of_a_case_and_a_name_is_a_seed_or_a_code() -> None:
    ranges = {"a": Range(1.0, 2.0), "b": Range(1e-3, 1.0, is_logarithmic=True, zero_share=0.1)}
    for point, numbers in (([0.0, 0.0], (1.0, 0.0)), ([1.0, 1.0], (2.0, 1.0))):
        choices, found = decode(encode((3,), point), (4,), ranges)
        assert choices == [3]
        assert tuple(found.values()) == pytest.approx(numbers)
    for wrong in ("", "x1", "c0", "c" + "w" * 5, "c40000"):
        with pytest.raises(ConfigError):
            decode(wrong, (4,), ranges)
    assert (seed_of("12"), seed_of("c12")) == (12, None)
    with pytest.raises(ConfigError):
        seed_of("9" * 30)


def test_the_search_goes_to_the_lowest_objective() -> None:
    ranges = {name: Range(0.0, 1.0) for name in "xyz"}

    def distance(code: str) -> tuple[float, float]:
        far = math.dist(decode(code, (NOISES,), ranges)[1].values(), (0.2, 0.7, 0.5))
        return far, far

    found = list(search(distance, (), 3, 200, np.random.default_rng(1)))
    assert len(found) == 200
    assert min(found) < 0.05 < min(found[:12])


def test_rows_have_a_least_a_share_and_a_verdict() -> None:
    rows = [{"square": x * x, "is_even": x % 2 == 0} for x in range(5)]
    assert least(rows, "square") is rows[0]
    assert share(rows, "is_even") == 0.6
    assert verdict(-1e-6) == "BROKEN"
    assert verdict(-1e-12) == "passive"
    assert verdict(-1.0, is_certified=False) == "leaks"
