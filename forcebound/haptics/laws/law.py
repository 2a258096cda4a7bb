"""A bounding law, four pure functions of the constants of a device, and the table of laws.

The functions take and return numbers and the NamedTuples of :mod:`forcebound.haptics.laws.sample`,
and use nothing but arithmetic and :mod:`math`. So the very same function objects run in plain
Python, and compiled in the live node, in audits and in sweeps.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

from forcebound.errors import ConfigError
from forcebound.haptics.laws.constants import device_constants
from forcebound.haptics.laws.dissipation import Dissipation
from forcebound.haptics.laws.sample import DeviceConstants, Sample, Write
from forcebound.haptics.parts import PartShape, Table

#: What a law remembers from sample to sample: an energy, in J (or a stiffness, in N/m).
State: TypeAlias = float


def zero_energy(device: DeviceConstants) -> State:
    """``start`` of a law whose state is an energy that begins at 0 J."""
    return 0.0


def settle_nothing(state: State, write: Write, device: DeviceConstants) -> State:
    """``settle`` of a law that needs no settling: return ``state``."""
    return state


def state_is_energy(state: State, write: Write, device: DeviceConstants) -> float:
    """``energy`` of a law whose state is its estimate of the energy, in J."""
    return state


@dataclass(frozen=True)
class BoundingLaw:
    """One bounding law; :mod:`forcebound.haptics.laws` says what it promises.

    Attributes:
        summary: One line for lists and legends.
        limit: ``(state, sample, device) -> (state, largest force in N, added damping in N s/m)``.
        start: ``(device) -> state`` at the first reading.
        settle: ``(state, write, device) -> state`` once the force of this sample is written.
        energy: ``(state, write, device) -> J``: the law's estimate of the energy
            after ``settle``.
        limits_holds: The next hold may cost at most the law's ``energy``; the bounder finds the
            largest force for which it does (:mod:`forcebound.haptics.laws.hold_cost`). The state is
            an energy, in J.
        uses_friction: False: the law counts viscous damping alone, f_c = 0.
        is_certified: The bound holds for the physical energy (``docs/theory.md``).
        adds_damping: The law may add a force, and so exceed the commanded one.
        exchanges: A ledger may give energy to another one, or get some; the state is an energy.
    """

    summary: str
    limit: Callable[[State, Sample, DeviceConstants], tuple[State, float, float]]
    start: Callable[[DeviceConstants], State] = zero_energy
    settle: Callable[[State, Write, DeviceConstants], State] = settle_nothing
    energy: Callable[[State, Write, DeviceConstants], float] = state_is_energy
    limits_holds: bool = False
    uses_friction: bool = True
    is_certified: bool = False
    adds_damping: bool = False
    exchanges: bool = False

    def device(self, dissipation: Dissipation, axes: int = 1) -> DeviceConstants:
        """Return the constants that the functions of this law take."""
        device = device_constants(dissipation, axes)
        return device if self.uses_friction else device._replace(friction=0.0)


def observe_energy(state: State, sample: Sample, device: DeviceConstants) -> State:
    r"""Return the energy of the device, in J, as the paper's passivity observer sees it.

    .. math:: E_1(n) = E_1(n-1) + B \Delta x(n)^2 + f_c |\Delta x(n)| + F_d(n-1) \Delta x(n)

    with :math:`B = b / T`.

    Source: Eq. 6 and 11 of the paper.
    """
    capability = device.damping / device.period
    distance = sample.distance
    return state + capability * distance * distance + device.friction * distance + sample.work


LAWS: Table[BoundingLaw] = Table(
    "laws",
    {
        "none": "forcebound.haptics.laws.none:NONE",
        "less_conservative": "forcebound.haptics.laws.less_conservative:LESS_CONSERVATIVE",
        "less_conservative_viscous": (
            "forcebound.haptics.laws.less_conservative:LESS_CONSERVATIVE_VISCOUS"
        ),
        "more_conservative": "forcebound.haptics.laws.more_conservative:MORE_CONSERVATIVE",
        "more_conservative_viscous": (
            "forcebound.haptics.laws.more_conservative:MORE_CONSERVATIVE_VISCOUS"
        ),
        "aol": "forcebound.haptics.laws.aol:AOL",
        "tdpa": "forcebound.haptics.laws.tdpa:TDPA",
        "certified": "forcebound.haptics.laws.certified:CERTIFIED",
        "certified_fading": "forcebound.haptics.laws.certified:CERTIFIED_FADING",
    },
    PartShape("forcebound.haptics.laws.law:BoundingLaw", is_object=True),
)


def check_law(name: str) -> None:
    """Raise ConfigError if there is no such law."""
    if name not in LAWS:
        raise ConfigError(f"no bounding law {name!r}; known are {', '.join(sorted(LAWS))}")
