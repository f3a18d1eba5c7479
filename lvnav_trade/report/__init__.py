"""The report of a campaign: self-contained HTML, the same as Markdown, CSV tables. Read `build.py` first."""

from lvnav_trade.report.build import SECTIONS, build, keep, verdict_tables

__all__ = ["SECTIONS", "build", "keep", "verdict_tables"]
