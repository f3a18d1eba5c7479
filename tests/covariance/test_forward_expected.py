"""What linear covariance expects of a filter."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import norm

from lvnav_trade.covariance.forward import expected_nees, false_rejection


def test_a_matched_filter_has_as_much_as_it_has_states_and_one_that_assumes_half_four_times_that() -> None:
    rng = np.random.default_rng(4)
    root = rng.standard_normal((3, 5, 5)) * 10.0 ** np.arange(-5.0, 5.0, 2.0)[:, None]
    covariance = root @ np.swapaxes(root, 1, 2)
    np.testing.assert_allclose(expected_nees(covariance, covariance), 5.0, rtol=1e-6)
    np.testing.assert_allclose(expected_nees(0.25 * covariance, covariance), 20.0, rtol=1e-6)


def test_a_filter_that_is_certain_of_a_state_has_none() -> None:
    formal = np.diag([1.0, 0.0])[None]
    assert np.isnan(expected_nees(formal, np.eye(2)[None])).all()


def test_a_gate_rejects_what_is_beyond_it_of_the_worst_row() -> None:
    ratio = np.array([[1.0, 4.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    expected = [2.0 * norm.sf(3.0 / 2.0), 2.0 * norm.sf(3.0), 0.0]
    assert false_rejection(9.0, ratio) == pytest.approx(expected)
    assert not false_rejection(np.inf, ratio).any()
