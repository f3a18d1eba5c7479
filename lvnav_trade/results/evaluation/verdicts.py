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
    """Value of an expression; NaN if not known."""

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
    formal, true, monte_carlo = (_column_value(text, terms, column) for column in NUMBERS)
    remarks = [term.remark for term in terms.values() if term.remark]
    n_run = min(len(term.runs) for term in terms.values())
    runs = np.stack([term.runs[:n_run] for term in terms.values()])
    is_finite = np.all(np.isfinite(runs), axis=0)
    n = int(is_finite.sum())
    low = high = np.nan
    if n >= _FEWEST:
        if n < n_run:
            remarks.append(f"{n_run - n} of {n_run} runs failed and are left out")
        monte_carlo, low, high = _monte_carlo_value(text, terms, runs[:, is_finite])
        term = next(iter(terms.values()))
        if term.is_share and len(terms) == 1 and text.strip() in terms:
            if set(np.unique(term.runs)) <= {0.0, 1.0}:
                _, low, high = share(int(term.runs.sum()), n)
            else:
                low, high = np.clip((low, high), 0.0, 1.0).tolist()
    return ExpressionValue(
        formal=formal,
        true=true,
        monte_carlo=monte_carlo,
        low=low,
        high=high,
        runs=n,
        remarks=tuple(dict.fromkeys(remarks)),
    )


def _column_value(text: str, terms: Mapping[str, MetricValue], column: str) -> float:
    """Return the value of an expression of one number per term.

    Parameters
    ----------
    text : str
        Expression in the names of the terms.
    terms : mapping of str to MetricValue
        Values of the terms.
    column : str
        Number of each term, from `NUMBERS`.
    """
    values = {name: getattr(term, column) for name, term in terms.items()}
    return float(expression.evaluate(text, values))


def _monte_carlo_value(text: str, terms: Mapping[str, MetricValue], runs: Floats) -> tuple[float, float, float]:
    """Return the value of an expression by the runs, and the ends of its interval.

    Parameters
    ----------
    text : str
        Expression in the names of the terms.
    terms : mapping of str to MetricValue
        Values of the terms.
    runs : (n_term, n_run) array
        Contributions of the runs that did not fail.

    Returns
    -------
    float, float, float
        Value, lower and upper end of the 95 % interval.
    """
    sample_values = {}
    jackknife_values = {}
    means = runs.mean(axis=1)
    jackknife_means = _jackknife_means(runs)
    for (name, term), mean, means_without in zip(terms.items(), means, jackknife_means, strict=True):
        sample_values[name] = _root(mean, term)
        jackknife_values[name] = _root(means_without, term)
    value = float(expression.evaluate(text, sample_values))
    jackknife = np.asarray(expression.evaluate(text, jackknife_values))
    interval = _interval(value, jackknife, expression.is_product(text))
    low, high = _extend_interval(text, terms, value, interval)
    return value, low, high


def _extend_interval(
    text: str, terms: Mapping[str, MetricValue], centre: float, run_interval: tuple[float, float]
) -> tuple[float, float]:
    """Return the interval by the runs, extended to the interval over the pooled cases if this reaches further.

    Parameters
    ----------
    text : str
        Expression in the names of the terms.
    terms : mapping of str to MetricValue
        Values of the terms.
    centre : float
        Value of the expression.
    run_interval : (float, float)
        Interval by the runs.
    """
    counts = {len(term.levels) for term in terms.values() if len(term.levels)}
    if len(counts) != 1:
        return run_interval
    n = counts.pop()
    if n < _FEWEST_LEVELS:
        return run_interval
    jackknife_values = {}
    for name, term in terms.items():
        if len(term.levels):
            means = _jackknife_means(term.levels[None])[0]
        else:
            means = np.full(n, term.runs.mean())
        jackknife_values[name] = _root(means, term)
    jackknife = np.asarray(expression.evaluate(text, jackknife_values))
    level_interval = _interval(centre, jackknife, expression.is_product(text))
    low = float(np.fmin(run_interval[0], level_interval[0]))
    high = float(np.fmax(run_interval[1], level_interval[1]))
    return low, high


def _jackknife_means(runs: Floats) -> Floats:
    """Return the jackknife means (n_term, n_run): for each run the mean of all other runs."""
    sum_of_others = runs.sum(axis=1, keepdims=True) - runs
    return np.asarray(sum_of_others / (runs.shape[1] - 1))


def _root(value: Any, term: MetricValue) -> Any:
    """Return the square root of the mean of a term that is stored as a mean square; others unchanged.

    Parameters
    ----------
    value : (...,) array or float
        Mean of the contributions of the runs.
    term : MetricValue
        The term.
    """
    if term.is_root:
        return np.sqrt(np.maximum(value, 0.0))
    return value


def _interval(centre: float, jackknife: Floats, is_product: bool) -> tuple[float, float]:
    """Return the 95 % interval of a value from its jackknife values.

    Parameters
    ----------
    centre : float
        Value.
    jackknife : (n,) array
        Value without one run, for each run.
    is_product : bool
        Whether the interval is computed for the logarithm, if all values are positive.

    Returns
    -------
    float, float
        Lower and upper end; NaN if a value is not finite.
    """
    if not (np.isfinite(centre) and np.all(np.isfinite(jackknife))):
        return np.nan, np.nan
    # A product is closer to log-normal than to normal.
    is_logarithmic = is_product and centre > 0.0 and bool(np.all(jackknife > 0.0))
    if is_logarithmic:
        centre = np.log(centre)
        jackknife = np.log(jackknife)
    n = len(jackknife)
    deviation = jackknife - jackknife.mean()
    standard_error = np.sqrt((n - 1) / n * np.sum(deviation**2))
    half = float(stats.t.isf(0.5 * (1.0 - _LEVEL), n - 1)) * standard_error
    low = centre - half
    high = centre + half
    if is_logarithmic:
        low = np.exp(low)
        high = np.exp(high)
    return float(low), float(high)


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
    verdicts = set()
    for name in tested_by:
        number = getattr(value, name)
        if np.isnan(number):
            continue
        lowest_number = highest_number = number
        if name == "monte_carlo" and not np.isnan(value.low):
            lowest_number = value.low
            highest_number = value.high
        if not (lowest_number < low or highest_number > high):
            verdicts.add(HOLDS)
        elif highest_number < low or lowest_number > high:
            verdicts.add(FAILS)
        else:
            verdicts.add(UNDECIDED)
    for word in (FAILS, UNDECIDED, HOLDS):
        if word in verdicts:
            return word
    return NOT_SET_UP
