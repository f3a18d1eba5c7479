"""Values of metrics by the name that a statement gives."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.results.evaluate import difference, errors_at, evaluate, evaluate_single, name_of

CASE, OTHER, PHASE = "aaaaaaaaaaaa", "bbbbbbbbbbbb", "liftoff to injection"


def test_a_statement_is_named_by_statistic_metric_and_place():
    assert name_of({"metric": "velocity_error_3d"}) == "velocity_error_3d at injection"
    assert (
        name_of({"metric": "position_error_x", "during": PHASE, "statistic": "worst"})
        == "worst position_error_x, liftoff to injection"
    )


def test_a_single_number_is_that_of_the_runs_or_else_the_true_one(good, alone):
    stated = {"metric": "velocity_error_north", "at": "injection"}
    three = evaluate(good, CASE, stated, "m/s")
    assert evaluate_single(good, CASE, stated, "m/s").value == three.monte_carlo
    three = evaluate(alone, CASE, stated, "m/s")
    assert np.isnan(three.monte_carlo)
    assert evaluate_single(alone, CASE, stated, "m/s").value == three.true


def test_the_difference_of_errors_three_times_as_large_is_twice_the_smaller(good):
    stated = {"metric": "velocity_error_north", "at": "injection"}
    found, own = difference(good, OTHER, CASE, stated, "-"), evaluate(good, CASE, stated, "-")
    assert found.monte_carlo == pytest.approx(2.0 * own.monte_carlo, rel=1e-9)
    assert difference(good, OTHER, CASE, stated, "m").remark == "unit m does not fit"


def test_a_metric_that_no_run_has_has_no_errors(good):
    assert errors_at(good, CASE, "injection", "satellites_tracked") is None
    assert errors_at(good, CASE, "touchdown", "velocity_error_3d").magnitude.size == 0
