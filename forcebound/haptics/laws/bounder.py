"""The bounder: a law, its memory and the vectors, as the device node calls it at each sample."""

import math
from collections.abc import Callable, Sequence
from functools import partial
from struct import Struct
from typing import Any, TypeAlias

from forcebound.compiled import jit, new_records
from forcebound.errors import ConfigError, DeviceError
from forcebound.haptics.laws.all_axes import REFUSED, TAKEN, compiled, cut
from forcebound.haptics.laws.constants import acts_along_path, axis_constants, energy_cap
from forcebound.haptics.laws.dissipation import ATTENUATES, WATCHDOGS, Dissipation, per_axis
from forcebound.haptics.laws.exchange import compiled_exchange
from forcebound.haptics.laws.law import LAWS, BoundingLaw, check_law
from forcebound.haptics.laws.ledger import Ledger
from forcebound.haptics.laws.timeline import HALF_NS
from forcebound.haptics.parts.user_module import describe_user_error
from forcebound.messages.packets import MAX_AXES

Vector: TypeAlias = tuple[float, ...]

SHORTEST_NS = 1000  # a reading sooner after the last proves nothing
ROUNDING = 1e-15  # more than the relative error of scaling a vector and taking its length
SMALLEST_LIMIT = 1e-290  # N; below it numbers lose the precision that ROUNDING relies on


class ForceBounder:
    """Bounds the force vector of a device with one law; one ledger for all axes.

    Call :meth:`start` once, then at each sample :meth:`bound` and :meth:`settle`. Coordinates may
    be joints: then positions are angles, in rad, and forces torques, in N m.

    Attributes:
        limit: Largest magnitude allowed at the last sample, in the direction of the commanded
            force, in N: the law's or the saturation.
        estimated_energy: The law's estimate after the last sample, in J; its meaning
            is the law's.
        overruns: Holds that lasted longer than the hold limit.
        refused_readings: Readings that were rejected: not finite, too soon after the last, faster
            than the device's largest speed, or perhaps before, perhaps after a change of the force.
        late_writes: Forces that took effect later after their reading than the device states.

    With ``exchanges`` the ledger can :meth:`debit`, for another one to :meth:`credit`.

    Raises:
        ConfigError: If the law is not known, or the description does not fit this number of axes.
        DeviceError: Here and in the methods, if the code of a user's law fails.
    """

    def __init__(
        self, law: str, dissipation: Dissipation, axes: int = 1, exchanges: bool = False
    ) -> None:
        check_law(law)
        if not 1 <= axes <= MAX_AXES:
            raise ConfigError(f"axes must be 1 to {MAX_AXES}, got {axes}")
        functions: Sequence[Any] = compiled(LAWS[law])
        if not LAWS.is_shipped(law):
            functions = [partial(_call, law, one) for one in functions]
        self._start_law, self._limit_force, self._settle_force = functions
        if exchanges:
            self._spare, self._debit = compiled_exchange(LAWS[law])
        self._cut = jit(cut)
        self._axes = axes
        self._dissipation = dissipation
        self._ledgers: Any = new_records(Ledger)
        self._ledger = self._ledgers[0]
        pack = Struct(f"{axes}d").pack_into  # numpy takes longer to set numbers
        self._set_reading = partial(pack, self._ledger.reading.data, 0)
        self._set_force = partial(pack, self._ledger.force.data, 0)
        self._fill_settings(LAWS[law])
        self._longest_limit = self._limit_s = dissipation.hold_limit
        self._limit_ns = round(dissipation.hold_limit * 1e9)
        self._write_delay_ns = round(dissipation.write_delay * 1e9)
        # Compile, or load from the cache, before time matters.
        rest = (0.0,) * axes
        self.start(0, rest)
        self.bound(1_000_000, rest, rest)
        if exchanges:
            self.debit(self.spare(rest))
        self.settle(rest)
        self.report_cut(2_000_000, rest)
        self.start(0, rest)

    def _fill_settings(self, law: BoundingLaw) -> None:
        d, ledger, axes = self._dissipation, self._ledger, self._axes
        constants = axis_constants(d, axes)
        along_path = acts_along_path(d, axes)
        has_presliding = any(one.presliding > 0.0 for one in constants)
        ledger.constants = law.device(d, axes)
        ledger.axes = axes
        ledger.saturation, ledger.lag, ledger.write_delay = d.saturation, d.lag, d.write_delay
        ledger.gain = d.gain_error if law.limits_holds else 0.0
        ledger.ends = 2 if ledger.gain > 0.0 else 1
        ledger.watchdog, ledger.tolerance = WATCHDOGS.index(d.watchdog), d.watchdog_tolerance
        ledger.watchdog_limit, ledger.allowance = d.watchdog_limit, d.allowance
        ledger.hand_speed = d.hand_speed if law.limits_holds else math.inf
        ledger.attenuates = ATTENUATES.index(d.attenuates) if law.limits_holds else 0
        ledger.least_share = d.least_share if ledger.attenuates > 0 else 1.0
        ledger.is_along_path = along_path
        ledger.is_rigid = (axes == 1 or along_path) and not has_presliding and d.lag == 0.0
        ledger.planned_limit = d.hold_limit
        ledger.path_error = math.hypot(*[one.weight_error for one in constants])
        ledger.resolution = math.hypot(*per_axis("resolution", d.resolution, axes))
        ledger.largest_speed = d.largest_speed
        for k, one in enumerate(constants):
            ledger.axis[k].constants = one

    @property
    def largest_allowance(self) -> float:
        """Most energy that a late hold, or a late write, can have given the hand, in J."""
        return float(self._ledger.largest_leak)

    @property
    def fast_holds(self) -> int:
        """Intervals with a force in which a reading shows more than the hand's stated speed."""
        return int(self._ledger.fast_holds)

    @property
    def speed_leak(self) -> float:
        """Most energy that a hand faster than stated can have got in them, in J."""
        return float(self._ledger.speed_leak)

    @property
    def crowded_writes(self) -> int:
        """Forces that had to be zero, since too many before them did not act yet."""
        return int(self._ledger.crowded)

    @property
    def allowance_repaid(self) -> bool:
        """True if the ledger has recovered what late holds, or a faster hand, can have given."""
        leaked = max(self.largest_allowance, self.speed_leak)
        return leaked == 0.0 or self.estimated_energy >= 0.0

    def start(self, time_ns: int, position: Vector) -> None:
        """Begin with the first reading, in m, at ``time_ns`` and no force; forget all before.

        The device must be without force from the last :meth:`settle` on.
        """
        self._taken_ns = self._now_ns = self._written_ns = time_ns
        self._position = position
        self._inserted_ns = 0  # before the reading, which may be earlier by so much
        self._held_limit_ns = self._limit_ns
        self._cut_ns = time_ns - 1_000_000_000  # none yet
        self._set_reading(*position)
        self.limit = 0.0
        self.overruns = self.refused_readings = self.late_writes = 0
        self.estimated_energy: float = self._start_law(self._ledgers)

    def bound(
        self, read_ns: int, position: Vector, commanded: Vector, jitter_ns: int = 0
    ) -> Vector:
        """Return the force to write at this sample, in N, in the direction of the commanded force.

        Only a law that adds damping departs from that. A reading that cannot be is refused: it is
        counted, changes nothing else, and the force is one that is safe whatever the device does.

        Args:
            read_ns: When ``position`` was read, in ns; later than before.
            position: Reading of each axis, in m.
            commanded: Commanded force of each axis, in N.
            jitter_ns: By how much it may have been read earlier than at ``read_ns``, in ns. What
                certainly happens after the reading is then that much later, too.

        Raises:
            ValueError: If a commanded force is not finite: a mistake of the caller, since the
                safety chain has rejected such a force before. So is a vector of another length
                (:class:`struct.error`), here and in the other methods.
        """
        self._set_force(*commanded)
        magnitude = math.hypot(*commanded)
        if not magnitude < math.inf:
            raise ValueError(f"commanded forces must be finite, got {commanded} N")
        before = self._position
        if jitter_ns != self._inserted_ns:
            self._insert(jitter_ns)
        is_clear = jitter_ns == 0 or self._postpone(read_ns, jitter_ns)
        limit, damping, dt = self._sample(read_ns, position, magnitude, is_clear=is_clear)
        force = commanded
        if damping > 0.0:
            rate, saturation = damping / dt, self._dissipation.saturation
            if limit < saturation:  # the law's limit is of the commanded force
                force, limit = shorten(force, magnitude, limit), saturation
            moved = zip(force, position, before, strict=True)
            force = tuple([f + rate * (now - then) for f, now, then in moved])
            magnitude = math.hypot(*force)
        self.limit = limit
        return shorten(force, magnitude, limit)

    def credit(self, amount: float) -> None:
        """Add energy, in J, that another ledger has given; before :meth:`bound`."""
        self._ledger.state[0] += amount
        self._ledger.state[1] += amount

    def spare(self, commanded: Vector) -> float:
        """Return what there is, in J, beyond the need of the force that :meth:`bound` just got.

        Negative: what is missing for it.
        """
        return float(self._spare(self._ledgers, math.hypot(*commanded)))

    def debit(self, most: float) -> float:
        """Take at most so much, in J, for another ledger, and return what was taken.

        Between :meth:`bound` and :meth:`settle`; the force to write is at most the new ``limit``.
        """
        taken, limit = self._debit(self._ledgers, most)
        self.limit = min(self.limit, limit)
        return float(taken)

    def settle(self, applied: Vector, write_ns: int | None = None) -> None:
        """Close the sample with the force that was written, in N: what :meth:`bound` gave, or less.

        ``write_ns`` is when it took effect, in ns; None: when the position was read.
        """
        now = self._now_ns
        write_ns = now if write_ns is None or write_ns < now else write_ns
        if write_ns - self._written_ns > self._held_limit_ns:
            self.overruns += 1
        if write_ns - now > self._write_delay_ns:
            self.late_writes += 1
        self._written_ns, self._held_limit_ns = write_ns, self._limit_ns
        self._set_force(*applied)
        self.estimated_energy = self._settle_force(self._ledgers, (write_ns - now) / 1e9)

    def set_hold_limit(self, seconds: float) -> None:
        """Plan the forces from the next :meth:`bound` on for this hold limit, in s.

        The device must have been given it before it gets such a force.
        """
        if seconds == self._limit_s:
            return
        self._limit_s, self._limit_ns = seconds, round(seconds * 1e9)
        self._ledger.planned_limit = self._ledger.constants.hold_limit = seconds
        if seconds > self._longest_limit:
            self._longest_limit = seconds
            cap = energy_cap(self._dissipation, self._axes, seconds)
            self._ledger.constants.energy_cap = cap

    def report_cut(self, time_ns: int, position: Vector) -> None:
        """Take in when and where (m) the watchdog dropped the force, before :meth:`bound`.

        A report at the time when a force takes effect is one of the old force, which acted until
        then. One older than the last reading does not show when the present force was dropped, if
        at all; the worst permitted time is assumed.
        """
        passed, waiting = (time_ns - self._now_ns) / 1e9, range(self._ledger.waiting)
        effects = [-self._ledger.age, *[self._ledger.until_write[place] for place in waiting]]
        if any(abs(one - passed) < HALF_NS for one in effects):
            return
        if time_ns < self._now_ns:
            self._ledger.is_unsure, self._ledger.quiet = True, 0.0
            return
        self._cut_ns = time_ns
        self._insert(0)
        self._sample(time_ns, position, 0.0, is_cut=True)
        self._cut(self._ledgers)
        self._ledger.is_unsure = self._ledger.was_unsure  # whatever its age was at the report

    def _insert(self, jitter_ns: int) -> None:
        self._inserted_ns, self._ledger.inserted = jitter_ns, jitter_ns / 1e9

    def _postpone(self, read_ns: int, jitter_ns: int) -> bool:
        """Let what happens after a reading wait for the time that was inserted before the reading.

        Return whether it is known of everything whether it happens before the reading or after.
        """
        ledger, is_clear = self._ledger, True
        latest = (read_ns - self._now_ns) / 1e9
        jitter = jitter_ns / 1e9
        times = [ledger.until_cut, *[ledger.until_write[k] for k in range(ledger.waiting)]]
        for k, time in enumerate(times):
            if time > latest - HALF_NS:
                times[k] += jitter
            elif time > latest - jitter + HALF_NS:  # a cut matters if the force is not replaced
                is_clear = is_clear and k == 0 and ledger.write_delay == 0.0
        ledger.until_cut = times[0]
        for k in range(ledger.waiting):
            ledger.until_write[k] = times[k + 1]
        if self._written_ns >= read_ns:
            self._written_ns += jitter_ns
        return is_clear

    def _sample(
        self,
        read_ns: int,
        position: Vector,
        magnitude: float,
        is_cut: bool = False,
        is_clear: bool = True,
    ) -> tuple[float, float, float]:
        """Let time pass up to a reading and take it in; return force, added damping and dt."""
        self._set_reading(*position)
        since_ns = read_ns - self._taken_ns
        is_timely = since_ns >= SHORTEST_NS and read_ns >= self._now_ns and is_clear
        if is_cut:  # it says all about the force that acted, nothing about one before
            self._ledger.is_unsure = self._ledger.was_unsure
        passed_ns = read_ns - self._now_ns
        if passed_ns > 0:
            self._now_ns = read_ns
        dt = since_ns / 1e9
        limit, damping, is_wrong, is_taken = self._limit_force(
            self._ledgers, magnitude, read_ns, passed_ns / 1e9, dt, TAKEN if is_timely else REFUSED
        )
        if is_taken:
            self._taken_ns, self._position = read_ns, position
        # Too soon after the reading at a cut is no fault of this one.
        elif is_wrong and not is_cut and read_ns - self._cut_ns >= SHORTEST_NS:
            self.refused_readings += 1
        return limit, damping, dt


def _call(law: str, function: Callable[..., Any], *arguments: Any) -> Any:
    """Call a function of a user's law, which may raise anything."""
    try:
        return function(*arguments)
    except Exception as error:
        raise DeviceError(f"law {law} failed: {describe_user_error(error)}") from error


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


def saturated(force: Vector, largest: float) -> Vector:
    """Return what motors give that have a ``largest`` force or torque; the direction is kept.

    Nothing, if it is not finite. The bounder saturates its result, too, since a law may add
    damping; a device clips for itself, since a motor does.
    """
    magnitude = math.hypot(*force)
    if magnitude <= largest:
        return force
    scale = largest / magnitude if math.isfinite(magnitude) else 0.0
    return tuple([scale * f for f in force]) if scale else (0.0,) * len(force)
