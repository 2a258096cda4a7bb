"""A participant's session: what comes next, the answers, and the data folder.

:class:`Session` is a state machine without clocks, sockets or graphs. Its caller, the live page or
a simulated observer, asks for :attr:`Session.step` and reports what came of it:

* ``instruction``, ``break``, ``feedback``: ``go_on()`` when it is over;
* ``touch``: ``begin()`` when its graph starts, ``touched(measures)`` when it has ended;
* ``question``: ``answer(1 or 2, response_time)``; when it returns, the row is on the disk.

Asking for the step changes nothing, so a page that is loaded again just asks again. A session that
is opened again goes on with the trial after the last answer: all that it needs is in the folder.
"""

import csv
import errno
import fcntl
import io
import json
import os
import platform
import re
import shutil
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from random import Random
from typing import Any, Literal, TypeAlias

from forcebound.errors import ConfigError
from forcebound.files import reason
from forcebound.graph.graph import GraphConfig
from forcebound.graph.resolved import to_document
from forcebound.lab.engine import Row, write_json
from forcebound.lab.study.data import (
    ABOUT,
    COLUMNS,
    REGISTER,
    STUDY,
    TRIALS,
    Kind,
    Participant,
    Register,
    read_document,
    read_participant,
    read_trials,
)
from forcebound.lab.study.measures import Measures
from forcebound.lab.study.order import Trial, next_trial, total
from forcebound.lab.study.plan import Study
from forcebound.messages.events import TrialEvent
from forcebound.run.results import run_metadata
from forcebound.run.run_directory import try_lock

Mark: TypeAlias = Callable[[TrialEvent, str, Mapping[str, str]], None]

RECORDINGS = "recordings"
LOCK = ".lock"  # no identifier, since the study's folder has one beside those of participants
BYTES_PER_SECOND = 1_000_000  # of a recording, a bound; one axis at 1 kHz takes 0.24 MB
ROOM = 10_000_000  # bytes for all else


@dataclass(frozen=True)
class Step:
    """The next step; each kind of step has the fields that its comment names."""

    kind: Literal["instruction", "break", "touch", "question", "feedback", "finished"]
    text: str = ""  # instruction, question
    duration: float = 0.0  # of a break, at least; s
    trial: Trial | None = None  # touch, question
    interval: int = 0  # touch: 1 or 2
    config: GraphConfig | None = None  # touch: its graph, whose force begins at zero
    recording: Path | None = None  # touch: where to
    is_right: bool | None = None  # feedback; None where no answer is right or wrong
    in_band: tuple[bool, ...] = ()  # feedback, of each touch


class Session:
    """A session of one participant; a context manager, which keeps the folder for itself.

    Args:
        study: What is presented and asked.
        folder: Of the study's data; the participant has a folder in it.
        participant: Identifier: letters, digits, ``-`` and ``_``; never a name.
        kind: Who takes part; an identifier keeps its kind.
        mark: Takes trial events; see :class:`forcebound.lab.study.markers.Markers`.
        observer: Parameters of a simulated participant, which keeps them.

    Raises:
        ConfigError: If the identifier is not valid, the folder has data of another study or kind,
            is in use or cannot be written, or the disk has no room for the remaining trials.
    """

    def __init__(
        self,
        study: Study,
        folder: Path,
        participant: str,
        kind: Kind = "person",
        mark: Mark = lambda event, message, data: None,
        observer: str = "",
    ) -> None:
        if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_-]{0,31}", participant):
            raise ConfigError(
                "a participant's identifier has up to 32 letters, digits, - and _ (and is never a"
                f" name), got {participant!r}"
            )
        if other := _written_otherwise(participant, folder):
            raise ConfigError(
                f"{folder} has data of {other}: {participant} looks like another way to write it;"
                f" go on as {other}, or choose an identifier that differs by more"
            )
        self.study, self.kind, self.folder, self._mark = study, kind, folder / participant, mark
        self._observer, self.rows = observer, list[Row]()
        try:
            (self.folder / RECORDINGS).mkdir(parents=True, exist_ok=True)
            lock = os.open(self.folder / LOCK, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
            with ExitStack() as stack:
                stack.callback(os.close, lock)
                if not try_lock(lock):
                    raise ConfigError(f"{participant} takes part in another session just now")
                with (folder / LOCK).open("a") as others:  # two may come at the same time
                    fcntl.flock(others, fcntl.LOCK_EX)
                    self._register(participant)
                self._close = stack.pop_all().close  # frees the lock
        except OSError as error:
            raise ConfigError(f"cannot write into {self.folder}: {reason(error)}") from error
        self._instructed = ""  # block
        self._rested = len(self.rows)  # rows at the last break, or the beginning
        self._feedback: Step | None = None
        self._begin_trial()

    def __enter__(self) -> "Session":
        return self

    def __exit__(self, *error: object) -> None:
        self._close()

    def _register(self, participant: str) -> None:
        """Take what the folder has of the participant; give a new one a number, after all checks.

        Nothing is written before, so that a start that is refused uses up no number.
        """
        root, study = self.folder.parent, self.study
        mine: Row = {"study": study.name, "digest": study.digest, "kind": self.kind}
        register = _register_of(root, mine)
        _check_same(root, register, mine)
        mine |= {"observer": self._observer}
        about = Participant(participant=participant, number=register.next_number, **mine)
        if is_known := (self.folder / ABOUT).exists():
            about = read_participant(self.folder)
            _check_same(self.folder, about, mine)
        size, self.number = 0, about.number
        if is_known or (self.folder / TRIALS).exists():
            self.rows, size = read_trials(study, self.folder, about)
        self._check_room()
        about = self._opened(about)
        if not (root / REGISTER).exists():
            (root / ".gitignore").write_text("*\n")  # data of people
        self._end_rows(size)
        later = max(register.next_number, about.number + 1)
        write_json(root / REGISTER, asdict(replace(register, next_number=later)))
        write_json(self.folder / ABOUT, asdict(about))

    def _opened(self, about: Participant) -> Participant:
        """Return the participant with this session, whose study and launch files are written."""
        configs = {one: self.study.config(one) for pair in self.study.pairs for one in pair}
        opened = {
            "opened": _now(),
            "machine": f"{platform.platform()}, {os.cpu_count()} cores",
            "versions": json.loads(run_metadata(next(iter(configs.values())))["versions"]),
        }
        launch = [{**asdict(one), "launch": to_document(c)} for one, c in configs.items()]
        (self.folder / STUDY).write_text(self.study.text, encoding="utf-8")
        write_json(self.folder / "launch.json", launch)
        return replace(about, sessions=(*about.sessions, opened))

    def _end_rows(self, size: int) -> None:
        """Cut off a row that was being written, after ``size`` bytes; end the one before."""
        with (self.folder / TRIALS).open("ab+") as rows:
            rows.truncate(size)
            rows.seek(max(size - 1, 0))
            if rows.read() not in (b"", b"\n"):
                rows.write(b"\n")
        if not size:
            self._append(dict(zip(COLUMNS, COLUMNS, strict=True)))

    def _append(self, row: Row) -> None:
        """Write a row to the disk; leave no part of it there if the disk is full."""
        text = io.StringIO()
        csv.DictWriter(text, COLUMNS, lineterminator="\n").writerow(row)
        data = text.getvalue().encode()
        with (self.folder / TRIALS).open("ab", buffering=0) as file:
            size = file.tell()
            try:
                if file.write(data) < len(data):
                    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
                os.fsync(file.fileno())
            except OSError:
                file.truncate(size)
                raise

    def _check_room(self) -> None:
        left = (total(self.study) or 100) - len(self.rows)
        recorded = 0.0 if self.kind == "simulated" else 2 * left * (self.study.touch_time + 3.0)
        needed = ROOM + round(recorded * BYTES_PER_SECOND)
        free = shutil.disk_usage(self.folder).free
        if free < needed:
            words = f"{needed / 1e6:.0f} MB for the remaining trials, it has {free / 1e6:.0f} MB"
            raise ConfigError(f"the disk of {self.folder} needs {words}")

    def _begin_trial(self) -> None:
        self._trial = next_trial(self.study, self.number, self.rows)
        self._touches: list[dict[str, Any]] = []
        self._attempt, self._started = 1, ""

    @property
    def progress(self) -> tuple[int, int | None]:
        """Trials that are answered, and all, training included; None: a staircase decides."""
        return len(self.rows), total(self.study)

    @property
    def step(self) -> Step:
        """The next step; asking changes nothing."""
        trial, every = self._trial, self.study.breaks.every
        if self._feedback is not None:
            return self._feedback
        if trial is None:
            return Step("finished")
        if self._instructed != trial.block:
            return Step("instruction", self.study.blocks[trial.block].text)
        if every and len(self.rows) - self._rested >= every:
            return Step("break", duration=self.study.breaks.duration)
        if len(self._touches) == 2:
            return Step("question", self.study.question, trial=trial)
        interval = len(self._touches) + 1
        config = self.study.config(trial.stimuli[interval - 1])
        chance = Random(f"{trial.seed}/{interval}/{self._attempt}")  # no two touches share it
        config = replace(config, seed=chance.randrange(2**31))
        file = self.folder / RECORDINGS / f"{trial.number:04d}-{interval}-{self._attempt}.mcap"
        return Step("touch", trial=trial, interval=interval, config=config, recording=file)

    def go_on(self) -> None:
        """Leave an instruction, a break or a feedback."""
        kind = self.step.kind
        if kind == "feedback":
            self._feedback = None
        elif kind == "instruction" and self._trial:
            self._instructed = self._trial.block
        elif kind == "break":
            self._rested = len(self.rows)

    def begin(self) -> None:
        """Note that a touch begins now."""
        trial, interval, law, seed = self._touch()
        if not self._started:  # else a touch is repeated
            self._started = _now()
            self._tell("trial_begins", trial)
        about = {"interval": interval, "law": law, "seed": seed}
        self._tell("touch_begins", trial, trial.stimuli[interval - 1].columns | about)

    def touched(self, measures: Measures) -> bool:
        """Take the measures of a touch; return whether its speed was in the band, or need not."""
        trial, interval, law, seed = self._touch()
        self._tell("touch_ends", trial, {"interval": interval, **asdict(measures)})
        repeat = self.study.guidance.repeat
        if repeat != "nothing" and not self.study.blocks[trial.block].holds(measures.speed):
            self._attempt += 1
            self._touches = [] if repeat == "trial" else self._touches
            return False
        about = {"law": law, "seed": seed, "touches": self._attempt}
        self._touches.append(about | asdict(measures))
        self._attempt = 1 if repeat == "touch" else self._attempt
        return True

    def _touch(self) -> tuple[Trial, int, str, int | None]:
        step = self.step
        assert step.kind == "touch", f"the step is {step.kind}"
        assert step.trial is not None
        assert step.config is not None
        # What is random in a live graph is drawn from its own seed.
        seed = step.config.seed if self.kind == "simulated" else None
        return step.trial, step.interval, step.config.only.servo.law, seed

    def answer(self, interval: Literal[1, 2], response_time: float | None = None) -> None:
        """Take the answer; when this returns, its row is on the disk.

        ``response_time`` is since the end of the second touch, in s; None: nobody was timed.

        Raises:
            OSError: If it cannot be written; the question is still open then.
        """
        trial = self.step.trial
        assert trial is not None
        assert len(self._touches) == 2, f"the step is {self.step.kind}"
        counted = 1 if trial.counted_first else 2
        row: Row = {
            **trial.columns,
            "chose_counted": int(interval == counted),
            "kind": self.kind,
            "answer": interval,
            "response_time": response_time,
            "started": self._started,
            "answered": _now(),
        }
        for place, touch in enumerate(self._touches, start=1):
            row |= {f"{name}_{place}": value for name, value in touch.items()}
        row = {name: "" if row[name] is None else str(row[name]) for name in COLUMNS}
        self._append(row)
        self.rows.append(row)
        self._tell("trial_ends", trial, {"answer": interval})
        if trial.phase == "training" and self.study.training.feedback:
            block, is_right = self.study.blocks[trial.block], interval == counted
            in_band = tuple(block.holds(touch["speed"]) for touch in self._touches)
            known = is_right if trial.counted.level else None
            self._feedback = Step("feedback", is_right=known, in_band=in_band)
        self._begin_trial()

    def _tell(self, event: TrialEvent, trial: Trial, data: Mapping[str, object] = {}) -> None:
        about = {"trial": trial.number, "block": trial.block, "phase": trial.phase, **data}
        texts = {name: str(value) for name, value in about.items() if value not in (None, "")}
        self._mark(event, f"{event.replace('_', ' ')}: {trial.number}", texts)


def _register_of(root: Path, new: Row) -> Register:
    """Return the register of a study's folder: a new one, or as participants without one ask."""
    if (root / REGISTER).exists():
        return read_document(root / REGISTER, Register)
    people = [read_participant(file.parent) for file in sorted(root.glob(f"*/{ABOUT}"))]
    kept = {key: getattr(people[0], key) for key in new} if people else new
    return Register(**kept, next_number=1 + max((one.number for one in people), default=-1))


def _check_same(folder: Path, found: Register | Participant, mine: Row) -> None:
    """Refuse a folder that has data of another study, kind of participant or observer."""
    for key, value in mine.items():
        if (was := getattr(found, key)) != value:
            other = "version of the study" if key == "digest" else f"{key}: {was!r}, not {value!r}"
            raise ConfigError(
                f"{folder} has data of another {other}; choose another folder (--output)"
                " or identifier"
            )


def _written_otherwise(participant: str, folder: Path) -> str | None:
    """Return a participant of the folder who differs by case or leading zeros only; or None."""
    others = [one.parent.name for one in folder.glob(f"*/{ABOUT}")]
    alike = [other for other in others if _plain(other) == _plain(participant)]
    return None if participant in alike or not alike else alike[0]


def _plain(participant: str) -> str:
    return re.sub(r"(?<!\d)0+(?=\d)", "", participant.casefold())


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="milliseconds")
