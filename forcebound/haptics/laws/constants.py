"""Numbers that laws and the bounder derive from the description of a device."""

import math

from forcebound.errors import ConfigError
from forcebound.haptics.laws.dissipation import Dissipation, per_axis
from forcebound.haptics.laws.hold_cost import rigid_cost
from forcebound.haptics.laws.sample import AxisConstants, DeviceConstants


def device_constants(dissipation: Dissipation, axes: int) -> DeviceConstants:
    """Return what laws take of a device with so many axes; ConfigError if it has others."""
    along_path = acts_along_path(dissipation, axes)
    return DeviceConstants(
        damping=dissipation.least_damping,
        friction=dissipation.least_friction,
        half_resolution=dissipation.coarsest_resolution / 2.0,
        period=dissipation.period,
        hold_limit=dissipation.hold_limit,
        axes=float(axes),
        path_friction=dissipation.least_friction if along_path else 0.0,
        start_price=_start_price(dissipation, axes) + _guard_price(dissipation, axes),
        energy_cap=energy_cap(dissipation, axes, dissipation.hold_limit),
        hand_speed=dissipation.hand_speed,
    )


def axis_constants(dissipation: Dissipation, axes: int) -> list[AxisConstants]:
    """Return what is known of each axis."""
    d, along_path = dissipation, acts_along_path(dissipation, axes)
    numbers = (
        per_axis("damping", d.damping, axes),
        per_axis("friction", d.friction, axes),
        per_axis("resolution", d.resolution, axes),
        per_axis("presliding", d.presliding, axes),
        per_axis("weight", d.weight, axes),
        per_axis("weight_error", d.weight_error, axes),
    )
    constants = []
    for b, f, resolution, z, weight, error in zip(*numbers, strict=True):
        # The motor carries the weight, so its gain error is an error of the weight too.
        error += d.gain_error * abs(weight)
        r = resolution / 2.0
        friction = 0.0 if along_path else f
        if error > f or (along_path and error * math.sqrt(axes) > f):
            raise ConfigError(
                f"the friction, {f} N, must hold the error of the weight, {error} N: "
                "else the device drifts off by itself, and no law can promise anything"
            )
        constants.append(AxisConstants(b, friction, r, r + z, 2.0 * z, error, weight))
    return constants


def acts_along_path(dissipation: Dissipation, axes: int) -> bool:
    """Return whether friction acts along the path of several axes, not on each by itself."""
    d = dissipation
    if axes > 1 and d.attenuates != "never" and not isinstance(d.friction, tuple):
        raise ConfigError(
            f"attenuates: {d.attenuates} on several axes needs the friction of each axis: "
            "one number means friction along the path",
            field="attenuates",
        )
    if axes == 1 or any(isinstance(one, tuple) for one in (d.damping, d.friction, d.weight_error)):
        return False
    if d.friction != 0.0 and any(per_axis("presliding", d.presliding, axes)):
        raise ConfigError(
            "presliding of several axes needs the friction of each axis: "
            "one number means friction along the path"
        )
    return True


def energy_cap(dissipation: Dissipation, axes: int, hold_limit: float) -> float:
    """Return the most energy, in J, that the ledger keeps beyond its price for the held force.

    By default what the costliest hold of the saturation needs, of at most ``hold_limit`` s: more is
    of no use at that instant.
    """
    if dissipation.energy_cap is not None:
        return dissipation.energy_cap
    error = max(one.weight_error for one in axis_constants(dissipation, axes))
    force = (1.0 + dissipation.gain_error) * dissipation.saturation + math.sqrt(axes) * error
    is_rigid = not any(per_axis("presliding", dissipation.presliding, axes)) and (
        axes == 1 or acts_along_path(dissipation, axes)
    )
    friction = dissipation.least_friction if is_rigid else 0.0
    around = dissipation.lag + dissipation.write_delay
    if dissipation.watchdog != "none":
        hold_limit *= 1.0 + dissipation.watchdog_tolerance
    cap = rigid_cost(force, friction, dissipation.least_damping, hold_limit + around)
    if dissipation.watchdog == "none":
        duration = dissipation.watchdog_limit + around
        late = rigid_cost(force, friction, dissipation.least_damping, duration)
        cap = max(cap, late - dissipation.allowance)
    return cap


def _guard_price(dissipation: Dissipation, axes: int) -> float:
    """J by which a force that is late, and guarded, can give more than a punctual one."""
    if dissipation.watchdog != "guarding":
        return 0.0
    duration = dissipation.period - dissipation.guard_period
    return sum(
        4.0 * one.damping * one.half_play**2 / duration for one in axis_constants(dissipation, axes)
    )


def _start_price(dissipation: Dissipation, axes: int) -> float:
    """J that friction may have been credited, or may give back, before a displacement is sure."""
    if acts_along_path(dissipation, axes):
        half = [one / 2.0 for one in per_axis("resolution", dissipation.resolution, axes)]
        return dissipation.least_friction * math.hypot(*half)
    frictions = per_axis("friction", dissipation.friction, axes)
    return sum(
        f * (one.half_resolution + 0.75 * one.presliding) + one.presliding * one.weight_error
        for f, one in zip(frictions, axis_constants(dissipation, axes), strict=True)
    )
