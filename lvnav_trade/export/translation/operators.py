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
    held,
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


def binary(kind: ast.operator, a: Value, b: Value) -> Value:
    """Return the result of a binary operator on two numbers.

    Raises
    ------
    TranslationError
        The operator has no translation, or // or % has an operand that is not an integer.
    """
    if isinstance(a, Constant) and isinstance(b, Constant):
        divides_by_zero = isinstance(kind, ast.Div) and b.value == 0
        if not divides_by_zero:
            evaluate = operator.pow if isinstance(kind, ast.Pow) else _BINARY[type(kind)][0]
            return Constant(evaluate(a.value, b.value))
    if isinstance(kind, ast.Pow):
        return _power(as_scalar(a), b)
    if type(kind) not in _BINARY:
        raise TranslationError(f"the operator {type(kind).__name__} is not translated")
    left_operand = as_scalar(a)
    right_operand = as_scalar(b)
    number_type = common_type([left_operand, right_operand])
    if isinstance(kind, ast.FloorDiv | ast.Mod):
        if number_type != INT:
            raise TranslationError("// and % of numbers that are no integers")
        name = "floor_divided" if isinstance(kind, ast.FloorDiv) else "remainder_of"  # C rounds towards zero
        return Scalar(f"{name}({left_operand.text}, {right_operand.text})", INT)
    if isinstance(kind, ast.Div) and number_type == INT:
        numerator = held(left_operand, UNARY)
        denominator = held(right_operand, UNARY)
        return Scalar(f"(double){numerator} / {denominator}", DOUBLE, PRODUCT)
    _, sign, level = _BINARY[type(kind)]
    # Brackets as the precedence requires; comparisons next to & and | get brackets, because compilers warn otherwise
    limit = UNARY if level in (BIT_AND, BIT_OR) else level
    left_text = held(left_operand, limit)
    right_text = held(right_operand, min(limit, level - 1))
    return Scalar(f"{left_text} {sign} {right_text}", number_type, level)


def common_type(numbers: Iterable[Scalar]) -> str:
    """Return the C type of a result of several numbers: double if one of them is a double."""
    return DOUBLE if any(number.kind == DOUBLE for number in numbers) else INT


def _power(base: Scalar, exponent: Value) -> Scalar:
    if isinstance(exponent, Constant) and exponent.value == 2 and base.level == ATOM:
        return Scalar(f"{base.text} * {base.text}", base.kind, PRODUCT)
    return Scalar(f"pow({base.text}, {as_scalar(exponent).text})", DOUBLE)


def unary(kind: ast.unaryop, a: Value) -> Value:
    """Return the result of a sign or `not` on a number."""
    if isinstance(kind, ast.UAdd):
        return a
    if isinstance(a, Constant):
        return Constant(-a.value if isinstance(kind, ast.USub) else not a.value)
    operand = as_scalar(a)
    if isinstance(kind, ast.USub):
        return Scalar(f"-{held(operand, ATOM)}", operand.kind, UNARY)
    return Scalar(f"!{held(operand, ATOM)}", INT, UNARY)


def compared(kind: ast.cmpop, a: Value, b: Value) -> Value:
    """Return the result of a comparison.

    `is` and `is not` are evaluated during the translation, because it is always known whether a value is None.

    Raises
    ------
    TranslationError
        The second operand of `is` is not None, or that of `in` is not a tuple of known numbers.
    """
    if isinstance(kind, ast.Is | ast.IsNot):
        if b != Constant(None):
            raise TranslationError("is: with None only")
        is_none = isinstance(a, Constant) and a.value is None
        return Constant(is_none == isinstance(kind, ast.Is))
    if isinstance(kind, ast.In | ast.NotIn):
        return _among(kind, a, b)
    evaluate, sign, level = _COMPARED[type(kind)]
    if isinstance(a, Constant) and isinstance(b, Constant):
        return Constant(bool(evaluate(a.value, b.value)))
    left_text = held(as_scalar(a), SUM)
    right_text = held(as_scalar(b), SUM)
    return Scalar(f"{left_text} {sign} {right_text}", INT, level)


def _among(kind: ast.cmpop, a: Value, b: Value) -> Value:
    """Return whether a number is in a tuple of known numbers."""
    if not isinstance(b, Constant):
        raise TranslationError("in: a tuple of known numbers only")
    if isinstance(a, Constant):
        return Constant((a.value in b.value) == isinstance(kind, ast.In))
    comparisons = [compared(ast.Eq(), a, Constant(item)) for item in b.value]
    condition = joined(comparisons, any_of=True)
    return condition if isinstance(kind, ast.In) else unary(ast.Not(), condition)


def joined(parts: list[Value], any_of: bool) -> Value:
    """Return the conjunction of truth values, or their disjunction if `any_of`."""
    unknown: list[Scalar] = []
    for operand in parts:
        if isinstance(operand, Constant):
            if bool(operand.value) == any_of:
                return Constant(any_of)
        else:
            unknown.append(as_scalar(operand))
    return _chain(unknown, any_of) if unknown else Constant(not any_of)


def _chain(parts: list[Scalar], any_of: bool) -> Scalar:
    if len(parts) == 1:
        return parts[0]
    sign = " || " if any_of else " && "
    return Scalar(sign.join(held(operand, EQUAL) for operand in parts), INT, OR)


def chosen(condition: Value, a: Value, b: Value) -> Value:
    """Return the first of two numbers if a condition is true, otherwise the second."""
    if isinstance(condition, Constant):
        return a if condition.value else b
    first = as_scalar(a)
    second = as_scalar(b)
    test = held(as_scalar(condition), OR)
    return Scalar(f"{test} ? {held(first, OR)} : {held(second, OR)}", common_type([first, second]), CHOICE)


def called(function: Any, arguments: list[Value]) -> Value | None:
    """Return the result of a function of numbers; None for any other function."""
    if function is lanes.where:
        return chosen(*arguments)
    if function is lanes.like:
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
    return number if number.kind == INT else Scalar(f"(int){held(number, ATOM)}", INT, UNARY)


def as_double(value: Value) -> Value:
    """Return a number as a double."""
    if isinstance(value, Constant):
        return Constant(float(value.value))
    number = as_scalar(value)
    return number if number.kind == DOUBLE else Scalar(f"(double){held(number, ATOM)}", DOUBLE, UNARY)
