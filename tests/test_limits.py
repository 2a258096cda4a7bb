"""Theoretical limits on maps."""

import math

import numpy as np
import pytest

from forcebound.graph.loader import load
from forcebound.haptics.controllers.passivity import colgate_schenkel
from forcebound.lab.sweep.limits import diolaiti, encoder, limit_of
from forcebound.run.virtual import run_virtual

B, FRICTION, T, STEP = 0.27, 0.12, 1e-3, 3e-5  # the device of the paper


def test_the_papers_device_may_show_twice_its_damping_over_its_period_or_less() -> None:
    assert colgate_schenkel(B, T, 0.0) == pytest.approx(540.0)
    for resolution, stiffness in ((STEP, 540.0), (0.0, 540.0), (1e-3, 240.0)):
        assert diolaiti(B, FRICTION, T, resolution, 0.0) == pytest.approx(stiffness)
    assert encoder(FRICTION, STEP) == pytest.approx(8000.0)
    assert encoder(FRICTION, 0.0) == math.inf


def passive_damping(stiffness: float, delay: int, points: int = 4096) -> float:
    """The smallest damping for which a wall that is late by some samples is passive, in N s/m.

    Source: Colgate and Schenkel 1997, Eq. 1 of the theorem, on a grid of frequencies.
    """
    angles = math.pi * np.arange(1, points + 1) / points
    real = np.cos(delay * angles) - np.cos((delay + 1) * angles)
    return float(np.max(0.5 * T * stiffness * real / (1.0 - np.cos(angles))))


@pytest.mark.parametrize("samples", [0, 1, 2, 5, 20])
def test_the_delay_limit_follows_from_the_theorem_of_colgate_and_schenkel(samples: int) -> None:
    stiffness = diolaiti(B, FRICTION, T, STEP, samples * T)
    assert passive_damping(stiffness, samples) == pytest.approx(B, rel=1e-4)


def test_a_row_has_the_limit_of_its_delay_its_wall_and_its_hand() -> None:
    row = {
        "device.damping": B,
        "device.friction": FRICTION,
        "device.rate": 1.0 / T,
        "device.resolution": STEP,
        "operator.damping": 2.8,
        "environment.damping": 0.07,
        "loop_delay_ms.p50": 1.5,
    }
    assert limit_of(row, "colgate_schenkel") == pytest.approx(0.2 / 0.002)
    assert limit_of(row, "with_hand") == pytest.approx(3.0 / 0.002)
    assert limit_of(row, "encoder") == pytest.approx(8000.0)
    assert limit_of(row, "abbott_okamura") == pytest.approx(540.0)
    assert limit_of(row, "diolaiti") == pytest.approx(0.27 / 0.002)


@pytest.mark.parametrize("delay_ms", [0, 1, 3])
def test_the_boundary_of_a_released_hand_lies_just_above_the_limit(delay_ms: int) -> None:
    # Every link adds its delay, and the force is written 0.4 ms after the reading.
    limit = colgate_schenkel(B, T, delay=4e-4 + 2e-3 * delay_ms)

    def lowest(factor: float) -> float:
        words = ["law:=none", f"delay:={delay_ms} ms", f"stiffness:={factor * limit}"]
        return float(run_virtual(load("released_hand", words)).summary["true_energy_min_j"])

    assert lowest(0.99) >= -1e-9
    assert lowest(2.5) < -1e-3  # friction stops small motions, so not at once
