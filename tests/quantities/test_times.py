from datetime import timedelta

import pytest

from lvnav_trade.quantities.errors import InputError
from lvnav_trade.quantities.times import LEAP_DAYS, gps_seconds, resolve_week, utc_after, utc_of


@pytest.mark.parametrize(
    ("utc", "expected"),
    [
        ("1980-01-06T00:00:00Z", 0),
        ("2000-01-01T00:00:00Z", 630720013),  # 13 leap seconds, as any GPS calendar prints it
        ("2016-12-31T23:59:59Z", 1167264016),
        ("2017-01-01T00:00:00Z", 1167264018),  # a leap second stands between
        ("2017-01-01", 1167264018),
        ("2017-01-01T02:00:00+02:00", 1167264018),
        ("2026-08-01T12:00:00.250Z", 1469620818.25),
    ],
)
def test_gps_time_counts_the_leap_seconds(utc, expected):
    assert gps_seconds(utc) == expected


def test_utc_is_the_inverse_of_gps_time_on_both_sides_of_every_leap_second():
    for day in LEAP_DAYS:
        for apart in (-86400.0, -1.0, -0.25, 0.0, 0.25, 1.0, 86400.0):
            utc = day + timedelta(seconds=apart)
            assert utc_of(gps_seconds(utc.isoformat())) == utc
        assert utc_of(gps_seconds(day.isoformat()) - 0.5) == day  # within the leap second


def test_a_clock_that_runs_on_is_behind_utc_by_the_leap_seconds_between():
    assert utc_after("1980-01-06T00:00:00Z", 1167264018.0) == "2017-01-01T00:00:00+00:00"
    assert utc_after("1980-01-06T00:00:00Z", 1469620818.25) == "2026-08-01T12:00:00.250000+00:00"
    assert utc_after("2016-12-31T23:59:50Z", 20.0) == "2017-01-01T00:00:09+00:00"
    assert utc_after("2026-12-31T23:59:59+00:00", 1.5) == "2027-01-01T00:00:00.500000+00:00"


def test_unix_time_counts_no_leap_seconds():
    assert utc_after("1970-01-01T00:00:00Z", 1483228800.0) == "2017-01-01T00:00:00+00:00"


@pytest.mark.parametrize("text", ["", "yesterday", "2026-13-01", "1979-12-31T00:00:00Z"])
def test_a_time_that_cannot_be_is_refused_in_one_line(text):
    with pytest.raises(InputError) as refused:
        gps_seconds(text)
    assert repr(text) in str(refused.value)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("week", "utc", "expected"),
    [
        (819, "2015-05-06T17:00:00Z", 1843),
        (1843, "2015-05-06T17:00:00Z", 1843),
        (819, "1995-09-20T00:00:00Z", 819),
        (1023, "2019-04-08T00:00:00Z", 2047),  # two days after a rollover, with an almanac from before it
        (0, "2019-04-05T00:00:00Z", 2048),  # the day before it, with an almanac of next week
        (2430, "2015-05-06T17:00:00Z", 2430),  # a week counted on is taken as it is
    ],
)
def test_a_ten_bit_week_is_resolved_to_the_era_of_the_lift_off(week, utc, expected):
    assert resolve_week(week, 3600.0, gps_seconds(utc)) == expected * 604800 + 3600
