"""Tables as text."""

from __future__ import annotations

from lvnav_trade.campaign.text import table


def test_columns_are_aligned_and_numbers_are_short() -> None:
    assert table(["case", "rms"], [["a", 1.23456], ["longer", 12]]) == "case    rms\na       1.235\nlonger  12"


def test_a_row_may_be_shorter_than_the_header() -> None:
    assert table(["a", "b", "c"], [["1"]]) == "a  b  c\n1"
