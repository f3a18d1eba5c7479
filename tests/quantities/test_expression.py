"""Arithmetic of named numbers: what is read, what is refused, what comes out."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.quantities.expression import evaluate, is_product, names


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("a / b", 0.5),
        ("max(a, b, 3) / min(a, b)", 3.0),
        ("100 * (a / b - 1)", -50.0),
        ("sqrt(b * b) - abs(-a)", 1.0),
    ],
)
def test_an_expression_has_the_value_of_its_arithmetic(text: str, value: float) -> None:
    assert evaluate(text, {"a": 1.0, "b": 2.0}) == pytest.approx(value)
    assert set(names(text)) == {"a", "b"}


def test_arrays_are_taken_element_by_element_and_a_division_by_zero_is_infinite() -> None:
    np.testing.assert_allclose(evaluate("max(a, b) / a", {"a": np.array([1.0, 4.0]), "b": 2.0}), [2.0, 1.0])
    assert np.isinf(evaluate("a / b", {"a": np.float64(1.0), "b": np.float64(0.0)}))


@pytest.mark.parametrize(
    "text", ["", "a b", "a ** 2", "a.b", "exit()", "a[0]", "a if b else c", "'a'", "True", "a" * 600, "a = b"]
)
def test_anything_else_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match="should be"):
        names(text)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("abs(a, b)", "should call abs with one value, as in abs(a)"),
        ("1 + sqrt(a, b)", "should call sqrt with one value, as in sqrt(a)"),
        ("abs()", "should call abs with one value, as in abs(a)"),
        ("min()", "should call min with its values, as in min(a, b)"),
        ("max - a", "should call max with its values, as in max(a, b)"),
        ("max(min, a)", "should call min with its values, as in min(a, b)"),
        ("max(*a)", "should be made of terms, numbers, + - * /, max, min, abs, sqrt and brackets"),
        ("max(a, default=b)", "should call max with its values, as in max(a, b)"),
        ("a + 1_000", "should have decimal numbers such as 1000.5, not '1_000'"),
        ("a + 0x10", "should have decimal numbers such as 1000.5, not '0x10'"),
        ("a + 1e999", "should have numbers below 1e308, not '1e999'"),
        (f"a + {'9' * 400}", f"should have numbers below 1e308, not '{'9' * 40} ... {'9' * 15}'"),
    ],
)
def test_a_call_of_wrong_arity_and_a_number_that_is_none_are_named(text: str, message: str) -> None:
    with pytest.raises(ValueError, match="should") as caught:
        names(text)
    assert str(caught.value) == message


def test_a_product_has_no_sums() -> None:
    assert is_product("max(a, b) / (2 * c)")
    assert not is_product("a / b - 1")
