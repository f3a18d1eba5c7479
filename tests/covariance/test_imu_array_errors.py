"""Several inertial units in linear covariance, against closed forms, one unit, and the backward pass."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lvnav_trade.covariance.diagnostics.case_diagnostics import scale_source
from lvnav_trade.covariance.history import adjoint, covariance
from tests.both_engines.test_closed_forms import DELTA_V, NOWHERE, SECONDS, thrusting
from tests.building import IDEAL, INERTIAL, TURNED, loaded, prepare_hop, with_fields, with_units
from tests.imu.test_array import DODECAHEDRON, cone

RICH = (
    "base.imu=imu/tactical_fog", "base.filter=filters/tight", *IDEAL, "base.imu.gyro.quantisation=1e-7 rad",
    "base.imu.accel.temperature={start: 1 s, end: 3 s, amplitude: [1 mg, 2 mg, 3 mg]}",
    "base.filter.extra_states=[accel_scale_factor, gyro_misalignment, gyro_g_sensitivity]",
)  # fmt: skip
SAMPLES = (
    "base.imu=imu/tactical_fog", "base.filter=filters/tight", *IDEAL, "base.filter.report_imu_samples=true",
    "base.filter.measurements=[pseudorange, range_rate, imu]",
)  # fmt: skip


def of_units(units, gyro=None, accel=None, **fields):
    """Covariance at the end of 100 s of thrust along x, of units that have these errors and no others."""
    scenario = loaded(INERTIAL)
    imu = with_fields(scenario.imu, rate="100 Hz", gyro=gyro or {}, accel=accel or {})
    initial = with_fields(scenario.initial, **NOWHERE)
    scenario = scenario.model_copy(update={"imu": imu, "initial": initial, "frame": "inertial"})
    return covariance(prepare_hop(with_units(scenario, units, **fields), thrusting()))


@pytest.mark.parametrize(
    "settings", [RICH, pytest.param(SAMPLES, marks=pytest.mark.slow)], ids=["increments", "samples as measurements"]
)
def test_a_set_of_one_unit_is_that_unit(settings):
    scenario = loaded(*settings)
    one, many = prepare_hop(scenario), prepare_hop(with_units(scenario, [{}]))
    a, b = covariance(one), covariance(many)
    assert np.array_equal(a.formal_sigma, b.formal_sigma)
    scale = np.max(a.true_sigma, axis=0)
    # noise that enters at one end of a window, and not half at either, moves by half a window
    assert np.max(np.abs(a.true_sigma - b.true_sigma) / scale) < 1e-5
    assert np.max(np.abs(a.mean - b.mean) / scale) < 2e-3
    assert b.sources == tuple(
        f"unit 1 {name}" if name.startswith(("gyro", "accelerometer")) else name for name in a.sources
    )


def test_what_a_list_of_one_unit_differs_by_is_of_second_order_in_the_window():
    """White noise enters a list as a bias of a window, which reaches velocity too: half the window, a quarter of it."""
    found = []
    for rate in ("10 Hz", "20 Hz", "40 Hz"):
        scenario = loaded("base.imu=imu/tactical_fog_matched", f"base.filter.covariance_rate={rate}")
        a, b = (covariance(prepare_hop(one)).true_sigma for one in (scenario, with_units(scenario, [{}])))
        found.append(float(np.max(np.abs(a - b)[:, :9] / np.max(a, axis=0)[:9])))
    assert found[0] < 1e-5
    assert found[0] > 3.0 * found[1] > 9.0 * found[2]


def test_the_backward_pass_is_the_forward_one():
    scenario = with_units(loaded(*RICH), [{"lever_arm": ["0.3 m", "0 m", "0 m"]}, TURNED, {"axes": [[1, 1, 1]]}])
    prepared_case = prepare_hop(scenario)
    forward, backward = covariance(prepared_case), adjoint(prepared_case, 30.0)
    by_source = backward.contribution.sum(axis=2)
    assert by_source == pytest.approx(forward.budget[-1, :, :9].T, rel=1e-6, abs=1e-9 * by_source.max())


@pytest.mark.parametrize("n", [2, 3])
def test_random_walks_and_biases_of_n_like_triads_fall_with_the_root_of_n(n):
    cov = of_units([TURNED] * n, {"random_walk": "1e-5 rad/s**0.5"}, {"bias_repeatability": "0.01 m/s**2"})
    root = math.sqrt(n)
    assert cov.true_sigma[-1, 0] == pytest.approx(1e-5 * SECONDS**0.5 / root, rel=1e-6)
    assert cov.true_sigma[-1, 3] == pytest.approx(0.01 * SECONDS / root, rel=1e-6)


@pytest.mark.parametrize("axes", [cone(4), cone(6), DODECAHEDRON], ids=["tetrad", "hexad", "dodecahedron"])
def test_random_walks_and_biases_of_n_skewed_axes_fall_with_the_root_of_n_over_three(axes):
    root = math.sqrt(len(axes) / 3.0)
    for units in ([{"axes": axes}], [{"axes": [axis]} for axis in axes]):
        cov = of_units(units, {"random_walk": "1e-5 rad/s**0.5"}, {"bias_repeatability": "0.01 m/s**2"})
        assert cov.true_sigma[-1, :3] == pytest.approx(np.full(3, 1e-5 * SECONDS**0.5 / root), rel=1e-6)
        assert cov.true_sigma[-1, 3] == pytest.approx(0.01 * SECONDS / root, rel=1e-6)


def test_a_scale_factor_of_a_turned_unit_acts_along_its_axes():
    """One unit turned by 45 deg about z: k1, k2 along (1, 1) and (-1, 1) give (k1 + k2) / 2 along, half across."""
    cov = of_units([{"orientation": ["0 deg", "0 deg", "45 deg"]}], accel={"scale_factor": "500 ppm"})
    assert cov.true_sigma[-1, 3:5] == pytest.approx(np.full(2, 5e-4 * DELTA_V * math.sqrt(0.5)), rel=1e-6)


def test_a_good_unit_beside_a_cheap_one_gains_little_and_equal_weights_lose():
    """Weights by noise: 1 / (1 / s1^2 + 1 / s2^2); equal ones: (s1^2 + s2^2) / 4."""
    cheap = {"gyro": {"random_walk": "1e-4 rad/s**0.5"}}
    for weights, variance in (("random_walk", 1.0 / (1e10 + 1e8)), ("equal", 0.25 * (1e-10 + 1e-8))):
        cov = of_units([{}, cheap], {"random_walk": "1e-5 rad/s**0.5"}, weights=weights)
        assert cov.true_sigma[-1, 0] == pytest.approx(math.sqrt(variance * SECONDS), rel=1e-6)
        assert {"unit 1 gyro random walk", "unit 2 gyro random walk"} <= set(cov.sources)


def test_sources_of_a_unit_are_found_in_its_card():
    scenario = with_units(loaded(INERTIAL, "base.imu=imu/tactical_fog"), [{}, TURNED])
    found = scale_source(scenario, "unit 2 gyro scale factor", 3.0)
    first, second = found.imu.units
    assert second.gyro.scale_factor == pytest.approx(3.0 * first.gyro.scale_factor)


def test_the_state_of_a_fused_bias_has_the_error_of_the_sum():
    """Matched filter of two unlike units at rest in nothing: formal and true sigma of the biases agree at the start."""
    other = {"gyro": {"random_walk": "0.1 deg/sqrt(h)", "bias_repeatability": "5 deg/h"}, **TURNED}
    scenario = with_units(loaded("base.imu=imu/tactical_fog_matched", "base.filter=filters/tight"), [{}, other])
    cov = covariance(prepare_hop(scenario))
    assert cov.true_sigma[0, 9:15] == pytest.approx(cov.formal_sigma[0, 9:15], rel=1e-9)
    assert cov.true_sigma[-1, :15] == pytest.approx(cov.formal_sigma[-1, :15], rel=0.02)
