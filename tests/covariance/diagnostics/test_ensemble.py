"""The error per step of the filter's transition: closed forms of what it misses, and none where it models all."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.covariance.diagnostics.ensemble import densities, step_errors
from lvnav_trade.kernels.transition import ATT, POS, VEL
from lvnav_trade.quantities.frames import matrices
from tests.building import LOOSE, hop, loaded, prepare_hop, with_fields

RUNS = 60
PUSH, BOOST = 30.0, 20.0  # m/s^2 along the velocity for 20 s, then a coast of 10 s
NO_START = {"tilt": "0 rad", "heading": "0 rad", "position": "0 m", "velocity": "0 m/s"}


def perturbed(gyro=None, accel=None, **initial):
    """The short flight with a unit of these errors only."""
    scenario = loaded(LOOSE)
    imu = with_fields(scenario.imu, gyro=gyro or {}, accel=accel or {})
    start = with_fields(scenario.initial, **{**NO_START, **initial})
    return prepare_hop(scenario.model_copy(update={"imu": imu, "initial": start}), hop(BOOST, 10.0, PUSH))


def spread(found, at):
    """Root mean square over the axes at each step."""
    variance = np.diagonal(found.covariance, axis1=1, axis2=2) + found.mean**2
    return np.sqrt(variance[:, at : at + 3].mean(axis=1))


def within(ratio, n_run, axes=3):
    """A root mean square of n_run draws on some axes, five of its own sigmas wide."""
    return np.all(np.abs(ratio - 1.0) < 5.0 / np.sqrt(2.0 * n_run * axes))


def test_what_the_filter_models_it_does_not_miss():
    """Biases and a tilted start: what remains is of second order, some thousandths of the first."""
    prepared_case = perturbed(
        {"bias_repeatability": "1 deg/h"}, {"bias_repeatability": "1 mg"}, tilt="1 mrad", velocity="1 m/s"
    )
    found = step_errors(prepared_case, 1, 8)
    first_order = np.abs(np.diff(found.error[:, VEL : VEL + 3], axis=0)).max()
    assert first_order > 5e-3  # the tilt turns 30 m/s^2 by some 1 mrad, of which a third lies across
    assert spread(found, VEL).max() < 5e-3 * first_order
    assert spread(found, ATT).max() < 1e-8
    assert spread(found, POS).max() < 5e-3 * first_order
    np.testing.assert_array_equal(spread(found, 9), 0.0)


def test_an_unmodelled_scale_factor_misses_its_share_of_the_speed_gained():
    sigma = 500e-6
    found = step_errors(perturbed(accel={"scale_factor": "500 ppm"}), 2, RUNS)
    boost = found.t <= BOOST
    # the thrust lies within degrees of one sensitive axis each second; three axes share one draw each
    expected = sigma * PUSH * found.seconds[boost] / np.sqrt(3.0)
    assert within(spread(found, VEL)[boost] / expected, RUNS, 1)
    assert spread(found, VEL)[~boost].max() < 1e-5
    noise = densities(found, prepare_hop(loaded(LOOSE)), 0.0, BOOST)
    assert noise.velocity == pytest.approx(sigma * PUSH / np.sqrt(3.0), rel=5.0 / np.sqrt(2.0 * RUNS))
    assert noise.attitude == pytest.approx(0.0, abs=1e-9)


def test_white_noise_is_found_again_as_the_density_of_the_card():
    prepared_case = perturbed({"random_walk": "0.1 deg/sqrt(h)"}, {"random_walk": "1 mg/sqrt(Hz)"})
    found = step_errors(prepared_case, 3, RUNS)
    noise, imu = densities(found, prepared_case), prepared_case.scenario.imu
    samples = RUNS * len(found.t) * 3
    assert noise.attitude == pytest.approx(imu.gyro.random_walk, rel=5.0 / np.sqrt(2.0 * samples))
    assert noise.velocity == pytest.approx(imu.accel.random_walk, rel=5.0 / np.sqrt(2.0 * samples))
    # within a step the noise of the velocity reaches the position: sigma^2 dt^3 / 3, no noise of its own
    assert noise.position == pytest.approx(imu.accel.random_walk * found.seconds[0] / np.sqrt(3.0), rel=0.05)
    assert (noise.gyro_bias, noise.accel_bias) == (0.0, 0.0)


def test_a_walking_bias_is_found_as_its_walk():
    prepared_case = perturbed({"rate_random_walk": "100 deg/h/sqrt(h)"})
    noise = densities(step_errors(prepared_case, 4, RUNS), prepared_case)
    assert noise.gyro_bias == pytest.approx(prepared_case.scenario.imu.gyro.rate_random_walk, rel=0.1)


def test_steps_follow_each_other_and_cover_the_flight():
    prepared_case = perturbed()
    found = step_errors(prepared_case, 1, 2)
    np.testing.assert_allclose(found.t[0] - found.seconds[0], prepared_case.t_hist[0])
    assert found.seconds.sum() == pytest.approx(prepared_case.t_hist[-1] - prepared_case.t_hist[0])
    assert found.mean.shape == (len(prepared_case.t_hist) - 1, prepared_case.layout.n_state)
    assert matrices(prepared_case.record.q).shape[0] == len(prepared_case.t_hist)
