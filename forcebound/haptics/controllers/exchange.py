"""Questions to the environment and its answers, for a controller that answers states by itself.

It matches each answer with its question, measures how long an answer takes, and notices when
answers stay away: nobody else knows that the environment is gone.
"""

from dataclasses import dataclass
from typing import Annotated, ClassVar

from forcebound.haptics.controllers import ControllerModel
from forcebound.haptics.controllers.plane import Asked
from forcebound.messages.packets import DeviceState, EnvironmentReply
from forcebound.quantities import NOT_NEGATIVE, POSITIVE, Time, check_ranges

REMEMBERED = 4096  # questions that are kept; at 4 kHz those of one second
ROUND_TRIP_SHARE = 0.05  # weight of a new round trip in their mean


def has_restarted(before: DeviceState, state: DeviceState) -> bool:
    """Return whether the device counts its ticks anew; a state that is late is older, too."""
    return state.seq < before.seq and state.time_ns > before.time_ns


@dataclass(frozen=True, kw_only=True)
class ReplyTimeouts(ControllerModel):
    """How long a controller that answers states by itself waits for the environment.

    Attributes:
        hold: Silence of the environment after which the force fades.
        fade: Time in which it does.
        age_limit: An answer that has taken longer is ignored.
        release: Time of force-free answers behind a surface after which the surface is gone.
    """

    hold: Annotated[Time, POSITIVE] = 0.1
    fade: Annotated[Time, POSITIVE] = 0.05
    age_limit: Annotated[Time, POSITIVE] = 0.5
    release: Annotated[Time, NOT_NEGATIVE] = 0.005

    answers_states: ClassVar[bool] = True

    def __post_init__(self) -> None:
        check_ranges(self)


class Exchange:
    """Questions that wait for an answer, and how long it takes.

    Times are of the controller's clock, in ns.
    """

    def __init__(self, timeouts: ReplyTimeouts) -> None:
        self._timeouts = timeouts
        self._asked: dict[int, tuple[Asked, int]] = {}  # by tick, with the time of asking
        self._newest = -1  # tick that was answered
        self._heard_ns: int | None = None
        self._round_trip = 0.0

    def ask(self, tick: int, asked: Asked, time_ns: int) -> None:
        """Note a question."""
        self._asked[tick] = asked, time_ns
        if len(self._asked) > REMEMBERED:
            del self._asked[next(iter(self._asked))]

    def take(self, reply: EnvironmentReply, time_ns: int) -> Asked | None:
        """Return what an answer answers; None if it is too old, twice, or older than another."""
        known = self._asked.pop(reply.device_seq, None)
        if known is None:
            return None
        asked, asked_ns = known
        round_trip = (time_ns - asked_ns) * 1e-9
        if round_trip > self._timeouts.age_limit:
            return None
        share = 1.0 if self._heard_ns is None else ROUND_TRIP_SHARE
        self._round_trip += share * (round_trip - self._round_trip)
        self._heard_ns = time_ns
        if reply.device_seq < self._newest:
            return None
        self._newest = reply.device_seq
        return asked

    def round_trip(self, time_ns: int) -> float:
        """Return the time that an answer takes, in s; before the first one: at least."""
        if self._heard_ns is None and self._asked:
            _, first_ns = next(iter(self._asked.values()))
            return (time_ns - first_ns) * 1e-9
        return self._round_trip

    def share(self, time_ns: int) -> float:
        """Return how much of a force may be shown: 1, less while it fades, 0 in silence."""
        if self._heard_ns is None:
            return 0.0
        silence = (time_ns - self._heard_ns) * 1e-9
        return min(max(1.0 - (silence - self._timeouts.hold) / self._timeouts.fade, 0.0), 1.0)
