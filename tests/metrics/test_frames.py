"""The frames of results: computed once, the ones beside a report among them."""

from __future__ import annotations

from lvnav_trade import metrics
from lvnav_trade.metrics import frames


def test_the_package_hands_out_the_frames_and_every_csv_is_one_of_them():
    assert metrics.METRICS is frames.METRICS
    assert set(metrics.CSV) <= set(frames.METRICS)
    assert not hasattr(metrics, "FRAMES")


def test_a_frame_is_computed_once_and_every_caller_has_a_copy(good):
    first = frames.METRICS["rms"](good)
    first["rms"] = 0.0
    assert (frames.METRICS["rms"](good).rms > 0.0).any()
