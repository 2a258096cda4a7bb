"""Walls across the first axis, and a viscous medium: formulas without a state.

The functions of numbers alone are those that compiled kernels share with the environments.
"""

from abc import abstractmethod
from dataclasses import dataclass
from typing import Annotated, TypeAlias

from forcebound.haptics.environments import FAR, StatelessEnvironment
from forcebound.messages.packets import Vector
from forcebound.quantities import (
    NOT_NEGATIVE,
    Damping,
    Length,
    Range,
    Ranged,
    Ratio,
    Stiffness,
    StiffnessRate,
)

AnyDamping: TypeAlias = Annotated[Damping, Range()]  # finite; negative: it gives energy


def on_first_axis(force: float, axes: int) -> Vector:
    """Return ``force`` along the first axis and zero along the others."""
    return (force,) if axes == 1 else (force,) + (0.0,) * (axes - 1)


def wall_force(position: float, stiffness: float, surface: float) -> float:
    """Return the force of an elastic wall, in N: ``k (x - x_w)`` behind the surface, else 0.

    Source: paper section 4.1, Eq. 32, first line.
    """
    return stiffness * max(position - surface, 0.0)


def active_wall_force(
    position: float, velocity: float, stiffness: float, damping: float, surface: float
) -> float:
    """Return ``k d + b v`` behind the surface, in N, else 0; it may pull."""
    depth = position - surface
    return stiffness * depth + damping * velocity if depth > 0.0 else 0.0


def damped_wall_force(
    position: float, velocity: float, stiffness: float, damping: float, surface: float
) -> float:
    """Return ``max(k d + b v, 0)`` behind the surface, in N, else 0: the wall does not pull."""
    return max(active_wall_force(position, velocity, stiffness, damping, surface), 0.0)


def time_varying_force(
    position: float, elapsed: float, stiffness: float, stiffness_rate: float, surface: float
) -> float:
    """Return the force of a wall of stiffness ``k_1 + k_2 t``, in N."""
    return wall_force(position, stiffness + stiffness_rate * elapsed, surface)


def power_law_force(
    position: float, stiffness: float, exponent: float, reference: float, surface: float
) -> float:
    """Return ``k d_0 (d / d_0)^p`` behind the surface, in N, else 0; beyond 10 m it stays."""
    depth = min(max(position - surface, 0.0), FAR) / reference
    force: float = stiffness * reference * depth**exponent
    return force


def damper_force(velocity: float, damping: float) -> float:
    """Return ``b v``, in N."""
    return damping * velocity


@dataclass(frozen=True)
class _FlatWall(Ranged, StatelessEnvironment):
    """Base of the walls: a force along the first axis alone.

    Attributes:
        stiffness: Force over penetration.
        position: Of the surface, on the first axis.
    """

    stiffness: Annotated[Stiffness, NOT_NEGATIVE] = 10_000.0  # paper 4.2: k = 10 N/mm
    position: Length = 0.010  # of the surface; paper 4.1: x_wall = 10 mm

    def force(self, user: str, position: Vector, velocity: Vector, elapsed: float) -> Vector:
        return on_first_axis(self.push(position[0], velocity[0], elapsed), len(position))

    @abstractmethod
    def push(self, x: float, v: float, elapsed: float) -> float:
        """Return the force, in N, at a position (m) and velocity (m/s) on the first axis."""


@dataclass(frozen=True)
class Wall(_FlatWall):
    """A flat elastic wall across the first axis; free motion before it."""

    def push(self, x: float, v: float, elapsed: float) -> float:
        return wall_force(x, self.stiffness, self.position)


@dataclass(frozen=True)
class DampedWall(_FlatWall):
    """A flat wall of spring and damper across the first axis, the standard test of a Z-width.

    The velocity is the device's estimate, a filtered backward difference of its readings.

    Source: J. E. Colgate and J. M. Brown, Factors affecting the Z-width of a haptic display, IEEE
    International Conference on Robotics and Automation, 1994.

    Attributes:
        damping: Force over velocity behind the surface, as far as the wall does not pull.
    """

    damping: AnyDamping = 0.0

    def push(self, x: float, v: float, elapsed: float) -> float:
        return damped_wall_force(x, v, self.stiffness, self.damping, self.position)


@dataclass(frozen=True)
class TimeVaryingWall(_FlatWall):
    """A wall of stiffness ``k_1 + k_2 t`` across the first axis (paper Eq. 32, second line).

    Attributes:
        stiffness: At the time at which the force engages, k_1.
        stiffness_rate: Its growth, k_2.
    """

    stiffness: Annotated[Stiffness, NOT_NEGATIVE] = 300.0  # k_1; paper 4.2: 0.3 N/mm
    stiffness_rate: StiffnessRate = 60.0  # k_2; paper 4.2: 0.06 N/mm per s

    def push(self, x: float, v: float, elapsed: float) -> float:
        return time_varying_force(x, elapsed, self.stiffness, self.stiffness_rate, self.position)


@dataclass(frozen=True)
class PowerLawWall(_FlatWall):
    """A wall ``F = k d_0 (d / d_0)^p`` across the first axis, with d the penetration.

    Written with a reference penetration d_0 so that ``stiffness`` keeps the unit N/m: at d = d_0
    the wall answers as a linear one of that stiffness. Exponent 1.5 is the contact of two spheres
    (H. Hertz, J. reine angew. Math. 92, 1881); 1 is the linear wall.

    Attributes:
        exponent: p; above 1 the wall hardens.
        reference: Penetration d_0 at which ``stiffness`` is force over penetration.
    """

    exponent: Annotated[Ratio, Range(above=0, at_most=10)] = 1.5
    reference: Annotated[Length, Range(at_least=1e-6)] = 0.001

    def push(self, x: float, v: float, elapsed: float) -> float:
        return power_law_force(x, self.stiffness, self.exponent, self.reference, self.position)


@dataclass(frozen=True)
class ActiveWall(_FlatWall):
    """A wall that gives energy: its damping is negative, so it pushes harder on the way out.

    A launch file may use it to see what a law survives.

    Attributes:
        damping: Force over velocity behind the surface; negative: it gives energy.
    """

    damping: AnyDamping = -20.0

    def push(self, x: float, v: float, elapsed: float) -> float:
        return active_wall_force(x, v, self.stiffness, self.damping, self.position)


@dataclass(frozen=True)
class Damper(Ranged, StatelessEnvironment):
    """A force ``b v`` along every axis, everywhere.

    Attributes:
        damping: b; negative: it gives energy.
    """

    damping: AnyDamping = 5.0

    def force(self, user: str, position: Vector, velocity: Vector, elapsed: float) -> Vector:
        return tuple(damper_force(v, self.damping) for v in velocity)
