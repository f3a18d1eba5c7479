"""Values of a kernel's expressions in translation: a constant, a C expression, an array, a record, several."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

DOUBLE, INT = "double", "int"
ONLY, SAME = 1, -1
# Levels of C's operators, those that bind most first.
ATOM, UNARY, PRODUCT, SUM, SHIFT, ORDER, EQUAL, BIT_AND, BIT_OR, AND, OR, CHOICE = range(12)


class TranslationError(Exception):
    """What a kernel says that has no translation."""


@dataclass(frozen=True)
class Known:
    """A number, truth value, None, name or tuple that is known when the code is made."""

    value: Any


@dataclass(frozen=True)
class Scalar:
    """A number by its C expression; kind: double or int; level of its weakest operator."""

    text: str
    kind: str
    level: int = ATOM


@dataclass(frozen=True)
class Array:
    """An array by a C expression of its first element's place; shape: numbers, or a Scalar where it is not known.

    rings (an entry per axis): 0 of a usual axis; n of one of n places, whose index counts on without end; ONLY of one
    whose index is always the present one, SAME of one along which nothing changes: C has no such axis. value: the
    content, where it is constant, without these axes.
    """

    text: str
    shape: tuple[int | Scalar, ...]
    kind: str
    constant: bool = False
    rings: tuple[int, ...] = ()
    value: Any = field(default=None, compare=False)

    def ring(self, axis: int) -> int:
        """Return how many places an axis has whose index counts on, 0 for a usual one."""
        return self.rings[axis] if axis < len(self.rings) else 0

    @property
    def sizes(self) -> tuple[int | Scalar, ...]:
        """The lengths of the axes that it has in C."""
        return tuple(size for axis, size in enumerate(self.shape) if self.ring(axis) not in (ONLY, SAME))

    def declared(self, name: str) -> str:
        """Return the declaration of a pointer of this type."""
        rest = "".join(f"[{size_of(size)}]" for size in self.sizes[1:])
        return f"{'const ' if self.constant else ''}{self.kind} {f'(*{name}){rest}' if rest else f'*{name}'}"


@dataclass(frozen=True)
class Several:
    """A tuple of values."""

    items: tuple[Value, ...]


@dataclass(frozen=True)
class Fields:
    """A record: its fields by name."""

    name: str
    fields: dict[str, Value] = field(compare=False)

    def __hash__(self) -> int:
        return hash(self.name)


Value = Known | Scalar | Array | Several | Fields


def size_of(size: int | Scalar) -> int:
    """Return the length of an axis that has to be known: at least one, for C has no empty arrays."""
    if isinstance(size, Scalar):
        raise TranslationError("only the last axis may have a length that is not known")
    return max(1, size)


def known_number(value: Any) -> Any:
    """Return a number of numpy's as one of Python's."""
    return value.item() if isinstance(value, np.generic) else value


def literal(value: Any) -> Scalar:
    """Return a known number as C writes it: a double in the fewest digits that are read back as it."""
    value = known_number(value)
    if isinstance(value, bool | int):
        return Scalar(str(int(value)), INT, UNARY if value < 0 else ATOM)
    if not isinstance(value, float):
        raise TranslationError(f"{value!r} is no number")
    if math.isnan(value):
        return Scalar("NAN", DOUBLE)
    negative = math.copysign(1.0, value) < 0.0
    return (
        Scalar("-INFINITY" if value < 0 else "INFINITY", DOUBLE, UNARY if negative else ATOM)
        if math.isinf(value)
        else Scalar(repr(value), DOUBLE, UNARY if negative else ATOM)
    )


def as_scalar(value: Value) -> Scalar:
    """Return a number, known or not, as a C expression."""
    if isinstance(value, Known):
        return literal(value.value)
    if isinstance(value, Scalar):
        return value
    raise TranslationError(f"{type(value).__name__} where a number should be")


def held(scalar: Scalar, level: int) -> str:
    """Return a C expression in brackets where an operator of a level would take it apart."""
    return f"({scalar.text})" if scalar.level > level else scalar.text


def table_of(name: str, content: np.ndarray, rings: tuple[int, ...] = (), shape: tuple[int, ...] = ()) -> Array:
    """Return an array of numbers that do not change; shape: with the axes that it has not in C."""
    kind = DOUBLE if content.dtype.kind == "f" else INT
    return Array(name, shape or tuple(content.shape), kind, constant=True, rings=rings, value=content)
