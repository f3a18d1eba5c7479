"""How many runs lie within three sigmas: counted against what was put in, with its interval."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.metrics.basics.intervals import success_bounds
from lvnav_trade.metrics.errors.coverage import GAUSSIAN, SIGMAS, coverage
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
