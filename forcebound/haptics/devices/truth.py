"""The ground truth of a simulated device."""

from typing import NamedTuple

from forcebound.messages.packets import Vector


class Truth(NamedTuple):
    """What a simulated device knows and no law may see."""

    position: Vector  # m, not quantised
    velocity: Vector  # m/s
    hand_force: Vector  # N, of spring and damper of the hand, positive into the environment
    energy: float  # J, that has flowed from the hand into the device: integral of F_h v dt
