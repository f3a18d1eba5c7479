"""Figures of results, as data. Each takes a results folder (or its tables), most of them a case or a quantity too."""

from lvnav_trade.report.figures import (
    budget,
    curves,
    error_histories,
    integrity,
    limits,
    mission,
    published,
    signals,
    space,
    vehicle_motion,
)
from lvnav_trade.report.figures.style import PLOTS

__all__ = [
    "PLOTS",
    "budget",
    "curves",
    "error_histories",
    "integrity",
    "limits",
    "mission",
    "published",
    "signals",
    "space",
    "vehicle_motion",
]
