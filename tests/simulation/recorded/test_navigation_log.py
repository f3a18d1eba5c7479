"""A recorded log is read in body axes and seconds of the receiver; what is wrong with it is said in one line."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from pydantic import ValidationError

from lvnav_trade.campaign.recorded_log import read_card
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.simulation.recorded.navigation_log import NavigationLog, axis_rotation, first_row_utc, read_recording
from tests import recorded_log


@pytest.mark.parametrize("turned", [False, True])
def test_sums_are_those_of_the_increments_in_body_axes(tmp_path, turned):
    card, ref = recorded_log.write(tmp_path, turned=turned)
    log = read_recording(read_card(card), tmp_path)
    assert log.t[0] == pytest.approx(0.0, abs=1e-9)
    noise = 6.0 * recorded_log.ARW * np.sqrt(log.t[-1])
    bias = recorded_log.GYRO_BIAS * log.t[-1]
    np.testing.assert_allclose(log.angle_sums[-1], ref.dtheta.sum(axis=0) + bias, rtol=0.0, atol=noise)
    assert log.epoch == recorded_log.EPOCH
    assert log.place[0, 0] == pytest.approx(recorded_log.PLACE[0], abs=1e-6)


def test_uneven_rows_have_the_sums_of_even_ones(tmp_path):
    for name in ("even", "uneven"):
        (tmp_path / name).mkdir()
    card, _ = recorded_log.write(tmp_path / "even")
    other, _ = recorded_log.write(tmp_path / "uneven", uneven=True)
    even, uneven = (read_recording(read_card(one), one.parent) for one in (card, other))
    assert uneven.t.size < even.t.size
    at = np.searchsorted(even.t, uneven.t - 1e-6)
    np.testing.assert_allclose(uneven.angle_sums, even.angle_sums[at], atol=1e-12)
    np.testing.assert_allclose(uneven.velocity_sums, even.velocity_sums[at], atol=1e-9)


def test_a_late_time_tag_is_taken_off(tmp_path):
    card, _ = recorded_log.write(tmp_path)
    stated = read_card(card)
    late = stated.model_copy(update={"imu": stated.imu.model_copy(update={"delay": -0.02})})
    with pytest.raises(InputError, match="do not span the rest"):
        read_recording(late, tmp_path)


def test_axes_are_a_right_handed_triad():
    np.testing.assert_array_equal(axis_rotation(("y", "-x", "z")) @ [1.0, 2.0, 3.0], [2.0, -1.0, 3.0])
    stated = {
        "name": "a",
        "source": "b",
        "epoch": "2026-01-01T00:00:00Z",
        "gnss": {"file": "g"},
        "still": ["0 s", "9 s"],
    }
    for axes, said in ((["x", "y", "-z"], "no right-handed triad"), (["x", "x", "z"], "no right-handed triad")):
        with pytest.raises(ValidationError, match=said):
            NavigationLog.model_validate(stated | {"imu": {"file": "i", "axes": axes}})
    with pytest.raises(ValidationError, match="still"):
        NavigationLog.model_validate(stated | {"imu": {"file": "i"}, "still": ["9 s", "8 s"]})


def test_missing_columns_and_latitudes_beyond_the_pole_are_named(tmp_path):
    card, _ = recorded_log.write(tmp_path)
    frame = pd.read_csv(tmp_path / "gnss.csv")
    frame.assign(latitude_deg=frame.latitude_deg + 60.0).to_csv(tmp_path / "gnss.csv", index=False)
    with pytest.raises(InputError, match=r"gnss.csv:2: latitude_deg is 107\.0\d+, beyond 90"):
        read_recording(read_card(card), tmp_path)
    frame.drop(columns="v_down_m_s").to_csv(tmp_path / "gnss.csv", index=False)
    with pytest.raises(InputError, match="no column 'v_down_m_s'"):
        read_recording(read_card(card), tmp_path)


def test_ranges_have_names_of_satellites(tmp_path):
    card, _ = recorded_log.write(tmp_path, ranges=True)
    log = read_recording(read_card(card), tmp_path)
    assert log.ranges.values.shape == (len(log.ranges.satellites), 2)
    assert log.ranges.t[0] == pytest.approx(recorded_log.REST)
    frame = pd.read_csv(tmp_path / "ranges.csv")
    frame.to_parquet(tmp_path / "ranges.parquet")
    other = read_card(card)
    other = other.model_copy(update={"ranges": other.ranges.model_copy(update={"file": "ranges.parquet"})})
    assert read_recording(other, tmp_path).ranges.satellites == log.ranges.satellites
    frame.rename(columns={"satellite": "prn"}).to_csv(tmp_path / "ranges.csv", index=False)
    with pytest.raises(InputError, match="no column 'satellite'"):
        read_recording(read_card(card), tmp_path)


GPS, UNIX = "1980-01-06T00:00:00Z", "1970-01-01T00:00:00Z"
FIRST = "2026-06-01T10:00:00+00:00"  # 1464343218 s of GPS time, as any GPS calendar prints it


@pytest.mark.parametrize(
    ("epoch", "scale", "seconds"),
    [
        (GPS, None, 1464343218.0),
        (GPS, "unix", 1464343200.0),  # GPS seconds of a host that forgets the leap seconds
        (UNIX, None, 1780308000.0),
        ("2016-12-31T00:00:00Z", "gps", 297165601.0),
        ("2016-12-31T00:00:00Z", "unix", 297165600.0),
        ("2026-05-30T23:59:42Z", None, 122418.0),  # seconds of the GPS week
    ],
)
def test_the_first_row_is_at_the_same_utc_whatever_the_column_counts_from(epoch, scale, seconds):
    card = stated_log(epoch=epoch, time_scale=scale)
    assert first_row_utc(card, seconds, "gnss.csv") == FIRST


def test_leap_seconds_that_may_be_counted_or_not_are_asked_for():
    card = stated_log(epoch="2016-12-31T00:00:00Z")
    with pytest.raises(InputError, match=r"gnss.csv: 1 leap second between the epoch .* state time_scale"):
        first_row_utc(card, 297165600.0, "gnss.csv")
    with pytest.raises(InputError, match="is the unit of time right"):
        first_row_utc(stated_log(epoch=UNIX), 1780308000.0e3, "gnss.csv")
    with pytest.raises(ValidationError, match="GPS time begins 1980-01-06"):
        stated_log(epoch=UNIX, time_scale="gps")


def stated_log(**fields) -> NavigationLog:
    files = {"imu": {"file": "i"}, "gnss": {"file": "g"}}
    return NavigationLog.model_validate({"name": "a", "source": "b", "still": ["0 s", "9 s"], **files, **fields})
