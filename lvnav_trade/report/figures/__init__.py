"""FAMILY 5: results -> figure. Each takes a results folder (or its tables), most of them a case or a quantity too."""

from lvnav_trade.report.figures import (
    budget,
    curves,
    errors,
    inertial,
    injection,
    integrity,
    limits,
    mission,
    protection,
    published,
    search,
    signals,
    space,
    validity,
    vehicle,
)
from lvnav_trade.report.figures.style import PLOTS

__all__ = [
    "PLOTS",
    "budget",
    "curves",
    "errors",
    "inertial",
    "injection",
    "integrity",
    "limits",
    "mission",
    "protection",
    "published",
    "search",
    "signals",
    "space",
    "validity",
    "vehicle",
]
