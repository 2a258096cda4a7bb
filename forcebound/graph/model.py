"""The sections of a launch file, made one by one; a problem in one does not hide those of others.

A part is made by itself, too: :func:`member_of` from words of the command line, :func:`device_of`
from the file of a device.
"""

import re
from collections.abc import Callable, Collection, Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any

from forcebound.errors import ConfigError
from forcebound.graph.document import device_section, hands_of
from forcebound.graph.fields import Field, fields_of
from forcebound.graph.forms import Form, Values, check_hint, note_error
from forcebound.graph.graph import (
    BESIDE_MODEL,
    FORMAT,
    KINDS,
    PHASE_KEYS,
    RUN_KEYS,
    DeviceConfig,
    EnvironmentConfig,
    GraphConfig,
    Phase,
    RealtimeConfig,
    RemoteConfig,
)
from forcebound.graph.names import HAND_SECTIONS, split_setting
from forcebound.graph.problems import Place, Problems, unknown
from forcebound.graph.resolved import check_plain
from forcebound.graph.servo import ServoSettings
from forcebound.graph.tree import Value, scalar
from forcebound.haptics.laws import LAWS
from forcebound.haptics.parts.user_module import describe_user_error, user_code
from forcebound.messages.topology import HANDS, IMPAIRABLE
from forcebound.network.impairment import Impairment
from forcebound.quantities import CheckedText
from forcebound.recordings.delay_traces import trace_of


def _check_law(law: str) -> None:
    if law not in LAWS:
        raise ConfigError(unknown("law", law, LAWS))


def _check_format(version: Any) -> None:
    if version != FORMAT:
        raise ConfigError(f"this version reads launch files of format {FORMAT}, not {version}")


PHASES = "phases"
_LAW = Field("law", Annotated[str, CheckedText(_check_law)], False, ServoSettings.law)
#: Sections of a part -> settings that stand beside the parameters of its kind.
BESIDE: Mapping[str, Mapping[str, Field]] = {
    "device": {**fields_of(ServoSettings), "law": _LAW},
    "environment": fields_of(EnvironmentConfig, BESIDE_MODEL),
}
_RUN = {
    "forcebound": Field("forcebound", Annotated[int, CheckedText(_check_format)], True),
    **fields_of(GraphConfig, RUN_KEYS),
}
_FILE = Form("the launch file", _RUN)
_FILE_OF_PHASES = Form(_FILE.name, {n: f for n, f in _RUN.items() if n != "duration"})
_LINK = {topic: Form(f"links.{topic}", fields_of(Impairment)) for topic in IMPAIRABLE}
#: Sections that are made of their values alone.
SETTINGS: Mapping[str, type] = {"realtime": RealtimeConfig, "remote": RemoteConfig}
_SETTINGS = {name: (Form(name, fields_of(kind)), kind) for name, kind in SETTINGS.items()}
PHASE = Form(PHASES, {**fields_of(Phase, PHASE_KEYS), "set": Field("set", dict[str, Any] | None)})
MOST_HANDS = 8
_NAME_OF_HAND = re.compile("[A-Za-z][A-Za-z0-9_]{0,31}")
_UNREAD = ("arguments", "include", "identified")  # no run reads these
_TAKEN = ("forcebound", *KINDS, "links", *SETTINGS, *RUN_KEYS, *_UNREAD, PHASES, HANDS, "units")


def read_sections(root: Value, problems: Problems) -> Values:
    """Return what could be made of a launch file: its sections by name, and the keys of the run.

    The phases have no settings yet; ``hands`` has the sections of each hand.
    """
    has_phases = PHASES in root.entries
    of_hands = (HANDS, *HAND_SECTIONS) if HANDS in root.entries else HAND_SECTIONS
    others = ("environment", "realtime", *of_hands, *_UNREAD, PHASES, *(["duration"] * has_phases))
    made = (_FILE_OF_PHASES if has_phases else _FILE).read(root, problems, others) or {}
    made.pop("forcebound", None)
    environment = root.entries.get("environment", Value({}, root.place, root.key))
    if (section := _section("environment", environment, problems, is_whole=True)) is not None:
        made["environment"] = section
    made[HANDS] = _hands(root, problems)
    if "realtime" in root.entries:
        made["realtime"] = _settings("realtime", root.entries["realtime"], problems)
    if has_phases:
        made[PHASES] = _phases(root.entries[PHASES], problems)
    return made


def _hands(root: Value, problems: Problems) -> dict[str, Values]:
    """What could be made of the sections of each hand, by its name."""
    named = root.entries.get(HANDS)
    if named is not None:
        for section in HAND_SECTIONS:
            if section in root.entries:
                value = root.entries[section]
                words = f"{section} belongs to a hand: move it below {HANDS}: and a name"
                problems.add(words, value.key or value.place)
        if not named.entries and not named.is_broken:
            problems.add(f"{HANDS}: expected the name of a hand and its sections", named.place)
        if len(named.entries) > MOST_HANDS:
            words = f"{HANDS}: expected at most {MOST_HANDS}, got {len(named.entries)}"
            problems.add(words, named.key or named.place)
        for name, value in named.entries.items():
            if not _NAME_OF_HAND.fullmatch(name) or name in _TAKEN:
                words = "expected a word of letters, digits and _ that is no section of a file"
                problems.add(f"{HANDS}: {words}, got {name!r}", value.key or value.place)
            Form(f"{HANDS}.{name}", {}).read(value, problems, HAND_SECTIONS)
    return {name: _hand(value, problems) for name, value in hands_of(root).items()}


def _hand(root: Value, problems: Problems) -> Values:
    made: Values = {}
    empty = Value({}, root.place, root.key)
    for name in HAND_SECTIONS:
        value = root.entries.get(name, empty)
        if name == "links":
            made[name] = _links(value, problems)
        elif name in SETTINGS:
            made[name] = _settings(name, value, problems) if name in root.entries else None
        elif not value.entries and value.content in (None, {}) and name in _WITHOUT:
            made[name] = _WITHOUT[name]()
        elif (section := _section(name, value, problems, is_whole=True)) is not None:
            made[name] = section
    return made


def _links(value: Value, problems: Problems) -> dict[str, Impairment]:
    Form("links", {}).read(value, problems, IMPAIRABLE)
    links = {
        topic: _made(_LINK[topic], link, problems, _link)
        for topic, link in value.entries.items()
        if topic in IMPAIRABLE
    }
    return {topic: link for topic, link in links.items() if link is not None}


#: Sections that a launch file need not have -> what then holds.
_WITHOUT: Mapping[str, Callable[[], Any]] = {
    "operator": lambda: None,  # no hand holds the device
    "controller": lambda: KINDS["controller"]["direct"](),
}


def _phases(value: Value, problems: Problems) -> list[Phase]:
    if not isinstance(value.content, tuple) or not value.content:
        expected = "at least one" if value.content == () else "a list"
        problems.add(f"{PHASES}: expected {expected}, got {value}", value.place, value.related)
        return []
    read = (PHASE.read(entry, problems) for entry in value.content)
    return [Phase(one["name"], one["duration"]) for one in read if one is not None]


def _section(name: str, value: Value, problems: Problems, is_whole: bool) -> Any:
    """The section of a part, whole or the part alone; None with a problem noted."""
    kind = _class_of(name, value, problems)
    if kind is None:
        return None
    make = _MAKE.get(name) if is_whole else None
    form = _form(name, kind, is_whole)
    return _made(form, value, problems, lambda v, at: make(kind, v, at) if make else _part(kind, v))


@lru_cache(maxsize=256)
def _form(section: str, kind: type, is_whole: bool) -> Form:
    beside = BESIDE.get(section, {}) if is_whole else {}
    return Form(section, {"kind": Field("kind", str), **fields_of(kind), **beside})


def _made(
    form: Form, value: Value, problems: Problems, make: Callable[[Values, Value], Any]
) -> Any:
    """What is made of a mapping; None with a problem noted."""
    values = form.read(value, problems)
    if values is not None:
        try:
            return make(values, value)
        except ConfigError as error:
            note_error(error, form.name, value, problems)
    return None


def _class_of(section: str, value: Value, problems: Problems) -> type | None:
    """The class of the kind that a section names; None with a problem noted."""
    table, kind = KINDS[section], value.entries.get("kind")
    if not isinstance(value.content, Mapping | None):
        Form(section, {}).read(value, problems)  # notes it
    elif kind is None:
        names = ", ".join(sorted(table))
        problems.add(f"{section} needs 'kind', one of {names}", value.key or value.place)
    elif not isinstance(kind.content, str):
        if not kind.is_broken:
            message = f"kind must be one of {', '.join(sorted(table))}, got {kind}"
            problems.add(message, kind.place, kind.related)
    elif kind.content not in table:
        message = unknown(f"{section} kind", kind.content, table)
        problems.add(message, kind.place, kind.related)
    else:
        try:
            found: type = table[table.resolve(kind.content, kind.folder)]
            if not table.is_shipped(kind.content):
                _check_fields(found, frozenset({"kind", *BESIDE.get(section, ())}))
            return found
        except ConfigError as error:
            problems.add(f"{section}: {error}", kind.place, kind.related)
    return None


@lru_cache(maxsize=64)
def _check_fields(kind: type, taken: frozenset[str]) -> None:
    """Check that a launch file can give every field of a dataclass that a user wrote."""
    try:
        fields = fields_of(kind)
    except Exception as error:
        raise ConfigError(f"the fields of {kind.__name__}: {describe_user_error(error)}") from None
    for name, field in fields.items():
        if name in taken:
            raise ConfigError(
                f"{kind.__name__}: a parameter cannot be called {name!r}, which is taken"
            )
        try:
            check_hint(field.hint)
        except TypeError as error:
            detail = str(error).partition("\n")[0]
            raise ConfigError(
                f"{kind.__name__}: a launch file cannot give {name!r} of the type {field.hint}:"
                f" {detail}"
            ) from None


def _part(kind: type, values: Values) -> Any:
    """A part of its values; ConfigError whatever its code raises."""
    values.pop("kind", None)
    with user_code(""):
        part = kind(**values)
    check_plain(part)
    return part


def _device(kind: type, values: Values, written: Value) -> DeviceConfig:
    servo = {name: values.pop(name) for name in BESIDE["device"] if name in values}
    if "law" in servo:
        with user_code("", "law"):
            servo["law"] = LAWS.resolve(servo["law"], written.entries["law"].folder)
    return DeviceConfig(_part(kind, values), ServoSettings(**servo))


def _environment(kind: type, values: Values, written: Value) -> EnvironmentConfig:
    beside = {name: values.pop(name) for name in BESIDE["environment"] if name in values}
    model = _part(kind, values)
    environment = EnvironmentConfig(model, **beside)
    with user_code("compute_trace", "compute_trace"):
        trace_of(environment.computation)
    try:
        model.check_files()
    except ConfigError as error:
        raise ConfigError(str(error), field=error.field or "file") from error
    return environment


def _settings(name: str, value: Value, problems: Problems) -> Any:
    form, kind = _SETTINGS[name]
    return _made(form, value, problems, lambda values, written: kind(**values))


def _link(values: Values, written: Value) -> Impairment:
    impairment = Impairment(**values)
    with user_code("trace", "trace"):
        trace_of(impairment)
    return impairment


_MAKE: Mapping[str, Callable[..., Any]] = {"device": _device, "environment": _environment}


def make_part(section: str, value: Value, problems: Problems, is_whole: bool = False) -> Any:
    """Return the part of a section alone, or the whole section; ConfigError with problems."""
    made = _section(section, value, problems, is_whole)
    problems.raise_if_any()
    return made


def member_of(section: str, kind: str, overrides: Sequence[str] = ()) -> Any:
    """Return one part by itself, such as an environment, outside any launch file.

    ``kind`` is as in a launch file, with a path from the current folder; ``overrides`` are
    parameters, each ``name:=value``. ConfigError if there is no such kind or a parameter is wrong.
    """
    problems = Problems()
    entries = {"kind": Value(kind, Place(section), text=kind)}
    for name, word in map(split_setting, overrides):
        place = Place(f"argument {name}:={word}")
        if name in entries:
            problems.add(f"{name!r} is given twice, or is no parameter", place)
        else:
            entries[name] = Value(scalar(word), place, text=word)
    return make_part(section, Value(entries, Place(section)), problems)


def device_of(path: Path, without: Collection[str]) -> Any:
    """Return the device of a file, as :func:`member_of` does, but for some of its parameters."""
    problems = Problems()
    section = device_section(path, problems)
    return make_part("device", section.without(*without), problems)


def law_of(kind: str) -> str:
    """Return a law's kind, absolute if it is in a file; a relative path starts from here.

    Raises:
        ConfigError: If there is no such law.
    """
    _check_law(kind)
    law = LAWS.resolve(kind, Path())
    LAWS[law]  # a file is loaded, and checked
    return law
