"""Numbers of the signals as metrics."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.results.evaluate import evaluate, evaluate_single
from lvnav_trade.results.evaluation.satellite_tracking import signal_values
from tests import synthetic

CASE = "aaaaaaaaaaaa"


def test_satellites_are_counted_and_what_is_left_of_delays_is_the_worst(good):
    during = {"metric": "satellites_tracked", "during": "flight"}
    assert evaluate_single(good, CASE, during | {"statistic": "least"}, "-").value == 0.0  # in the outage
    assert evaluate_single(good, CASE, during | {"statistic": "worst"}, "-").value == synthetic.N_SAT
    left = evaluate_single(good, CASE, {"metric": "ionosphere_left", "during": "flight", "statistic": "worst"}, "m")
    assert left.value == pytest.approx(2.5)


def test_what_signals_show_is_a_true_number(good):
    found = evaluate(
        good, "aaaaaaaaaaaa", {"metric": "satellites_tracked", "during": "flight", "statistic": "least"}, "-"
    )
    assert (found.true, np.isnan(found.formal), np.isnan(found.monte_carlo)) == (0.0, True, True)


def test_the_change_of_a_delay_has_a_largest_value_and_an_altitude_where_it_is(good):
    found = evaluate(good, CASE, {"metric": "troposphere_change", "during": "flight", "statistic": "worst"}, "mm")
    every = signal_values(good, CASE, "troposphere_change")
    assert found.true == pytest.approx(1e3 * every.value.max())
    peak = evaluate(good, CASE, {"metric": "troposphere_change_height", "during": "flight"}, "km")
    assert peak.true == pytest.approx(every.height[every.value.idxmax()] / 1e3)


def test_air_is_crossed_fastest_where_climb_rate_times_density_is_largest(good):
    """A climb at 20 m/s^2: v exp(-h / H) is largest at h = H / 2, since v is the root of 2 a h."""
    found = evaluate(good, CASE, {"metric": "air_crossing_height", "during": "flight"}, "km")
    assert found.true == pytest.approx(7.5 / 2, abs=0.3)


def test_reacquisition_is_the_median_of_the_satellites(good):
    stated = {"metric": "reacquisition_time", "at": "stage1_cutoff + 34 s"}
    assert evaluate(good, CASE, stated, "s").true == pytest.approx(4.5)
    assert evaluate(good, CASE, stated, "m").remark == "unit m does not fit"
