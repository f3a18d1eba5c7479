"""Decorrelated scalars of a solution carry the information of the correlated ones."""

from __future__ import annotations

from collections import namedtuple

import numpy as np
import pytest

from lvnav_trade.filter.decorrelation import decorrelate

Work = namedtuple("Work", "reported_covariance z H")
Parts = namedtuple("Parts", "sigma_points state_history")
Case = namedtuple("Case", "model signals options")
Model = namedtuple("Model", "has_reported_covariance is_processed")
Signals = namedtuple("Signals", "scale variance")
Options = namedtuple("Options", "gains")
Receiver = namedtuple("Receiver", "covariance")


@pytest.mark.parametrize(
    ("has_position", "rows"), [(True, slice(0, 6)), (False, slice(3, 6))], ids=["both", "velocity alone"]
)
def test_the_information_of_the_scalars_is_that_of_the_reported_covariance(has_position, rows):
    rng = np.random.default_rng(4)
    root, H, z = rng.standard_normal((6, 6)), rng.standard_normal((6, 9)), rng.standard_normal(6)
    scale = rng.uniform(1.0, 2.0, 6)
    R = np.outer(scale, scale) * (root @ root.T + np.eye(6))
    work = Work(np.zeros((6, 6)), z.copy(), H.copy())
    measured = np.array([has_position] * 3 + [True] * 3)
    case = Case(Model(True, measured), Signals(scale[None], np.ones((1, 6))), Options(None))
    receiver = Receiver(R / np.outer(scale, scale))
    decorrelate(work, Parts(None, np.zeros((1, 1))), case, receiver, None, 0)
    inverse = np.linalg.inv(R[rows, rows])
    np.testing.assert_allclose(work.H[rows].T @ work.H[rows], H[rows].T @ inverse @ H[rows], rtol=1e-9, atol=1e-10)
    np.testing.assert_allclose(work.H[rows].T @ work.z[rows], H[rows].T @ inverse @ z[rows], rtol=1e-9, atol=1e-10)
