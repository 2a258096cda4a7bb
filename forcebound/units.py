"""Units: a quantity as it is written, to a float in SI units.

A number without a unit is SI. Units of another dimension are refused, and so is what is too large
or too small to be meant.
"""

import math
import re
from decimal import Decimal
from functools import cache, lru_cache
from typing import TYPE_CHECKING, Any

from forcebound.errors import ConfigError

if TYPE_CHECKING:
    import pint

SMALLEST, LARGEST = 1e-30, 1e30  # SI; beyond is a slip of the pen, and its square may be 0 or inf
LONGEST = 9e9  # s, 285 years: all that 64 bits of nanoseconds hold


def parse_quantity(value: object, unit: str) -> float:
    """Return a quantity as a finite float in the SI unit ``unit``.

    Args:
        value: A number, or text: ``"10 N/mm"``, ``"5ms"``, ``"40 %"``; without a unit it is SI.
        unit: Symbol of the expected SI unit, such as ``"N/m"``; ``""`` for a plain ratio.

    Raises:
        ConfigError: If it is not a finite number, its unit is unknown, its dimension differs, or
            it is a time beyond ``LONGEST``.
    """
    expected = _expected(unit)
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        raise ConfigError(f"expected {expected}; got {_shown(value)}")
    if isinstance(value, str):
        number, given = split_quantity(value, expected)
        if given:
            # 0.03 mm is 3e-5, the float nearest to what is written: floats would round twice.
            factor = _factor(given, unit, value, expected)
            number = _finite(float(Decimal(repr(number)) * factor), value, expected)
    else:
        number = _finite(value, value, expected)
    if unit == "s" and abs(number) > LONGEST:
        raise ConfigError(f"expected {expected}, at most {LONGEST:g} s; got {_shown(value)}")
    if number and not SMALLEST <= abs(number) <= LARGEST:
        raise ConfigError(
            f"expected {expected}, 0 or {SMALLEST:g} to {LARGEST:g} in size; got {_shown(value)}"
        )
    return number


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


@lru_cache(maxsize=65536)
def to_si(text: str) -> float | None:
    """Return a quantity of any dimension that parameters have, in SI; None if it is none."""
    for symbol in ("", *NAMES):
        try:
            return parse_quantity(text, symbol)
        except ConfigError:
            continue
    return None


# The unit part is matched before pint sees it: pint evaluates arithmetic, also `9**9**9**9`.
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
    "s": ("time", "5 ms"),
}

# Only what a force-feedback experiment needs: pint's own list takes 0.13 s to read and knows so
# many words (`a` is a year, `p` a pico) that a slip of the pen is often a unit of something.
_DEFINITIONS = """
nano- = 1e-9 = n-
micro- = 1e-6 = µ- = μ- = u-
milli- = 1e-3 = m-
centi- = 1e-2 = c-
kilo- = 1e3 = k-
mega- = 1e6 = M-
meter = [length] = m = metre
second = [time] = s = sec
gram = [mass] = g
radian = [] = rad
degree = 0.017453292519943295 * radian = deg
percent = 0.01 = %
byte = [data] = B
bit = 0.125 * byte
newton = kilogram * meter / second ** 2 = N = Newton
joule = newton * meter = J
watt = joule / second = W
hertz = 1 / second = Hz = Hertz
minute = 60 * second = min
inch = 0.0254 * meter = in
pound_force = 4.4482216152605 * newton = lbf
"""


@cache
def _registry() -> "pint.UnitRegistry[float]":
    import pint  # 0.15 s, with dask 0.25 s: only for units that are not in COMMON_FACTORS

    registry: pint.UnitRegistry[float] = pint.UnitRegistry(None)  # pyright: ignore[reportArgumentType]
    registry.load_definitions(_DEFINITIONS.strip().splitlines())
    return registry


#: The units of most launch files, SI unit -> unit -> factor, as pint has them: a launch that needs
#: no others starts without it.
COMMON_FACTORS = {
    "": {"%": "0.01"},
    "Hz": {"kHz": "1000"},
    "N/m": {"N/mm": "1000"},
    "N/m/s": {"N/mm/s": "1000"},
    "kg": {"g": "0.001"},
    "m": {"mm": "0.001"},
    "m/s": {"mm/s": "0.001"},
    "s": {"ms": "0.001", "us": "0.000001", "min": "60"},
}

# Found before: a sweep reads the same units often.
_FACTORS = {
    (given, unit): Decimal(factor)
    for unit, factors in COMMON_FACTORS.items()
    for given, factor in factors.items()
}


def _factor(given: str, unit: str, value: str, expected: str) -> Decimal:
    """How many of ``unit`` one of ``given`` is; powers of ten exactly."""
    known = Decimal(1) if given == unit else _FACTORS.get((given, unit))
    if known is not None:
        return known
    import pint

    registry = _registry()
    text = given.replace("²", "^2").replace("³", "^3").replace("·", "*")
    try:
        source = registry.parse_units(text)
    except pint.UndefinedUnitError as error:
        names = error.unit_names
        unknown = names if isinstance(names, str) else ", ".join(names)
        raise ConfigError(f"unknown unit {unknown!r} in {value!r}: expected {expected}") from None
    target = registry.parse_units(unit)
    if source.dimensionality != target.dimensionality:
        raise ConfigError(f"expected {expected}; got {value!r}, which is {_named(source)}")
    number = _finite(registry.convert(1.0, source, target), value, expected)
    factor = _FACTORS[given, unit] = Decimal(f"{number:.15g}")
    return factor


def _named(unit: Any) -> str:
    """The quantity that a unit of pint measures, with its article."""
    for symbol, (name, _) in NAMES.items():
        if _registry().parse_units(symbol).dimensionality == unit.dimensionality:
            return _article(name)
    return f"of dimension {unit.dimensionality}"


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
    if isinstance(value, int) and value.bit_length() > 1000:  # Python refuses to print some
        return "an enormous number"
    text = repr(value) if isinstance(value, str | int | float) else f"a {type(value).__name__}"
    if isinstance(value, bool):
        text = text.lower()
    return text if len(text) <= 60 else text[:57] + "..."
