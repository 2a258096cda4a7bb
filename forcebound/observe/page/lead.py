"""A simulated hand that lets go and presses again, because a new law found it inside something.

The ledger of a law begins empty, and only motion fills it: what a hand does not put in, it cannot
get. So a hand that was inside when its law began feels a soft wall, however stiff the law is for
one that presses. One that swung out and in has spent on the way what it had put in.
"""

from collections.abc import Callable
from typing import TypeAlias

from forcebound.messages.packets import Vector
from forcebound.observe.page.state import LiveState

HELD_NS = 500_000_000  # in contact, after which a hand that swung has settled
AWAY_NS = 300_000_000  # without contact, after which the hand presses again
PRESS_NS = 700_000_000  # for the way in: a hand that bounces spends what it has put in
LONGEST_NS = 3_000_000_000  # that each part takes, at most: a hand that gets nowhere is let be

Move: TypeAlias = Callable[[Vector], object]


class Lead:
    """Leads the pointer of a hand out and back in, once per :meth:`begin`.

    Args:
        move: Moves the pointer to a place, in m.
        start: Where it goes to let go, in m.
        state: Of the hand.
    """

    def __init__(self, move: Move, start: Vector, state: LiveState) -> None:
        self._move, self._start, self._state = move, start, state
        self._place: Vector | None = None
        self.end()

    def begin(self, place: Vector | None) -> None:
        """Begin, with the pointer at a place, in m; None: nobody has moved it."""
        self.end()
        self._place = place

    def end(self) -> None:
        """Let the hand be: somebody moves it, or it is inside again."""
        self._place = None
        self._is_out, self._since_ns, self._press_ns = False, 0, 0
        self._state.is_led = False

    def look(self) -> None:
        """Make the next move, if it is time."""
        now = self._state.newest
        if self._place is None or now is None or now.engagement < 1.0:
            return
        self._since_ns = self._since_ns or now.time_ns
        is_long = now.time_ns - self._since_ns > LONGEST_NS
        if not self._is_out:
            is_in = self._state.is_inside or self._state.is_held_for(HELD_NS)
            if is_in and self._state.is_short:
                self._state.is_led = self._is_out = True
                self._since_ns = now.time_ns
                self._move(self._start)
            elif is_long:  # it has let go already, or loses nothing
                self.end()
        elif self._press_ns:
            self._press(min((now.time_ns - self._press_ns) / PRESS_NS, 1.0))
        elif is_long or self._state.is_free_for(AWAY_NS):
            self._press_ns = now.time_ns

    def _press(self, share: float) -> None:
        assert self._place is not None
        way = zip(self._start, self._place, strict=True)
        self._move(tuple([start + share * (end - start) for start, end in way]))
        if share == 1.0:
            self.end()
