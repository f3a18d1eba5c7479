"""Figures of delays and latency show the tables."""

from __future__ import annotations

import numpy as np

from lvnav_trade.plots import PLOTS
from lvnav_trade.plots.delays import layers_of

CASE = "aaaaaaaaaaaa"


def test_true_delays_stand_above_what_the_correction_leaves(good):
    axes = PLOTS["delays"](good, CASE).axes
    assert [a.get_ylabel().split("\n")[0] for a in axes] == [
        "troposphere, true", "ionosphere, true", "troposphere, left by", "ionosphere, left by"
    ]  # fmt: skip
    true, left = (next(line for line in a.get_lines() if line.get_label() == "their median") for a in axes[1::2])
    known = np.isfinite(true.get_ydata())
    np.testing.assert_array_equal(true.get_ydata()[known], 5.0)
    np.testing.assert_array_equal(left.get_ydata()[known], 2.5)
    assert not known[65]  # in the outage nothing is measured


def test_a_layer_without_delay_is_not_drawn(good):
    rows = good.satellites.assign(ionosphere_m=0.0, ionosphere_left_m=0.0)
    assert layers_of(rows) == ["troposphere"]
    bare = type(good)(good.folder)
    bare._read["satellites"] = rows
    assert len(PLOTS["delays"](bare, CASE).axes) == 2


def test_latency_is_drawn_in_milliseconds(good):
    line = PLOTS["latency"](good, CASE).axes[0].get_lines()[0]
    np.testing.assert_allclose(line.get_ydata()[[0, -1]], [100.0, 300.0])
