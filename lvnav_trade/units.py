"""Quantity fields: "0.01 deg/h" becomes SI here and nowhere else."""

from __future__ import annotations

import math
import re
from functools import lru_cache
from typing import Annotated, Any

import pint
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, PlainSerializer, WithJsonSchema


@lru_cache(maxsize=1)
def registry() -> pint.UnitRegistry[Any]:
    """Return the one unit registry: pint's own plus the spellings of inertial datasheets."""
    units: pint.UnitRegistry[Any] = pint.UnitRegistry(autoconvert_offset_to_baseunit=True)
    # In a datasheet "g" is standard gravity and "h" is an hour; pint's gram and Planck constant are never meant.
    units.define("g_standard = 9.80665 m/s^2 = g")
    units.define("milli_g = 1e-3 * g_standard = mg")
    units.define("micro_g = 1e-6 * g_standard = ug")
    units.define("h = hour")
    units.define("t = 1000 kg")
    units.define("rtHz = Hz ** 0.5")
    units.define("dB_Hz = [cn0]")
    units.define("TECU = 1e16 / m**2")
    return units


@lru_cache(maxsize=4096)
def parse(text: str, unit: str) -> float:
    """Return the number of SI `unit` that the text states; raise ValueError in one line where it does not.

    The text is a number followed by a unit in the datasheet's spelling (``0.2 deg/sqrt(h)``, ``50 ug/sqrt(Hz)``).
    """
    number, _, spelled = text.strip().partition(" ")
    try:
        value = float(number)
    except ValueError:
        number, spelled = _split(text.strip())
        value = float(number)
    if not spelled.strip():
        raise ValueError(f"{text!r} has no unit; write it as a quantity in a unit of {_example(unit)}")
    if not math.isfinite(value):
        raise ValueError(f"{text!r} is not a finite quantity")
    if unit in _LEVELS:
        if spelled.strip() != unit:
            raise ValueError(f"{text!r} has the wrong unit; expected {unit}")
        return value
    try:
        value = float((value * registry().parse_expression(_pint_spelling(spelled))).to(unit).magnitude)
    except pint.DimensionalityError:
        raise ValueError(f"{text!r} has the wrong unit; expected {_example(unit)}") from None
    except Exception as error:  # what is no unit fails in the tokenizer, in the evaluation or in the conversion
        raise ValueError(
            f"{text!r} has no unit that is known ({spelled.strip()!r}); expected {_example(unit)}"
        ) from error
    if not math.isfinite(value):
        raise ValueError(f"{text!r} is not a finite quantity")
    return value


def _split(text: str) -> tuple[str, str]:
    """Split "10Hz" after the longest leading number."""
    for end in range(len(text), 0, -1):
        try:
            float(text[:end])
        except ValueError:
            continue
        return text[:end], text[end:]
    raise ValueError(f"{text!r} is not a quantity: a number and a unit, such as '0.5 deg/h'")


def _pint_spelling(unit: str) -> str:
    """Turn ``deg/sqrt(h)`` into an expression that pint evaluates, and percent and ppm into numbers."""
    text = unit.strip().replace("^", "**").replace("%", "percent")
    return re.sub(r"sqrt\(([^()]*)\)", r"((\1)**0.5)", text)


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
    "N": "force (N, kN)",
    "rad/s**0.5": "angle random walk (deg/sqrt(h), deg/h/sqrt(Hz))",
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
    "m*s**2": "variance of range per acceleration (m*s^2)",
}


def _example(unit: str) -> str:
    return _EXAMPLES.get(unit, unit)


def quantity(unit: str, minimum: float | None = None, above: float | None = None) -> Any:
    """Return the pydantic annotation of a float held in SI `unit` and written with a unit in the card.

    It is refused below `minimum`, and unless it is greater than `above` (both SI). Dumped in JSON mode it becomes text
    again (``"0.0003 m/s"``), so that a resolved card reads back to the same number.
    """

    def read(value: Any) -> float:
        if isinstance(value, bool) or not isinstance(value, str | int | float):
            raise ValueError(f"expected a quantity in a unit of {_example(unit)}")
        if isinstance(value, str):
            return parse(str(value), unit)
        if value == 0:
            return 0.0  # zero is the same in every unit
        raise ValueError(f"{value} has no unit; write it as a quantity in a unit of {_example(unit)}")

    def write(value: float) -> str:
        return f"{value!r} {unit}"

    schema = {"type": ["string", "number"], "description": f"quantity with a unit: {_example(unit)}"}
    return Annotated[
        float,
        BeforeValidator(read),
        PlainSerializer(write, return_type=str, when_used="json"),
        WithJsonSchema(schema),
        Field(ge=minimum, gt=above, allow_inf_nan=False),
    ]


class Card(BaseModel):
    """Base of every settings object: frozen, and a key that it does not know is an error."""

    model_config = ConfigDict(frozen=True, extra="forbid")


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

# These have no sign: a mass, the length of a pause, and every one-sigma.
Mass = quantity("kg", minimum=0.0)
Area = quantity("m**2", minimum=0.0)
Pause = quantity("s", minimum=0.0)
LengthSigma = quantity("m", minimum=0.0)
AngleSigma = quantity("rad", minimum=0.0)
AngularRateSigma = quantity("rad/s", minimum=0.0)
SpeedSigma = quantity("m/s", minimum=0.0)
AccelerationSigma = quantity("m/s**2", minimum=0.0)
AngleRandomWalk = quantity("rad/s**0.5", minimum=0.0)
VelocityRandomWalk = quantity("m/s**1.5", minimum=0.0)
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
JerkGain = quantity("1/s**2", minimum=0.0)
RangeGain = quantity("m*s**2", minimum=0.0)

# And these divide.
Frequency = quantity("Hz", above=0.0)
TimeConstant = quantity("s", above=0.0)
Force = quantity("N", above=0.0)
Pressure = quantity("Pa", above=0.0)
ScaleHeight = quantity("m", above=0.0)
