"""Quantities with units: fields of cards such as "0.01 deg/h" are converted to SI here and nowhere else."""

import math
import re
import unicodedata
from collections.abc import Iterable, Sequence
from datetime import datetime
from decimal import Decimal
from functools import lru_cache
from itertools import pairwise
from typing import Annotated, Any, Self

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    GetCoreSchemaHandler,
    PlainSerializer,
    WithJsonSchema,
    model_validator,
)
from pydantic_core import CoreSchema, core_schema

from lvnav_trade.quantities.errors import quoted
from lvnav_trade.quantities.input_files import DECIMAL as _NUMBER
from lvnav_trade.quantities.input_files import is_plain
from lvnav_trade.quantities.input_limits import LARGEST, LARGEST_ELSE, QUANTITY_LENGTH, SMALLEST, YEARS
from lvnav_trade.quantities.marks import ASSUMED, SECOND_HAND, Marks, mark_faults
from lvnav_trade.quantities.unit_spelling import UnknownUnitError, conversion, product

_SIZE = r"\u00b1|\+/-|\+-"
_ENDLESS = r"[+-]?(?:nan|inf|infinity)"
_QUANTITY = re.compile(rf"(?P<size>{_SIZE})?(?P<number>{_NUMBER}|{_ENDLESS}) (?P<unit>\S+)", re.IGNORECASE)
_BARE = re.compile(rf"(?:{_SIZE})?(?:{_NUMBER}|{_ENDLESS})\s*", re.IGNORECASE)
_BESIDE = re.compile(rf"((?:{_SIZE})?{_NUMBER})([^\W\d]\S*|[%\u00b0]\S*)")  # a unit without the space
_SEPARATED = re.compile(r"[+-]?[0-9.]+[ ,_']+[0-9]|[+-]?[0-9]+\.[0-9]+\.")
_MINUS = re.compile(r"^\u2212|(?<=[0-9.][eE])\u2212")

# Logarithmic units, and multiples of the filter's sigma, by spelling: the number to add for the reference unit.
_LEVELS = {
    "dB-Hz": {"dB-Hz": 0.0, "dBHz": 0.0, "dB*Hz": 0.0, "dB\u00b7Hz": 0.0},
    "dB": {"dB": 0.0},
    "dBi": {"dBi": 0.0, "dBic": 0.0},
    "dBW": {"dBW": 0.0, "dBm": -30.0},
    "sigma": {"sigma": 0.0},
}


@lru_cache(maxsize=4096)
def parse(text: str, unit: str, has_sign: bool = True) -> float:
    """Return a quantity, written as text, in an SI unit.

    Parameters
    ----------
    text : one number, one space and one unit in the spelling of datasheets (``0.2 deg/sqrt(h)``, ``50 ug/sqrt(Hz)``),
        with a decimal point and without thousands separators. Units: `unit_spelling.units`.
    unit : SI unit of the result.
    has_sign : whether the quantity may be negative. Otherwise, as for a sigma, a plus-minus sign is allowed.

    Raises
    ------
    ValueError
        The text is no quantity, the unit is unknown or of another dimension (an angle is a dimension), the number is
        not finite or beyond `input_limits.LARGEST`, or a temperature is below absolute zero. The message has one line.
    """
    if len(text) > QUANTITY_LENGTH:
        raise ValueError(f"{quoted(text)} is not a quantity: {len(text)} characters, at most {QUANTITY_LENGTH}")
    match = _QUANTITY.fullmatch(with_ascii_minus(text))
    if match is None:
        raise ValueError(_no_quantity(text, unit))
    if match["size"] and (has_sign or match["number"].startswith(("+", "-"))):
        raise ValueError(f"{text!r} has both signs where the quantity has one; write one number")
    value = float(match["number"])
    if math.isfinite(value):
        value = _convert(text, value, match["unit"], unit)
    if not math.isfinite(value):
        raise ValueError(f"{text!r} is not a finite quantity")
    largest = LARGEST.get(unit, LARGEST_ELSE)
    if abs(value) > largest:
        raise ValueError(f"{text!r} is too large; at most {largest:g} {unit}")
    if 0.0 < abs(value) < SMALLEST:
        raise ValueError(f"{text!r} is too small; write 0, or at least {SMALLEST:g} {unit}")
    if unit == "K" and value < 0.0:
        raise ValueError(f"{text!r} is below absolute zero")
    return value


def with_ascii_minus(text: str) -> str:
    """Return a text with ASCII minus signs in number and exponent; text copied from a PDF has U+2212 instead."""
    return _MINUS.sub("-", text)


def _no_quantity(text: str, unit: str) -> str:
    """Return the error of a text that is not a number, a space and a unit."""
    number, _, _ = text.partition(" ")
    foreign = [char for char in number if not char.isascii() and char not in "\u00b1\u00b0\u00b5\u03bc"]
    if foreign:
        character_name = f"U+{ord(foreign[0]):04X} {unicodedata.name(foreign[0], 'without a name')}"
        advice = "write digits 0 to 9, '-' and a space, as in '-0.5 deg/h'"
        return f"{quoted(text)} is not a quantity: {character_name}; {advice}"
    if _BARE.fullmatch(text):
        return f"{quoted(text)} has no unit; write it as a quantity in a unit of {example(unit)}"
    unspaced_match = _BESIDE.fullmatch(text)
    sample = f"{unspaced_match[1]} {unspaced_match[2]}" if unspaced_match else "0.5 deg/h"
    separator_hint = "; write a decimal point, and no thousands separators" if _SEPARATED.match(text) else ""
    return f"{quoted(text)} is not a quantity: a number, one space and a unit, such as {sample!r}{separator_hint}"


def _convert(text: str, value: float, unit_text: str, unit: str) -> float:
    """Return a value in the unit `unit_text` converted to SI `unit`."""
    if unit in _LEVELS:
        if unit_text not in _LEVELS[unit]:
            raise ValueError(f"{text!r} has the wrong unit; expected {unit}")
        return value + _LEVELS[unit][unit_text]
    try:
        source, target = product(unit_text), product(unit)
    except UnknownUnitError as error:
        if error.remedy:
            raise ValueError(f"{text!r}: {error.unknown_text!r} {error.remedy}") from None
        raise ValueError(
            f"{text!r} has no unit that is known ({error.unknown_text!r}); expected {example(unit)}"
        ) from None
    if source.dimension != target.dimension:
        raise ValueError(f"{text!r} has the wrong unit; expected {example(unit)}")
    try:
        return value * conversion(source, target) + source.offset
    except OverflowError:
        return math.inf


# SI units, with the quantity and units in which it is written
EXAMPLES = {
    "m": "length (m, km, cm)",
    "s": "time (s, ms, min)",
    "rad": "angle (deg, mrad, arcsec)",
    "rad/s": "angular rate (deg/h, deg/s, rad/s)",
    "m/s": "speed (m/s, km/s)",
    "m/s**2": "acceleration (m/s^2, g, mg, ug)",
    "Hz": "frequency (Hz)",
    "kg": "mass (kg, t, lb)",
    "W": "power (W)",
    "m**3": "volume (l, m^3, cm^3)",
    "N": "force (N, kN, lbf)",
    "rad/s**0.5": "angle random walk (deg/sqrt(h), deg/h/sqrt(Hz))",
    "m/s**0.5": "position random walk (m/sqrt(s))",
    "m/s**1.5": "velocity random walk (m/s/sqrt(h), ug/sqrt(Hz))",
    "rad/s**1.5": "rate random walk (deg/h/sqrt(h))",
    "m/s**2.5": "acceleration random walk (mg/sqrt(h))",
    "rad*s/m": "g-sensitivity (deg/h/g)",
    "1/s**0.5": "scale-factor drift (ppm/sqrt(year))",
    "m**2/s**3": "density of acceleration (g^2/Hz, (m/s^2)^2/Hz)",
    "rad**2/s": "density of angular rate ((deg/s)^2/Hz, (rad/s)^2/Hz)",
    "dimensionless": "fraction (ppm, percent, dimensionless)",
    "dB-Hz": "carrier to noise density (dB-Hz)",
    "dB": "ratio of powers (dB)",
    "dBi": "antenna gain (dBi)",
    "dBW": "power (dBW)",
    "K": "temperature (K, degC)",
    "1/m**2": "electron content (TECU)",
    "Pa": "pressure (Pa, hPa, mbar, psi)",
    "rad/s**2": "angular acceleration (rad/s^2, deg/s^2)",
    "1/s": "gain (1/s)",
    "rad*s**2/m": "angle per specific force (rad/g, deg/g)",
    "m/s**3": "jerk (m/s^3, g/s)",
    "1/s**2": "variance of jerk per squared acceleration (1/s^2)",
    "T": "magnetic flux density (nT, uT, gauss)",
    "m*s**2": "variance of range per acceleration (m*s^2)",
}


def example(unit: str) -> str:
    """Return the name of the quantity with SI `unit`, and units in which it is written."""
    return EXAMPLES.get(unit, unit)


def quantity(unit: str, minimum: float | None = None, exclusive_minimum: float | None = None) -> Any:
    """Return the pydantic annotation of a float in SI `unit` that a card writes with a unit.

    The value must be at least `minimum` and greater than `exclusive_minimum` (both SI). Dumped in JSON mode it becomes
    text again (``"0.0003 m/s"``), which is read back to the same number.
    """
    has_sign = not any(bound is not None and bound >= 0.0 for bound in (minimum, exclusive_minimum))
    return Annotated[
        float,
        BeforeValidator(lambda value: read(value, unit, has_sign)),
        PlainSerializer(lambda value: f"{value!r} {unit}", return_type=str, when_used="json"),
        WithJsonSchema({"type": ["string", "number"], "description": f"quantity with a unit: {example(unit)}"}),
        Field(ge=minimum, gt=exclusive_minimum, allow_inf_nan=False),
    ]


def at_most(annotation: Any, largest: float, limit_text: str) -> Any:
    """Return the annotation of a quantity of at most `largest` (SI), which messages print as `limit_text`."""

    def check(value: Any) -> Any:
        if max(value if isinstance(value, tuple) else (value,)) > largest * (1.0 + 1e-9):
            raise ValueError(f"is too large for such a device; at most {limit_text}")
        return value

    return Annotated[annotation, AfterValidator(check)]


def at_least(annotation: Any, smallest: float, limit_text: str) -> Any:
    """Return the annotation of a quantity of at least `smallest` (SI), which messages print as `limit_text`."""

    def check(value: float) -> float:
        if value < smallest * (1.0 - 1e-9):
            raise ValueError(f"is too small for such a device; at least {limit_text}")
        return value

    return Annotated[annotation, AfterValidator(check)]


def read(value: Any, unit: str, has_sign: bool = True) -> float:
    """Return the value of a card's field in SI `unit`; ValueError as in `parse`, or if a number has no unit."""
    if isinstance(value, bool) or not isinstance(value, str | int | float):
        raise ValueError(f"expected a quantity in a unit of {example(unit)}")
    if isinstance(value, str):
        return parse(str(value), unit, has_sign)
    if value == 0:
        return 0.0  # zero is the same in every unit
    raise ValueError(f"{quoted(value)} has no unit; write it as a quantity in a unit of {example(unit)}")


def _strict_schema(schema: Any) -> Any:
    """Return a schema whose numbers reject booleans, and whose lists of literals reject repetitions."""
    if isinstance(schema, list):
        return [_strict_schema(item) for item in schema]
    if not isinstance(schema, dict) or schema.get("type") == "model":
        return schema
    strict: Any = {key: value if key == "serialization" else _strict_schema(value) for key, value in schema.items()}
    if strict.get("type") in ("int", "float"):
        return core_schema.no_info_before_validator_function(_plain_number, strict)
    items = strict.get("items_schema") if strict.get("type") == "tuple" else None
    if isinstance(items, list) and len(items) == 1 and items[0].get("type") == "literal":
        return core_schema.no_info_after_validator_function(require_distinct, strict)
    return strict


def _plain_number(value: Any) -> Any:
    if isinstance(value, bool):
        raise ValueError(f"should be a number, not {str(value).lower()}")
    if isinstance(value, str) and not is_plain(value):
        raise ValueError(f"{quoted(value)} is not a decimal number: digits 0 to 9 without separators")
    is_finite = isinstance(value, int) or (isinstance(value, float) and math.isfinite(value))
    if is_finite and abs(value) > LARGEST_ELSE:
        raise ValueError(f"{quoted(value)} is too large; at most {LARGEST_ELSE:g}")
    return value


def require_distinct(values: Sequence[Any]) -> Sequence[Any]:
    """Return the values; ValueError if a value is listed twice."""
    for index, value in enumerate(values):
        if value in values[:index]:
            raise ValueError(f"{quoted(value)} is listed twice")
    return values


def require_rising(name: str, values: Sequence[float]) -> None:
    """Raise ValueError if a column of a card does not rise from entry to entry."""
    if any(next_value <= previous_value for previous_value, next_value in pairwise(values)):
        raise ValueError(f"{name} must rise from entry to entry")


class Card(BaseModel):
    """Base of all settings. Instances are frozen.

    Unknown keys, booleans in place of numbers, numbers that are not finite, and repeated literals in a list are errors.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    def _faults(self) -> Iterable[str]:
        """Return the errors of these settings, as messages; only the first is raised."""
        return ()

    @model_validator(mode="after")
    def _check_faults(self) -> Self:
        for fault in self._faults():
            raise ValueError(fault)
        return self

    @classmethod
    def __get_pydantic_core_schema__(cls, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        """Return pydantic's schema of the settings with the stricter rules for numbers and lists of words."""
        schema = handler(source)
        model: Any = handler.resolve_ref_schema(schema)
        while model["type"] != "model":  # validators of the whole model wrap its schema
            model = model["schema"]
        model["schema"] = _strict_schema(model["schema"])
        return schema


class NamedCard(Card):
    """A card with a name and the sources of its numbers."""

    name: str
    source: str = Field(description="source of the numbers")
    assumed: Marks = ASSUMED
    second_hand: Marks = SECOND_HAND

    @model_validator(mode="after")
    def _check_marks(self) -> Self:
        for fault in mark_faults(self):
            raise ValueError(fault)
        return self


def _share(value: Any) -> Any:
    """Return the number of a fraction written with a unit, such as ``99.73 %``; other values unchanged."""
    if not isinstance(value, str) or not (" " in value or "%" in value):
        return value
    fraction = parse(value, "dimensionless")
    number, _, unit = with_ascii_minus(value).partition(" ")
    return float(Decimal(number).scaleb(-2)) if unit in ("%", "percent") else fraction  # 99.73 % is 0.9973 to the bit


Share = Annotated[
    float,
    BeforeValidator(_share),
    WithJsonSchema({"type": ["number", "string"], "description": "number, or a fraction with a unit (99.73 %)"}),
]
"""A probability, a confidence level or another fraction: a plain number or a percentage."""

Length = quantity("m")
Duration = quantity("s")
Angle = quantity("rad")
AngularRate = quantity("rad/s")
Speed = quantity("m/s")
Acceleration = quantity("m/s**2")
CarrierToNoise = quantity("dB-Hz")
TurnRate = quantity("Hz")
Gain = quantity("dBi")
Level = quantity("dBW")
SignedFraction = quantity("dimensionless")

# Quantities without a sign, such as a mass, a duration and every sigma
Mass = quantity("kg", minimum=0.0)
Power = quantity("W", minimum=0.0)
Volume = quantity("m**3", minimum=0.0)
Hours = quantity("s", exclusive_minimum=0.0)
Area = quantity("m**2", minimum=0.0)
Pause = quantity("s", minimum=0.0)
LengthSigma = quantity("m", minimum=0.0)
AngleSigma = quantity("rad", minimum=0.0)
AngularRateSigma = quantity("rad/s", minimum=0.0)
SpeedSigma = quantity("m/s", minimum=0.0)
AccelerationSigma = quantity("m/s**2", minimum=0.0)
AngleRandomWalk = quantity("rad/s**0.5", minimum=0.0)
VelocityRandomWalk = quantity("m/s**1.5", minimum=0.0)
PositionRandomWalk = quantity("m/s**0.5", minimum=0.0)
RateRandomWalk = quantity("rad/s**1.5", minimum=0.0)
AccelerationRandomWalk = quantity("m/s**2.5", minimum=0.0)
GSensitivity = quantity("rad*s/m", minimum=0.0)
ScaleDrift = quantity("1/s**0.5", minimum=0.0)
AccelerationDensity = quantity("m**2/s**3", minimum=0.0)
RateDensity = quantity("rad**2/s", minimum=0.0)
Fraction = quantity("dimensionless", minimum=0.0)
Decibels = quantity("dB", minimum=0.0)
Temperature = quantity("K", minimum=0.0)
ElectronContent = quantity("1/m**2", minimum=0.0)
JitterPerForce = quantity("rad*s**2/m", minimum=0.0)
AngularAccelerationSigma = quantity("rad/s**2", minimum=0.0)
GainPerSecond = quantity("1/s", minimum=0.0)
JerkSigma = quantity("m/s**3", minimum=0.0)
FluxDensitySigma = quantity("T", minimum=0.0)
JerkGain = quantity("1/s**2", minimum=0.0)
RangeGain = quantity("m*s**2", minimum=0.0)

# Quantities above zero, because they divide
Frequency = quantity("Hz", exclusive_minimum=0.0)
TimeConstant = quantity("s", exclusive_minimum=0.0)
Force = quantity("N", exclusive_minimum=0.0)
Pressure = quantity("Pa", exclusive_minimum=0.0)
ScaleHeight = quantity("m", exclusive_minimum=0.0)

# Limits of either sign: of deflection, full scale.
AngleLimit = quantity("rad", exclusive_minimum=0.0)
# Of sensors: below these a gyro is clipped by any manoeuvre, an accelerometer by a tenth of gravity
AngularRateLimit = at_least(quantity("rad/s", exclusive_minimum=0.0), math.pi / 180.0, "1 deg/s")
AccelerationLimit = at_least(quantity("m/s**2", exclusive_minimum=0.0), 0.980665, "0.1 g")
# Rates of sensors and filters
StepRate = at_most(Frequency, 2e4, "20 kHz")
# Sigma of an attitude, at most half a turn
AttitudeSigma = at_most(AngleSigma, math.pi, "180 deg")


def _epoch(text: str) -> str:
    """Return an ISO 8601 time; ValueError if it is none, or outside the years of space flight."""
    try:
        year = datetime.fromisoformat(text).year if text.isascii() else 0
    except ValueError:
        year = 0
    if not YEARS[0] <= year <= YEARS[1]:
        raise ValueError(
            f"{quoted(text)} is not an ISO 8601 time such as 2026-08-01T12:00:00Z, from {YEARS[0]} to {YEARS[1]}"
        )
    return text


Epoch = Annotated[str, AfterValidator(_epoch)]
