"""A running graph as its pages show it."""

import time
from collections import deque
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from forcebound.observe.page.controls import Controls, Pointer
from forcebound.observe.page.feed import Feed, Message
from forcebound.observe.page.lead import Lead
from forcebound.observe.page.pace import Pace
from forcebound.observe.page.state import Judged
from forcebound.observe.runs import Watch

FRAME = 1.0 / 30.0  # s between two looks at the graph
COMPILES = 30.0  # s that a first start takes on a usual machine
READABLE = 0.25  # s between two wordings of the state
MOST_EVENTS = 50  # that a page which comes later gets


class ShownGraph:
    """A running graph that is shown: what comes from it, and what may be done to it."""

    def __init__(self, run_dir: Path, controls: Controls, taken: Callable[[Any], None]) -> None:
        self.run_dir = run_dir
        self._shown_since = time.monotonic()  # s; no other graph of this server has the same
        self.watch = Watch(run_dir)
        self.controls = controls
        self.feed = Feed(run_dir, controls.energies_before)  # first: the graph may have ended
        self.pointers = {hand: Pointer(run_dir, taken, hand) for hand in self.feed.hands}
        self._leads = {
            hand: Lead(self.pointers[hand].point, start, self.feed.hands[hand].state)
            for hand, start in controls.starts.items()
        }
        self._misses = dict.fromkeys(self.feed.hands, 0)
        self.pace = Pace(controls.period)
        self.events: deque[Message] = deque(maxlen=MOST_EVENTS)  # for pages that come later
        self._next_state = 0.0

    def describe(self) -> list[Message]:
        """Return what a page needs to know before its first frame."""
        controls, scene = self.controls, self.feed.scene
        signals = [
            {"hand": hand, "name": name, "label": about.text, "unit": about.unit}
            for hand in self.feed.hands
            for name in self.feed.signals_of(hand)
            for about in (self.feed.signals[name],)
        ]
        hello = {**controls.describe(), "graph": self._shown_since, "signals": signals}
        known = filter(None, (scene, controls.episodes))
        return [hello, controls.parameters(), *known, *self.events]

    def look(self, now: float) -> list[Message]:
        """Return the messages to the pages about what has come since the last look."""
        messages = self.feed.look(self.pace.slowness)
        for lead in self._leads.values():
            lead.look()
        for message in messages:
            if message["type"] == "frame":
                message["pointer"] = self.pointers[message["hand"]].place  # of any page
                self._misses[message["hand"]] = message["misses"]
                self.pace.note(sum(self._misses.values()), now)
                message["pace"] = FRAME * self.pace.slowness
        if now >= self._next_state and self.is_starting(now):
            self._next_state = now + READABLE
            seconds = now - self._shown_since
            messages.append(
                {"type": "starting", "seconds": seconds, "share": f"{seconds / COMPILES:.0%}"}
            )
        elif now >= self._next_state and any(one["type"] == "frame" for one in messages):
            self._next_state = now + READABLE
            words = {name: one.state.describe() for name, one in self.feed.hands.items()}
            known = {name: one for name, one in words.items() if one is not None}
            messages += [{"type": "state", "hands": known}] if known else []
        return messages

    def is_starting(self, now: float) -> bool:
        """Whether the environment has not answered yet, since it loads or compiles."""
        is_new = not self.controls.is_started and not self.feed.is_answered
        return is_new and now < self._shown_since + 2 * COMPILES

    def press_again(self) -> None:
        """Let hands that are inside let go, and press again: their laws have begun again."""
        for hand, lead in self._leads.items():
            lead.begin(self.pointers[hand].place)

    def let_be(self, hand: str) -> None:
        """Lead a hand nowhere: somebody moves it."""
        if hand in self._leads:
            self._leads[hand].end()

    def take_judged(self, judged: Mapping[str, Judged]) -> None:
        """Take what is known of the hands beside their samples."""
        for hand, one in judged.items():
            self.feed.hands[hand].state.judged = one

    def close(self) -> None:
        """Close what comes from the graph."""
        self.feed.close()
        for pointer in self.pointers.values():
            pointer.close()
