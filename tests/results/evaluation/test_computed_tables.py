"""The frames of results: computed once, the ones beside a report among them."""

from __future__ import annotations

from lvnav_trade.results import evaluation
from lvnav_trade.results.evaluation import computed_tables


def test_the_package_hands_out_the_frames_and_every_csv_is_one_of_them():
    assert evaluation.METRICS is computed_tables.METRICS
    assert set(evaluation.CSV) <= set(computed_tables.METRICS)
    assert not hasattr(evaluation, "FRAMES")


def test_a_frame_is_computed_once_and_every_caller_has_a_copy(good):
    first = computed_tables.METRICS["rms"](good)
    first["rms"] = 0.0
    assert (computed_tables.METRICS["rms"](good).rms > 0.0).any()
