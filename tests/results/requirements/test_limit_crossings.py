"""Curves over numeric axes, their crossings, and tornado bars."""

from __future__ import annotations

import json

import numpy as np
import pytest

from lvnav_trade.results.evaluation import METRICS
from lvnav_trade.results.requirements.limit_crossings import base_level, find_crossings, numeric_axes
from lvnav_trade.results.tables.read import load
from tests import synthetic

FACTORS = tuple(factor for _, factor in synthetic.CASES)
LIMIT = 20.0
AXES = """\
design: {design}
base: {{initial: {{heading: 0.5 rad}}}}
axes:
  - {{path: initial.heading, cards: null, values: [{values}], labels: [{labels}]}}
requirements:
  - {{name: north, metric: position_error_north, at: injection, probability: 0.9, below: {limit} m, confidence: 0.9}}
  - {{name: fast, metric: velocity_error_3d, at: injection, probability: 0.9, below: 2.0 m/s, confidence: 0.9}}
"""


def tables(folder, labels, values=("1 rad", "2 rad"), design="grid", levels=None):
    head = synthetic.CAMPAIGN.partition("requirements:")[0]
    made = AXES.format(design=design, values=", ".join(values), labels=", ".join(labels), limit=LIMIT)
    found = load(synthetic.results(folder, n_run=200, campaign=head + made))
    levels = levels or [{"heading": label} for label in labels]
    axes = [json.dumps(one) for one in levels]
    return found.with_frames(cases=found.cases.assign(axes=axes))


@pytest.fixture(scope="module")
def numeric(tmp_path_factory):
    return tables(tmp_path_factory.mktemp("numeric"), [f"{factor} deg" for factor in FACTORS])


def test_an_axis_is_numeric_in_the_unit_of_its_labels_or_in_si(numeric, tmp_path):
    (axis,) = numeric_axes(numeric)
    assert (axis.name, axis.unit) == ("heading", "deg")
    assert [axis.values[f"{factor} deg"] for factor in FACTORS] == list(FACTORS)
    assert axis.values["base"] == pytest.approx(np.degrees(0.5))
    named = tables(tmp_path / "named", ["small", "large"], ("0.1 rad", "0.2 rad"))
    assert numeric_axes(named)[0][1:] == ("rad", {"small": 0.1, "large": 0.2, "base": 0.5})
    assert not numeric_axes(tables(tmp_path / "cards", ["small", "large"], ("{a: 1}", "{a: 2}")))


def test_the_level_of_the_base_is_known_by_its_number_or_as_one_of_the_levels(numeric, tmp_path):
    assert base_level(numeric, "heading") == ("", pytest.approx(np.degrees(0.5)), "deg")
    named = tables(tmp_path / "same", ["small", "large"], ("0.1 rad", "0.5 rad"))
    assert base_level(named, "heading") == ("large", 0.5, "rad")
    assert base_level(named, "imu")[0] == ""


def test_a_curve_crosses_its_limit_where_the_error_that_grows_with_the_axis_reaches_it(numeric):
    """The errors of the synthetic cases are proportional to their factor, which is the value of the axis here."""
    frame = METRICS["curves"](numeric)
    north = frame[frame.requirement == "north"]
    assert list(north.value) == list(FACTORS)
    slope = north.lincov / north.value
    assert slope.iloc[0] == pytest.approx(slope.iloc[1])
    row = METRICS["crossings"](numeric).set_index(["requirement", "by"]).loc["north", "linear covariance"]
    assert row.crossing == pytest.approx(LIMIT / slope.iloc[0], rel=1e-9)
    assert (row.low, row.high) == FACTORS


def test_a_curve_that_comes_back_has_two_crossings_and_what_is_not_finite_none():
    x = np.arange(4.0)
    assert [one[2] for one in find_crossings(x, np.array([1.0, 3.0, 1.0, 1.0]), 2.0)] == [0.5, 1.5]
    assert not list(find_crossings(x, np.array([1.0, np.inf, np.nan, 1.5]), 2.0))
    assert not list(find_crossings(x, np.ones(4), 2.0))


def test_numbers_are_numbers_in_every_csv_table(numeric):
    for name in ("requirements", "expected_verdicts", "curves", "crossings"):
        frame = METRICS[name](numeric)
        texts = [value for column in frame for value in frame[column] if isinstance(value, str)]
        assert not [text for text in texts if text[:1].isdigit() and " " in text], name
        assert not set(frame.columns) & {"count", "mean", "axes", "rank", "size", "filter", "at"}


def test_a_tornado_has_a_bar_for_every_axis_from_the_smallest_to_the_largest_error(tmp_path):
    found = tables(
        tmp_path, [f"{factor} deg" for factor in FACTORS], design="one_at_a_time",
        levels=[{"heading": "base", "imu": "base"}, {"heading": "3 deg", "imu": "base"}],
    )  # fmt: skip
    error = METRICS["expected_verdicts"](found).set_index(["requirement", "case"]).estimate["north"]
    bars = METRICS["tornado"](found).query("requirement == 'north'").set_index("axis")
    assert list(bars.index) == ["heading", "imu"]
    heading = bars.loc["heading"]
    assert (heading.low, heading.high) == (min(error), max(error))
    assert heading.base in (min(error), max(error))
    assert bars.loc["imu", "range"] == 0.0
