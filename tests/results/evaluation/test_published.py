"""Published numbers: rows of the table of references."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.results.evaluation import METRICS
from lvnav_trade.results.evaluation.published import band_of, references, verdict_in_band


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


def test_a_band_is_wider_by_half_of_the_last_printed_digit(good):
    """0.01 may be 0.005 to 0.015: a factor of two about it reaches from 0.25 to 3 of the printed number."""
    assert band_of({"value": 0.01, "digit": 0.01}) == pytest.approx((0.25, 3.0))
    assert band_of({"value": -4.0, "digit": 1.0, "band": (-0.5, 2.0)}) == pytest.approx((-0.5625, 2.25))
    assert band_of({"value": 0.49}) == (0.5, 2.0)
    number = SOURCE | {"metric": "velocity_error_3d", "value": 1.0, "unit": "m/s", "case": {"imu": "fine"}}
    ours = references(good, {"references": [number]}).ours.iloc[0]
    printed = number | {"value": 2.05 * ours}
    assert not references(good, {"references": [printed]}).in_band.iloc[0]
    assert references(good, {"references": [printed | {"digit": 0.1 * ours}]}).in_band.iloc[0]


def test_a_row_is_judged_anew_as_its_results_would_be(good):
    number = SOURCE | {"metric": "velocity_error_3d", "value": 1.0, "unit": "m/s", "case": {"imu": "fine"}}
    for factor in (0.9, 1.98, 2.05, 2.6):
        value = factor * references(good, {"references": [number]}).ours.iloc[0]
        plain, wide = number | {"value": value}, number | {"value": value, "digit": 0.2 * value}
        kept, made = (references(good, {"references": [one]}).iloc[0] for one in (plain, wide))
        again = verdict_in_band(kept, wide)
        assert again == {name: made[name] for name in again}
