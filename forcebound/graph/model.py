"""The sections of a launch file, made one by one; a problem in one does not hide those of others.

One reader reads launch files, what :mod:`forcebound.graph.resolved` writes (:func:`restore`), and
parts by themselves (:mod:`forcebound.graph.parts`).
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache, partial
from types import MappingProxyType
from typing import Annotated, Any, Literal, TypeAlias

from forcebound.axes import Axis
from forcebound.errors import ConfigError
from forcebound.graph.checks import Note
from forcebound.graph.document import with_named_hands
from forcebound.graph.fields import Field, fields_of
from forcebound.graph.forms import Form, Values, check_hint, note_error, read_as
from forcebound.graph.graph import (
    FORMAT,
    KINDS,
    PHASE_KEYS,
    SECTION_SETTINGS,
    DeviceFacts,
    EnvironmentConfig,
    GraphConfig,
    HandConfig,
    PartSpec,
    Phase,
    RealtimeConfig,
    RemoteConfig,
)
from forcebound.graph.names import FILE_KEYS, RUN_KEYS, ParameterName, problem_of_hand
from forcebound.graph.problems import Problems, unknown
from forcebound.graph.resolved import FACTS, check_plain
from forcebound.graph.seen_axes import axes_of, seen_axes
from forcebound.graph.servo import ServoSettings
from forcebound.graph.tree import Value, from_plain, units_of
from forcebound.haptics.laws import LAWS
from forcebound.haptics.parts.plain import field_of
from forcebound.haptics.parts.user_module import describe_user_error, user_code
from forcebound.messages.topology import HAND_SECTIONS, HANDS, IMPAIRABLE, MOST_HANDS, Document
from forcebound.network.impairment import Impairment
from forcebound.network.presets import PRESET, PRESETS, named_link
from forcebound.quantities import CheckedText
from forcebound.recordings.delay_traces import trace_of


def _check_format(version: Any) -> None:
    if version != FORMAT:
        raise ConfigError(f"this version reads launch files of format {FORMAT}, not {version}")


#: Whether this process makes a part, by its section and kind; of others it keeps the values.
Makes: TypeAlias = Callable[[str, str], bool]

PHASES = "phases"
_RUN = {
    "forcebound": Field("forcebound", Annotated[int, CheckedText(_check_format)], True),
    **fields_of(GraphConfig, RUN_KEYS),
}
_FILE = Form("the launch file", _RUN)
_FILE_OF_PHASES = Form(_FILE.name, {n: f for n, f in _RUN.items() if n != "duration"})
#: Keys of a link: those of an impairment, and the named network that gives them other defaults.
_NAMED: Any = Literal[*PRESETS]
LINK = {PRESET: Field(PRESET, _NAMED | None), **fields_of(Impairment)}
_LINK = {topic: Form(f"links.{topic}", LINK) for topic in IMPAIRABLE}
#: Sections that are made of their values alone.
SETTINGS: Mapping[str, type] = {"realtime": RealtimeConfig, "remote": RemoteConfig}
_SETTINGS = {name: (Form(name, fields_of(kind)), kind) for name, kind in SETTINGS.items()}
PHASE = Form(PHASES, {**fields_of(Phase, PHASE_KEYS), "set": Field("set", dict[str, Any] | None)})
_OPTIONAL = ("operator", "controller")  # sections that a hand need not have


def always(section: str, kind: str) -> bool:
    """Make every part."""
    return True


def never(section: str, kind: str) -> bool:
    """Make no part."""
    return False


def read_graph(
    root: Value,
    problems: Problems,
    makes: Makes = always,
    check: Callable[[Values, Note], None] = lambda made, note: None,
) -> GraphConfig:
    """Return the configuration that a tree describes, its phases as they are written.

    ``check`` notes what does not go together among the sections that could be made. ConfigError
    with all problems.
    """
    root = with_named_hands(root)
    written = root.entries.get("units", Value(None, root.place)).entries  # of a resolved document
    units = {name: unit.text for name, unit in written.items()}
    root = root.without("units") if units else root
    units |= {str(ParameterName.parse(name)): unit for name, unit in units_of(root)}
    made = read_sections(root, problems, makes)

    def note(hand: str, section: str, error: ConfigError) -> None:
        sections = root.entries[HANDS].entries[hand] if hand else root
        note_error(error, section, sections.entries[section], problems, is_named=True)

    check(made, note)
    problems.raise_if_any()
    hands = {name: HandConfig(**sections) for name, sections in made.pop(HANDS).items()}
    phases = tuple(made.pop(PHASES, ()))
    if phases:
        made["duration"] = sum(phase.duration for phase in phases)
    return GraphConfig(**made, hands=hands, phases=phases, units=units)


def read_sections(root: Value, problems: Problems, makes: Makes = always) -> Values:
    """Return what could be made of a launch file: its sections by name, and the keys of the run.

    ``hands`` has the sections of each hand.
    """
    has_phases = PHASES in root.entries
    sections = ("environment", "realtime", HANDS, *HAND_SECTIONS, *FILE_KEYS, PHASES)
    others = (*sections, *(["duration"] * has_phases))
    made = (_FILE_OF_PHASES if has_phases else _FILE).read(root, problems, others) or {}
    made.pop("forcebound", None)
    made[HANDS] = _hands(root, problems, makes)
    environment = root.entries.get("environment", Value({}, root.place, root.key))
    device = next((hand.get("device") for hand in made[HANDS].values()), None)
    axes = axes_of(device, "named_axes")
    if (found := read_section("environment", environment, problems, makes, axes)) is not None:
        made["environment"] = found
    if "realtime" in root.entries:
        made["realtime"] = _settings("realtime", root.entries["realtime"], problems)
    if has_phases:
        made[PHASES] = _phases(root.entries[PHASES], problems)
    return made


def _hands(root: Value, problems: Problems, makes: Makes) -> dict[str, Values]:
    """Sections of each hand, as far as they could be made, by its name."""
    named = root.entries[HANDS]
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
        problem = problem_of_hand(name, len(named.entries))
        if problem is not None:
            problems.add(problem, value.key or value.place)
        Form(f"{HANDS}.{name}", {}).read(value, problems, HAND_SECTIONS)
    return {name: _hand(value, problems, makes) for name, value in named.entries.items()}


def _hand(root: Value, problems: Problems, makes: Makes) -> Values:
    made: Values = {}
    empty = Value({}, root.place, root.key)
    for name in HAND_SECTIONS:
        value = root.entries.get(name, empty)
        if name == "links":
            made[name] = _links(value, problems)
        elif name in SETTINGS:
            if name in root.entries:
                made[name] = _settings(name, value, problems)
        elif name == "axes":
            if name in root.entries and (seen := seen_axes(value, made.get("device"), problems)):
                made["seen"] = seen
        elif name in _OPTIONAL and not value.entries and value.content in (None, {}):
            continue
        else:
            of = "hand_axes" if name == "operator" else "named_axes"
            axes = axes_of(made.get("device"), of)
            if (found := read_section(name, value, problems, makes, axes)) is not None:
                made |= found if name == "device" else {name: found}
    return made


def _links(value: Value, problems: Problems) -> dict[str, Impairment]:
    Form("links", {}).read(value, problems, IMPAIRABLE)
    links = {
        topic: read_link(topic, link, problems)
        for topic, link in value.entries.items()
        if topic in IMPAIRABLE
    }
    return {topic: link for topic, link in links.items() if link is not None}


def _phases(value: Value, problems: Problems) -> list[Phase]:
    if not isinstance(value.content, tuple) or not value.content:
        expected = "at least one" if value.content == () else "a list"
        problems.add(f"{PHASES}: expected {expected}, got {value}", value.place, value.related)
        return []
    read = (PHASE.read(entry, problems) for entry in value.content)
    return [
        Phase(one["name"], one["duration"], one.get("set") or {}) for one in read if one is not None
    ]


def read_section(
    name: str,
    value: Value,
    problems: Problems,
    makes: Makes = always,
    axes: Sequence[Axis] | None = (),
) -> Any:
    """Return the section of a part, with its settings; None with a problem noted.

    Quantities are read in the units of the ``axes``.
    """
    finish = _SECTION_OF.get(name, _part_alone)
    return read_part(name, value, problems, SECTION_SETTINGS.get(name, {}), finish, makes, axes)


def _part_alone(part: Any, settings: Values, written: Value) -> Any:
    return part


def read_part(
    section: str,
    value: Value,
    problems: Problems,
    settings: Mapping[str, Field] = MappingProxyType({}),
    finish: Callable[[Any, Values, Value], Any] = _part_alone,
    makes: Makes = always,
    axes: Sequence[Axis] | None = (),
) -> Any:
    """Return what ``finish`` makes of a part and its settings; None with a problem noted."""
    kind: Value | None = value.entries.get("kind")
    kept: Values = {}  # the values of a part that is not made here
    if kind is not None and kind.text in KINDS[section] and not makes(section, kind.text):
        kept = {name: one.plain for name, one in value.entries.items() if name not in settings}
        form, make = Form(section, settings), partial(_spec, kept)
    else:
        found = _class_of(section, value, problems)
        if found is None:
            return None
        form, make = _form(section, found, tuple(settings.values())), partial(found)
        if section == "device":
            written = {name: one.plain for name, one in value.entries.items()}
            try:
                with user_code(""):
                    axes = found.written_axes(written) or ()
            except ConfigError as error:
                return note_error(error, section, value, problems)
    values = form.read(value, problems, kept, axes)
    if values is None:
        return None
    beside = {name: values.pop(name) for name in settings if name in values}
    values.pop("kind", None)
    try:
        with user_code(""):
            part = make(**{field_of(key): one for key, one in values.items()})
        check_plain(part)
        return finish(part, beside, value)
    except ConfigError as error:
        note_error(error, section, value, problems)
    return None


def _spec(kept: Values) -> PartSpec:
    return PartSpec(kept["kind"], {name: one for name, one in kept.items() if name != "kind"})


@lru_cache(maxsize=256)
def _form(section: str, kind: type, settings: tuple[Field, ...]) -> Form:
    beside = {field.name: field for field in settings}
    return Form(section, {"kind": Field("kind", str), **fields_of(kind), **beside})


def _device(model: Any, settings: Values, written: Value) -> Values:
    if "law" in settings:
        with user_code("", "law"):
            settings["law"] = LAWS.resolve(settings["law"], written.entries["law"].folder)
    if written.place.line and not isinstance(model, PartSpec):
        model.check_files()
    return {"device": model, "servo": ServoSettings(**settings)}


def _environment(model: Any, settings: Values, written: Value) -> EnvironmentConfig:
    environment = EnvironmentConfig(model, **settings)
    if isinstance(model, PartSpec):
        return environment  # another process reads its files
    with user_code("compute_trace", "compute_trace"):
        trace_of(environment.computation)
    try:
        model.check_files()
    except ConfigError as error:
        raise ConfigError(str(error), field=error.field or "file") from error
    return environment


#: Section of a part -> what is made of the part, its settings, and both as they are written.
_SECTION_OF: Mapping[str, Callable[[Any, Values, Value], Any]] = {
    "device": _device,
    "environment": _environment,
}


def _built(form: Form, value: Value, problems: Problems, build: Callable[[Values], Any]) -> Any:
    """Result of ``build`` with the values of a mapping; None with a problem noted."""
    values = form.read(value, problems)
    if values is not None:
        try:
            return build(values)
        except ConfigError as error:
            note_error(error, form.name, value, problems)
    return None


def _settings(name: str, value: Value, problems: Problems) -> Any:
    form, kind = _SETTINGS[name]
    return _built(form, value, problems, lambda values: kind(**values))


def read_link(topic: str, value: Value, problems: Problems) -> Any:
    """Return the link of a topic; None with a problem noted."""
    return _built(_LINK[topic], value, problems, _impairment)


def _impairment(values: Values) -> Impairment:
    name = values.pop(PRESET, None)
    impairment = named_link(name, **values) if name else Impairment(**values)
    with user_code("trace", "trace"):
        trace_of(impairment)
    return impairment


def _class_of(section: str, value: Value, problems: Problems) -> Any:
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
                _check_fields(found, frozenset({"kind", *SECTION_SETTINGS.get(section, ())}))
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


def restore(document: Document, makes: Makes = never) -> GraphConfig:
    """Return the configuration of an unchanged resolved document.

    What goes together was checked before. A part that this process does not make is a
    :class:`PartSpec`.

    Raises:
        ConfigError: If it is no such document, or a file that it names is gone.
    """
    try:
        root = from_plain(document, "document")
        facts = root.entries.get(FACTS, Value({}, root.place)).entries
        config = read_graph(root.without(FACTS), Problems(), makes)
        hands = dict(config.hands)
        for name, stated in facts.items():
            hands[name] = replace(hands[name], stated=read_as(DeviceFacts, stated, FACTS))
    except (ConfigError, KeyError, TypeError) as error:
        field = error.field if isinstance(error, ConfigError) else None
        raise ConfigError(f"this is no resolved launch document: {error}", field=field) from error
    return replace(config, hands=hands)
