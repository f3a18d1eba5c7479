"""Times: civil time to GPS time, and time stamps of single precision restored to their grid."""

import math
from bisect import bisect_right
from datetime import UTC, datetime, timedelta
from typing import NamedTuple

import numpy as np

from lvnav_trade.quantities.errors import InputError
from lvnav_trade.quantities.records import Floats

SECONDS_PER_WEEK = 604800.0
WEEK_ROLLOVER = 1024
GPS_ORIGIN = datetime(1980, 1, 6, tzinfo=UTC)
UNIX_ORIGIN = datetime(1970, 1, 1, tzinfo=UTC)
# BeiDou time began with 2006-01-01 00:00 UTC, when GPS time was 14 s ahead of UTC, and has no leap seconds either
# (BDS-SIS-ICD B1I 3.0, section 3.3).
BDT_WEEKS, BDT_BEHIND = 1356, 14.0  # weeks of GPS time at its origin; s
BDT_TRUNCATED = 256  # eight bits of a week number in a BeiDou almanac

# First UTC day on which GPS time leads UTC by one second more than before (IERS Bulletin C; 18 s since 2017, and no
# leap second has been announced since).
LEAP_DAYS = tuple(
    datetime.fromisoformat(day).replace(tzinfo=UTC)
    for day in (
        "1981-07-01", "1982-07-01", "1983-07-01", "1985-07-01", "1988-01-01", "1990-01-01", "1991-01-01", "1992-07-01",
        "1993-07-01", "1994-07-01", "1996-01-01", "1997-07-01", "1999-01-01", "2006-01-01", "2009-01-01", "2012-07-01",
        "2015-07-01", "2017-01-01",
    )
)  # fmt: skip


def leap_seconds(utc: datetime) -> int:
    """Return GPS time minus UTC (s) at a time in UTC."""
    return bisect_right(LEAP_DAYS, utc)


def gps_seconds(epoch: str) -> float:
    """Return the seconds of GPS time since 1980-01-06 00:00 at an ISO 8601 time.

    A time without offset is UTC. InputError if the text is not a time, or lies before 1980-01-06.
    """
    utc = utc_time(epoch)
    if utc < GPS_ORIGIN:
        raise InputError(f"{epoch!r} lies before GPS time begins (1980-01-06)")
    return (utc - GPS_ORIGIN).total_seconds() + leap_seconds(utc)


def utc_of(seconds: float) -> datetime:
    """Return the time in UTC at seconds of GPS time since 1980-01-06 00:00; during a leap second the next midnight."""
    gps_time = GPS_ORIGIN + timedelta(seconds=seconds)
    leaps = leap_seconds(gps_time)
    while leaps and gps_time - timedelta(seconds=leaps) < LEAP_DAYS[leaps - 1]:  # the last leap second is still ahead
        if gps_time - timedelta(seconds=leaps - 1) >= LEAP_DAYS[leaps - 1]:
            return LEAP_DAYS[leaps - 1]
        leaps -= 1
    return gps_time - timedelta(seconds=leaps)


def utc_after(epoch: str, seconds: float) -> str:
    """Return the time in UTC (ISO 8601) `seconds` after an epoch, with leap seconds.

    After the Unix epoch, 1970-01-01T00:00:00Z, each day has 86,400 s, because Unix time has no leap seconds. GPS time
    and other continuous clocks have them. InputError if the epoch is not a time.
    """
    start = utc_time(epoch)
    if start == UNIX_ORIGIN:
        return (start + timedelta(seconds=seconds)).isoformat()
    utc_seconds = (start - GPS_ORIGIN).total_seconds()
    gps_seconds_after = utc_seconds + leap_seconds(start) + seconds
    return utc_of(gps_seconds_after).isoformat()


def utc_time(epoch: str) -> datetime:
    """Return the time of an ISO 8601 text in UTC; without offset it is UTC. InputError if the text is not a time."""
    try:
        moment = datetime.fromisoformat(epoch)
    except ValueError:
        raise InputError(f"{epoch!r} is not an ISO 8601 time such as 2026-08-01T12:00:00Z") from None
    return moment.replace(tzinfo=UTC) if moment.tzinfo is None else moment.astimezone(UTC)


def resolve_week(week: int, seconds: float, reference_time: float, rollover: int = WEEK_ROLLOVER) -> float:
    """Return s of GPS time for a week number and seconds of week, in the era closest to the time `reference_time` (s).

    A week number of `rollover` or more is complete; a smaller number is truncated, as satellites send it.

    rollover : Number of weeks of an era.
    """
    time = week * SECONDS_PER_WEEK + seconds
    if week >= rollover:
        return time
    era = rollover * SECONDS_PER_WEEK
    n_era = round((reference_time - time) / era)
    return time + era * max(0, n_era)


def resolve_beidou_week(week: int, seconds: float, reference_time: float) -> float:
    """Return s of GPS time for week number and seconds of week of BeiDou time; as `resolve_week`, of 256-week eras."""
    bdt_offset = BDT_WEEKS * SECONDS_PER_WEEK + BDT_BEHIND
    return resolve_week(week, seconds, reference_time - bdt_offset, BDT_TRUNCATED) + bdt_offset


_CLEAR = 2.0  # smallest grid width in roundings: n random rows fit such a grid with probability 2^-n
_HALF = 0.501  # largest effect of rounding, in spacings of numbers of single precision
_MEANT = 1e-3  # of that spacing: a column whose numbers move less on restoration was not rounded
_ALL_DIGITS = 7  # significant digits of single precision
_SEEN = 5000  # number of rows whose digits are examined
_DIGITS = range(-3, 7)


class RestoredTimes(NamedTuple):
    """A column of time after restoration.

    column : (n,), unit of the file. Times on their grid, or unchanged.
    note : Remark for the user; empty if the column is unchanged.
    spacing : Unit of the file. Largest distance between neighbouring numbers of single precision in the column; zero
        where the column has all digits or is on its grid again.
    """

    column: Floats
    note: str
    spacing: float

    @property
    def sigma(self) -> float:
        """One sigma of the remaining rounding error, in the unit of the column."""
        return self.spacing / math.sqrt(12.0)


def restore_time_stamps(column: Floats, unit: str) -> RestoredTimes:
    """Return time stamps (n,) with the rounding to single precision removed.

    It is removed if every time is within rounding of a grid of decimal digits or of even intervals, and the grid is
    much wider than the rounding. Otherwise the column is unchanged.

    unit : Unit of the column, for the remark.
    """
    unchanged_times = RestoredTimes(column, "", 0.0)
    with np.errstate(over="ignore", invalid="ignore"):
        single = column.astype(np.float32)
    if column.size < 2 or not np.all(np.isfinite(single)) or not _is_single(column, single):
        return unchanged_times
    spacings = np.abs(np.spacing(single)).astype(float)  # of each number from the next
    largest_spacing = float(np.max(spacings))
    remark = f"time stamps of single precision, up to {largest_spacing:.2g} {unit} apart"
    grid = _grid(column, spacings, largest_spacing)
    if grid is None:
        least_width = _CLEAR * largest_spacing
        ticks = column / least_width
        if np.all(ticks == np.rint(ticks)):  # a clock of binary ticks
            return unchanged_times
        return RestoredTimes(
            column, f"{remark}, fit no grid: the noise of the rows includes their rounding", largest_spacing
        )
    if np.max(np.abs(grid - column)) <= _MEANT * largest_spacing:
        return unchanged_times
    return RestoredTimes(grid, f"{remark}, are restored to the grid that they were rounded from", 0.0)


def _is_single(column: Floats, single: np.ndarray) -> bool:
    """Whether numbers (n,) are of single precision, or decimal texts of numbers of single precision.

    For decimal texts most must have all digits of single precision, because a file rounded to fewer decimals is exact.
    """
    if np.all(single == column):
        return True
    sample = slice(None, None, 1 + column.size // _SEEN)
    decimals = column[sample].tolist()
    for short, number in zip(single[sample], decimals, strict=True):
        if float(str(short)) != number:
            return False
    n_full = sum(_digit_count(number) >= _ALL_DIGITS for number in decimals)
    return 2 * n_full > len(decimals)


def _digit_count(number: float) -> int:
    """Return the number of significant decimal digits of a number."""
    mantissa, _, _ = repr(abs(number)).partition("e")
    return len(mantissa.replace(".", "").strip("0"))


def _grid(column: Floats, spacings: Floats, largest_spacing: float) -> Floats | None:
    """Return the nearest points (n,) of a wide grid that fits the column within rounding; None without such a grid."""
    for digits in _DIGITS:
        if 10.0**-digits < _CLEAR * largest_spacing:
            break
        grid = np.round(column, digits)
        if np.all(np.abs(grid - column) <= _HALF * spacings):
            return np.asarray(grid)
    # even intervals: a line fitted to the times by the number of intervals since the first
    intervals = np.diff(column)
    median_interval = float(np.median(intervals))
    if median_interval < _CLEAR * largest_spacing:
        return None
    steps = np.rint(intervals / median_interval)
    count = np.concatenate([[0.0], np.cumsum(steps)])
    if count[-1] < 1.0:
        return None
    start = column[0]
    slope, base = np.polyfit(count, column - start, 1)
    grid = start + base + slope * count
    return grid if np.all(np.abs(grid - column) <= spacings) else None


def coarse_message(spacing: float, unit: str) -> str:
    """Return the message about repeated times of single precision, whose numbers are `spacing` apart (in `unit`)."""
    return f"single precision resolves {spacing:.3g} {unit} here; write more digits, or count from a later zero"
