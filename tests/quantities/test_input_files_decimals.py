"""Numbers as text are decimal digits of ASCII."""

from __future__ import annotations

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lvnav_trade.quantities.input_files import DECIMAL, decimal, decimal_or_endless, integer

NO_DECIMALS = ("1_000", "1_0.5", "1e1_0", "\u0661", "\uff11.5", "1\u0665", "\u22121", "0x10", "1,5", "1 000", "", "--1")


@pytest.mark.parametrize("text", NO_DECIMALS)
def test_separators_and_digits_of_other_scripts_are_no_numbers(text: str) -> None:
    for read in (decimal, decimal_or_endless, integer):
        with pytest.raises(ValueError, match=r"number|literal|convert"):
            read(text)


def test_a_number_is_finite_unless_the_caller_names_what_is_not() -> None:
    assert decimal(" -2.5e-3\r") == -2.5e-3
    assert integer(" 07 ") == 7
    assert decimal_or_endless("inf") == float("inf")
    for text in ("nan", "inf", "1e999", "9" * 400):
        with pytest.raises(ValueError, match="is not a finite number"):
            decimal(text)


@given(st.text(st.sampled_from("0123456789.eE+-_ \u0661\uff11"), max_size=6))
def test_whatever_is_read_fits_the_pattern_of_a_number(text: str) -> None:
    try:
        value = decimal(text)
    except ValueError:
        return
    assert re.fullmatch(DECIMAL, text.strip())
    assert value == float(text.strip())
