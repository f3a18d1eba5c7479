"""The worst error around the event of a requirement."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from lvnav_trade.campaign.definition.schema import Requirement
from lvnav_trade.results.requirements.improvements import lincov_verdicts
from lvnav_trade.results.requirements.windows import quantiles_of_runs, unevaluated, windows
from lvnav_trade.results.statistics.probability import norm_quantile
from lvnav_trade.results.tables.read import Tables
from tests import synthetic

STATED = {"name": "velocity", "at": "stage1_cutoff", "probability": 0.95, "confidence": 0.9}


def asking(tables: Tables, **changes: object) -> Tables:
    """Return results of a campaign with one requirement at the first cut-off, 40 s."""
    stated = {**STATED, "metric": "velocity_error_3d", "below": "0.75 m/s", **changes}
    found = tables.with_frames()
    found.__dict__["campaign"] = {
        **tables.campaign, "requirements": [Requirement.model_validate(stated).model_dump(mode="json")]
    }  # fmt: skip
    return found


def law(t: float, factor: float, part: slice) -> tuple[np.ndarray, np.ndarray]:
    """Return mean and covariance of the Gaussian that errors are drawn from at a time."""
    growth = factor * (1.0 + 0.01 * t)
    return growth * synthetic.MEAN[part], np.diag((growth * synthetic.SIGMA[part]) ** 2)


@pytest.mark.parametrize(("metric", "part"), [("velocity_error_3d", slice(3, 6)), ("attitude_error_3d", slice(0, 3)),
                                              ("velocity_error_down", slice(5, 6))])  # fmt: skip
def test_linear_covariance_finds_the_worst_quantile_of_the_window(alone, metric, part):
    unit = "mrad" if "attitude" in metric else "m/s"
    found = windows(asking(alone, metric=metric, below=f"1 {unit}")).set_index("case")
    for case, factor in (("imu=fine", 1.0), ("imu=coarse", 3.0)):
        row, scale = found.loc[case], 1e3 if unit == "mrad" else 1.0
        assert (row.first_s, row.t_s, row.last_s, row.worst_s, row.by) == (35.0, 40.0, 60.0, 60.0, "LinCov")
        assert row.estimate == pytest.approx(scale * norm_quantile(*law(40.0, factor, part), 0.95), rel=1e-6)
        assert row.worst == pytest.approx(scale * norm_quantile(*law(60.0, factor, part), 0.95), rel=1e-6)


def test_the_runs_decide_where_there_are_any(good):
    """200 runs and bins of 1 %: the 95 % quantile is good to 10 %."""
    found = windows(asking(good)).set_index("case")
    assert set(found.by) == {"runs"}
    for case, factor in (("imu=fine", 1.0), ("imu=coarse", 3.0)):
        expected = norm_quantile(*law(60.0, factor, slice(3, 6)), 0.95)
        assert found.loc[case].worst == pytest.approx(expected, rel=0.12)
        assert found.loc[case].worst_s > 50.0


@pytest.mark.parametrize(
    ("below", "after", "changes"),
    [("0.65 m/s", "20 s", True), ("0.65 m/s", "1 s", False), ("1.0 m/s", "20 s", False), ("0.2 m/s", "20 s", False)],
)
def test_a_verdict_changes_where_the_limit_lies_between_event_and_worst(alone, below, after, changes):
    """The 95 % quantile of the fine case is 0.61 m/s at the event and 0.70 m/s 20 s after it."""
    found = windows(asking(alone, below=below, window={"after": after})).set_index("case")
    assert bool(found.loc["imu=fine"].verdict_changes) is changes


def test_a_window_ends_with_the_history_and_starts_before_the_event_as_stated(alone):
    found = windows(asking(alone, at="injection", window={"before": "30 s", "after": "60 s"})).iloc[0]
    assert (found.first_s, found.last_s) == (69.5, 99.5)
    assert found.worst_s == 99.5


def test_few_runs_do_not_stand_for_a_quantile_that_none_of_them_is_expected_beyond(good):
    """200 runs have ten beyond 95 %, and on average less than one beyond 99.73 %: linear covariance has that one."""
    row = windows(asking(good, probability=0.9973)).set_index("case").loc["imu=fine"]
    assert row.by == "LinCov"
    assert row.worst == pytest.approx(norm_quantile(*law(60.0, 1.0, slice(3, 6)), 0.9973), rel=1e-6)


def test_a_window_rests_on_what_the_verdict_rests_on(good):
    """Of a case that is not selected and that its runs leave undecided both are linear covariance's."""
    found = asking(good, probability=0.98, below="0.68 m/s")
    found.__dict__["campaign"] = {
        **found.campaign, "monte_carlo": {"runs": 200, "selected": {"imu": "coarse"}, "other_runs": 200}
    }  # fmt: skip
    by = windows(found).set_index("case").by
    assert dict(by) == {"imu=fine": "LinCov", "imu=coarse": "runs"}


def test_a_normalised_error_is_evaluated_at_the_stored_states(alone):
    """Independent of `whitening`: the errors are 3 times the filter's sigma on every axis in the coarse case, with
    means, so its quantile is 3 times that of the fine case.
    """
    found = windows(asking(alone, metric="normalised_velocity_error", below="5 sigma")).set_index("case")
    mean, sigma = synthetic.MEAN[3:6], synthetic.SIGMA[3:6]
    expected_size = norm_quantile(mean / sigma, np.eye(3), 0.95) / np.sqrt(3.0)
    for case in ("imu=fine", "imu=coarse"):
        row = found.loc[case]
        assert (row.by, row.unit, row.first_s, row.last_s) == ("LinCov", "sigma", 35.0, 60.0)
        assert row.estimate == pytest.approx(expected_size, rel=1e-6)
        assert row.worst == pytest.approx(expected_size, rel=1e-6)


def test_a_number_of_the_orbit_at_its_event_is_that_of_the_verdict(alone):
    """And later the one of the state there: the errors grow with time."""
    asked = asking(alone, metric="impact_error_cross", below="1 km", window={"before": "0 s", "after": "10 s"})
    found, verdict = windows(asked).set_index("case"), lincov_verdicts(asked).set_index("case")
    for case in verdict.index:
        assert found.loc[case].estimate == pytest.approx(verdict.loc[case].estimate, rel=1e-6)
        assert found.loc[case].worst > found.loc[case].estimate
        assert found.loc[case].worst_s == pytest.approx(50.0, abs=1e-6)


def test_phases_have_no_window_and_what_is_known_at_events_only_says_so(good):
    assert windows(asking(good, at=None, during="flight")).empty
    assert unevaluated(asking(good, at=None, during="flight")).empty
    asked = asking(good, metric="normalised_attitude_error", below="3 sigma")
    assert windows(asked).empty
    assert (
        list(unevaluated(asked).reason) == ["the covariance between the axes of attitude is stored at events only"] * 2
    )


def test_every_requirement_at_an_event_has_a_window_or_a_reason(good):
    for metric, below in (("velocity_error_3d", "1 m/s"), ("perigee_error", "1 km"), ("impact_error", "1 km"),
                          ("position_protection_level", "9 m"), ("normalised_position_error", "3 sigma")):  # fmt: skip
        asked = asking(good, metric=metric, below=below)
        pairs = [set(frame.case) for frame in (windows(asked), unevaluated(asked))]
        assert pairs[0] | pairs[1] == set(good.labels.values())
        assert not pairs[0] & pairs[1]


@pytest.mark.parametrize(("axis", "freedom"), [("3d", 3), ("north", 1)])
def test_quantiles_between_and_beyond_the_stored_ones_are_exact_for_a_normal_vector(axis, freedom):
    known = {name: [stats.chi.ppf(p, freedom)] for name, p in (("q50_si", 0.5), ("q95_si", 0.95), ("q997_si", 0.997))}
    for probability in (0.5, 0.9, 0.95, 0.99, 0.9973):
        found = quantiles_of_runs(pd.DataFrame(known), axis, probability)
        assert found == pytest.approx(stats.chi.ppf(probability, freedom), rel=1e-9)


def test_a_quantile_is_infinite_where_so_many_runs_failed():
    frame = pd.DataFrame({"q50_si": [1.0], "q95_si": [2.0], "q997_si": [np.inf]})
    assert quantiles_of_runs(frame, "3d", 0.95) == pytest.approx([2.0])
    assert np.isinf(quantiles_of_runs(frame, "3d", 0.99)).all()


def test_a_window_that_could_have_no_effect_is_an_input_error():
    with pytest.raises(ValueError, match="a window needs an event"):
        Requirement.model_validate(
            {**STATED, "at": None, "during": "flight", "metric": "velocity_error_3d", "below": "1 m/s", "window": {}}
        )
    with pytest.raises(ValueError, match="known at events only"):
        Requirement.model_validate({**STATED, "metric": "normalised_attitude_error", "below": "3 sigma", "window": {}})
