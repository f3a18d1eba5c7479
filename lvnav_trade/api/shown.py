"""Records that campaign, trajectory and log functions return, with their display in a notebook."""

from __future__ import annotations

import math

import pandas as pd

from lvnav_trade.api.display import Displayed, Shown
from lvnav_trade.campaign import recorded, unit_card
from lvnav_trade.campaign.reading import exporting, starting
from lvnav_trade.campaign.running import status


class CampaignStatus(status.Status, Displayed):
    """Progress of a campaign: its state, the runs required, stored and failed, damaged files, lost work items."""

    def _shown(self) -> Shown:
        cases = pd.DataFrame([case._asdict() for case in self.cases])
        counted = f"{self.stored} of {self.asked} runs are stored, {self.failed} failed"
        return Shown(f"{self.folder}: {self.state}", (counted, *self.damaged, *self.lost), {"Cases": cases})


class ExportedTrajectory(exporting.Written, Displayed):
    """An exported trajectory: `file`, `card`, times (s) of its `events`, largest `difference` of the export (SI)."""

    def _shown(self) -> Shown:
        events = pd.DataFrame(list(self.events.items()), columns=["event", "t_s"])
        difference = pd.DataFrame(list(self.difference.items()), columns=["quantity", "difference_si"])
        lines = (f"rows: {self.file}", f"card: {self.card}")
        return Shown("Exported flight", lines, {"Events": events, "Largest difference when flown": difference})


class StartedCampaign(starting.Started, Displayed):
    """A first campaign: `campaign`, `card`, `guesses` with their reasons, `events`."""

    def _shown(self) -> Shown:
        rows = [[guess.part, str(guess.content), guess.why] for guess in self.guesses]
        lines = (f"campaign: {self.campaign}", f"card: {self.card}")
        return Shown("First campaign", lines, {"Guesses": pd.DataFrame(rows, columns=["part", "guess", "why"])})


class FittedImu(unit_card.FittedUnit, Displayed):
    """Error model of an IMU from its log at rest.

    It has the `coefficients` with their intervals, the Allan deviations `curves` (SI), and the `text` of the card.
    """

    def _shown(self) -> Shown:
        return Shown("IMU", (f"{self.seconds:.0f} s at {self.rate:g} Hz",), {"Coefficients": self.coefficients})


class ProcessedLog(recorded.Processed, Displayed):
    """A log processed by the filters of a campaign: `alignment`, `track`, `outages`, `summary`, `notes`."""

    def _shown(self) -> Shown:
        heading = f"heading after the rest: {math.degrees(self.alignment.heading) % 360.0:.1f} deg"
        return Shown(self.card.name, (heading, *self.notes), {"Outages": self.summary})
