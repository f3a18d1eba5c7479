"""White innovations pass."""

from __future__ import annotations

from lvnav_trade.metrics import METRICS
from lvnav_trade.store import Tables


def test_white_innovations_pass_and_channels_have_names(good):
    found = METRICS["whiteness"](good)
    assert found.white.all()
    assert found.channel.iloc[0] == "G01 range"
    assert found.channel.nunique() == 16


def test_coloured_innovations_fail_in_their_channel_and_the_lag_is_named(good):
    """A product sum of 0.1 per pair at lag 3 among 17 900 pairs is thirteen sigma."""
    rows = good.whiteness.copy()
    hit = (rows.channel == "G02 range") & (rows.lag_number == 3)
    rows.loc[hit, "product_sum_ratio"] = 0.1 * rows.pair_count[hit]
    coloured = Tables(good.folder)
    coloured._read["whiteness"] = rows
    found = METRICS["whiteness"](coloured).set_index(["case", "channel"])
    assert not found.loc[("imu=fine", "G02 range"), "white"]
    assert found.loc[("imu=fine", "G02 range"), "largest_lag_number"] == 3
    assert found.white.sum() == 30
