"""Optical azimuth: its prediction against local axes, its row against differences, where it is seen."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.quantities.frames import matrices, rotation_i_n
from lvnav_trade.sensors.jacobian_row import H_ATT
from lvnav_trade.sensors.pad.azimuth import AzimuthCard, fill, measure
from lvnav_trade.trajectory.attitude_algebra import product
from tests.sensors.pad.rows import R_I, THETA, VIEW, assert_rows_are_derivatives, rows, state

CARD = AzimuthCard.model_validate({"name": "test", "source": "none", "sigma": "5 arcsec", "bias": "20 arcsec"})

AZIMUTH = np.radians(100.0)


def seen(H, z, nav, azimuth=AZIMUTH):
    observed = np.zeros(4)
    measure(observed, np.array([azimuth, 0.0, 0.0, 0.0]), 0.0)
    fill(H, z, 0, observed, nav)


def test_the_truth_is_the_azimuth_of_the_bodys_y_axis():
    assert CARD.truth(VIEW)[0, 0] == pytest.approx(np.radians(100.0), abs=1e-12)


@pytest.mark.parametrize("heading", [1e-6, 0.01, -0.05])
def test_the_innovation_is_the_angle_between_two_azimuths(heading):
    down = rotation_i_n(R_I, THETA)[0, 2]
    error = np.concatenate([heading * down + 0.001 * np.cross(down, R_I[0] / np.linalg.norm(R_I)), np.zeros(6)])
    y = rotation_i_n(R_I, THETA)[0] @ matrices(state(error)[None, :4])[0, :, 1]
    expected = np.radians(100.0) - np.arctan2(y[1], y[0])
    assert rows(seen, 1, error)[1][0] == pytest.approx(expected, rel=1e-5, abs=1e-12)


def test_across_north_the_innovation_stays_small():
    H, z = np.zeros((1, 13)), np.zeros(1)
    seen(H, z, state(), np.radians(100.0) + 2.0 * np.pi)
    assert z[0] == pytest.approx(0.0, abs=1e-12)


def test_the_row_is_the_derivative_with_respect_to_attitude():
    def fixed_horizon(H, z, nav):
        seen(H, z, np.concatenate([nav[:7], R_I[0]]))  # the turn of the horizon with position is neglected

    assert_rows_are_derivatives(fixed_horizon, 1, AzimuthCard.jacobian)
    H, _ = rows(seen, 1)
    down = rotation_i_n(R_I, THETA)[0, 2]
    assert H[0, H_ATT : H_ATT + 3] @ down == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize("error", [0.0, 1e-4, -0.08])
def test_a_measured_azimuth_is_the_true_one_and_an_error(error):
    out = np.zeros(4)
    measure(out, np.array([1.2, 0.0, 0.0, 0.0]), error)
    np.testing.assert_allclose(out[:2], [np.cos(1.2 + error), np.sin(1.2 + error)], atol=1e-10)


def test_it_is_seen_while_the_vehicle_stands_and_the_mirror_faces_the_horizon():
    assert CARD.is_available(VIEW).tolist() == [True]
    assert CARD.is_available(VIEW._replace(is_at_rest=np.array([False]))).tolist() == [False]
    lying = np.array([[np.cos(0.6), 0.0, 0.0, np.sin(0.6)]])  # 69 deg about z: the y axis leaves the horizon
    assert CARD.is_available(VIEW._replace(q_b_i=product(VIEW.q_b_i, lying))).tolist() == [False]


def test_noise_and_bias_are_its_own():
    np.testing.assert_allclose(CARD.noise_sigma(VIEW), [[np.radians(5.0 / 3600.0)]])
    np.testing.assert_allclose(CARD.matched_model().variance(VIEW), [[np.radians(5.0 / 3600.0) ** 2]])
    (bias,) = CARD.correlated_errors()
    assert bias.sigma == pytest.approx(np.radians(20.0 / 3600.0))
