"""Tables as text."""

from __future__ import annotations

from lvnav_trade.campaign.text import table


def test_columns_are_aligned_and_numbers_are_short() -> None:
    assert table(["case", "rms"], [["a", 1.23456], ["longer", 12]]) == "case    rms\na       1.235\nlonger  12"


def test_a_row_may_be_shorter_than_the_header() -> None:
    assert table(["a", "b", "c"], [["1"]]) == "a  b  c\n1"


def test_a_long_last_column_is_wrapped_to_the_width_and_keeps_its_words() -> None:
    rows = [["gate", "none", "number or none; innovation gate in sigma per scalar measurement; none: no gate"]]
    lines = table(["field", "default", "takes"], rows, 60).splitlines()
    assert max(map(len, lines)) <= 60
    assert all(line.startswith(" " * 16) for line in lines[2:])
    assert " ".join(" ".join(lines[1:]).split()) == " ".join(rows[0])
    assert table(["a"], [["x" * 40]], 20).splitlines()[1] == "x" * 40  # a word is not broken
