"""Records of campaign, trajectory and log functions: fields by name, tables in a notebook."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import pandas as pd

from lvnav_trade import api
from lvnav_trade.campaign.running.status import CaseStatus

FRAME = pd.DataFrame({"n": [4711]})


def test_a_status_counts_runs_and_names_what_is_damaged():
    case = CaseStatus("digest", "base", 80, 40, 1)
    found = api.CampaignStatus("results/x", "damaged", "", 80, 40, 1, (case,), ("runs.parquet: cut",), (), 0, "")
    page = found._repr_html_()
    assert "results/x: damaged" in page
    assert "40 of 80 runs are stored, 1 failed" in page
    assert "runs.parquet: cut" in page
    assert "base" in page
    assert found.stored_runs == 40


def test_an_exported_flight_shows_events_and_difference():
    found = api.ExportedTrajectory(Path("a.csv"), Path("a.yaml"), {"injection": 512.0}, {"position": 1e-6})
    assert "injection" in str(found)
    assert "1e-06" in str(found)
    assert found.card == Path("a.yaml")


def test_a_first_campaign_shows_its_guesses():
    guess = SimpleNamespace(field="time", content="t_s", reason="its name")
    found = api.StartedCampaign(Path("a.yaml"), Path("card.yaml"), (guess,), {})
    assert "its name" in found._repr_html_()


def test_logs_show_their_tables():
    alignment, card = SimpleNamespace(heading=-0.5), SimpleNamespace(name="Walk")
    log = api.ProcessedLog(card, alignment, FRAME, FRAME, FRAME, ("a note",))
    assert "331.4 deg" in str(log)
    assert "a note" in log._repr_html_()
    imu = api.FittedImu({}, 3600.0, 200.0, "text", FRAME, FRAME)
    assert "3600 s at 200 Hz" in str(imu)
    assert "4711" in imu._repr_html_()
