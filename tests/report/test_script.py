"""A script that adds nothing, and rows of published numbers with what a script adds."""

from __future__ import annotations

from typing import Any

import pandas as pd

from lvnav_trade.campaign.reading.study_card import CampaignFigure, StudyCampaign, StudySection
from lvnav_trade.report.script import StudyFigure, StudyScript, published_rows
from lvnav_trade.results.tables.read import load
from tests import synthetic

NUMBER = {"source": "A paper", "metric": "velocity_error_3d", "at": "injection", "value": 1.0, "unit": "m/s"}


class Adding(StudyScript):
    """One published number, and one row of another kind."""

    def references(self, campaign: str) -> list[dict[str, Any]]:
        """Return a number of one campaign."""
        return [NUMBER | {"case": {"imu": "fine"}}] if campaign == "synthetic" else []

    def rows(self, campaign: str, tables: Any) -> list[dict[str, Any]]:
        """Return a row."""
        return [{"id": "mine", "case": campaign}]


def test_a_script_adds_numbers_behind_those_of_the_campaign_and_then_its_rows(tmp_path):
    tables = load(synthetic.results(tmp_path, n_run=40))
    alone = published_rows("synthetic", tables, tables.campaign, StudyScript(tmp_path))
    more = published_rows("synthetic", tables, tables.campaign, Adding(tmp_path))
    assert [row["id"] for row in alone] == ["synthetic references 1", "synthetic references 2"]
    assert [row["id"] for row in more] == [*(row["id"] for row in alone), "synthetic references 3", "mine"]
    assert not StudyScript(tmp_path).is_statement(pd.DataFrame(alone)).any()


def test_a_figure_of_a_script_says_what_is_wrong_with_its_entry():
    def faults(figure, question):
        yield "settings", f"{figure.plot} needs settings"

    script = StudyScript("nowhere", {"mine": StudyFigure(lambda one, figure: None, faults=faults)})
    part = StudyCampaign(campaign="a", figures=(CampaignFigure(plot="errors"), CampaignFigure(plot="mine")))
    (wrong,) = script.mistakes([StudySection(part, None, path="campaigns.0")])  # type: ignore[arg-type]
    assert (wrong.path, wrong.message) == ("campaigns.0.figures.1.settings", "mine needs settings")
