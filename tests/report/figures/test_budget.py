"""The sandpile and the map of contributions show the tables."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from lvnav_trade.report.figures import PLOTS
from lvnav_trade.report.figures.raster import matplotlib_figure

CASE = "aaaaaaaaaaaa"


def test_the_top_of_the_pile_is_the_true_variance(good):
    """The layers are areas between cumulated variances; the uppermost edge is their sum."""
    axes = matplotlib_figure(PLOTS["budget"](good, CASE, "velocity")).axes[0]
    history = good.history
    rows = history[(history.case == CASE) & (history.quantity == "velocity") & (history.axis == "3d")]
    top = max(float(layer.get_paths()[0].vertices[:, 1].max()) for layer in axes.collections[:2])
    assert top == pytest.approx(float(rows.lincov_true_si.max()) ** 2, rel=1e-9)


def test_the_line_is_the_filters_own_variance(good):
    axes = matplotlib_figure(PLOTS["budget"](good, CASE, "attitude")).axes[0]
    history = good.history
    rows = history[(history.case == CASE) & (history.quantity == "attitude") & (history.axis == "3d")]
    np.testing.assert_allclose(axes.get_lines()[0].get_ydata(), (rows.lincov_formal_si * 1e3) ** 2, rtol=1e-12)


def test_the_axis_of_variances_is_labelled_with_sigmas(good):
    axes = matplotlib_figure(PLOTS["budget"](good, CASE, "position")).axes[0]
    ticks = axes.get_yticks()
    labels = [float(axes.yaxis.get_major_formatter()(tick, 0)) for tick in ticks]
    np.testing.assert_allclose(np.square(labels), ticks, rtol=1e-6, atol=1e-12)


def test_the_map_has_the_largest_source_on_top_and_its_sum_beside_it(good):
    figure = matplotlib_figure(PLOTS["heatmap"](good, CASE, "velocity"))
    start, axes = figure.axes[:2]
    assert [label.get_text() for label in start.get_yticklabels()] == ["gyro bias", "range noise"]
    assert start.yaxis_inverted()
    assert [text.get_text() for text in axes.texts][:2] == ["75.0 %", "25.0 %"]
    assert axes.collections[0].get_array().compressed().sum() == pytest.approx(90.0)  # nine of ten bins


@pytest.fixture
def many(good):
    """The results with each source cut into fifteen, of ever smaller parts."""
    parts = 0.5 ** np.arange(15)
    tables = type(good)(good.folder)
    for name, value in (("budget", "share_ratio"), ("adjoint", "variance_si2")):
        table = getattr(good, name)
        pieces = [
            table.assign(source=table.source + f" {k:02d}", **{value: table[value] * part / parts.sum()})
            for k, part in enumerate(parts)
        ]
        tables._read[name] = pd.concat(pieces, ignore_index=True)
    return tables


def test_of_many_sources_the_smallest_are_summed(many):
    figure = matplotlib_figure(PLOTS["budget"](many, CASE, "velocity"))
    reported = [text.get_text() for text in figure.legends[0].get_texts()]
    assert reported == [
        "gyro bias 00", "gyro bias 01", "range noise 00", "gyro bias 02", "range noise 01", "gyro bias 03",
        "range noise 02", "all others", "filter's own sigma (white on black)", "mean, the same in every run",
    ]  # fmt: skip
    start, axes = matplotlib_figure(PLOTS["heatmap"](many, CASE, "velocity")).axes[:2]
    names = [label.get_text() for label in start.get_yticklabels()]
    assert len(names) == 13
    assert names[-1] == "all others"
    sums = [float(text.get_text().split()[0]) for text in axes.texts[:13]]
    assert sum(sums) == pytest.approx(100.0, abs=0.5)
