"""Time stamps of single precision: restored to their grid, or reported with their rounding error."""

import math
from typing import NamedTuple

import numpy as np

from lvnav_trade.quantities.records import Floats

_CLEAR = 2.0  # smallest grid width in roundings: n random rows fit such a grid with probability 2^-n
_HALF = 0.501  # largest effect of rounding, in spacings of numbers of single precision
_MEANT = 1e-3  # of that spacing: a column whose numbers move less on restoration was not rounded
_ALL_DIGITS = 7  # significant digits of single precision
_SEEN = 5000  # number of rows whose digits are examined
_DIGITS = range(-3, 7)


class Stamps(NamedTuple):
    """A column of time after restoration.

    column : (n,), unit of the file. Times on their grid, or unchanged.
    note : Remark for the user; empty if the column is unchanged.
    apart : Unit of the file. Largest distance between neighbouring numbers of single precision in the column; zero
        where the column has all digits or is on its grid again.
    """

    column: Floats
    note: str
    apart: float

    @property
    def sigma(self) -> float:
        """One sigma of the remaining rounding error, in the unit of the column."""
        return self.apart / math.sqrt(12.0)


def restored(column: Floats, unit: str) -> Stamps:
    """Return time stamps (n,) with the rounding to single precision removed.

    It is removed if every time is within rounding of a grid of decimal digits or of even intervals, and the grid is
    much wider than the rounding. Otherwise the column is unchanged.

    unit : Unit of the column, for the remark.
    """
    as_is = Stamps(column, "", 0.0)
    with np.errstate(over="ignore", invalid="ignore"):
        single = column.astype(np.float32)
    if column.size < 2 or not np.all(np.isfinite(single)) or not _is_single(column, single):
        return as_is
    near = np.abs(np.spacing(single)).astype(float)  # of each number from the next
    apart = float(np.max(near))
    remark = f"time stamps of single precision, up to {apart:.2g} {unit} apart"
    grid = _grid(column, near, apart)
    if grid is None:
        ticks = column / (_CLEAR * apart)
        if np.all(ticks == np.rint(ticks)):  # a clock of binary ticks
            return as_is
        return Stamps(column, f"{remark}, fit no grid: the noise of the rows includes their rounding", apart)
    if np.max(np.abs(grid - column)) <= _MEANT * apart:
        return as_is
    return Stamps(grid, f"{remark}, are restored to the grid that they were rounded from", 0.0)


def _is_single(column: Floats, single: np.ndarray) -> bool:
    """Whether numbers (n,) are of single precision, or decimal texts of numbers of single precision.

    For decimal texts most must have all digits of single precision, because a file rounded to fewer decimals is exact.
    """
    if np.all(single == column):
        return True
    some = slice(None, None, 1 + column.size // _SEEN)
    decimals = column[some].tolist()
    if any(float(str(short)) != number for short, number in zip(single[some], decimals, strict=True)):
        return False
    return 2 * sum(_significant(number) >= _ALL_DIGITS for number in decimals) > len(decimals)


def _significant(number: float) -> int:
    return len(repr(abs(number)).partition("e")[0].replace(".", "").strip("0"))


def _grid(column: Floats, near: Floats, apart: float) -> Floats | None:
    """Return the nearest points (n,) of a wide grid that fits the column within rounding; None without such a grid."""
    for digits in _DIGITS:
        if 10.0**-digits < _CLEAR * apart:
            break
        grid = np.round(column, digits)
        if np.all(np.abs(grid - column) <= _HALF * near):
            return np.asarray(grid)
    usual = float(np.median(np.diff(column)))
    if usual < _CLEAR * apart:
        return None
    count = np.concatenate([[0.0], np.cumsum(np.rint(np.diff(column) / usual))])
    if count[-1] < 1.0:
        return None
    slope, base = np.polyfit(count, column - column[0], 1)
    grid = column[0] + base + slope * count
    return grid if np.all(np.abs(grid - column) <= near) else None


def coarse(apart: float, unit: str) -> str:
    """Return the message about repeated times of single precision; apart : spacing of such numbers, in `unit`."""
    return f"single precision resolves {apart:.3g} {unit} here; write more digits, or count from a later zero"
