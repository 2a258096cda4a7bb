"""Parameters as text for a launch file, with the unit that their type names."""

import dataclasses
import inspect
import json
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cache, reduce
from operator import or_
from types import UnionType
from typing import Annotated, Any, Union, get_args, get_origin

from forcebound.axes import Axis, units_on
from forcebound.graph.fields import fields_of
from forcebound.graph.graph import EnvironmentConfig, GraphConfig, RealtimeConfig
from forcebound.graph.names import ParameterName
from forcebound.graph.parameters import takeable_laws
from forcebound.graph.servo import ServoSettings
from forcebound.graph.tree import scalar
from forcebound.messages.control import Parameters
from forcebound.network.impairment import Impairment
from forcebound.quantities import Range, Unit
from forcebound.units import in_unit

# YAML reads it as text without quotes, also within { } and [ ].
_PLAIN = re.compile(r"[A-Za-z_/.][A-Za-z0-9_/.+-]*( [A-Za-z0-9_/.+-]+)*")


def as_written(
    config: GraphConfig, values: Parameters, units: Mapping[str, str] | None = None
) -> dict[str, str]:
    """Return parameters of a graph as YAML, each fit for ``forcebound param set``.

    In ``units``, by the name of the parameter, else in SI. Of a part in a user's file that was not
    read, no type is known: in the unit in which the parameter was written.
    """
    hints, units = {name: _hint(config, name) for name in values}, units or {}
    written = {name: config.units.get(name, "") for name, hint in hints.items() if hint is None}
    units = {**written, **units}
    return {n: _text(value, hints[n], units.get(n, "")) for n, value in values.items()}


def ranges(config: GraphConfig, names: Iterable[str]) -> dict[str, str]:
    """Return in words what values parameters can have, such as ``>= 0 N/m``; "" for any."""
    found = {}
    for name in names:
        parts = list(_parts(_hint(config, name)))
        symbol = "".join(part.symbol for part in parts if isinstance(part, Unit))
        found[name] = " and ".join(p.describe(symbol) for p in parts if isinstance(p, Range))
        if ParameterName.parse(name).is_law:
            found[name] = ", ".join(takeable_laws())
    return found


def meanings_of(config: GraphConfig, names: Iterable[str]) -> dict[str, str]:
    """Return what parameters mean, in the words of their docstrings; "" where there are none."""
    found = {}
    for name in names:
        kind, _ = _place(config, name)
        text = meanings(kind).get(ParameterName.parse(name).last, "") if kind else ""
        found[name] = re.sub(r":\w+:`~?([^`]*)`|`+([^`]*)`+", r"\1\2", text)
    return found


@cache
def meanings(kind: type) -> dict[str, str]:
    """Return the meanings of the fields of a dataclass, from the attributes in its docstring."""
    found: dict[str, str] = {}
    for base in reversed(kind.__mro__):
        _, _, after = inspect.cleandoc(base.__doc__ or "").partition("Attributes:\n")
        section = after.partition("\n\n")[0]
        for entry in re.split(r"\n(?=    \w)", f"\n{section}"):
            name, colon, text = entry.strip().partition(": ")
            if colon and name.isidentifier():
                found[name] = " ".join(text.split())
    return found


def _hint(config: GraphConfig, name: str) -> Any:
    """Return the type of a parameter, with the unit that it has on the axes of the graph."""
    place, hint = ParameterName.parse(name), _place(config, name)[1]
    if place.section not in ("environment", "controller"):
        return hint
    return _on_axes(
        hint, config.hands.get(place.hand, next(iter(config.hands.values()))).named_axes
    )


def _on_axes(hint: Any, axes: Sequence[Axis]) -> Any:
    """A type with its units as they are on these axes."""
    if isinstance(hint, Unit):
        return Unit(units_on(axes, hint.symbol))
    origin: Any = get_origin(hint)
    inside = tuple(_on_axes(one, axes) for one in get_args(hint))
    if origin in (Union, UnionType):
        return reduce(or_, inside)
    turns: Any = Annotated if origin is Annotated else tuple
    return turns[inside] if origin in (Annotated, tuple) else hint


def _place(config: GraphConfig, name: str) -> tuple[type | None, Any]:
    """Return the dataclass that has a parameter, and the type of the parameter there."""
    place = ParameterName.parse(name)
    beside: dict[str, tuple[type, ...]] = {
        "environment": (type(config.environment.model), EnvironmentConfig),
        "realtime": (RealtimeConfig,),
        "links": (Impairment,),
    }
    hand = config.hands.get(place.hand)
    if hand is not None:
        beside["device"] = (type(hand.device), ServoSettings)
        beside["operator"] = (type(hand.operator),) if hand.operator is not None else ()
        beside["controller"] = (type(hand.controller),)
    kinds = beside.get(place.section, (GraphConfig,))
    for step in () if place.section == "links" else place.keys[1:-1]:
        kinds = tuple(part for kind in kinds for part in _inside(kind, step))
    for kind in kinds:
        field = fields_of(kind).get(place.last)
        if field is not None:
            return kind, field.hint
    return None, None


def _inside(kind: type, name: str) -> Iterator[type]:
    """Give the dataclasses that a field of a dataclass may have."""
    field = fields_of(kind).get(name)
    for part in _parts(field.hint) if field else ():
        if isinstance(part, type) and dataclasses.is_dataclass(part):
            yield part


def _text(value: Any, hint: Any, unit: str = "") -> str:
    if value is None:
        return "null"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, int | float):
        symbols = [part.symbol for part in _parts(hint) if isinstance(part, Unit)]
        return in_unit(value, unit if unit and (symbols or hint is None) else "".join(symbols[:1]))
    if isinstance(value, list):
        inner = [part for part in _parts(hint) if get_origin(part) in (tuple, list)]
        entries = get_args(inner[0]) if inner else ()
        hints = [entry for entry in entries if entry is not Ellipsis] or [None]
        kinds = [hints[min(i, len(hints) - 1)] for i in range(len(value))]
        texts = [_text(entry, kind, unit) for entry, kind in zip(value, kinds, strict=True)]
        return f"[{', '.join(texts)}]"
    if isinstance(value, Mapping):
        classes = [part for part in _parts(hint) if dataclasses.is_dataclass(part)]
        fields = fields_of(classes[0]) if classes and isinstance(classes[0], type) else {}
        pairs = [
            f"{key}: {_text(entry, fields[key].hint if key in fields else None)}"
            for key, entry in value.items()
        ]
        return f"{{ {', '.join(pairs)} }}"
    text = str(value)
    is_plain = _PLAIN.fullmatch(text) and isinstance(scalar(text), str)
    return text if is_plain else json.dumps(text)


def _parts(hint: Any) -> Iterator[Any]:
    """Give the parts of a type at its top: members of unions, annotations, the type itself."""
    origin = get_origin(hint)
    if origin is Annotated or origin in (Union, UnionType):
        for part in get_args(hint):
            yield from _parts(part)
    else:
        yield hint
