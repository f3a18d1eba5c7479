"""The nonlinearity index: second order in the errors, nought where all is linear."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.covariance.diagnostics.case_diagnostics import _nonlinearities
from lvnav_trade.covariance.diagnostics.nonlinearity import nonlinearity
from lvnav_trade.covariance.history import covariance
from lvnav_trade.kernels.attitude import matrix
from lvnav_trade.kernels.transition import ATT, POS, VEL
from lvnav_trade.simulation.montecarlo import run_block
from tests.building import LOOSE, MATCHED, case, loaded, prepare_hop, with_fields


@pytest.mark.parametrize("settings", [(), (LOOSE,)])
def test_half_the_error_has_half_the_index(settings):
    """The remainder is quadratic, so per sigma it is proportional to the error: a quarter of the remainder at half."""
    prepared_case = case(*settings)
    history = covariance(prepared_case)
    whole, half = (nonlinearity(prepared_case, history, 15.0, scale) for scale in (1.0, 0.5))
    assert whole.motion > 1e-6
    assert half.motion / whole.motion == pytest.approx(0.5, rel=0.01)
    assert half.state == whole.state


def test_the_curvature_of_a_range_is_half_the_square_over_the_distance():
    """A position error d across the line of sight changes a range of R by d^2 / 2R, one of 20 000 km by 2.5e-2 m for
    1 km; the innovation's sigma is at least the noise of 2 m.
    """
    prepared_case = case()
    history = covariance(prepared_case)
    true = history.true_cov.copy()
    true[:] = 0.0
    true[:, range(POS, POS + 3), range(POS, POS + 3)] = 1e6
    found = nonlinearity(prepared_case, history._replace(true_cov=true), 15.0)
    assert 0.5e6 / 2.7e7 / 2.6 < found.rows < 0.5e6 / 2.0e7 / 2.0


def test_rows_that_the_filter_does_not_take_have_no_part_in_the_index():
    """Velocity errors of 500 m/s bend range rates by a tenth of their sigma. To ranges they are nothing: the curvature
    of a filter that takes no range rates is that of position errors of 1 km.
    """
    prepared_case = case("base.filter.measurements=[pseudorange]")
    history, navigation = covariance(prepared_case), slice(VEL, VEL + 6)
    true = np.zeros_like(history.true_cov)
    sigma, correlation = np.repeat([500.0, 1e3], 3), np.kron([[1.0, 0.99], [0.99, 1.0]], np.eye(3))
    true[:, navigation, navigation] = correlation * np.outer(sigma, sigma)
    found = nonlinearity(prepared_case, history._replace(true_cov=true), 15.0)
    assert 0.98 * 0.5e6 / 2.7e7 / 2.6 < found.rows < 0.5e6 / 2.0e7 / 2.0


def test_without_measurements_there_is_no_row():
    prepared_case = case("base.filter=filters/inertial")
    assert np.isnan(nonlinearity(prepared_case, covariance(prepared_case), 10.0).rows)


def test_over_a_gap_a_tilt_turns_the_specific_force_to_second_order():
    """A tilt d about one axis takes f (1 - cos d) = f d^2 / 2 off the specific force along the others."""
    prepared_case = case()
    history = covariance(prepared_case)
    tilt, begin, end = 0.1, 5.0, 15.0
    true = np.zeros_like(history.true_cov)
    true[:, range(ATT, ATT + 3), range(ATT, ATT + 3)] = tilt**2
    formal = np.zeros_like(true)
    formal[:, range(15), range(15)] = 1.0
    found = nonlinearity(prepared_case, history._replace(true_cov=true, formal_cov=formal), begin, end=end)
    ticks = slice(*(int(np.argmin(np.abs(prepared_case.reference.t - t))) for t in (begin, end)))
    turned = [
        np.reshape(matrix(*q), (3, 3)) @ dv
        for q, dv in zip(prepared_case.reference.q_b_i[ticks], prepared_case.reference.dvel[ticks], strict=True)
    ]
    force = np.abs(np.sum(turned, axis=0)).max() / (end - begin)
    assert found.time == end
    position = 0.5 * force * 0.5 * tilt**2 * (end - begin) ** 2
    assert found.motion == pytest.approx(position, rel=0.05)


def opened(tilt):
    """Return the short flight of an open loop whose initial attitude has a sigma on every axis."""
    scenario = loaded(MATCHED)
    card, start = with_fields(scenario.filter, feedback="open"), {"tilt": tilt, "heading": tilt}
    initial = with_fields(scenario.initial, **start)
    return prepare_hop(scenario.model_copy(update={"filter": card, "initial": initial}))


@pytest.mark.parametrize(("tilt", "linear"), [("0.1 deg", True), ("1 deg", False), ("3 deg", False)])
def test_an_open_loop_is_beyond_linearity_where_runs_and_linear_covariance_disagree(tilt, linear):
    """The second order of the INS grows over the whole flight; that of one update interval is 1e-5 in all of them."""
    prepared_case = opened(tilt)
    history, end = covariance(prepared_case), float(prepared_case.t_hist[-1])
    errors = run_block(prepared_case, 3, 0, 200).err[:, -1, :9]
    ratio = np.sqrt(np.mean(errors**2, axis=0)) / np.hypot(history.true_sigma[-1, :9], history.mean[-1, :9])
    ((_, found),) = _nonlinearities(prepared_case, history, {"end": end})
    assert nonlinearity(prepared_case, history, end).motion < 1e-4
    if linear:
        assert ratio.max() < 1.2
        assert found.motion < 0.1
    else:
        assert ratio.max() > 2.0
        assert 0.5 < found.motion / ratio.max() < 2.0
    assert found.time == end


def test_the_index_stays_small_where_overlapping_changes_of_latency_move_the_mean_by_many_sigmas():
    """The index is about the errors that covariance spreads. What both changes together move the mean by is no part of
    it: the report says that it does not apply there.
    """
    faults = [
        {"kind": "latency_change", "by": "80 ms", "start": start, "duration": "12 s"} for start in ("8 s", "10 s")
    ]
    prepared_case = prepare_hop(with_fields(loaded(), faults=faults))
    history = covariance(prepared_case)
    at = int(np.argmin(np.abs(prepared_case.t_hist - 15.0)))
    found = nonlinearity(prepared_case, history, 15.0)
    assert np.max(np.abs(history.mean[at, :9]) / history.formal_sigma[at, :9]) > 100.0
    assert max(found.motion, found.transition, found.rows) < 1e-3
