from dataclasses import dataclass
from typing import Annotated, Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from forcebound.errors import ConfigError
from forcebound.graph.fields import fields_of
from forcebound.graph.forms import read_as
from forcebound.graph.schema import properties
from forcebound.graph.tree import from_plain
from forcebound.quantities import POSITIVE, Range, Time
from forcebound.units import in_unit, parse_quantity, to_si


@pytest.mark.parametrize(
    ("text", "unit", "value"),
    [
        ("10 N/mm", "N/m", 10_000.0),
        ("10N/mm", "N/m", 10_000.0),
        ("0.06 N/mm/s", "N/m/s", 60.0),
        ("5 ms", "s", 0.005),
        ("100 µs", "s", 1e-4),
        ("100 μs", "s", 1e-4),
        ("0.03 mm", "m", 3e-5),
        ("-10 mm", "m", -0.01),
        ("+1e1 cm", "m", 0.1),
        ("1000 1/s", "Hz", 1000.0),
        ("75 g", "kg", 0.075),
        ("8.5 newton", "N", 8.5),
        ("2.8 N*s/m", "N s/m", 2.8),
        ("2.8 N·s/m", "N s/m", 2.8),
        ("981 cm/s²", "m/s^2", 9.81),
        ("40 %", "", 0.4),
        ("0.4", "", 0.4),
        (" .5 ", "s", 0.5),
        ("12", "s", 12.0),
        (12, "s", 12.0),
        (0.1, "s", 0.1),
        ("0 ms", "s", 0.0),
        ("1e-400 ms", "s", 0.0),
    ],
)
def test_a_quantity_is_the_float_nearest_to_what_is_written(
    text: object, unit: str, value: float
) -> None:
    assert parse_quantity(text, unit) == value


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ("3 meters", "3000 mm"),
        ("8 kbit/s", "1 kilobyte/second"),
        ("2 W s", "2 N m"),
        ("3 1/min", "0.05 Hz"),
        ("5 g cm^2", "5e-7 kg m**2"),
        ("7 mN s/mm", "7 N·s m^-1"),
        ("12 kg/s²", "0.012 N/mm"),
    ],
)
def test_a_quantity_is_the_same_in_other_units(one: str, other: str) -> None:
    assert to_si(one) == to_si(other) is not None


@pytest.mark.parametrize(
    ("value", "unit", "fragment"),
    [
        ("5 s", "N/m", "which is a time"),
        ("5 m^2", "m", "'5 m^2'"),
        ("20 periods", "s", "'periods'"),
        ("fast", "m/s", "'fast'"),
        ("", "s", "got ''"),
        ("1 2 s", "s", "got '1 2 s'"),
        ("0x10 s", "s", "got '0x10 s'"),
        ("1_000 s", "s", "got '1_000 s'"),
        ("9**9**9**9**9 s", "s", "a time"),
        ("1e400 s", "s", "finite"),
        ("1e308 ks", "s", "finite"),
        (float("nan"), "s", "finite"),
        (10**400, "s", "finite"),
        (True, "s", "true"),
        (None, "s", "got nothing"),
        ([1], "s", "got a list"),
        ("x" * 1000, "s", "xxx..."),
    ],
)
def test_what_is_no_such_quantity_says_what_was_expected_and_what_came(
    value: object, unit: str, fragment: str
) -> None:
    with pytest.raises(ConfigError) as caught:
        parse_quantity(value, unit)
    assert fragment in str(caught.value)


@given(st.text() | st.from_regex(r"[0-9.e+-]{1,8} ?[a-zA-Zµ/*^ 0-9%-]{0,12}", fullmatch=True))
def test_any_text_is_a_finite_float_or_a_config_error(text: str) -> None:
    try:
        value = parse_quantity(text, "N/m")
    except ConfigError:
        return
    assert abs(value) < float("inf")


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_a_number_and_its_text_are_the_same_quantity(value: float) -> None:
    assert parse_quantity(value, "m") == parse_quantity(repr(value), "m") == value


@pytest.mark.parametrize(
    ("bounds", "value", "message"),
    [
        (Range(above=0), 0.0, "must be > 0 s and <= 86400 s, got 0 s"),
        (Range(at_least=0), -1.0, "must be 0 to 86400 s, got -1 s"),
        (Range(at_most=1), 1.5, "must be <= 1 s, got 1.5 s"),
        (Range(below=1), 1.0, "must be < 1 s, got 1 s"),
        (Range(), 86_401.0, "must be <= 86400 s, got 86401 s"),
        (Range(), 2**70, "must fit into 64 bits, got 71 bits"),
    ],
)
def test_a_value_out_of_range_says_the_bound_and_its_unit(
    bounds: Range, value: float, message: str
) -> None:
    with pytest.raises(ConfigError, match=message):
        bounds.check(value, "s")


@dataclass(frozen=True)
class Sample:
    period: Annotated[Time, POSITIVE]
    wait: Time | None = None


@pytest.mark.parametrize(
    ("given_value", "fragment"),
    [
        ({"period": "1 kg"}, "which is a mass"),
        ({"period": "-1 ms"}, "must be > 0 s and <= 86400 s, got -0.001 s"),
        ({"period": 1, "wait": "1 kg"}, "which is a mass"),
    ],
)
def test_annotated_quantities_are_read(given_value: dict[str, Any], fragment: str) -> None:
    sound = from_plain({"period": "1 ms", "wait": "2 ms"}, "sample")
    assert read_as(Sample, sound, "sample") == Sample(0.001, 0.002)
    with pytest.raises(ConfigError) as caught:
        read_as(Sample, from_plain(given_value, "sample"), "sample")
    assert fragment in str(caught.value)


def test_an_editor_is_told_the_unit() -> None:
    described = properties(fields_of(Sample))["period"]["anyOf"][0]
    assert (
        described["description"] == "time in s; or with its unit, e.g. 5 ms; > 0 s and <= 86400 s"
    )


@pytest.mark.parametrize(
    ("value", "unit", "digits", "text"),
    [
        (0.02, "ms", 15, "20 ms"),
        (10_000.0, "N/mm", 15, "10 N/mm"),
        (3e-5, "mm", 15, "0.03 mm"),
        (0.4, "%", 15, "40 %"),
        (1234.5678, "N/mm", 3, "1.23 N/mm"),
        (-0.0, "mm", 15, "0 mm"),
        (2.5, "", 15, "2.5"),
        (2.5, "furlong", 15, "2.5"),  # there is no such unit: it is SI
        (float("inf"), "s", 15, "inf s"),
    ],
)
def test_a_quantity_is_written_in_a_unit(value: float, unit: str, digits: int, text: str) -> None:
    assert in_unit(value, unit, digits) == text


@given(st.floats(-1e12, 1e12), st.sampled_from(["ms", "s", "min"]))
def test_a_quantity_that_is_written_in_full_reads_as_it_was(value: float, unit: str) -> None:
    assert parse_quantity(in_unit(value, unit), "s") == pytest.approx(value, rel=1e-14)
