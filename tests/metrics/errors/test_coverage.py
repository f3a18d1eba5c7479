"""Runs within three sigmas, counted against what was put in; paired differences of two levels."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.metrics.basics.intervals import success_bounds
from lvnav_trade.metrics.errors.coverage import GAUSSIAN, SIGMAS, coverage, paired_levels
from lvnav_trade.store import load
from lvnav_trade.store.schema import error_column
from tests import synthetic

N_RUN = 200


@pytest.fixture(scope="module")
def tables(tmp_path_factory):
    return load(synthetic.results(tmp_path_factory.mktemp("coverage"), n_run=N_RUN))


def test_every_case_event_and_quantity_has_a_row_and_the_counts_are_those_of_the_runs(tables):
    frame = coverage(tables)
    assert set(frame.case) == set(tables.labels.values())
    assert set(frame.quantity) == {"attitude", "velocity", "position"}
    row = frame.iloc[-1]
    case = next(key for key, label in tables.labels.items() if label == row.case)
    runs = tables.runs[(tables.runs.case == case) & (tables.runs.event == row.event)]
    mine = tables.history[(tables.history.case == case) & (tables.history.quantity == row.quantity)]
    inside = []
    for axis in [name for name in dict.fromkeys(mine.axis) if name != "3d"]:
        series = mine[mine.axis == axis]
        sigma = series.filter_sigma_si.iloc[np.argmin(np.abs(series.t_s.to_numpy() - runs.t_s.iloc[0]))]
        error = runs[error_column(row.quantity, axis, series.unit.iloc[0])].to_numpy()
        inside.append((np.abs(error) <= SIGMAS * sigma) & (runs.failure.to_numpy() == ""))
    assert row.all_inside_ratio == pytest.approx(np.all(inside, axis=0).mean())
    assert row.inside_ratio == pytest.approx(np.mean(inside))


def test_the_interval_is_exact_and_what_is_honest_reaches_a_gaussian(tables):
    frame = coverage(tables)
    for row in frame.itertuples():
        out = round(row.run_count * (1.0 - row.all_inside_ratio))
        assert (row.low_ratio, row.high_ratio) == pytest.approx(success_bounds(row.run_count, out, 0.975))
        assert row.honest == (row.high_ratio >= GAUSSIAN**3)


def test_events_outside_the_stretch_are_left_out(tables):
    first = coverage(tables).event.iloc[0]
    assert set(coverage(tables, (first, first)).event) == {first}


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
