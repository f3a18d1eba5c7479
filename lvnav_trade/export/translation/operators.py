"""Operators and functions of numbers: evaluated at once if the operands are known, otherwise translated to C."""

from __future__ import annotations

import ast
import math
import operator
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from lvnav_trade.export.translation.values import (
    ATOM,
    BIT_AND,
    BIT_OR,
    CHOICE,
    DOUBLE,
    EQUAL,
    INT,
    OR,
    ORDER,
    PRODUCT,
    SUM,
    UNARY,
    Constant,
    Scalar,
    TranslationError,
    Value,
    as_scalar,
    operand_text,
)
from lvnav_trade.kernels import lanes

_BINARY: dict[type, tuple[Callable[[Any, Any], Any], str, int]] = {
    ast.Add: (operator.add, "+", SUM),
    ast.Sub: (operator.sub, "-", SUM),
    ast.Mult: (operator.mul, "*", PRODUCT),
    ast.Div: (operator.truediv, "/", PRODUCT),
    ast.FloorDiv: (operator.floordiv, "", ATOM),
    ast.Mod: (operator.mod, "", ATOM),
    ast.BitAnd: (operator.and_, "&", BIT_AND),
    ast.BitOr: (operator.or_, "|", BIT_OR),
}
_COMPARED: dict[type, tuple[Callable[[Any, Any], Any], str, int]] = {
    ast.Lt: (operator.lt, "<", ORDER),
    ast.LtE: (operator.le, "<=", ORDER),
    ast.Gt: (operator.gt, ">", ORDER),
    ast.GtE: (operator.ge, ">=", ORDER),
    ast.Eq: (operator.eq, "==", EQUAL),
    ast.NotEq: (operator.ne, "!=", EQUAL),
}
# Functions of numbers, by the function in kernels: name in C, and function for known numbers.
FUNCTIONS: dict[Any, tuple[str, Callable[..., Any]]] = {
    getattr(math, name): (c, getattr(math, name))
    for name, c in {
        **{n: n for n in ("sqrt", "sin", "cos", "tan", "asin", "acos", "atan", "atan2", "exp", "log", "tanh", "sinh")},
        **{n: n for n in ("cosh", "floor", "ceil", "hypot", "log10", "log1p", "expm1", "pow", "fabs")},
    }.items()
} | {
    abs: ("fabs", abs),
    np.sqrt: ("sqrt", math.sqrt),
    np.exp: ("exp", math.exp),
    np.sin: ("sin", math.sin),
    np.cos: ("cos", math.cos),
    min: ("fmin", min),
    max: ("fmax", max),
}


def binary(node: ast.operator, a: Value, b: Value) -> Value:
    """Return the result of a binary operator on two numbers.

    Raises
    ------
    TranslationError
        The operator has no translation, or // or % has an operand that is not an integer.
    """
    if isinstance(a, Constant) and isinstance(b, Constant):
        divides_by_zero = isinstance(node, ast.Div) and b.value == 0
        if not divides_by_zero:
            evaluate = operator.pow if isinstance(node, ast.Pow) else _BINARY[type(node)][0]
            return Constant(evaluate(a.value, b.value))
    if isinstance(node, ast.Pow):
        return _power(as_scalar(a), b)
    if type(node) not in _BINARY:
        raise TranslationError(f"the operator {type(node).__name__} is not translated")
    left_operand = as_scalar(a)
    right_operand = as_scalar(b)
    number_type = common_type([left_operand, right_operand])
    if isinstance(node, ast.FloorDiv | ast.Mod):
        if number_type != INT:
            raise TranslationError("// and % of numbers that are no integers")
        name = "floor_divided" if isinstance(node, ast.FloorDiv) else "remainder_of"  # C rounds towards zero
        return Scalar(f"{name}({left_operand.text}, {right_operand.text})", INT)
    if isinstance(node, ast.Div) and number_type == INT:
        numerator = operand_text(left_operand, UNARY)
        denominator = operand_text(right_operand, UNARY)
        return Scalar(f"(double){numerator} / {denominator}", DOUBLE, PRODUCT)
    _, sign, level = _BINARY[type(node)]
    # Brackets as the precedence requires; comparisons next to & and | get brackets, because compilers warn otherwise
    limit = UNARY if level in (BIT_AND, BIT_OR) else level
    left_text = operand_text(left_operand, limit)
    right_text = operand_text(right_operand, min(limit, level - 1))
    return Scalar(f"{left_text} {sign} {right_text}", number_type, level)


def common_type(numbers: Iterable[Scalar]) -> str:
    """Return the C type of a result of several numbers: double if one of them is a double."""
    return DOUBLE if any(number.c_type == DOUBLE for number in numbers) else INT


def _power(base: Scalar, exponent: Value) -> Scalar:
    if isinstance(exponent, Constant) and exponent.value == 2 and base.level == ATOM:
        return Scalar(f"{base.text} * {base.text}", base.c_type, PRODUCT)
    return Scalar(f"pow({base.text}, {as_scalar(exponent).text})", DOUBLE)


def unary(node: ast.unaryop, a: Value) -> Value:
    """Return the result of a sign or `not` on a number."""
    if isinstance(node, ast.UAdd):
        return a
    if isinstance(a, Constant):
        return Constant(-a.value if isinstance(node, ast.USub) else not a.value)
    operand = as_scalar(a)
    if isinstance(node, ast.USub):
        return Scalar(f"-{operand_text(operand, ATOM)}", operand.c_type, UNARY)
    return Scalar(f"!{operand_text(operand, ATOM)}", INT, UNARY)


def comparison(node: ast.cmpop, a: Value, b: Value) -> Value:
    """Return the result of a comparison.

    `is` and `is not` are evaluated during the translation, because it is always known whether a value is None.

    Raises
    ------
    TranslationError
        The second operand of `is` is not None, or that of `in` is not a tuple of known numbers.
    """
    if isinstance(node, ast.Is | ast.IsNot):
        if b != Constant(None):
            raise TranslationError("is: with None only")
        is_none = isinstance(a, Constant) and a.value is None
        return Constant(is_none == isinstance(node, ast.Is))
    if isinstance(node, ast.In | ast.NotIn):
        return _membership(node, a, b)
    evaluate, sign, level = _COMPARED[type(node)]
    if isinstance(a, Constant) and isinstance(b, Constant):
        return Constant(bool(evaluate(a.value, b.value)))
    left_text = operand_text(as_scalar(a), SUM)
    right_text = operand_text(as_scalar(b), SUM)
    return Scalar(f"{left_text} {sign} {right_text}", INT, level)


def _membership(node: ast.cmpop, a: Value, b: Value) -> Value:
    """Return whether a number is in a tuple of known numbers."""
    if not isinstance(b, Constant):
        raise TranslationError("in: a tuple of known numbers only")
    if isinstance(a, Constant):
        return Constant((a.value in b.value) == isinstance(node, ast.In))
    comparisons = [comparison(ast.Eq(), a, Constant(item)) for item in b.value]
    condition = combine_conditions(comparisons, any_of=True)
    return condition if isinstance(node, ast.In) else unary(ast.Not(), condition)


def combine_conditions(operands: list[Value], any_of: bool) -> Value:
    """Return the conjunction of truth values, or their disjunction if `any_of`."""
    unknown_operands: list[Scalar] = []
    for operand in operands:
        if isinstance(operand, Constant):
            if bool(operand.value) == any_of:
                return Constant(any_of)
        else:
            unknown_operands.append(as_scalar(operand))
    return _chain(unknown_operands, any_of) if unknown_operands else Constant(not any_of)


def _chain(operands: list[Scalar], any_of: bool) -> Scalar:
    if len(operands) == 1:
        return operands[0]
    sign = " || " if any_of else " && "
    return Scalar(sign.join(operand_text(operand, EQUAL) for operand in operands), INT, OR)


def conditional_value(condition: Value, a: Value, b: Value) -> Value:
    """Return the first of two numbers if a condition is true, otherwise the second."""
    if isinstance(condition, Constant):
        return a if condition.value else b
    first = as_scalar(a)
    second = as_scalar(b)
    test = operand_text(as_scalar(condition), OR)
    text = f"{test} ? {operand_text(first, OR)} : {operand_text(second, OR)}"
    return Scalar(text, common_type([first, second]), CHOICE)


def function_result(function: Any, arguments: list[Value]) -> Value | None:
    """Return the result of a function of numbers; None for any other function."""
    if function is lanes.where:
        return conditional_value(*arguments)
    if function is lanes.number_like:
        return as_double(arguments[1])
    if function is float:
        return as_double(arguments[0])
    if function is int:
        return _as_int(arguments[0])
    if function not in FUNCTIONS:
        return None
    name, evaluate = FUNCTIONS[function]
    constants = [argument.value for argument in arguments if isinstance(argument, Constant)]
    if len(constants) == len(arguments):
        return Constant(evaluate(*constants))
    numbers = [as_scalar(argument) for argument in arguments]
    number_type = DOUBLE
    if name in ("fmin", "fmax") and common_type(numbers) == INT:
        number_type = INT
        name = "smaller" if name == "fmin" else "larger"
    return Scalar(f"{name}({', '.join(number.text for number in numbers)})", number_type)


def _as_int(value: Value) -> Value:
    if isinstance(value, Constant):
        return Constant(int(value.value))
    number = as_scalar(value)
    return number if number.c_type == INT else Scalar(f"(int){operand_text(number, ATOM)}", INT, UNARY)


def as_double(value: Value) -> Value:
    """Return a number as a double."""
    if isinstance(value, Constant):
        return Constant(float(value.value))
    number = as_scalar(value)
    return number if number.c_type == DOUBLE else Scalar(f"(double){operand_text(number, ATOM)}", DOUBLE, UNARY)
