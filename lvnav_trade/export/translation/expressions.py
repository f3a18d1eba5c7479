"""Expressions in the body of a kernel: names, fields, indices, calls."""

from __future__ import annotations

import ast
import builtins
from collections.abc import Mapping
from typing import Any, Protocol

import numpy as np

from lvnav_trade.export.translation import operators
from lvnav_trade.export.translation.values import (
    DOUBLE,
    INT,
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

    def known(self, value: Any, label: str) -> Value:
        """Return a global of a kernel's module."""
        ...

    def table(self, label: str, content: Any) -> Array:
        """Return a table of known numbers."""
        ...

    def call(
        self, body: Any, node: ast.Call, function: Any, arguments: list[Value], named: Mapping[str, Value]
    ) -> Value:
        """Return the result of a kernel called from another kernel."""
        ...

    def return_line(self, found: Value, returned: list[Value]) -> str:
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
        self.read: set[str] = set()
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

    def fail(self, node: ast.AST, why: str) -> TranslationError:
        """Return an error with its location in the source of the kernel."""
        location = f"{self.function.__module__}.{self.function.__name__}"
        return TranslationError(f"{location}, line {getattr(node, 'lineno', 0)}: {why}: {ast.unparse(node)}")

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
        self.read.add(node.id)
        if node.id in self.names:
            return self.names[node.id]
        scope = self.function.__globals__
        if node.id in scope:
            return self.program.known(scope[node.id], f"{self.function.__module__.rpartition('.')[2]}_{node.id}")
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
            return TupleValue(tuple(s if isinstance(s, Scalar) else Constant(s) for s in base.shape))
        if isinstance(base, Constant):
            attribute = getattr(base.value, node.attr)
            return self.program.known(
                attribute, f"{getattr(base.value, '__name__', '').rpartition('.')[2]}_{node.attr}"
            )
        raise self.fail(node, "no field is known")

    def _tuple(self, node: ast.Tuple) -> Value:
        items = tuple(self.value(item) for item in node.elts)
        if all(isinstance(item, Constant) for item in items):
            return Constant(tuple(item.value for item in items if isinstance(item, Constant)))
        return TupleValue(items)

    def _binop(self, node: ast.BinOp) -> Value:
        first, right = self.value(node.left), self.value(node.right)
        return operators.binary(node.op, first, right)

    def _unaryop(self, node: ast.UnaryOp) -> Value:
        return operators.unary(node.op, self.value(node.operand))

    def _boolop(self, node: ast.BoolOp) -> Value:
        any_of, parts = isinstance(node.op, ast.Or), list[Value]()
        for item in node.values:
            count = len(self.lines)
            operand = self.value(item)
            if len(self.lines) > count and parts:
                raise self.fail(item, "needs statements of its own behind `and` or `or`")
            parts.append(operand)
            if isinstance(operand, Constant) and bool(operand.value) == any_of:
                break  # the following operands are not evaluated
        return operators.joined(parts, any_of)

    def _compare(self, node: ast.Compare) -> Value:
        parts, first = list[Value](), self.value(node.left)
        for comparator, item in zip(node.ops, node.comparators, strict=True):
            right = self.value(item)
            parts.append(operators.compared(comparator, first, right))
            first = right
        return parts[0] if len(parts) == 1 else operators.joined(parts, any_of=False)

    def _ifexp(self, node: ast.IfExp) -> Value:
        condition = self.value(node.test)
        if isinstance(condition, Constant):
            return self.value(node.body if condition.value else node.orelse)
        count = len(self.lines)
        first, second = self.value(node.body), self.value(node.orelse)
        if len(self.lines) > count:
            raise self.fail(node, "needs statements of its own in one of two cases")
        if isinstance(first, Array) and isinstance(second, Array):
            if (first.shape, first.kind, first.constant, first.rings) != (
                second.shape,
                second.kind,
                second.constant,
                second.rings,
            ):
                raise self.fail(node, "two arrays of different kinds")
            text = f"({as_scalar(condition).text} ? {first.text} : {second.text})"
            return Array(text, first.shape, first.kind, first.constant, first.rings)
        rows = [self.items(branch) for branch in (first, second)]
        if rows[0] is not None and rows[1] is not None and len(rows[0]) == len(rows[1]):
            return TupleValue(tuple(operators.chosen(condition, a, b) for a, b in zip(*rows, strict=True)))
        return operators.chosen(condition, first, second)

    @staticmethod
    def items(found: Value) -> list[Value] | None:
        """Return the values of a tuple; None for any other value."""
        if isinstance(found, TupleValue):
            return list(found.items)
        if isinstance(found, Constant) and isinstance(found.value, tuple):
            return [Constant(one) for one in found.value]
        return None

    def _call(self, node: ast.Call) -> Value:
        function = self.value(node.func)
        if not isinstance(function, Constant):
            raise self.fail(node, "is no function")
        arguments = [self.value(argument) for argument in node.args]
        keywords = {str(argument.arg): self.value(argument.value) for argument in node.keywords}
        if function.value is len:
            return self._length(node, arguments[0])
        result = operators.called(function.value, arguments)
        return result if result is not None else self.program.call(self, node, function.value, arguments, keywords)

    def _length(self, node: ast.Call, of: Value) -> Value:
        if isinstance(of, Array):
            size = of.shape[0]
            return size if isinstance(size, Scalar) else Constant(size)
        if isinstance(of, TupleValue):
            return Constant(len(of.items))
        if isinstance(of, Constant):
            return Constant(len(of.value))
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
        return self._at(base, node)

    def _at(self, base: Array, node: ast.Subscript) -> Value:
        """Return an element of an array, or the sub-array at an index or a slice."""
        parts = node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]
        text, indices = base.text, list[int]()
        for axis, part in enumerate(parts):
            if isinstance(part, ast.Slice):
                return self._slice(base, text, axis, part, node)
            index = self.value(part)
            ring, length = base.ring(axis), base.shape[axis]
            if ring in (ONLY, SAME):
                self._present(part, ring)
                continue
            if ring:
                index = operators.binary(ast.Mod(), index, Constant(ring))
            if isinstance(index, Constant):
                at = int(index.value)
                index = Constant(at + length if at < 0 and isinstance(length, int) else at)
                indices.append(index.value)
            text = f"{text}[{as_scalar(index).text}]"
        remaining = base.shape[len(parts) :]
        here = sum(base.ring(axis) not in (ONLY, SAME) for axis in range(len(parts)))
        there = all(0 <= at < size for at, size in zip(indices, base.sizes, strict=False) if isinstance(size, int))
        value = base.value[tuple(indices)] if base.value is not None and len(indices) == here and there else None
        if remaining:
            return Array(text, remaining, base.kind, base.constant, base.rings[len(parts) :], value)
        if value is not None:
            return Constant(np.asarray(value).item())
        return Scalar(text if here or not base.constant else f"*{text}", base.kind)

    @staticmethod
    def _present(node: ast.expr, ring: int) -> None:
        """Raise RingTooShort for an index other than the present one, if only the present one is stored."""
        if ring == ONLY and not (isinstance(node, ast.Name) and node.id in ("epoch", "w", "window")):
            raise RingTooShort(ast.unparse(node))

    def _slice(self, base: Array, text: str, axis: int, part: ast.Slice, node: ast.Subscript) -> Array:
        if axis != len(base.shape) - 1 or part.step is not None:
            raise self.fail(node, "slices are of the last axis, without a step")
        first = self.value(part.lower) if part.lower is not None else Constant(0)
        last = self.value(part.upper) if part.upper is not None else None
        end: Value = last if last is not None else self._size(base.shape[axis])
        size = operators.binary(ast.Sub(), end, first) if first != Constant(0) else end
        begins = as_scalar(first)
        text = text if begins.text == "0" else f"&{text}[{begins.text}]"
        return Array(text, (size.value if isinstance(size, Constant) else as_scalar(size),), base.kind, base.constant)

    @staticmethod
    def _size(size: int | Scalar) -> Value:
        return size if isinstance(size, Scalar) else Constant(size)

    def as_array(self, several: TupleValue, stem: str) -> Array:
        """Return a tuple of numbers as a local array."""
        parts = [as_scalar(item) for item in several.items]
        number_type = DOUBLE if any(number.kind == DOUBLE for number in parts) else INT
        name = self.temporary(f"{number_type} {{}}[{len(parts)}]", stem)
        for at, number in enumerate(parts):
            self.write(f"{name}[{at}] = {number.text};")
        return Array(name, (len(parts),), number_type)


def constant_array(name: str, content: Any) -> Array:
    """Return a table of known numbers."""
    return table_of(name, np.asarray(content))
