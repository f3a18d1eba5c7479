"""The stored sky is the one that the engines saw, where there is anything to see."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from lvnav_trade.engines.setup.atmosphere import Delays
from lvnav_trade.records import IDLE, LOST
from lvnav_trade.store import load
from lvnav_trade.store.sky import sky_tables, thresholds
from tests import synthetic


def test_every_number_stands_in_its_row():
    prepared = synthetic.prepared()
    table = sky_tables(prepared)["satellites"]
    at = 30 * synthetic.N_SAT + 5
    sky, delays = prepared.sky, prepared.delays
    assert (table["t_s"][at], table["satellite"][at], table["system"][at]) == (31.0, "G06", "G")
    assert (table["antenna_number"][at], table["state"][at]) == (2, "track")
    for column, values in {
        "azimuth_rad": sky.azimuth,
        "elevation_rad": sky.elevation,
        "cn0_db_hz": sky.cn0,
        "range_sigma_m": sky.range_sigma,
        "rate_sigma_m_per_s": sky.rate_sigma,
        "troposphere_m": delays.troposphere[:, :, 0],
        "troposphere_left_m": delays.left[:, :, 0] - 2.5,
        "ionosphere_m": delays.ionosphere[:, :, 0],
        "ionosphere_left_m": 2.5 + 0.0 * sky.cn0,
    }.items():
        assert table[column][at] == pytest.approx(values[30, 5], abs=1e-12), column
    np.testing.assert_allclose(table["latency_s"][[0, -1]], [0.1, 0.3])


def test_delays_and_noise_are_those_of_measurements_alone(written):
    rows = load(written).satellites
    for column in ("troposphere_m", "ionosphere_left_m", "range_sigma_m"):
        assert (rows[column].isna() == ~rows.tracked).all()


def test_satellites_that_are_down_and_without_a_channel_are_left_out():
    made = synthetic.prepared()
    elevation, state, tracked = made.sky.elevation.copy(), made.sky.state.copy(), made.sky.tracked.copy()
    elevation[:, :3] = -0.2
    tracked[:, :2] = False
    state[:, 0], state[:, 1] = IDLE, LOST
    sky = made.sky._replace(elevation=elevation, state=state, tracked=tracked)
    table = sky_tables(SimpleNamespace(**{**vars(made), "sky": sky}))["satellites"]
    assert set(table["satellite"]) == {f"G{k:02d}" for k in range(2, 9)}


def test_no_epoch_is_lost_where_nothing_is_up():
    made = synthetic.prepared()
    nothing = np.zeros_like(made.sky.tracked)
    sky = made.sky._replace(
        elevation=made.sky.elevation - 3.0, tracked=nothing, state=np.zeros_like(made.sky.state), transitions=()
    )
    tables = sky_tables(SimpleNamespace(**{**vars(made), "sky": sky, "delays": Delays(*made.delays)}))
    assert len(tables["satellites"]["t_s"]) == synthetic.N_EPOCH
    assert set(tables["satellites"]["satellite"]) == {"G08"}
    assert tables["transitions"]["t_s"] == []


def test_a_fast_receiver_is_stored_once_a_second():
    made = synthetic.prepared()
    sky = made.sky._replace(t=made.sky.t / 10.0)
    table = sky_tables(SimpleNamespace(**{**vars(made), "sky": sky}))["satellites"]
    np.testing.assert_allclose(np.unique(np.diff(np.unique(table["t_s"]))), 1.0)


def test_transitions_are_the_receivers(written):
    rows = load(written).transitions
    first = rows[(rows.case == "aaaaaaaaaaaa") & (rows.satellite == "G02")]
    assert list(zip(first.t_s, first.from_state, first.to_state, first.reason, strict=True)) == [
        (1.0, "idle", "track", "tracked from the start"),
        (60.0, "track", "lost", "fault"),
        (75.1, "lost", "search", "search"),
        (75.5, "search", "acquire", "found"),
        (76.0, "acquire", "track", "loops closed"),
    ]


@pytest.mark.parametrize(("link", "found", "kept"), [(object(), 33.0, 25.0), (None, np.nan, np.nan)])
def test_thresholds_hold_where_there_is_a_link_budget(link, found, kept):
    tracking = SimpleNamespace(acquire_above=33.0, track_above=25.0)
    columns = thresholds(SimpleNamespace(receiver=SimpleNamespace(link=link, tracking=tracking)))
    np.testing.assert_equal(columns, {"acquire_above_db_hz": [found], "track_above_db_hz": [kept]})
