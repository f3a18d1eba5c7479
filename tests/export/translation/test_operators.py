"""Operators of the translator: done at once where both sides are known."""

import ast

import pytest

from lvnav_trade.export.translation.operators import (
    binary,
    combine_conditions,
    comparison,
    conditional_value,
    function_result,
    unary,
)
from lvnav_trade.export.translation.values import Constant, Scalar, TranslationError
from lvnav_trade.kernels.lanes import number_like, where

A, B, N = Scalar("a", "double"), Scalar("b", "double"), Scalar("n", "int")


def test_known_numbers_are_computed_at_once():
    assert binary(ast.Div(), Constant(1), Constant(8)) == Constant(0.125)
    assert unary(ast.Not(), Constant(0)) == Constant(True)
    assert comparison(ast.NotIn(), Constant(3), Constant((1, 2))) == Constant(True)
    assert conditional_value(Constant(False), A, B) is B
    assert function_result(where, [Constant(True), A, B]) is A
    assert function_result(number_like, [A, Constant(1)]) == Constant(1.0)


@pytest.mark.parametrize(("kind", "text"), [
    (ast.Sub(), "a - (a - b)"), (ast.Mult(), "a * (a - b)"), (ast.Div(), "a / (a - b)"),
])  # fmt: skip
def test_what_would_be_taken_from_the_left_stands_in_brackets(kind, text):
    assert binary(kind, A, binary(ast.Sub(), A, B)).text == text


def test_integers_divide_as_in_python():
    assert binary(ast.Div(), N, Constant(4)).text == "(double)n / 4"
    assert binary(ast.FloorDiv(), N, Scalar("m", "int")).text == "floor_divided(n, m)"
    with pytest.raises(TranslationError, match="no integers"):
        binary(ast.Mod(), A, Constant(2))


def test_a_part_of_and_or_that_decides_leaves_nothing_else():
    assert combine_conditions([A, Constant(False)], any_of=False) == Constant(False)
    assert combine_conditions([A, Constant(False), B], any_of=True).text == "a || b"
    assert combine_conditions([Constant(True)], any_of=False) == Constant(True)


def test_is_is_about_none_and_known():
    assert comparison(ast.Is(), A, Constant(None)) == Constant(False)
    with pytest.raises(TranslationError, match="with None only"):
        comparison(ast.Is(), A, B)
