"""A quantity is read once, in the datasheet's spelling, and refused where it cannot be meant."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Literal

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import TypeAdapter, ValidationError

from lvnav_trade.imu.error_model import GyroCard
from lvnav_trade.quantities import units
from lvnav_trade.quantities.input_limits import LARGEST, SMALLEST
from lvnav_trade.quantities.units import Card, parse, require_rising

DEG, HOUR, G = math.pi / 180.0, 3600.0, 9.80665


@pytest.mark.parametrize(
    ("text", "unit", "value"),
    [
        ("0.5 deg/h", "rad/s", 0.5 * DEG / HOUR),
        ("0.2 deg/sqrt(h)", "rad/s**0.5", 0.2 * DEG / 60.0),
        ("12 deg/h/sqrt(Hz)", "rad/s**0.5", 12.0 * DEG / HOUR),  # as a root PSD: 1 deg/h/sqrt(Hz) = 1/60 deg/sqrt(h)
        ("50 ug/sqrt(Hz)", "m/s**1.5", 50e-6 * G),
        ("0.05 m/s/sqrt(h)", "m/s**1.5", 0.05 / 60.0),
        ("1 deg/h/sqrt(h)", "rad/s**1.5", DEG / HOUR / 60.0),
        ("2 mg/sqrt(h)", "m/s**2.5", 2e-3 * G / 60.0),
        ("0.2 deg/rt-h", "rad/s**0.5", 0.2 * DEG / 60.0),
        ("0.2 \u00b0/hr/\u221aHz", "rad/s**0.5", 0.2 * DEG / HOUR),
        ("10 deg/h/g", "rad*s/m", 10.0 * DEG / HOUR / G),
        ("300 ppm", "dimensionless", 3e-4),
        ("0.1 %", "dimensionless", 1e-3),
        ("6 g", "m/s**2", 6.0 * G),
        ("2 h", "s", 7200.0),
        ("300 t", "kg", 3e5),
        ("10 Hz", "Hz", 10.0),
        ("1e-3 m^2", "m**2", 1e-3),
        ("-38.6 deg", "rad", -38.6 * DEG),
        ("45 dB-Hz", "dB-Hz", 45.0),
        ("-3.5 dBi", "dBi", -3.5),
        ("130 K", "K", 130.0),
        ("11 deg/g", "rad*s**2/m", 11.0 * DEG / G),
    ],
)
def test_a_datasheets_spelling_becomes_si(text: str, unit: str, value: float) -> None:
    assert parse(text, unit) == pytest.approx(value, rel=1e-12)


@pytest.mark.parametrize(
    ("text", "unit", "message"),
    [
        ("5", "s", "'5' has no unit; write it as a quantity in a unit of time (s, ms, min)"),
        ("deg/h", "rad/s", "'deg/h' is not a quantity: a number, one space and a unit, such as '0.5 deg/h'"),
        ("5 deg", "s", "'5 deg' has the wrong unit; expected time (s, ms, min)"),
        ("5 furlong/s", "m/s", "'5 furlong/s' has no unit that is known ('furlong'); expected speed (m/s, km/s)"),
        ("5 sec/", "s", "'5 sec/' has no unit that is known ('sec/'); expected time (s, ms, min)"),
        ("5 nm", "m", "'5 nm': 'nm' is a nanometre or a nautical mile; write nmi"),
        ("-5 K", "K", "'-5 K' is below absolute zero"),
        ("\u20135 deg", "rad", "'\u20135 deg' is not a quantity: U+2013 EN DASH; write digits 0 to 9, '-' and a space,"
         " as in '-0.5 deg/h'"),
        ("5\u00a0deg", "rad", "'5\\xa0deg' is not a quantity: U+00A0 NO-BREAK SPACE; write digits 0 to 9, '-' and a"
         " space, as in '-0.5 deg/h'"),
        ("\u00b10.4 mrad", "rad", "'\u00b10.4 mrad' has both signs where the quantity has one; write one number"),
        ("0.1%", "dimensionless", "'0.1%' is not a quantity: a number, one space and a unit, such as '0.1 %'"),
        ("5 deg/sqrt(h", "rad/s**0.5",
         "'5 deg/sqrt(h' has no unit that is known ('deg/sqrt(h'); expected angle random walk"
         " (deg/sqrt(h), deg/h/sqrt(Hz))"),
        ("nan m", "m", "'nan m' is not a finite quantity"),
        ("45 Hz", "dB-Hz", "'45 Hz' has the wrong unit; expected dB-Hz"),
        ("5 dB", "dBi", "'5 dB' has the wrong unit; expected dBi"),
        ("", "m", "'' is not a quantity: a number, one space and a unit, such as '0.5 deg/h'"),
    ],
)  # fmt: skip
def test_what_is_no_quantity_is_refused_in_one_line(text: str, unit: str, message: str) -> None:
    with pytest.raises(ValueError, match=r"quantity|unit|nmi|absolute zero") as caught:
        parse(text, unit)
    assert str(caught.value) == message


@pytest.mark.parametrize(
    ("text", "unit"),
    [
        ("10 000 m", "m"), ("2 500 m", "m"), ("1,5 m", "m"), ("1 5 m", "m"), ("1_000 m", "m"), ("1'000 m", "m"),
        ("1.000,5 m", "m"), ("0.1 deg + 3 rad", "rad"), ("0.1 deg 3 rad", "rad"), ("\uff19 m", "m"), ("9 \uff4d", "m"),
        ("\u0661 m", "m"), ("10Hz", "Hz"), ("5  m", "m"), (" 5 m", "m"), ("5 m ", "m"), ("5\tm", "m"), ("0x10 m", "m"),
        ("5 2*m", "m"), ("5 m.real", "m"), ("1 m**9**9**9**9", "m"), ("5 m**10", "m"), ("5 m^1e9", "m"), ("5 1", "m"),
        ("1" * 1_000_000 + " m", "m"), ("1 " + "m" * 1_000_000, "m"), ("1 " + "(" * 39 + "m", "m"), ("5 m-s", "m"),
    ],
)  # fmt: skip
def test_what_is_not_one_number_one_space_and_one_unit_is_refused(text: str, unit: str) -> None:
    with pytest.raises(ValueError, match=r"is not a quantity|has no unit that is known") as caught:
        parse(text, unit)
    assert len(str(caught.value)) < 300


@pytest.mark.parametrize(
    ("text", "unit"),
    [("5 kg", "m/s"), ("2 kg", "m/s**2"), ("9.8 m/s^2", "kg"),
     ("10 rad/s", "Hz"), ("10 Hz", "rad/s"), ("3 ppm", "rad"), ("3 rad", "dimensionless"),
     ("2 rad/s^2", "rad/s"), ("5 deg/h", "rad/s**0.5")],
)  # fmt: skip
def test_a_unit_of_another_dimension_is_refused_and_an_angle_is_a_dimension(text: str, unit: str) -> None:
    with pytest.raises(ValueError, match="has the wrong unit"):
        parse(text, unit)


@pytest.mark.parametrize(
    ("text", "unit"), [("9e99 deg", "rad"), ("1e13 m", "m"), ("4e5 km/s", "m/s"), ("1e31 1/s", "1/s")]
)
def test_a_number_that_nothing_has_is_refused(text: str, unit: str) -> None:
    with pytest.raises(ValueError, match="is too large; at most"):
        parse(text, unit)


@pytest.mark.parametrize("text", ["\u00b10.4 mrad", "+/-0.4 mrad", "+-0.4 mrad", "0.4 mrad"])
def test_a_plus_minus_sign_is_read_where_a_quantity_has_no_sign(text: str) -> None:
    assert Sample.model_validate({"tilt": text}).tilt == pytest.approx(4e-4, rel=1e-15)
    assert GyroCard.model_validate({"misalignment": [text, text, text]}).misalignment == pytest.approx(4e-4, rel=1e-15)
    assert GyroCard(full_scale="\u00b1490 deg/s").full_scale == parse("490 deg/s", "rad/s")


@pytest.mark.parametrize("text", ["\u00b1-0.4 mrad", "\u00b1+0.4 mrad", "\u00b1 0.4 mrad", "\u00b1\u00b10.4 mrad"])
def test_a_plus_minus_sign_stands_before_a_number_without_a_sign(text: str) -> None:
    with pytest.raises(ValidationError, match=r"has both signs|is not a quantity"):
        Sample.model_validate({"tilt": text})


def test_the_minus_sign_of_a_pdf_is_a_minus_sign() -> None:
    assert parse("\u22120.4 mrad", "rad") == parse("-0.4 mrad", "rad")
    assert parse("4e\u22124 rad", "rad") == parse("4e-4 rad", "rad")
    for text in ("0.\u22124 mrad", "\u2212\u22121 rad", "1\u22121 rad"):
        with pytest.raises(ValueError, match="is not a quantity"):
            parse(text, "rad")


def test_levels_are_read_by_each_of_their_spellings() -> None:
    assert parse("45 dBHz", "dB-Hz") == parse("45 dB-Hz", "dB-Hz") == 45.0
    assert parse("3 dBic", "dBi") == 3.0
    assert parse("-130 dBm", "dBW") == -160.0


def test_a_degree_of_temperature_is_offset_and_not_multiplied() -> None:
    assert parse("15 degC", "K") == pytest.approx(288.15, rel=1e-12)


@given(st.text(st.sampled_from("mskghHzdegrt/()+-.0123456789 %[]{}_'\"\\,:;=#\n\u00b5"), max_size=12))
def test_whatever_is_written_is_read_or_refused_in_one_line(text: str) -> None:
    try:
        found, said = parse(f"5 {text}", "s"), ""
    except ValueError as refused:
        found, said = 0.0, str(refused)
    assert math.isfinite(found)
    assert "\n" not in said


Sort = Literal["first", "second"]


class Sample(Card):
    """A field of every sort."""

    count: int = 1
    factors: tuple[float, ...] = ()
    share: float | None = None
    words: tuple[Sort, ...] = ()

    arm: units.Length = 0.0
    tilt: units.AngleSigma = 0.0
    sigma: units.AngularRateSigma = 0.0
    rate: units.Frequency = 1.0


def test_zero_needs_no_unit_and_any_other_bare_number_does() -> None:
    assert Sample.model_validate({"arm": 0}).arm == 0.0
    with pytest.raises(ValidationError, match="3 has no unit; write it as a quantity in a unit of length"):
        Sample.model_validate({"arm": 3})


@pytest.mark.parametrize("value", [True, None, [1], {"m": 1}])
def test_what_is_neither_text_nor_number_is_no_quantity(value: object) -> None:
    with pytest.raises(ValidationError, match="expected a quantity in a unit of length"):
        Sample.model_validate({"arm": value})


def test_a_lever_arm_has_a_sign_and_a_sigma_and_a_rate_have_none() -> None:
    assert Sample.model_validate({"arm": "-2 m"}).arm == -2.0
    assert Sample.model_validate({"sigma": "0 deg/h"}).sigma == 0.0
    with pytest.raises(ValidationError, match="greater than or equal to 0"):
        Sample.model_validate({"sigma": "-1 deg/h"})
    for rate in ("0 Hz", 0, "-1 Hz"):
        with pytest.raises(ValidationError, match="greater than 0"):
            Sample.model_validate({"rate": rate})


@given(st.floats(-LARGEST["m"], LARGEST["m"]).filter(lambda value: value == 0.0 or abs(value) >= SMALLEST))
def test_a_card_that_is_written_reads_back_to_the_same_number(value: float) -> None:
    field = TypeAdapter(units.Length)
    written = field.dump_python(value, mode="json")
    assert field.validate_python(written) == value


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("count", True, "should be a number, not true"),
        ("factors", [1.0, False], "should be a number, not false"),
        ("share", True, "should be a number, not true"),
        ("share", math.inf, "finite number"),
        ("factors", [math.nan], "finite number"),
        ("share", 1e40, "is too large"),
        ("count", 10**40, "is too large"),
        ("count", 10**400, "a number of too many digits is too large"),
        ("share", 10**400, "a number of too many digits is too large"),
        ("count", "1_000", "'1_000' is not a decimal number: digits 0 to 9 without separators"),
        ("share", "1_0.5", "'1_0.5' is not a decimal number"),
        ("count", "\u0661", "is not a decimal number"),
        ("words", ["first", "second", "first"], "'first' is listed twice"),
    ],
)
def test_a_truth_value_is_no_number_and_a_word_of_a_list_stands_once(field: str, value: object, message: str) -> None:
    with pytest.raises(ValidationError, match=message):
        Sample.model_validate({field: value})


def test_numbers_and_words_that_are_meant_are_read() -> None:
    found = Sample.model_validate({"count": 3, "factors": [1, 2.5], "share": 0.5, "words": ["second", "first"]})
    assert (found.count, found.factors, found.share, found.words) == (3, (1.0, 2.5), 0.5, ("second", "first"))


def test_a_key_that_a_card_does_not_know_is_an_error_and_a_card_cannot_be_changed() -> None:
    with pytest.raises(ValidationError, match="Extra inputs are not permitted"):
        Sample.model_validate({"amr": "1 m"})
    with pytest.raises(ValidationError, match="frozen"):
        Sample().arm = 1.0


class Span(Card):
    """A card with two rules of its own."""

    start: float = 0.0
    end: float = 1.0

    def _faults(self) -> Iterator[str]:
        if self.start < 0.0:
            yield "start lies before zero"
        if self.end < self.start:
            yield "end lies before start"


def test_the_first_fault_that_a_card_finds_in_itself_is_the_error() -> None:
    assert Span(start=0.5).end == 1.0
    with pytest.raises(ValidationError, match="Value error, end lies before start"):
        Span(start=2.0)
    with pytest.raises(ValidationError, match="Value error, start lies before zero"):
        Span(start=-1.0, end=-2.0)


def test_a_column_that_does_not_rise_is_refused_by_its_name() -> None:
    require_rising("mach", (0.0, 0.5, 2.0))
    with pytest.raises(ValueError, match="mach must rise from entry to entry"):
        require_rising("mach", (0.0, 0.5, 0.5))


@pytest.mark.parametrize(
    ("card", "why"),
    [
        (lambda: GyroCard(full_scale="0.5 deg/s"), "at least 1 deg/s"),
        (lambda: GyroCard(nonlinearity="300000 %"), "at most 100 %"),
        (lambda: GyroCard(scale_factor="200 %"), "at most 100 %"),
        (lambda: GyroCard(bias_repeatability="1e10 deg/h"), "at most 1000 deg/s"),
        (lambda: parse("5e-324 m", "m"), "too small; write 0"),
        (lambda: parse("1e29 ppm", "dimensionless"), "too large"),
    ],
)
def test_a_number_that_no_device_has_is_refused(card, why) -> None:
    with pytest.raises(ValueError, match=why):
        card()
