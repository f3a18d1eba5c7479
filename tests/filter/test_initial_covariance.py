"""Covariance of a filter at its start."""

from __future__ import annotations

import math

import numpy as np

from lvnav_trade.filter.assumed import ImuModel, InitialModel, ReceiverModel
from lvnav_trade.filter.card import FilterCard
from lvnav_trade.filter.initial_covariance import initial_covariance
from lvnav_trade.filter.states import FilterMeasurements, state_layout
from lvnav_trade.sensors.receiver_observables import Channels

IMU = ImuModel(
    gyro_random_walk="0.03 deg/sqrt(h)", accel_random_walk="50 ug/sqrt(Hz)", gyro_bias="1 deg/h", accel_bias="2 mg"
)
RECEIVER = ReceiverModel(
    pseudorange_sigma="2 m", range_rate_sigma="0.1 m/s", position_sigma="3 m", velocity_sigma="0.2 m/s",
    clock_h0=2e-21, clock_h_minus2=3e-24,
)  # fmt: skip
INITIAL = InitialModel(
    tilt="1 mrad", heading="10 mrad", position="5 m", velocity="0.1 m/s", clock_bias="100 m", clock_drift="1 m/s"
)
CARD = FilterCard(name="f", source="test", measurements=("pseudorange", "range_rate"))
CHANNELS = Channels(True, ("G01", "G02"), ("G", "G"), (True, True))


def test_the_first_covariance_is_the_filter_model_in_the_axes_of_the_start():
    layout = state_layout(CARD, FilterMeasurements(IMU, RECEIVER, CHANNELS))
    C_n_i = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
    P = initial_covariance(layout, INITIAL, C_n_i)
    expected = np.diag([1e-3, 1e-3, 1e-2]) ** 2
    np.testing.assert_allclose(P[:3, :3], C_n_i @ expected @ C_n_i.T, rtol=1e-14)
    np.testing.assert_allclose(np.diag(P)[3:9], np.square([0.1] * 3 + [5.0] * 3))
    np.testing.assert_allclose(np.diag(P)[9:12], math.radians(1.0 / 3600.0) ** 2)
    np.testing.assert_allclose(np.diag(P)[12:15], (2e-3 * 9.80665) ** 2)
    np.testing.assert_allclose(np.diag(P)[15:], [1e4, 1.0])
    assert np.count_nonzero(P - np.diag(np.diag(P))) == np.count_nonzero(
        (C_n_i @ expected @ C_n_i.T) - np.diag(np.diag(C_n_i @ expected @ C_n_i.T))
    )
