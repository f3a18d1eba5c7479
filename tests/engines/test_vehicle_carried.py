"""Sources in lanes: what is put into one of them is found there and nowhere else; ticks of the nominal flight."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.engines.vehicle_carried import add_to, entry, nominal_tick, set_noise
from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.vector import WIDTH
from tests.engines.modelled import modelled


@jit
def fill(lanes, noise):
    add_to(lanes, 9, 3, 1, 2.5)
    set_noise(noise, 9, 0, 4.0)
    return entry(lanes, 9, 1, 3)


def test_a_source_is_a_lane_of_its_group():
    lanes, noise = np.zeros((2, 4, 4, WIDTH)), np.zeros((2, 1, WIDTH))
    assert fill(lanes, noise) == 2.5
    assert lanes[1, 1, 3, 1] == 2.5
    assert np.count_nonzero(lanes) == 1
    assert noise[1, 0, 1] == 4.0


def test_the_plain_form_is_one_source_after_the_other():
    sources = np.zeros((3, 4, 4))
    add_to(sources, 2, 3, 1, 2.5)
    assert entry(sources, 2, 1, 3) == 2.5


def test_a_nominal_tick_is_the_flights_own_velocity_gain():
    reference, sums = modelled().reference, np.zeros(21)
    k = 1000
    nominal_tick(sums, reference, k, 0.005)
    force = np.linalg.norm(sums[9:12]) / 0.005
    assert force == pytest.approx(30.0, rel=1e-6)
    np.testing.assert_allclose(sums[:9].reshape(3, 3) @ sums[:9].reshape(3, 3).T, 0.005**2 * np.eye(3), atol=1e-18)
