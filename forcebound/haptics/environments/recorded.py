"""The answers of an environment in a recording."""

from bisect import bisect_left
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeAlias

import msgspec

from forcebound import mcap_file
from forcebound.errors import ConfigError
from forcebound.files import content_of, version_of
from forcebound.haptics.environments import Environment, EnvironmentModel
from forcebound.messages.packets import TOPIC_OF, Contact, DeviceState, EnvironmentReply, Vector
from forcebound.messages.topology import HAND, node_name


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
        hand: Whose replies, of a recording with several; empty: those to the hand of the same name.
    """

    file: Path
    hand: str = ""

    def check_files(self) -> None:
        _read(self.file, version_of(self.file))

    def check_hands(self, hands: tuple[str, ...]) -> None:
        known = _read(self.file, version_of(self.file))
        missing = [name for name in hands if (self.hand or name) not in known]
        if missing and HAND not in known:
            got = self.hand or missing[0]
            expected = f"expected one of {', '.join(known)}, the hands of {self.file}"
            raise ConfigError(f"hand: {expected}; got {got!r}", field="hand")

    def open(self, axes: int) -> "_OpenRecorded":
        return _OpenRecorded(_read(self.file, version_of(self.file)), self.hand, axes)


class _State(msgspec.Struct):
    seq: int
    time_ns: int
    elapsed: float


class _Reply(msgspec.Struct):
    device_seq: int
    device_time_ns: int
    force: Vector  # N
    proxy: Vector | None = None
    normal: Vector | None = None


_STATES, _REPLIES = TOPIC_OF[DeviceState], TOPIC_OF[EnvironmentReply]
_Answers: TypeAlias = dict[float, _Reply]  # by the time since the force engaged, in s


class _Launch(msgspec.Struct):
    hands: dict[str, Any] = {}


class _OpenRecorded(Environment):
    def __init__(self, answers: dict[str, _Answers], hand: str, axes: int) -> None:
        self._answers = {name: (list(one), list(one.values())) for name, one in answers.items()}
        self._hand, self._axes = hand, axes
        self._replies: dict[str, _Reply | None] = {}

    def force(self, user: str, position: Vector, velocity: Vector, elapsed: float) -> Vector:
        name = self._hand or user
        times, answers = self._answers[name if name in self._answers else HAND]
        self._replies[user] = None
        if not times[0] <= elapsed <= times[-1]:
            return (0.0,) * self._axes
        after = bisect_left(times, elapsed)
        is_before_nearer = after > 0 and elapsed - times[after - 1] < times[after] - elapsed
        reply = self._replies[user] = answers[after - is_before_nearer]
        return self._fitted(reply.force)

    def contact(self, user: str) -> Contact | None:
        reply = self._replies.get(user)
        if reply is None or reply.proxy is None or reply.normal is None:
            return None
        if len(reply.force) > self._axes:
            return None
        return Contact(self._fitted(reply.proxy), self._fitted(reply.normal))

    def _fitted(self, vector: Vector) -> Vector:
        return vector[: self._axes] + (0.0,) * (self._axes - len(vector))


@lru_cache(maxsize=2)
def _read(file: Path, version: tuple[int, int]) -> dict[str, _Answers]:
    """Return the answers to each hand by the time of the state, in s since the force engaged.

    If the recording begins later than that, the times count from its beginning. Kept for one
    ``version`` of the file: a launch reads it to check it, and once more to open it.
    """
    hands: Iterable[str] = ()
    with content_of(file):
        for content in mcap_file.readable(file, ()):
            if not isinstance(content, tuple) and content.name == mcap_file.METADATA_NAME:
                launch = msgspec.json.decode(content.metadata.get("launch", "{}"), type=_Launch)
                hands = launch.hands
    return {hand: _answers_to(hand, file) for hand in hands or (HAND,)}


def _answers_to(hand: str, file: Path) -> _Answers:
    asked_on, answered_on = node_name(hand, _STATES), node_name(hand, _REPLIES)
    states: list[_State] = []
    replies: list[_Reply] = []
    with content_of(file):
        for content in mcap_file.readable(file, (asked_on, answered_on)):
            if isinstance(content, tuple) and content[0] == asked_on:
                states.append(msgspec.json.decode(content[1], type=_State))
            elif isinstance(content, tuple):
                with suppress(msgspec.ValidationError):  # a number that is not finite is null
                    replies.append(msgspec.json.decode(content[1], type=_Reply))
    times: dict[tuple[int, int], float] = {}
    start, last = states[0].elapsed if states else 0.0, 0.0
    for state in states:
        if state.elapsed < last:
            break  # the device was lost, and begins again
        last = state.elapsed
        times[state.seq, state.time_ns] = last - start
    asked = ((times.get((reply.device_seq, reply.device_time_ns)), reply) for reply in replies)
    answers = {time: reply for time, reply in asked if time is not None}
    if not answers or last == 0.0:
        raise ConfigError(
            f"{file} has no reply to a state with an engaged force: nothing to answer"
        )
    return dict(sorted(answers.items()))
