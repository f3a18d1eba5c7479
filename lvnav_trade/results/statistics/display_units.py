"""Conversion of the quantities of resolved settings, which are in SI, to the units of data sheets."""

import math
from collections.abc import Mapping
from typing import Any

from lvnav_trade.quantities.marks import MARKS

_G = 9.80665
_DEG, _HOUR = math.pi / 180.0, 3600.0
_YEAR = 365.25 * 86400.0
# By SI unit: units of data sheets with their size in SI, the largest first. The first unit not above a value is used.
_SHEETS: dict[str, tuple[tuple[str, float], ...]] = {
    "rad": (("deg", _DEG), ("mrad", 1e-3)),
    "rad/s": (("deg/s", _DEG), ("deg/h", _DEG / _HOUR)),
    "rad/s**0.5": (("deg/sqrt(h)", _DEG / math.sqrt(_HOUR)),),
    "rad/s**1.5": (("deg/h/sqrt(h)", _DEG / _HOUR / math.sqrt(_HOUR)),),
    "rad*s/m": (("deg/h/g", _DEG / _HOUR / _G),),
    "m/s**2": (("g", _G), ("mg", 1e-3 * _G), ("ug", 1e-6 * _G)),
    "m/s**1.5": (("m/s/sqrt(h)", 1.0 / math.sqrt(_HOUR)),),
    "m/s**2.5": (("mg/sqrt(h)", 1e-3 * _G / math.sqrt(_HOUR)),),
    "1/s**0.5": (("ppm/sqrt(year)", 1e-6 / math.sqrt(_YEAR)),),
    "m**3": (("l", 1e-3),),
    "m**2": (("m^2", 1.0),),
    "m": (("km", 1e3), ("m", 1.0)),
    "dimensionless": (("%", 1e-2), ("ppm", 1e-6)),
}
_FEW = 4
_NOTHING: tuple[Any, ...] = (None, "", [], {})
_WORDS = ("name", "source", *MARKS)


def split(text: Any) -> tuple[float, str] | None:
    """Return number and SI unit of a quantity of resolved settings; None if the value is not a quantity."""
    number, space, unit = str(text).partition(" ")
    if not isinstance(text, str) or not space:
        return None
    try:
        return float(number), unit
    except ValueError:
        return None


def in_people(value: Any) -> str:
    """Return a value of resolved settings as text: quantities in units of data sheets, settings with their fields.

    The text of null is empty.
    """
    if value is None:
        return ""
    if isinstance(value, Mapping):
        fields = {key: field for key, field in value.items() if key not in _WORDS and field not in _NOTHING}
        return _first([f"{key} {in_people(field)}" for key, field in fields.items()])
    if isinstance(value, list):
        return _first([in_people(item) for item in value])
    quantity = split(value)
    if quantity is None:
        return f"{value:.6g}" if isinstance(value, float) else str(value)
    number, unit = quantity
    sheets = _SHEETS.get(unit, ((unit, 1.0),))
    fit = [sheet for sheet in sheets if abs(number) >= sheet[1] * (1.0 - 1e-9)]
    name, size = fit[0] if fit else sheets[-1 if number else 0]
    return f"{float(f'{number / size:.4g}'):g} {name}"


def _first(texts: list[str]) -> str:
    """Join texts; if there are many, only the first, with the number of the others."""
    more = len(texts) - _FEW
    return ", ".join(texts[:_FEW]) + (f" and {more} more" if more > 0 else "")
