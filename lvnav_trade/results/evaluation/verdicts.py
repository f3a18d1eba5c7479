"""Values of expressions of metrics by formal sigma, true error and paired runs, with interval and verdict."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy import stats

from lvnav_trade.quantities import expression
from lvnav_trade.quantities.records import Floats
from lvnav_trade.results.evaluation.integrity import share
from lvnav_trade.results.metric import NUMBERS as NUMBERS
from lvnav_trade.results.metric import MetricValue

HOLDS, FAILS, UNDECIDED, NOT_SET_UP = "holds", "does not hold here", "undecided", "not set up"
_LEVEL = 0.95
_FEWEST = 8  # smallest number of runs for an interval
_FEWEST_LEVELS = 4  # smallest number of pooled cases for an interval


class ExpressionValue(NamedTuple):
    """Value of an expression; NaN where it is not known."""

    formal: float  # by formal sigmas
    true: float  # by true errors of linear covariance
    monte_carlo: float  # by the runs
    low: float  # lower limit of the two-sided 95 % interval of the value by the runs
    high: float  # upper limit of this interval
    runs: int  # number of runs that did not fail
    remarks: tuple[str, ...]


def value_of(text: str, terms: Mapping[str, MetricValue]) -> ExpressionValue:
    """Evaluate an expression of metrics.

    Parameters
    ----------
    text : str
        Expression, such as ``100 * (1 - a / b)``.
    terms : mapping of str to MetricValue
        Values by name. The runs of all terms are paired by their numbers.

    Returns
    -------
    ExpressionValue
        Value by three methods, and the interval of the value by the runs.

    Notes
    -----
    The interval is Student's, with the jackknife variance over the runs. For an expression without sums it is that of
    the logarithm; for the fraction of runs with a property it is exact binomial. Runs that failed in any term are
    excluded. The interval is widened to that over the pooled cases if this is larger.
    """
    remarks = [term.remark for term in terms.values() if term.remark]
    formal, true, drawn = (
        float(expression.evaluate(text, {name: getattr(term, column) for name, term in terms.items()}))
        for column in NUMBERS
    )
    least = min(len(term.runs) for term in terms.values())
    each = np.stack([term.runs[:least] for term in terms.values()])
    sound = np.all(np.isfinite(each), axis=0)
    low = high = np.nan
    n = int(sound.sum())
    if n >= _FEWEST:
        if n < least:
            remarks.append(f"{least - n} of {least} runs failed and are left out")
        means, without = each[:, sound].mean(axis=1), _without(each[:, sound])
        of_terms = list(zip(terms, means, without, terms.values(), strict=True))
        drawn, others = (
            expression.evaluate(text, {name: _root(pair[k], term) for name, *pair, term in of_terms}) for k in (0, 1)
        )
        low, high = _interval(float(drawn), np.asarray(others), expression.is_product(text))
        low, high = _with_levels(text, terms, float(drawn), (low, high))
        only = next(iter(terms.values()))
        if only.is_share and len(terms) == 1 and text.strip() in terms:
            exact = set(np.unique(only.runs)) <= {0.0, 1.0}
            low, high = share(int(only.runs.sum()), n)[1:] if exact else np.clip((low, high), 0.0, 1.0).tolist()
    return ExpressionValue(formal, true, float(drawn), low, high, n, tuple(dict.fromkeys(remarks)))


def _with_levels(
    text: str, terms: Mapping[str, MetricValue], centre: float, by_runs: tuple[float, float]
) -> tuple[float, float]:
    """Return the interval by the runs, extended to the interval over the pooled cases if this reaches further."""
    counts = {len(term.levels) for term in terms.values() if len(term.levels)}
    if len(counts) != 1 or (n := counts.pop()) < _FEWEST_LEVELS:
        return by_runs
    others = {
        name: _root(_without(term.levels[None])[0] if len(term.levels) else np.full(n, term.runs.mean()), term)
        for name, term in terms.items()
    }
    by_levels = _interval(centre, np.asarray(expression.evaluate(text, others)), expression.is_product(text))
    return float(np.fmin(by_runs[0], by_levels[0])), float(np.fmax(by_runs[1], by_levels[1]))


def _without(each: Floats) -> Floats:
    """Return the jackknife means (n_term, n_run): for each run the mean of all other runs."""
    return np.asarray((each.sum(axis=1, keepdims=True) - each) / (each.shape[1] - 1))


def _root(value: Any, term: MetricValue) -> Any:
    return np.sqrt(np.maximum(value, 0.0)) if term.is_root else value


def _interval(centre: float, without: Floats, is_product: bool) -> tuple[float, float]:
    """Return the 95 % interval of a value from its jackknife values (n,), each without one run."""
    if not (np.isfinite(centre) and np.all(np.isfinite(without))):
        return np.nan, np.nan
    by_logarithm = is_product and centre > 0.0 and bool(np.all(without > 0.0))
    middle, others = (np.log(centre), np.log(without)) if by_logarithm else (centre, without)
    n = len(others)
    sigma = np.sqrt((n - 1) / n * np.sum((others - others.mean()) ** 2))  # jackknife standard error
    half = float(stats.t.isf(0.5 * (1.0 - _LEVEL), n - 1)) * sigma
    ends = middle - half, middle + half
    low, high = (float(np.exp(end)) if by_logarithm else float(end) for end in ends)
    return low, high


def verdict(value: ExpressionValue, low: float, high: float, tested_by: Sequence[str]) -> str:
    """Return the verdict whether a value lies between two bounds.

    Parameters
    ----------
    value : ExpressionValue
        The value.
    low, high : float
        Bounds; NaN for none.
    tested_by : sequence of str
        Numbers to test, of `NUMBERS`; numbers that are not known are skipped. The number by the runs is tested with its
        interval.

    Returns
    -------
    str
        The worst of `HOLDS`, `UNDECIDED` and `FAILS` over the numbers; `NOT_SET_UP` if none is known.
    """
    words = []
    for name in tested_by:
        number = getattr(value, name)
        ends = (value.low, value.high) if name == "monte_carlo" and value.low == value.low else (number, number)
        if number != number:
            continue
        inside = not (ends[0] < low or ends[1] > high)
        outside = ends[1] < low or ends[0] > high
        words.append(HOLDS if inside else FAILS if outside else UNDECIDED)
    return next((word for word in (FAILS, UNDECIDED, HOLDS) if word in words), NOT_SET_UP)
