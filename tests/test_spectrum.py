"""Spectra against sines, held springs and low-passes; perception against its sources."""

import math
from random import Random

import numpy as np
import pytest

from forcebound.graph.loader import load
from forcebound.lab.runs import run_all
from forcebound.results.perception import differences, vibration_threshold
from forcebound.results.spectrum import (
    Impedance,
    bands,
    displayed_impedance,
    transparency_bandwidth,
    vibration,
)
from forcebound.results.surface import Floats

RATE = 1000.0
PERIOD = 1.0 / RATE
TIME = np.arange(20_000, dtype=np.float64) * PERIOD


def wandering() -> Floats:
    """Return a position that moves at all frequencies, by about a millimetre."""
    random = Random(5)
    steps = np.array([random.gauss(0.0, 1e-4) for _ in range(TIME.size)])
    position = np.cumsum(steps)
    return np.asarray(position - position.mean(), dtype=np.float64)


def test_bands_are_thirds_of_octaves_below_half_the_rate() -> None:
    centres = bands(20.0, 500.0, 1000.0)
    assert centres[0] == pytest.approx(20.0, rel=0.01)
    assert centres[-1] == pytest.approx(400.0, rel=0.01)  # the band of 500 Hz ends at 561 Hz
    assert bands(20.0, 500.0, 4000.0)[-1] == pytest.approx(500.0, rel=0.01)


@pytest.mark.parametrize("frequency", [25.0, 100.0, 250.0])
def test_a_sine_is_in_its_band_with_its_effective_value(frequency: float) -> None:
    found = vibration(0.3 * np.sin(2.0 * math.pi * frequency * TIME), RATE, mass=0.1)
    assert found is not None
    strongest = int(np.argmax(found.force))
    assert found.frequency[strongest] == pytest.approx(frequency, rel=0.03)
    assert found.force[strongest] == pytest.approx(0.3 / math.sqrt(2.0), rel=0.02)


def test_the_vibration_is_held_against_the_motion_of_the_mass() -> None:
    frequency = 100.0
    just_felt = (
        0.1 * (2.0 * math.pi * frequency) ** 2 * float(vibration_threshold(np.array(frequency)))
    )
    found = vibration(just_felt * np.sin(2.0 * math.pi * frequency * TIME), RATE, mass=0.1)
    assert found is not None
    assert float(found.above_threshold.max()) == pytest.approx(0.0, abs=0.2)
    without_mass = vibration(TIME, RATE, mass=None)
    assert without_mass is not None
    assert np.isnan(without_mass.above_threshold).all()


def test_less_than_half_a_second_has_no_vibration() -> None:
    assert vibration(TIME[:499], RATE, 0.1) is None
    assert vibration(TIME[:0], math.nan, 0.1) is None


def test_the_threshold_is_that_of_verrillo() -> None:
    assert float(vibration_threshold(np.array(250.0))) == pytest.approx(1e-7)
    assert float(vibration_threshold(np.array(125.0))) == pytest.approx(4e-7, rel=0.01)
    assert float(vibration_threshold(np.array(500.0))) == pytest.approx(2.8e-7, rel=0.01)
    assert float(vibration_threshold(np.array(20.0))) == float(vibration_threshold(np.array(40.0)))


@pytest.mark.parametrize("delay", [0, 1, 2])
def test_a_held_spring_has_the_damping_of_its_delay(delay: int) -> None:
    position = wandering()
    force = 2000.0 * np.roll(position, delay)
    shown = displayed_impedance(force, position, RATE)
    assert shown is not None
    slow = (shown.frequency > 3.0) & (shown.frequency < 30.0)
    # Colgate and Schenkel: a hold and d samples of delay act like -K T (1/2 + d) of damping.
    expected = -2000.0 * PERIOD * (0.5 + delay)
    assert shown.damping[slow] == pytest.approx(np.full(slow.sum(), expected), rel=0.1)
    turned = np.cos(2.0 * math.pi * shown.frequency[slow] * PERIOD * (0.5 + delay))
    assert shown.stiffness[slow] == pytest.approx(2000.0 * turned, rel=0.05)


def test_what_is_not_moved_has_no_impedance() -> None:
    still = np.zeros(TIME.size)
    assert displayed_impedance(still, still, RATE) is None
    assert displayed_impedance(wandering()[:3999], wandering()[:3999], RATE) is None


def test_a_force_that_does_not_follow_the_hand_has_no_impedance() -> None:
    random = Random(6)
    noise = np.array([random.gauss(0.0, 1.0) for _ in range(TIME.size)])
    shown = displayed_impedance(noise, wandering(), RATE)
    assert shown is None or shown.frequency.size < 3


@pytest.mark.parametrize("corner", [5.0, 40.0])
def test_the_bandwidth_of_a_low_pass_is_its_corner(corner: float) -> None:
    frequency = bands(1.0, 500.0, RATE)
    shown = np.asarray(2000.0 / (1.0 + 1j * frequency / corner), dtype=np.complex128)
    omega = 2.0 * math.pi * frequency
    bandwidth = transparency_bandwidth(Impedance(frequency, shown.real, shown.imag / omega), 2000.0)
    assert corner / 10**0.1 <= bandwidth <= corner * 1.001


def test_a_late_wall_loses_its_bandwidth_to_the_phase() -> None:
    frequency = bands(1.0, 500.0, RATE)
    omega = 2.0 * math.pi * frequency
    shown = 2000.0 * np.exp(-1j * omega * 0.010)  # 10 ms: 45 degrees at 12.5 Hz
    late = Impedance(frequency, shown.real, shown.imag / omega)
    assert 12.5 / 10**0.1 <= transparency_bandwidth(late, 2000.0) <= 12.5


def test_a_wall_that_is_too_soft_from_the_start_has_no_bandwidth() -> None:
    frequency = bands(1.0, 500.0, RATE)
    soft = Impedance(frequency, np.full(frequency.size, 500.0), np.zeros(frequency.size))
    assert transparency_bandwidth(soft, 2000.0) == 0.0


@pytest.mark.parametrize(("stiffness", "is_felt"), [(1240.0, True), (1220.0, False), (760.0, True)])
def test_a_difference_of_a_weber_fraction_is_felt(stiffness: float, is_felt: bool) -> None:
    before = {"displayed_stiffness_n_per_m": 1000.0, "peak_force_n": None}
    after = {"displayed_stiffness_n_per_m": stiffness, "peak_force_n": 3.0}
    (found,) = differences(before, after)
    assert found.figure == "displayed_stiffness_n_per_m"
    assert found.is_perceptible is is_felt
    assert differences(before, {**after, "at_rest": False})[0].is_perceptible is None
    assert found.difference == pytest.approx(stiffness / 1000.0 - 1.0)


def test_a_shaken_wall_shows_the_damping_of_its_hold_and_its_reply_wait() -> None:
    (ran,) = run_all([load("impedance", ["law:=none"])])
    assert ran.result is not None
    summary = ran.result.summary
    shown = {key: np.array(values) for key, values in summary["displayed_impedance"].items()}
    slow = shown["frequency_hz"] < 50.0
    # 1 N/mm, held for 1 ms and written 0.4 ms after the reading.
    assert np.median(shown["damping_n_s_per_m"][slow]) == pytest.approx(-0.9, rel=0.05)
    assert np.median(shown["stiffness_n_per_m"][slow]) == pytest.approx(1000.0, rel=0.02)
    assert summary["transparency_bandwidth_hz"] > 50.0
