"""A candidate with a known difference gets the verdict that the difference deserves."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.quantities.errors import InputError
from lvnav_trade.results.comparison.comparison import COLUMNS, FAILED_RUNS, compare, parse_effect, parse_effects
from lvnav_trade.results.comparison.paired_changes import rms_change
from lvnav_trade.results.evaluate import errors_at
from tests.results.variants import errors, failing, variant, worse

VELOCITY = "velocity_error_3d"


def row(found, metric, case="imu=coarse"):
    frame = found.frame
    return frame[(frame.metric == metric) & (frame.case == case)].iloc[0]


@pytest.fixture(scope="module")
def seven(good, tmp_path_factory):
    """Errors 7 % larger, give or take 2 % in each run."""
    return variant(good, tmp_path_factory.mktemp("seven"), runs=worse(1.07, 0.02))


def test_an_unchanged_candidate_is_not_worse_in_anything(good):
    found = compare(good, good)
    assert list(found.frame.columns) == COLUMNS
    assert found.verdict == "not worse"
    assert set(found.frame.remark) == {"the same in every run"}
    assert {"velocity_error_3d", "position_error_3d", "attitude_error_3d", "loose bound", FAILED_RUNS} <= set(
        found.frame.metric
    )


def test_a_candidate_that_is_seven_percent_worse_is_worse_than_five_and_not_worse_than_ten(good, seven):
    assert compare(good, seven).verdict == "worse"
    lenient = compare(good, seven, parse_effects([f"{q}_error_3d=10%" for q in ("velocity", "position", "attitude")]))
    assert set(lenient.frame[lenient.frame.kind == "error"].verdict) == {"not worse"}
    velocity = row(lenient, VELOCITY)
    assert velocity.low < 0.07 < velocity.high
    assert velocity.effective_runs > 50 * velocity.runs


def test_a_difference_too_close_to_call_is_undecided(good, tmp_path):
    close = variant(good, tmp_path / "close", runs=worse(1.05, 0.05))
    found = compare(good, close)
    assert found.verdict == "undecided"
    assert row(found, VELOCITY).verdict == "undecided"


def test_the_numbers_are_those_of_the_pairs_without_failed_runs(good, seven):
    found = row(compare(good, seven, confidence=0.9), VELOCITY, "imu=fine")
    sides = [errors_at(tables, "aaaaaaaaaaaa", "injection", VELOCITY).magnitude for tables in (good, seven)]
    keep = np.isfinite(sides[0])
    assert keep.sum() == 199
    rows = len(compare(good, seven).frame)
    change = rms_change(sides[0][keep], sides[1][keep], True, 0.1 / rows, 0.1)
    assert tuple(found[["change", "low", "high"]]) == pytest.approx((change.change, change.low, change.high))


def test_an_effect_may_be_a_quantity_at_another_event_or_of_a_quantile(good, seven):
    effects = parse_effects(["velocity_error_north@stage1_cutoff=0.5 m/s", f"{VELOCITY}:q90=2%"])
    found = compare(good, seven, effects)
    assert row(found, "velocity_error_north").verdict == "not worse"
    assert (row(found, "velocity_error_north").event, row(found, "velocity_error_north").scale) == (
        "stage1_cutoff",
        "m/s",
    )
    quantile = found.frame[(found.frame.statistic == "q90") & (found.frame.case == "imu=coarse")].iloc[0]
    assert quantile.verdict == "worse"
    assert quantile.low < 0.07 < quantile.high


def test_none_leaves_a_metric_out(good):
    found = compare(good, good, parse_effects(["position_error_3d=none", "tight bound=none"]))
    assert not {"position_error_3d", "tight bound"} & set(found.frame.metric)


def test_a_requirement_is_compared_by_the_runs_beyond_its_bound(good, tmp_path):
    larger = variant(good, tmp_path / "larger", runs=worse(1.9))
    found = row(compare(good, larger), "loose bound", "imu=fine")
    assert (found.kind, found.statistic, found.scale) == ("requirement", "fraction beyond", "fraction of runs")
    assert found.base == pytest.approx(1 / 200)
    assert found.effect == pytest.approx(0.1)
    assert row(compare(good, larger, parse_effects(["tight bound=1%"])), "tight bound", "imu=fine").effect == 0.01


def test_a_requirement_that_allows_hardly_a_run_is_compared_by_its_quantile_and_decided(good, tmp_path):
    def strict(campaign):
        (first, *rest) = campaign["requirements"]
        return campaign | {"requirements": [first | {"name": "strict", "probability": 0.9973}, *rest]}

    base = variant(good, tmp_path / "strict", campaign=strict)
    sides = {factor: variant(base, tmp_path / f"by {factor}", runs=worse(factor, 0.01)) for factor in (1.01, 1.2)}
    found = {factor: row(compare(base, side), "strict", "imu=fine") for factor, side in sides.items()}
    assert [found[factor].verdict for factor in (1.01, 1.2)] == ["not worse", "worse"]
    assert {(one.kind, one.statistic, one.effect) for one in found.values()} == {("requirement", "q99.73", 0.05)}
    assert "fitted" in found[1.01].remark
    # an effect that is stated in runs beyond the limit stays that
    counted = row(compare(base, sides[1.2], parse_effects(["strict=1%"])), "strict", "imu=fine")
    assert counted.statistic == "fraction beyond"
    own = compare(base, sides[1.2], parse_effects(["strict:q90=30%"]))
    assert row(own, "strict", "imu=fine").statistic == "q90"


def test_runs_that_fail_in_the_candidate_alone_make_it_worse(good, tmp_path):
    lost = variant(good, tmp_path / "lost", runs=failing(tuple(range(20, 60))))
    found = row(compare(good, lost), FAILED_RUNS)
    assert (found.base, found.candidate, found.verdict) == (pytest.approx(1 / 200), pytest.approx(41 / 200), "worse")
    assert row(compare(good, lost), VELOCITY).runs == 200


def test_the_campaign_of_the_base_may_state_effects_and_confidence(good, tmp_path, seven):
    stated = {"compare": {"confidence": 0.8, "effects": {VELOCITY: "10 %"}}}
    base = variant(good, tmp_path / "base", campaign=lambda campaign: campaign | stated)
    found = compare(base, seven)
    assert (found.confidence, row(found, VELOCITY).verdict) == (0.8, "not worse")
    assert row(compare(base, seven, parse_effects([f"{VELOCITY}=5%"])), VELOCITY).verdict == "worse"


def test_without_runs_linear_covariance_is_compared(alone):
    found = compare(alone, alone, parse_effects(["velocity_error_north=0.01 m/s"]), mapping={"fine": "coarse"})
    velocity = row(found, VELOCITY, "imu=fine → imu=coarse")
    assert velocity.change == pytest.approx(2.0)
    assert (velocity.verdict, velocity.runs, velocity.remark) == ("worse", 0, "by linear covariance")
    assert row(found, "loose bound", "imu=coarse").verdict == "not worse"


@pytest.mark.parametrize(
    ("effect", "why"),
    [
        ("velocity_eror_3d=1%", r"no such metric or requirement .*did you mean 'velocity_error_3d'\?"),
        ("velocity_error_3d@inject=1%", "'inject' is not an event of imu=fine .it has liftoff, stage1_cutoff"),
        ("velocity_error_3d=1 kg", "'1 kg' has the wrong unit"),
        ("velocity_error_3d=-1%", "'-1%' should not be below zero"),
        ("velocity_error_3d=-1 m/s", "'-1 m/s' should not be below zero"),
        ("velocity_error_3d", "write METRIC=AMOUNT"),
        ("velocity_error_3d:mean=1%", "write METRIC, METRIC@EVENT"),
        ("velocity_error_3d=little", "neither a percentage"),
        ("velocity_error_3d=x%", "is not a quantity"),
    ],
)
def test_an_effect_that_cannot_be_is_refused_in_one_line(good, effect, why):
    with pytest.raises(InputError, match=why) as caught:
        compare(good, good, parse_effects([effect]))
    assert len(str(caught.value).splitlines()) == 1


def test_a_confidence_that_is_none_is_refused(good):
    with pytest.raises(InputError, match=r"give a number from 0\.5 to below 1"):
        compare(good, good, confidence=95.0)


def test_an_effect_is_taken_apart():
    assert parse_effect("a@b:q99.7", "5 %") == ("a", "b", "q99.7", "5 %")
    assert parse_effect("injection velocity", "1%") == ("injection velocity", "", "rms", "1%")


def test_the_family_of_rows_calls_an_equal_candidate_worse_no_more_often_than_the_confidence_says(good):
    # Candidates drawn anew about the smallest effect of interest itself: truth lies on the edge in all rows at once.
    def redrawn(seed):
        runs = good.runs.copy()
        worse_by = 1.05 * np.exp(0.1 * np.random.default_rng(seed).standard_normal((len(runs), 1)) - 0.01)
        runs[errors(runs)] = runs[errors(runs)].to_numpy() * worse_by
        return good.with_frames(runs=runs)

    trials = 25
    wrong = sum(compare(good, redrawn(k), confidence=0.8).verdict == "worse" for k in range(trials))
    assert wrong / trials < 0.2 + 3.0 * np.sqrt(0.2 * 0.8 / trials)
