"""Additions of a script to the report of a study: paragraphs, tables and figures of a `StudyScript`."""

from lvnav_trade.api.studies import load_script, recount, renew
from lvnav_trade.campaign.reading.study import Figure as FigureEntry
from lvnav_trade.campaign.reading.study import Part, Question
from lvnav_trade.report.blocks import Block, Picture, Text, number, shown, table, words
from lvnav_trade.report.printed import short_cases
from lvnav_trade.report.script import Answered, StudyFigure, StudyScript, published_rows

__all__ = [
    "Answered",
    "Block",
    "FigureEntry",
    "Part",
    "Picture",
    "Question",
    "StudyFigure",
    "StudyScript",
    "Text",
    "load_script",
    "number",
    "published_rows",
    "recount",
    "renew",
    "short_cases",
    "shown",
    "table",
    "words",
]
