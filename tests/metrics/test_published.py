"""Published numbers: rows of the table of references."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.metrics import METRICS
from lvnav_trade.metrics.published import references


def test_references_are_held_against_their_band_in_their_own_unit(good):
    found = METRICS["references"](good)
    assert list(found.columns) == [
        "id", "source", "item", "case", "metric", "unit", "published", "formal", "true", "monte_carlo", "low", "high",
        "ours", "ratio", "band_low", "band_high", "in_band", "percentile", "repeats", "fitted", "own", "again",
        "verification", "counts_as", "verdict", "remark",
    ]  # fmt: skip
    rms = METRICS["rms"](good).set_index(["case", "phase_or_event", "metric", "axis"]).rms
    assert found.ours.iloc[0] == pytest.approx(100 * rms.loc[("imu=fine", "injection", "velocity_error", "3d")])
    assert found.in_band.tolist() == [False, False]
    assert found.case.tolist() == ["imu=fine", "imu=coarse"]
    assert found.id.tolist() == ["synthetic references 1", "synthetic references 2"]
    assert found.verdict.tolist() == ["undecided", "does not hold here"]  # the first is within its interval of the band
    first = found.iloc[0]
    assert first.monte_carlo == pytest.approx(first.ours, rel=1e-9)
    assert first.formal == pytest.approx(199.5 * np.sqrt(0.1**2 + 0.12**2 + 0.2**2), rel=1e-9)
    assert first.low < first.ours < first.high
    assert first.true == pytest.approx(first.ours, rel=0.15)


def test_references_fall_back_on_linear_covariance_and_say_so(alone):
    assert set(METRICS["references"](alone).remark) == {"drawn; linear covariance", "linear covariance"}


SOURCE = {"source": "A paper", "item": "table 2"}


def test_a_campaign_may_be_asked_anew_without_flying_again(good):
    number = SOURCE | {
        "metric": "velocity_error_3d",
        "value": 1.0,
        "unit": "m/s",
        "single": True,
        "case": {"imu": "fine"},
    }
    found = METRICS["references"](good)
    again = references(good, {"references": [number]})
    assert again.ours.iloc[0] == pytest.approx(found.ours.iloc[0] / 100)
    assert 90.0 < again.percentile.iloc[0] < 100.0


def test_an_improvement_is_held_against_another_case(good):
    number = SOURCE | {"metric": "position_error_3d", "value": 66.7, "unit": "%", "case": {"imu": "fine"}}
    found = references(good, {"references": [number | {"against": {"imu": "coarse"}}]})
    assert found.ours.iloc[0] == pytest.approx(100 * (1 - 1 / 3), rel=1e-6)
    assert found.in_band.iloc[0]
    nobody = references(good, {"references": [number | {"against": {"imu": "none"}}]})
    assert nobody.remark.iloc[0] == "0 cases to hold it against"
