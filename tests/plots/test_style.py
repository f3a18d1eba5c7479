"""Marks of events and faults."""

from __future__ import annotations

from lvnav_trade.plots import PLOTS

CASE = "aaaaaaaaaaaa"


def test_faults_are_shaded_and_events_are_named(good):
    axes = PLOTS["satellites"](good, CASE).axes[0]
    assert len(axes.patches) == 1
    assert {"stage1 cutoff", "injection"} <= {text.get_text() for text in axes.texts}
