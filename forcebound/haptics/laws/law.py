"""A bounding law, four pure functions of the constants of a device, and the table of laws.

The functions take and return numbers and the NamedTuples of :mod:`forcebound.haptics.laws.sample`,
and use nothing but arithmetic and :mod:`math`. So the very same function objects run in plain
Python, and compiled in the live node, in audits and in sweeps.
"""

import math
import re
from collections.abc import Callable
from dataclasses import dataclass, replace
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
        limit: ``(state, sample, device) -> (state, largest force in N, added damping in N s/m)``;
            the commanded force is shortened, then the damping force is added.
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
        numbers: The law's own numbers, not negative: fields of DeviceConstants and their values. A
            name like ``energy_tank(refill=20)`` is that of the law with another one.
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
    numbers: tuple[tuple[str, float], ...] = ()

    def device(self, dissipation: Dissipation, axes: int = 1) -> DeviceConstants:
        """Return the constants that the functions of this law take."""
        device = device_constants(dissipation, axes)._replace(**dict(self.numbers))
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


class LawTable(Table[BoundingLaw]):
    """The laws, also with other numbers than their own: ``energy_tank(refill=20)``, in SI units."""

    def __contains__(self, kind: object) -> bool:
        return isinstance(kind, str) and super().__contains__(_split(kind)[0])

    def is_shipped(self, kind: str) -> bool:
        """Return whether the law ships with forcebound, with any numbers."""
        return super().is_shipped(_split(kind)[0]) and kind not in self._added

    @property
    def usual(self) -> list[str]:
        """The laws that a sweep or an audit of all laws has: not those in ``BY_NAME``."""
        return [kind for kind in self if kind not in BY_NAME]

    def _load(self, kind: str) -> BoundingLaw:
        name, written = _split(kind)
        if not written:
            return super()._load(kind)
        law, numbers = self[name], {}
        for one in written[1:-1].split(","):
            key, _, text = (part.strip() for part in one.partition("="))
            try:
                numbers[key] = float(text)
            except ValueError:
                numbers[key] = math.nan
            if key not in dict(law.numbers) or not 0.0 <= numbers[key] < math.inf:
                own = ", ".join(f"{name}={value:g}" for name, value in law.numbers) or "none"
                raise ConfigError(
                    f"law {name}: expected its numbers, at least 0 and in SI units ({own}), "
                    f"got {one.strip()!r}",
                    field="law",
                )
        return replace(law, numbers=tuple((dict(law.numbers) | numbers).items()))


def _split(kind: str) -> tuple[str, str]:
    """Return the name of a law, and its numbers in their brackets, if it has some."""
    match = re.fullmatch(r"(\w+)(\(.*\))", kind)
    return (match[1], match[2]) if match else (kind, "")


#: Laws for a comparison, chosen by name alone: no sweep or audit of all laws has them.
BY_NAME = frozenset({"energy_tank"})

LAWS = LawTable(
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
        "energy_tank": "forcebound.haptics.laws.energy_tank:ENERGY_TANK",
        "certified": "forcebound.haptics.laws.certified:CERTIFIED",
        "certified_fading": "forcebound.haptics.laws.certified:CERTIFIED_FADING",
    },
    PartShape("forcebound.haptics.laws.law:BoundingLaw", is_object=True),
)


def check_law(name: str) -> None:
    """Raise ConfigError if there is no such law."""
    if name not in LAWS:
        raise ConfigError(f"no bounding law {name!r}; known are {', '.join(sorted(LAWS))}")
