"""Ranges from which an attack draws the fields of a part: by their types, units and ranges.

A field of a launch file has its unit and its :class:`forcebound.quantities.Range` in its type, so a
part that is new is drawn without a line here. What no type says is in :data:`SPANS`.
"""

import dataclasses
import math
from collections.abc import Callable, Iterator, Mapping
from typing import Annotated, Any, Literal, get_args, get_origin

from forcebound import quantities
from forcebound.errors import ConfigError
from forcebound.graph.fields import Field, fields_of
from forcebound.quantities import Unit
from forcebound_proofs.cases import Range

#: Magnitudes by unit, where a field's type leaves them open: what hands meet in haptics, and more.
SPANS: dict[str, tuple[float, float]] = {
    "": (0.1, 10.0),
    "Hz": (0.1, 100.0),
    "J": (1e-6, 1.0),
    "N": (0.3, 30.0),
    "N s/m": (0.1, 100.0),
    "N/m": (100.0, 30_000.0),
    "N/m/s": (10.0, 10_000.0),
    "W": (1e-3, 1e3),
    "kg": (1e-3, 1.0),
    "m": (1e-4, 0.05),
    "m/s": (1e-3, 0.3),
    "rad": (0.01, math.pi),
    "s": (5e-4, 0.1),
}
NEAR = 0.005  # m, of a place from where it is by default
OFTEN_NONE = 0.15  # share of the cases in which a field that may be off, or nothing, is
#: Fields that only choose a file, or that would make a large solid once more for each case.
KEPT = ("origin", "orientation", "radius", "scale", "spacing", "timestep")


def ranges_of(kind: type, given: tuple[str, ...] = ()) -> dict[str, Range]:
    """Return the ranges of the fields that can be drawn, but those that are ``given``, by path."""
    found: dict[str, Range] = {}
    for name, field in fields_of(kind).items():
        if name in KEPT or name in given:
            continue
        if dataclasses.is_dataclass(field.default) and not isinstance(field.default, type):
            inner = ranges_of(type(field.default))
            found |= {f"{name}.{path}": one for path, one in inner.items()}
        elif (one := _range_of(field)) is not None:
            found[name] = one
    return found


def made(
    kind: Any,
    numbers: Mapping[str, float],
    values: Mapping[str, Any] = {},
    check: Callable[[Any], object] = lambda part: None,
) -> Any:
    """Return a part whose fields have ``values`` and these numbers of :func:`ranges_of`.

    What does not go with the others, as the part or ``check`` find, has its default.

    Raises:
        ConfigError: If no part can be made.
    """
    drawn = {}
    for name, field in fields_of(kind).items():
        start = f"{name}."
        inner = {key.removeprefix(start): n for key, n in numbers.items() if key.startswith(start)}
        if inner:
            drawn[name] = made(type(field.default), inner)
        elif name in numbers and (value := _value_of(field, numbers[name])) is not None:
            drawn[name] = value
    while True:
        try:
            part = kind(**{**drawn, **values})
            check(part)
        except ConfigError as error:
            if not drawn:
                raise
            del drawn[error.field if error.field in drawn else next(reversed(drawn))]
        else:
            return part


def _choices(hint: Any) -> Iterator[tuple[Any, str | None, quantities.Range | None]]:
    """Yield the types that a field may have, each with its unit and range, if it has them."""
    if get_origin(hint) is Annotated:
        base, *notes = get_args(hint)
        symbols = [note.symbol for note in notes if isinstance(note, Unit)]
        permitted = [note for note in notes if isinstance(note, quantities.Range)]
        yield base, symbols[0] if symbols else None, permitted[-1] if permitted else None
    elif get_origin(hint) in (None, Literal, tuple, dict, list):
        yield hint, None, None
    else:
        for choice in get_args(hint):
            yield from _choices(choice)


def _words(field: Field) -> tuple[Any, ...]:
    """Return the values of a field that has a choice of words, or of yes and no."""
    kinds = [kind for kind, _, _ in _choices(field.hint)]
    if kinds == [bool]:
        return (False, True)
    literals = [get_args(kind) for kind in kinds if get_origin(kind) is Literal]
    return literals[0] if len(kinds) == 1 and literals else ()


def _range_of(field: Field) -> Range | None:
    """Return the range of a number, or of a choice among words; None: the field has its default."""
    if words := _words(field):
        return Range(0.0, len(words) - 1e-3)
    for kind, symbol, permitted in _choices(field.hint):
        if kind is float and symbol in SPANS:
            return _drawn(symbol, permitted, field.default)
    return None


def _drawn(symbol: str, permitted: quantities.Range | None, default: Any) -> Range:
    low, high = SPANS[symbol]
    is_place = symbol == "m" and permitted is None
    if is_place and isinstance(default, float):
        return Range(default - NEAR, default + NEAR)
    bounds = permitted or quantities.Range()
    least = bounds.at_least if bounds.at_least is not None else bounds.above
    most = bounds.at_most if bounds.at_most is not None else bounds.below
    if least is not None and most is not None:  # all that is permitted
        low, high = (least or min(low, 1e-2 * most)), most
    low, high = max(low, least or low), min(high, most or high)
    may_be_off = bounds.at_least == 0.0 or not isinstance(default, float)
    return Range(
        low,
        high,
        is_logarithmic=low > 0.0,
        zero_share=OFTEN_NONE if may_be_off else 0.0,
        is_signed=least is None and symbol != "m",
    )


def _value_of(field: Field, number: float) -> Any:
    """Return the value of a number of :func:`_range_of`; None: the default."""
    if words := _words(field):
        return words[int(number)]
    if number == 0.0 and not isinstance(field.default, float):
        return None
    return number
