"""What is reported of filters with a logic, of runs whose story is known."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.metrics import METRICS
from lvnav_trade.metrics.errors.covariances import reach
from lvnav_trade.store import load
from tests import synthetic

RUNS = 40


@pytest.fixture(scope="module")
def watched(tmp_path_factory):
    return load(synthetic.results(tmp_path_factory.mktemp("watched"), n_run=RUNS, size=16, logic=True))


def test_every_kind_of_change_is_counted_with_its_reason(watched):
    found = METRICS["logic"](watched)
    mine = found[found.case == "imu=fine"].set_index(["from_mode", "to_mode", "reason"])
    start, lost = (
        mine.loc["waiting", "converging", "good samples in a row"],
        mine.loc["aiding", "predicting", "data lost"],
    )
    assert (start.change_count, start.run_count, start.run_ratio, start.first_s) == (RUNS, RUNS, 1.0, 5.0)
    assert (lost.change_count, lost.run_ratio, lost.median_s) == (RUNS // 4, 0.25, 60.0)
    assert mine.loc["predicting", "stopped", "data loss persists"].change_count == RUNS // 4
    assert len(mine) == 5


def test_the_modes_of_all_runs_add_up_at_every_time(watched):
    modes = METRICS["modes"](watched)
    mine = modes[modes.case == "imu=coarse"].pivot(index="t_s", columns="mode", values="run_ratio")
    np.testing.assert_allclose(mine.sum(axis=1), 1.0)
    at = mine.loc[mine.index[np.searchsorted(mine.index, [0.0, 15.0, 40.0, 65.0, 75.0, 90.0])]]
    assert at.waiting.tolist() == [1.0, 0.0, 0.0, 0.0, 0.0, 0.0]
    assert at.aiding.tolist() == [0.0, 0.0, 1.0, 0.75, 0.75, 0.75]
    assert at.predicting.tolist() == [0.0, 0.0, 0.0, 0.25, 0.0, 0.0]
    assert at.stopped.tolist() == [0.0, 0.0, 0.0, 0.0, 0.25, 0.0]


def test_stops_and_restarts_are_counted_and_who_corrects_at_the_end(watched):
    row = METRICS["stops"](watched).set_index("case").loc["imu=fine"]
    assert (row.started_ratio, row.corrected_ratio, row.ended_ratio) == (1.0, 1.0, 0.75)
    assert (row.stop_count, row.restart_count) == (RUNS // 4, RUNS // 4)


def test_filters_without_a_logic_have_none_of_it(good):
    assert METRICS["logic"](good).empty
    assert METRICS["modes"](good).empty
    assert METRICS["stops"](good).empty


def test_linear_covariance_is_not_held_against_a_filter_with_a_logic(watched, good):
    case = watched.cases.case[0]
    assert not reach(watched, case).applies
    assert "logic of its own" in reach(watched, case).reason
    assert reach(good, good.cases.case[0]).applies
    assert set(METRICS["agreement"](watched).agree) == {"not applicable"}
