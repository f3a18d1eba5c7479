"""Additions of a script to the report of a study: paragraphs, tables and figures of a `StudyScript`."""

from lvnav_trade.api.studies import load_script, recount, renew
from lvnav_trade.campaign.reading.study_card import CampaignFigure as FigureEntry
from lvnav_trade.campaign.reading.study_card import StudyCampaign, StudySection
from lvnav_trade.report.blocks import Block, Picture, Text, formatted_columns, number, table, words
from lvnav_trade.report.printed import short_cases
from lvnav_trade.report.script import StudyFigure, StudyResult, StudyScript, published_rows

__all__ = [
    "Block",
    "FigureEntry",
    "Picture",
    "StudyCampaign",
    "StudyFigure",
    "StudyResult",
    "StudyScript",
    "StudySection",
    "Text",
    "formatted_columns",
    "load_script",
    "number",
    "published_rows",
    "recount",
    "renew",
    "short_cases",
    "table",
    "words",
]
