"""Records that show themselves in a notebook: a title, a line of text, tables; as HTML and as text."""

from __future__ import annotations

import html
import math
from collections.abc import Mapping
from typing import NamedTuple

import pandas as pd

from lvnav_trade.campaign import recorded_log, unit_card
from lvnav_trade.campaign.reading import starting
from lvnav_trade.campaign.reading import starting as exporting
from lvnav_trade.campaign.running import status

MOST_ROWS = 40
"""Largest number of rows shown of a table; the number of further rows is printed below it."""


class DisplayContent(NamedTuple):
    """Content of a displayed result."""

    title: str  # heading; none if empty
    lines: tuple[str, ...] = ()  # paragraphs below the heading
    tables: Mapping[str, pd.DataFrame] = {}  # tables by caption, in their order


class DisplayBase:
    """Base of results that a notebook and `print` display; a subclass returns the content from `_display_content`."""

    def _display_content(self) -> DisplayContent:
        raise NotImplementedError

    def _repr_html_(self) -> str:
        return html_of(self._display_content())

    def __str__(self) -> str:
        return text_of(self._display_content())


def html_of(content: DisplayContent) -> str:
    """Return the content as HTML.

    Parameters
    ----------
    content : DisplayContent
        Content to display.

    Returns
    -------
    str
        HTML. Texts are escaped, because names that a user chose may contain markup.
    """
    blocks: list[str] = []
    if content.title:
        blocks.append(f"<h4>{html.escape(content.title)}</h4>")
    blocks += [f"<p>{html.escape(line)}</p>" for line in content.lines]
    for caption, frame in content.tables.items():
        if caption:
            blocks.append(f"<p><b>{html.escape(caption)}</b></p>")
        blocks.append(frame.head(MOST_ROWS).to_html(index=False, border=0, na_rep="", float_format=_short))
        if len(frame) > MOST_ROWS:
            blocks.append(f"<p>{_more_rows(frame)}</p>")
    return "\n".join(blocks)


def text_of(content: DisplayContent) -> str:
    """Return the content as plain text.

    Parameters
    ----------
    content : DisplayContent
        Content to display.

    Returns
    -------
    str
        Lines with the title, the paragraphs and the tables.
    """
    blocks = [content.title, *content.lines]
    for caption, frame in content.tables.items():
        blocks.append(caption)
        blocks.append(frame.head(MOST_ROWS).to_string(index=False, na_rep="", float_format=_short))
        if len(frame) > MOST_ROWS:
            blocks.append(_more_rows(frame))
    return "\n".join(block for block in blocks if block)


def _short(value: float) -> str:
    return f"{value:.6g}"


def _more_rows(frame: pd.DataFrame) -> str:
    """Return the number of rows of a table that are not shown, in words."""
    return f"{len(frame) - MOST_ROWS} more rows"


class CampaignStatus(status.Status, DisplayBase):
    """Progress of a campaign: its state, the runs required, stored and failed, damaged files, lost work items."""

    def _display_content(self) -> DisplayContent:
        cases = pd.DataFrame([case._asdict() for case in self.cases])
        count_text = f"{self.stored_runs} of {self.required_runs} runs are stored, {self.failed_runs} failed"
        return DisplayContent(
            f"{self.folder}: {self.state}", (count_text, *self.damaged_files, *self.lost_items), {"Cases": cases}
        )


class ExportedTrajectory(exporting.WrittenTrajectory, DisplayBase):
    """An exported trajectory: `file`, `card`, times (s) of its `events`, largest `difference` of the export (SI)."""

    def _display_content(self) -> DisplayContent:
        events = pd.DataFrame(list(self.events.items()), columns=["event", "t_s"])
        difference = pd.DataFrame(list(self.difference.items()), columns=["quantity", "difference_si"])
        return DisplayContent(
            title="Exported flight",
            lines=(f"rows: {self.file}", f"card: {self.card}"),
            tables={"Events": events, "Largest difference": difference},
        )


class StartedCampaign(starting.FirstCampaign, DisplayBase):
    """A first campaign: `campaign`, `card`, `guesses` with their reasons, `events`."""

    def _display_content(self) -> DisplayContent:
        rows = [[guess.field, str(guess.content), guess.reason] for guess in self.guesses]
        guesses = pd.DataFrame(rows, columns=["part", "guess", "why"])
        return DisplayContent(
            title="First campaign",
            lines=(f"campaign: {self.campaign}", f"card: {self.card}"),
            tables={"Guesses": guesses},
        )


class FittedImu(unit_card.ImuFit, DisplayBase):
    """Error model of an IMU from its log at rest.

    It has the `coefficients` with their intervals, the Allan deviations `curves` (SI), and the `text` of the card.
    """

    def _display_content(self) -> DisplayContent:
        return DisplayContent(
            title="IMU",
            lines=(f"{self.seconds:.0f} s at {self.rate:g} Hz",),
            tables={"Coefficients": self.coefficients},
        )


class ProcessedLog(recorded_log.FilteredLog, DisplayBase):
    """A log processed by the filters of a campaign: `alignment`, `track`, `outages`, `summary`, `notes`."""

    def _display_content(self) -> DisplayContent:
        heading_deg = math.degrees(self.alignment.heading) % 360.0
        return DisplayContent(
            title=self.card.name,
            lines=(f"heading after the rest: {heading_deg:.1f} deg", *self.notes),
            tables={"Outages": self.summary},
        )
