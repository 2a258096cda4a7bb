"""A session on the live page without a browser: what is shown when, and what counts."""

import json
import re
import shutil
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from threading import Thread
from typing import Any

import numpy as np
import pytest
from test_user_study import SHORT, rows_in, study_of
from waiting import until

from forcebound.errors import ConfigError, RunError
from forcebound.graph.loader import build, read_template
from forcebound.interface.live import launch_unrecorded
from forcebound.lab.study.graph import Sample, StudyGraph, mover_of, played, wall_at_hand
from forcebound.lab.study.live import Approach, Inbox, LiveStudy
from forcebound.lab.study.observers import _approaching
from forcebound.lab.study.page import StudyServer
from forcebound.lab.study.plan import Block, Study
from forcebound.lab.study.session import Session
from forcebound.observe.page.feed import request_of
from forcebound.observe.page.pace import BURST, MOST_MESSAGES, Limit
from forcebound.run.results import results_of
from forcebound.run.virtual import run_virtual

WALL, LINE, BEFORE = 0.010, 0.0, -0.020  # m
STAY = 0.3  # s, time of the device
TEXT = re.sub(r"band: \[.*\]", "band: [1 mm/s, 2 m/s]", SHORT).replace(
    "touch_time: 2", "touch_time: 0.3"
)


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Study:
    return study_of(TEXT, tmp_path_factory.mktemp("study"))


@pytest.fixture(scope="module")
def touched(study: Study, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The recording of a touch, at some 0.1 m/s."""
    file = tmp_path_factory.mktemp("touch") / "touch.mcap"
    config = study.config(study.pairs[0][0])
    run_virtual(_approaching(study, study.blocks["slow"], config, 0.1, 0.0, 0.0), record=file)
    return file


class FakeGraph:
    """A graph whose hand comes from before the line into the wall, unless it is held."""

    def __init__(self, touched: Path) -> None:
        self.movers, self.failure = {"pointer"}, ""
        self.calls: list[str] = []
        self.places: list[object] = []
        self.error: Exception | None = None  # raised by the next touch
        self.is_held = False  # before the wall
        self.early: list[Sample] = []  # that came while the recording was being started
        self.buttons = 0
        self._touched, self._time, self._is_placed = touched, 0.0, False

    def prepare(self, config: object) -> None:
        error, self.error = self.error, None
        if error is not None:
            raise error
        self.calls.append("prepare")

    def place(self, config: object) -> None:
        self.calls.append("place")
        self._is_placed, self._step = True, 0

    def clear(self) -> None:
        self.calls.append("clear")
        self._is_placed = False

    @contextmanager
    def recording(self, file: Path) -> Iterator[None]:
        shutil.copy(self._touched, file)
        yield

    def samples(self) -> list[Sample]:
        self._time += 0.1
        if self._is_placed and self.early:
            early, self.early = self.early, []
            return early
        if not self._is_placed:
            return [Sample(self._time, BEFORE, self.buttons)]
        self._step += 1
        way = BEFORE if self.is_held or self._step < 3 else 0.005 * (self._step - 2)
        return [Sample(self._time, way, self.buttons)]

    def point(self, place: object) -> None:
        self.places.append(place)

    def close(self) -> None:
        self.calls.append("close")


class Led:
    """A session that runs in a thread, and what its pages got."""

    def __init__(self, study: Study, folder: Path, touched: Path) -> None:
        self.folder, self.graph = folder / "p01", FakeGraph(touched)
        self.session = Session(study, folder, "p01", "rehearsal")
        self.sent: list[Any] = []
        self.notes: list[str] = []
        graph: Any = self.graph
        self.live = LiveStudy(self.session, graph, self.sent.append, self.notes.append)
        self._thread = Thread(target=self.live.run)

    def __enter__(self) -> "Led":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.live.inbox.put({"do": "stop"})
        self._thread.join()
        self.session.__exit__()

    @property
    def kind(self) -> str:
        return str(self.live.shown["kind"])

    def look(self) -> None:
        """Wait until all that has been sent so far was taken."""
        self.graph.places.clear()
        self.live.inbox.put({"do": "point", "place": 0.004})
        until(lambda: self.graph.places, "the pointer")

    def choose(self, choice: object = 1, step: str | None = None) -> None:
        number = self.live.shown["step"] if step is None else step
        self.live.inbox.put({"do": "choose", "step": number, "choice": choice})

    def reach(self, kind: str) -> None:
        """Wait for a step of a kind."""
        until(lambda: self.kind == kind, f"{kind}, not {self.kind}")

    def until(self, *kinds: str) -> None:
        """Leave what comes before steps of some kinds, with first answers."""
        chosen = ""

        def is_there() -> bool:
            nonlocal chosen
            shown = self.live.shown
            if shown["kind"] not in kinds and shown["choices"] and shown["step"] != chosen:
                chosen = shown["step"]
                self.choose(step=chosen)
            return shown["kind"] in kinds

        until(is_there, f"{kinds}, not {self.kind}")


@pytest.fixture
def led(study: Study, tmp_path: Path, touched: Path) -> Iterator[Led]:
    with Led(study, tmp_path, touched) as led:
        led.live.inbox.put({"do": "ready"})
        yield led


def test_a_session_leads_to_its_end_with_each_trial_once(led: Led) -> None:
    led.until("finished")
    rows = rows_in(led.folder)
    assert [int(row["trial"]) for row in rows] == list(range(1, 7))
    assert all(0.05 < float(row["speed_1"]) < 0.2 and not row["seed_1"] for row in rows)
    kinds = [message["kind"] for message in led.sent if message["type"] == "step"]
    assert kinds[:6] == ["wait", "noise", "instruction", "wait", "back", "go"]
    assert kinds.count("question") == 6
    assert kinds.count("feedback") == 2
    assert led.graph.calls.count("place") == led.graph.calls.count("clear") == 12
    scenes = [message["scene"] for message in led.sent if message.get("kind") == "go"]
    assert scenes[0] == {"line": pytest.approx(LINE), "wall": pytest.approx(WALL)}


def test_an_answer_to_another_step_and_what_is_no_answer_do_not_count(led: Led) -> None:
    led.until("question")
    *_, earlier, shown = (one["step"] for one in led.sent if one["type"] == "step")
    assert shown == led.live.shown["step"]
    for choice, step in ((0, shown), (3, shown), ("1", shown), (None, shown), (2, earlier)):
        led.choose(choice, step=step)
        led.live.inbox.put({"do": "nothing", "we": "know"})
        led.look()
    assert led.kind == "question"
    assert rows_in(led.folder) == []
    led.choose(2)
    led.choose(2)  # a second press of the same key
    led.reach("feedback")
    assert [row["answer"] for row in rows_in(led.folder)] == ["2"]


def test_no_step_can_be_answered_before_a_page_has_got_it(led: Led) -> None:
    led.until("finished")
    steps = [one["step"] for one in led.sent if one["type"] == "step"]
    assert len(set(steps)) == len(steps)
    assert steps != sorted(steps)  # none follows from the one before


def test_a_flood_of_messages_leaves_one_of_each_kind_and_the_last_word() -> None:
    inbox = Inbox()
    for place in range(100_000):
        inbox.put({"do": "point", "place": place})
    inbox.put({"do": "away"})
    inbox.put({"do": "ready"})
    inbox.put({"do": "away"})
    assert list(inbox.take(60.0)) == [
        {"do": "point", "place": 99_999},
        {"do": "ready"},
        {"do": "away"},
    ]
    assert list(inbox.take(0.0)) == []


def test_the_messages_of_a_flood_do_not_count_and_those_of_a_pointer_do() -> None:
    for rate, permitted in ((100, 1000), (10_000, MOST_MESSAGES * (10.0 + BURST))):
        limit = Limit()
        count = sum(limit.permits(1000.0 + i / rate) for i in range(10 * rate))
        assert count == pytest.approx(permitted, abs=2)
        assert limit.is_flooded == (rate == 10_000)


@pytest.mark.parametrize("level", ["NaN", "1e999", '"\\ud800"', "Infinity"])
def test_what_is_no_json_never_reaches_a_study(level: str) -> None:
    assert request_of('{"do": "level", "level": 0.5}') == {"do": "level", "level": 0.5}
    assert request_of(f'{{"do": "level", "level": {level}}}') is None
    for text in ("[]", "1", '{"do": ["level"]}', "{}", "[" * 100_000, b"\xff"):
        assert request_of(text) is None


def test_a_button_of_the_handle_answers_once_it_is_pressed_again(led: Led) -> None:
    led.until("go")
    led.graph.buttons = 0b10  # held while the question comes
    led.until("question")
    assert rows_in(led.folder) == []
    led.graph.buttons = 0
    sent = led.graph._time
    until(lambda: led.graph._time > sent + 0.5, "some looks")
    led.graph.buttons = 0b10
    led.reach("feedback")
    assert [row["answer"] for row in rows_in(led.folder)] == ["2"]


def test_a_touch_begins_again_when_its_page_has_gone(led: Led) -> None:
    led.graph.is_held = True
    led.until("go")
    led.live.inbox.put({"do": "away"})
    led.reach("wait")
    assert led.graph.calls[-1] == "clear"  # no force while nobody sees the page
    led.graph.is_held = False
    led.live.inbox.put({"do": "ready"})
    led.until("question")
    assert led.session.step.trial is not None
    assert led.session.step.trial.number == 1
    led.choose()
    led.reach("feedback")
    assert [row["touches_1"] for row in rows_in(led.folder)] == ["1"]


def test_a_contact_before_the_recording_is_no_contact(led: Led) -> None:
    """A hand that was at the wall, and is back behind the line, when the recording begins."""
    places = (BEFORE, WALL + 0.001, BEFORE)
    led.graph.early = [Sample(0.01 * i, place, 0) for i, place in enumerate(places, start=1)]
    led.graph.is_held = True
    led.until("go")
    begun = led.graph._time
    until(lambda: led.graph._time > begun + 1.0, "longer than the touch lasts")
    assert led.graph.calls.count("place") == 1  # no next touch
    led.graph.is_held = False
    led.until("question")


@pytest.mark.parametrize("error", [RunError("the device is lost"), OSError(28, "no space")])
def test_an_error_is_said_and_the_touch_comes_again(led: Led, error: Exception) -> None:
    led.graph.error = error
    led.until("problem")
    assert "close" in led.graph.calls  # no force
    assert led.notes == [str(error)]
    assert str(error) == led.live.shown["text"]
    led.choose()
    led.until("question")


def test_a_break_lasts_and_the_graph_rests(
    study: Study, tmp_path: Path, touched: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    own = replace(study, breaks=replace(study.breaks, every=1, duration=3600.0), noise="none")
    with Led(own, tmp_path, touched) as led:
        led.live.inbox.put({"do": "ready"})
        led.until("break")
        assert led.graph.calls[-1] == "close"
        assert 3000.0 < led.live.describe()["remaining"] <= 3600.0
        led.choose()
        led.live.inbox.put({"do": "point", "place": 0.0})
        until(lambda: led.graph.places, "the messages to be read")
        assert led.kind == "break"
        clock = time.monotonic
        monkeypatch.setattr(time, "monotonic", lambda: clock() + 3600.0)
        led.until("question")


def test_a_touch_out_of_the_band_says_why(study: Study, tmp_path: Path, touched: Path) -> None:
    slow = replace(study.blocks["slow"], band=(0.3, 0.4))
    with Led(replace(study, blocks={**study.blocks, "slow": slow}), tmp_path, touched) as led:
        led.live.inbox.put({"do": "ready"})
        led.until("go")
        until(lambda: "Too slow." in led.live.shown["text"], "the reason")


def test_the_marker_has_the_colour_of_the_mean_speed_from_the_line_on() -> None:
    way = Approach(LINE, WALL, Block((0.02, 0.05)))
    for seconds, place, colour in (
        (0.0, -0.001, None),
        (0.1, 0.0, None),  # at the line
        (0.2, 0.001, 0),  # 10 mm/s
        (0.3, 0.008, 1),  # 40 mm/s
        (0.31, 0.0101, 1),  # 48 mm/s, in contact
        (0.4, 0.03, 1),  # behind the wall it stays
    ):
        way.take(Sample(seconds, place, 0))
        assert way.colour == colour, seconds
    assert way.contact == 0.31
    fast = Approach(LINE, WALL, Block((0.02, 0.05)))
    for seconds, place in ((0.0, 0.0), (0.05, 0.009)):
        fast.take(Sample(seconds, place, 0))
    assert fast.colour == 2


class FakePage:
    may_change = True

    def __init__(self) -> None:
        self.received: list[Any] = []

    def send(self, text: str) -> None:
        self.received.append(json.loads(text)["type"])


def test_the_newest_page_leads_and_the_one_before_learns_it(led: Led) -> None:
    server: Any = object.__new__(StudyServer)
    server.pages, server.live = set(), led.live
    old, new, audience = FakePage(), FakePage(), FakePage()
    audience.may_change = False
    led.until("question")
    answer = {"do": "choose", "step": led.live.shown["step"], "choice": 2}
    for page in (old, new, audience):
        server.opened(page)
    assert (old.received, new.received, audience.received) == (["elsewhere"], [], [])
    server.receive(old, answer)
    server.receive(new, {"do": "stop"})
    server.receive(new, {"do": "point", "place": 0.001})
    until(lambda: led.graph.places == [0.001], "the pointer")
    assert led.kind == "question"
    server.closed(old)
    server.receive(new, answer)
    led.reach("feedback")


@pytest.mark.parametrize(
    ("file", "settings", "mover"),
    [
        ("stiff_wall", [], "pointer"),
        ("pointer_wall", [], "pointer"),
        ("odrive_knob", [], "itself"),
        ("odrive_knob", ["device:=/dev/ttyACM0"], "person"),
    ],
)
def test_a_person_moves_what_is_at_a_port(file: str, settings: list[str], mover: str) -> None:
    assert mover_of(build(read_template(file), settings)) == mover


def test_a_live_clock_gets_the_hold_limit_that_lateness_asks_for(study: Study) -> None:
    simulated = study.config(study.pairs[0][0])
    assert simulated.only.servo.hold_limit == 1
    assert played(simulated, 0.010).only.servo.hold_limit == "auto"


def test_a_wall_that_changes_with_time_is_refused() -> None:
    assert wall_at_hand(build(read_template("stiff_wall"))) == WALL
    with pytest.raises(ConfigError, match="stays"):
        wall_at_hand(build(read_template("time_varying_wall")))


@pytest.mark.live
@pytest.mark.xdist_group("processes")
def test_between_two_touches_there_is_no_force_and_each_has_its_ledger(tmp_path: Path) -> None:
    """The hand is pushed into a wall, which is taken away, and comes back under the same law."""
    study = study_of(TEXT.replace("launch: paper_wall", "launch: stiff_wall"), tmp_path)
    config = study.config(study.pairs[0][0])
    graph = StudyGraph(study, launch_unrecorded)

    def push(happened: Callable[[float], bool], what: str, target: float = WALL + 0.015) -> None:
        seen: list[Sample] = []  # where the hand is asked to be, one after the other

        def look() -> bool:
            graph.point(target)
            for sample in graph.samples():
                seen.append(sample) if happened(sample.position) else seen.clear()
            return bool(seen) and seen[-1].time - seen[0].time >= STAY

        until(look, what)

    try:
        graph.prepare(config)
        graph.place(config)
        with graph.recording(tmp_path / "first.mcap"):
            push(lambda place: place > WALL + 0.0003, "contact")
            started = graph._graph
        graph.clear()
        with graph.recording(tmp_path / "between.mcap"):
            push(lambda place: place > WALL + 0.010, "the way through the wall's place")
        push(lambda place: place < LINE, "the way back", BEFORE)
        graph.prepare(config)
        assert graph._graph is started  # it goes on
        with graph.recording(tmp_path / "second.mcap"):
            graph.place(config)
            push(lambda place: place > WALL + 0.0003, "contact again")
    finally:
        graph.close()
    graph.clear()  # as after a graph that has failed in the middle of a touch
    first, between, second = (
        results_of(tmp_path / f"{name}.mcap")["hand"] for name in ("first", "between", "second")
    )
    for touch in (first, second):
        assert np.abs(touch.columns.commanded_force).max() > 0.0
    assert np.abs(between.columns.applied_force).max() == 0.0
    laws = [event.data["law"] for event in second.events if event.event == "law_changed"]
    assert laws == ["certified", "more_conservative"]
