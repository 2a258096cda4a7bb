"""Recordings as demonstrations that learning reads: rows of features, episode by episode.

A feature has the values of columns of a recording, which have the names of its tables
(:mod:`forcebound.recordings.export`). The rows of a data set are ticks of one hand, or the last of
them at or before each frame. They have, of that tick, the state and the telemetry; of every other
hand its last tick at or before it; and the reply of the environment to that tick, or to the last
one before it that was answered. A tick without one of these, such as those before the first reply,
is no row.

A recording is read as a stream. Only the chosen columns of an episode are held in memory.
"""

import re
from array import array
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from itertools import chain, groupby
from math import nan
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from forcebound.errors import ConfigError
from forcebound.files import content_of
from forcebound.messages.packets import (
    TOPIC_OF,
    DeviceState,
    EnvironmentReply,
    Packet,
    Telemetry,
)
from forcebound.messages.topology import HAND
from forcebound.recordings.clock import UTC_OFFSET, utc_ns
from forcebound.recordings.episodes import Episode, episodes_of
from forcebound.recordings.export import columns_of, described, row_of
from forcebound.recordings.launched import launched
from forcebound.recordings.recording import Recording

NEXT = "+1"  # after the name of a column: its value in the next row
# The first that has a field gives it.
_STATE, _TELEMETRY, _REPLY = _TOPICS = tuple(
    TOPIC_OF[kind] for kind in (DeviceState, Telemetry, EnvironmentReply)
)
_ABOUT = ("names", "units", "meanings")  # of the columns of a feature, as attributes of a file
LONGEST_LINE = 100  # characters of a feature's columns in a summary
_SETTLING_NS = 2_000_000_000  # packets of an episode may be so late in the file


class Column(NamedTuple):
    """A column of a recording: one number of each row."""

    hand: str
    topic: str
    name: str  # in the table of that topic
    is_next: bool
    label: tuple[str, str, str]  # name, unit and meaning in a data set


class Demonstration(NamedTuple):
    """The rows of one episode.

    Attributes:
        about: Number of rows, the task, the name of the recording's file, number of the episode.
        stamps: ``timestamp``, s from the first row, that of the frame if there are frames;
            ``time_ns``, ns, when the tick began, on the devices' clock; and ``utc_ns`` of that, if
            every recording of the data set knows it. Each of shape (n,).
        features: By name, shape (n, columns), float64.
    """

    about: dict[str, Any]
    stamps: dict[str, NDArray[Any]]
    features: dict[str, NDArray[np.float64]]


class DataSet:
    """The kept episodes of some recordings; as text: what it has, and what was left out.

    Args:
        recordings: At least one, each with all its topics.
        features: Columns by the name of the feature; none: leaves out that feature. These come
            in place of those, or beside those, that suit the hands.
        fps: Frames per second; None: a row for each tick.
        task: What is done, in words; default: the description of the launch file.
        takes_all: Whether discarded and open episodes are taken, too.

    Attributes:
        features: Names, units and meanings of each feature's columns, by these words.
        fps: Rows per second.
        device: The kind of the device whose ticks are the rows.

    Raises:
        ConfigError: If a column is unknown, no episode is kept, or the recordings differ in what
            their features are.
    """

    def __init__(
        self,
        recordings: Sequence[Recording],
        features: Mapping[str, Sequence[str]] | None = None,
        fps: int | None = None,
        task: str | None = None,
        takes_all: bool = False,
    ) -> None:
        self._has_frames, self._task = fps is not None, task
        self._parts: list[tuple[Recording, dict[str, list[Column]], list[Episode]]] = []
        self._notes: dict[str, None] = {}
        self._counts = [0, 0]  # episodes and rows of the last reading
        lacking = [one.path for one in recordings if UTC_OFFSET not in one.metadata]
        self._has_utc = not lacking
        if 0 < len(lacking) < len(recordings):
            self._notes[f"left out: utc_ns, since {lacking[0]} was not recorded live"] = None
        about = []
        for recording in recordings:
            with content_of(recording.path):
                found = _features(recording, features or {})
                episodes = episodes_of(recording)
                self._parts.append((recording, found, [e for e in episodes if e.kept or takes_all]))
                for one in () if takes_all else episodes:
                    if not one.kept:
                        why = "open when the recording ended" if one.is_open else "discarded"
                        self._note(recording, one, why)
                self._clock = found.get("state", next(iter(found.values())))[0].hand
                device = launched(recording.by_hand[self._clock].launch).device
                self.fps, self.device = float(fps or device.rate or 0.0), device.kind
                labels = {name: [one.label for one in columns] for name, columns in found.items()}
                about.append((labels, self.fps))
        paths = ", ".join(str(recording.path) for recording in recordings)
        if any(one != about[0] for one in about):
            raise ConfigError(
                f"{paths} differ in hands, axes, signals or rate: export them apart, or choose"
                " features that are alike (--feature) and --fps"
            )
        if not any(chosen for _, _, chosen in self._parts):
            raise ConfigError(f"no episode was kept in {paths}: --all takes the others, too")
        self.features: dict[str, dict[str, list[str]]] = {
            name: {key: [row[n] for row in rows] for n, key in enumerate(_ABOUT)}
            for name, rows in about[0][0].items()
        }

    def _note(self, recording: Recording, episode: Episode, why: str) -> None:
        self._notes[f"left out: episode {episode.number} of {recording.path}, {why}"] = None

    def __str__(self) -> str:
        rows = f"frames at {self.fps:g} Hz" if self._has_frames else "ticks"
        lines = ["episodes: {}, rows: {}, ".format(*self._counts) + f"{rows} of {self._clock}"]
        for name, about in self.features.items():
            words: list[str] = []
            columns = zip(about["names"], about["units"], strict=True)
            for (of, unit), group in groupby(
                columns, lambda row: (row[0].rpartition(".")[0], row[1])
            ):
                numbers = "/".join(label.rpartition(".")[2] for label, _ in group)
                words.append(f"{of}.{numbers}".removeprefix(".") + (f" ({unit})" if unit else ""))
            line = f"{name}: {', '.join(words)}"
            if len(line) > LONGEST_LINE:
                whole = re.split(r"[/ ]", line[:LONGEST_LINE])[-1]
                line = f"{line[: LONGEST_LINE - len(whole)]}... ({len(about['names'])} columns)"
            lines.append(line)
        return "\n".join([*lines, *self._notes])

    def demonstrations(self) -> Iterator[Demonstration]:
        """Yield the episodes; their data are read from the files as they are asked for.

        Raises:
            ConfigError: If a recording is damaged, or no episode has a row.
        """
        self._counts = [0, 0]
        for recording, features, chosen in self._parts:
            columns = list(chain.from_iterable(features.values()))
            hands = dict.fromkeys([self._clock, *(column.hand for column in columns)])
            streams = [
                _ticks_of(recording.by_hand[hand], chosen, [c for c in columns if c.hand == hand])
                for hand in hands
            ]
            with content_of(recording.path):
                for ticks in zip(*streams, strict=True):
                    found = self._demonstration(recording, features, ticks)
                    if found is None:
                        self._note(recording, ticks[0].episode, "since a column has no value")
                        continue
                    self._counts[0] += 1
                    self._counts[1] += found.about["num_samples"]
                    yield found
        if not self._counts[0]:
            raise ConfigError("no episode has a row in which every column has a value")

    def _demonstration(
        self,
        recording: Recording,
        features: Mapping[str, Sequence[Column]],
        ticks: Sequence["_Ticks"],
    ) -> Demonstration | None:
        """Return the rows of an episode; None: there is none."""
        times = ticks[0].times
        for each in ticks:
            times = times[each.at(times)[0]]
        since = (times - times[:1]) * 1e-9
        if self._has_frames and times.size:
            frames = np.arange(int(since[-1] * self.fps) + 1)
            at = times[0] + np.rint(frames * (1e9 / self.fps)).astype(np.int64)
            times, since = times[np.searchsorted(times, at, "right") - 1], frames / self.fps
        values = {column: rows for each in ticks for column, rows in each.at(times)[1].items()}
        count = times.size - any(column.is_next for column in values)  # the last has no next one
        if count <= 0:
            return None
        stamps: dict[str, NDArray[Any]] = {"timestamp": since[:count], "time_ns": times[:count]}
        if self._has_utc:
            stamps["utc_ns"] = utc_ns(recording, times[:count])
        task = self._task or recording.launch.get("description") or recording.path.stem
        where = {"recording": recording.path.name, "episode": ticks[0].episode.number}
        return Demonstration(
            about={"num_samples": count, "task": task, **where},
            stamps=stamps,
            features={
                name: np.stack([values[one][one.is_next :][:count] for one in columns], axis=1)
                for name, columns in features.items()
            },
        )


class _Ticks:
    """Packets of one hand in an episode, as columns."""

    def __init__(self, episode: Episode, columns: Sequence[Column]) -> None:
        self.episode = episode
        self._columns = {topic: [c for c in columns if c.topic == topic] for topic in _TOPICS}
        self._tables = {topic: (array("q"), array("q"), array("d")) for topic in _TOPICS}

    def add(self, packet: Packet, time_ns: int) -> None:
        topic, row = TOPIC_OF[type(packet)], row_of(packet)
        times, counts, values = self._tables[topic]
        times.append(time_ns)
        counts.append(packet.seq)
        values.extend(float(row.get(column.name, nan)) for column in self._columns[topic])

    @property
    def times(self) -> NDArray[np.int64]:
        """When the ticks of the episode began, ns."""
        times = np.array(self._tables[_STATE][0], np.int64)
        return times[times < self.episode.end_ns]

    def at(self, times: NDArray[np.int64]) -> tuple[NDArray[np.bool_], dict[Column, NDArray[Any]]]:
        """Return for each of these times whether there is a row, and the columns of these rows."""
        began, own = np.append(self.times, -1), {}
        own[_STATE] = np.searchsorted(began[:-1], times, "right") - 1
        ticks, found = began[own[_STATE]], own[_STATE] >= 0
        if self._columns[_TELEMETRY]:  # of the same tick: written after its state was read
            written, numbers, _ = self._tables[_TELEMETRY]
            own[_TELEMETRY] = np.searchsorted(written, ticks)
            number = np.append(self._tables[_STATE][1], -1)[own[_STATE]]
            found &= np.append(numbers, -1)[own[_TELEMETRY]] == number
        if self._columns[_REPLY]:
            answered = np.array(self._tables[_REPLY][0], np.int64)
            order = np.argsort(answered, kind="stable")
            last = np.searchsorted(answered, ticks, "right", sorter=order) - 1
            own[_REPLY] = np.append(order, -1)[last]
            found &= last >= 0
        values: dict[Column, NDArray[Any]] = {}
        for topic, columns in self._columns.items():
            table = np.array(self._tables[topic][2]).reshape(-1, max(len(columns), 1))
            values |= {column: table[own[topic][found], n] for n, column in enumerate(columns)}
        return found, values


def _ticks_of(
    recording: Recording, episodes: Sequence[Episode], columns: Sequence[Column]
) -> Iterator[_Ticks]:
    """Yield the packets of a hand, episode by episode."""
    waiting = deque(_Ticks(episode, columns) for episode in episodes)
    for packet in recording.stream(*_TOPICS):
        time_ns = packet.time_ns
        if isinstance(packet, EnvironmentReply):
            time_ns = packet.device_time_ns
        elif waiting and time_ns > waiting[0].episode.end_ns + _SETTLING_NS:
            yield waiting.popleft()
        for ticks in waiting:
            if time_ns < ticks.episode.begin_ns:
                break
            ticks.add(packet, time_ns)
    yield from waiting


def _features(
    recording: Recording, features: Mapping[str, Sequence[str]]
) -> dict[str, list[Column]]:
    """Return the columns of each feature: of those that suit the hands, changed by ``features``.

    Of a leader and a follower (environment ``coupling``) the action is the leader's position, and
    the state is the follower's. Of other hands the action is their own position in the next row.

    Raises:
        ConfigError: If a column is unknown, or no feature is left.
    """
    tables = {hand: columns_of(one, _TOPICS) for hand, one in recording.by_hand.items()}
    environment, hands = recording.launch.get("environment", {}), list(tables)
    pair = [environment.get(role) for role in ("leader", "follower")]
    acting = [f"{hand}.position{NEXT}" for hand in hands]
    if environment.get("kind") == "coupling" and set(pair) <= set(hands):
        acting, hands = [f"{pair[0]}.position"], pair[1:]
    signals = [n for n in tables[hands[0]].get(_REPLY, ()) if n.startswith("signals.")]
    fields = {"state": ["position"], "velocity": ["velocity"]}
    fields["effort"] = ["applied_force", "commanded_force"]
    chosen: dict[str, Sequence[str]] = {"action": acting}
    chosen |= {name: [f"{h}.{f}" for h in hands for f in own] for name, own in fields.items()}
    chosen["environment_state"] = [f"{hands[0]}.{signal}" for signal in signals]
    found = {}
    for name, texts in {**chosen, **features}.items():
        if texts:
            found[name] = [one for text in texts for one in _columns(recording, tables, text)]
    if not found:
        raise ConfigError("no feature is left: name at least one column")
    return found


def _columns(
    recording: Recording, tables: Mapping[str, Mapping[str, Sequence[str]]], text: str
) -> list[Column]:
    """Return the columns that a text such as ``leader.position`` names."""
    hand, _, field = text.removesuffix(NEXT).partition(".")
    if len(tables) == 1 and hand not in tables:
        hand, field = next(iter(tables)), text.removesuffix(NEXT)
    if hand not in tables:
        known = " or ".join(f"{one}.position" for one in tables)
        raise ConfigError(f"expected hand and column, such as {known}, got {text!r}")
    of, is_next = recording.by_hand[hand], text.endswith(NEXT)
    table, _, rest = field.partition(".")
    topics, prefix = _TOPICS, hand
    if table in _TOPICS:
        topics, prefix, field = (table,), f"{hand}.{table}", rest
    for topic in topics:
        names = [n for n in tables[hand].get(topic, ()) if re.sub(r"\[\d+\]", "", n) == field]
        axes = [axis.name for axis in launched(of.launch).named_axes(len(names))]
        found = []
        for name, axis in zip(names, axes, strict=False):
            is_axis = "[" in name and field not in ("joints", "torques", "orientation")
            label = f"{prefix}.{field}.{axis}" if is_axis else f"{prefix}.{name}"
            meaning, unit = described(of, topic, name)
            shown = label.removeprefix(f"{HAND}.") + NEXT * is_next
            found.append(Column(hand, topic, name, is_next, (shown, unit, meaning)))
        if found:
            return found
    own = {re.sub(r"\[\d+\]", "", n): None for names in tables[hand].values() for n in names}
    raise ConfigError(f"{recording.path} has no column {field!r}; it has {', '.join(own)}")
