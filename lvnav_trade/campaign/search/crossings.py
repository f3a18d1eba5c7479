"""Values of a variable at which several ratios are at most 1, from a grid and the crossings between its values."""

import math
from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from scipy import optimize

from lvnav_trade.quantities.records import Floats

_CLOSE = 1e-3  # relative tolerance of the crossings


class PermittedValues(NamedTuple):
    """Values of a variable at which a function is at most 1."""

    intervals: tuple[tuple[float, float], ...]  # intervals of these values
    answer: float  # largest value in the intervals; NaN if there is none
    limiting_requirement: str  # at the upper end; empty if there is no limit up to the last value
    monotone: bool  # whether the function is at most 1 for all values below the answer


def search(
    ratio: Callable[[float], Mapping[str, float]], grid: Floats, log: bool, refine: bool = True
) -> PermittedValues:
    """Find the values of a variable at which the largest of several ratios is at most 1.

    Parameters
    ----------
    ratio : callable
        Returns the ratios by name for a value; NaN if the value is not possible.
    grid : (n,) array
        Increasing values to evaluate first. Between neighbours on different sides of 1, Brent's method finds the
        crossing.
    log : bool
        Search in the logarithm of the value.
    refine : bool
        Find the crossings; if not, the last grid value that is met is the end of an interval.

    Returns
    -------
    PermittedValues
        Intervals, largest value, limiting ratio.
    """
    cache: dict[float, Mapping[str, float]] = {}

    def ratios_at(value: float) -> Mapping[str, float]:
        if value not in cache:
            cache[value] = ratio(value)
        return cache[value]

    def excess(value: float) -> float:
        return _excess(ratios_at(value))

    possible_values = [value for value in map(float, grid) if not math.isnan(excess(value))]
    if not possible_values:
        return PermittedValues((), math.nan, "", True)
    crossings = []  # between neighbours on different sides of 1: first value beyond the crossing, and the crossing
    for low, high in pairwise(possible_values):
        is_low_permitted = excess(low) <= 0.0
        is_high_permitted = excess(high) <= 0.0
        if is_low_permitted != is_high_permitted:
            permitted_value = low if is_low_permitted else high
            try:
                crossing = _crossing(excess, low, high, log) if refine else permitted_value
            except ValueError:  # a value between them is not possible: excess is NaN there
                crossing = permitted_value
            crossings.append((high, crossing))
    first = possible_values[0]
    last = possible_values[-1]
    is_first_permitted = excess(first) <= 0.0
    intervals, first_beyond = _intervals(first, last, crossings, is_first_permitted)
    if not intervals:
        return PermittedValues((), math.nan, _largest(ratios_at(first)), True)
    answer = intervals[-1][1]
    limiting = ""
    if not math.isnan(first_beyond):
        value_beyond = _nearest(cache, answer) if refine else first_beyond
        limiting = _largest(ratios_at(value_beyond))
    is_monotone = len(intervals) == 1 and intervals[0][0] == first
    return PermittedValues(tuple(intervals), answer, limiting, is_monotone)


def _excess(ratios: Mapping[str, float]) -> float:
    """Return the logarithm of the largest ratio: above 0 if the value is not permitted, NaN if it is not possible."""
    values = list(ratios.values())
    if not values or np.isnan(values).any() or max(values) <= 0.0:
        return math.nan
    return math.log(max(values))


def _intervals(
    first: float, last: float, crossings: Sequence[tuple[float, float]], is_first_permitted: bool
) -> tuple[list[tuple[float, float]], float]:
    """Return the permitted intervals, which begin and end at the crossings.

    Parameters
    ----------
    first, last : float
        First and last value of the search.
    crossings : sequence of (float, float)
        Grid value after each crossing, and the value of the crossing.
    is_first_permitted : bool
        Whether the first value is permitted.

    Returns
    -------
    list of (float, float), float
        Intervals; grid value after the end of the last interval, NaN if this ends at the last value.
    """
    intervals = []
    begin = first
    is_permitted = is_first_permitted
    first_beyond = math.nan
    for next_value, crossing in crossings:
        if is_permitted:
            intervals.append((begin, crossing))
            first_beyond = next_value
        else:
            begin = crossing
        is_permitted = not is_permitted
    if is_permitted:
        intervals.append((begin, last))
        first_beyond = math.nan
    return intervals, first_beyond


def _crossing(excess: Callable[[float], float], low: float, high: float, log: bool) -> float:
    """Return the value at which a function changes its sign, by Brent's method.

    Parameters
    ----------
    excess : callable
        Function of the value.
    low, high : float
        Values between which its sign changes.
    log : bool
        Whether the search is on a logarithmic scale.
    """
    if not log:
        tolerance = _CLOSE * max(abs(low), abs(high))
        return float(optimize.brentq(excess, low, high, xtol=0.3 * tolerance))

    def excess_of_log(u: float) -> float:
        return excess(math.exp(u))

    log_low = math.log(low)
    log_high = math.log(high)
    root = optimize.brentq(excess_of_log, log_low, log_high, xtol=0.3 * _CLOSE)
    return math.exp(float(root))


def _nearest(ratios_by_value: Mapping[float, Any], value: float) -> float:
    """Return the evaluated value nearest to a value."""
    return min(ratios_by_value, key=lambda x: abs(x - value))


def _largest(ratios: Mapping[str, float]) -> str:
    return max(ratios, key=lambda name: ratios[name])
