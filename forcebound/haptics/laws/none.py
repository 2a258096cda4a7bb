"""No bound, for comparison (paper, Fig. 7).

The force passes within the saturation. The state is the energy observer of the paper's Eq. 6, so
that a recording shows the energy that a law would have observed.
"""

import math

from forcebound.haptics.laws.law import BoundingLaw, State, observe_energy
from forcebound.haptics.laws.sample import DeviceConstants, Sample


def limit(state: State, sample: Sample, device: DeviceConstants) -> tuple[State, float, float]:
    """Observe the energy (:func:`observe_energy`), limit nothing."""
    return observe_energy(state, sample, device), math.inf, 0.0


NONE = BoundingLaw(
    summary="no bound but the saturation",
    limit=limit,
)
