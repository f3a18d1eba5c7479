"""Shares of runs by the decisions of tests for faults."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from lvnav_trade.results.evaluate import evaluate

CASE = "aaaaaaaaaaaa"
COLUMNS = ["case", "run_number", "t_s", "isolated_element", "channel"]


@pytest.mark.parametrize(("metric", "share"), [("detection_rate", 2 / 200), ("false_alarm_rate", 2 / 200)])
def test_a_rate_is_the_share_of_runs_that_decide_in_a_phase(good, metric, share):
    decided = pd.DataFrame(
        [(CASE, run, t, "clock", "") for run, t in ((4, 41.0), (9, 50.0), (11, 3.0))], columns=COLUMNS
    )
    none = pd.DataFrame([], columns=COLUMNS)
    tables = good.with_frames(integrity=decided, nominal_integrity=none)
    found = evaluate(tables, CASE, {"metric": metric, "during": "stage1_cutoff to injection"}, "-")
    assert (found.monte_carlo, found.true) == (pytest.approx(share), 0.0)
    assert np.flatnonzero(found.runs).tolist() == [4, 9]
    assert found.is_share


def test_without_runs_there_is_none(alone):
    found = evaluate(alone, CASE, {"metric": "detection_rate", "during": "flight"}, "-")
    assert found.remark == "no runs"
