"""Arithmetic of named numbers written as text, and the cases that the names stand for.

``a / b``, ``max(a, b, c) / min(a, b, c)``, ``100 * (a / b - 1)``.
"""

import ast
from collections.abc import Callable, Mapping, Sequence
from functools import reduce
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np

_BINARY: dict[type[ast.operator], Callable[[Any, Any], Any]] = {
    ast.Add: np.add, ast.Sub: np.subtract, ast.Mult: np.multiply, ast.Div: np.divide,
}  # fmt: skip
_CALLED: dict[str, Callable[..., Any]] = {
    "max": lambda *values: reduce(np.maximum, values),
    "min": lambda *values: reduce(np.minimum, values),
    "abs": np.abs,
    "sqrt": np.sqrt,
}
_LENGTH = 500  # characters


def _parsed(text: str) -> ast.expr:
    try:
        if len(text) > _LENGTH:
            raise ValueError
        tree = ast.parse(text.strip(), mode="eval").body
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        raise ValueError("should be an expression such as 'a / b' or 'max(a, b) / min(a, b)'") from None
    for node in ast.walk(tree):
        if not _known(node):
            raise ValueError(f"should be made of terms, numbers, + - * /, {', '.join(_CALLED)} and brackets")
    return tree


def _known(node: ast.AST) -> bool:
    if isinstance(node, ast.Call):
        return isinstance(node.func, ast.Name) and node.func.id in _CALLED and bool(node.args) and not node.keywords
    if isinstance(node, ast.Constant):
        return isinstance(node.value, int | float) and not isinstance(node.value, bool)
    if isinstance(node, ast.UnaryOp):
        return isinstance(node.op, ast.USub)
    return isinstance(node, (ast.BinOp, ast.Name, ast.Load, ast.USub, *_BINARY))


def names(text: str) -> tuple[str, ...]:
    """Return the names of the terms of an expression in their order; ValueError where it is none."""
    found = [node.id for node in ast.walk(_parsed(text)) if isinstance(node, ast.Name)]
    return tuple(dict.fromkeys(name for name in found if name not in _CALLED))


def is_product(text: str) -> bool:
    """Whether an expression has neither sums nor differences: its logarithm varies more evenly than itself."""
    return not any(isinstance(node, ast.Add | ast.Sub) for node in ast.walk(_parsed(text)))


def evaluate(text: str, values: Mapping[str, Any]) -> Any:
    """Return the value of an expression, element by element where the values of its terms are arrays of one shape."""

    def value(node: ast.AST) -> Any:
        if isinstance(node, ast.Name):
            return values[node.id]
        if isinstance(node, ast.Constant):
            return float(node.value)  # type: ignore[arg-type]
        if isinstance(node, ast.UnaryOp):
            return -value(node.operand)
        if isinstance(node, ast.BinOp):
            return _BINARY[type(node.op)](value(node.left), value(node.right))
        assert isinstance(node, ast.Call)
        assert isinstance(node.func, ast.Name)
        return _CALLED[node.func.id](*map(value, node.args))

    with np.errstate(divide="ignore", invalid="ignore"):
        return value(_parsed(text))


class Reading(NamedTuple):
    """Levels of the axes that no term names, and the number of each term's case."""

    levels: dict[str, str]
    cases: dict[str, int]


def matching(known: Sequence[Mapping[str, str]], levels: Mapping[str, str]) -> list[int]:
    """Return the numbers of the cases (level of every axis of each) that have all the levels."""
    return [k for k, one in enumerate(known) if all(one.get(axis) == level for axis, level in levels.items())]


def readings(known: Sequence[Mapping[str, str]], wanted: Mapping[str, Mapping[str, str]]) -> list[Reading]:
    """Return the cases of each term for all levels, in turn, of the axes that no term names.

    known: level of every axis of each case; wanted: levels that each term names. Axes that vary together (design zip)
    need not all be named: the fewest are read that leave each term one case, of those that read the most cases (one
    axis varied at a time: every axis).
    """
    named = {axis for levels in wanted.values() for axis in levels}
    free = [axis for axis in (known[0] if known else ()) if axis not in named]
    sizes = range(len(free) + 1)
    return max((_read_by(known, wanted, axes) for n in sizes for axes in combinations(free, n)), key=len)


def _read_by(
    known: Sequence[Mapping[str, str]], wanted: Mapping[str, Mapping[str, str]], axes: Sequence[str]
) -> list[Reading]:
    found = []
    for choice in dict.fromkeys(tuple(levels[axis] for axis in axes) for levels in known):
        levels = dict(zip(axes, choice, strict=True))
        cases = {name: matching(known, {**one, **levels}) for name, one in wanted.items()}
        if all(len(one) == 1 for one in cases.values()):
            found.append(Reading(levels, {name: one[0] for name, one in cases.items()}))
    return found
