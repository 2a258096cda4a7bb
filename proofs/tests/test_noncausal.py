"""The non-causal originals of the paper's laws beside the causal laws."""

import math
from collections.abc import Callable

import pytest
from bounding_traces import EXACT, B, forces, run, steady

from forcebound_proofs.paper.noncausal import (
    less_conservative_noncausal,
    more_conservative_noncausal,
)


@pytest.mark.parametrize(
    ("law", "original"),
    [
        ("less_conservative", less_conservative_noncausal),
        ("more_conservative", more_conservative_noncausal),
    ],
)
class TestNonCausalOriginal:
    def test_a_steady_press_differs_little_from_the_causal_law(
        self, law: str, original: Callable[..., list[float]]
    ) -> None:
        depths = [2e-3 * (1 - math.exp(-i / 40)) for i in range(400)]
        asked = [10_000.0 * x for x in depths]
        causal = forces(run(law, EXACT, steady(depths[1:], asked[1:])))
        offline = original(depths, asked, EXACT)
        assert len(offline) == 400
        assert offline[1:] == pytest.approx(causal, rel=0.02, abs=0.05)

    def test_even_motion_is_the_same_but_for_the_ends(
        self, law: str, original: Callable[..., list[float]]
    ) -> None:
        depths = [i * 1e-5 for i in range(50)]
        causal = forces(run(law, EXACT, steady(depths[1:], [0.0] + [8.5] * 48)))
        offline = original(depths, [0.0, 0.0] + [8.5] * 48, EXACT)
        assert offline[2:-1] == pytest.approx(causal[1:-1], rel=1e-12)
        assert offline[-1] < causal[-1]  # it knows that the trace ends

    def test_the_force_is_saturated_and_zero_stays_zero(
        self, law: str, original: Callable[..., list[float]]
    ) -> None:
        depths = [i * 1e-2 for i in range(5)]
        assert original(depths, [1e6] * 5, EXACT)[2] == 8.5
        assert original(depths, [0.0] * 5, EXACT) == [0.0] * 5


def test_the_original_knows_a_move_before_it_happens() -> None:
    assert less_conservative_noncausal([0.0, 1e-3], [8.0, 8.0], EXACT)[0] == pytest.approx(
        math.sqrt(4 * B * 0.12e-3)
    )
    assert more_conservative_noncausal([0.0, 1e-3], [8.0, 8.0], EXACT)[0] == pytest.approx(
        math.sqrt(4 * B * 0.12e-3)
    )
