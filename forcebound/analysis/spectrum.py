"""Spectra of a run: vibration of the force, displayed impedance, transparency bandwidth.

Power spectra are means over half-overlapping Hann windows (Welch, The use of fast Fourier transform
for the estimation of power spectra, IEEE Transactions on Audio and Electroacoustics 15(2), 1967),
summed over third-octave bands (IEC 61260).
"""

from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from forcebound.analysis.perception import vibration_threshold
from forcebound.analysis.surface import Floats

SEGMENT = 0.5  # s of a window: lines 2 Hz apart
LONG_SEGMENT = 2.0  # s, for impedances, whose bands begin at 1 Hz
LEAST_SEGMENTS = 3  # for impedances: of a single window, the coherence is always 1
VIBRATION = (20.0, 500.0)  # Hz, range of the Pacinian corpuscles
IMPEDANCE = (1.0, 500.0)  # Hz
COHERENCE = 0.9  # least of a band whose impedance counts
EXCITATION = 1e-6  # m, RMS, least motion of a band whose impedance counts
TRANSPARENT = 10.0 ** (3.0 / 20.0)  # 3 dB, either way
IN_PHASE = np.pi / 4.0  # 45 degrees: where a first-order low-pass has lost 3 dB


def bands(low: float, high: float, rate: float) -> Floats:
    """Return the centres of the third-octave bands from ``low`` to ``high``, in Hz.

    Bands that reach beyond half of the sampling ``rate``, in Hz, are left out.
    """
    numbers = np.arange(round(10.0 * np.log10(low)), round(10.0 * np.log10(high)) + 1)
    centres = 10.0 ** (numbers / 10.0)
    return np.asarray(centres[centres * 10.0**0.05 <= rate / 2.0])


@dataclass(frozen=True)
class Vibration:
    """Vibration of a force in steady contact."""

    frequency: Floats  # Hz, centres of third-octave bands
    force: Floats  # N, RMS in each band
    above_threshold: Floats  # dB, of the motion of the handle, in each band; NaN without its mass


def vibration(error: Floats, rate: float, mass: float | None) -> Vibration | None:
    """Return the spectrum of a force error from 20 to 500 Hz against the vibration threshold.

    The error, in N, without gaps, moves the device's mass, in kg: a band of ``F`` N moves the
    handle by ``F / (m w^2)``, at most; a hand adds mass to it. None for less than 0.5 s.
    """
    spectra = _cross_spectra(error, error, rate, SEGMENT)
    centres = bands(*VIBRATION, rate)
    if spectra is None or not centres.size:
        return None
    frequency, power, _, _ = spectra
    force = np.sqrt([np.real(power[_inside(frequency, centre)]).sum() for centre in centres])
    threshold = vibration_threshold(centres) * (2.0 * np.pi * centres) ** 2 / np.sqrt(2.0)
    reached = force / (np.nan if mass is None else mass * threshold)
    return Vibration(centres, force, 20.0 * np.log10(np.maximum(reached, 1e-6)))


@dataclass(frozen=True)
class Impedance:
    r"""Impedance that the motor displays: :math:`Z = k / j \omega + b`, by band.

    The device's own mass, damping and friction come on top of it.
    """

    frequency: Floats  # Hz, centres of the bands in which the hand moves enough
    stiffness: Floats  # N/m, effective: real part of force over position
    damping: Floats  # N s/m, effective: imaginary part of it over the angular frequency


def displayed_impedance(force: Floats, position: Floats, rate: float) -> Impedance | None:
    r"""Return the impedance that the motor displays to a hand that moves in contact.

    .. math:: k + j \omega b = \frac{S_{xF}(\omega)}{S_{xx}(\omega)}
              \frac{1 - e^{-j \omega T}}{j \omega T}

    The last factor is the hold of the force from sample to sample. A punctual wall of stiffness K
    so has an effective damping of -K T / 2, which is what Colgate and Schenkel's limit is about.

    A run must move the hand at many frequencies while it stays in contact: launch file
    ``impedance``. Bands with less than 1 um RMS of motion or a coherence below 0.9 are left out.

    Applied force, in N, and position along the same axis, in m, have no gaps and are in contact.
    None if no band is excited, or for less than 4 s.

    Source: effective impedances as in Mehling, Colgate and Peshkin, Increasing the impedance range
    of a haptic display by adding electrical damping, World Haptics 2005, and Colonnese and Okamura,
    Rendered and characterized closed-loop accuracy of impedance-type haptic displays, IEEE
    Transactions on Haptics 8(4), 2015.
    """
    spectra = _cross_spectra(position, force, rate, LONG_SEGMENT, LEAST_SEGMENTS)
    if spectra is None:
        return None
    frequency, moves, forces, cross = spectra
    found = []
    for centre in bands(*IMPEDANCE, rate):
        inside = _inside(frequency, centre)
        motion, effort, both = moves[inside].sum(), forces[inside].sum(), cross[inside].sum()
        if motion < EXCITATION**2 or abs(both) ** 2 < COHERENCE * motion * effort:
            continue
        omega = 2.0 * np.pi * centre
        hold = (1.0 - np.exp(-1j * omega / rate)) / (1j * omega / rate)
        displayed = both / motion * hold
        found.append((centre, displayed.real, displayed.imag / omega))
    return Impedance(*np.array(found).T) if found else None


def transparency_bandwidth(impedance: Impedance, stiffness: float) -> float:
    """Return the frequency up to which an elastic wall is displayed to 3 dB and 45 degrees, in Hz.

    It is the last band up to which no band differs by more from the stiffness of the wall, in N/m;
    0 if the lowest does. The highest excited band is the most that a run can show.

    Source: bandwidth of the ratio of displayed and wanted impedance, as Lawrence, Stability and
    transparency in bilateral teleoperation, IEEE Transactions on Robotics and Automation 9(5),
    1993. A first-order low-pass reaches both limits at its corner; a mere delay only the second.
    """
    omega = 2.0 * np.pi * impedance.frequency
    ratio = (impedance.stiffness + 1j * omega * impedance.damping) / stiffness
    size = np.abs(ratio)
    differs = (size > TRANSPARENT) | (size < 1.0 / TRANSPARENT) | (abs(np.angle(ratio)) > IN_PHASE)
    outside = np.flatnonzero(differs)
    last = (int(outside[0]) if outside.size else ratio.size) - 1
    return float(impedance.frequency[last]) if last >= 0 else 0.0


def _inside(frequency: Floats, centre: float) -> NDArray[np.bool_]:
    edge = 10.0**0.05
    return np.asarray((frequency >= centre / edge) & (frequency < centre * edge))


def _cross_spectra(
    first: Floats, second: Floats, rate: float, segment: float, least: int = 1
) -> tuple[Floats, Floats, Floats, NDArray[np.complex128]] | None:
    """Return frequencies and the power in each line: of both signals, and of their product."""
    if not first.size:  # and the rate may be unknown
        return None
    length = round(segment * rate)
    if first.size < (least + 1) * length // 2 or first.size < length or length < 2:
        return None
    window = np.hanning(length + 1)[:-1]
    scale = 2.0 / (window.sum() ** 2 * 1.5)  # 1.5: bandwidth of the window, in lines

    def transform(signal: Floats) -> NDArray[np.complex128]:
        parts = sliding_window_view(signal, length)[:: length // 2]
        return np.fft.rfft((parts - parts.mean(axis=1, keepdims=True)) * window)

    x, y = transform(first), transform(second)
    frequency = np.asarray(np.fft.rfftfreq(length, 1.0 / rate), dtype=np.float64)
    return (
        frequency,
        np.asarray(scale * np.mean(np.abs(x) ** 2, axis=0), dtype=np.float64),
        np.asarray(scale * np.mean(np.abs(y) ** 2, axis=0), dtype=np.float64),
        np.asarray(scale * np.mean(np.conj(x) * y, axis=0), dtype=np.complex128),
    )
