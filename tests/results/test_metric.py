"""What all metrics share: units, places, the single number."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from lvnav_trade.results.metric import Metric, MetricValue, event_of, event_or_phase, scale_of


@dataclass(frozen=True)
class _Fixed(Metric):
    found: MetricValue | None = None

    def value(self, tables, case, stated, unit):
        return self.found


def single(found):
    return _Fixed("fixed", "m", "a number", found).single(None, "", {}, "m")


def test_a_unit_has_its_size_in_si_or_does_not_fit():
    assert scale_of("km", "m") == 1000.0
    assert scale_of("-", "m") == 1.0
    assert scale_of("s", "m") is None


def test_a_place_is_a_phase_or_an_event_and_injection_without_either():
    assert event_or_phase({}) == event_of({"during": "flight"}) == "injection"
    assert event_or_phase({"during": "flight", "at": None}) == "flight"
    assert event_or_phase({"at": "liftoff"}) == "liftoff"


def test_the_single_number_is_of_the_runs_whose_squares_are_growing_sizes():
    found = single(MetricValue(true=1.0, monte_carlo=2.0, remark="a", runs=np.array([9.0, np.inf, 4.0])))
    assert (found.value, found.remark, found.runs.tolist()) == (2.0, "a", [2.0, 3.0, np.inf])
    assert single(MetricValue(true=1.0)).value == 1.0
    assert single(MetricValue(runs=np.array([1.0, 0.0]), is_root=False)).runs.tolist() == [0.0, 1.0]


def test_a_metric_without_runs_of_its_own_has_no_errors_and_no_law():
    metric = Metric("a", "m", "a number")
    assert metric.errors(None, {}) is None
    assert metric.distribution(None, {}) == "linear covariance does not hold this error there"
    assert metric.label({"statistic": "worst", "during": "flight"}) == "worst a, flight"
    with pytest.raises(NotImplementedError):
        metric.value(None, "", {}, "-")
