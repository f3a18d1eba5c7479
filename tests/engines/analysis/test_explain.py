"""What is behind a case's linear covariance adds up to it."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest

from lvnav_trade.engines.analysis import explain as room
from lvnav_trade.engines.analysis.explain import explain
from lvnav_trade.engines.analysis.retune import FACTORS
from lvnav_trade.engines.lincov.history import covariance
from lvnav_trade.records import Asked
from tests.building import case, flying, hop


@lru_cache(maxsize=1)
def found():
    prepared = case()
    history = covariance(prepared)
    asked = Asked(at="end1", events=("end0", "end1"))
    return prepared, history, explain(prepared.scenario, prepared, history, asked)


def test_covariances_by_source_sum_to_the_true_one_off_the_diagonal_too():
    prepared, history, what = found()
    assert [part.event for part in what.by_source] == ["end1", "end0"]
    for part in what.by_source:
        at = int(np.argmin(np.abs(history.t - prepared.trajectory.events[part.event])))
        for q in range(3):
            true = history.true_cov[at][3 * q : 3 * q + 3, 3 * q : 3 * q + 3]
            np.testing.assert_allclose(part.covariance[:, q].sum(axis=0), true, atol=1e-9 * np.trace(true))


def test_the_covariance_of_every_source_is_positive():
    for part in found()[2].by_source:
        for block in part.covariance.reshape(-1, 3, 3):
            assert np.linalg.eigvalsh(block).min() >= -1e-9 * np.trace(block)


def test_the_adjoint_is_of_the_event_that_was_asked_for():
    prepared, history, what = found()
    assert what.adjoint.time == pytest.approx(prepared.trajectory.events["end1"], abs=1e-9)
    at = int(np.argmin(np.abs(history.t - what.adjoint.time)))
    total = what.adjoint.contribution.sum(axis=(1, 2))
    np.testing.assert_allclose(total, history.true_sigma[at, :9] ** 2, rtol=1e-9)


def test_phases_lie_between_events_and_cover_the_flight():
    prepared, _, what = found()
    assert [phase.name for phase in what.phases] == ["start to end0", "end0 to end1"]
    assert what.phases[0].start == prepared.reference.t[0]
    assert all(np.all(np.diff(phase.singular) <= 0.0) for phase in what.phases)
    assert all(phase.weakest for phase in what.phases)


def test_a_direction_of_a_state_without_an_initial_sigma_is_reported_all_the_same():
    prepared = found()[0]
    P = prepared.start.P.copy()
    P[-1, :] = P[:, -1] = 0.0
    known = prepared._replace(start=prepared.start._replace(P=P))
    assert room._in_words(known, 0.0, np.eye(P.shape[0])[-1]).startswith("+1.00 ")


def test_every_event_has_its_nonlinearity():
    assert [name for name, _ in found()[2].nonlinear] == ["liftoff", "end0", "end1"]


def test_what_is_not_asked_for_is_not_computed():
    prepared, history, _ = found()
    what = explain(prepared.scenario, prepared, history, Asked(adjoint=False, observability=False))
    assert (what.adjoint, what.by_source, what.sensitivity, what.phases) == (None, (), (), ())
    assert what.event == "end1"  # no injection: the last event


def test_three_quantities_share_their_covariances_and_a_factor_of_one_changes_nothing(monkeypatch):
    prepared, history, _ = found()
    calls = []

    def counted(again):
        calls.append(again)
        return covariance(again)

    monkeypatch.setattr("lvnav_trade.engines.analysis.retune.covariance", counted)
    with flying(hop()):
        what = explain(prepared.scenario, prepared, history, Asked(sensitivity=True, observability=False))
    assert [part.quantity for part in what.sensitivity] == ["attitude", "velocity", "position"]
    sources = {source for part in what.sensitivity for source in part.sources}
    assert len(calls) == len(sources) * (len(FACTORS) - 1)
    for part in what.sensitivity:
        np.testing.assert_allclose(part.frozen[:, 2], part.retuned[:, 2], rtol=1e-9)
