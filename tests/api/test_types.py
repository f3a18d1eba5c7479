"""Records that public functions return: attributes, and what a notebook shows of them."""

from __future__ import annotations

from pathlib import Path

import pandas as pd

from lvnav_trade import api
from lvnav_trade.campaign.running.selfcheck import CombinedCheck
from lvnav_trade.covariance.selfcheck.check import CheckResult


def test_a_checked_campaign_has_its_cases_and_remarks():
    found = api.check("smoke")
    assert [case.label for case in found.cases] == ["base"]
    assert found.campaign.name == "smoke"
    assert all(isinstance(line, str) for line in found.notes + found.warnings + found.beyond_limits)
    assert "smoke: valid" in found._repr_html_()
    noted = api.CheckedCampaign(found.campaign, found.cases, notes=("one",))
    assert noted.remarks == {"notes": ["one"]}


def test_a_plan_is_a_table_with_its_cost(tmp_path):
    found = api.plan("smoke", ["monte_carlo.runs=80"], tmp_path)
    assert found.cases.to_dict("records")[0] | {"id": ""} == {"id": "", "label": "base", "runs": 80, "done": 0}
    assert found.seconds > 0.0
    assert f"about {found.seconds:.0f} s of one core" in str(found)


def test_a_selfcheck_counts_its_verdicts():
    checks = [CheckResult("gate", "innovations", 0.5, 0.0, 1.0), CheckResult("gate", "innovations", 2.0, 0.0, 1.0)]
    found = api.SelfCheck(tuple(CombinedCheck(one, ("a", "b")) for one in checks))
    assert (found.passed, found.count("passed"), found.count("failed")) == (False, 1, 1)
    assert list(found.frame.case) == ["all", "all"]
    assert "1 passed, 1 failed" in str(found)


def test_searches_and_replays_show_their_tables():
    frame, page = pd.DataFrame({"n": [4711]}), Path("page.html")
    for one in (
        api.Solution(frame, frame, 1.0, page),
        api.Sensitivity(frame, "base", "velocity", 1.0, 8, "", 1.0, page),
        api.Tuning(frame, frame, None, Path("filter.yaml"), 3, 1.0, page),
        api.ReplayedRun("id", "base", 3, "diverged", frame, frame, page),
    ):
        assert "4711" in one._repr_html_()
        assert "page.html" in str(one)
