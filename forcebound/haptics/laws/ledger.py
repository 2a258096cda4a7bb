"""Memory of a bounder between two calls: one record, which compiled functions take over.

Compiled functions read and write it by attribute, without copying; interpreted ones do the same.
"""

from typing import Annotated, Any

from forcebound.haptics.laws.sample import AxisConstants, AxisMemory, DeviceConstants, Memory
from forcebound.haptics.laws.waveform import Motor
from forcebound.messages.packets import MAX_AXES

#: Forces that can be on their way at once; the last place takes only a zero force.
PLACES = 8

#: Values of ``Ledger.watchdog``, in the order of
# :data:`forcebound.haptics.laws.dissipation.WATCHDOGS`.
GUARDING, REPORTING, SILENT, NONE = range(4)

SETTLED = 20.0  # time constants of the amplifier, after which the rest of a force is gone: 2e-9


class Axis:
    """Record of one axis."""

    memory: AxisMemory
    motor: Motor
    constants: AxisConstants
    held: float  # N, force that took effect last
    onset: float  # N, largest magnitude that the motor's force can have had then
    waiting: Annotated[list[float], PLACES]  # N, forces that were written and will act, in order
    trial: float  # N, force whose cost is computed, or the direction of one
    strength: float  # N, magnitude of the force of a hold
    rubbed: float  # N, of friction, that the last interval left beside an attenuating motor
    origin: float  # m, reading at the start
    work: float  # J, in the ledger, of this axis: less the prices that grow with the gain


class Ledger:
    """Memory of a bounder."""

    reading: Annotated[list[float], MAX_AXES]  # m, input of a call
    force: Annotated[list[float], MAX_AXES]  # N, input of a call
    # Settings.
    axes: int
    saturation: float  # N
    ends: int  # of the range of gains: 2, or 1 if the gain has no error
    gain: float  # its largest relative error
    lag: float  # s
    write_delay: float  # s
    watchdog: int
    tolerance: float  # of the watchdog
    watchdog_limit: float  # s
    allowance: float  # J
    hand_speed: float  # m/s, or inf
    attenuates: int  # place in ``dissipation.ATTENUATES``: 0 never, 1 per write, 2 freely
    least_share: float  # that an attenuating motor gives; 1 if it gives all
    is_rigid: bool  # a formula gives the largest force
    is_along_path: bool  # of friction
    planned_limit: float  # s, hold limit of the next force
    path_error: float  # N, length of the vector of the errors of the weights
    resolution: float  # m, length of the vector of the axes' resolutions
    largest_speed: float  # m/s; a reading that implies more is refused
    constants: DeviceConstants
    # The law: state and energy available for the next hold, at the least and the largest gain.
    state: Annotated[list[float], 2]
    available: Annotated[list[float], 2]
    before: Annotated[list[float], 2]  # J, what older forces can give until that hold begins
    held_price: float  # J, of the last reading that was taken in
    spent: float  # J, the most that the force since that reading can have given
    since: float  # s, since that reading
    inserted: float  # s before this reading that the true interval need not have
    is_waiting: bool  # in that time
    memory: Memory
    # The last reading that was refused for its speed, since one was taken in.
    has_candidate: bool
    candidate: Annotated[list[float], MAX_AXES]  # m
    candidate_ns: int  # when it was read
    # The force that acts.
    age: float  # s
    until_cut: float  # s until it will be dropped, or inf
    held_limit: float  # s, that it was planned for
    budget: float  # J, that it was planned for
    given: float  # J, the most that it can have given since it took effect
    is_dropped: bool
    is_late: bool  # it took effect later than the write delay: its budget is what was left then
    is_unsure: bool  # the watchdog may have dropped a force since the last reading
    was_unsure: bool  # the same, of a force that another one has replaced since
    quiet: float  # s, since a force may have been dropped last
    largest_leak: float  # J, the most that a late hold, or a late write, can have given
    fast_holds: int  # intervals with a force in which the hand was seen to be too fast
    speed_leak: float  # J, the most that it can have got in them
    # The forces that were written and will act, in order.
    waiting: int  # number of them
    until_write: Annotated[list[float], PLACES]  # s
    waiting_limit: Annotated[list[float], PLACES]  # s, hold limit
    waiting_budget: Annotated[list[float], PLACES]  # J
    waiting_late: Annotated[list[float], PLACES]  # s, later than the write delay
    crowded: int  # decisions for which there was no place: a zero force was allowed
    axis: Annotated[list[Axis], MAX_AXES]


def store_axis(into: Any, memory: AxisMemory) -> None:
    """Put the memory of an axis into a record."""
    into.reading = memory.reading
    into.force = memory.force
    into.mean_force = memory.mean_force
    into.play = memory.play
    into.path = memory.path
    into.older = memory.older
    into.younger = memory.younger


def store_force(into: Any, force: float) -> None:
    """Put the force that was written last into the memory of an axis, in N."""
    into.force = force


def store_memory(into: Any, memory: Memory) -> None:
    """Put the memory of all axes into a record."""
    into.path = memory.path
    into.loss = memory.loss
    into.between = memory.between
    into.older_age = memory.older_age
    into.younger_age = memory.younger_age
    into.samples = memory.samples
