"""Measurement rows by regression over sigma points."""

from __future__ import annotations

import numpy as np

from lvnav_trade.filter.ekf import fill_receiver, place_antenna
from lvnav_trade.filter.policies.regression import clear_spread, regress_receiver
from lvnav_trade.simulation.epoch.filter_case import OptionalState, case_of
from lvnav_trade.simulation.montecarlo import new_work
from tests.building import LOOSE, loaded, prepare_hop, with_fields

EPOCH = 3


def test_the_slope_of_a_linear_measurement_is_its_jacobian_and_explains_all():
    scenario = loaded(LOOSE)
    card = with_fields(scenario.filter, algorithm="unscented")
    prepared = prepare_hop(scenario.model_copy(update={"filter": card}))
    work, parts = new_work(prepared, False)
    work.nav[:] = prepared.start.nav
    work.P[:] = prepared.start.P
    place_antenna(work, None, None, prepared.model, prepared.unit.dt, EPOCH)
    work.solution[:] = work.antenna[0, :6] + 0.5
    fill_receiver(work, None, None, prepared.model, prepared.signals, EPOCH)
    jacobian, innovation = work.H[:6, :9].copy(), work.z.copy()
    regress_receiver(work, OptionalState(), case_of(prepared), parts.sigma_points, EPOCH)
    np.testing.assert_allclose(work.H[:6, :9], jacobian, rtol=0, atol=1e-6)
    np.testing.assert_allclose(work.z, innovation, rtol=0, atol=1e-6)
    np.testing.assert_allclose(parts.sigma_points.spread[:6], 0.0, atol=1e-12)
    parts.sigma_points.spread[:] = 1.0
    clear_spread(parts.sigma_points, 0, 6)
    assert not parts.sigma_points.spread[:6].any()
