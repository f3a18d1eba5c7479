"""The truth in numbers for the linear covariance: sources, what matches the filter's states, where it starts."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lvnav_trade.engines.truth import REMAINDER, initial_cross, source_names, start_sources, true_model
from tests.building import INERTIAL, LOOSE, MATCHED, case, loaded, prepare_hop, with_fields


def model(prepared):
    return true_model(prepared, source_names(prepared))


def test_sources_are_physical_causes_each_named_once():
    names = source_names(case())
    assert len(set(names)) == len(names)
    assert "gyro misalignment" in names  # two blocks of parameters, one cause
    assert {"pseudorange noise", "range-rate noise", "receiver clock", "receiver clock start"} <= set(names)


def test_every_coupling_names_its_own_measurement_noise():
    loose, unaided = set(source_names(case(LOOSE))), set(source_names(case(INERTIAL)))
    assert {"position solution noise", "velocity solution noise"} <= loose
    assert "receiver clock" not in loose
    assert not any("noise" in name for name in unaided)


def test_true_parameters_match_the_filters_state_of_the_same_driver_or_none():
    true = model(case(MATCHED))
    assert set(true.matched) == {9, 12}
    assert (model(case()).matched == -1).any()


def test_the_estimate_starts_at_zero_so_error_and_parameter_are_the_same_thing():
    prepared = case(MATCHED)
    true = model(prepared)
    cross, variance = initial_cross(prepared, true)
    sources = start_sources(true, cross)
    total = sources.sum(axis=0)
    for j in np.flatnonzero(true.start > 0.0):
        at = true.matched[j]
        np.testing.assert_array_equal(np.diag(cross[j, :, at : at + 3]), variance[j])
        assert np.all(np.diag(total)[at : at + 3] >= true.start[j])
    # a matched filter believes just that
    np.testing.assert_allclose(np.diag(total), np.diag(prepared.start.P), rtol=1e-12)


@pytest.mark.parametrize("seconds", [0.1, 0.05])
def test_a_true_process_keeps_its_variance_over_windows(seconds):
    scenario = loaded()
    imu = with_fields(scenario.imu, **{"gyro.bias_instability": "2 deg/h", "gyro.instability_time": "3 s"})
    card = with_fields(scenario.filter, covariance_rate=f"{1.0 / seconds} Hz")
    prepared = prepare_hop(scenario.model_copy(update={"imu": imu, "filter": card}))
    true, length = model(prepared), int(np.argmin(np.abs(prepared.lengths - seconds)))
    j = [b.source for b in prepared.sources].index("gyro bias instability")
    sigma2 = (2.0 * math.radians(1.0) / 3600.0) ** 2
    assert true.start[j] == pytest.approx(sigma2, rel=1e-12)
    assert true.fade[length, j] == pytest.approx(math.exp(-seconds / 3.0), rel=1e-12)
    kept = true.fade[length, j] ** 2 * sigma2 + true.wander[length, j]
    assert kept == pytest.approx(sigma2, rel=1e-12)


def test_what_quantisation_holds_back_is_drawn_anew_in_every_window():
    scenario = loaded()
    imu = with_fields(scenario.imu, **{"gyro.quantisation": "1e-5 rad"})
    prepared = prepare_hop(scenario.model_copy(update={"imu": imu}))
    true = model(prepared)
    j = int(np.flatnonzero(true.driver == REMAINDER)[0])
    moving = prepared.lengths > 0.0
    np.testing.assert_array_equal(true.fade[:, j], np.where(moving, 0.0, 1.0))
    np.testing.assert_allclose(true.wander[moving, j], 1e-10 / 12.0, rtol=1e-12)
