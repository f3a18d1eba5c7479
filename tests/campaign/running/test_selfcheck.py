"""The self-check of a campaign: every case once, what several have in common once, bounds for all of it together."""

from __future__ import annotations

import pytest
from scipy import stats

from lvnav_trade.campaign.reading.load import load
from lvnav_trade.campaign.running import selfcheck
from lvnav_trade.campaign.running.progress import Progress
from lvnav_trade.covariance.selfcheck.check import FAMILY, CheckResult

AXES = "axes=[{path: filter, cards: [filters/loose, filters/tight]}]"


class Watch(Progress):
    """What a run of checks reports."""

    def __init__(self):
        self.heard = []

    def stage(self, name, total, is_uniform=True):
        self.heard.append((name, total))

    def advance(self, count):
        self.heard.append(count)


@pytest.fixture
def checked(monkeypatch):
    def fake(scenario, seed, history):
        own = 0.25 if scenario.filter.tight else 0.5
        return [
            CheckResult("draws", "shared", 0.1 * seed, distribution=stats.norm()),
            CheckResult("Jacobian", "own", own, upper_limit=0.3),
        ]

    monkeypatch.setattr(selfcheck, "check_scenario", fake)
    watch = Watch()
    return selfcheck.selfcheck(load("campaigns/smoke.yaml", [AXES]), jobs=1, progress=watch), watch


def test_what_cases_have_in_common_is_said_once_and_each_case_is_counted(checked):
    found, watch = checked
    loose, tight = "filter=loose", "filter=tight"
    assert [(one.check.quantity, one.cases, one.check.verdict) for one in found] == [
        ("shared", (loose, tight), "passed"), ("own", (loose,), "failed"), ("own", (tight,), "passed"),
    ]  # fmt: skip
    assert watch.heard == [("self-check", 2), 1, 1]


def test_the_bounds_of_a_statistic_are_those_of_all_statistics_together(checked):
    (shared, *others), _ = checked
    assert shared.check.upper_limit == pytest.approx(stats.norm.isf(FAMILY / 2.0))
    assert {one.check.upper_limit for one in others} == {0.3}
