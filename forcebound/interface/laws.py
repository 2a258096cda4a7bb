"""A bounding law alone, on arrays."""

from __future__ import annotations

import math
from dataclasses import fields
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from forcebound.errors import ConfigError
from forcebound.haptics.devices.phantom import PhantomPremium15
from forcebound.haptics.laws import BoundingLaw, Dissipation, ForceBounder
from forcebound.haptics.laws.bounder import shorten
from forcebound.interface.runs import known_law, time_of

FASTEST = 100.0  # m/s; no hand moves so
#: The paper's device, on whose numbers a law relies unless others are given.
_DEVICE = PhantomPremium15()


def bound(
    position: ArrayLike,
    force: ArrayLike,
    law: str | BoundingLaw = "certified",
    *,
    period: float | str = 1e-3,
    **numbers: Any,
) -> NDArray[np.float64]:
    """Return what a law leaves of a force, sample by sample, as the device node applies it.

    The law begins with the first sample, for which it passes on no force.

    Args:
        position: Readings at a steady rate, in m; shape (n,) or (n, axes).
        force: Commanded force at each of them, in N, positive against positive motion; same shape.
        law: Name of the law, or one that was made in Python.
        period: Time between two readings, in s or with its unit.
        numbers: Of the device, in SI units: ``damping`` (N s/m), ``friction`` (N), ``resolution``
            (m), ``saturation`` (N) and the others of
            :class:`forcebound.haptics.laws.Dissipation`; default: the paper's device, with a force
            that is held for one period.

    Returns:
        The applied force, in N; same shape.

    Raises:
        ConfigError: If a shape, the law or a number is wrong.
    """
    readings, forces = (np.asarray(one, dtype=float) for one in (position, force))
    if readings.shape != forces.shape or readings.ndim not in (1, 2) or not readings.size:
        raise ConfigError(
            "position and force need one shape, (n,) or (n, axes); got "
            f"{readings.shape} and {forces.shape}"
        )
    if not (np.isfinite(readings).all() and np.isfinite(forces).all()):
        raise ConfigError("position and force must be finite numbers")
    period = time_of("period", period)
    law = law if isinstance(law, str) else known_law(law)
    if (fastest := np.abs(np.diff(readings, axis=0)).max(initial=0.0) / period) > FASTEST:
        raise ConfigError(
            f"position moves at up to {fastest:.3g} m/s: is it in m, and period in s?"
        )
    own = ("damping", "friction", "resolution", "saturation")
    stated = {name: getattr(_DEVICE, name) for name in own} | {"hold_limit": period}
    try:
        relied_on = Dissipation(**{**stated, "period": period, **numbers})
    except TypeError as error:
        names = ", ".join(field.name for field in fields(Dissipation))
        raise ConfigError(f"numbers, in SI units, are {names}; got {error}") from None
    vectors = readings.reshape(len(readings), -1)
    bounder = ForceBounder(law, relied_on, vectors.shape[1])
    applied = np.zeros_like(vectors)
    bounder.start(0, tuple(vectors[0]))
    pairs = zip(vectors[1:], forces.reshape(vectors.shape)[1:], strict=True)
    for n, (reading, commanded) in enumerate(pairs, 1):
        bounded = bounder.bound(round(n * period * 1e9), tuple(reading), tuple(commanded))
        shortened = shorten(bounded, math.hypot(*bounded), relied_on.saturation)  # as the device
        bounder.settle(shortened)
        applied[n] = shortened
    return applied.reshape(forces.shape)
