"""Cases taken together: root mean squares over all their runs, intervals over runs and over cases."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats

from lvnav_trade.results import evaluate as single_cases
from lvnav_trade.results.evaluation.pooled_cases import cases_of, evaluate, evaluate_single, label_of, members
from lvnav_trade.results.evaluation.verdicts import value_of
from lvnav_trade.results.metric import MetricValue, SingleValue

SPEED = {"metric": "velocity_error_3d", "at": "injection"}
LEVELS = {f"{imu}{draw}": {"imu": imu, "realisation": str(draw)} for imu in ("fine", "coarse") for draw in range(5)}


@pytest.fixture
def tables():
    labels = {case: f"imu={one['imu']}, realisation={one['realisation']}" for case, one in LEVELS.items()}
    return SimpleNamespace(levels=LEVELS, labels=labels)


def test_one_case_stands_for_those_that_are_taken_together(tables):
    assert cases_of(tables, {"imu": "fine"}, ("realisation",)) == ["fine0"]
    assert cases_of(tables, {}, ("realisation",)) == ["fine0", "coarse0"]
    assert cases_of(tables, {"imu": "fine"}, ()) == [f"fine{k}" for k in range(5)]
    assert members(tables, "coarse0", ("realisation",)) == [f"coarse{k}" for k in range(5)]
    assert label_of(tables, "fine0", ("realisation",)) == "imu=fine; 5 levels of realisation together"
    assert label_of(tables, "fine0", ()) == "imu=fine, realisation=0"
    alone = SimpleNamespace(levels={"fine0": LEVELS["fine0"]}, labels=tables.labels)
    assert label_of(alone, "fine0", ("realisation",)) == "imu=fine, realisation=0"


def test_numbers_are_those_of_all_runs_in_one_case(tables, monkeypatch):
    rng = np.random.default_rng(1)
    runs = {case: np.abs(rng.normal(size=40)) * (1 + k) for k, case in enumerate(LEVELS)}

    def one(_, case, stated, unit):
        worst = stated.get("statistic") == "worst"
        value = np.median(runs[case]) if worst else np.sqrt(np.mean(runs[case] ** 2))
        return SingleValue(float(value), "", np.sort(runs[case]))

    monkeypatch.setattr(single_cases, "evaluate_single", one)
    every = np.concatenate([runs[f"fine{k}"] for k in range(5)])
    found = evaluate_single(tables, "fine0", SPEED | {"pool": ("realisation",)}, "m/s")
    assert found.value == pytest.approx(np.sqrt(np.mean(every**2)), rel=1e-12)
    np.testing.assert_array_equal(found.runs, np.sort(every))
    worst = evaluate_single(tables, "fine0", SPEED | {"pool": ("realisation",), "statistic": "worst"}, "m/s")
    assert worst.value == np.median(every)
    assert evaluate_single(tables, "fine0", SPEED, "m/s").value == one(None, "fine0", SPEED, "").value


def test_a_count_is_the_median_of_the_cases(tables, monkeypatch):
    counts = dict(zip(LEVELS, (7.0, 9.0, 8.0, 8.0, 4.0, 1.0, 1.0, 1.0, 1.0, 1.0), strict=True))
    monkeypatch.setattr(single_cases, "evaluate_single", lambda _, case, stated, unit: SingleValue(counts[case]))
    stated = {"metric": "satellites_tracked", "pool": ("realisation",)}
    assert evaluate_single(tables, "fine0", stated, "-").value == 8.0


def _value(each):
    return MetricValue(1.0, 2.0, float(np.sqrt(each.mean())), runs=each)


def test_the_interval_covers_what_the_cases_differ_by(tables, monkeypatch):
    """Levels of very different size, runs alike: Student's interval of the logarithm of a mean of five cases."""
    sizes = np.array([1.0, 2.0, 4.0, 1.5, 3.0])
    each = dict(zip(LEVELS, [np.full(20, size) for size in (*sizes, *sizes)], strict=True))
    monkeypatch.setattr(single_cases, "evaluate", lambda _, case, stated, unit: _value(each[case]))
    found = evaluate(tables, "fine0", SPEED | {"pool": ("realisation",)}, "-")
    assert (found.formal, found.true) == (1.0, 2.0)
    assert found.monte_carlo == pytest.approx(np.sqrt(sizes.mean()), rel=1e-12)
    value = value_of("a", {"a": found})
    without = np.log(np.sqrt((sizes.sum() - sizes) / 4))
    half = stats.t.isf(0.025, 4) * np.sqrt(0.8 * np.sum((without - without.mean()) ** 2))
    assert value.low == pytest.approx(np.sqrt(sizes.mean()) * np.exp(-half), rel=1e-12)
    assert value.high == pytest.approx(np.sqrt(sizes.mean()) * np.exp(half), rel=1e-12)


def test_runs_of_one_number_share_their_draws_and_count_once(tables, monkeypatch):
    """The same runs five times over know no more than once."""
    squares = np.random.default_rng(2).chisquare(1, 50)
    monkeypatch.setattr(single_cases, "evaluate", lambda _, case, stated, unit: _value(squares))
    found = value_of("a", {"a": evaluate(tables, "fine0", SPEED | {"pool": ("realisation",)}, "-")})
    alone = value_of("a", {"a": _value(squares)})
    assert (found.low, found.high) == pytest.approx((alone.low, alone.high), rel=1e-12)


def test_a_share_of_cases_together_is_their_mean(tables, monkeypatch):
    each = dict(zip(LEVELS, [np.array([1.0] * k + [0.0] * (10 - k)) for k in (1, 2, 3, 4, 5, *[0] * 5)], strict=True))
    made = {case: MetricValue(np.nan, np.nan, found.mean(), "", found, False, True) for case, found in each.items()}
    monkeypatch.setattr(single_cases, "evaluate", lambda _, case, stated, unit: made[case])
    stated = {"metric": "detection_rate", "during": "flight", "pool": ("realisation",)}
    found = value_of("a", {"a": evaluate(tables, "fine0", stated, "-")})
    assert found.monte_carlo == pytest.approx(0.3)
    assert found.low < 0.3 < found.high
    none = value_of("a", {"a": evaluate(tables, "coarse0", stated, "-")})
    assert (none.low, none.monte_carlo) == (0.0, 0.0)
    assert none.high > 0.2  # ten runs without one tell no more


def test_a_mean_of_cases_together_keeps_its_sign(tables, monkeypatch):
    means = dict(zip(LEVELS, (-3.0, -1.0, 1.0, 2.0, -4.0, *[0.0] * 5), strict=True))
    monkeypatch.setattr(single_cases, "evaluate_single", lambda _, case, stated, unit: SingleValue(means[case]))
    made = {case: MetricValue(np.nan, 0.5, mean, is_root=False) for case, mean in means.items()}
    monkeypatch.setattr(single_cases, "evaluate", lambda _, case, stated, unit: made[case])
    stated = {"metric": "clock_bias_error_time", "statistic": "mean", "during": "flight", "pool": ("realisation",)}
    assert evaluate_single(tables, "fine0", stated, "m").value == pytest.approx(-1.0)
    found = evaluate(tables, "fine0", stated, "m")
    assert (found.true, found.monte_carlo) == (0.5, pytest.approx(-1.0))
