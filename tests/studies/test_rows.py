"""Orders of cases and statements on innovations: rows of the table of published numbers."""

from __future__ import annotations

import pandas as pd
import pytest

from lvnav_studies import rows
from lvnav_studies.rows import _is_named, claim_rows
from lvnav_trade.api.measures import COLUMNS, FRAMES, whiteness
from lvnav_trade.results.tables.read import load
from tests import synthetic

SOURCE = {"source": "A paper", "item": "table 2"}


def made(tables, claims):
    return pd.DataFrame(claim_rows(tables, claims), columns=COLUMNS)


@pytest.mark.parametrize(
    ("order", "ratio", "holds"), [(["fine", "coarse"], 1 / 3, True), (["coarse", "fine"], 3, False)]
)
def test_an_order_of_cases_holds_or_not(good, order, ratio, holds):
    stated = SOURCE | {"metric": "velocity_error_3d", "during": "liftoff to injection"}
    found = made(good, {"orderings": [stated | {"cases": [{"imu": level} for level in order]}]}).iloc[0]
    assert found.ours == pytest.approx(ratio, rel=1e-6)
    assert found.in_band == holds
    assert found["case"] == " < ".join(f"imu={level}" for level in order)


def test_an_order_of_cases_that_are_not_there_does_not_hold(good):
    stated = SOURCE | {"metric": "velocity_error_3d", "cases": [{"imu": "fine"}, {"imu": "none"}]}
    found = made(good, {"orderings": [stated]}).iloc[0]
    assert not found.in_band
    assert found.remark == "not one case each"


@pytest.mark.parametrize("white", [True, False])
def test_innovations_drawn_white_are_called_white(good, white):
    stated = SOURCE | {"case": {"imu": "fine"}, "channels": "range", "white": white, "largest": 0.1}
    found = made(good, {"innovations": [stated]}).iloc[0]
    assert found.in_band == white
    assert 0.0 < found.ours < 0.03  # eight channels, ten lags, 199 runs of 99 epochs: a sigma of 0.007
    assert "of 8 channels" in found.remark


def test_an_unbiased_autocorrelation_above_one_is_correlated(good, monkeypatch):
    correlated = whiteness(good).assign(largest_ratio=1.01)
    monkeypatch.setattr(rows, "whiteness", lambda tables: correlated)
    stated = SOURCE | {"case": {"imu": "fine"}, "channels": "range", "white": False}
    assert made(good, {"innovations": [stated]}).iloc[0].in_band


def test_the_channels_of_the_receivers_own_filter_are_meant_by_its_name():
    assert _is_named("receiver G05 range rate", "receiver range rate")
    assert not _is_named("receiver G05 range rate", "range rate")
    assert _is_named("G05 range rate", "range rate")
    assert _is_named("position x", "position")
    assert not _is_named("receiver G05 range", "position")


def test_a_metric_of_modes_may_be_an_order_and_a_statement(tmp_path):
    watched = load(synthetic.results(tmp_path / "modes", n_run=16, size=16, logic=True))
    about = {"metric": "mode_entry_time", "mode": "aiding", "during": "liftoff to end"}
    claims = {
        "orderings": [{"source": "a", "cases": [{"imu": "fine"}, {"imu": "coarse"}], "factor": 1.0, **about}],
        "statements": [{"source": "a", "value": "b - a", "unit": "s", "at_least": 19, "at_most": 21,
                        "terms": {"a": {**about, "mode": "converging"}, "b": about}}],
    }  # fmt: skip
    found = made(watched, claims)
    assert set(found.verdict) == {"holds"}
    assert found.ours.tolist() == [1.0, 20.0, 20.0]


def test_an_order_of_coverage_is_the_ratio_of_the_shares(good):
    about = {"source": "a page", "metric": "velocity_coverage", "at": "injection", "factor": 1.5}
    order = made(good, {"orderings": [about | {"cases": [{"imu": "fine"}, {"imu": "coarse"}]}]}).iloc[0]
    shares = FRAMES["coverage"](good).set_index(["case", "event", "quantity"]).all_inside_ratio
    assert order.ours == pytest.approx(
        shares["imu=fine", "injection", "velocity"] / shares["imu=coarse", "injection", "velocity"]
    )
