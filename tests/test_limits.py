"""Theoretical limits on maps."""

import math

import numpy as np
import pytest

from forcebound.graph.loader import load
from forcebound.haptics.controllers.passivity import colgate_schenkel
from forcebound.lab.sweep.limits import diolaiti, encoder, gil, limit_of
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
        "device.axes": 1,
        "device.mass": 0.075,
        "device.damping": B,
        "device.friction": FRICTION,
        "device.rate": 1.0 / T,
        "device.resolution": STEP,
        "operator.damping": 2.8,
        "operator.mass": 0.275,
        "environment.kind": "damped_wall",
        "environment.stiffness": 1e3,
        "environment.damping": 0.07,
        "loop_delay_ms.p50": 0.5,
    }
    assert limit_of(row, "colgate_schenkel") == pytest.approx(0.2 / 0.001)
    assert limit_of(row, "with_hand") == pytest.approx(3.0 / 0.001)
    assert limit_of(row, "gil") == pytest.approx(3.14 / 0.001)
    assert limit_of(row, "encoder") == pytest.approx(8000.0)
    undamped = {**row, "environment.damping": 0.0}
    assert limit_of(undamped, "abbott_okamura") == pytest.approx(540.0)
    assert limit_of(undamped, "diolaiti") == pytest.approx(0.27 / 0.001)
    axes = {**row, "device.axes": 3, "device.damping": "[0.3, 0.1, 0.1]"}
    assert limit_of(axes, "colgate_schenkel") == pytest.approx(0.23 / 0.001)


@pytest.mark.parametrize(
    ("other", "name"),
    [
        ({"environment.kind": "membrane"}, "colgate_schenkel"),
        ({"over.stiffness": 2e3}, "colgate_schenkel"),  # it is the stiffness of something else
        ({"environment.damping": 0.07}, "diolaiti"),
        ({"environment.damping": 0.07}, "abbott_okamura"),
        ({"loop_delay_ms.p50": 1.5}, "abbott_okamura"),
        ({"operator.damping": 30.0}, "gil"),
    ],
)
def test_a_limit_is_no_number_where_its_conditions_do_not_hold(
    other: dict[str, object], name: str
) -> None:
    row: dict[str, object] = {
        "device.axes": 1,
        "device.mass": 0.075,
        "device.damping": B,
        "device.friction": FRICTION,
        "device.rate": 1.0 / T,
        "device.resolution": STEP,
        "operator.damping": 1.0,
        "environment.kind": "wall",
        "environment.stiffness": 1e3,
        "loop_delay_ms.p50": 0.4,
    }
    assert math.isfinite(limit_of(row, name))
    assert math.isnan(limit_of({**row, **other}, name))


def rests(stiffness: float, damping: float, samples: int, mass: float) -> bool:
    """Whether a mass with damping B comes to rest at a wall, late by some samples: by its poles.

    The wall has the stiffness and, by a backward difference, the damping given.
    """
    decay = math.exp(-B * T / mass)
    still = (1.0 - decay) * mass / B
    size = 3 + samples  # place, speed, place before, and the forces on their way
    step = np.zeros((size, size))
    step[0, :2], step[1, 1], step[2, 0] = (1.0, still), decay, 1.0
    wall = np.zeros(size)
    wall[0], wall[2] = -stiffness - damping / T, damping / T
    reached = wall if samples == 0 else np.eye(size)[-1]
    step[0] += (T - still) / B * reached
    step[1] += (1.0 - decay) / B * reached
    if samples:
        step[3] = wall
        step[4:, 3:-1] = np.eye(samples - 1)
    return bool(np.abs(np.linalg.eigvals(step)).max() < 1.0)


@pytest.mark.parametrize(("mass", "samples"), [(0.075, 0), (0.075, 2), (0.3, 1), (0.3, 5)])
@pytest.mark.parametrize("share", [0.0, 0.5, 0.95])  # of the most damping for which it holds
def test_the_limit_of_rest_follows_from_the_poles_of_the_loop(
    mass: float, samples: int, share: float
) -> None:
    most = 0.1 * mass / (T + samples * T) - B
    limit = gil(B, T, share * most, samples * T, mass)
    assert rests(0.9 * limit, share * most, samples, mass)
    assert not rests(1.04 * limit, share * most, samples, mass)
    assert math.isnan(gil(B, T, 1.1 * most, samples * T, mass))


@pytest.mark.parametrize("delay_ms", [0, 1, 3])
def test_the_boundary_of_a_released_hand_lies_just_above_the_limit(delay_ms: int) -> None:
    # Every link adds its delay, and the force is written 0.4 ms after the reading.
    limit = colgate_schenkel(B, T, delay=4e-4 + 2e-3 * delay_ms)

    def lowest(factor: float) -> float:
        words = ["law:=none", f"delay:={delay_ms} ms", f"stiffness:={factor * limit}"]
        return float(run_virtual(load("released_hand", words)).summary["true_energy_min_j"])

    assert lowest(0.99) >= -1e-9
    assert lowest(2.5) < -1e-3  # friction stops small motions, so not at once
