"""Stalls of the machine during an identification: what they spoil is done again.

A force that is held for longer than was meant throws an axis. Then there is no force, the device
comes to rest, somebody brings it back if it is far away, and the movement begins anew.
"""

import math
import os
from collections.abc import Callable
from contextlib import suppress
from typing import TypeVar

from forcebound.errors import DeviceError
from forcebound.identification.rig import Floats, Limits, Rig, StallError, come_to_rest
from forcebound.messages.packets import Vector

TRIES = 50  # of a movement

Result = TypeVar("Result")


def repeated(rig: Rig, movement: Callable[[], Result], go_back: Callable[[], object]) -> Result:
    """Return what a movement gives; after a stall, go back and move again.

    Raises:
        DeviceError: If the machine is late each time, or the device fails.
    """
    with suppress(StallError):
        return movement()
    for _ in range(TRIES):
        rig.repetitions += 1
        try:
            go_back()
            return movement()
        except StallError as stall:
            last = str(stall)
    raise DeviceError(
        f"a movement was tried {TRIES} times, and the last time {last}. {lateness(rig)}: end other"
        " programs, and see `forcebound doctor`"
    )


def recover(rig: Rig) -> Vector:
    """Let the device come to rest without force, and be brought back if need be; return where.

    Raises:
        DeviceError: If nobody brings it back.
    """
    limits, rig.limits = rig.limits, Limits(0.0, math.inf, math.inf)
    try:
        found = come_to_rest(rig, limits.reach)
        if _distance(found, rig.start) > limits.reach:
            rig.bring_back()
            found = come_to_rest(rig, limits.reach)
            rig.engage()
    finally:
        rig.limits = limits
    if min(_distance(found, rig.start), _distance(found, rig.first)) > limits.reach:
        raise DeviceError(
            f"a late tick has thrown the device far away, and nobody has brought it back."
            f" {lateness(rig)}: end other programs, and see `forcebound doctor`"
        )
    return tuple(found.tolist())


def lateness(rig: Rig) -> str:
    """Return how late this machine was, and its load, in words."""
    return (
        f"This machine was late by up to {1e3 * rig.longest_wait:.0f} ms while a force was on; its"
        f" load is {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores"
    )


def _distance(one: Floats, other: Vector) -> float:
    return float(max(abs(a - b) for a, b in zip(one, other, strict=True)))
