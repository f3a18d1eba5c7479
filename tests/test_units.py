"""A quantity is read once, in the datasheet's spelling, and refused where it cannot be meant."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import TypeAdapter, ValidationError

from lvnav_trade import units
from lvnav_trade.units import Card, parse

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
        ("10 deg/h/g", "rad*s/m", 10.0 * DEG / HOUR / G),
        ("300 ppm", "dimensionless", 3e-4),
        ("0.1 %", "dimensionless", 1e-3),
        ("6 g", "m/s**2", 6.0 * G),
        ("2 h", "s", 7200.0),
        ("300 t", "kg", 3e5),
        ("10Hz", "Hz", 10.0),
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
        ("deg/h", "rad/s", "'deg/h' is not a quantity: a number and a unit, such as '0.5 deg/h'"),
        ("5 furlong", "s", "'5 furlong' has the wrong unit; expected time (s, ms, min)"),
        ("5 secs/", "s", "'5 secs/' has no unit that is known ('secs/'); expected time (s, ms, min)"),
        ("5 deg/sqrt(h", "rad/s**0.5",
         "'5 deg/sqrt(h' has no unit that is known ('deg/sqrt(h'); expected angle random walk"
         " (deg/sqrt(h), deg/h/sqrt(Hz))"),
        ("nan m", "m", "'nan m' is not a finite quantity"),
        ("45 Hz", "dB-Hz", "'45 Hz' has the wrong unit; expected dB-Hz"),
        ("5 dB", "dBi", "'5 dB' has the wrong unit; expected dBi"),
        ("", "m", "'' is not a quantity: a number and a unit, such as '0.5 deg/h'"),
    ],
)  # fmt: skip
def test_what_is_no_quantity_is_refused_in_one_line(text: str, unit: str, message: str) -> None:
    with pytest.raises(ValueError, match=r"quantity|unit") as caught:
        parse(text, unit)
    assert str(caught.value) == message


@given(st.text(st.sampled_from("mskghHzdegrt/()+-.0123456789 %[]{}_'\"\\,:;=#\n\u00b5"), max_size=12))
def test_whatever_is_written_is_read_or_refused_in_one_line(text: str) -> None:
    try:
        found, said = parse(f"5 {text}", "s"), ""
    except ValueError as refused:
        found, said = 0.0, str(refused)
    assert math.isfinite(found)
    assert "\n" not in said


class Sample(Card):
    """A field of every sort."""

    arm: units.Length = 0.0
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


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_a_card_that_is_written_reads_back_to_the_same_number(value: float) -> None:
    field = TypeAdapter(units.Length)
    written = field.dump_python(value, mode="json")
    assert field.validate_python(written) == value


def test_a_key_that_a_card_does_not_know_is_an_error_and_a_card_cannot_be_changed() -> None:
    with pytest.raises(ValidationError, match="Extra inputs are not permitted"):
        Sample.model_validate({"amr": "1 m"})
    with pytest.raises(ValidationError, match="frozen"):
        Sample().arm = 1.0
