"""Units: a quantity as it is written, to a float in SI units.

A number without a unit is SI. Units of another dimension are refused.
"""

import math
import re
from decimal import Decimal
from functools import cache
from typing import NamedTuple

from forcebound.errors import ConfigError


def parse_quantity(value: object, unit: str) -> float:
    """Return a quantity as a finite float in the SI unit ``unit``.

    Args:
        value: A number, or text: ``"10 N/mm"``, ``"5ms"``, ``"40 %"``; without a unit it is SI.
        unit: Symbol of the expected SI unit, such as ``"N/m"``; ``""`` for a plain ratio.

    Raises:
        ConfigError: If it is not a finite number, its unit is unknown, or its dimension differs.
    """
    expected = _expected(unit)
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        raise ConfigError(f"expected {expected}; got {_shown(value)}")
    if not isinstance(value, str):
        return _finite(value, value, expected)
    number, given = split_quantity(value, expected)
    if not given:
        return number
    # 0.03 mm is 3e-5, the float nearest to what is written: floats would round twice.
    size = _size(given, unit, value, expected)
    return _finite(float(Decimal(repr(number)) * size), value, expected)


def split_quantity(
    text: str, expected: str = "a number, with or without a unit"
) -> tuple[float, str]:
    """Return number and unit of a quantity as it is written; the unit ``""`` if it has none.

    Raises:
        ConfigError: If it is no finite number with or without a unit.
    """
    match = _QUANTITY.fullmatch(text.strip())
    if match is None:
        raise ConfigError(f"expected {expected}; got {_shown(text)}")
    return _finite(float(match["number"]), text, expected), match["unit"] or ""


def in_unit(value: float, unit: str, digits: int = 15) -> str:
    """Return a quantity in SI as text in a unit that is written so: ``20 ms``.

    With as few of the ``digits`` as give the number again; a unit that there is not is none.
    """
    try:
        size = _unit(unit)[0] if unit else Decimal(1)
    except KeyError:
        unit, size = "", Decimal(1)
    number = float(Decimal(repr(value)) / size) + 0.0 if math.isfinite(value) else value
    text = f"{float(f'{number:.{digits}g}'):.15g}"
    if digits == 15 and float(text) != number:
        text = repr(number)
    return f"{text} {unit}".rstrip()


class Everyday(NamedTuple):
    """A quantity as people read it: in an everyday unit, with some digits after the point."""

    si: str  # its SI unit; "" for a count or a share
    unit: str  # everyday
    digits: int = 2

    @property
    def factor(self) -> float:
        """How many everyday units one SI unit has."""
        return 1.0 if self.si == self.unit else float(_unit(self.si)[0] / _unit(self.unit)[0])

    @property
    def suffix(self) -> str:
        """End of the key of a value in SI: ``_n_per_m``; "" for a count or a share."""
        return f"_{self.si.lower()}".replace("/", "_per_").replace(" ", "_") if self.si else ""

    def show(self, value: float | None) -> str:
        """Return a value in SI as text; a dash for None."""
        if value is None:
            return UNDEFINED
        # Adding zero turns a rounded -0.0 into 0.0: "-0.00 mJ" would read as a leak.
        number = round(value * self.factor, self.digits) + 0.0
        return f"{number:.{self.digits}f} {self.unit}".rstrip()

    def label(self, words: str) -> str:
        """Return the label of an axis: ``peak force (N)``."""
        if words.endswith(")"):
            return f"{words[:-1]}, {self.unit})"
        return f"{words} ({self.unit})" if self.unit else words


UNDEFINED = "–"
NUMBER, HZ, DB = (Everyday(unit, unit, 0) for unit in ("", "Hz", "dB"))
S, N, W = (Everyday(unit, unit) for unit in ("s", "N", "W"))
MM, MM_S, MJ = Everyday("m", "mm"), Everyday("m/s", "mm/s"), Everyday("J", "mJ")
MS, N_MM = Everyday("s", "ms", 0), Everyday("N/m", "N/mm")
RAD, RAD_S = Everyday("rad", "rad", 4), Everyday("rad/s", "rad/s", 3)
N_M, N_M_RAD = Everyday("N m", "N m", 3), Everyday("N m/rad", "N m/rad")
PERCENT, WHOLE = Everyday("", "%", 1), Everyday("", "%", 0)

#: By SI unit, what people use for small values; of the stiffness for large ones.
EVERYDAY = {each.si: each for each in (MM, MM_S, MJ, MS, N_MM)}

NO_ENERGY = 1e-9  # J; less is a rounding error


def energy_in_words(joules: float | None) -> str:
    """Return an energy with three digits: ``13.9 J``, ``194 mJ``, ``-0.4 uJ``; a dash for None.

    A rounding error is 0.
    """
    if joules is None:
        return UNDEFINED
    size = abs(joules)
    if size < NO_ENERGY:
        return "0"
    if size >= 999.5:
        return f"{joules:,.0f} J"
    units = (("J", 1.0), ("mJ", 1e3))
    unit, factor = next((one for one in units if size * one[1] >= 0.9995), ("uJ", 1e6))
    return f"{joules * factor:.3g} {unit}"


@cache
def to_si(text: str) -> float | None:
    """Return a quantity of any dimension that parameters have, in SI; None if it is none."""
    for symbol in ("", *NAMES):
        try:
            return parse_quantity(text, symbol)
        except ConfigError:
            continue
    return None


_FACTOR_PATTERN = r"(?:1|[A-Za-zµμ%]+(?:(?:\^|\*\*)-?[1-9]|[²³])?)"
_QUANTITY = re.compile(
    r"(?P<number>[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?)"
    rf"\s*(?P<unit>{_FACTOR_PATTERN}(?:(?:\s*[*·/]\s*|\s+){_FACTOR_PATTERN}){{0,7}})?"
)

#: Unit -> name of the quantity and an example, for messages.
NAMES = {
    "": ("ratio", "0.4 or 40 %"),
    "B/s": ("data rate", "64 kB/s"),
    "Hz": ("frequency", "1 kHz"),
    "J": ("energy", "2 mJ"),
    "N": ("force", "8.5 N"),
    "W": ("power", "50 mW"),
    "N m": ("torque", "0.1 N m"),
    "N m s": ("damping of a joint", "1e-3 N m s"),
    "N m/rad": ("stiffness of a joint", "2 N m/rad"),
    "N m/rad/s": ("rate of a joint's stiffness", "0.5 N m/rad/s"),
    "N s/m": ("damping", "0.27 N s/m"),
    "N/m": ("stiffness", "10 N/mm"),
    "N/m/s": ("rate of stiffness", "0.06 N/mm/s"),
    "kg m^2": ("inertia", "1e-4 kg m^2"),
    "kg": ("mass", "75 g"),
    "m": ("length", "0.03 mm"),
    "m/s": ("speed", "200 mm/s"),
    "m/s^2": ("acceleration", "9.81 m/s^2"),
    "rad": ("angle", "30 deg"),
    "rad/s": ("angular speed", "90 deg/s"),
    "rad/s^2": ("angular acceleration", "10 rad/s^2"),
    "s": ("time", "5 ms"),
}

#: Spellings of each unit, its size in SI, and the powers of m, s, kg and byte in it. Only what a
#: force-feedback experiment needs: of more words, a slip of the pen would often be one.
_UNITS = {
    name: (Decimal(size), powers)
    for names, size, powers in (
        ("m meter metre", "1", (1, 0, 0, 0)),
        ("in inch", "0.0254", (1, 0, 0, 0)),
        ("s sec second", "1", (0, 1, 0, 0)),
        ("min minute", "60", (0, 1, 0, 0)),
        ("Hz Hertz hertz", "1", (0, -1, 0, 0)),
        ("g gram", "0.001", (0, 0, 1, 0)),
        ("N Newton newton", "1", (1, -2, 1, 0)),
        ("lbf", "4.4482216152605", (1, -2, 1, 0)),
        ("J joule", "1", (2, -2, 1, 0)),
        ("W watt", "1", (2, -3, 1, 0)),
        ("B byte", "1", (0, 0, 0, 1)),
        ("bit", "0.125", (0, 0, 0, 1)),
        ("1 rad radian", "1", (0, 0, 0, 0)),
        ("deg degree", "0.0174532925199433", (0, 0, 0, 0)),
        ("% percent", "0.01", (0, 0, 0, 0)),
    )
    for name in names.split()
}
_PREFIXES = {
    name: Decimal(size)
    for names, size in (
        ("n nano", "1e-9"),
        ("u µ μ micro", "1e-6"),
        ("m milli", "1e-3"),
        ("c centi", "1e-2"),
        ("k kilo", "1e3"),
        ("M mega", "1e6"),
    )
    for name in names.split()
}
_FACTOR = re.compile(r"([*·/]?)\s*(1|[A-Za-zµμ%]+)(?:\^|\*\*)?(-?[1-9]|[²³])?")


@cache
def _unit(text: str) -> tuple[Decimal, tuple[int, ...]]:
    """Return size and powers of a unit as it is written; KeyError for a name that is none."""
    size = Decimal(1)
    powers: tuple[int, ...] = (0, 0, 0, 0)
    for sign, name, exponent in _FACTOR.findall(text):
        factor, inner = _named(name)
        power = int(exponent.translate({ord("²"): "2", ord("³"): "3"}) or 1)
        power = -power if sign == "/" else power
        size *= factor**power
        powers = tuple(a + power * b for a, b in zip(powers, inner, strict=True))
    return size, powers


def _named(name: str) -> tuple[Decimal, tuple[int, ...]]:
    """Return size and powers of a unit by its name, which may have a prefix or be a plural."""
    for spelling in (name, name.removesuffix("s") if len(name) > 3 else name):
        if spelling in _UNITS:
            return _UNITS[spelling]
        for prefix, factor in _PREFIXES.items():
            unit = (
                _UNITS.get(spelling.removeprefix(prefix)) if spelling.startswith(prefix) else None
            )
            if unit is not None:
                return factor * unit[0], unit[1]
    raise KeyError(name)


def _size(given: str, unit: str, value: str, expected: str) -> Decimal:
    """Return how many of ``unit`` one of ``given`` is."""
    try:
        size, powers = _unit(given)
    except KeyError as error:
        raise ConfigError(f"unknown unit {error} in {value!r}: expected {expected}") from None
    if powers != _unit(unit)[1]:
        kinds = (
            _article(name) for symbol, (name, _) in NAMES.items() if _unit(symbol)[1] == powers
        )
        known = next(kinds, "no quantity of a launch file")
        raise ConfigError(f"expected {expected}; got {value!r}, which is {known}")
    return size


def _expected(unit: str) -> str:
    name, example = NAMES.get(unit, ("quantity", ""))
    words = _article(name) + (f" in {unit}" if unit else "")
    return words + (f", for example {example}" if example else "")


def _article(name: str) -> str:
    return f"{'an' if name[0] in 'aeiou' else 'a'} {name}"


def _finite(number: float, value: object, expected: str) -> float:
    try:
        result = float(number)
    except OverflowError:  # an int beyond the floats
        result = math.inf
    if not math.isfinite(result):
        raise ConfigError(f"expected {expected}, finite; got {_shown(value)}")
    return result


def _shown(value: object) -> str:
    if value is None:
        return "nothing"
    kind = "mapping" if isinstance(value, dict) else type(value).__name__
    text = repr(value) if isinstance(value, str | int | float) else f"a {kind}"
    if isinstance(value, bool):
        text = text.lower()
    return text if len(text) <= 60 else text[:57] + "..."
