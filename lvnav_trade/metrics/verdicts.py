"""The value of an expression of metrics by formal sigma, true error and paired runs, its interval, and its verdict."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy import stats

from lvnav_trade import expression
from lvnav_trade.metrics.integrity import share
from lvnav_trade.metrics.metric import NUMBERS as NUMBERS
from lvnav_trade.metrics.metric import MetricValue
from lvnav_trade.records import Floats

HOLDS, FAILS, UNDECIDED, NOT_SET_UP = "holds", "does not hold here", "undecided", "not set up"
_LEVEL = 0.95
_FEWEST = 8  # runs that give an interval
_FEWEST_LEVELS = 4  # cases taken together that do


class Value(NamedTuple):
    """The value of an expression three times, and the two-sided 95 % interval of that by the runs; NaN if unknown."""

    formal: float
    true: float
    monte_carlo: float
    low: float
    high: float
    runs: int
    remarks: tuple[str, ...]


def value_of(text: str, terms: Mapping[str, MetricValue]) -> Value:
    """Return the value of an expression of terms.

    The interval is Student's with the jackknife's variance over the runs, which belong together run by run; of the
    logarithm where the expression has no sums; the exact one of a share of the runs. Runs that failed in any of the
    terms are left out.
    """
    remarks = [one.remark for one in terms.values() if one.remark]
    formal, true, drawn = (
        float(expression.evaluate(text, {name: getattr(one, column) for name, one in terms.items()}))
        for column in NUMBERS
    )
    least = min(len(one.runs) for one in terms.values())
    each = np.stack([one.runs[:least] for one in terms.values()])
    sound = np.all(np.isfinite(each), axis=0)
    low = high = np.nan
    n = int(sound.sum())
    if n >= _FEWEST:
        if n < least:
            remarks.append(f"{least - n} of {least} runs failed and are left out")
        means, without = each[:, sound].mean(axis=1), _without(each[:, sound])
        of_terms = list(zip(terms, means, without, terms.values(), strict=True))
        drawn, others = (
            expression.evaluate(text, {name: _root(pair[k], one) for name, *pair, one in of_terms}) for k in (0, 1)
        )
        low, high = _interval(float(drawn), np.asarray(others), expression.is_product(text))
        low, high = _with_levels(text, terms, float(drawn), (low, high))
        only = next(iter(terms.values()))
        if only.is_share and len(terms) == 1 and text.strip() in terms:
            exact = set(np.unique(only.runs)) <= {0.0, 1.0}
            low, high = share(int(only.runs.sum()), n)[1:] if exact else np.clip((low, high), 0.0, 1.0).tolist()
    return Value(formal, true, float(drawn), low, high, n, tuple(dict.fromkeys(remarks)))


def _with_levels(
    text: str, terms: Mapping[str, MetricValue], centre: float, by_runs: tuple[float, float]
) -> tuple[float, float]:
    """Return the interval by the runs, or that by the cases that are taken together where it reaches further."""
    counts = {len(one.levels) for one in terms.values() if len(one.levels)}
    if len(counts) != 1 or (n := counts.pop()) < _FEWEST_LEVELS:
        return by_runs
    others = {
        name: _root(_without(one.levels[None])[0] if len(one.levels) else np.full(n, one.runs.mean()), one)
        for name, one in terms.items()
    }
    by_levels = _interval(centre, np.asarray(expression.evaluate(text, others)), expression.is_product(text))
    return float(np.fmin(by_runs[0], by_levels[0])), float(np.fmax(by_runs[1], by_levels[1]))


def _without(each: Floats) -> Floats:
    """Return the mean of all runs but one, for each run: (n_term, n_run)."""
    return np.asarray((each.sum(axis=1, keepdims=True) - each) / (each.shape[1] - 1))


def _root(value: Any, one: MetricValue) -> Any:
    return np.sqrt(np.maximum(value, 0.0)) if one.is_root else value


def _interval(centre: float, without: Floats, is_product: bool) -> tuple[float, float]:
    if not (np.isfinite(centre) and np.all(np.isfinite(without))):
        return np.nan, np.nan
    by_logarithm = is_product and centre > 0.0 and bool(np.all(without > 0.0))
    middle, others = (np.log(centre), np.log(without)) if by_logarithm else (centre, without)
    n = len(others)
    sigma = np.sqrt((n - 1) / n * np.sum((others - others.mean()) ** 2))
    half = float(stats.t.isf(0.5 * (1.0 - _LEVEL), n - 1)) * sigma
    ends = middle - half, middle + half
    low, high = (float(np.exp(end)) if by_logarithm else float(end) for end in ends)
    return low, high


def verdict(found: Value, low: float, high: float, tested_by: Sequence[str]) -> str:
    """Return whether every number that is there lies between the bounds (NaN: none), the runs' with its interval."""
    words = []
    for name in tested_by:
        number = getattr(found, name)
        ends = (found.low, found.high) if name == "monte_carlo" and found.low == found.low else (number, number)
        if number != number:
            continue
        inside = not (ends[0] < low or ends[1] > high)
        outside = ends[1] < low or ends[0] > high
        words.append(HOLDS if inside else FAILS if outside else UNDECIDED)
    return next((word for word in (FAILS, UNDECIDED, HOLDS) if word in words), NOT_SET_UP)
