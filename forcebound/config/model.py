"""The form of a whole launch file, put together for the kinds of parts that it names."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import lru_cache, partial
from typing import Annotated, Any

from forcebound.analysis.delay_traces import trace_of
from forcebound.bounding import LAWS
from forcebound.config.fields import Field, fields_of
from forcebound.config.forms import Form, Values
from forcebound.config.graph import (
    BESIDE_MODEL,
    FORMAT,
    KINDS,
    RUN_KEYS,
    DeviceConfig,
    EnvironmentConfig,
    GraphConfig,
    PhaseHead,
    RealtimeConfig,
    RemoteConfig,
)
from forcebound.config.problems import Problems, unknown
from forcebound.config.resolved import check_plain
from forcebound.config.tree import BROKEN, Value
from forcebound.errors import ConfigError
from forcebound.network.impairment import Impairment
from forcebound.nodes.servo import ServoSettings
from forcebound.parts.user_module import describe_user_error, kind_of, user_code
from forcebound.quantities import CheckedText
from forcebound.topology import LINKS


def _check_law(law: str) -> None:
    if law not in LAWS:
        raise ConfigError(unknown("law", law, LAWS))


def _check_format(version: Any) -> None:
    if version != FORMAT:
        raise ConfigError(f"this version reads launch files of format {FORMAT}, not {version}")


PHASES = "phases"
_FORMAT = Field("forcebound", Annotated[int, CheckedText(_check_format)], True)
_LAW = Field("law", Annotated[str, CheckedText(_check_law)], False, ServoSettings.law)
#: Sections of a part -> settings that stand beside the parameters of its kind.
BESIDE: Mapping[str, Mapping[str, Field]] = {
    "device": {**fields_of(ServoSettings), "law": _LAW},
    "environment": fields_of(EnvironmentConfig, BESIDE_MODEL),
}
_KIND = Field("kind", str)


def form_of(root: Value, problems: Problems) -> tuple[Form, Value]:
    """Return the form of a launch file, and the file with every section that it must have."""
    root = _completed(root)
    kinds: list[tuple[str, type]] = []
    for name in KINDS:
        value = root.entries.get(name)
        if value is None or value.content is BROKEN:
            continue
        if (kind := _class_of(name, value, problems)) is not None:
            kinds.append((name, kind))
        else:  # its problem has been noted
            root = root.with_entries({**root.entries, name: replace(value, content=BROKEN)})
    return _form(tuple(kinds), PHASES in root.entries), root


@lru_cache(maxsize=64)
def _form(kinds: tuple[tuple[str, type], ...], has_phases: bool) -> Form:
    """The form for these kinds."""
    sections = dict(FIXED)
    for name, kind in kinds:
        fields = {"kind": _KIND, **fields_of(kind), **BESIDE.get(name, {})}
        sections[name] = Form(name, fields, partial(_MAKE.get(name, _part), name, kind))
    fields = {"forcebound": _FORMAT, **fields_of(GraphConfig, RUN_KEYS)}
    others = (*KINDS, "arguments", "include", "identified")  # no run reads these three
    free = [name for name in others if name not in sections] + ["duration"] * has_phases
    fields |= {name: Field(name, Any) for name in free}
    return Form("the launch file", fields, inner=sections)


def _completed(root: Value) -> Value:
    empty = Value({}, root.place, root.key)
    entries = {"controller": empty, "links": empty, "realtime": empty}
    entries |= {"device": empty, "environment": empty, **root.entries}
    operator = entries.get("operator")
    if operator is not None and (operator.content is None or operator.content == {}):
        del entries["operator"]  # no hand holds the device
    if entries["controller"].content is None or entries["controller"].content == {}:
        kind = Value("direct", root.place, text="direct")
        entries["controller"] = replace(entries["controller"], content={"kind": kind})
    return root.with_entries(entries)


def make_part(section: str, value: Value, problems: Problems, is_whole: bool = False) -> Any:
    """Return the part of a section alone, or the whole section; ConfigError with problems."""
    kind = _class_of(section, value, problems)
    made: Values = {}
    if kind is not None:
        beside, make = (
            (BESIDE.get(section, {}), _MAKE.get(section, _part)) if is_whole else ({}, _part)
        )
        fields = {"kind": _KIND, **fields_of(kind), **beside}
        made = Form(section, fields, partial(make, section, kind)).read(value, problems)
    problems.raise_if_any()
    return made[""]


def _class_of(section: str, value: Value, problems: Problems) -> type | None:
    """The class of the kind that a section names; None with a problem noted."""
    table, kind = KINDS[section], value.entries.get("kind")
    names = ", ".join(sorted(table))
    if not isinstance(value.content, Mapping | None):
        problems.add(f"{section}: expected a mapping, got {value}", value.place, value.related)
    elif kind is None:
        problems.add(f"{section} needs 'kind', one of {names}", value.key or value.place)
    elif not isinstance(kind.content, str):
        if not kind.is_broken:
            message = f"kind must be one of {names}, got {kind}"
            problems.add(message, kind.place, kind.related)
    elif kind.content not in table:
        message = unknown(f"{section} kind", kind.content, table)
        problems.add(message, kind.place, kind.related)
    else:
        try:
            found: type = table[table.resolve(kind.content, kind.folder)]
            if not table.is_shipped(kind.content):
                _check_fields(found, frozenset({"kind", *BESIDE.get(section, ())}))
        except ConfigError as error:
            problems.add(f"{section}: {error}", kind.place, kind.related)
        else:
            return found
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
            _ = Form(kind.__name__, {name: field}).adapter
        except Exception as error:  # of pydantic, or of a type's own code
            detail = str(error).partition("\n")[0]
            raise ConfigError(
                f"{kind.__name__}: a launch file cannot give {name!r} of the type {field.hint}:"
                f" {detail}"
            ) from None


def _part(section: str, kind: type, values: Values, written: Value) -> Any:
    """A part of its values; ConfigError whatever its own code raises."""
    values.pop("kind", None)
    if kind_of(kind) is None:
        try:
            return kind(**values)
        except ConfigError:
            raise
        except (ValueError, ArithmeticError) as error:
            raise ConfigError(str(error)) from error
    with user_code(""):
        part = kind(**values)
    check_plain(part)
    return part


def _device(section: str, kind: type, values: Values, written: Value) -> DeviceConfig:
    servo, parameters = _split(values, BESIDE[section])
    if "law" in servo:
        with user_code("", "law"):
            servo["law"] = LAWS.resolve(servo["law"], written.entries["law"].folder)
    return DeviceConfig(_part(section, kind, parameters, written), ServoSettings(**servo))


def _environment(section: str, kind: type, values: Values, written: Value) -> EnvironmentConfig:
    beside, parameters = _split(values, BESIDE[section])
    model = _part(section, kind, parameters, written)
    environment = EnvironmentConfig(model, **beside)
    with user_code("compute_trace", "compute_trace"):
        trace_of(environment.computation)
    try:
        model.check_files()
    except ConfigError as error:
        raise ConfigError(str(error), field=error.field or "file") from error
    return environment


def _split(values: Values, beside: Mapping[str, Field]) -> tuple[Values, Values]:
    """The values that stand beside those of the kind, and the latter."""
    settings = {name: value for name, value in values.items() if name in beside}
    return settings, {name: value for name, value in values.items() if name not in beside}


def _link(values: Values, written: Value) -> Impairment:
    impairment = Impairment(**values)
    with user_code("trace", "trace"):
        trace_of(impairment)
    return impairment


def _settings(kind: type) -> Form:
    name = kind.__name__.removesuffix("Config").lower()
    return Form(name, fields_of(kind), lambda values, written: kind(**values))


_MAKE: Mapping[str, Callable[..., Any]] = {"device": _device, "environment": _environment}

_SET = {"set": Field("set", dict[str, Any] | None)}
FIXED: Mapping[str, Form] = {
    "links": Form(
        "links",
        {},
        inner={topic: Form(f"links.{topic}", fields_of(Impairment), _link) for topic in LINKS},
    ),
    "realtime": _settings(RealtimeConfig),
    "remote": _settings(RemoteConfig),
    PHASES: Form("phases", {**fields_of(PhaseHead), **_SET}, is_list=True),
}
