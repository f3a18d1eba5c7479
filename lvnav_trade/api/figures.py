"""Building blocks of figures for scripts: panels with marks, shown in the report and saved as PNG or SVG."""

from lvnav_trade.report.figures.figure import GREY, SHADE, Figure, Panel, canvas, named_ticks, panel
from lvnav_trade.report.figures.overlap import widen_covered
from lvnav_trade.report.figures.published import level_sizes, mark_levels
from lvnav_trade.report.figures.style import PALETTE, line_of, over_time, scale_up

__all__ = [
    "GREY",
    "PALETTE",
    "SHADE",
    "Figure",
    "Panel",
    "canvas",
    "level_sizes",
    "line_of",
    "mark_levels",
    "named_ticks",
    "over_time",
    "panel",
    "scale_up",
    "widen_covered",
]
