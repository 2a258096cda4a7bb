"""A session of a study with a person: which page is shown when, and when a touch begins and ends.

It runs in a thread of its own, so that it can wait; pages put what they send into :attr:`inbox`.
The pages keep nothing: what is shown now is :attr:`shown`, for each page that opens.
"""

import secrets
import time
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from threading import Condition
from typing import Any, Literal

from forcebound.errors import ForceboundError
from forcebound.lab.study.graph import Sample, StudyGraph, wall_at_hand
from forcebound.lab.study.measures import measure
from forcebound.lab.study.plan import Block
from forcebound.lab.study.session import Session, Step
from forcebound.messages.topology import HAND
from forcebound.observe.page.feed import Message
from forcebound.run.results import results_of

LOOK = 0.01  # s between two looks at the graph; a message from a page is taken at once
FRAME = 1.0 / 30.0  # s between two messages with the place of the marker
LEAST_TIME = 0.02  # s of the approach from the line on, from which there is a speed to show
ORDINALS = ("First", "Second")
GO_ON = ("Go on",)
NOWHERE = Sample(0.0, 0.0, 0)  # before the first reading


class StopError(Exception):
    """The session is to end."""


class AgainError(Exception):
    """The touch does not count, and begins again: the page has gone, or the hand was too early."""


@dataclass
class Approach:
    """The way of the hand from the starting line to the wall, in m on the first axis."""

    line: float
    wall: float
    block: Block
    contact: float | None = None  # s, the device's clock
    newest: Sample = NOWHERE
    speed: float | None = None  # m/s, mean from the line on; the last one before the contact stays
    _left: Sample | None = None  # at the line

    def take(self, sample: Sample) -> None:
        """Take a reading."""
        self.newest = sample
        if self.contact is not None:
            return
        if sample.position <= self.line:
            self._left, self.speed = sample, None
        elif self._left is not None:
            elapsed = sample.time - self._left.time
            if sample.position > self.wall:
                self.contact = sample.time
            if elapsed >= LEAST_TIME or self.contact is not None:
                self.speed = (sample.position - self._left.position) / elapsed

    @property
    def colour(self) -> int | None:
        """Which of the study's colours the marker has: too slow, in the band, too fast."""
        return None if self.speed is None else colour_of(self.block, self.speed)


def colour_of(block: Block, speed: float) -> int:
    """Return 0 for a speed below the band of a block, 1 within, 2 above."""
    if block.holds(speed) or block.band is None:
        return 1
    return 0 if speed < block.band[0] else 2


class Inbox:
    """Messages of the pages: the newest message of each kind, so that a flood makes nobody wait."""

    def __init__(self) -> None:
        self._newest: dict[str, Message] = {}
        self._changed = Condition()

    def put(self, message: Message) -> None:
        """Take a message; from any thread."""
        with self._changed:
            self._newest.pop(message["do"], None)  # it comes last
            self._newest[message["do"]] = message
            self._changed.notify()

    def take(self, seconds: float) -> Collection[Message]:
        """Return the messages, waiting at most so long for one."""
        with self._changed:
            self._changed.wait_for(lambda: self._newest, seconds)
            newest, self._newest = self._newest, {}
        return newest.values()


class LiveStudy:
    """Leads one participant through a session.

    Args:
        session: Of the participant.
        graph: That presents the touches.
        send: Sends a message to the pages; called in the thread of :meth:`run`.
        note: Says what is wrong to the experimenter, in the terminal.
    """

    def __init__(
        self,
        session: Session,
        graph: StudyGraph,
        send: Callable[[Message], None],
        note: Callable[[str], None],
    ) -> None:
        self.inbox = Inbox()
        self.shown: Message = {}
        self._session, self._graph, self._send, self._note = session, graph, send, note
        self._is_ready, self._hint = False, ""
        self._next_frame = self._ended = 0.0  # s; end of the last touch
        self._show("wait", "One moment")

    def run(self) -> None:
        """Lead through the session, until it is finished, or a message ``stop``."""
        try:
            self._try(self._check_noise)
            while self._session.step.kind != "finished":
                self._try(self._do)
            self._show("finished", "Finished. Thank you!")
        except StopError:
            pass
        finally:
            self._graph.close()

    def _try(self, work: Callable[[], None]) -> None:
        """Do something; if it fails, say so, and wait for the answer *Try again*."""
        try:
            work()
        except AgainError as why:
            self._hint = str(why)
        except (ForceboundError, OSError) as error:
            problem = self._graph.failure or str(error)
            self._graph.close()
            self._note(problem)
            text = problem.splitlines()[-1].strip()
            self._choose("problem", "Please call the experimenter.", text, ("Try again",))

    def _do(self) -> None:
        step, session = self._session.step, self._session
        if step.kind == "touch":
            self._touch(step)
        elif step.kind == "question":
            answer = self._choose("question", step.text, "", ("1  first", "2  second"))
            interval: Literal[1, 2] = 1 if answer == 1 else 2
            session.answer(interval, round(time.monotonic() - self._ended, 3))
        else:
            if step.kind == "break":
                self._graph.close()  # no device is kept waiting, and no recording grows
            title = {"break": "Break", "instruction": "Please read"}.get(step.kind, "Training")
            text = _feedback(step) if step.kind == "feedback" else step.text
            self._choose(step.kind, title, text, GO_ON, step.duration)
            session.go_on()

    def _check_noise(self) -> None:
        if self._session.study.noise != "none":
            text = (
                "Put on the earphones. Choose a level that is pleasant, but loud enough that you do"
                " not hear the device."
            )
            self._choose("noise", "Noise", text, GO_ON)

    def _touch(self, step: Step) -> None:
        assert step.trial is not None
        assert step.config is not None
        assert step.recording is not None
        study, config = self._session.study, step.config
        wall, block = wall_at_hand(config), study.blocks[step.trial.block]
        approach = Approach(wall - study.guidance.line, wall, block)
        title, hint = f"{ORDINALS[step.interval - 1]} wall", self._hint
        scene = {"line": approach.line, "wall": wall}
        self._show("wait", title, hint or "One moment.")
        while not self._is_ready:
            self._look()
        self._graph.prepare(config)
        self._show("back", title, f"{hint} Wait behind the line.".strip(), scene=scene)
        while not approach.newest.time or approach.newest.position > approach.line:
            self._follow(approach)
        self._graph.place(config)
        try:
            with self._graph.recording(step.recording):
                self._present(Approach(approach.line, wall, block), title, study.touch_time)
        finally:
            self._graph.clear()
        self._hint = ""
        run = results_of(step.recording)[HAND]
        measures = measure(run, study.guidance.line, study.touch_time)
        if not self._session.touched(measures):
            speed = measures.speed
            words = ("Too slow.", "In the band.", "Too fast.")
            self._hint = (
                "Start behind the line." if speed is None else words[colour_of(block, speed)]
            )

    def _present(self, approach: Approach, title: str, touch_time: float) -> None:
        """Let the participant touch the wall, which is in its place, while it is recorded."""
        self._graph.samples()  # from before the recording, which would not have that contact
        while not approach.newest.time:
            self._follow(approach)
        if approach.newest.position > approach.line:
            raise AgainError("Too early. Go back behind the line.")
        self._session.begin()
        self._show(
            "go", title, "Touch the wall.", scene={"line": approach.line, "wall": approach.wall}
        )
        while approach.contact is None or approach.newest.time < approach.contact + touch_time:
            self._follow(approach)
            if not self._is_ready:
                raise AgainError
        self._ended = time.monotonic()

    def _follow(self, approach: Approach) -> None:
        """Take the readings since the last look, and move the marker."""
        for sample in self._look():
            approach.take(sample)
        if approach.newest.time and time.monotonic() >= self._next_frame:
            self._next_frame = time.monotonic() + FRAME
            self._send({"type": "marker", "x": approach.newest.position, "colour": approach.colour})

    def _choose(
        self, kind: str, title: str, text: str, choices: tuple[str, ...], least: float = 0.0
    ) -> int:
        """Show a step, and return which of its choices was taken, from 1, after ``least`` s."""
        self._show(kind, title, text, choices=choices, ends=time.monotonic() + least)
        held = ~0  # buttons of the handle that were down at the last look; first let go of all
        while True:
            taken = self._take()
            for sample in self._graph.samples():
                new = sample.buttons & ~held
                held = sample.buttons
                taken += [n for n in range(1, len(choices) + 1) if new & 1 << (n - 1)]
            for choice in taken:
                if choice in range(1, len(choices) + 1) and time.monotonic() >= self.shown["ends"]:
                    return int(choice)

    def _look(self) -> Sequence[Sample]:
        self._take()
        return self._graph.samples()

    def _take(self) -> list[Any]:
        """Take what pages send, waiting a moment for it; return choices for the present step."""
        chosen = []
        for message in self.inbox.take(LOOK):
            match message:
                case {"do": "stop"}:
                    raise StopError
                case {"do": "choose", "step": step, "choice": choice}:
                    chosen += [choice] if step == self.shown["step"] else []
                case {"do": "level", "level": float() | int() as level}:
                    self.shown["level"] = min(max(level, 0.0), 1.0)
                case {"do": "point", "place": place}:
                    self._graph.point(place)
                case {"do": "ready" | "away" as do}:
                    self._is_ready = do == "ready"
        return chosen

    def _show(
        self,
        kind: str,
        title: str,
        text: str = "",
        *,
        choices: Sequence[str] = (),
        ends: float = 0.0,
        scene: Mapping[str, float] | None = None,
    ) -> None:
        """Show a step on the pages, from now on and on each that opens."""
        study, (done, every) = self._session.study, self._session.progress
        self.shown = {
            "type": "step",
            # An answer to another one does not count, and none can be sent before it is shown.
            "step": secrets.token_hex(4),
            "kind": kind,
            "title": title,
            "text": text,
            "choices": choices,
            "ends": ends,  # s, this machine's clock: no choice counts before
            "scene": scene,
            "done": done,
            "every": every,
            "colours": study.guidance.colours,
            "noise": study.noise,
            "level": self.shown.get("level", 0.3),
            "rehearsal": self._session.kind == "rehearsal",
            "drags": "pointer" in self._graph.movers,
        }
        self._send(self.describe())

    def describe(self) -> Message:
        """Return the step of now, for a page."""
        return {**self.shown, "remaining": max(0.0, self.shown["ends"] - time.monotonic())}


def _feedback(step: Step) -> str:
    """Return the feedback on a trial of the training, in words."""
    slow_or_fast = [name for name, good in zip(ORDINALS, step.in_band, strict=True) if not good]
    speed = f"{' and '.join(slow_or_fast)} touch: wrong speed." if slow_or_fast else "Good speed."
    return speed if step.is_right is None else f"{'Right' if step.is_right else 'Wrong'}. {speed}"
