"""Combination of redundant IMUs by stage: the middle value on the nominal flight."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lvnav_trade.gnss.fault_cards import GyroBiasStep
from tests.simulation.preparation.test_redundancy_plan import units_of

WHITE = {"gyro": {"random_walk": "1e-5 rad/s**0.5"}, "accel": {"random_walk": "1e-4 m/s**1.5"}}


def test_the_middle_beside_a_failed_unit_leaves_the_larger_of_two():
    fault = GyroBiasStep(unit=1, size=["900 deg/h", "0 deg/h", "0 deg/h"], **{"from": "10 s"})
    prepared_case, units = units_of(fault, units=(WHITE,) * 3, selection="mid_value")
    before, after = units.stage[0], units.stage[-1]
    sigma = 1e-5 * math.sqrt(prepared_case.unit.dt)
    assert units.shift[before, 0] == pytest.approx(np.zeros(3), abs=1e-3 * sigma)
    found = units.shift[after, 0, 0] + units.axis_weights[after, 0, 0, 0, 0] * 0.0
    # with 21 sigma of its own it is never the middle one
    assert found == pytest.approx(sigma / math.sqrt(math.pi), rel=0.05)
    assert units.axis_weights[after, :, 0, 0, 0] == pytest.approx([0.0, 0.5, 0.5], abs=1e-3)
