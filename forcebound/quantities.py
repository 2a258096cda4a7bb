"""Physical quantities: plain floats in SI units, and the unit that a launch file may write.

A parameter declares its unit in its type, ``stiffness: Stiffness = 10_000.0``; the launch file may
then say ``10 N/mm``. In the program every quantity is a float in SI units. A parameter may also
declare what values make sense, ``rate: Annotated[Frequency, POSITIVE] = 1000.0``.

Units are read, and ranges checked, where text comes in, by the launch files
(:mod:`forcebound.graph`); ranges also by :func:`check_ranges` when a dataclass is made in Python.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from types import UnionType
from typing import (
    Annotated,
    Any,
    Literal,
    Protocol,
    TypeAlias,
    Union,
    get_args,
    get_origin,
    get_type_hints,
    runtime_checkable,
)

from forcebound.errors import ConfigError
from forcebound.units import NAMES, parse_quantity

DAY = 86_400.0  # s, the longest time: in ns, and many times over, it still is a number of 64 bits
LARGEST = 2**63 - 1  # of whole numbers, which packets carry
HUGE = 1e30  # of other numbers, in SI units: their squares and products are finite


@runtime_checkable
class Note(Protocol):
    """Note of a type on a value, in ``Annotated[float, Unit("s"), POSITIVE]``."""

    def read(self, value: Any, symbol: str) -> Any:
        """Return what is meant by ``value``, in the unit ``symbol``; ValueError if it is wrong."""
        ...


@dataclass(frozen=True)
class Unit:
    """The SI unit of an annotated float, in the notation of launch files."""

    symbol: str

    def read(self, value: Any, symbol: str) -> float:
        """Return the quantity that a number or a text with a unit is, in SI units."""
        return parse_quantity(value, self.symbol)

    def describe(self) -> str:
        """Return what the number is, for editors."""
        name, example = NAMES.get(self.symbol, ("quantity", ""))
        unit = f" in {self.symbol}" if self.symbol else ""
        return f"{name}{unit}" + (f"; or with its unit, e.g. {example}" if example else "")


@dataclass(frozen=True)
class Range:
    """The values of an annotated number that make sense; bounds in the number's SI unit.

    A time is at most a ``DAY`` in any case.
    """

    above: float | None = None  # excluded
    at_least: float | None = None
    at_most: float | None = None
    below: float | None = None  # excluded
    hint: str = ""  # what a message says beside the range

    def check(self, value: float, symbol: str = "") -> float:
        """Return ``value``, in the unit ``symbol``.

        Raises:
            ConfigError: If it is outside, or not finite.
        """
        if isinstance(value, int) and abs(value) > LARGEST:
            raise ConfigError(f"must fit into 64 bits, got {value.bit_length()} bits")
        if symbol != "s" and HUGE < abs(value) < math.inf:
            raise ConfigError(f"must be at most {HUGE:g} {symbol}, got {value:g} {symbol}")
        at_most = self._at_most(symbol)
        if (
            math.isfinite(value)
            and (self.above is None or value > self.above)
            and (self.at_least is None or value >= self.at_least)
            and (at_most is None or value <= at_most)
            and (self.below is None or value < self.below)
        ):
            return value
        got = f"{value:g} {symbol}".rstrip()
        raise ConfigError(f"must be {self.describe(symbol)}{self.hint}, got {got}")

    def _at_most(self, symbol: str) -> float | None:
        is_open = self.at_most is None and self.below is None
        return DAY if symbol == "s" and is_open else self.at_most

    def describe(self, symbol: str = "") -> str:
        """Return the range in words: ``> 0 Hz``, ``1 to 6``."""
        unit, at_most = f" {symbol}".rstrip(), self._at_most(symbol)
        if self.at_least is not None and at_most is not None:
            return f"{self.at_least:g} to {at_most:g}{unit}"
        bounds = ((">", self.above), (">=", self.at_least), ("<=", at_most), ("<", self.below))
        said = [f"{sign} {bound:g}{unit}" for sign, bound in bounds if bound is not None]
        return " and ".join(said) or "finite"

    def read(self, value: Any, symbol: str) -> Any:
        """Return the number, if it is within."""
        return self.check(value, symbol)


@dataclass(frozen=True)
class CheckedText:
    """Requirement on a text, in ``Annotated[str, CheckedText(check)]``."""

    check: Callable[[str], object]  # raises ConfigError if a text will not do

    def read(self, value: Any, symbol: str) -> Any:
        """Return the text, if it will do."""
        self.check(value)
        return value


POSITIVE = Range(above=0)
NOT_NEGATIVE = Range(at_least=0)
PROBABILITY = Range(at_least=0, at_most=1, hint=", or with a sign, 33 %")


def check_ranges(settings: Any) -> None:
    """Check, in ``__post_init__`` of a dataclass, the numbers whose types name a :class:`Range`.

    Raises:
        ConfigError: If one is outside; it names the field.
    """
    kind: type = type(settings)
    for name, permitted, symbol, words in _ranges_of(kind):
        value = getattr(settings, name)
        if value is None or (isinstance(value, str) and value in words):
            continue  # a word such as auto, or no value, in place of the number
        if isinstance(value, str):
            expected = f"a number{f' in {symbol}' if symbol else ''}"
            raise ConfigError(f"{name}: expected {expected}, got {value!r}", field=name)
        try:
            for number in value if isinstance(value, tuple) else (value,):
                permitted.check(number, symbol)
        except ConfigError as error:
            raise ConfigError(f"{name} {error}", field=name) from None


class Ranged:
    """Base of a dataclass whose construction checks its ranges."""

    def __post_init__(self) -> None:
        check_ranges(self)


@cache
def _ranges_of(kind: type) -> Sequence[tuple[str, Range, str, Sequence[str]]]:
    """Name, range, unit, and words in place of the number, of each field that has a range."""
    found = []
    for name, hint in get_type_hints(kind, include_extras=True).items():
        is_union = isinstance(hint, UnionType) or get_origin(hint) is Union
        choices: tuple[Any, ...] = get_args(hint) if is_union else (hint,)
        literals = [get_args(choice) for choice in choices if get_origin(choice) is Literal]
        words = [word for each in literals for word in each]
        for choice in choices:
            notes = choice.__metadata__ if get_origin(choice) is Annotated else ()
            symbols = [note.symbol for note in notes if isinstance(note, Unit)]
            ranges = [note for note in notes if isinstance(note, Range)]
            found += [(name, note, "".join(symbols), words) for note in ranges]
    return found


AS_WRITTEN = "as written"
#: A text that may look like a number, such as a serial number: it is taken as it is written.
Name: TypeAlias = Annotated[str, AS_WRITTEN]

Angle: TypeAlias = Annotated[float, Unit("rad")]
AngularSpeed: TypeAlias = Annotated[float, Unit("rad/s")]
DataRate: TypeAlias = Annotated[float, Unit("B/s")]
Damping: TypeAlias = Annotated[float, Unit("N s/m")]
Energy: TypeAlias = Annotated[float, Unit("J")]
Force: TypeAlias = Annotated[float, Unit("N")]
Frequency: TypeAlias = Annotated[float, Unit("Hz")]
Inertia: TypeAlias = Annotated[float, Unit("kg m^2")]
JointDamping: TypeAlias = Annotated[float, Unit("N m s")]
JointStiffness: TypeAlias = Annotated[float, Unit("N m/rad")]
Length: TypeAlias = Annotated[float, Unit("m")]
Mass: TypeAlias = Annotated[float, Unit("kg")]
Power: TypeAlias = Annotated[float, Unit("W")]
Ratio: TypeAlias = Annotated[float, Unit("")]
Speed: TypeAlias = Annotated[float, Unit("m/s")]
Stiffness: TypeAlias = Annotated[float, Unit("N/m")]
StiffnessRate: TypeAlias = Annotated[float, Unit("N/m/s")]
Time: TypeAlias = Annotated[float, Unit("s")]
Torque: TypeAlias = Annotated[float, Unit("N m")]
