"""Records of campaign, trajectory and log functions that show themselves in a notebook."""

from __future__ import annotations

import math

import pandas as pd

from lvnav_trade.api.display import Displayed, Shown
from lvnav_trade.campaign import recorded, unit_card
from lvnav_trade.campaign.reading import exporting, starting
from lvnav_trade.campaign.running import status


class CampaignStatus(status.Status, Displayed):
    """Progress of a campaign: state, runs required, stored and failed, cases, damaged files, lost work items."""

    def _shown(self) -> Shown:
        cases = pd.DataFrame([case._asdict() for case in self.cases])
        counted = f"{self.stored} of {self.asked} runs are stored, {self.failed} failed"
        return Shown(f"{self.folder}: {self.state}", (counted, *self.damaged, *self.lost), {"Cases": cases})


class ExportedTrajectory(exporting.Written, Displayed):
    """A flight as a file: `file`, `card`, times (s) of the `events`, largest `difference` of the export (SI)."""

    def _shown(self) -> Shown:
        events = pd.DataFrame(list(self.events.items()), columns=["event", "t_s"])
        difference = pd.DataFrame(list(self.difference.items()), columns=["quantity", "difference_si"])
        lines = (f"rows: {self.file}", f"card: {self.card}")
        return Shown("Exported flight", lines, {"Events": events, "Largest difference when flown": difference})


class StartedCampaign(starting.Started, Displayed):
    """A first campaign: `campaign`, `card`, `guesses` with their reasons, `events`."""

    def _shown(self) -> Shown:
        rows = [[one.part, str(one.content), one.why] for one in self.guesses]
        lines = (f"campaign: {self.campaign}", f"card: {self.card}")
        return Shown("First campaign", lines, {"Guesses": pd.DataFrame(rows, columns=["part", "guess", "why"])})


class FittedImu(unit_card.FittedUnit, Displayed):
    """What a log of an IMU at rest shows: `coefficients` with intervals (SI), Allan deviations `curves`, `text`."""

    def _shown(self) -> Shown:
        return Shown("IMU", (f"{self.seconds:.0f} s at {self.rate:g} Hz",), {"Coefficients, SI": self.coefficients})


class ProcessedLog(recorded.Processed, Displayed):
    """A log through the filters of a campaign: `alignment`, `track`, `outages`, `summary`, `notes`."""

    def _shown(self) -> Shown:
        heading = f"heading after the rest: {math.degrees(self.alignment.heading) % 360.0:.1f} deg"
        return Shown(self.card.name, (heading, *self.notes), {"Outages": self.summary})
