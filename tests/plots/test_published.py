"""Figures of published numbers hold the numbers that they show."""

from __future__ import annotations

import json

import numpy as np
import pandas as pd
import pytest

from lvnav_trade.metrics.numbers import ours
from lvnav_trade.metrics.published import references
from lvnav_trade.plots.published import antennas, bound, clocks, locus, missions, ratios, single, spread, steps
from lvnav_trade.plots.raster import drawn
from lvnav_trade.store.read import load
from tests import synthetic

STATED = {"metric": "velocity_error_3d", "at": "injection"}


@pytest.fixture(scope="module")
def tables(tmp_path_factory):
    return load(synthetic.results(tmp_path_factory.mktemp("published"), n_run=40))


def test_every_ratio_is_a_mark_and_those_out_of_band_are_distinguished(tables):
    frame = references(tables)
    ax = drawn(ratios(frame)).axes[0]
    shown = {line.get_label(): line.get_xdata() for line in ax.get_lines()}
    np.testing.assert_allclose(shown["out of band"], frame.ratio)
    assert not len(shown["in band"])
    assert ax.get_xlabel() == "ours / published (-)"


def test_a_ratio_far_beyond_is_an_arrow_at_the_end_of_the_axis(tables):
    frame = references(tables)
    frame.loc[0, ["ratio", "band_low", "band_high"]] = [1e-5, 0.0, 900.0]
    ax = drawn(ratios(frame)).axes[0]
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
    shown = {line.get_label(): list(line.get_xdata()) for line in drawn(ratios(frame)).axes[0].get_lines()}
    assert shown["in band, published flight none of ours"] == [0.8]
    assert shown["in band"] == [0.9, 1.1]
    assert shown["out of band"] == [1.2]


def test_without_a_flight_at_an_edge_the_legend_has_no_entry_of_them(tables):
    labels = {mark.label for mark in ratios(references(tables)).legend()}
    assert {"in band", "out of band"} < labels
    assert not any("none of ours" in label for label in labels)


def test_items_that_stand_alone_need_no_case(tables):
    frame = references(tables).assign(item="")
    frame.loc[0, "item"] = "alone"
    assert drawn(ratios(frame)).axes[0].get_yticklabels()[0].get_text() == "alone"


def test_a_single_flight_stands_among_ours_each_over_the_published_number(tables):
    published = STATED | {"value": 0.5, "unit": "m/s", "single": True, "case": {"imu": "fine"}}
    ax = drawn(spread(tables, [published, published | {"single": False}])).axes[0]
    assert [label.get_text() for label in ax.get_yticklabels()] == ["velocity_error_3d at injection: imu=fine"]
    median = next(line for line in ax.get_lines() if line.get_marker() == "|").get_xdata()[0]
    assert median == pytest.approx(np.median(ours(tables, "aaaaaaaaaaaa", STATED, "m/s").runs) / 0.5)


def test_without_a_single_flight_there_is_nothing_to_draw(tables):
    assert spread(tables, [STATED | {"value": 0.5, "unit": "m/s"}]) is None


def test_a_locus_has_the_published_value_as_a_line_and_levels_by_name(tables):
    ax = drawn(locus(tables, "imu", STATED, "cm/s", published=30.0)).axes[0]
    line, published = (line.get_ydata() for line in ax.get_lines()[:2])
    expected = [ours(tables, case, STATED, "cm/s").value for case in ("aaaaaaaaaaaa", "bbbbbbbbbbbb")]
    np.testing.assert_allclose(line, expected)
    assert set(published) == {30.0}
    assert [label.get_text() for label in ax.get_xticklabels()] == ["fine", "coarse"]
    assert ax.get_ylabel() == "velocity error 3d at injection\n(cm/s)"


def test_the_base_of_one_at_a_time_has_no_place_among_the_levels(tables):
    cases = tables.cases.assign(axes=['{"imu": "base"}', '{"imu": "2 deg/h"}'])
    other = tables.with_frames(cases=cases)
    other.campaign = tables.campaign
    ax = drawn(locus(other, "imu", STATED, "cm/s")).axes[0]
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
    line, ring = drawn(locus(other, "heading", STATED, "cm/s")).axes[0].get_lines()
    values = {case: ours(tables, case, STATED, "cm/s").value for case in ("aaaaaaaaaaaa", "bbbbbbbbbbbb")}
    expected = sorted([(base, values["aaaaaaaaaaaa"]), (2.0, values["bbbbbbbbbbbb"])])
    np.testing.assert_allclose(np.transpose(line.get_data()), expected)
    np.testing.assert_allclose(np.transpose(ring.get_data()), [(base, values["aaaaaaaaaaaa"])])
    assert ring.get_label() == "flown in the study"


def test_a_zero_that_is_flown_is_a_line_where_the_axis_is_logarithmic(tables):
    other = _one_at_a_time(tables, (2.0, 4.0), 0.0)
    more = other.cases.iloc[[1]].assign(case="cccccccccccc", axes='{"heading": "400 deg"}')
    wide = other.with_frames(cases=pd.concat([other.cases, more]))
    wide.campaign = other.campaign
    ax = drawn(locus(wide, "heading", STATED, "cm/s")).axes[0]
    assert [line.get_label() for line in ax.get_lines()] == ["ours", "flown in the study (0 deg)"]
    assert 0.0 not in ax.get_lines()[0].get_xdata()


def test_a_ring_is_around_the_level_of_every_line_that_the_study_names(tables):
    ax = drawn(locus(tables, "imu", STATED, "cm/s", flown="coarse")).axes[0]
    ring = ax.get_lines()[-1]
    assert list(ring.get_xdata()) == [1.0]
    assert ring.get_ydata()[0] == pytest.approx(ours(tables, "bbbbbbbbbbbb", STATED, "cm/s").value)


FLOWN = [
    {"item": f"{name}, {what}", "metric": metric, "value": value, "unit": unit, "case": {"imu": "fine"}}
    for name, value in (("C20", 0.2), ("C19", 0.4))
    for what, metric, unit in (("velocity", "velocity_error_3d", "m/s"), ("position", "position_error_3d", "m"))
]


def test_a_panel_for_every_metric_with_its_unit_and_a_line_for_every_mission(tables):
    figure = drawn(missions(tables, FLOWN))
    assert [ax.get_xlabel() for ax in figure.axes] == ["|velocity error 3d| (m/s)", "|position error 3d| (m)"]
    lines = {line.get_label(): line.get_xdata()[0] for line in figure.axes[0].lines}
    assert (lines["C20"], lines["C19"]) == (0.2, 0.4)
    assert figure.axes[0].get_ylabel() == "flights below (%)"


def test_without_missions_or_of_a_case_that_is_not_flown_there_is_no_figure(tables):
    assert missions(tables, []) is None
    assert missions(tables, [{**FLOWN[0], "case": {"imu": "none"}}]) is None


def test_every_axis_has_its_error_and_its_estimate_and_what_is_left_with_units():
    names = [f"{kind}_{axis}" for kind in ("velocity", "position") for axis in ("radial", "along", "cross")]
    table = {f"{name}_{what}": np.linspace(0.0, k, 20) for k, name in enumerate(names)
             for what in ("true", "estimated", "left")}  # fmt: skip
    figure = drawn(single(pd.DataFrame({"t_s": np.arange(20.0), **table})))
    assert [ax.get_title() for ax in figure.axes[:3]] == ["position, radial", "position, along", "position, cross"]
    assert [ax.get_ylabel() for ax in figure.axes[::3]] == ["m", "left (m)", "m/s", "left (m/s)"]
    assert [len(ax.lines) for ax in figure.axes[:6]] == [2, 2, 2, 2, 2, 2]
    assert "s)" in figure.axes[-1].get_xlabel()


def test_three_panels_with_units_and_a_line_for_every_phase():
    columns = ("attitude_{}_rad", "velocity_{}_m_per_s", "position_{}_m")
    kinds = ("error", "missed", "missed_mean")
    table = pd.DataFrame({c.format(k): np.linspace(1.0, 2.0, 30) for c in columns for k in kinds})
    figure = drawn(
        steps(table.assign(t_s=np.arange(30.0)), [("start to cutoff", 0.0, 12.0), ("cutoff to end", 12.0, 29.0)])
    )
    assert [ax.get_ylabel().split("(")[-1] for ax in figure.axes] == ["mrad)", "m/s)", "m)"]
    assert "s)" in figure.axes[-1].get_xlabel()
    assert all(len(ax.lines) == 5 for ax in figure.axes)


def test_the_value_of_a_statement_stands_over_its_axis_with_its_bounds(tables):
    size = {"metric": "velocity_error_3d", "at": "injection"}
    stated = {"value": "a", "terms": {"a": size}, "unit": "cm/s", "along": "imu", "at_least": 20.0, "at_most": 70.0}
    ax = drawn(bound(tables, stated)).axes[0]
    lines = {line.get_label(): line.get_ydata() for line in ax.get_lines()}
    np.testing.assert_allclose(lines["formal"], 199.5 * np.sqrt(0.1**2 + 0.12**2 + 0.2**2) * np.array([1.0, 3.0]))
    assert sorted(float(line.get_ydata()[0]) for line in ax.get_lines() if line.get_label() == "bound") == [20.0, 70.0]
    assert [tick.get_text() for tick in ax.get_xticklabels()] == ["fine", "coarse"]


def test_a_clock_is_drawn_as_values_with_the_truth_among_the_solutions():
    t = np.arange(5.0)
    table = pd.DataFrame({"t_s": t, "bias_m": t, "drift_m_per_s": t, "bias_m a": t + 1.0, "drift_m_per_s a": t - 1.0})
    bias, drift = drawn(clocks(table)).axes
    assert [line.get_label() for line in bias.lines[:2]] == ["a", "true"]
    np.testing.assert_array_equal(bias.lines[0].get_ydata(), t + 1.0)
    np.testing.assert_array_equal(drift.lines[1].get_ydata(), t)


def test_antennas_are_drawn_by_angle_and_not_where_nothing_is_heard():
    angle = np.arange(361.0)
    heard = np.where(angle <= 100.0, 5.0 - angle / 50.0, -np.inf)
    first, all_round = drawn(antennas(pd.DataFrame({"angle_deg": angle, "off_boresight": heard, "right": heard}))).axes
    assert np.nanmax(first.lines[0].get_ydata()) == 5.0
    assert np.isnan(all_round.lines[0].get_ydata()[200])
