"""The difference of two inertial units as a measurement: closed forms, and both engines."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lvnav_trade.covariance.history import adjoint, covariance
from lvnav_trade.scenario.filter_models import filter_models
from lvnav_trade.simulation.montecarlo import run_block
from tests.both_engines.test_closed_forms import DEG_H, G
from tests.building import IDEAL, INERTIAL, TURNED, loaded, prepare_hop, with_difference, with_fields, with_units
from tests.imu.test_array import DODECAHEDRON, cone

QUIET = {
    "imu.gyro.random_walk": "1e-8 rad/s**0.5", "imu.gyro.rate_random_walk": 0, "imu.accel.random_walk": "1e-7 m/s**1.5",
    "imu.accel.rate_random_walk": 0,
}  # fmt: skip
UNLIKE = {"gyro": {"bias_repeatability": "3 deg/h"}, "accel": {"bias_repeatability": "1 mg"}}


@pytest.mark.slow  # a kernel of its own, most of half a minute to compile
def test_a_difference_of_two_units_tells_which_is_the_better_one_whatever_their_weights():
    """Equal noise, so equal weights: (s1^2 + s2^2) / 4 of the fused bias at first. Once the difference is known, what
    is left is s1 s2 / sqrt(s1^2 + s2^2), as if they were weighted by their biases. 1 deg/h and 3; 2 mg and 1.
    """
    scenario = with_fields(loaded(INERTIAL, "base.imu=imu/tactical_fog_matched"), **QUIET)
    cov = covariance(prepare_hop(with_difference(scenario, [{}, UNLIKE | TURNED])))
    gyro, accel = slice(9, 12), slice(12, 15)
    for sigma in (cov.formal_sigma, cov.true_sigma):
        assert sigma[0, gyro] == pytest.approx(np.full(3, math.sqrt(10.0) / 2.0 * DEG_H), rel=1e-9)
        assert sigma[-1, gyro] == pytest.approx(np.full(3, 3.0 / math.sqrt(10.0) * DEG_H), rel=1e-4)
        assert sigma[-1, accel] == pytest.approx(np.full(3, 2e-3 * G / math.sqrt(5.0)), rel=1e-4)
    assert np.max(np.abs(cov.true_sigma / cov.formal_sigma - 1.0)) < 1e-3


def test_axes_of_unlike_noise_have_it_each_in_the_difference():
    """Of two units along the same axes the squares add, axis by axis, and the matched filter assumes that."""
    quiet, loud = 0.003, 0.3  # deg/sqrt(h)
    scenario = with_fields(loaded(INERTIAL, "base.imu=imu/tactical_fog_matched"), **QUIET)
    own = {"random_walk": [f"{quiet} deg/sqrt(h)", f"{quiet} deg/sqrt(h)", f"{loud} deg/sqrt(h)"]}
    prepared_case = prepare_hop(with_difference(scenario, [{"gyro": own}, {"gyro": own | UNLIKE["gyro"]}]))
    sensor = next(one for one in prepared_case.devices if one.card.measurement == "angle_difference")
    at = 5
    walk = np.array([quiet, quiet, loud]) * math.radians(1.0) / 60.0
    since = sensor.time_since_measurement[at]
    assert sensor.sigma[at, :3] == pytest.approx(math.sqrt(2.0 * since) * walk, rel=1e-9)
    assert sensor.variance[at, :3] == pytest.approx(2.0 * since * walk**2, rel=1e-9)


WALKS = ["0.003 deg/sqrt(h)", "0.003 deg/sqrt(h)", "0.3 deg/sqrt(h)"]
SPEED_WALKS = ["3 mg/sqrt(Hz)", "0.03 mg/sqrt(Hz)", "0.03 mg/sqrt(Hz)"]
BIASES = {
    1: {"gyro": ["1 deg/h", "1 deg/h", "5 deg/h"], "accel": ["2 mg", "0.1 mg", "1 mg"]},
    2: {"gyro": ["3 deg/h", "0.2 deg/h", "1 deg/h"], "accel": ["1 mg", "1 mg", "0.3 mg"]},
}


def test_the_filter_assumes_what_is_true_of_units_whose_axes_are_unlike():
    """A matched filter is exact, axis by axis, from a start known so well that the errors are those of the units."""
    start = {"initial.tilt": "1e-6 deg", "initial.heading": "1e-6 deg"}
    scenario = with_fields(loaded(INERTIAL, "base.imu=imu/tactical_fog_matched"), **QUIET, **start)
    units = [
        {"gyro": {"bias_repeatability": BIASES[k]["gyro"], "random_walk": WALKS[::turn]},
         "accel": {"bias_repeatability": BIASES[k]["accel"], "random_walk": SPEED_WALKS}}
        for k, turn in ((1, 1), (2, -1))
    ]  # fmt: skip
    cov = covariance(prepare_hop(with_difference(scenario, units)))
    np.testing.assert_allclose(cov.formal_sigma[:, :15], cov.true_sigma[:, :15], rtol=1e-3)
    # y of the gyros is quiet, so the difference is known: what is left is s1 s2 / sqrt(s1^2 + s2^2), of 1 and 0.2 deg/h
    assert cov.true_sigma[-1, 10] == pytest.approx(0.2 / math.hypot(1.0, 0.2) * DEG_H, rel=1e-2)


OTHER = {"": {"gyro": "5 deg/h", "accel": "5 mg"}, "_walk": {"gyro": "5 deg/h/sqrt(h)", "accel": "5 mg/sqrt(h)"},
         "_correlation": {"gyro": 0.3, "accel": 0.3}}  # fmt: skip


@pytest.mark.parametrize("end", OTHER)
@pytest.mark.parametrize("kind", ["gyro", "accel"])
def test_a_field_of_the_relative_biases_changes_what_the_filter_assumes(kind, end):
    base = loaded(INERTIAL, "base.imu=imu/tactical_fog_matched")
    whole = with_difference(base, [{}, UNLIKE | TURNED])
    stated = filter_models(whole)[0].model_dump(mode="json")
    name = f"{kind}_relative_bias{end}"
    one, two = (
        covariance(prepare_hop(with_fields(whole, **{"filter.imu": stated | change}))).formal_sigma
        for change in ({}, {name: OTHER[end][kind]})
    )
    assert not np.array_equal(one, two)


def test_the_difference_of_like_units_tells_nothing_of_their_average():
    scenario = loaded(INERTIAL, "base.imu=imu/tactical_fog_matched")
    with_it = covariance(prepare_hop(with_difference(scenario, [{}, TURNED])))
    without = covariance(prepare_hop(with_units(scenario, [{}, TURNED])))
    assert with_it.true_sigma[:, :15] == pytest.approx(without.true_sigma, rel=1e-9)


@pytest.mark.parametrize("units", [
    [{"lever_arm": ["0.5 m", "0 m", "0 m"]}, UNLIKE | TURNED],
    [{"axes": cone(4)}, {"axes": DODECAHEDRON, "gyro": {"random_walk": "0.1 deg/sqrt(h)"}}, {"axes": [[1, 1, 1]]}],
], ids=["unlike", "skewed"])  # fmt: skip
def test_both_engines_agree_on_a_difference(units):
    base = loaded(
        "base.imu=imu/tactical_fog", "base.filter=filters/tight", *IDEAL, "base.imu.accel.scale_factor=200 ppm"
    )
    prepared_case = prepare_hop(with_difference(base, units, "pseudorange", "range_rate"))
    cov, n = covariance(prepared_case), 64
    at = [10, 20, 30]
    rms = np.sqrt(np.mean(run_block(prepared_case, 5, 0, n).err[:, at] ** 2, axis=0))
    ratio = rms / np.hypot(cov.true_sigma[at], cov.mean[at])
    # the ratio of a root mean square of n runs to sigma has itself the sigma 1 / sqrt(2 n); of 90, five of it
    assert np.max(np.abs(ratio - 1.0)) < 5.0 / math.sqrt(2.0 * n)
    backward = adjoint(prepared_case, 30.0).contribution.sum(axis=2)
    assert backward == pytest.approx(cov.budget[-1, :, :9].T, rel=1e-6, abs=1e-9 * backward.max())
