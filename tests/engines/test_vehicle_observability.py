"""What samples, attitude reference and receiver tell of the 24 states."""

from __future__ import annotations

import numpy as np

from lvnav_trade.engines.lincov.history import covariance
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
    # What is left are the gradient of gravity and the rounding of a position's own drift: next to nothing in 20 s.
    told = [_apart(modelled(**{"receiver__solution__bias_time": time})) for time in ("60 s", "1e15 s")]
    assert told[0] > 0.1
    assert told[1] < 0.02 * told[0]


def _apart(prepared):
    """The largest singular value among directions in which a position's bias replaces the position."""
    found = observability(prepared, np.array([0.0, 20.0]))[0]
    position, bias = slice(6, 9), slice(15, 18)
    told = [
        value
        for value, d in zip(found.singular, found.directions, strict=True)
        if np.abs(d[position]).max() > 0.5 and np.abs(d[bias]).max() > 0.5 and d[position] @ d[bias] < 0.0
    ]
    assert len(told) == 3
    return max(told)


def test_an_explanation_holds_the_windows_that_were_asked_for():
    prepared = modelled()
    found = explain(prepared.scenario, prepared, covariance(prepared), Asked(window=10.0))
    assert [phase.name for phase in found.phases] == ["0 s to 10 s", "10 s to 20 s", "20 s to 30 s"]
    assert found.adjoint is None
