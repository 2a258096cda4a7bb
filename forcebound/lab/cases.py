"""Cases of campaigns: grids of values."""

from collections.abc import Sequence
from itertools import product
from typing import Any


def by_logarithm(low: float, high: float, share: float) -> float:
    """Return the number at this share, 0 to 1, of a range whose logarithm is even."""
    return float(low * (high / low) ** share)


def grid(**values: Sequence[Any]) -> list[dict[str, Any]]:
    """Return each combination of the values; the last parameter varies fastest.

    ::

        grid(law=["none", "tdpa"], delay=[0.0, 2e-3])[1]  # {"law": "none", "delay": 0.002}
    """
    return [dict(zip(values, one, strict=True)) for one in product(*values.values())]
