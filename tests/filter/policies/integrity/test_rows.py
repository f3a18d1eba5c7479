"""What rows are tested with: the variance that the filter assumes of them, and windows of its own epochs."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import pytest

from lvnav_trade.filter.policies.integrity.assess import _test_rows
from lvnav_trade.filter.policies.integrity.state import new_monitor
from lvnav_trade.filter.policies.policy_cards import IntegrityCard, build_fault_tests
from lvnav_trade.filter.updates import noise_variance


class Work(NamedTuple):
    x: np.ndarray
    reported_covariance: np.ndarray


class Points(NamedTuple):
    residual_variance: np.ndarray


class Gains(NamedTuple):
    gain: np.ndarray


class Signals(NamedTuple):
    variance: np.ndarray
    satellite_by_slot: np.ndarray


class Model(NamedTuple):
    decimation: int
    tight: bool
    n_observable: int
    is_processed: np.ndarray
    n_entry: np.ndarray
    entry: np.ndarray
    column: np.ndarray


class Whitening(NamedTuple):
    has_reported_covariance: bool
    n_receiver: int = 2


class Options(NamedTuple):
    gains: Any = None
    fault_tests: Any = None
    differences: Any = None


class Case(NamedTuple):
    model: Any
    signals: Signals
    options: Options


SIGNALS = Signals(np.array([[4.0, 9.0]]), np.zeros((1, 1), dtype=np.int64))


@pytest.mark.parametrize(
    ("sigma_points", "gains", "whitened", "variance"),
    [
        (None, None, False, 9.0),
        (Points(np.array([0.0, 0.5])), None, False, 9.5),
        (Points(np.array([0.0, 0.5])), None, True, 1.0),  # what points leave is in the covariance of the solution
        (None, Gains(np.zeros((1, 2, 2))), True, 16.0),
        (None, Gains(np.zeros((1, 2, 2))), False, 9.0),
    ],
)
def test_a_row_has_the_variance_that_its_update_assumes(sigma_points, gains, whitened, variance):
    work = Work(np.zeros(2), np.diag([25.0, 16.0]))
    case = Case(Whitening(whitened), SIGNALS, Options(gains=gains))
    assert noise_variance(work, sigma_points, case, 0, 1, 1) == variance


def test_a_window_is_of_the_epochs_at_which_the_filter_measures():
    model = Model(2, False, 1, np.ones(2, dtype=np.bool_), np.ones(2, dtype=np.int64), np.zeros((2, 1), dtype=np.int64),
                  np.zeros((2, 1), dtype=np.int64))  # fmt: skip
    own, tests = new_monitor(20, 2, 2, 4), build_fault_tests(IntegrityCard(window=4), 10, 5, 2.0)
    own.variance[...], own.z[:] = 3.0, [2.0, 4.0]
    case = Case(model, SIGNALS, Options(fault_tests=tests))
    for epoch in range(1, 20, 2):
        _test_rows(own, np.eye(1), np.ones((2, 1)), case, epoch, 2)
    np.testing.assert_allclose(own.recent_squares, np.outer([1.0, 4.0], np.ones(4)))
