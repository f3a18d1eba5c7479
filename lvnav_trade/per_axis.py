"""Values of a triad's axes: one of all three, or a list of three."""

import math
from collections.abc import Callable
from typing import Annotated, Any

from pydantic import BeforeValidator, Field, PlainSerializer, WithJsonSchema
from pydantic_core import PydanticKnownError

from lvnav_trade import units

PerAxis = float | tuple[float, float, float]
"""One value of all three axes, or one of each."""


def by_axis(unit: str) -> Any:
    """Return the pydantic annotation of a `PerAxis` held in SI `unit`: a quantity, or a list of three; none below zero.

    Three equal ones are one.
    """

    def read(value: Any) -> PerAxis:
        several = isinstance(value, list | tuple)
        if several and len(value) != 3:
            raise ValueError(f"expected one quantity in a unit of {units.example(unit)}, or three, of x, y and z")
        found = tuple(units.read(one, unit, has_sign=False) for one in (value if several else [value]))
        if min(found) < 0.0:
            raise PydanticKnownError("greater_than_equal", {"ge": 0})
        return found[0] if len(set(found)) == 1 else found  # type: ignore[return-value]

    def written(value: PerAxis) -> str | list[str]:
        return [f"{one!r} {unit}" for one in value] if isinstance(value, tuple) else f"{value!r} {unit}"

    one = {"type": ["string", "number"]}
    schema = {
        "anyOf": [one, {"type": "array", "items": one, "minItems": 3, "maxItems": 3}],
        "description": f"quantity with a unit: {units.example(unit)}, or three, of x, y and z",
    }
    return Annotated[PerAxis, BeforeValidator(read), PlainSerializer(written, when_used="json"), WithJsonSchema(schema)]


def axes(value: PerAxis) -> tuple[float, float, float]:
    """Return the values of x, y and z."""
    return value if isinstance(value, tuple) else (value, value, value)


def rms(value: PerAxis) -> float:
    """Return the root mean square of the axes; of one value that value."""
    return math.sqrt(sum(one * one for one in value) / 3.0) if isinstance(value, tuple) else value


def each_axis(function: Callable[..., float], *values: PerAxis) -> PerAxis:
    """Return a function of values that may differ by axis, axis by axis where one of them does."""
    if not any(isinstance(value, tuple) for value in values):
        return function(*values)
    x, y, z = (function(*one) for one in zip(*(axes(value) for value in values), strict=True))
    return x, y, z


def squares(value: PerAxis) -> tuple[float, float, float]:
    """Return the squares of the values of x, y and z."""
    return axes(each_axis(lambda one: one**2, value))


# One-sigmas of a triad's axes, alike or each its own.
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
