"""What goes out: the point solution itself, or that of the filter which it starts."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.filter.receivers.bancroft import solution
from lvnav_trade.filter.receivers.ekf_gnss import solve, step
from lvnav_trade.filter.receivers.receiver import (
    FilterSettings,
    ReportedCovariance,
    new_receiver,
    point_model,
    receiver_filter,
    switch_on,
)
from tests.filter.receivers.scenes import scene, standing, true_ranges

OWN = ReportedCovariance()
POINT = point_model(OWN, 2.0, 0.1)
FILTER = receiver_filter(OWN, 1.0, FilterSettings(2.0, 0.1, 0.5, 0.005))


@pytest.mark.parametrize("filtering", [None, FILTER])
def test_a_receiver_hands_out_what_its_solver_finds(filtering):
    at = scene(np.arange(3.0), standing)
    ranges = true_ranges(at)
    one, other = new_receiver(), new_receiver()
    for receiver in (one, other):
        switch_on(receiver, *at.r_i[0])
    for k in range(3):
        epoch = (at.satellite[k], at.moving[k], at.used[k], at.n_used[k], ranges[k])
        found = solve(one, POINT, filtering, *epoch)
        expected = solution(other, POINT, *epoch) if filtering is None else step(other, FILTER, POINT, *epoch)
        assert found == expected > 0.0
    assert np.array_equal(one.solution, other.solution)
    assert np.array_equal(one.covariance, other.covariance)
    np.testing.assert_allclose(one.solution[:3], at.r_i[-1], atol=1e-3)
