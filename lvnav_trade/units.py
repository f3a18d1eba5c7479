"""Quantity fields: "0.01 deg/h" becomes SI here and nowhere else."""

import math
import re
from collections.abc import Iterable, Sequence
from datetime import datetime
from functools import lru_cache
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Self

import pint
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

from lvnav_trade.errors import quoted
from lvnav_trade.limits import EXPONENT, LARGEST, LARGEST_ELSE, QUANTITY_LENGTH, YEARS


@lru_cache(maxsize=1)
def registry() -> "pint.UnitRegistry[Any]":
    """Return the one unit registry: pint's own, the spellings of inertial datasheets, and angles as a dimension.

    With pint's own dimensionless radian 10 rad/s would be read as 10 Hz.
    """
    units: pint.UnitRegistry[Any] = pint.UnitRegistry(None, autoconvert_offset_to_baseunit=True)
    units.load_definitions(str(Path(pint.__file__).with_name("default_en.txt")))
    for definition in (
        "radian = [angle] = rad",
        # In a datasheet "g" is standard gravity and "h" is an hour; pint's gram and Planck constant are never meant.
        "g_standard = 9.80665 m/s^2 = g",
        "milli_g = 1e-3 * g_standard = mg",
        "micro_g = 1e-6 * g_standard = ug",
        "h = hour",
        "t = 1000 kg",
        "rtHz = Hz ** 0.5",
        "dB_Hz = [cn0]",
        "TECU = 1e16 / m**2",
    ):
        units.define(definition)
    return units


_NUMBER = r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?"
_ENDLESS = r"[+-]?(?:nan|inf|infinity)"
_QUANTITY = re.compile(rf"({_NUMBER}|{_ENDLESS}) (\S+)", re.IGNORECASE)
_BARE = re.compile(rf"(?:{_NUMBER}|{_ENDLESS})\s*", re.IGNORECASE)
_BESIDE = re.compile(rf"({_NUMBER})([^\W\d]\S*)")  # a unit without the space
_SEPARATED = re.compile(r"[+-]?[0-9.]+[ ,_']+[0-9]|[+-]?[0-9]+\.[0-9]+\.")


@lru_cache(maxsize=4096)
def parse(text: str, unit: str) -> float:
    """Return the number of SI `unit` that the text states.

    The text is one number, one space and one unit in the datasheet's spelling (``0.2 deg/sqrt(h)``,
    ``50 ug/sqrt(Hz)``); the number has a decimal point and no thousands separators.

    Raises
    ------
    ValueError
        In one line: the text is anything else, the unit is unknown or of another dimension (an angle is a dimension),
        or the number is not finite or beyond `limits.LARGEST`.
    """
    if len(text) > QUANTITY_LENGTH:
        raise ValueError(f"{quoted(text)} is not a quantity: {len(text)} characters, at most {QUANTITY_LENGTH}")
    match = _QUANTITY.fullmatch(text)
    if match is None:
        raise ValueError(_no_quantity(text, unit))
    value, spelled = float(match[1]), match[2]
    if math.isfinite(value):
        value = _converted(text, value, spelled, unit)
    if not math.isfinite(value):
        raise ValueError(f"{text!r} is not a finite quantity")
    largest = LARGEST.get(unit, LARGEST_ELSE)
    if abs(value) > largest:
        raise ValueError(f"{text!r} is too large; at most {largest:g} {unit}")
    return value


def _no_quantity(text: str, unit: str) -> str:
    """Say what is wrong with a text that is no number, space and unit."""
    if _BARE.fullmatch(text):
        return f"{quoted(text)} has no unit; write it as a quantity in a unit of {example(unit)}"
    beside = _BESIDE.fullmatch(text)
    sample = f"{beside[1]} {beside[2]}" if beside else "0.5 deg/h"
    more = "; write a decimal point, and no thousands separators" if _SEPARATED.match(text) else ""
    return f"{quoted(text)} is not a quantity: a number, one space and a unit, such as {sample!r}{more}"


def _converted(text: str, value: float, spelled: str, unit: str) -> float:
    """Return a value of the unit `spelled` in SI `unit`; levels are read as they stand."""
    if unit in _LEVELS:
        if spelled != unit:
            raise ValueError(f"{text!r} has the wrong unit; expected {unit}")
        return value
    try:
        return float(registry().Quantity(value, registry().parse_units(_spelled_for_pint(spelled))).to(unit).magnitude)
    except pint.DimensionalityError:
        raise ValueError(f"{text!r} has the wrong unit; expected {example(unit)}") from None
    except OverflowError:
        return math.inf
    except Exception as error:  # what is no unit fails in the grammar, in the registry or in the conversion
        raise ValueError(f"{text!r} has no unit that is known ({spelled!r}); expected {example(unit)}") from error


_EXPONENT = r"-?[0-9]+(?:\.[0-9]+)?"
_POWER = rf"(?:[^\W\d]+|%|°|1(?=/)|<[0-9]+>)(?:(?:\^|\*\*)(?:{_EXPONENT}|\({_EXPONENT}\)))?"
_PRODUCT = rf"{_POWER}(?:[*/]{_POWER})*"
_GROUP = re.compile(rf"(?<![^\W\d])(sqrt)?\(({_PRODUCT})\)")


def _spelled_for_pint(unit: str) -> str:
    """Return a unit such as ``deg/sqrt(h)`` as pint reads it; ValueError where it is none: nothing else reaches pint.

    It is a product or quotient of names, 1, groups in brackets and square roots, each perhaps to one bounded power.
    """
    if "<" in unit or any(one.isnumeric() and one not in "0123456789" for one in unit):
        raise ValueError("characters that no unit has")
    groups: list[str] = []

    def numbered(group: re.Match[str]) -> str:
        groups.append(f"(({group[2]})**0.5)" if group[1] else f"({group[2]})")
        return f"<{len(groups) - 1}>"

    while _GROUP.search(unit):
        unit = _GROUP.sub(numbered, unit, count=1)
    if not re.fullmatch(_PRODUCT, unit):
        raise ValueError("no unit")
    for number, group in reversed([*enumerate(groups)]):
        unit = unit.replace(f"<{number}>", group)
    if any(float(exponent) > EXPONENT for exponent in re.findall(r"(?:\^|\*\*)\(?-?([0-9.]+)", unit)):
        raise ValueError("an exponent that no unit has")
    return unit.replace("^", "**").replace("%", "percent")


# Levels are read as they stand: they are logarithms, and which ratio each is of is said by its one spelling.
_LEVELS = ("dB-Hz", "dB", "dBi", "dBW")

_EXAMPLES = {
    "m": "length (m, km, cm)",
    "s": "time (s, ms, min)",
    "rad": "angle (deg, mrad, arcsec)",
    "rad/s": "angular rate (deg/h, deg/s, rad/s)",
    "m/s": "speed (m/s, km/s)",
    "m/s**2": "acceleration (m/s^2, g, mg, ug)",
    "Hz": "frequency (Hz)",
    "kg": "mass (kg, t)",
    "W": "power (W)",
    "m**3": "volume (l, m^3, cm^3)",
    "N": "force (N, kN)",
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
    "K": "temperature (K)",
    "1/m**2": "electron content (TECU)",
    "Pa": "pressure (Pa, hPa, mbar)",
    "rad/s**2": "angular acceleration (rad/s^2, deg/s^2)",
    "1/s": "gain (1/s)",
    "rad*s**2/m": "angle per specific force (rad/g, deg/g)",
    "m/s**3": "jerk (m/s^3, g/s)",
    "1/s**2": "variance of jerk per squared acceleration (1/s^2)",
    "T": "magnetic flux density (nT, uT, T)",
    "m*s**2": "variance of range per acceleration (m*s^2)",
}


def example(unit: str) -> str:
    """Return what a quantity of SI `unit` is, with units that it is written in."""
    return _EXAMPLES.get(unit, unit)


def quantity(unit: str, minimum: float | None = None, above: float | None = None) -> Any:
    """Return the pydantic annotation of a float held in SI `unit` and written with a unit in the card.

    It is refused below `minimum`, and unless it is greater than `above` (both SI). Dumped in JSON mode it becomes text
    again (``"0.0003 m/s"``), so that a resolved card reads back to the same number.
    """
    return Annotated[
        float,
        BeforeValidator(lambda value: read(value, unit)),
        PlainSerializer(lambda value: f"{value!r} {unit}", return_type=str, when_used="json"),
        WithJsonSchema({"type": ["string", "number"], "description": f"quantity with a unit: {example(unit)}"}),
        Field(ge=minimum, gt=above, allow_inf_nan=False),
    ]


def read(value: Any, unit: str) -> float:
    """Return the number of SI `unit` that a field of a card states; ValueError where it is none."""
    if isinstance(value, bool) or not isinstance(value, str | int | float):
        raise ValueError(f"expected a quantity in a unit of {example(unit)}")
    if isinstance(value, str):
        return parse(str(value), unit)
    if value == 0:
        return 0.0  # zero is the same in every unit
    raise ValueError(f"{quoted(value)} has no unit; write it as a quantity in a unit of {example(unit)}")


def _stricter(schema: Any) -> Any:
    """Return a part of a schema in which numbers refuse truth values, and lists of known words refuse repetitions."""
    if isinstance(schema, list):
        return [_stricter(one) for one in schema]
    if not isinstance(schema, dict) or schema.get("type") == "model":
        return schema
    found: Any = {key: value if key == "serialization" else _stricter(value) for key, value in schema.items()}
    if found.get("type") in ("int", "float"):
        return core_schema.no_info_before_validator_function(_plain_number, found)
    items = found.get("items_schema") if found.get("type") == "tuple" else None
    if isinstance(items, list) and len(items) == 1 and items[0].get("type") == "literal":
        return core_schema.no_info_after_validator_function(distinct, found)
    return found


def _plain_number(value: Any) -> Any:
    if isinstance(value, bool):
        raise ValueError(f"should be a number, not {str(value).lower()}")
    if isinstance(value, int | float) and math.isfinite(value) and abs(value) > LARGEST_ELSE:
        raise ValueError(f"{quoted(value)} is too large; at most {LARGEST_ELSE:g}")
    return value


def distinct(values: Sequence[Any]) -> Sequence[Any]:
    """Return the values; ValueError names the first that stands twice."""
    for index, value in enumerate(values):
        if value in values[:index]:
            raise ValueError(f"{quoted(value)} stands twice")
    return values


def require_rising(name: str, values: Sequence[float]) -> None:
    """ValueError where a column of a card does not rise from entry to entry."""
    if any(later <= earlier for earlier, later in pairwise(values)):
        raise ValueError(f"{name} must rise from entry to entry")


class Card(BaseModel):
    """Base of every settings object: frozen, and a key that it does not know is an error.

    So are a truth value where a number belongs, a number that is not finite, and a word that stands twice in a list of
    known words.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    def _faults(self) -> Iterable[str]:
        """Return what makes these settings impossible, in words; the first is the error."""
        return ()

    @model_validator(mode="after")
    def _possible(self) -> Self:
        for fault in self._faults():
            raise ValueError(fault)
        return self

    @classmethod
    def __get_pydantic_core_schema__(cls, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        """Return pydantic's schema of the settings with the stricter rules for numbers and lists of words."""
        schema = handler(source)
        whole: Any = handler.resolve_ref_schema(schema)
        while whole["type"] != "model":  # rules of the whole stand around it
            whole = whole["schema"]
        whole["schema"] = _stricter(whole["schema"])
        return schema


class NamedCard(Card):
    """A card of something that has a name, and where its numbers are from."""

    name: str
    source: str


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

# These have no sign: a mass, the length of a pause, and every one-sigma.
Mass = quantity("kg", minimum=0.0)
Power = quantity("W", minimum=0.0)
Volume = quantity("m**3", minimum=0.0)
Hours = quantity("s", above=0.0)
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

# And these divide.
Frequency = quantity("Hz", above=0.0)
TimeConstant = quantity("s", above=0.0)
Force = quantity("N", above=0.0)
Pressure = quantity("Pa", above=0.0)
ScaleHeight = quantity("m", above=0.0)


def _epoch(text: str) -> str:
    """Return an ISO 8601 time; ValueError where it is none, or not of the age of space flight."""
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
