"""Quantities in the units of datasheets, and names of cases, as a report shows them."""

import math
import re
from collections import Counter
from collections.abc import Mapping
from typing import Any

from lvnav_trade.quantities.marks import MARKS
from lvnav_trade.results.tables.read import Tables

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


def split_quantity(text: Any) -> tuple[float, str] | None:
    """Return number and SI unit of a quantity of resolved settings; None if the value is not a quantity."""
    number, space, unit = str(text).partition(" ")
    if not isinstance(text, str) or not space:
        return None
    try:
        return float(number), unit
    except ValueError:
        return None


def display_text(value: Any) -> str:
    """Return a value of resolved settings as text: quantities in units of data sheets, settings with their fields.

    The text of null is empty.
    """
    if value is None:
        return ""
    if isinstance(value, Mapping):
        fields = {key: field for key, field in value.items() if key not in _WORDS and field not in _NOTHING}
        return _abridge([f"{key} {display_text(field)}" for key, field in fields.items()])
    if isinstance(value, list):
        return _abridge([display_text(item) for item in value])
    quantity = split_quantity(value)
    if quantity is None:
        if isinstance(value, float):
            return f"{value:.6g}"
        return str(value)
    number, unit = quantity
    sheets = _SHEETS.get(unit, ((unit, 1.0),))
    fitting_sheets = [sheet for sheet in sheets if abs(number) >= sheet[1] * (1.0 - 1e-9)]
    if fitting_sheets:
        name, size = fitting_sheets[0]
    else:
        name, size = sheets[-1 if number else 0]
    display_value = float(f"{number / size:.4g}")
    return f"{display_value:g} {name}"


def _abridge(texts: list[str]) -> str:
    """Join texts; if there are many, only the first, with the number of the others."""
    further_count = len(texts) - _FEW
    return ", ".join(texts[:_FEW]) + (f" and {further_count} more" if further_count > 0 else "")


_CARD_LABEL = re.compile(r"[a-z0-9][a-z0-9_.-]*")  # label of a level that is the file name of its card
_NAMELESS = "several units"  # name of an IMU array that is written in the campaign: no title of its own
_LONGEST = 80  # characters; a longer name of a card is not used as a heading
SEPARATOR = " · "


def case_names(tables: Tables) -> dict[str, str]:
    """Return a unique name for each case, by digest, in the order of the plan.

    A level of an axis has the name of its card if all cards of the axis have different names, otherwise axis and label,
    such as ``update_rate=1 Hz``. Axes with the same level in all cases are omitted. If no level has the name of a card,
    and in a design space, the label of the case is its name.
    """
    if tables.has_designs:
        return dict(tables.labels)
    axes = list(next(iter(tables.levels.values()), {}))
    definitions = dict(zip(axes, tables.campaign.get("axes") or (), strict=False))
    card_names = {axis: _level_names(definitions[axis]) for axis in axes if axis in definitions}
    varied_axes = []
    for axis in axes:
        distinct_levels = {levels[axis] for levels in tables.levels.values()}
        if len(distinct_levels) > 1:
            varied_axes.append(axis)
    name_by_case = {}
    for case, levels in tables.levels.items():
        level_names = []
        has_card = False
        for axis in varied_axes:
            level = levels[axis]
            card_name = card_names.get(axis, {}).get(level)
            level_names.append(f"{axis}={level}" if card_name is None else card_name)
            has_card |= card_name is not None
        name_by_case[case] = SEPARATOR.join(level_names) if has_card else tables.labels[case]
    count = Counter(name_by_case.values())
    unique_names = {}
    for case, name in name_by_case.items():
        unique_names[case] = name if count[name] == 1 else tables.labels[case]
    return unique_names


def _level_names(axis: Mapping[str, Any]) -> dict[str, str]:
    """Return the names of an axis's cards by label; empty if the levels are not cards, or have labels of the user."""
    labels = list(axis.get("labels") or ())
    cards = []
    for value in axis.get("values") or ():
        name = value.get("name") if isinstance(value, Mapping) else None
        cards.append(None if name == _NAMELESS else name)
    are_usable = all(map(_is_usable, cards))
    are_from_files = all(_CARD_LABEL.fullmatch(str(label)) for label in labels)
    if not (labels and are_usable and are_from_files):
        return {}
    if len(set(cards)) < len(cards):
        return {}
    return {str(label): str(name) for label, name in zip(labels, cards, strict=True)}


def _is_usable(name: Any) -> bool:
    """Return whether the name of a card can be part of the name of a case."""
    return isinstance(name, str) and 0 < len(name) <= _LONGEST and SEPARATOR not in name


def with_case_names(tables: Tables) -> Tables:
    """Return the results with the names of the cases as their labels."""
    names = case_names(tables)
    if names == tables.labels:
        return tables
    return tables.with_frames(cases=tables.cases.assign(label=tables.cases.case.map(names)))
