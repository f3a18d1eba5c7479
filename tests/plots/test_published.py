"""Figures of published numbers hold the numbers that they show."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.metrics.published import ours
from lvnav_trade.metrics.references import references
from lvnav_trade.plots.published import locus, ratios, spread
from tests import synthetic

STATED = {"metric": "velocity_error_3d", "at": "injection"}


@pytest.fixture(scope="module")
def tables(tmp_path_factory):
    from lvnav_trade.store import load

    return load(synthetic.results(tmp_path_factory.mktemp("published"), n_run=40))


def test_every_ratio_is_a_mark_and_those_out_of_band_are_told_apart(tables):
    frame = references(tables)
    ax = ratios(frame).axes[0]
    drawn = {line.get_label(): line.get_xdata() for line in ax.get_lines()}
    np.testing.assert_allclose(drawn["out of band"], frame.ratio)
    assert not len(drawn["in band"])
    assert ax.get_xlabel() == "ours / published (-)"


def test_a_ratio_next_to_nothing_stands_at_the_edge_and_items_that_stand_alone_need_no_case(tables):
    frame = references(tables).assign(ratio=1e-5, item="")
    frame.loc[0, "item"] = "alone"
    ax = ratios(frame).axes[0]
    drawn = {line.get_label(): line.get_xdata() for line in ax.get_lines()}
    np.testing.assert_allclose(drawn["smaller than 0.02"], 0.02)
    assert ax.get_yticklabels()[0].get_text() == "alone"


def test_a_single_flight_stands_among_ours_each_over_the_published_number(tables):
    published = STATED | {"value": 0.5, "unit": "m/s", "single": True, "case": {"imu": "fine"}}
    ax = spread(tables, [published, published | {"single": False}]).axes[0]
    assert [label.get_text() for label in ax.get_yticklabels()] == ["velocity_error_3d at injection: imu=fine"]
    median = next(line for line in ax.get_lines() if line.get_marker() == "|").get_xdata()[0]
    assert median == pytest.approx(np.median(ours(tables, "aaaaaaaaaaaa", STATED, "m/s").runs) / 0.5)


def test_without_a_single_flight_there_is_nothing_to_draw(tables):
    assert spread(tables, [STATED | {"value": 0.5, "unit": "m/s"}]) is None


def test_a_locus_has_the_published_value_as_a_line_and_levels_by_name(tables):
    ax = locus(tables, "imu", STATED, "cm/s", published=30.0).axes[0]
    line, published = (line.get_ydata() for line in ax.get_lines()[:2])
    expected = [ours(tables, case, STATED, "cm/s").value for case in ("aaaaaaaaaaaa", "bbbbbbbbbbbb")]
    np.testing.assert_allclose(line, expected)
    assert set(published) == {30.0}
    assert [label.get_text() for label in ax.get_xticklabels()] == ["fine", "coarse"]
    assert ax.get_ylabel() == "velocity error 3d at injection\n(cm/s)"
