"""The bounds of an identification hold, on devices that are drawn from a seed."""

from collections.abc import Sequence

import pytest

from forcebound_proofs.identification_bounds import evaluate, is_reached, judge


@pytest.mark.no_cover  # too many samples
@pytest.mark.parametrize(
    "seeds", [(2,), pytest.param(range(1, 101), marks=pytest.mark.slow)], ids=["one", "many"]
)
def test_bounds_hold_and_are_narrow(seeds: Sequence[int]) -> None:
    document = evaluate([judge(seed) for seed in seeds])
    assert not document["failed"]
    assert is_reached(document), document["numbers"]
