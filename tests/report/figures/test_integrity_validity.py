"""The map of where linear covariance holds, over the two axes of a campaign."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd

from lvnav_trade.report.figures.integrity import is_a_grid, validity
from lvnav_trade.report.figures.raster import matplotlib_figure
from lvnav_trade.results.tables.read import Tables

LEVELS = {f"{h}{g}": {"heading": h, "gap": g} for h in ("1 deg", "10 deg") for g in ("0 s", "100 s")}


def tables(levels, frame=None):
    """Return results that hold nothing but the levels of cases and what their spot check found."""
    cases = {"case": list(levels), "label": list(levels), "axes": [json.dumps(axes) for axes in levels.values()]}
    found = Tables(Path()).with_frames(cases=pd.DataFrame(cases))
    found.cache[("lvnav_trade.results.requirements.confirmation", "spot_check")] = frame
    return found


def test_a_grid_has_every_pair_of_levels_of_two_axes_once():
    assert is_a_grid(tables(LEVELS))
    assert not is_a_grid(tables(dict(list(LEVELS.items())[:3])))
    assert not is_a_grid(tables({case: {"heading": case} for case in "abcd"}))


def test_a_cell_holds_the_ratio_furthest_from_one_and_a_mark():
    cases = list(LEVELS)
    rows = [(case, "mrad", ratio, "agree") for case in cases for ratio in (0.9, 1.1)]
    rows += [
        (cases[1], "m", 0.2, "disagree"),
        (cases[2], "m", np.inf, "disagree"),
        (cases[3], "m", 1.0, "not applicable"),
    ]
    frame = pd.DataFrame(rows, columns=["case", "unit", "ratio", "verdict"])
    cells, bar = matplotlib_figure(validity(tables(LEVELS, frame))).axes
    assert (cells.get_xlabel(), cells.get_ylabel()) == ("heading", "gap")
    assert "(-)" in bar.get_ylabel()
    texts = [text.get_text() for text in cells.texts]
    assert texts == ["1.1", "✗ 5", "✗ > 100", "– 1.1"]
