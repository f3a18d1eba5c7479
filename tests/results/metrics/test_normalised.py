"""Errors in the filter's own sigmas as requirements state them."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from lvnav_trade.campaign.definition.schema import Requirement
from lvnav_trade.results.metric import NO_LAW
from lvnav_trade.results.registry import find
from lvnav_trade.results.requirements.confirmation import expected_verdicts, verdicts
from lvnav_trade.results.statistics.case_tables import CaseTables
from lvnav_trade.results.statistics.select import errors_by_axis
from lvnav_trade.results.tables.read import Tables
from tests import synthetic

CASE = "aaaaaaaaaaaa"
STATED = {"name": "realism", "at": "injection", "probability": 0.95, "confidence": 0.9}


def asking(tables: Tables, metric: str, below: str) -> Tables:
    """Return results of a campaign with one requirement on consistency."""
    stated = Requirement.model_validate({**STATED, "metric": metric, "below": below}).model_dump(mode="json")
    found = tables.with_frames()
    found.__dict__["campaign"] = {**tables.campaign, "requirements": [stated]}
    return found


def test_the_normalised_error_of_a_run_is_the_root_of_its_nees_per_axis(good):
    found = find("normalised_attitude_error").errors(CaseTables(good, CASE), STATED)
    assert found is not None
    errors = errors_by_axis(good, CASE, "injection", "attitude")
    sigma = synthetic.SIGMA[:3] * (1.0 + 0.01 * synthetic.EVENTS["injection"])
    size = np.sqrt(np.mean((errors.drop(columns="failure").to_numpy() / sigma) ** 2, axis=1))
    lost = (errors.failure != "").to_numpy()
    assert found.magnitude[~lost] == pytest.approx(size[~lost], rel=1e-9)
    assert np.isinf(found.magnitude[lost]).all()
    assert lost.sum() == 1
    assert found.unit == "sigma"


@pytest.mark.parametrize("bound", [1.2, 1.62, 2.2])
def test_linear_covariance_expects_the_chi_square_of_a_consistent_filter(good, bound):
    """Attitude has no mean and the filter's covariance is the true one: three times the square is chi-square, 3."""
    row = expected_verdicts(asking(good, "normalised_attitude_error", f"{bound} sigma")).iloc[0]
    assert row.expected_probability == pytest.approx(stats.chi2.cdf(3.0 * bound**2, 3), abs=1e-8)
    assert row.estimate == pytest.approx(np.sqrt(stats.chi2.ppf(0.95, 3) / 3.0), rel=1e-6)


def test_a_consistent_filter_meets_the_requirement_and_an_overconfident_one_violates_it(good, wrong):
    """Of errors 1.6 times the sigma 44 % are below the limit that 99 % of a consistent filter's are below."""
    limit = f"{np.sqrt(stats.chi2.ppf(0.99, 3) / 3.0):.4f} sigma"
    for tables, verdict in ((good, "met"), (wrong, "violated")):
        found = verdicts(asking(tables, "normalised_attitude_error", limit))
        assert set(found.verdict) == {verdict}
        assert set(found.unit) == {"sigma"}
        assert set(found.by) == {"runs"}


def test_a_covariance_without_an_inverse_has_no_normalised_error(good):
    rows = good.covariances
    found = good.with_frames(covariances=rows.assign(formal_si2=0.0 * rows.formal_si2))
    metric = find("normalised_velocity_error")
    assert metric.errors(CaseTables(found, CASE), STATED) is None
    assert metric.distribution(CaseTables(found, CASE), STATED) == NO_LAW


def test_a_normalised_error_is_of_an_event_and_has_its_own_unit():
    stated = {"name": "a", "metric": "normalised_position_error", "probability": 0.9}
    with pytest.raises(ValueError, match="compared with the filter's covariance at an event"):
        Requirement.model_validate({**stated, "below": "2 sigma", "during": "flight"})
    with pytest.raises(ValueError, match="wrong unit; expected sigma"):
        Requirement.model_validate({**stated, "below": "2 m"})


def test_its_root_mean_square_is_one_by_the_filter_and_that_of_the_errors_by_the_others(good):
    found = find("normalised_attitude_error").value(good, CASE, STATED, "-")
    assert (found.formal, found.true) == (1.0, pytest.approx(1.0, rel=1e-9))  # attitude has no mean
    sound = found.runs[np.isfinite(found.runs)]
    assert np.sqrt(sound.mean()) == pytest.approx(1.0, rel=0.06)  # 199 runs of three axes
    assert find("normalised_attitude_error").value(good, CASE, {"at": "touchdown"}, "-").remark
