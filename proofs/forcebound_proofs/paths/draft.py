"""A device while it is drawn: the truth, and the fields that state it."""

import math
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import numpy as np

from forcebound.compiled import record_type
from forcebound.lab.cases import by_logarithm
from forcebound_proofs.paths.truth import COPIES, Device

Random: TypeAlias = np.random.Generator


def log_between(random: Random, low: float, high: float) -> float:
    """Draw a number, every factor equally likely."""
    return by_logarithm(low, high, random.random())


@dataclass
class Draft:
    """A device while it is drawn: the truth, and the fields that state it."""

    random: Random
    axes: int
    fields: dict[str, Any]  # of Dissipation
    case: dict[str, Any] = field(default_factory=dict)  # further fields of AttackedDevice
    devices: Any = None  # of ``truth``: the device and its copies

    def __post_init__(self) -> None:
        """Give the device what the fields state, alike on each axis, and nothing else."""
        self.devices = np.zeros(1 + COPIES, record_type(Device))
        device, axes = self.device, self.axes
        device.gain[:], device.fastest, device.seen = 1.0, math.inf, math.inf
        device.axes, device.is_along_path = axes, axes > 1
        device.damping[:axes], device.friction[:axes] = (
            self.fields[name] for name in ("damping", "friction")
        )
        device.error[:axes] = self.fields["resolution"] / 2.0

    @property
    def device(self) -> Any:
        """The truth, a record."""
        return self.devices[0]

    def per_axis(self, name: str) -> tuple[float, ...]:
        """Return a number for each axis, also where one was stated for all."""
        value = self.fields[name]
        return value if isinstance(value, tuple) else (value,) * self.axes


def plain(random: Random, axes: int) -> Draft:
    """Draw a device without imperfections."""
    period = float(random.choice([1e-3, 1e-3, 2.5e-4]))
    ratio = float(random.choice([1.0, 1.02, 1.25, 2.5]))
    fields: dict[str, Any] = {
        "damping": log_between(random, 0.02, 2.0),
        "friction": log_between(random, 0.003, 1.0),
        "resolution": 0.0 if random.random() < 0.1 else log_between(random, 1e-6, 2e-4),
        "period": period,
        "hold_limit": round(period * ratio * 1e9) / 1e9,
        "saturation": log_between(random, 1.0, 30.0),
    }
    draft = Draft(random, axes, fields)
    if axes > 1 and random.random() < 0.3:  # the isotropic law allows this, too
        draft.device.is_along_path = False
    return draft
