"""Figures of chosen cases show those, and the numbers of the tables."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.plots.case_errors import autocorrelations, errors, relative
from tests import synthetic


@pytest.fixture(scope="module")
def tables(tmp_path_factory):
    from lvnav_trade.store import load

    return load(synthetic.results(tmp_path_factory.mktemp("chosen"), n_run=40))


def test_errors_are_those_of_the_cases_and_the_phase_that_are_asked_for(tables):
    ax = errors(tables, "velocity", [{"imu": "coarse"}], "north", "liftoff to stage1_cutoff").axes[0]
    runs, expected = ax.get_lines()[:2]
    assert runs.get_label() == "imu=coarse"
    history = tables.history
    rows = history[(history.case == "bbbbbbbbbbbb") & (history.quantity == "velocity") & (history.axis == "north")]
    rows = rows[rows.t_s.between(0.0, 40.0)]
    np.testing.assert_allclose(runs.get_ydata(), rows.rms_si)
    np.testing.assert_allclose(expected.get_ydata(), rows.lincov_true_si)
    assert "velocity error, north RMS" in ax.get_ylabel()


def test_all_cases_are_drawn_where_none_is_chosen(tables):
    labels = [line.get_label() for line in errors(tables, "position").axes[0].get_lines()]
    assert {"imu=fine", "imu=coarse"} <= set(labels)


def test_every_case_has_a_panel_with_a_line_per_channel(tables):
    figure = autocorrelations(tables, [{"imu": "fine"}], "rate")
    panel = next(ax for ax in figure.axes if ax.get_title() == "imu=fine")
    assert len(panel.get_lines()) == synthetic.N_SAT
    assert list(panel.get_lines()[0].get_xdata()) == list(range(1, 11))


def test_relative_errors_are_over_those_of_the_first_case(tables):
    ax = relative(tables, "velocity", [{"imu": "fine"}, {"imu": "coarse"}], "north", "liftoff to stage1_cutoff").axes[0]
    lines = {line.get_label(): line for line in ax.get_lines()}
    history = tables.history
    rows = history[(history.quantity == "velocity") & (history.axis == "north") & history.t_s.between(0.0, 40.0)]
    fine, coarse = (rows[rows.case == case] for case in ("aaaaaaaaaaaa", "bbbbbbbbbbbb"))
    over = lines["imu=coarse"].get_ydata()
    np.testing.assert_allclose(over, coarse.rms_si.to_numpy() / fine.rms_si.to_numpy())
    own = lines["dots: filter's own sigma over its true error"].get_ydata()
    np.testing.assert_allclose(own, fine.lincov_formal_si / np.hypot(fine.lincov_true_si, fine.lincov_mean_si))
