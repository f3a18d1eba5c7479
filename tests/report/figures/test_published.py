"""Figures of published numbers hold the numbers that they show."""

from __future__ import annotations

import json

import numpy as np
import pandas as pd
import pytest

from lvnav_trade.report.figures.published import PublishedValue, locus, ratios, spread, steps
from lvnav_trade.report.figures.raster import matplotlib_figure
from lvnav_trade.results.evaluate import evaluate_single
from lvnav_trade.results.evaluation.published import references
from lvnav_trade.results.tables.read import load
from tests import synthetic

STATED = {"metric": "velocity_error_3d", "at": "injection"}


@pytest.fixture(scope="module")
def tables(tmp_path_factory):
    return load(synthetic.results(tmp_path_factory.mktemp("published"), n_run=40))


def test_every_ratio_is_a_mark_and_those_out_of_band_are_distinguished(tables):
    frame = references(tables)
    ax = matplotlib_figure(ratios(frame)).axes[0]
    shown = {line.get_label(): line.get_xdata() for line in ax.get_lines()}
    np.testing.assert_allclose(shown["out of band"], frame.ratio)
    assert not len(shown["in band"])
    assert ax.get_xlabel() == "ours / published (-, log)"


def test_a_ratio_far_beyond_is_an_arrow_at_the_end_of_the_axis(tables):
    frame = references(tables)
    frame.loc[0, ["ratio", "band_low", "band_high"]] = [1e-5, 0.0, 900.0]
    ax = matplotlib_figure(ratios(frame)).axes[0]
    arrows = {line.get_marker(): list(line.get_xdata()) for line in ax.get_lines() if len(line.get_xdata())}
    assert arrows["<"] == [0.02]
    assert ">" not in arrows
    band = next(line for line in ax.get_lines() if line.get_label() == "band")
    assert tuple(band.get_xdata()[:2]) == (0.02, 50.0)


def test_a_row_in_band_whose_single_flight_is_none_of_ours_has_a_mark_of_its_own(tables):
    frame = pd.concat([references(tables).iloc[:1]] * 4, ignore_index=True)
    frame = frame.assign(
        ratio=[0.8, 0.9, 1.1, 1.2], in_band=[True, True, True, False], percentile=[0.5, 50, np.nan, 99]
    )
    shown = {line.get_label(): list(line.get_xdata()) for line in matplotlib_figure(ratios(frame)).axes[0].get_lines()}
    assert shown["in band, published flight outside our runs"] == [0.8]
    assert shown["in band"] == [0.9, 1.1]
    assert shown["out of band"] == [1.2]


def test_without_a_flight_at_an_edge_the_legend_has_no_entry_of_them(tables):
    labels = {mark.label for mark in ratios(references(tables)).legend()}
    assert {"in band", "out of band"} < labels
    assert not any("outside our runs" in label for label in labels)


def test_items_that_stand_alone_need_no_case(tables):
    frame = references(tables).assign(item="")
    frame.loc[0, "item"] = "alone"
    assert matplotlib_figure(ratios(frame)).axes[0].get_yticklabels()[0].get_text() == "alone"


def test_a_single_flight_stands_among_ours_each_over_the_published_number(tables):
    published = STATED | {"value": 0.5, "unit": "m/s", "single": True, "case": {"imu": "fine"}}
    ax = matplotlib_figure(spread(tables, [published, published | {"single": False}])).axes[0]
    assert [label.get_text() for label in ax.get_yticklabels()] == ["velocity_error_3d at injection: imu=fine"]
    median = next(line for line in ax.get_lines() if line.get_marker() == "|").get_xdata()[0]
    assert median == pytest.approx(np.median(evaluate_single(tables, "aaaaaaaaaaaa", STATED, "m/s").runs) / 0.5)


def test_without_a_single_flight_there_is_nothing_to_draw(tables):
    assert spread(tables, [STATED | {"value": 0.5, "unit": "m/s"}]) is None


def test_a_locus_has_the_published_value_as_a_line_and_levels_by_name(tables):
    ax = matplotlib_figure(locus(tables, "imu", STATED, "cm/s", published=PublishedValue(30.0))).axes[0]
    line, published = (line.get_ydata() for line in ax.get_lines()[:2])
    expected = [evaluate_single(tables, case, STATED, "cm/s").value for case in ("aaaaaaaaaaaa", "bbbbbbbbbbbb")]
    np.testing.assert_allclose(line, expected)
    assert set(published) == {30.0}
    assert [label.get_text() for label in ax.get_xticklabels()] == ["fine", "coarse"]
    assert ax.get_ylabel() == "velocity error 3d at injection\n(cm/s)"


def test_the_base_of_one_at_a_time_has_no_place_among_the_levels(tables):
    cases = tables.cases.assign(axes=['{"imu": "base"}', '{"imu": "2 deg/h"}'])
    other = tables.with_frames(cases=cases)
    other.campaign = tables.campaign
    ax = matplotlib_figure(locus(other, "imu", STATED, "cm/s")).axes[0]
    assert list(ax.get_lines()[0].get_xdata()) == [2.0]
    assert ax.get_xlabel() == "imu (deg/h)"


def _one_at_a_time(tables, values, base):
    """The first synthetic case as the base, the second as the only other level of an axis."""
    labels = [f"{value} deg" for value in values]
    cases = tables.cases.assign(axes=['{"heading": "base"}', json.dumps({"heading": labels[0]})])
    other = tables.with_frames(cases=cases)
    axis = {"path": "initial.heading", "labels": labels, "values": [f"{np.radians(value)} rad" for value in values]}
    other.campaign = tables.campaign | {"axes": [axis], "base": {"initial": {"heading": f"{np.radians(base)} rad"}}}
    return other


@pytest.mark.parametrize("base", [1.0, 4.0])
def test_a_ring_marks_what_the_study_flies_and_the_line_goes_through_it(tables, base):
    """Whether it is none of the levels, or one whose case is the base."""
    other = _one_at_a_time(tables, (2.0, 4.0), base)
    line, ring = matplotlib_figure(locus(other, "heading", STATED, "cm/s")).axes[0].get_lines()
    values = {case: evaluate_single(tables, case, STATED, "cm/s").value for case in ("aaaaaaaaaaaa", "bbbbbbbbbbbb")}
    expected = sorted([(base, values["aaaaaaaaaaaa"]), (2.0, values["bbbbbbbbbbbb"])])
    np.testing.assert_allclose(np.transpose(line.get_data()), expected)
    np.testing.assert_allclose(np.transpose(ring.get_data()), [(base, values["aaaaaaaaaaaa"])])
    assert ring.get_label() == "used in the study"


def test_a_zero_that_is_flown_is_a_line_where_the_axis_is_logarithmic(tables):
    other = _one_at_a_time(tables, (2.0, 4.0), 0.0)
    more = other.cases.iloc[[1]].assign(case="cccccccccccc", axes='{"heading": "400 deg"}')
    wide = other.with_frames(cases=pd.concat([other.cases, more]))
    wide.campaign = other.campaign
    ax = matplotlib_figure(locus(wide, "heading", STATED, "cm/s")).axes[0]
    assert [line.get_label() for line in ax.get_lines()] == ["ours", "used in the study (0 deg)"]
    assert 0.0 not in ax.get_lines()[0].get_xdata()


def test_a_ring_is_around_the_level_of_every_line_that_the_study_names(tables):
    ax = matplotlib_figure(locus(tables, "imu", STATED, "cm/s", study_level="coarse")).axes[0]
    ring = ax.get_lines()[-1]
    assert list(ring.get_xdata()) == [1.0]
    assert ring.get_ydata()[0] == pytest.approx(evaluate_single(tables, "bbbbbbbbbbbb", STATED, "cm/s").value)


def test_three_panels_with_units_and_a_line_for_every_phase():
    columns = ("attitude_{}_rad", "velocity_{}_m_per_s", "position_{}_m")
    kinds = ("error", "missed", "missed_mean")
    table = pd.DataFrame({c.format(k): np.linspace(1.0, 2.0, 30) for c in columns for k in kinds})
    figure = matplotlib_figure(
        steps(table.assign(t_s=np.arange(30.0)), [("start to cutoff", 0.0, 12.0), ("cutoff to end", 12.0, 29.0)])
    )
    assert [ax.get_ylabel().split("(")[-1] for ax in figure.axes] == ["mrad, log)", "m/s, log)", "m, log)"]
    assert "s)" in figure.axes[-1].get_xlabel()
    assert all(len(ax.lines) == 5 for ax in figure.axes)
