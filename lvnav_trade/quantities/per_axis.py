"""Values for the axes of a triad: one number for all three axes, or a list of three."""

import math
from collections.abc import Callable
from typing import Annotated, Any

from pydantic import BeforeValidator, Field, PlainSerializer, WithJsonSchema
from pydantic_core import PydanticKnownError

from lvnav_trade.quantities import units

PerAxis = float | tuple[float, float, float]
"""One value for all three axes, or a value for each axis (x, y, z)."""


def by_axis(unit: str) -> Any:
    """Return the pydantic annotation of a `PerAxis` in SI `unit`, read from a quantity or a list of three quantities.

    Negative values are an input error. Three equal values become one number.
    """

    def read(value: Any) -> PerAxis:
        items = value if isinstance(value, list | tuple) else [value]
        if items is value and len(items) != 3:
            raise ValueError(f"expected one quantity in a unit of {units.example(unit)}, or three, of x, y and z")
        numbers = tuple(units.read(item, unit, has_sign=False) for item in items)
        if min(numbers) < 0.0:
            raise PydanticKnownError("greater_than_equal", {"ge": 0})
        return numbers[0] if len(set(numbers)) == 1 else numbers  # type: ignore[return-value]

    def write(value: PerAxis) -> str | list[str]:
        if isinstance(value, tuple):
            return [f"{number!r} {unit}" for number in value]
        return f"{value!r} {unit}"

    quantity = {"type": ["string", "number"]}
    by_axes = {"type": "array", "items": quantity, "minItems": 3, "maxItems": 3}
    schema = {
        "anyOf": [quantity, by_axes],
        "description": f"quantity with a unit: {units.example(unit)}, or three, of x, y and z",
    }
    return Annotated[
        PerAxis,
        BeforeValidator(read),
        PlainSerializer(write, when_used="json"),
        WithJsonSchema(schema),
    ]


def axes(value: PerAxis) -> tuple[float, float, float]:
    """Return the values of x, y and z."""
    return value if isinstance(value, tuple) else (value, value, value)


def rms(value: PerAxis) -> float:
    """Return the root mean square over the axes."""
    if not isinstance(value, tuple):
        return value
    mean_square = sum(number * number for number in value) / 3.0
    return math.sqrt(mean_square)


def each_axis(function: Callable[..., float], *values: PerAxis) -> PerAxis:
    """Return a function of scalars evaluated for each axis.

    The result is one number if every argument is one number.
    """
    if not any(isinstance(value, tuple) for value in values):
        return function(*values)
    by_value = [axes(value) for value in values]
    arguments_by_axis = zip(*by_value, strict=True)
    x, y, z = (function(*arguments) for arguments in arguments_by_axis)
    return x, y, z


def squares(value: PerAxis) -> tuple[float, float, float]:
    """Return the squares of the values of x, y and z."""
    square = each_axis(lambda number: number**2, value)
    return axes(square)


# One-sigma values of a triad, equal on all axes or by axis.
Angle: Any = units.at_most(by_axis("rad"), math.pi / 2.0, "90 deg")
AngularRate: Any = units.at_most(by_axis("rad/s"), math.radians(1000.0), "1000 deg/s")
Acceleration: Any = units.at_most(by_axis("m/s**2"), 980.665, "100 g")
AngleRandomWalk: Any = units.at_most(by_axis("rad/s**0.5"), math.radians(1000.0) / 60.0, "1000 deg/sqrt(h)")
VelocityRandomWalk: Any = units.at_most(by_axis("m/s**1.5"), 9.80665, "1 g/sqrt(Hz)")
RateRandomWalk: Any = by_axis("rad/s**1.5")
AccelerationRandomWalk: Any = by_axis("m/s**2.5")
GSensitivity: Any = by_axis("rad*s/m")
ScaleDrift: Any = by_axis("1/s**0.5")
_One = Annotated[float, Field(gt=-1.0, lt=1.0)]
Correlation = _One | tuple[_One, _One, _One]
Fraction: Any = units.at_most(by_axis("dimensionless"), 1.0, "100 %")
