"""Measurements of a case: a receiver that solves for its position itself, and what it reports."""

from __future__ import annotations

import numpy as np

from tests.building import LOOSE, loaded, prepare_hop, with_fields

POINT = {"kind": "bancroft", "range_sigma": "2 m", "rate_sigma": "0.1 m/s"}


def test_a_receiver_that_solves_for_itself_goes_on_where_its_solution_is_left_out():
    scenario = loaded(LOOSE)
    solving = with_fields(scenario, **{"receiver.solution": POINT})
    faults = [{"kind": "invalid_output", "start": "12 s", "duration": "3 s"}]
    plain, watching = (
        prepare_hop(with_fields(solving, **{"filter.logic": logic, "faults": faults})) for logic in (None, {})
    )
    np.testing.assert_array_equal(watching.signals.n_used, plain.signals.n_used)
    np.testing.assert_array_equal(watching.chain.has_solution, plain.chain.has_solution)
    left = plain.t_epoch[plain.chain.has_solution & ~watching.options.rules.is_good]
    assert left.tolist() == [12.0, 13.0, 14.0]


def test_the_filter_takes_the_variances_that_the_receiver_reports_scaled_as_its_tuning_says():
    solving = with_fields(loaded(LOOSE), **{"receiver.solution": POINT})
    plain, tuned = (
        prepare_hop(with_fields(solving, **{"filter.underweighting": cards})) for cards in ([], [{"noise_factor": 4.0}])
    )
    for one in (plain, tuned):
        np.testing.assert_array_equal(
            one.signals.variance[:, :6], np.diagonal(one.chain.reported_covariance, axis1=1, axis2=2)
        )
    np.testing.assert_allclose(tuned.chain.reported_covariance, 4.0 * plain.chain.reported_covariance, rtol=1e-14)
