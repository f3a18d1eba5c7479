"""The earlier state by the inverse transition, against clones."""

from __future__ import annotations

from collections import namedtuple

import numpy as np
import pytest

from lvnav_trade.filter.ekf import apply_robustness
from lvnav_trade.filter.policies.back_propagation import accumulate_transition, begin_transition, recover_previous_epoch
from lvnav_trade.filter.policies.epoch_differences import DifferenceProcessing, clone, new_previous_epoch
from lvnav_trade.kernels.covariance import predict


def processing(cloned, first, back):
    return DifferenceProcessing(
        is_difference=np.zeros(3, bool),
        is_present=np.ones((1, 3), bool),
        previous_entry=0,
        reset_variance=np.full((1, 1), -1.0),
        cloned_states=np.array(cloned),
        clone=first,
        is_back_propagated=back,
    )


@pytest.mark.parametrize("growth", [1.0, 1.02], ids=["all remembered", "fading memory"])
def test_the_earlier_state_found_by_the_inverse_transition_is_the_clone(growth):
    rng, n, cloned, first = np.random.default_rng(3), 12, [6, 7, 8, 9], 10
    n = first + len(cloned)
    root = rng.standard_normal((first, first))
    P = np.zeros((n, n))
    P[:first, :first] = root @ root.T
    noise, decay = np.zeros(n), np.ones(n)
    noise[:first], decay[9] = rng.uniform(0.1, 1.0, first), 0.9
    blocks = np.zeros((3, 9))
    blocks[0] = 0.3 * np.eye(3).ravel()
    blocks[1:] = 0.2 * rng.standard_normal((2, 9))
    rows, columns = np.array([6, 3, 0]), np.array([3, 0, 9 - 3])
    Model = namedtuple(
        "Model",
        "seconds block_rows block_columns decay noise clock injected_variance inflation h_infinity_weight n_estimated "
        "n_state excess_density",
    )
    model = Model(
        np.array([0.3]),
        rows,
        columns,
        decay[None],
        noise[None],
        -1,
        np.zeros((0, n)),
        np.array([growth]),
        np.zeros((1, 9)),
        n,
        n,
        None,
    )
    by_clone, by_inverse = P.copy(), P.copy()
    clones, inverse = processing(cloned, first, False), processing(cloned, first, True)
    previous_epoch = new_previous_epoch(inverse, 1, 0, n)
    clone(by_clone, clones)
    begin_transition(previous_epoch, inverse)
    for _ in range(4):
        for covariance in (by_clone, by_inverse):
            apply_robustness(covariance, model, 0)
            predict(covariance, blocks, rows, columns, decay, noise, -1, 0.3)
        accumulate_transition(previous_epoch, inverse, blocks, np.zeros(18), model, 0, -1)
    assert np.abs(by_inverse[first:]).max() == 0.0
    recover_previous_epoch(by_inverse, previous_epoch, inverse)
    np.testing.assert_allclose(by_inverse, by_clone, rtol=0, atol=1e-10 * np.abs(by_clone).max())
