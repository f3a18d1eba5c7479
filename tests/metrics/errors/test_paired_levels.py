"""Two levels on the same draws: what they have in common cancels, what differs is reported."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.metrics.errors.paired_levels import paired_levels
from lvnav_trade.store import load
from tests import synthetic


@pytest.fixture(scope="module")
def tables(tmp_path_factory):
    return load(synthetic.results(tmp_path_factory.mktemp("paired"), n_run=50))


def test_the_difference_is_that_of_the_errors_run_by_run(tables):
    frame = paired_levels(tables, "imu")
    assert set(frame.quantity) == {"attitude", "velocity", "position"}
    assert set(frame.levels) == {"fine and coarse"}
    row = frame[(frame.quantity == "velocity")].iloc[-1]
    runs, columns = tables.runs[tables.runs.event == row.event], []
    columns = [name for name in runs.columns if name.startswith("velocity_") and "_error_" in name and "3d" not in name]
    first, second = (runs[runs.case == case].sort_values("run_number")[columns].to_numpy() for case in tables.labels)
    factor = tables.people["velocity", "3d"][1]
    assert row.difference_rms == pytest.approx(factor * np.sqrt(np.mean(np.sum((second - first) ** 2, axis=1))))
    assert row.difference_ratio == pytest.approx(row.difference_rms / min(row.first_rms, row.second_rms))


def test_an_axis_that_no_case_has_gives_no_rows(tables):
    assert paired_levels(tables, "filter").empty
