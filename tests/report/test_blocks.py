"""How numbers are written."""

from __future__ import annotations

import pytest

from lvnav_trade.report.blocks import number, percent


@pytest.mark.parametrize(
    ("value", "told"),
    [
        (0.0, "0"), (1234.5, "1230"), (0.012345, "0.0123"), (9.996, "10.0"), (1.0, "1.00"), (1e-7, "1.00e-07"),
        (float("nan"), "–"), (float("inf"), "∞"), (7, "7"), (-45.67, "-45.7"),
    ],
)  # fmt: skip
def test_numbers_have_three_significant_digits(value, told):
    assert number(value) == told


def test_percent_does_not_round_a_requirement_away():
    assert percent(0.9973) == "99.73 %"
