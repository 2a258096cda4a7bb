"""The answers of an environment in a recording."""

from bisect import bisect_left
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple, cast

import msgspec

from forcebound import mcap_file
from forcebound.errors import ConfigError
from forcebound.files import content_of, version_of
from forcebound.haptics.environments import Environment, EnvironmentModel
from forcebound.messages.packets import TOPIC_OF, Contact, DeviceState, EnvironmentReply, Vector


@dataclass(frozen=True)
class RecordedEnvironment(EnvironmentModel):
    """Answers again what an environment in a recording answered, wherever the hand is now.

    It looks at the time alone, which counts from when the force engaged, or from the recording's
    beginning if that is later. The answer is that to the recorded state nearest in time; before the
    first and after the last one it is zero force. Forces that do not depend on where the hand is
    can give it energy: such an environment is not passive, and only the law bounds it.

    Axes that the recording lacks get no force; those that the device lacks are left out, and the
    contact with them.

    Attributes:
        file: A recording (``.mcap``) with states of the device and replies of the environment.
    """

    file: Path

    def check_files(self) -> None:
        _read(self.file, version_of(self.file))

    def open(self, axes: int) -> "_OpenRecorded":
        return _OpenRecorded(*_read(self.file, version_of(self.file)), axes)


class _Answer(NamedTuple):
    force: Vector  # N
    contact: Contact | None  # None: free motion


class _OpenRecorded(Environment):
    def __init__(self, times: tuple[float, ...], answers: tuple[_Answer, ...], axes: int) -> None:
        self._times = times  # s since the force engaged
        self._answers = [_fitted(answer, axes) for answer in answers]
        self._nothing = _Answer((0.0,) * axes, None)
        self._answer = self._nothing

    def force(self, user: str, position: Vector, velocity: Vector, elapsed: float) -> Vector:
        times = self._times
        self._answer = self._nothing
        if times[0] <= elapsed <= times[-1]:
            after = bisect_left(times, elapsed)
            is_before_nearer = after > 0 and elapsed - times[after - 1] < times[after] - elapsed
            self._answer = self._answers[after - is_before_nearer]
        return self._answer.force

    def contact(self, user: str) -> Contact | None:
        return self._answer.contact


def _fitted(answer: _Answer, axes: int) -> _Answer:
    """An answer for a device with this number of axes."""
    if len(answer.force) == axes:
        return answer
    more = (0.0,) * (axes - len(answer.force))
    contact = answer.contact if more else None
    if contact is not None:
        contact = Contact(contact.proxy + more, contact.normal + more)
    return _Answer(answer.force[:axes] + more, contact)


_STATES, _REPLIES = TOPIC_OF[DeviceState], TOPIC_OF[EnvironmentReply]


class _State(msgspec.Struct):
    seq: int
    time_ns: int
    elapsed: float


_Numbers = tuple[float | None, ...]  # one that is not finite is recorded as null


class _Reply(msgspec.Struct):
    device_seq: int
    device_time_ns: int
    force: _Numbers
    proxy: _Numbers | None = None
    normal: _Numbers | None = None


@lru_cache(maxsize=2)
def _read(file: Path, version: tuple[int, int]) -> tuple[tuple[float, ...], tuple[_Answer, ...]]:
    """Return the times of the answered states, in s since the force engaged, and the answers.

    If the recording begins later than that, the times count from its beginning. Kept for one
    ``version`` of the file: a launch reads it to check it, and once more to open it.
    """
    states: list[_State] = []
    replies: list[_Reply] = []
    with content_of(file):
        for content in mcap_file.readable(file, (_STATES, _REPLIES)):
            if isinstance(content, tuple):
                topic, data = content
                if topic == _STATES:
                    states.append(msgspec.json.decode(data, type=_State))
                else:
                    replies.append(msgspec.json.decode(data, type=_Reply))
        answers = _by_time(states, replies)
    if not answers:
        raise ConfigError(
            f"{file} has no reply to a state with an engaged force: nothing to answer"
        )
    return tuple(answers), tuple(answers.values())


def _by_time(states: list[_State], replies: list[_Reply]) -> dict[float, _Answer]:
    """Return the answers by the time of the state; empty if no force engaged."""
    times: dict[tuple[int, int], float] = {}
    start = states[0].elapsed if states else 0.0
    last = 0.0
    for state in states:
        if state.elapsed < last:
            break  # the device was lost, and begins again
        last = state.elapsed
        times[state.seq, state.time_ns] = last - start
    answers = {}
    for reply in replies:
        time = times.get((reply.device_seq, reply.device_time_ns))
        force = _finite(reply.force)
        if time is not None and force is not None:
            proxy, normal = _finite(reply.proxy), _finite(reply.normal)
            touched = None if proxy is None or normal is None else Contact(proxy, normal)
            answers[time] = _Answer(force, touched)
    return dict(sorted(answers.items())) if last > 0.0 else {}


def _finite(numbers: _Numbers | None) -> Vector | None:
    """The numbers; None if they are absent or one is not finite."""
    if numbers is None or any(x is None for x in numbers):
        return None
    return cast("Vector", numbers)
