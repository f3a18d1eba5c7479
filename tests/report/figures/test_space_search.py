"""Figures of searches."""

from __future__ import annotations

import pandas as pd

from lvnav_trade.report.figures import space
from tests.report.test_search import ANSWERS, LOOKS, ONE, SCANNED


def test_a_ratio_has_its_limit_of_one_and_its_answer() -> None:
    figure = space.ratios(pd.DataFrame(LOOKS, columns=SCANNED), pd.DataFrame(ONE, columns=ANSWERS), "initial.tilt")
    (ax,) = figure.panels
    assert "initial.tilt (deg)" in ax.axes["xlabel"]
    assert [1.5] in [list(mark.data["x"]) for mark in ax.marks if mark.mark_type == "line"]


def test_indices_have_two_panels_with_two_bars_for_each_source() -> None:
    ways = {f"{way}_{order}": [0.6, 0.4] for way in ("frozen", "retuned") for order in ("first", "total")}
    figure = space.indices(pd.DataFrame({"source": ["a", "b"], **ways}))
    assert [len(panel.marks) for panel in figure.panels] == [2, 2]
