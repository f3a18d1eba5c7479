"""Arithmetic expressions of named numbers, written as text.

``a / b``, ``max(a, b, c) / min(a, b, c)``, ``100 * (a / b - 1)``.
"""

import ast
import math
import re
from collections.abc import Callable, Mapping
from functools import reduce
from typing import Any

import numpy as np

from lvnav_trade.quantities.errors import quoted
from lvnav_trade.quantities.input_files import DECIMAL

_BINARY: dict[type[ast.operator], Callable[[Any, Any], Any]] = {
    ast.Add: np.add,
    ast.Sub: np.subtract,
    ast.Mult: np.multiply,
    ast.Div: np.divide,
}
_FUNCTIONS: dict[str, Callable[..., Any]] = {
    "max": lambda *values: reduce(np.maximum, values),
    "min": lambda *values: reduce(np.minimum, values),
    "abs": np.abs,
    "sqrt": np.sqrt,
}
_SINGLE = ("abs", "sqrt")  # these have one argument, the others one or more
_LENGTH = 500  # characters


def _parse(text: str) -> ast.expr:
    try:
        if len(text) > _LENGTH:
            raise ValueError
        tree = ast.parse(text.strip(), mode="eval").body
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        raise ValueError("should be an expression such as 'a / b' or 'max(a, b) / min(a, b)'") from None
    function_ids = {id(node.func) for node in ast.walk(tree) if isinstance(node, ast.Call)}
    for node in ast.walk(tree):
        is_called = id(node) in function_ids
        fault = _fault(node, text.strip(), is_called)
        if fault:
            raise ValueError(fault)
    return tree


def _fault(node: ast.AST, text: str, is_called: bool) -> str:
    """Return the error of a node in the syntax tree of `text`; empty if the node is allowed.

    is_called : Whether the node is the function of a call.
    """
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in _FUNCTIONS:
        name = node.func.id
        has_arguments = bool(node.args) and not node.keywords
        too_many = name in _SINGLE and len(node.args) != 1
        is_allowed = has_arguments and not too_many
        return "" if is_allowed else _call_fault(name)
    if isinstance(node, ast.Name) and node.id in _FUNCTIONS and not is_called:
        return _call_fault(node.id)
    if isinstance(node, ast.Constant) and isinstance(node.value, int | float) and not isinstance(node.value, bool):
        number_text = ast.get_source_segment(text, node)
        return _number_fault(number_text or "")
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
        return ""
    if isinstance(node, (ast.BinOp, ast.Name, ast.Load, ast.USub, *_BINARY)):
        return ""
    return f"should be made of terms, numbers, + - * /, {', '.join(_FUNCTIONS)} and brackets"


def _number_fault(number_text: str) -> str:
    if not re.fullmatch(DECIMAL, number_text):
        return f"should have decimal numbers such as 1000.5, not {quoted(number_text)}"
    if not math.isfinite(float(number_text)):
        return f"should have numbers below 1e308, not {quoted(number_text)}"
    return ""


def _call_fault(name: str) -> str:
    if name in _SINGLE:
        return f"should call {name} with one value, as in {name}(a)"
    return f"should call {name} with its values, as in {name}(a, b)"


def names(text: str) -> tuple[str, ...]:
    """Return the names of the terms of an expression in order; ValueError if the text is no expression."""
    nodes = ast.walk(_parse(text))
    identifiers = [node.id for node in nodes if isinstance(node, ast.Name)]
    terms = [name for name in identifiers if name not in _FUNCTIONS]
    return tuple(dict.fromkeys(terms))


def is_product(text: str) -> bool:
    """Whether an expression has neither sums nor differences, so that its logarithm is closer to linear."""
    nodes = ast.walk(_parse(text))
    return not any(isinstance(node, ast.Add | ast.Sub) for node in nodes)


def evaluate(text: str, values: Mapping[str, Any]) -> Any:
    """Return the value of an expression, element by element if its terms are arrays of one shape."""

    def value(node: ast.AST) -> Any:
        if isinstance(node, ast.Name):
            return values[node.id]
        if isinstance(node, ast.Constant):
            return float(node.value)  # type: ignore[arg-type]
        if isinstance(node, ast.UnaryOp):
            return -value(node.operand)
        if isinstance(node, ast.BinOp):
            operation = _BINARY[type(node.op)]
            return operation(value(node.left), value(node.right))
        assert isinstance(node, ast.Call)
        assert isinstance(node.func, ast.Name)
        function = _FUNCTIONS[node.func.id]
        arguments = map(value, node.args)
        return function(*arguments)

    with np.errstate(divide="ignore", invalid="ignore"):
        return value(_parse(text))
