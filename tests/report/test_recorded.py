"""The page of a recorded log says what the filters of a campaign make of it, and where they fall short."""

from __future__ import annotations

import numpy as np
import pandas as pd

from lvnav_trade.campaign.reading.load import load
from lvnav_trade.campaign.recorded_log import FilteredLog, failures, outage_summary
from lvnav_trade.report.build import html_page, markdown_page
from lvnav_trade.report.recorded import page
from lvnav_trade.simulation.recorded.alignment import Alignment
from lvnav_trade.simulation.recorded.navigation_log import NavigationLog


def processed(inside: bool = True, square: float = 1.0, heading: str | None = None) -> FilteredLog:
    card = NavigationLog.model_validate(
        {"name": "a drive", "source": "simulated", "epoch": "2026-01-01T00:00:00Z", "imu": {"file": "i"},
         "gnss": {"file": "g"}, "still": ["0 s", "9 s"], "heading": heading}
    )  # fmt: skip
    rows = pd.DataFrame(
        {"case": "base", "length_s": 15.0, "begin_s": [20.0, 25.0], "end_s": [35.0, 40.0], "position_error_m": 2.0,
         "position_3sigma_m": 4.0, "velocity_error_m_per_s": 0.1, "velocity_3sigma_m_per_s": 0.3, "nees_ratio": square,
         "inside": inside, "failed": False}
    )  # fmt: skip
    aligned = Alignment(9.0, np.eye(3), np.radians([0.1, 0.0, -0.2]), np.radians(-90.0), np.radians(0.5))
    return FilteredLog(card, aligned, pd.DataFrame(), rows, outage_summary(rows), ("2 of 9 solutions are left out",))


def said(done: FilteredLog) -> str:
    return " ".join(markdown_page(*page(done, load("campaigns/smoke.yaml"))).split())


def test_alignment_and_outages_stand_on_the_page():
    text = said(processed())
    assert "270.0 deg (from the motion, one sigma 0.5 deg); removed from the rates: 0.1, 0, -0.2 deg/s" in text
    assert "2.00" in text
    assert "figures/outages.png" in text
    assert "assumes" not in text.partition("Outages by case")[2]
    assert "(stated)" in said(processed(heading="1 rad"))
    assert "uPlot" in html_page(*page(processed(), load("campaigns/smoke.yaml")))


def test_a_filter_that_assumes_too_little_or_too_much_is_named():
    assert "base, 15 s: 0 % inside three sigma, fewer than 95 %: the filter assumes too little" in said(
        processed(False)
    )
    assert "a mean NEES of 0.10, below 0.3: the filter assumes more error than there is" in said(processed(square=0.1))


def test_what_is_left_out_is_on_the_page():
    assert "2 of 9 solutions are left out." in said(processed())


def test_outages_that_fail_are_counted_and_the_rest_is_no_verdict():
    rows = processed().outages
    rows.loc[1, ["failed", "inside"]] = [True, False]
    rows.loc[1, ["nees_ratio", "position_error_m", "velocity_error_m_per_s"]] = np.nan
    summary = outage_summary(rows)
    assert summary[["outages", "failed", "inside_percent"]].to_numpy().tolist() == [[2, 1, 50.0]]
    assert summary.position_rms_m[0] == 2.0
    (note,) = failures(summary)
    assert note.startswith("base, 15 s: 1 of 2 outages fail")
    assert note.endswith("NEES, RMS and worst are of the other 1")
    text = said(processed()._replace(outages=rows, summary=summary, notes=(note,)))
    assert "1 of 2 outages fail" in text
    assert "the filter assumes" not in text
    (note,) = failures(outage_summary(rows.iloc[1:]))
    assert "1 of 1 outages fail (the estimate is not finite, or beyond the case's limit)" in note
    assert note.endswith("there is no NEES, RMS or worst")
