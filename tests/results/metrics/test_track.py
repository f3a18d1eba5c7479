"""Velocity error along and across the track, against a rotated covariance and the runs by hand."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.campaign.definition.published_cards import MeasuredMetric
from lvnav_trade.campaign.definition.schema import Requirement
from lvnav_trade.results.evaluate import evaluate, evaluate_single
from lvnav_trade.results.mechanics.stored_states import State, run_errors, state_at
from lvnav_trade.results.registry import find
from lvnav_trade.results.requirements.confirmation import expected_verdicts, verdicts
from lvnav_trade.results.requirements.windows import unevaluated
from lvnav_trade.results.statistics.case_results import CaseResults, Gaussian
from lvnav_trade.results.statistics.case_tables import CaseTables
from lvnav_trade.results.tables.read import load
from tests import mission as flights

ALONG, ACROSS = {"metric": "velocity_along_track_error"}, {"metric": "velocity_across_track_error"}
SIGMA, MEAN, ANGLE = np.array([0.3, 0.1, 0.2]), np.array([0.02, -0.01, 0.05]), np.radians(30.0)


class Turned(CaseResults):
    """A case that flies along x of frame i at y = z = 0, reported in axes turned about z by an angle."""

    def axes(self, quantity):
        return ["a", "b", "c"]

    def state(self, event):
        c, s = np.cos(ANGLE), np.sin(ANGLE)
        turn = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])  # reporting axes to frame i
        return State(event, 0.0, np.array([0.0, 7e6, 0.0]), np.array([7.5e3, 0.0, 0.0]), 0.0, turn)

    def gaussian(self, event, quantity, axis):
        return Gaussian(MEAN, np.diag(SIGMA**2), {"gyro": np.diag([0.04, 0.0, 0.01])})


@pytest.fixture(scope="module")
def orbit(tmp_path_factory):
    return load(flights.results(tmp_path_factory.mktemp("track"), failing=(3,)))


def test_a_covariance_turned_by_an_angle_has_the_variance_of_the_textbook():
    c, s = np.cos(ANGLE), np.sin(ANGLE)
    law = find("velocity_along_track_error").distribution(Turned(), ALONG).law
    assert law.covariance[0, 0] == pytest.approx((c * 0.3) ** 2 + (s * 0.1) ** 2, rel=1e-14)
    assert law.mean[0] == pytest.approx(c * 0.02 + s * -0.01, rel=1e-14)
    assert law.sources["gyro"][0, 0] == pytest.approx(c**2 * 0.04, rel=1e-14)


def test_across_the_track_is_along_the_normal_of_position_and_velocity():
    law = find("velocity_across_track_error").distribution(Turned(), ACROSS).law
    assert law.covariance[0, 0] == pytest.approx(0.2**2, rel=1e-14)  # r x v is along minus z
    assert law.mean[0] == pytest.approx(-0.05, rel=1e-14)


def test_the_runs_have_the_components_of_their_errors_in_frame_i(orbit):
    state = state_at(orbit, flights.CASE, "injection")
    error, failed = run_errors(orbit, flights.CASE, state)
    along = error[:, :3] @ state.v_i / np.linalg.norm(state.v_i)
    normal = np.cross(state.r_i, state.v_i)
    across = error[:, :3] @ normal / np.linalg.norm(normal)
    for stated, component in ((ALONG, along), (ACROSS, across)):
        found = evaluate(orbit, flights.CASE, stated, "cm/s")
        np.testing.assert_allclose(np.sqrt(found.runs[~failed]), 100.0 * np.abs(component[~failed]), rtol=1e-9)
        assert np.isinf(found.runs[failed]).all()
        size = find(stated["metric"]).errors(CaseTables(orbit, flights.CASE), stated).magnitude
        np.testing.assert_allclose(size[~failed], np.abs(component[~failed]), rtol=1e-9)
        mean = evaluate(orbit, flights.CASE, {**stated, "statistic": "mean"}, "m/s")
        np.testing.assert_allclose(mean.runs[~failed], component[~failed], rtol=1e-9)


def test_linear_covariance_and_the_filter_have_the_size_of_the_runs(orbit):
    for stated in (ALONG, ACROSS):
        found = evaluate(orbit, flights.CASE, stated, "m/s")
        sound = found.runs[np.isfinite(found.runs)]
        assert np.sqrt(sound.mean()) == pytest.approx(found.true, rel=0.15)  # 199 runs: 5 % is one sigma
        formal, true = (
            evaluate_single(orbit, flights.CASE, {**stated, "statistic": name}, "m/s").value
            for name in ("formal", "lincov")
        )
        assert formal == pytest.approx(found.formal, rel=1e-12)
        assert true == pytest.approx(found.formal, rel=1e-9)  # the filter of these results assumes what is true
        assert true < found.true
    assert evaluate(orbit, flights.CASE, ALONG, "m").remark == "unit m does not fit"
    assert evaluate(orbit, flights.CASE, {**ALONG, "at": "touchdown"}, "m/s").remark == "not among our results"


def test_a_requirement_on_it_has_a_verdict_by_runs_and_by_linear_covariance(orbit):
    stated = {"name": "along", "probability": 0.9, "below": "1 m/s", **ALONG}
    found = orbit.with_frames()
    requirement = Requirement.model_validate(stated).model_dump(mode="json")
    found.__dict__["campaign"] = {**orbit.campaign, "requirements": [requirement]}
    law = find("velocity_along_track_error").distribution(CaseTables(orbit, flights.CASE), ALONG)
    assert expected_verdicts(found).estimate[0] == pytest.approx(1.65 * np.sqrt(law.law.covariance[0, 0]), rel=0.05)
    assert set(verdicts(found).verdict) == {"met"}
    assert unevaluated(found).reason.tolist() == ["the metric is known at events only"]


@pytest.mark.parametrize(
    ("card", "more", "message"),
    [
        (Requirement, {"during": "flight"}, "resolved along the true velocity at an event; give at"),
        (Requirement, {"window": {"before": "1 s"}}, "is known at events only"),
        (MeasuredMetric, {"during": "flight"}, "velocity_along_track_error is of an event; give at"),
    ],
)
def test_it_is_of_an_event(card, more, message):
    required = {"name": "a", "probability": 0.9, "below": "1 m/s"} if card is Requirement else {}
    with pytest.raises(ValueError, match=message):
        card.model_validate({**ALONG, **required, **more})
