"""The tables of runs say of every run what its history holds."""

from __future__ import annotations

import numpy as np

from lvnav_trade.results.tables.engine_tables import row_tables
from lvnav_trade.results.tables.read import load
from lvnav_trade.results.tables.run_tables import MOST_TIMES, trace_columns
from lvnav_trade.simulation.statistics import merge, summarise
from tests import synthetic


def test_every_run_has_a_row_for_each_span_with_the_largest_error_in_it(tmp_path):
    tables = load(synthetic.results(tmp_path, n_run=16, size=8))
    worst = tables.interval_errors[tables.interval_errors.case == "aaaaaaaaaaaa"]
    bounds = [(-5.0, 0.0), (0.0, 40.0), (40.0, 99.5)]
    assert list(zip(worst.t_s, worst.t_end_s, strict=True)) == bounds * 16
    assert list(worst.run_number) == [run for run in range(16) for _ in bounds]
    drawn = synthetic.block(synthetic.covariance(1.0), 0, 16)
    within = (drawn.t >= 0.0) & (drawn.t <= 40.0)
    np.testing.assert_array_equal(
        worst.velocity_north_error_m_per_s[worst.t_s == 0.0], np.abs(drawn.err[:, within, 3]).max(axis=1)
    )
    square, t = drawn.err[:, within, 3] ** 2, drawn.t[within]
    mean = (0.5 * (square[:, 1:] + square[:, :-1]) * np.diff(t)).sum(axis=1) / 40.0
    np.testing.assert_allclose(worst.velocity_north_rms_m_per_s[worst.t_s == 0.0], np.sqrt(mean), rtol=1e-12)
    at_injection = tables.runs[(tables.runs.case == "aaaaaaaaaaaa") & (tables.runs.event == "injection")]
    last = worst[worst.t_s == 40.0].position_3d_error_m.to_numpy()
    assert (last >= at_injection.position_3d_error_m.to_numpy()).all()


def test_without_runs_the_tables_have_their_columns_and_no_row():
    cov = synthetic.covariance()
    one = merge([summarise(synthetic.block(cov, 0, 8), synthetic.EVENTS, cov.true_sigma, synthetic.OUTPUTS)])
    empty, full = (row_tables("c", synthetic.OUTPUTS, summary) for summary in (None, one))
    assert {name: table.schema for name, table in empty.items()} == {name: table.schema for name, table in full.items()}
    assert {table.num_rows for table in empty.values()} == {0}


def test_a_run_over_time_has_the_sizes_of_its_errors_and_no_more_times_than_are_drawn():
    drawn = synthetic.block(synthetic.covariance(), 0, 4)
    long = np.repeat(drawn.err[:, :1], 1001, axis=1)
    many = drawn._replace(t=np.linspace(0.0, 99.5, 1001), err=long, sigma=np.ones_like(long))
    found = trace_columns(synthetic.OUTPUTS, [one._replace(first_run=k) for k, one in enumerate((drawn, many))])
    first = found["run_number"] == 0
    for quantity, at in (("attitude", 0), ("velocity", 3), ("position", 6)):
        mine = first & (found["quantity"] == quantity)
        np.testing.assert_array_equal(found["t_s"][mine], drawn.t)
        np.testing.assert_allclose(found["error_si"][mine], np.linalg.norm(drawn.err[0, :, at : at + 3], axis=1))
        np.testing.assert_allclose(found["sigma_si"][mine], np.linalg.norm(drawn.sigma[0, :, at : at + 3], axis=1))
    times = found["t_s"][~first & (found["quantity"] == "position")]
    assert 300 < times.size <= MOST_TIMES
    assert times[-1] == 99.5


def test_a_run_over_time_ends_where_it_failed():
    failed = synthetic.block(synthetic.covariance(), 0, 1, failing=(0,))
    found = trace_columns(synthetic.OUTPUTS, [failed])
    np.testing.assert_array_equal(np.isnan(found["error_si"]), found["t_s"] >= failed.t_failed[0])
