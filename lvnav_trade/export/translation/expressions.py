"""Expressions in the body of a kernel: names, fields, indices, calls."""

from __future__ import annotations

import ast
import builtins
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Protocol

import numpy as np

from lvnav_trade.export.translation import operators
from lvnav_trade.export.translation.values import (
    ONLY,
    SAME,
    Array,
    Constant,
    RecordValue,
    Scalar,
    TranslationError,
    TupleValue,
    Value,
    as_scalar,
    table_of,
)


class Owner(Protocol):
    """Interface of the program for which kernels are translated."""

    def global_value(self, value: Any, label: str) -> Value:
        """Return a global of a kernel's module."""
        ...

    def table(self, label: str, content: Any) -> Array:
        """Return a table of known numbers."""
        ...

    def call(
        self, body: Any, node: ast.Call, function: Any, arguments: list[Value], keywords: Mapping[str, Value]
    ) -> Value:
        """Return the result of a kernel called from another kernel."""
        ...

    def return_line(self, value: Value, return_values: list[Value]) -> str:
        """Return the statement that returns a value."""
        ...


class RingTooShort(TranslationError):
    """An index refers to an earlier epoch: its axis needs two places."""


class Expressions:
    """The expressions of one kernel, for known types of its arguments.

    lines : statements that the expressions need before them
    """

    def __init__(self, program: Owner, function: Any, names: dict[str, Value]) -> None:
        self.program, self.function, self.names = program, function, names
        self.lines: list[str] = []
        self.indent = 1
        self.locals: dict[str, str] = {}
        self.read_names: set[str] = set()
        self.n_temporary = 0

    # ------------------------------------------------------------------------------------------ helpers

    def write(self, line: str) -> None:
        """Write a line of C."""
        self.lines.append("    " * self.indent + line)

    def temporary(self, declaration: str, stem: str) -> str:
        """Declare a local variable with a new name, which replaces {} in the declaration; return the name."""
        self.n_temporary += 1
        name = f"{stem}_{self.n_temporary}"
        self.locals[name] = declaration.format(name)
        return name

    def fail(self, node: ast.AST, reason: str) -> TranslationError:
        """Return an error with its location in the source of the kernel."""
        location = f"{self.function.__module__}.{self.function.__name__}"
        return TranslationError(f"{location}, line {getattr(node, 'lineno', 0)}: {reason}: {ast.unparse(node)}")

    # -------------------------------------------------------------------------------------- expressions

    def value(self, node: ast.expr) -> Value:
        """Return the value of an expression; TranslationError if it cannot be translated."""
        translator = getattr(self, f"_{type(node).__name__.lower()}", None)
        if translator is None:
            raise self.fail(node, f"{type(node).__name__} is not translated")
        result: Value = translator(node)
        return result

    def _constant(self, node: ast.Constant) -> Value:
        return Constant(node.value)

    def _name(self, node: ast.Name) -> Value:
        self.read_names.add(node.id)
        if node.id in self.names:
            return self.names[node.id]
        scope = self.function.__globals__
        if node.id in scope:
            return self.program.global_value(scope[node.id], f"{self.function.__module__.rpartition('.')[2]}_{node.id}")
        if hasattr(builtins, node.id):
            return Constant(getattr(builtins, node.id))
        raise self.fail(node, "no such name")

    def _attribute(self, node: ast.Attribute) -> Value:
        base = self.value(node.value)
        if isinstance(base, RecordValue):
            if node.attr not in base.fields:
                raise self.fail(node, f"{base.name} has no field of that name here")
            return base.fields[node.attr]
        if isinstance(base, Array) and node.attr == "shape":
            return TupleValue(tuple(map(self._size, base.shape)))
        if isinstance(base, Constant):
            owner = getattr(base.value, "__name__", "").rpartition(".")[2]
            return self.program.global_value(getattr(base.value, node.attr), f"{owner}_{node.attr}")
        raise self.fail(node, "no field is known")

    def _tuple(self, node: ast.Tuple) -> Value:
        items = tuple(self.value(item) for item in node.elts)
        if all(isinstance(item, Constant) for item in items):
            return Constant(tuple(item.value for item in items if isinstance(item, Constant)))
        return TupleValue(items)

    def _binop(self, node: ast.BinOp) -> Value:
        left_operand = self.value(node.left)
        right_operand = self.value(node.right)
        return operators.binary(node.op, left_operand, right_operand)

    def _unaryop(self, node: ast.UnaryOp) -> Value:
        return operators.unary(node.op, self.value(node.operand))

    def _boolop(self, node: ast.BoolOp) -> Value:
        any_of = isinstance(node.op, ast.Or)
        operands: list[Value] = []
        for item in node.values:
            n_lines = len(self.lines)
            operand = self.value(item)
            if len(self.lines) > n_lines and operands:
                raise self.fail(item, "needs statements of its own behind `and` or `or`")
            operands.append(operand)
            if isinstance(operand, Constant) and bool(operand.value) == any_of:
                break  # the following operands are not evaluated
        return operators.combine_conditions(operands, any_of)

    def _compare(self, node: ast.Compare) -> Value:
        comparisons: list[Value] = []
        left_operand = self.value(node.left)
        for comparator, item in zip(node.ops, node.comparators, strict=True):
            right_operand = self.value(item)
            comparisons.append(operators.comparison(comparator, left_operand, right_operand))
            left_operand = right_operand
        if len(comparisons) == 1:
            return comparisons[0]
        return operators.combine_conditions(comparisons, any_of=False)

    def _ifexp(self, node: ast.IfExp) -> Value:
        condition = self.value(node.test)
        if isinstance(condition, Constant):
            return self.value(node.body if condition.value else node.orelse)
        n_lines = len(self.lines)
        first = self.value(node.body)
        second = self.value(node.orelse)
        if len(self.lines) > n_lines:
            raise self.fail(node, "needs statements of its own in one of two cases")
        if isinstance(first, Array) and isinstance(second, Array):
            text = f"({as_scalar(condition).text} ? {first.text} : {second.text})"
            if replace(first, text=text) != replace(second, text=text):
                raise self.fail(node, "two arrays of different kinds")
            return replace(first, text=text, value=None)
        first_items = self.items(first)
        second_items = self.items(second)
        if first_items is None or second_items is None or len(first_items) != len(second_items):
            return operators.conditional_value(condition, first, second)
        items = [operators.conditional_value(condition, a, b) for a, b in zip(first_items, second_items, strict=True)]
        return TupleValue(tuple(items))

    @staticmethod
    def items(value: Value) -> list[Value] | None:
        """Return the values of a tuple; None for any other value."""
        if isinstance(value, TupleValue):
            return list(value.items)
        if isinstance(value, Constant) and isinstance(value.value, tuple):
            return [Constant(item) for item in value.value]
        return None

    def _call(self, node: ast.Call) -> Value:
        function = self.value(node.func)
        if not isinstance(function, Constant):
            raise self.fail(node, "is no function")
        arguments = [self.value(argument) for argument in node.args]
        keywords = {str(argument.arg): self.value(argument.value) for argument in node.keywords}
        if function.value is len:
            return self._length(node, arguments[0])
        result = operators.function_result(function.value, arguments)
        return result if result is not None else self.program.call(self, node, function.value, arguments, keywords)

    def _length(self, node: ast.Call, value: Value) -> Value:
        if isinstance(value, Array):
            return self._size(value.shape[0])
        if isinstance(value, TupleValue):
            return Constant(len(value.items))
        if isinstance(value, Constant):
            return Constant(len(value.value))
        raise self.fail(node, "has no length")

    # ------------------------------------------------------------------------------------------ indices

    def _subscript(self, node: ast.Subscript) -> Value:
        base = self.value(node.value)
        if isinstance(base, Constant) and isinstance(base.value, tuple):
            index = self.value(node.slice)
            if isinstance(index, Constant):
                return Constant(base.value[index.value])
            label = ast.unparse(node.value)
            base = self.program.table(f"{self.function.__name__}_{label}" if label.isidentifier() else "tuple", base)
        if isinstance(base, TupleValue):
            index = self.value(node.slice)
            if isinstance(index, Constant):
                return base.items[index.value]
            base = self.as_array(base, "of")
        if not isinstance(base, Array):
            raise self.fail(node, "is no array")
        return self._element(base, node)

    def _element(self, base: Array, node: ast.Subscript) -> Value:
        """Return an element of an array, or the sub-array at an index or a slice."""
        index_nodes = node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]
        text = base.text
        indices: list[Value] = []  # of the axes that C has
        for axis, index_node in enumerate(index_nodes):
            if isinstance(index_node, ast.Slice):
                return self._slice(base, text, axis, index_node, node)
            index = self.value(index_node)
            ring = base.ring(axis)
            if ring in (ONLY, SAME):
                self._check_present(index_node, ring)
                continue
            if ring:
                index = operators.binary(ast.Mod(), index, Constant(ring))
            index = self._from_start(index, base.shape[axis])
            indices.append(index)
            text = f"{text}[{as_scalar(index).text}]"
        value = self._known_element(base, indices)
        n_axes = len(index_nodes)
        if base.shape[n_axes:]:
            return Array(text, base.shape[n_axes:], base.c_type, base.constant, base.rings[n_axes:], value)
        if value is not None:
            return Constant(np.asarray(value).item())
        return Scalar(text if indices or not base.constant else f"*{text}", base.c_type)

    @staticmethod
    def _from_start(index: Value, length: int | Scalar) -> Value:
        """Return an index of an axis; a known index from the end as an index from the start."""
        if not isinstance(index, Constant):
            return index
        place = int(index.value)
        if place < 0 and isinstance(length, int):
            place += length
        return Constant(place)

    @staticmethod
    def _known_element(base: Array, indices: list[Value]) -> Any:
        """Return the content of a constant array at known indices; None if it or an index is not known."""
        places = [index.value for index in indices if isinstance(index, Constant)]
        if base.value is None or len(places) < len(indices):
            return None
        for place, size in zip(places, base.sizes, strict=False):
            if isinstance(size, int) and not 0 <= place < size:
                return None
        return base.value[tuple(places)]

    @staticmethod
    def _check_present(node: ast.expr, ring: int) -> None:
        """Raise RingTooShort for an index other than the present one, if only the present one is stored."""
        is_present = isinstance(node, ast.Name) and node.id in ("epoch", "w", "window")
        if ring == ONLY and not is_present:
            raise RingTooShort(ast.unparse(node))

    def _slice(self, base: Array, text: str, axis: int, bounds: ast.Slice, node: ast.Subscript) -> Array:
        """Return a slice of the last axis of an array; TranslationError for any other slice.

        text : C expression of the array, with the indices of the earlier axes
        axis : number of the sliced axis
        """
        if axis != len(base.shape) - 1 or bounds.step is not None:
            raise self.fail(node, "slices are of the last axis, without a step")
        first = self.value(bounds.lower) if bounds.lower is not None else Constant(0)
        end = self.value(bounds.upper) if bounds.upper is not None else self._size(base.shape[axis])
        size = operators.binary(ast.Sub(), end, first) if first != Constant(0) else end
        start = as_scalar(first).text
        if start != "0":
            text = f"&{text}[{start}]"
        length = size.value if isinstance(size, Constant) else as_scalar(size)
        return Array(text, (length,), base.c_type, base.constant)

    @staticmethod
    def _size(size: int | Scalar) -> Value:
        return size if isinstance(size, Scalar) else Constant(size)

    def as_array(self, value: TupleValue, stem: str) -> Array:
        """Return a tuple of numbers as a local array."""
        numbers = [as_scalar(item) for item in value.items]
        number_type = operators.common_type(numbers)
        name = self.temporary(f"{number_type} {{}}[{len(numbers)}]", stem)
        for k, number in enumerate(numbers):
            self.write(f"{name}[{k}] = {number.text};")
        return Array(name, (len(numbers),), number_type)


def constant_array(name: str, content: Any) -> Array:
    """Return a table of known numbers."""
    return table_of(name, np.asarray(content))
