"""The better case comes first."""

from __future__ import annotations

from lvnav_trade.metrics import METRICS


def test_the_better_case_ranks_first(good):
    found = METRICS["ranking"](good)
    assert list(found.case) == ["imu=fine", "imu=coarse"]
    assert (found.velocity_low < found.velocity).all()
