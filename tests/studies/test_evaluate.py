"""Statements: an expression three times, its interval over paired runs, its verdict, and where a bound is reached."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from lvnav_studies.claims import Term
from lvnav_studies.evaluate import bound_crossing, bounds, case_text, locus
from lvnav_studies.rows import claim_rows
from lvnav_trade.api.measures import COLUMNS, FAILS, HOLDS, ExpressionValue
from lvnav_trade.results.tables.read import load
from tests import synthetic

FINE, COARSE = {"imu": "fine"}, {"imu": "coarse"}
NAMES = (
    "history",
    "runs",
    "events",
    "outputs",
    "labels",
    "display_units",
    "interval_errors",
    "consistency",
    "campaign",
    "cases",
)
SPEED = {"metric": "velocity_error_3d", "at": "injection"}


def rows(tables, **stated):
    claims = {"name": "synthetic", "statements": [{"source": "A paper", **stated}]}
    return pd.DataFrame(claim_rows(tables, claims), columns=COLUMNS)


def wilson_hilferty(freedom: int) -> float:
    """Return the 99 % quantile of chi-square over its degrees of freedom, by the cube of a Gaussian."""
    return (1.0 - 2.0 / (9.0 * freedom) + 2.3263 * np.sqrt(2.0 / (9.0 * freedom))) ** 3


def test_a_ratio_of_paired_runs_is_known_better_than_either(good):
    terms = {"a": SPEED | {"case": COARSE}, "b": SPEED | {"case": FINE}}
    found = rows(good, id="s1", item="#1 three times", value="a / b", terms=terms, at_least=2.99, at_most=3.01).iloc[0]
    assert (found.id, found["item"], found.verdict) == ("s1", "#1 three times", HOLDS)
    # the same draws, three times as large: nothing is left of the sampling error
    np.testing.assert_allclose([found.formal, found.monte_carlo, found.low, found.high], 3.0, rtol=1e-9)
    assert found.true == pytest.approx(3.0, rel=1e-9)
    assert "1 of 200 runs failed and are left out" in found.remark


def test_the_interval_of_unpaired_numbers_is_that_of_two_samples(good):
    """Velocity north over east: independent draws, so var(ln ratio) = 1 / n for root mean squares of Gaussians."""
    terms = {"a": {"metric": "velocity_error_north"}, "b": {"metric": "velocity_error_east"}}
    terms = {name: term | {"at": "injection", "case": FINE} for name, term in terms.items()}
    found = rows(good, value="a / b", terms=terms, at_least=0.1).iloc[0]
    half = np.log(found.high / found.low) / 2.0
    assert half == pytest.approx(1.97 * np.sqrt(1.0 / 199), rel=0.15)
    assert found.low < found.monte_carlo < found.high
    assert found.id == "synthetic statements 1"


def test_axes_that_no_term_names_are_read_level_by_level(good):
    spread = {"a": {"metric": "velocity_error_3d"}, "b": {"metric": "velocity_error_east"}}
    found = rows(good, value="a / b", terms={k: v | {"at": "injection"} for k, v in spread.items()}, at_least=1.0)
    assert list(found["case"]) == ["imu=fine", "imu=coarse"]
    assert list(found.verdict) == [HOLDS, HOLDS]


def test_a_phase_between_events_is_paired_too_and_another_has_no_interval(good):
    terms = {"a": {"metric": "velocity_error_3d", "during": "liftoff to injection", "case": COARSE}}
    terms["b"] = terms["a"] | {"case": FINE}
    found = rows(good, value="a / b", terms=terms, at_least=2.0).iloc[0]
    assert found.low == pytest.approx(3.0, rel=1e-9)
    terms = {name: term | {"during": "stage1_cutoff + 5 s to injection"} for name, term in terms.items()}
    found = rows(good, value="a / b", terms=terms, at_least=2.0).iloc[0]
    assert np.isnan(found.low)
    assert found.monte_carlo == pytest.approx(3.0, rel=1e-9)
    assert "without an interval" in found.remark


def test_runs_that_linear_covariance_does_not_describe_fail_by_the_runs_alone(wrong):
    """Runs 1.6 times as large as said: the size of an error, in its unit, by three columns."""
    stated = {"value": "a", "unit": "cm/s", "terms": {"a": SPEED | {"case": FINE}}, "at_most": 70.0}
    found = rows(wrong, **stated).iloc[0]
    sigma = 100 * 1.995 * np.sqrt(0.1**2 + 0.12**2 + 0.2**2)
    assert found.formal == pytest.approx(sigma, rel=1e-9)
    assert found.monte_carlo > 1.4 * found.true
    assert (found.verdict, found.unit) == (FAILS, "cm/s")
    assert rows(wrong, **stated, tested_by=["formal", "true"]).iloc[0].verdict == HOLDS


def test_the_nees_of_matched_runs_is_one_and_of_larger_ones_their_square(good, wrong):
    stated = {"value": "n", "terms": {"n": {"metric": "velocity_nees", "during": "flight", "case": FINE}}}
    stated |= {"at_least": 0.3, "probability": 0.99}
    found = rows(good, **stated).iloc[0]
    assert (found.formal, found.verdict) == (1.0, HOLDS)
    mean = (synthetic.MEAN[4] / synthetic.SIGMA[4]) ** 2 / 3.0
    assert found.true == pytest.approx(1.0 + mean, rel=1e-9)
    assert found.monte_carlo == pytest.approx(1.0 + mean, rel=0.1)
    assert found.band_high == pytest.approx(wilson_hilferty(3 * 199), abs=2e-4)  # one run failed
    found = rows(wrong, **stated).iloc[0]
    assert found.monte_carlo == pytest.approx(1.6**2 + mean, rel=0.15)
    assert found.verdict == FAILS


@pytest.mark.parametrize(
    ("term", "message"),
    [
        ({"metric": "attitude_convergence_time", "during": "flight"}, "give during and below"),
        ({"metric": "attitude_convergence_time", "at": "injection", "below": "1 deg"}, "give during and below"),
        ({"metric": "attitude_convergence_time", "during": "flight", "below": "1 m"}, "1 m"),
        ({"metric": "attitude_error_3d", "below": "1 deg"}, "below needs a metric that has a limit"),
        ({"metric": "attitude_convergence_time", "during": "flight", "below": "3 sigma"}, "sigma_of"),
        ({"metric": "attitude_convergence_time", "during": "flight", "below": "1 deg", "sigma_of": FINE}, "sigma_of"),
        ({"metric": "detection_rate", "at": "injection"}, "of a phase"),
    ],
)
def test_a_convergence_time_has_a_phase_and_a_limit(term, message):
    with pytest.raises(ValueError, match=message):
        Term.model_validate(term)


def case_of(tables, levels):
    return next(digest for digest, mine in tables.levels.items() if mine == levels)


def test_a_share_of_runs_has_its_exact_interval(tmp_path):
    tested = load(synthetic.results(tmp_path / "tested", n_run=8, size=8, logic=True))
    term = {"metric": "detection_rate", "during": "stage1_cutoff to stage1_cutoff + 5 s", "case": FINE}
    stated = {"value": "d", "terms": {"d": term}, "at_least": 0.6, "tested_by": ["monte_carlo"]}
    found = rows(tested, **stated).iloc[0]
    assert (found.monte_carlo, found.true, found.high, found.verdict) == (1.0, 1.0, 1.0, HOLDS)
    assert found.low == pytest.approx(0.025 ** (1.0 / 8.0))  # all of eight
    term["during"] = "stage1_cutoff + 5 s to injection"
    found = rows(tested, **stated).iloc[0]
    assert (found.monte_carlo, found.low, found.verdict) == (0.0, 0.0, FAILS)
    assert found.high == pytest.approx(1.0 - 0.025 ** (1.0 / 8.0))


def test_without_runs_linear_covariance_decides_and_says_so(alone):
    terms = {"a": SPEED | {"case": COARSE}, "b": SPEED | {"case": FINE}}
    found = rows(alone, value="a / b", terms=terms, at_least=2.0).iloc[0]
    assert found.verdict == HOLDS
    assert "linear covariance alone" in found.remark


def test_where_a_bound_is_reached_is_interpolated_between_levels():
    values = [(f"{x} m/s", ExpressionValue(np.nan, y, *[np.nan] * 3, 0, ())) for x, y in ((0.1, 0.8), (0.01, 0.4))]
    assert bound_crossing(values, np.nan, 0.6) == "0.0316 m/s"  # half way of the logarithm
    assert bound_crossing(values, np.nan, 0.9) == ""
    formal = [(f"{x} deg", ExpressionValue(y, 0.5, *[np.nan] * 3, 0, ())) for x, y in ((0.1, 0.8), (0.01, 0.4))]
    assert bound_crossing(formal, np.nan, 0.6) == ""  # the true error never does
    assert bound_crossing(formal, np.nan, 0.6, ["formal", "true"]) == "0.0316 deg (formal)"


def test_the_bound_of_a_nees_is_that_of_its_runs():
    assert bounds({"at_least": 0.3}, 200)[0] == 0.3
    assert bounds({"probability": 0.99}, 200)[1] == pytest.approx(wilson_hilferty(600), abs=2e-4)


def test_the_median_over_an_axis_stands_for_its_levels_and_acquisitions_are_taken_together(good):
    term = SPEED | {"over": "imu"}
    found = rows(good, value="a", unit="m/s", terms={"a": term}, at_least=0.1).iloc[0]
    sizes = [100 * 1.995 * f * np.sqrt(0.1**2 + 0.12**2 + 0.2**2) / 100 for f in (1.0, 3.0)]
    assert found.formal == pytest.approx(np.mean(sizes), rel=1e-9)
    term = {"metric": "reacquisition_time", "at": "stage1_cutoff + 34 s", "over": "imu"}
    found = rows(good, value="a", unit="s", terms={"a": term}, at_most=5.0, tested_by=["true"]).iloc[0]
    assert (found.true, found.verdict) == (4.5, HOLDS)
    assert "median of 16 acquisitions" in found.remark


def test_errors_of_two_cases_are_subtracted_run_by_run(good):
    """The same draws, three times as large: the difference is twice the smaller one's error."""
    term = SPEED | {"case": COARSE, "minus": FINE}
    found = rows(good, value="a", unit="cm/s", terms={"a": term}, at_most=1.0, tested_by=["monte_carlo"]).iloc[0]
    own = rows(good, value="a", unit="cm/s", terms={"a": SPEED | {"case": FINE}}, at_most=1.0).iloc[0]
    assert found.monte_carlo == pytest.approx(2.0 * own.monte_carlo, rel=1e-9)
    assert found.low == pytest.approx(2.0 * own.low, rel=1e-9)
    assert np.isnan(found.true)
    east = term | {"metric": "velocity_error_east"}
    found = rows(good, value="a", unit="m/s", terms={"a": east}, at_most=1.0, tested_by=["monte_carlo"]).iloc[0]
    alone = SPEED | {"case": FINE, "metric": "velocity_error_east"}
    own = rows(good, value="a", unit="m/s", terms={"a": alone}, at_most=1.0).iloc[0]
    assert found.monte_carlo == pytest.approx(2.0 * own.monte_carlo, rel=1e-9)


def test_a_locus_follows_its_axis_and_what_it_is_held_against_stays(good):
    terms = {"a": SPEED | {"case": COARSE}, "b": SPEED | {"case": FINE}}
    stated = {"source": "x", "value": "a / b", "terms": terms, "at_most": 2.0, "along": "imu", "case": {}}
    ((others, values),) = locus(good, stated)  # b names another level
    assert others == ""
    assert [(level, round(value.formal, 9)) for level, value in values] == [("fine", 1.0), ("coarse", 3.0)]
    ((_, values),) = locus(good, stated | {"terms": {"a": SPEED | {"case": COARSE}, "b": SPEED | {"case": COARSE}}})
    assert [(level, round(value.formal, 9)) for level, value in values] == [("fine", 1.0), ("coarse", 1.0)]
    levels = good.levels | {"aaaaaaaaaaaa": {"imu": "fine", "set": "x"}, "bbbbbbbbbbbb": {"imu": "coarse", "set": "y"}}
    terms = {"a": SPEED | {"case": {"set": "y", "imu": "coarse"}}, "b": SPEED | {"case": {"set": "x"}}}
    tables = SimpleNamespace(**{name: getattr(good, name) for name in NAMES}, levels=levels, cache={})
    ((_, values),) = locus(tables, stated | {"terms": terms})
    assert [(level, round(value.formal, 9)) for level, value in values] == [("fine", 3.0), ("coarse", 3.0)]


def test_a_ratio_to_the_filters_own_sigma_has_the_bounds_of_so_many_runs(good, wrong):
    """Matched runs keep them, runs of 1.6 times the error do not: the bounds are those of a chi-square of the runs."""
    drawn = SPEED | {"case": FINE}
    stated = {"value": "a / s", "terms": {"a": drawn, "s": drawn | {"statistic": "formal"}}, "of_runs": 0.95}
    stated |= {"tested_by": ["monte_carlo"]}
    found, other = rows(good, **stated).iloc[0], rows(wrong, **stated).iloc[0]
    assert found.formal == pytest.approx(1.0)
    assert other.monte_carlo == pytest.approx(1.6 * found.monte_carlo, rel=0.1)
    assert (other.verdict, other.in_band) == (FAILS, False)
    low, high = found.band_low, found.band_high
    runs = 199  # one failed
    # Wilson and Hilferty: chi-square over n is (1 - 2 / 9n -+ z sqrt(2 / 9n))^3
    for bound, z in ((low, -1.959964), (high, 1.959964)):
        assert bound**2 == pytest.approx((1.0 - 2.0 / (9 * runs) + z * np.sqrt(2.0 / (9 * runs))) ** 3, abs=1e-4)
    assert bounds({"of_runs": 0.95}, 20) == pytest.approx((0.692, 1.307), abs=1e-3)


@pytest.mark.parametrize(
    ("stated", "levels", "named"),
    [
        ({}, {"faults": "loss", "imu": "base"}, "faults=loss"),
        ({}, {"faults": "base", "imu": "base"}, "base"),
        ({"imu": "base"}, {}, "imu=base"),
        ({"imu": "fog"}, {"faults": "base"}, "imu=fog"),
        ({}, {}, ""),
    ],
)
def test_a_reading_is_named_by_the_axis_that_is_varied(stated, levels, named):
    assert case_text(stated, levels) == named
