"""Errors of the mission as metrics: needs and units."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.results.evaluate import evaluate
from lvnav_trade.results.mechanics.mission_errors import ElementEpochs
from lvnav_trade.results.metrics.mission import (
    MISSION,
    epochs_of,
    magnitude_sample_at,
    mean_and_covariance_at,
    sizes_at,
)
from lvnav_trade.results.statistics.case_tables import CaseTables
from lvnav_trade.results.tables.read import load
from tests import mission as flights

PERIGEE = {"metric": "perigee_error", "at": "injection"}


@pytest.fixture(scope="module")
def orbit(tmp_path_factory):
    return load(flights.results(tmp_path_factory.mktemp("orbit"), n_run=40, failing=(3,)))


def test_the_value_is_the_root_mean_square_of_the_sizes_of_the_runs(orbit):
    size = sizes_at(CaseTables(orbit, flights.CASE), "injection", "perigee_error")
    assert np.flatnonzero(np.isinf(size)).tolist() == [3]
    found = evaluate(orbit, flights.CASE, PERIGEE, "km")
    np.testing.assert_allclose(np.sqrt(found.runs), size / 1e3, rtol=1e-15)
    assert evaluate(orbit, flights.CASE, PERIGEE, "s").remark == "unit s does not fit"
    assert evaluate(orbit, flights.CASE, {**PERIGEE, "at": "touchdown"}, "km").remark == "not among our results"


def test_the_law_is_the_first_order_gaussian_or_says_why_there_is_none(orbit):
    case = CaseTables(orbit, flights.CASE)
    mean, covariance = mean_and_covariance_at(case, "injection", "perigee_error")
    found = MISSION["perigee_error"].distribution(case, PERIGEE)
    assert (found.label_unit, found.label_factor, found.event_or_time) == ("km", 1e-3, "injection")
    assert (found.law.mean.tolist(), found.law.covariance.tolist()) == (mean.tolist(), covariance.tolist())
    correction = MISSION["correction_delta_v"].distribution(case, {"at": "injection"})
    assert correction == "a sum of impulses is no linear function of the error"
    assert magnitude_sample_at(case, "injection", "inclination_error") is None


def test_a_statement_chooses_kind_and_epochs_of_the_elements(orbit):
    later = {**PERIGEE, "elements": "osculating", "epoch": "30 s", "reference_epoch": "90 s"}
    assert epochs_of(PERIGEE) == ElementEpochs()
    assert (
        epochs_of(later)
        == epochs_of({**later, "epoch": 30.0, "reference_epoch": 90.0})
        == ElementEpochs(False, 30.0, 90.0)
    )
    assert epochs_of({"epoch": "30 s"}) == ElementEpochs(True, 30.0, 30.0)
    case = CaseTables(orbit, flights.CASE)
    size = sizes_at(case, "injection", "perigee_error", ElementEpochs(False, 30.0, 90.0))
    np.testing.assert_allclose(np.sqrt(evaluate(orbit, flights.CASE, later, "km").runs), size / 1e3, rtol=1e-15)
    assert np.flatnonzero(np.isinf(size)).tolist() == [3]
    label = MISSION["perigee_error"].label
    assert label(PERIGEE) == "perigee_error at injection"
    assert label(later) == "perigee_error at injection + 30 s, osculating, true elements at + 90 s"
    assert [one.name for one in MISSION.values() if not one.has_epoch] == [
        "correction_delta_v", "impact_error", "impact_error_down", "impact_error_cross"
    ]  # fmt: skip
