"""A star tracker in both engines, against closed forms: averaged updates, the first fix, errors that last."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
import pytest

from lvnav_trade.covariance.history import covariance
from lvnav_trade.quantities.frames import matrices, reporting_axes
from lvnav_trade.sensors.optics import boresight_quaternion
from lvnav_trade.trajectory.flight import motion
from tests.building import INERTIAL, LOOSE, MATCHED, flight, loaded, prepare_hop, turning, with_fields
from tests.simulation.preparation.test_sensors import agree

ARCSEC = math.pi / 648000.0
TRACKER = {"kind": "star_tracker", "name": "test", "source": "none", "boresight": [0.0, 0.0, 1.0],
           "across": "20 arcsec", "about": "200 arcsec"}  # fmt: skip
# a unit that drifts by less than 0.01 arcsec in the flight: what is left is the tracker's
QUIET = {
    "imu.gyro.random_walk": "1e-9 deg/sqrt(h)", "imu.gyro.bias_repeatability": "1e-7 deg/h",
    "imu.gyro.bias_instability": "0 deg/h", "imu.gyro.rate_random_walk": "0 deg/h/sqrt(h)",
    "imu.gyro.scale_factor": "0 ppm", "imu.gyro.misalignment": "0 mrad", "imu.gyro.g_sensitivity": "0 deg/h/g",
}  # fmt: skip
SLOW = {"imu.rate": "50 Hz", "filter.covariance_rate": "5 Hz", "imu.process_rate": "5 Hz"}
COARSE = {"initial.tilt": "0.3 deg", "initial.heading": "0.3 deg"}


@lru_cache(maxsize=1)
def still():
    """A coast of 25 s in which the body does not turn: velocity tells nothing of attitude."""
    return flight([(25.0, lambda t: np.zeros(3))], lambda t: np.tile(turning(np.array([5.0])), (t.size, 1)))


def tracked(*settings, measurements=("stellar_attitude",), sensor=None, **fields):
    """The short flight with a star tracker; without other settings an inertial filter with nothing else."""
    card = {**TRACKER, **(sensor or {})}
    base = loaded(MATCHED, *(settings or (INERTIAL,)))
    listed = {"filter.measurements": list(measurements)}
    return with_fields(base, **{"sensors": {"tracker": card}, **listed, **SLOW, **fields})


def body(cov, epoch):
    """Sigma of attitude about the body axes (arcsec): true, and as the filter has it."""
    at = int(np.argmin(np.abs(cov.t - epoch)))
    return cov.true_sigma[at, :3] / ARCSEC, cov.formal_sigma[at, :3] / ARCSEC


@pytest.mark.parametrize("n", [1, 4, 25])
def test_n_updates_average_the_noise_across_and_about_the_boresight(n):
    prepared_case = prepare_hop(tracked(**QUIET, **COARSE), still())
    true, formal = body(covariance(prepared_case), prepared_case.t_epoch[n - 1])
    start = 0.3 * 3600.0
    expected = [1.0 / math.sqrt(n / sigma**2 + 1.0 / start**2) for sigma in (20.0, 20.0, 200.0)]
    np.testing.assert_allclose(true, expected, rtol=1e-4)
    np.testing.assert_allclose(formal, expected, rtol=1e-4)


def test_both_engines_agree_on_an_oblique_boresight():
    sensor = {"boresight": [1.0, 1.0, 0.0]}
    prepared_case = prepare_hop(tracked(sensor=sensor, **{"initial.tilt": "0.05 deg", "initial.heading": "0.05 deg"}))
    cov, _ = agree(prepared_case, [0, 1, 2], runs=200)
    roll, _, yaw = cov.true_sigma[-1, :3]
    assert roll > 2.0 * yaw  # half of what is unknown about the boresight is unknown about the body's x axis


def test_the_heading_of_a_tight_filter_after_the_first_fix():
    scenario = tracked("base.filter=filters/tight", measurements=("pseudorange", "range_rate", "stellar_attitude"),
                       **COARSE)  # fmt: skip
    prepared_case = prepare_hop(scenario, still())
    imu, cov = scenario.imu, covariance(prepared_case)
    first = prepared_case.t_epoch[0]
    at = motion(prepared_case.trajectory, np.array([first]))
    theta0 = prepared_case.trajectory.theta0
    C_i_n = reporting_axes("ned", np.array([first]), at.r_i, at.v_i, theta0)[0]
    C_s_i = (matrices(at.q_b_i) @ matrices(boresight_quaternion((0.0, 0.0, 1.0))[None]))[0]
    bias = math.hypot(imu.gyro.bias_repeatability, imu.gyro.bias_instability)
    before = math.radians(0.3) ** 2 + imu.gyro.random_walk**2 * first + (bias * first) ** 2
    information = C_s_i @ np.diag(1.0 / (ARCSEC * np.array([20.0, 20.0, 200.0])) ** 2) @ C_s_i.T
    after = np.linalg.inv(information + np.eye(3) / before)
    expected = math.sqrt((C_i_n @ after @ C_i_n.T)[2, 2])
    k = int(np.argmin(np.abs(cov.t - first)))
    C_b_i = matrices(at.q_b_i)[0]
    found = C_i_n @ C_b_i @ cov.formal_cov[k, :3, :3] @ C_b_i.T @ C_i_n.T
    assert math.sqrt(found[2, 2]) == pytest.approx(expected, rel=1e-3)
    assert expected < 0.2 * math.radians(0.3)


def test_what_lasts_is_averaged_by_its_correlation_and_a_misalignment_not_at_all():
    time, n = 4.0, 25
    lasting = {"low_frequency": "15 arcsec", "low_frequency_time": f"{time} s", "misalignment": "40 arcsec"}
    prepared_case = prepare_hop(tracked(sensor=lasting, **QUIET, **COARSE), still())
    cov = covariance(prepared_case)
    true, formal = body(cov, prepared_case.t_epoch[n - 1])
    lag = np.abs(np.subtract.outer(np.arange(n), np.arange(n)))
    averaged = 15.0**2 * np.exp(-lag / time).mean()
    start = (0.3 * 3600.0) ** 2
    for axis, noise in enumerate((20.0, 20.0, 200.0)):
        trust = 1.0 / (1.0 + noise**2 / n / start)  # the first attitude counts a little
        expected = trust**2 * (noise**2 / n + averaged + 40.0**2) + (1.0 - trust) ** 2 * start
        assert true[axis] == pytest.approx(math.sqrt(expected), rel=1e-4)
        assert formal[axis] == pytest.approx(1.0 / math.sqrt(n / noise**2 + 1.0 / start), rel=1e-4)
    budget = dict(zip(cov.sources, cov.budget[-1], strict=True))
    assert np.sqrt(budget["star tracker misalignment"][0]) / ARCSEC == pytest.approx(40.0, rel=0.01)
    assert {"star tracker noise", "star tracker low-frequency error"} < set(cov.sources)


LASTING = {"low_frequency": "10 arcsec", "low_frequency_time": "20 s", "misalignment": "30 arcsec", "latency": "0.1 s"}
STATES = ["tracker_misalignment", "tracker_low_frequency"]


@pytest.mark.parametrize("field", ["extra_states", "consider"])
def test_states_for_what_lasts_make_the_filter_consistent_late_as_it_is(field):
    measurements = ("position", "velocity", "stellar_attitude")
    fields = {f"filter.{field}": STATES, "filter.delay_compensation": {"kind": "buffered"}}
    prepared_case = prepare_hop(tracked(LOOSE, measurements=measurements, sensor=LASTING, **fields))
    names = [output.quantity for output in prepared_case.outputs]
    assert [names.count(state) for state in STATES] == [3, 3]
    cov, _ = agree(prepared_case, [0, 1, 2, *(k for k, name in enumerate(names) if name in STATES)])
    np.testing.assert_allclose(cov.formal_sigma[-1, :3], cov.true_sigma[-1, :3], rtol=1e-3)
    naive = covariance(prepare_hop(tracked(LOOSE, measurements=measurements, sensor=LASTING, **{
        "filter.delay_compensation": {"kind": "buffered"}})))  # fmt: skip
    assert np.all(naive.formal_sigma[-1, :2] < 0.6 * naive.true_sigma[-1, :2])


def test_it_measures_from_an_event_and_not_while_the_body_turns_too_fast():
    from_event = prepare_hop(tracked(sensor={"from": "end0"}))
    np.testing.assert_array_equal(from_event.sensors.is_measuring[0], from_event.t_epoch >= 20.0)
    # the body turns by 4 deg/s and 1 deg/s throughout
    for rate, seen in (("4 deg/s", 0), ("4.2 deg/s", 30)):
        assert np.count_nonzero(prepare_hop(tracked(sensor={"highest_rate": rate})).sensors.is_measuring) == seen
