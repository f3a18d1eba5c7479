"""Quantities of resolved settings in the units of data sheets; conversions by hand."""

from __future__ import annotations

import math

import pytest

from lvnav_trade.quantities.units import parse
from lvnav_trade.results.statistics.display_units import display_text


@pytest.mark.parametrize(
    ("sheet", "unit"),
    [
        ("1 deg/h", "rad/s"),
        ("3 deg/s", "rad/s"),
        ("0.15 deg/sqrt(h)", "rad/s**0.5"),
        ("0.1 deg/h/sqrt(h)", "rad/s**1.5"),
        ("0.06 m/s/sqrt(h)", "m/s**1.5"),
        ("2 mg/sqrt(h)", "m/s**2.5"),
        ("7.5 mg", "m/s**2"),
        ("25 ug", "m/s**2"),
        ("30 g", "m/s**2"),
        ("1000 ppm", "dimensionless"),
        ("5 %", "dimensionless"),
        ("0.05 mrad", "rad"),
        ("100 deg", "rad"),
        ("1 deg/h/g", "rad*s/m"),
        ("350 ppm/sqrt(year)", "1/s**0.5"),
        ("0.0372 l", "m**3"),
        ("54000 kg", "kg"),
        ("350 km", "m"),
        ("0 deg/s", "rad/s"),
    ],
)
def test_a_quantity_is_written_in_the_unit_of_a_data_sheet(sheet: str, unit: str) -> None:
    assert display_text(f"{parse(sheet, unit)!r} {unit}") == sheet


def test_settings_and_lists_are_written_by_their_first_parts() -> None:
    found = display_text(
        {"name": "x", "kind": "cosine", "peak": f"{math.pi!r} rad", "assumed": {"peak": "y"}, "of": None}
    )
    assert found == "kind cosine, peak 180 deg"
    assert display_text(["1.0 m", "2.0 m", "3.0 m", "4.0 m", "5.0 m", "6.0 m"]) == "1 m, 2 m, 3 m, 4 m and 2 more"
    assert display_text(None) == ""
