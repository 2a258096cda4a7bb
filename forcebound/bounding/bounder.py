"""The bounder: a law, its memory and the vectors, as the device node calls it at each sample."""

import math
from typing import TypeAlias

from forcebound.bounding.law import ANCHOR_SAMPLES, Dissipation, least_viscous_path
from forcebound.bounding.laws import LAWS
from forcebound.errors import ConfigError

Vector: TypeAlias = tuple[float, ...]

ROUNDING = 1e-15  # more than the relative error of scaling a vector and taking its length
SMALLEST_LIMIT = 1e-290  # N; below it numbers lose the precision that ROUNDING relies on


class ForceBounder:
    """Bounds the force vector of a device with one law; one ledger for all axes.

    Call :meth:`start` once, then at each sample :meth:`bound` and :meth:`settle`. Damping and
    friction are those of the worst axis: every axis must dissipate at least this much, and friction
    must act along the path or on each axis by itself. Axes that differ much are better served by a
    bounder each.

    Args:
        law: A key of :data:`forcebound.bounding.LAWS`.
        dissipation: What the law may rely on.
        axes: Length of the vectors, at least 1.

    Raises:
        ConfigError: If the law is not known or there is no axis.
    """

    def __init__(self, law: str, dissipation: Dissipation, axes: int = 1) -> None:
        if law not in LAWS:
            raise ConfigError(f"no bounding law {law!r}; known are {', '.join(sorted(LAWS))}")
        if axes < 1:
            raise ConfigError(f"axes must be >= 1, got {axes}")
        self._law = LAWS[law]
        self._parameters = self._law.parameters(dissipation, axes)
        self._limit_force = self._law.limit
        self._settle_state = self._law.settle
        self._half_resolution = dissipation.resolution / 2.0
        self._hold_limit = dissipation.hold_limit
        self._saturation = dissipation.saturation
        self._axes = axes
        self._force: Vector = (0.0,) * axes
        self._held = self._held_sum = self._path = 0.0
        self._viscous = self._between = 0.0
        self._samples = 0  # since the anchors were moved
        self._plays: list[float] = []
        self._paths: list[float] = []
        self.start(0, self._force)

    @property
    def limit(self) -> float:
        """Largest magnitude allowed at the last sample, in N: the law's or the saturation."""
        return self._limit

    @property
    def estimated_energy(self) -> float:
        """Energy that the law believes in after the last sample, in J; its meaning is the law's."""
        return self._law.energy(self._state, self._held, self._held_sum, *self._parameters)

    def start(self, time_ns: int, position: Vector) -> None:
        """Begin with the first reading and no force; forget everything before.

        The device must be without force from the last :meth:`settle` on.

        Args:
            time_ns: When it was read, in ns.
            position: Reading of each axis, in m.

        Raises:
            ValueError: If ``position`` does not have as many entries as there are axes.
        """
        if len(position) != self._axes:
            raise ValueError(f"expected {self._axes} positions, got {len(position)}")
        self._time_ns = time_ns
        self._state = self._law.start(*self._parameters)
        self._reading = position
        self._limit = 0.0
        self._release()
        self._restart()

    def bound(self, time_ns: int, position: Vector, force: Vector) -> Vector:
        """Return the force to write at this sample.

        Args:
            time_ns: When ``position`` was read and the force is written, in ns; later than before.
            position: Reading of each axis, in m.
            force: Force asked for on each axis, in N, finite.

        Returns:
            Bounded force of each axis, in N, in the direction asked for (a law that adds damping
            excepted).

        Raises:
            ValueError: If the time has not advanced or a number is not finite. Both are mistakes
                of the caller: the safety chain has refused such forces before.
        """
        elapsed = (time_ns - self._time_ns) / 1e9
        if elapsed <= 0.0:
            raise ValueError(f"time must advance: {time_ns} ns after {self._time_ns} ns")
        r = self._half_resolution
        cell = 2.0 * r
        moves: list[float] = []
        distance_square = step_square = older_square = younger_square = work = path_square = 0.0
        plays, paths, held_force = self._plays, self._paths, self._force
        older, younger = self._older, self._younger
        for axis, (reading, before) in enumerate(zip(position, self._reading, strict=True)):
            move = reading - before
            moves.append(move)
            distance_square += move * move
            work += held_force[axis] * move
            # clear_square() and play(), written out: a call costs more than what it does
            clear = abs(move) - cell
            if clear > 0.0:
                step_square += clear * clear
            clear = abs(reading - older[axis]) - cell
            if clear > 0.0:
                older_square += clear * clear
            clear = abs(reading - younger[axis]) - cell
            if clear > 0.0:
                younger_square += clear * clear
            playing = plays[axis]
            if reading - r > playing:
                plays[axis] = reading - r
                paths[axis] += plays[axis] - playing
            elif reading + r < playing:
                plays[axis] = reading + r
                paths[axis] += playing - plays[axis]
            path_square += paths[axis] * paths[axis]
        asked_norm = math.hypot(*force)
        if not asked_norm + distance_square < math.inf:
            raise ValueError(f"numbers must be finite, got {position} m and {force} N")
        self._time_ns = time_ns
        self._reading = position
        path = math.sqrt(path_square)
        self._older_age += elapsed
        self._younger_age += elapsed
        viscous = least_viscous_path(
            self._viscous,
            step_square,
            elapsed,
            older_square,
            self._older_age,
            younger_square,
            self._younger_age,
            self._between,
        )
        self._state, limit, damping = self._limit_force(
            self._state,
            min(asked_norm, self._saturation),
            elapsed,
            math.sqrt(distance_square),
            viscous - self._viscous,
            path - self._path,
            work,
            self._held,
            self._held_sum,
            *self._parameters,
        )
        self._path = path
        self._viscous = viscous
        self._samples += 1
        if elapsed > self._hold_limit:
            self._release()
            self._restart()
        elif self._samples == ANCHOR_SAMPLES:
            self._move_anchors()
        self._limit = limit = min(limit, self._saturation)
        if damping > 0.0:
            rate = damping / elapsed
            force = tuple([f + rate * move for f, move in zip(force, moves, strict=True)])
            asked_norm = math.hypot(*force)
        return shorten(force, asked_norm, limit)

    def settle(self, applied: Vector) -> None:
        """Close the sample with the force that was really written.

        Args:
            applied: Force of each axis, in N: what :meth:`bound` returned, or less of it.

        Raises:
            ValueError: If the length is wrong.
        """
        change_sum = held_sum = square = 0.0
        for now, before in zip(applied, self._force, strict=True):
            change_sum += abs(now - before)
            held_sum += abs(now)
            square += now * now
        held = math.sqrt(square)
        self._state = self._settle_state(
            self._state, held, change_sum, self._held_sum, *self._parameters
        )
        self._force = applied
        self._held = held
        self._held_sum = held_sum

    def _release(self) -> None:
        self._force = (0.0,) * self._axes
        self._held = self._held_sum = 0.0

    def _restart(self) -> None:
        """Forget the way so far: from here on play operator and anchors start anew."""
        self._plays = list(self._reading)
        self._paths = [0.0] * self._axes
        self._path = 0.0
        self._older = self._younger = self._reading
        self._older_age = self._younger_age = 0.0
        self._viscous = self._between = 0.0
        self._samples = 0

    def _move_anchors(self) -> None:
        self._older, self._younger = self._younger, self._reading
        self._older_age, self._younger_age = self._younger_age, 0.0
        self._viscous -= self._between
        self._between = self._viscous
        self._samples = 0


def shorten(force: Vector, magnitude: float, limit: float) -> Vector:
    """Return ``force``, of ``magnitude`` N, no longer than ``limit`` N; its direction is kept.

    The length is at most ``limit`` to the last bit, not only to rounding.
    """
    if magnitude <= limit:
        return force
    if len(force) == 1:
        return (math.copysign(limit, force[0]),)
    if limit < SMALLEST_LIMIT:
        return (0.0,) * len(force)
    scale = limit / magnitude * (1.0 - ROUNDING)
    return tuple([scale * f for f in force])
