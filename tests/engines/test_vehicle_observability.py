"""What samples, attitude reference and receiver tell of the 24 states."""

from __future__ import annotations

import numpy as np

from lvnav_trade.engines.covariances import covariance
from lvnav_trade.engines.explain import explain
from lvnav_trade.engines.vehicle_observability import observability
from lvnav_trade.records import Asked
from tests.engines.modelled import BASELINE, modelled


def test_rate_and_acceleration_add_six_observable_directions_to_the_baseline():
    edges = np.array([0.0, 20.0, 30.0])
    ours, base = observability(modelled(), edges), observability(modelled(BASELINE), edges)
    for with_model, without in zip(ours, base, strict=True):
        assert with_model.rank == without.rank + 6
        assert with_model.singular.size == 24
        # numerically every direction is seen: none is lost to rounding
        assert with_model.singular[-1] > 1e-10 * with_model.singular[0]
    assert ours[0].rows == 20 * (200 * 6 + 9)


def test_a_position_bias_without_a_time_constant_cannot_be_told_from_position():
    constant = modelled(**{"receiver__solution__bias_time": "1e15 s"})
    found = observability(constant, np.array([0.0, 20.0]))[0]
    assert np.sum(found.singular < 1e-10 * found.singular[0]) == 3


def test_an_explanation_holds_the_windows_that_were_asked_for():
    prepared = modelled()
    found = explain(prepared.scenario, prepared, covariance(prepared), Asked(window=10.0))
    assert [phase.name for phase in found.phases] == ["0 s to 10 s", "10 s to 20 s", "20 s to 30 s"]
    assert found.adjoint is None
