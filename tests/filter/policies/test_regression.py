"""Measurement rows by regression over sigma points."""

from __future__ import annotations

import numpy as np

from lvnav_trade.filter.ekf import fill_receiver, place_antenna
from lvnav_trade.filter.policies.regression import clear_residual_variance, regress_receiver
from lvnav_trade.simulation.epoch.filter_case import OptionalState, case_of
from lvnav_trade.simulation.montecarlo import new_work
from tests.building import LOOSE, loaded, prepare_hop, with_fields

EPOCH = 3


def test_the_slope_of_a_linear_measurement_is_its_jacobian_and_explains_all():
    scenario = loaded(LOOSE)
    card = with_fields(scenario.filter, algorithm="unscented")
    prepared_case = prepare_hop(scenario.model_copy(update={"filter": card}))
    work, optional_state = new_work(prepared_case, False)
    work.nav[:] = prepared_case.initial_state.nav
    work.P[:] = prepared_case.initial_state.P
    place_antenna(work, None, None, prepared_case.model, prepared_case.unit.dt, EPOCH)
    work.solution[:] = work.antenna[0, :6] + 0.5
    fill_receiver(work, None, None, prepared_case.model, prepared_case.signals, EPOCH)
    jacobian, innovation = work.H[:6, :9].copy(), work.z.copy()
    regress_receiver(work, OptionalState(), case_of(prepared_case), optional_state.sigma_points, EPOCH)
    np.testing.assert_allclose(work.H[:6, :9], jacobian, rtol=0, atol=1e-6)
    np.testing.assert_allclose(work.z, innovation, rtol=0, atol=1e-6)
    np.testing.assert_allclose(optional_state.sigma_points.residual_variance[:6], 0.0, atol=1e-12)
    optional_state.sigma_points.residual_variance[:] = 1.0
    clear_residual_variance(optional_state.sigma_points, 0, 6)
    assert not optional_state.sigma_points.residual_variance[:6].any()
