"""Figures as JSON hold what is drawn: values, extremes of long lines, and nothing that ends a script."""

from __future__ import annotations

import base64
import json

import numpy as np

from lvnav_trade.report.figures.browser import MOST_POINTS, data_of
from lvnav_trade.report.figures.figure import canvas


def read(figure):
    found = json.loads(data_of(figure))
    arrays = [np.frombuffer(base64.b64decode(text), dtype="<f4") for text in found["arrays"]]
    return found, arrays


def test_arrays_are_stored_once_and_marks_refer_to_them():
    figure, grid = canvas(1, 2)
    x = np.array([0.0, 1.0, np.nan])
    for axes in grid[0]:
        axes.plot(x, [1.0, np.nan, 3.0], ls="--", label="line")
    found, arrays = read(figure)
    assert len(arrays) == 2
    mark = found["panels"][1]["marks"][0]
    np.testing.assert_array_equal(arrays[mark["x"]], x.astype("f4"))
    assert (mark["ls"], mark["label"], found["columns"]) == ([6, 3], "line", 2)


def test_of_a_long_line_the_extremes_and_the_gaps_are_kept():
    figure, grid = canvas()
    x = np.arange(20000.0)
    y = np.sin(x / 500.0)
    y[[7, 12345]] = -50.0, 99.0
    y[6000:6010] = np.nan
    grid[0, 0].plot(x, y)
    found, arrays = read(figure)
    mark = found["panels"][0]["marks"][0]
    shown = arrays[mark["y"]]
    assert shown.size <= 1.6 * MOST_POINTS
    assert (np.nanmin(shown), np.nanmax(shown)) == (-50.0, 99.0)
    assert np.isnan(shown).any()
    assert (np.diff(arrays[mark["x"]]) > 0.0).all()


def test_limits_that_are_not_finite_and_letters_of_html_are_harmless():
    figure, grid = canvas()
    grid[0, 0].axhline(np.nan)
    grid[0, 0].plot([0.0], [1.0], label="</script>&\u2028")
    grid[0, 0].set(ylim=(np.nan, 2.0))
    text = data_of(figure)
    assert not set("<>&\u2028") & set(text)
    panel = json.loads(text)["panels"][0]
    assert panel["ylim"] == [None, 2.0]
    assert [mark["label"] for mark in panel["marks"]] == ["</script>&\u2028"]
