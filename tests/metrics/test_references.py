"""Published numbers in their own unit."""

from __future__ import annotations

import pytest

from lvnav_trade.metrics import METRICS


def test_references_are_held_against_their_band_in_their_own_unit(good):
    found = METRICS["references"](good)
    assert list(found.columns) == [
        "source", "item", "case", "metric", "unit", "published", "ours", "ratio", "band_low", "band_high", "in_band",
        "remark",
    ]  # fmt: skip
    rms = METRICS["rms"](good).set_index(["case", "phase_or_event", "metric", "axis"]).rms
    assert found.ours.iloc[0] == pytest.approx(100 * rms.loc[("imu=fine", "injection", "velocity_error", "3d")])
    assert found.in_band.tolist() == [False, False]
    assert found.case.tolist() == ["imu=fine", "imu=coarse"]


def test_references_fall_back_on_linear_covariance_and_say_so(alone):
    assert set(METRICS["references"](alone).remark) == {"drawn; linear covariance", "linear covariance"}
