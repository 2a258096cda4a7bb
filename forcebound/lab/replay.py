"""The graph of a recording, to run it once more: with its own parts, others, or what it recorded.

What can be fed from the recording in place of the graph's own:

* ``hand``: a hand whose path is a function of time already repeats itself, from its beginning. Any
  other (a pointer, a person on hardware, none, a hand in a recording that begins later) becomes one
  that follows the recorded path; see :mod:`forcebound.haptics.hands.paths`.
* ``network``: the recorded delays and losses of each link, in place of those of links and
  environment; see :func:`forcebound.recordings.delay_traces.hop_delays`.
* ``environment``: the recorded replies, whatever the hand does; see
  :mod:`forcebound.haptics.environments.recorded`.

Several hands run together in their world. One of them alone needs the recorded replies: what the
others did to the world is nowhere else.
"""

import dataclasses
import json
import re
from collections.abc import Collection, Iterator, Sequence
from pathlib import Path
from typing import cast

from forcebound.errors import ConfigError
from forcebound.files import content_of
from forcebound.graph.graph import COMPUTATION, KINDS, SECTION_SETTINGS, GraphConfig, HandConfig
from forcebound.graph.loader import from_document, launch_file_of, load
from forcebound.graph.model import read_section
from forcebound.graph.names import (
    OF_GRAPH,
    ParameterName,
    parameter_name,
    put,
    split_setting,
)
from forcebound.graph.parts import law_of
from forcebound.graph.problems import Problems, unknown
from forcebound.graph.resolved import to_document
from forcebound.graph.tree import from_plain, scalar
from forcebound.haptics.hands.hands import SoftGrip
from forcebound.haptics.hands.paths import began
from forcebound.haptics.laws import LAWS
from forcebound.haptics.parts.user_module import names_file
from forcebound.messages.packets import TOPIC_OF, Telemetry
from forcebound.messages.topology import HAND, HANDS, HERE, LINKS, Document, flat, nested
from forcebound.recordings.recording import Recording

_GRIP = tuple(field.name for field in dataclasses.fields(SoftGrip))
_COMPUTATION = tuple(f"compute_{name}" for name in COMPUTATION)


def graph_of(
    recording: Recording, settings: Sequence[str] = (), feeds: Collection[str] = ()
) -> GraphConfig:
    """Return the graph of a recording.

    Args:
        recording: With its launch file.
        settings: Other values, each ``name:=value``: ``law``; ``device``, ``operator``,
            ``controller`` or ``environment`` for another kind with its defaults, or for the
            recorded class of the user's with what was recorded; or a key of the launch file,
            ``environment.stiffness``. With several hands, ``left.law``.
        feeds: Some of ``hand``, ``network``, ``environment``.

    Raises:
        ConfigError: If the recording holds none, a setting is wrong, the recording names code or a
            serial port of its own, which only the user may, or its hands need what is not fed.
    """
    document, several = _document(recording), len(recording.hands) > 1
    is_part = several and HAND in document[HANDS]
    if document.pop(HERE, None) is not None:  # other machines have recorded the others
        document[HANDS] = {hand: document[HANDS][hand] for hand in recording.hands}
        is_part = True
    if is_part and "environment" not in feeds:
        raise ConfigError(
            "some of several hands alone need --environment: what the others did to their world is"
            " in the recorded replies only"
        )
    if several and "network" in feeds:
        raise ConfigError(f"--network: {recording.path} has several hands; expected one")
    with content_of(recording.path):
        _feed(document, recording, feeds)
    named = {_set(document, setting) for setting in settings}
    if "environment" in feeds and "environment" in named:
        raise ConfigError("environment:=KIND and --environment exclude each other: give one")
    for hand in document[HANDS]:
        own = {name.removeprefix(parameter_name(hand, "")) for name in named}
        _check_code(recording, flat(document, hand), own, KINDS)
    config = from_document(document)
    for hand, parts in config.hands.items():
        if parameter_name(hand, "device") not in named and parts.device.simulated_in is not None:
            device = parameter_name(hand, "device")
            raise ConfigError(
                f"{recording.path} was recorded on a device at a serial port; name a simulated one,"
                f" such as {device}:=five_bar, or this one: {device}:=KIND {device}.port:=PORT"
            )
    return config


def graph_onto(recording: Recording, target: str, settings: Sequence[str] = ()) -> GraphConfig:
    """Return the graph of a launch file, one of whose hands does what that of a recording did.

    Args:
        recording: Of one hand.
        target: The launch file, ``FILE``, or with the name of its hand, ``FILE.yaml:HAND``.
        settings: Of the launch file, each ``name:=value``.

    Raises:
        ConfigError: If a setting is wrong, there is no such hand, or it has other axes, or a real
            device, which only its own motors move.
    """
    path, name = launch_file_of(target)
    config = load(path or target, settings)
    name = name or (HAND if len(config.hands) > 1 else next(iter(config.hands)))
    if name not in config.hands:
        known = " or ".join(f"--onto {path or target}:{hand}" for hand in config.hands)
        raise ConfigError(f"{target}: which hand? {known}")
    if config.hands[name].device.simulated_in is not None:
        raise ConfigError(
            f"{target}: the device of {name} is a real one, which no simulated hand moves: name a"
            " simulated leader, to which the environment coupling couples a real follower"
        )
    document = to_document(config)
    sections, file = document[HANDS][name], str(recording.path.absolute())
    path_of = {"kind": "trajectory", "file": file, "hand": recording.hand}
    sections["operator"] = {**path_of, **_kept(sections, "operator", _GRIP)}
    return from_document(document)


def device_of(recording: Recording, settings: Sequence[str] = ()) -> HandConfig:
    """Return the device of a hand's recording and its servo, with nobody at it.

    ``settings`` are those of :func:`graph_of` for law and device; without the name of a hand they
    are those of each.

    Raises:
        ConfigError: As :func:`graph_of`; a setting of another section.
    """
    document, named = _with_settings(recording, settings)
    for name in named:
        if name.partition(".")[0] not in ("law", "device"):
            raise ConfigError(
                f"{name} does not enter the verification: expected law, device or device.KEY"
            )
    sections = document[HANDS][HAND]
    _check_code(recording, sections, named, ("device",))
    problems = Problems()
    with content_of(recording.path):
        found = read_section("device", from_plain(sections["device"], "device"), problems)
        problems.raise_if_any()
    return HandConfig(**found)


def changed_keys(recording: Recording, settings: Sequence[str]) -> list[str]:
    """Return the names of keys of a hand's device that ``settings`` of device_of have changed."""
    before, now = (
        _with_settings(recording, given)[0][HANDS][HAND]["device"] for given in ((), settings)
    )
    keys = [key for key in {**before, **now} if before.get(key) != now.get(key)]
    keys = ["kind"] if "kind" in keys else keys  # of another kind all keys are others
    return [f"device.{key}" for key in keys]


def _with_settings(recording: Recording, settings: Sequence[str]) -> tuple[Document, set[str]]:
    """The launch file of a hand's recording with those settings that are its own; their names."""
    document, own = _document(recording), []
    for setting in settings:
        name, text = split_setting(setting)
        place = ParameterName.parse(name)
        if place.hand in (HAND, recording.hand):
            own.append(f"{'.'.join(place.keys)}:={text}")
        elif place.hand not in recording.hands:
            raise ConfigError(unknown("hand", place.hand, recording.hands))
    return document, {_set(document, setting) for setting in own}


def duration_of(recording: Recording, config: GraphConfig) -> float:
    """Return for how long the force was engaged in a recording, in s."""
    return max(map(_duration, recording.by_hand.values(), config.hands.values()))


def _duration(recording: Recording, hand: HandConfig) -> float:
    longest = max((tick.elapsed for tick in _ticks(recording)), default=0.0)
    longest -= began(_ticks(recording))
    period = hand.servo.period_ns * 1e-9
    return (longest // period + 1.0) * period


def _ticks(recording: Recording) -> Iterator[Telemetry]:
    return cast("Iterator[Telemetry]", recording.stream(TOPIC_OF[Telemetry]))


def _document(recording: Recording) -> Document:
    """The launch file of a recording, to be changed."""
    document = nested(json.loads(json.dumps(recording.launch)))
    for sections in document[HANDS].values():
        if "device" not in sections:
            raise ConfigError(f"{recording.path} holds no launch file")
        sections["device"].pop("late_ticks", None)  # of recordings before format 4
    return document


def _feed(document: Document, recording: Recording, feeds: Collection[str]) -> None:
    """Feed parts of the graph from the recording; phases do not change them."""
    file, fed = str(recording.path.absolute()), []
    if "network" in feeds:
        traces = {topic: {"trace": file, "trace_hop": topic} for topic in LINKS}
        document[HANDS][HAND]["links"] = traces
        for name in _COMPUTATION:
            document["environment"].pop(name, None)
        fed += [r"links\.", r"environment\.compute_"]
    recordings = recording.by_hand
    if "environment" in feeds:
        kept = _kept(document, "environment", _COMPUTATION)
        whose = {"hand": recording.hand} if HAND in document[HANDS] else {}
        document["environment"] = {"kind": "recorded", "file": file, **whose, **kept}
        fed.append(r"environment\.(?!compute_)")
    for name, sections in document[HANDS].items():
        sections.pop("remote", None)  # the environment runs here
        one = recordings[recording.hand if name == HAND else name]
        hand = sections.get("operator", {})
        if "hand" in feeds and (not hand or hand["kind"] == "pointer" or began(_ticks(one)) > 0.0):
            kept = _kept(sections, "operator", _GRIP)
            path = {"kind": "trajectory", "file": file, "hand": one.hand}
            sections["operator"] = {**path, **kept}
    for phase in document.get("phases", ()) if fed else ():
        values = phase["set"].items()
        phase["set"] = {key: one for key, one in values if not re.match("|".join(fed), key)}


def _kept(document: Document, section: str, names: Collection[str]) -> Document:
    return {key: value for key, value in document.get(section, {}).items() if key in names}


def _set(document: Document, setting: str) -> str:
    """Put a setting into the document; return its name."""
    name, text = split_setting(setting)
    place = ParameterName.parse(name)
    hands, section = document[HANDS], ".".join(place.keys)
    is_of_all = place.section in OF_GRAPH
    if not is_of_all and place.hand not in hands and HAND not in hands:
        names = " or ".join(parameter_name(hand, section) for hand in hands)
        raise ConfigError(f"whose {section}? It belongs to a hand: {names}")
    sections = document if is_of_all else hands.get(place.hand, {})
    if section == "law":
        sections["device"]["law"] = law_of(text)
    elif section in KINDS:
        own = tuple(SECTION_SETTINGS.get(section, ()))  # not the kind's
        kind, recorded = KINDS[section].resolve(text, Path()), sections.get(section, {})
        is_same = names_file(kind) and Path(kind).name == Path(recorded.get("kind", "")).name
        kept = recorded if is_same else _kept(sections, section, own)
        sections[section] = {**kept, "kind": kind}
    else:
        known = [*KINDS, "links", "realtime"]
        if len(place.keys) < 2 or place.section not in known:
            settings = ["law", *KINDS, *(f"{section}.KEY" for section in known)]
            raise ConfigError(unknown("setting", name, settings))
        put(document, place.path, scalar(text))
    return name


def _check_code(
    recording: Recording, document: Document, named: Collection[str], used: Collection[str]
) -> None:
    """Check that the recording chooses no code: only forcebound and the user do."""
    tables = {name: (KINDS[name], document.get(name, {}).get("kind")) for name in used}
    tables["law"] = (LAWS, document["device"]["law"])
    for name, (table, kind) in tables.items():
        if kind is not None and name not in named and not table.is_shipped(kind):
            raise ConfigError(
                f"{recording.path} names code of its own, {kind}: to run it, name it yourself,"
                f" {name}:=FILE.py, or another {name}"
            )
