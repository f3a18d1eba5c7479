"""Values of the translator: numbers as C writes them, declarations of arrays."""

import math

import numpy as np
import pytest

from lvnav_trade.export.translation.values import (
    ONLY,
    Array,
    Scalar,
    TranslationError,
    as_scalar,
    literal,
    operand_text,
    size_of,
    table_of,
)


@pytest.mark.parametrize(("value", "text"), [
    (0.1, "0.1"), (-2.5, "-2.5"), (1e300, "1e+300"), (3, "3"), (True, "1"), (math.inf, "INFINITY"),
    (-math.inf, "-INFINITY"), (np.float64(1 / 3), "0.3333333333333333"), (-0.0, "-0.0"),
])  # fmt: skip
def test_a_number_is_written_so_that_it_is_read_back_as_it_is(value, text):
    assert literal(value).text == text


def test_what_is_no_number_is_refused():
    with pytest.raises(TranslationError, match="'a' is no number"):
        literal("a")
    with pytest.raises(TranslationError, match="Array where a number should be"):
        as_scalar(Array("x", (3,), "double"))
    with pytest.raises(TranslationError, match="only the last axis"):
        size_of(Scalar("n", "int"))


def test_weaker_operators_stand_in_brackets():
    assert operand_text(Scalar("a + b", "double", 3), 2) == "(a + b)"
    assert operand_text(Scalar("a * b", "double", 2), 3) == "a * b"


def test_an_axis_that_is_always_the_present_one_is_not_declared():
    array = Array("x", (1, 4, 3), "double", rings=(ONLY,))
    assert array.declaration("p") == "double (*p)[3]"
    assert table_of("T", np.zeros((2, 3))).declaration("p") == "const double (*p)[3]"
    assert table_of("T", np.zeros(3, dtype=np.int64)).declaration("p") == "const int *p"
