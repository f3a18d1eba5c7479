"""Values of expressions in translation: a constant, a C expression, an array, a record, a tuple."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

DOUBLE, INT = "double", "int"
ONLY, SAME = 1, -1
# Precedence of C operators, highest first.
ATOM, UNARY, PRODUCT, SUM, SHIFT, ORDER, EQUAL, BIT_AND, BIT_OR, AND, OR, CHOICE = range(12)


class TranslationError(Exception):
    """A construct of a kernel that cannot be translated to C."""


@dataclass(frozen=True)
class Constant:
    """A number, truth value, None, name or tuple that is known at translation."""

    value: Any


@dataclass(frozen=True)
class Scalar:
    """A number as a C expression.

    text : The expression.
    c_type : C type, double or int.
    level : Precedence of its outermost operator.
    """

    text: str
    c_type: str
    level: int = ATOM


@dataclass(frozen=True)
class Array:
    """An array in C.

    text : C expression of the address of its first element.
    shape : Length of each axis; a Scalar if it is not known at translation.
    c_type : C type of the elements.
    constant : Whether the elements are constant.
    rings : For each axis: 0 for an ordinary axis; n for a ring buffer of n places, whose index grows without end;
        `ONLY` if only the present index is read, `SAME` if the elements are equal along the axis. C has no axis for the
        last two.
    value : Content of a constant array, without the axes that C lacks.
    """

    text: str
    shape: tuple[int | Scalar, ...]
    c_type: str
    constant: bool = False
    rings: tuple[int, ...] = ()
    value: Any = field(default=None, compare=False)

    def ring(self, axis: int) -> int:
        """Return the number of places of a ring buffer axis, 0 for an ordinary axis."""
        return self.rings[axis] if axis < len(self.rings) else 0

    @property
    def sizes(self) -> tuple[int | Scalar, ...]:
        """Lengths of the axes in C."""
        return tuple(size for axis, size in enumerate(self.shape) if self.ring(axis) not in (ONLY, SAME))

    def declaration(self, name: str) -> str:
        """Return the declaration of a pointer of this type."""
        inner_sizes = "".join(f"[{size_of(size)}]" for size in self.sizes[1:])
        pointer = f"(*{name}){inner_sizes}" if inner_sizes else f"*{name}"
        qualifier = "const " if self.constant else ""
        return f"{qualifier}{self.c_type} {pointer}"


@dataclass(frozen=True)
class TupleValue:
    """A tuple of values."""

    items: tuple[Value, ...]


@dataclass(frozen=True)
class RecordValue:
    """A record: its fields by name."""

    name: str
    fields: dict[str, Value] = field(compare=False)

    def __hash__(self) -> int:
        return hash(self.name)


Value = Constant | Scalar | Array | TupleValue | RecordValue


def size_of(size: int | Scalar) -> int:
    """Return the length of an axis that must be known, at least one, because C has no empty arrays."""
    if isinstance(size, Scalar):
        raise TranslationError("only the last axis may have a length that is not known")
    return max(1, size)


def known_number(value: Any) -> Any:
    """Return a NumPy number as a Python number."""
    return value.item() if isinstance(value, np.generic) else value


def literal(value: Any) -> Scalar:
    """Return a known number as a C literal; a double with the fewest digits that restore it."""
    value = known_number(value)
    if isinstance(value, bool | int):
        return Scalar(str(int(value)), INT, UNARY if value < 0 else ATOM)
    if not isinstance(value, float):
        raise TranslationError(f"{value!r} is no number")
    if math.isnan(value):
        return Scalar("NAN", DOUBLE)
    is_negative = math.copysign(1.0, value) < 0.0  # also minus zero
    text = repr(value)
    if math.isinf(value):
        text = "-INFINITY" if is_negative else "INFINITY"
    return Scalar(text, DOUBLE, UNARY if is_negative else ATOM)


def as_scalar(value: Value) -> Scalar:
    """Return a number, known or not, as a C expression."""
    if isinstance(value, Constant):
        return literal(value.value)
    if isinstance(value, Scalar):
        return value
    raise TranslationError(f"{type(value).__name__} where a number should be")


def operand_text(scalar: Scalar, level: int) -> str:
    """Return a C expression, in brackets if an operator of the given precedence would split it."""
    return f"({scalar.text})" if scalar.level > level else scalar.text


def table_of(name: str, content: np.ndarray, rings: tuple[int, ...] = (), shape: tuple[int, ...] = ()) -> Array:
    """Return a constant array.

    shape : shape with the axes that C lacks; by default that of the content
    """
    number_type = DOUBLE if content.dtype.kind == "f" else INT
    return Array(name, shape or tuple(content.shape), number_type, constant=True, rings=rings, value=content)
