"""Rows of a history that a number is of, and the same number of every run."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.results.statistics.per_run import per_run, run_values, select_times, signed_run_errors
from lvnav_trade.results.statistics.select import history_of
from lvnav_trade.results.tables.read import load
from tests import synthetic

CASE = "aaaaaaaaaaaa"
NORTH = {"metric": "velocity_error_north"}


@pytest.fixture(scope="module")
def good(tmp_path_factory):
    return load(synthetic.results(tmp_path_factory.mktemp("per_run"), failing=(3,)))


def test_an_event_is_one_row_and_a_phase_those_between_its_ends(good):
    rows = history_of(good, CASE, "velocity", "north")
    assert len(select_times(good, CASE, rows, {"at": "injection"})) == 1
    phase = select_times(good, CASE, rows, {"during": "liftoff to injection"})
    assert (phase.t_s.min(), phase.t_s.max()) == (0.0, 99.5)
    assert select_times(good, CASE, rows, {"at": "touchdown"}).empty


def test_errors_of_runs_have_their_sign_and_sizes_have_none(good):
    errors = signed_run_errors(good, CASE, NORTH, "m/s")
    np.testing.assert_array_equal(np.abs(errors), run_values(good, CASE, NORTH, "m/s"))
    assert (errors < 0.0).any()
    assert np.flatnonzero(np.isinf(errors)).tolist() == [3]
    assert not len(signed_run_errors(good, CASE, NORTH | {"during": "flight"}, "m/s"))


def test_a_phase_between_events_has_a_number_of_every_run_and_another_has_none(good):
    column = "velocity_north_error_m_per_s"
    assert len(per_run(good, CASE, {"during": "liftoff to injection"}, column)) == 200
    assert not len(per_run(good, CASE, {"during": "liftoff + 1 s to injection"}, column))
