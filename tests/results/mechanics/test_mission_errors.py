"""Errors of the mission's numbers against closed forms and draws."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.kernels.earth import GM, OMEGA
from lvnav_trade.quantities.frames import (
    ecef_from_geodetic,
    eci_from_ecef,
    elements_from_state,
    rotation_e_n,
    unit,
)
from lvnav_trade.results.evaluate import errors_at
from lvnav_trade.results.mechanics import mission_errors, orbits, stored_states
from lvnav_trade.results.metrics.mission import MISSION, mean_and_covariance_at
from lvnav_trade.results.statistics.case_tables import CaseTables
from lvnav_trade.results.tables.read import load
from tests import mission as flights
from tests import synthetic


@pytest.fixture(scope="module")
def orbit(tmp_path_factory):
    return load(flights.results(tmp_path_factory.mktemp("orbit"), failing=(3,)))


@pytest.fixture(scope="module")
def circular(tmp_path_factory):
    return load(flights.results(tmp_path_factory.mktemp("circular"), flights.CIRCULAR, n_run=0))


@pytest.fixture(scope="module")
def fall(tmp_path_factory):
    return load(flights.results(tmp_path_factory.mktemp("fall"), falling()))


def falling():
    r_e = ecef_from_geodetic(np.radians(30.0), 0.5, 120e3)
    v_e = rotation_e_n(np.radians(30.0), 0.5).T @ np.array([1200.0, 700.0, -900.0])
    theta = OMEGA * synthetic.EVENTS["injection"]
    r_i, v_i = eci_from_ecef(r_e, theta), eci_from_ecef(v_e, theta)
    return r_i, v_i + np.cross([0.0, 0.0, OMEGA], r_i)


def state_of(tables):
    return stored_states.state_at(tables, flights.CASE, "injection")


def test_a_bias_is_resolved_to_a_millionth_of_its_sigma():
    bias, sigma = np.array([1e-15, -1e-15, 0.1234567, -3.0]), np.array([2.0, 2.0, 1.0, 0.0])
    found = mission_errors.round_bias(bias, sigma)
    np.testing.assert_array_equal(found[:2], 0.0)
    assert not np.signbit(found[:2]).any()
    np.testing.assert_allclose(found[2:], [0.123457, -3.0], rtol=1e-12)


def test_the_semi_major_axis_follows_vis_viva(orbit):
    """da = 2 a^2 v dv / mu along the velocity, 2 a^2 dr / r^2 along the radius; J2 changes it by a thousandth."""
    state = state_of(orbit)
    a = float(orbits.osculating(state.r_i, state.v_i).semi_major_axis)
    slope = mission_errors.jacobian(state, "semi_major_axis_error")[0]
    v, r = np.linalg.norm(state.v_i), np.linalg.norm(state.r_i)
    expected = np.concatenate([2.0 * a**2 * state.v_i / GM, 2.0 * a**2 * state.r_i / r**3])
    np.testing.assert_allclose(
        slope * mission_errors.STEP, expected * mission_errors.STEP, atol=5e-3 * 2.0 * a**2 * v / GM * 1e-2
    )
    assert slope @ np.concatenate([unit(state.v_i), np.zeros(3)]) == pytest.approx(2.0 * a**2 * v / GM, rel=5e-3)


def test_the_plane_turns_by_the_out_of_plane_velocity_over_the_speed(orbit):
    """di = cos(u) dv / (h / r), dnode = sin(u) dv / (h / r sin i), u the argument of latitude."""
    state, elements = state_of(orbit), flights.SUN_SYNCHRONOUS
    u = elements.perigee_argument + elements.true_anomaly
    h_i = np.cross(state.r_i, state.v_i)
    push = np.concatenate([unit(h_i), np.zeros(3)]) * np.linalg.norm(h_i) / np.linalg.norm(state.r_i)
    tilt, turn = (
        float((mission_errors.jacobian(state, f"{name}_error") @ push)[0]) for name in ("inclination", "node")
    )
    assert tilt == pytest.approx(np.cos(u), abs=5e-3)
    assert turn == pytest.approx(np.sin(u) / np.sin(elements.inclination), abs=5e-3)


@pytest.fixture(scope="module")
def drawn(orbit):
    state, law = state_of(orbit), stored_states.law_at(orbit, flights.CASE, "injection")
    errors = np.random.default_rng(5).multivariate_normal(law.mean, law.true, 100_000)
    parts = [mission_errors.orbit_errors(state, part) for part in np.array_split(errors, 50)]
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


@pytest.mark.parametrize("metric", [name for name in MISSION if "correction" not in name and "impact" not in name])
def test_the_first_order_covariance_is_that_of_many_draws(orbit, drawn, metric):
    found = drawn[metric] if drawn[metric].ndim == 2 else drawn[metric][:, None]
    mean, covariance = mean_and_covariance_at(CaseTables(orbit, flights.CASE), "injection", metric)
    sigma = np.sqrt(np.diag(covariance))
    np.testing.assert_allclose(found.std(axis=0), sigma, rtol=0.015)  # 6 standard errors and the second order
    np.testing.assert_allclose(found.mean(axis=0), mean, atol=0.02 * sigma.max())


def test_the_first_order_covariance_of_an_impact_is_that_of_many_draws(fall):
    state, law = state_of(fall), stored_states.law_at(fall, flights.CASE, "injection")
    drawn = np.random.default_rng(6).multivariate_normal(law.mean, law.true, 40_000)
    found = np.concatenate([mission_errors.impact_errors(state, part) for part in np.array_split(drawn, 20)])
    mean, covariance = mean_and_covariance_at(CaseTables(fall, flights.CASE), "injection", "impact_error")
    sigma = np.sqrt(np.diag(covariance))
    np.testing.assert_allclose(np.cov(found.T) / np.outer(sigma, sigma), covariance / np.outer(sigma, sigma), atol=0.03)
    np.testing.assert_allclose(found.mean(axis=0), mean, atol=0.03 * sigma.max())


def test_sobols_draws_have_the_mean_and_the_covariance(orbit):
    law = stored_states.law_at(orbit, flights.CASE, "injection")
    drawn = mission_errors.draws(law.mean, law.true)
    sigma = np.sqrt(np.diag(law.true))
    assert drawn.shape == (mission_errors.DRAWS, 6)
    np.testing.assert_allclose((drawn.mean(axis=0) - law.mean) / sigma, 0.0, atol=2e-3)
    np.testing.assert_allclose(np.cov(drawn.T) / np.outer(sigma, sigma), law.true / np.outer(sigma, sigma), atol=0.02)


def test_perigee_has_no_first_order_sigma_where_the_orbit_is_circular(circular, tmp_path):
    """The osculating orbit is circular, its mean is not (J2): only errors of a thousandth make it so."""
    assert mean_and_covariance_at(CaseTables(circular, flights.CASE), "injection", "perigee_error") is not None
    found = load(flights.results(tmp_path, flights.CIRCULAR, n_run=0, factor=40.0))
    reason = mean_and_covariance_at(CaseTables(found, flights.CASE), "injection", "perigee_error")
    assert isinstance(reason, str)
    assert reason.startswith("the orbit is circular to within 3 sigma")
    assert not isinstance(
        mean_and_covariance_at(CaseTables(found, flights.CASE), "injection", "eccentricity_vector_error"), str
    )
    assert not isinstance(
        mean_and_covariance_at(CaseTables(found, flights.CASE), "injection", "semi_major_axis_error"), str
    )


@pytest.mark.parametrize("metric", [name for name in MISSION if "impact" not in name])
def test_runs_have_errors_of_every_metric_and_a_failed_one_is_infinite(orbit, metric):
    found = errors_at(orbit, flights.CASE, "injection", metric)
    assert found.magnitude.shape == (200,)
    assert np.flatnonzero(np.isinf(found.magnitude)).tolist() == [3]
    assert found.unit == MISSION[metric].unit


def test_the_errors_of_runs_are_those_of_the_assumed_orbit(orbit):
    """Truth minus estimate, so the assumed state is truth minus error: energy by hand for one run."""
    state = state_of(orbit)
    error, _ = stored_states.run_errors(orbit, flights.CASE, state)
    row = orbit.runs[(orbit.runs.event == "injection") & (orbit.runs.run_number == 7)].iloc[0]
    north_east_down = row[[f"velocity_{axis}_error_m_per_s" for axis in ("north", "east", "down")]].to_numpy(float)
    np.testing.assert_allclose(error[7, :3], state.turn @ north_east_down, rtol=1e-12)
    believed = orbits.mean(state.r_i - error[7, 3:], state.v_i - error[7, :3])
    true = orbits.mean(state.r_i, state.v_i)
    size = errors_at(orbit, flights.CASE, "injection", "perigee_error").magnitude[7]
    assert size == pytest.approx(abs(float(true.perigee - believed.perigee)), rel=1e-12)


def test_a_flight_that_reaches_orbit_has_no_impact_and_a_fall_has_no_orbit(orbit, fall):
    assert np.isinf(errors_at(orbit, flights.CASE, "injection", "impact_error").magnitude).all()
    assert mean_and_covariance_at(CaseTables(orbit, flights.CASE), "injection", "impact_error") == "not defined there"
    assert np.isinf(errors_at(fall, flights.CASE, "injection", "perigee_error").magnitude).all()
    assert mean_and_covariance_at(CaseTables(fall, flights.CASE), "injection", "perigee_error") == "no closed orbit"
    assert errors_at(fall, flights.CASE, "injection", "impact_error_cross").magnitude.max() < 1e4


def test_a_correction_is_a_size_and_no_gaussian(orbit):
    found = mean_and_covariance_at(CaseTables(orbit, flights.CASE), "injection", "correction_delta_v")
    assert found == "a sum of impulses is no linear function of the error"
    size = errors_at(orbit, flights.CASE, "injection", "correction_delta_v").magnitude
    assert 0.0 < np.median(size) < 1.0


@pytest.mark.parametrize("is_mean", [True, False])
def test_errors_of_elements_at_epochs_are_those_of_flown_states(orbit, is_mean):
    """Another integrator, and osculating elements by their classical formulas; mean ones along the flown orbit."""
    state, error = state_of(orbit), np.array([[0.3, -0.2, 0.1, 5.0, -20.0, 10.0]])
    found = mission_errors.orbit_errors_at(state, error, mission_errors.ElementEpochs(is_mean, 30.0, 90.0))
    start = np.concatenate([state.r_i, state.v_i])
    shifted = start - error[0][[3, 4, 5, 0, 1, 2]]
    true, estimated = (
        flights.coast(one[:3], one[3:], np.array([0.0, t])).y[:, -1] for one, t in ((start, 90.0), (shifted, 30.0))
    )
    if is_mean:
        a, b = (orbits.mean(one[:3], one[3:]) for one in (true, estimated))
        expected = {name: float(getattr(a, name) - getattr(b, name)) for name in ("perigee", "apogee", "inclination")}
    else:
        a, b = (elements_from_state(one[:3], one[3:]) for one in (true, estimated))
        heights = [[k.semi_major_axis * (1.0 + s * k.eccentricity) for s in (-1.0, 1.0)] for k in (a, b)]
        expected = {"perigee": heights[0][0] - heights[1][0], "apogee": heights[0][1] - heights[1][1]}
        expected["inclination"] = a.inclination - b.inclination
    for name, value in expected.items():
        assert float(found[f"{name}_error"][0, 0]) == pytest.approx(float(value), rel=1e-3, abs=1e-9), name


def test_errors_of_elements_at_the_event_are_the_usual_ones(orbit):
    state, error = state_of(orbit), np.array([[0.3, -0.2, 0.1, 5.0, -20.0, 10.0], [0.0] * 6])
    usual, found = (
        mission_errors.orbit_errors(state, error),
        mission_errors.orbit_errors_at(state, error, mission_errors.ElementEpochs()),
    )
    assert usual.keys() == found.keys()
    for name, values in usual.items():
        np.testing.assert_allclose(found[name], values, rtol=1e-9, atol=1e-9)


def test_osculating_elements_swing_from_epoch_to_epoch_and_mean_ones_stay(orbit):
    """Kilometres of apogee in a minute by J2 alone, of a state without errors."""
    state, nothing = state_of(orbit), np.zeros((1, 6))
    swing, stay = (
        float(
            mission_errors.orbit_errors_at(state, nothing, mission_errors.ElementEpochs(is_mean, 0.0, 60.0))[
                "apogee_error"
            ][0, 0]
        )
        for is_mean in (False, True)
    )
    assert abs(swing) > 200.0
    assert abs(stay) < 0.05 * abs(swing)
