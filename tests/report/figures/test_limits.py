"""Limits of requirements in figures, with their place, unit and fraction of runs; quantiles of the runs."""

from __future__ import annotations

import numpy as np

from lvnav_trade.report.figures import PLOTS
from lvnav_trade.report.figures.limits import limits_of
from lvnav_trade.results.statistics.select import history_of

CASE = "aaaaaaaaaaaa"


def test_a_limit_has_value_unit_fraction_and_place(good):
    (limit,) = limits_of(good, CASE, "velocity")
    assert (limit.requirement, limit.value, limit.event) == ("loose bound", 2.0, "injection")
    assert limit.label == "limit: 90 % of runs below 2 m/s, injection"
    assert limits_of(good, CASE, "attitude") == []  # its requirement is on one axis


def test_an_error_over_time_has_the_limit_and_a_marker_at_its_event(good):
    (ax,) = PLOTS["comparison"](good, "velocity").panels
    (line,) = [mark for mark in ax.marks if mark.mark_type == "limit"]
    assert (line.data["at"], line.label) == (2.0, limits_of(good, CASE, "velocity")[0].label)
    (marker,) = [mark for mark in ax.marks if mark.style.get("marker") == "v"]
    assert (list(marker.data["x"]), list(marker.data["y"])) == ([99.5], [2.0])


def test_a_ranking_has_the_limit_and_the_quantile_that_it_bounds(good):
    ax = PLOTS["rank"](good).panels[0]
    assert [mark.data["at"] for mark in ax.marks if mark.mark_type == "limit"] == [2.0]
    (dots,) = [mark for mark in ax.marks if mark.label == "quantile that the limit bounds"]
    assert dots.data["x"][0] < 2.0 < dots.data["x"][1]  # fine is within, coarse beyond


def test_quantiles_are_those_that_are_stored(good):
    (ax,) = PLOTS["quantiles"](good, CASE, "velocity").panels
    rows = history_of(good, CASE, "velocity", "3d")
    inner, outer = [mark for mark in ax.marks if mark.mark_type == "band"]
    np.testing.assert_array_equal(inner.data["low"], rows.q50_si)
    np.testing.assert_array_equal(inner.data["high"], rows.q95_si)
    np.testing.assert_array_equal(outer.data["high"], rows.q997_si)
