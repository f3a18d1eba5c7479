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


class Displayed:
    """Base of results that a notebook and `print` display; a subclass returns the content from `_shown`."""

    def _shown(self) -> DisplayContent:
        raise NotImplementedError

    def _repr_html_(self) -> str:
        return html_of(self._shown())

    def __str__(self) -> str:
        return text_of(self._shown())


def html_of(shown: DisplayContent) -> str:
    """Return the content as HTML.

    Parameters
    ----------
    shown : DisplayContent
        Content to display.

    Returns
    -------
    str
        HTML. Texts are escaped, because names that a user chose may contain markup.
    """
    parts = [f"<h4>{html.escape(shown.title)}</h4>"] if shown.title else []
    parts += [f"<p>{html.escape(line)}</p>" for line in shown.lines]
    for caption, frame in shown.tables.items():
        parts.append(f"<p><b>{html.escape(caption)}</b></p>" if caption else "")
        parts.append(frame.head(MOST_ROWS).to_html(index=False, border=0, na_rep="", float_format=_short))
        parts += [f"<p>{more}</p>" for more in _more(frame)]
    return "\n".join(part for part in parts if part)


def text_of(shown: DisplayContent) -> str:
    """Return the content as plain text.

    Parameters
    ----------
    shown : DisplayContent
        Content to display.

    Returns
    -------
    str
        Lines with the title, the paragraphs and the tables.
    """
    lines = [shown.title, *shown.lines]
    for caption, frame in shown.tables.items():
        lines.append(caption)
        lines.append(frame.head(MOST_ROWS).to_string(index=False, na_rep="", float_format=_short))
        lines += _more(frame)
    return "\n".join(line for line in lines if line)


def _short(value: float) -> str:
    return f"{value:.6g}"


def _more(frame: pd.DataFrame) -> list[str]:
    return [f"{len(frame) - MOST_ROWS} more rows"] if len(frame) > MOST_ROWS else []


class CampaignStatus(status.Status, Displayed):
    """Progress of a campaign: its state, the runs required, stored and failed, damaged files, lost work items."""

    def _shown(self) -> DisplayContent:
        cases = pd.DataFrame([case._asdict() for case in self.cases])
        counted = f"{self.stored} of {self.asked} runs are stored, {self.failed} failed"
        return DisplayContent(f"{self.folder}: {self.state}", (counted, *self.damaged, *self.lost), {"Cases": cases})


class ExportedTrajectory(exporting.WrittenTrajectory, Displayed):
    """An exported trajectory: `file`, `card`, times (s) of its `events`, largest `difference` of the export (SI)."""

    def _shown(self) -> DisplayContent:
        events = pd.DataFrame(list(self.events.items()), columns=["event", "t_s"])
        difference = pd.DataFrame(list(self.difference.items()), columns=["quantity", "difference_si"])
        lines = (f"rows: {self.file}", f"card: {self.card}")
        return DisplayContent("Exported flight", lines, {"Events": events, "Largest difference": difference})


class StartedCampaign(starting.FirstCampaign, Displayed):
    """A first campaign: `campaign`, `card`, `guesses` with their reasons, `events`."""

    def _shown(self) -> DisplayContent:
        rows = [[guess.part, str(guess.content), guess.why] for guess in self.guesses]
        lines = (f"campaign: {self.campaign}", f"card: {self.card}")
        return DisplayContent(
            "First campaign", lines, {"Guesses": pd.DataFrame(rows, columns=["part", "guess", "why"])}
        )


class FittedImu(unit_card.ImuFit, Displayed):
    """Error model of an IMU from its log at rest.

    It has the `coefficients` with their intervals, the Allan deviations `curves` (SI), and the `text` of the card.
    """

    def _shown(self) -> DisplayContent:
        return DisplayContent(
            "IMU", (f"{self.seconds:.0f} s at {self.rate:g} Hz",), {"Coefficients": self.coefficients}
        )


class ProcessedLog(recorded_log.FilteredLog, Displayed):
    """A log processed by the filters of a campaign: `alignment`, `track`, `outages`, `summary`, `notes`."""

    def _shown(self) -> DisplayContent:
        heading = f"heading after the rest: {math.degrees(self.alignment.heading) % 360.0:.1f} deg"
        return DisplayContent(self.card.name, (heading, *self.notes), {"Outages": self.summary})
