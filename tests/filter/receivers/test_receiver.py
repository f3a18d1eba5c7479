"""Settings in numbers: what each argument becomes, and the arrays of a receiver."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2

from lvnav_trade.filter.receivers.receiver import (
    SINCE,
    FilterSettings,
    ReportedCovariance,
    new_receiver,
    point_model,
    receiver_filter,
    switch_on,
    transition,
)
from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.lanes import number_like, view
from lvnav_trade.kernels.vector import WIDTH

OWN = ReportedCovariance()


def test_limits_of_residuals_grow_with_two_degrees_of_freedom_a_satellite():
    limits = point_model(OWN, 2.0, 0.1, false_alarm=0.01, max_satellite_count=10).limits
    assert np.all(np.isinf(limits[:5]))  # four satellites leave nothing to test
    # upper 1 % points of chi-square as printed in tables
    assert limits[5:8] == pytest.approx([9.210, 13.277, 16.812], abs=6e-4)
    assert len(limits) == 11
    assert limits[10] == chi2.isf(0.01, 12)


def test_sigmas_become_variances_and_what_is_left_out_limits_nothing():
    model = receiver_filter(OWN, 1.0, FilterSettings(2.0, 0.1, 0.5, 0.005))
    assert (model.range_floor, model.rate_floor) == (4.0, pytest.approx(0.01))
    assert (model.drive_floor, model.clock) == (0.25, pytest.approx(2.5e-5))
    assert model.gate_squared == model.range_limit == model.rate_limit == model.restart == model.coast == np.inf
    settings = FilterSettings(
        2.0, 0.1, 0.5, 0.005, gate=5.0, range_limit=100.0, rate_limit=9.0, restart_after=4, longest_coast=60.0
    )
    limited = receiver_filter(OWN, 1.0, settings)
    assert (limited.gate_squared, limited.range_limit, limited.rate_limit) == (25.0, 100.0, 9.0)
    assert (limited.restart, limited.coast) == (4.0, 60.0)


def test_the_transition_integrates_acceleration_twice():
    phi = transition(receiver_filter(OWN, 2.0, FilterSettings(2.0, 0.1, 0.5, 0.005)))
    state = np.zeros(11)
    state[[0, 3, 6, 9, 10]] = [3.0, 5.0, 7.0, 11.0, 13.0]
    np.testing.assert_allclose((phi @ state)[[0, 3, 6, 9, 10]], [3.0, 11.0, 23.0, 37.0, 13.0])


def test_a_slowly_fading_acceleration_is_a_random_walk_in_the_limit():
    walk = transition(receiver_filter(OWN, 1.0, FilterSettings(2.0, 0.1, 0.5, 0.005)))
    fading = transition(receiver_filter(OWN, 1.0, FilterSettings(2.0, 0.1, 0.5, 0.005, acceleration_time=1e6)))
    np.testing.assert_allclose(fading, walk, rtol=0, atol=2e-6)
    quick = transition(receiver_filter(OWN, 1.0, FilterSettings(2.0, 0.1, 0.5, 0.005, acceleration_time=0.5)))
    assert quick[0, 0] == pytest.approx(np.exp(-2.0))
    assert quick[3, 0] == pytest.approx(0.5 * (1.0 - np.exp(-2.0)))


@jit
def switch_on_lanes(receiver):
    at = view(receiver)
    place = number_like(at.nav[0], 6.4e6)
    switch_on(at, place, 0.5 * place, 0.0 * place)


def test_a_receiver_that_is_switched_on_has_forgotten_everything_in_every_run():
    one, eight = new_receiver(), new_receiver(WIDTH)
    for receiver in (one, eight):
        for array in receiver:
            array[:] = 7.0
    switch_on(one, 6.4e6, 3.2e6, 0.0)
    switch_on_lanes(eight)
    for name in ("position_guess", "nav", "P", "memory"):
        alone = getattr(one, name)
        np.testing.assert_array_equal(getattr(eight, name), np.repeat(alone[..., None], WIDTH, axis=-1))
    assert list(one.position_guess) == [6.4e6, 3.2e6, 0.0]
    assert one.memory[SINCE] == -1.0
    assert not np.any(one.P)
    assert all(array.shape[:-1] == getattr(one, name).shape for name, array in eight._asdict().items())
