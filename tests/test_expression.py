"""Arithmetic of named numbers: what is read, what is refused, what comes out."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.expression import evaluate, is_product, names, readings


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
    "text", ["", "a b", "a ** 2", "a.b", "exit()", "min()", "a[0]", "a if b else c", "'a'", "True", "a" * 600, "a = b"]
)
def test_anything_else_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match="should be"):
        names(text)


def test_a_product_has_no_sums() -> None:
    assert is_product("max(a, b) / (2 * c)")
    assert not is_product("a / b - 1")


def test_one_axis_varied_at_a_time_is_read_case_by_case():
    known = [{"a": "base", "b": "base"}, {"a": "1", "b": "base"}, {"a": "base", "b": "1"}, {"a": "base", "b": "2"}]
    assert [one.levels for one in readings(known, {"x": {}})] == known
    assert readings([], {"x": {}}) == []


def test_axes_that_vary_together_need_not_all_be_named():
    known = [{"a": "1", "b": "p"}, {"a": "2", "b": "q"}]
    assert [one.levels for one in readings(known, {"x": {}})] == [{"a": "1"}, {"a": "2"}]
