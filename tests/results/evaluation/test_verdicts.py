"""The value of an expression three times: its interval over paired runs, and its verdict."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.results.evaluation.verdicts import (
    FAILS,
    HOLDS,
    NOT_SET_UP,
    UNDECIDED,
    ExpressionValue,
    value_of,
    verdict,
)
from lvnav_trade.results.metric import MetricValue


@pytest.mark.parametrize(
    ("low", "high", "word"), [(0.9, 1.1, HOLDS), (0.9, 1.3, UNDECIDED), (1.25, 1.3, FAILS), (np.nan, np.nan, FAILS)]
)
def test_an_interval_holds_inside_fails_outside_and_leaves_open_what_is_across(low, high, word):
    found = ExpressionValue(1.0, 1.0, 1.3 if np.isnan(low) else 1.2, low, high, 200, ())
    assert verdict(found, np.nan, 1.2, ("formal", "true", "monte_carlo")) == word
    assert verdict(found, np.nan, 1.2, ("true",)) == HOLDS


def test_what_has_no_number_is_not_set_up():
    assert verdict(ExpressionValue(*[np.nan] * 5, 0, ()), 0.0, 1.0, ("true",)) == NOT_SET_UP


def test_the_interval_covers_the_truth_as_often_as_it_says():
    generator, inside = np.random.default_rng(5), 0
    for _ in range(400):
        common = generator.standard_normal(60)
        a, b = ((common + 0.5 * generator.standard_normal(60)) ** 2 for _ in range(2))
        found = value_of("a / b", {k: MetricValue(1.0, 1.0, 1.0, runs=v) for k, v in {"a": a, "b": 4.0 * b}.items()})
        inside += found.low < 0.5 < found.high
    assert 0.92 * 400 < inside < 0.98 * 400
