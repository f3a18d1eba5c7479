"""Published numbers, orders, innovations: rows of the table of references."""

from __future__ import annotations

import numpy as np
import pytest

from lvnav_trade.metrics import METRICS, published
from lvnav_trade.metrics.filter import whiteness
from lvnav_trade.metrics.published import _named, interpretations, references, short_names
from tests.vehicle_tables import DURING, RAW, SIGMA, tables

CASE, FAILED = "aaaaaaaaaaaa", 3
PHASE = "liftoff to injection"


def test_references_are_held_against_their_band_in_their_own_unit(good):
    found = METRICS["references"](good)
    assert list(found.columns) == [
        "id", "source", "item", "case", "metric", "unit", "published", "formal", "true", "monte_carlo", "low", "high",
        "ours", "ratio", "band_low", "band_high", "in_band", "percentile", "repeats", "fitted", "own", "verdict",
        "remark",
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


@pytest.mark.parametrize(
    ("order", "ratio", "holds"), [(["fine", "coarse"], 1 / 3, True), (["coarse", "fine"], 3, False)]
)
def test_an_order_of_cases_holds_or_not(good, order, ratio, holds):
    stated = SOURCE | {"metric": "velocity_error_3d", "during": "liftoff to injection"}
    found = references(good, {"orderings": [stated | {"cases": [{"imu": level} for level in order]}]}).iloc[0]
    assert found.ours == pytest.approx(ratio, rel=1e-6)
    assert found.in_band == holds
    assert found["case"] == " < ".join(f"imu={level}" for level in order)


def test_an_order_of_cases_that_are_not_there_does_not_hold(good):
    stated = SOURCE | {"metric": "velocity_error_3d", "cases": [{"imu": "fine"}, {"imu": "none"}]}
    found = references(good, {"orderings": [stated]}).iloc[0]
    assert not found.in_band
    assert found.remark == "not one case each"


@pytest.mark.parametrize("white", [True, False])
def test_innovations_drawn_white_are_called_white(good, white):
    stated = SOURCE | {"case": {"imu": "fine"}, "channels": "range", "white": white, "largest": 0.1}
    found = references(good, {"innovations": [stated]}).iloc[0]
    assert found.in_band == white
    assert 0.0 < found.ours < 0.03  # eight channels, ten lags, 199 runs of 99 epochs: a sigma of 0.007
    assert "of 8 channels" in found.remark


def test_an_unbiased_autocorrelation_above_one_is_correlated(good, monkeypatch):
    rows = whiteness(good).assign(largest_ratio=1.01)
    monkeypatch.setattr(published, "whiteness", lambda tables: rows)
    stated = SOURCE | {"case": {"imu": "fine"}, "channels": "range", "white": False}
    assert references(good, {"innovations": [stated]}).iloc[0].in_band


def test_the_channels_of_the_receivers_own_filter_are_meant_by_its_name():
    assert _named("receiver G05 range rate", "receiver range rate")
    assert not _named("receiver G05 range rate", "range rate")
    assert _named("G05 range rate", "range rate")
    assert _named("position x", "position")
    assert not _named("receiver G05 range", "position")


def test_every_case_that_is_held_against_raw_samples_stands_beside_what_is_stated_of_it():
    found = interpretations(tables())
    assert list(found.case) == ["1", "2"]
    assert list(found.stated_percent) == [88.0, 57.0]
    assert set(found.during) == {DURING}
    assert list(found.raw_percent) == pytest.approx([100.0 * (1.0 - SIGMA / RAW)] * 2)
    assert list(found.unbiased_percent) == pytest.approx([100.0 * (1.0 - SIGMA / RAW)] * 2)


def test_cases_are_named_by_what_sets_them_apart():
    found = tables()
    assert list(short_names(found, list(found.labels)).values()) == ["1", "2"]
    assert list(short_names(found, list(found.labels)[:1]).values()) == [next(iter(found.labels.values()))]


def test_a_campaign_that_holds_nothing_against_raw_samples_has_no_readings():
    found = tables()
    found.__dict__["campaign"] = {}
    assert interpretations(found).empty
