"""The page that answers the campaign's question: self-contained HTML, its Markdown twin, CSV tables."""

from lvnav_trade.report.build import SECTIONS, build, keep

__all__ = ["SECTIONS", "build", "keep"]
