"""Two cases on the same draws: how much the second differs, how sure that is, and what the pairing is worth."""

from typing import NamedTuple

import numpy as np
from scipy import optimize, stats

from lvnav_trade.quantities.records import Bools, Floats

# Resamples of the runs behind the bounds of a quantile's change.
RESAMPLES = 2000
# A quantile needs so many runs on either side of it, or else no bound is given.
FEWEST_BEYOND = 5
_CHUNK = 2**22


class Change(NamedTuple):
    """What the candidate does to a statistic of the error.

    base, candidate: the statistic of each; change: candidate / base - 1, or candidate - base; low, high: one-sided
    bounds on the change, each at its own level, NaN where the runs do not give one; effective_runs: unpaired runs per
    case that would tell the change as well, infinite where the draws cancel altogether.
    """

    base: float
    candidate: float
    change: float
    low: float
    high: float
    effective_runs: float


def rms_change(base: Floats, candidate: Floats, relative: bool, alpha_low: float, alpha_high: float) -> Change:
    """Return the change of the root mean square of errors (n,) that belong together run by run.

    The bounds are Student's, with the jackknife's variance of ln(candidate / base), or of the difference where not
    `relative` (Efron and Stein 1981: the jackknife's variance is not too small on average).
    """
    n, scale = len(base), np.log if relative else np.asarray
    sizes = np.sqrt(np.mean(base**2)), np.sqrt(np.mean(candidate**2))
    with np.errstate(divide="ignore", invalid="ignore"):
        first, second = (scale(_rms_without(part)) for part in (base, candidate))
        centre = float(scale(sizes[1]) - scale(sizes[0]))
        paired, apart = _jackknife(second - first), _jackknife(first) + _jackknife(second)
    low = high = float("nan")
    if n >= 2 and np.isfinite(paired):
        low = centre - float(stats.t.isf(alpha_low, n - 1)) * np.sqrt(paired)
        high = centre + float(stats.t.isf(alpha_high, n - 1)) * np.sqrt(paired)
    if relative:
        centre, low, high = (float(np.expm1(value)) for value in (centre, low, high))
    return Change(float(sizes[0]), float(sizes[1]), centre, float(low), float(high), _worth(n, apart, paired))


def _rms_without(error: Floats) -> Floats:
    """Return the root mean square of all runs but one, for each run."""
    square = error**2
    return np.asarray(np.sqrt(np.maximum(square.sum() - square, 0.0) / max(1, len(error) - 1)))


def _jackknife(without: Floats) -> float:
    """Return the variance of a statistic from its values with each run left out."""
    n = len(without)
    return float((n - 1) / n * np.sum((without - without.mean()) ** 2))


def _worth(n: int, apart: float, paired: float) -> float:
    """Return the number of unpaired runs whose variance would be that of n paired ones."""
    if not np.isfinite(apart + paired):
        return float("nan")
    return float(n * apart / paired) if paired > 1e-12 * apart else float("inf")


def quantile_change(
    base: Floats, candidate: Floats, probability: float, relative: bool, alpha_low: float, alpha_high: float
) -> Change:
    """Return the change of a quantile of |error|, by resampling whole pairs (percentile bounds).

    The quantile is the order statistic that at least the fraction `probability` of runs stays at or below. The
    resamples are always the same ones: an answer does not change from one look to the next.
    """
    pair = np.abs(np.stack([base, candidate]))
    n = pair.shape[1]
    rank = max(1, int(np.ceil(probability * n - 1e-9))) - 1
    at = np.sort(pair, axis=1)[:, rank]
    head = (float(at[0]), float(at[1]), float(_difference(at[0], at[1], relative)))
    if not supports(n, probability):
        return Change(*head, float("nan"), float("nan"), float("nan"))
    drawn = _resampled(pair, rank)
    low, high = np.quantile(_difference(drawn[0], drawn[1], relative), [alpha_low, 1.0 - alpha_high])
    measured = np.log(drawn) if relative and np.all(drawn > 0.0) else drawn
    apart, paired = float(measured.var(axis=1).sum()), float(np.var(measured[1] - measured[0]))
    return Change(*head, float(low), float(high), _worth(n, apart, paired))


def supports(runs: int, probability: float) -> bool:
    """Return whether so many runs give a bound on a quantile without an assumed distribution."""
    return min(runs * probability, runs * (1.0 - probability)) >= FEWEST_BEYOND - 1e-9


def fitted_quantile_change(
    base: Floats, candidate: Floats, probability: float, relative: bool, alpha_low: float, alpha_high: float
) -> Change:
    """Return the change of a quantile of |error| (n,) that too few runs lie beyond, from a fitted distribution.

    The square of an error is a weighted sum of squared Gaussians. It is approximated by g times a chi-square of h
    degrees of freedom with the sample's mean and variance (Satterthwaite 1946), which is exact for a Gaussian scalar
    and for a norm of equal components. Of a norm of unequal ones a far quantile is up to 4 % low, in base and candidate
    alike. The bounds are Student's, with the jackknife's variance as of `rms_change`.
    """
    n, scale = len(base), np.log if relative else np.asarray
    squares = np.stack([base**2, candidate**2])
    sizes = _fitted_quantile(squares.mean(axis=1), squares.var(axis=1, ddof=1), probability)
    with np.errstate(divide="ignore", invalid="ignore"):
        first, second = (scale(_fitted_without(part, probability)) for part in (base, candidate))
        centre = float(scale(sizes[1]) - scale(sizes[0]))
        together, apart = _jackknife(second - first), _jackknife(first) + _jackknife(second)
    low = high = float("nan")
    if n >= 3 and np.isfinite(together):
        low = centre - float(stats.t.isf(alpha_low, n - 1)) * np.sqrt(together)
        high = centre + float(stats.t.isf(alpha_high, n - 1)) * np.sqrt(together)
    if relative:
        centre, low, high = (float(np.expm1(value)) for value in (centre, low, high))
    return Change(float(sizes[0]), float(sizes[1]), centre, float(low), float(high), _worth(n, apart, together))


def _fitted_quantile(mean: Floats, variance: Floats, probability: float) -> Floats:
    """Return the quantile of an error whose square has this mean and variance: g chi-square of h, see above."""
    freedom = 2.0 * mean**2 / variance
    return np.asarray(np.sqrt(mean / freedom * stats.chi2.ppf(probability, freedom)))


def _fitted_without(error: Floats, probability: float) -> Floats:
    """Return the fitted quantile of all runs but one, for each run."""
    square, n = error**2, len(error)
    mean = (square.sum() - square) / (n - 1)
    squares = np.sum(square**2) - square**2
    return _fitted_quantile(mean, np.maximum(squares - (n - 1) * mean**2, 0.0) / (n - 2), probability)


def _difference(base: Floats, candidate: Floats, relative: bool) -> Floats:
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(candidate / base - 1.0 if relative else candidate - base)


def _resampled(pair: Floats, rank: int) -> Floats:
    """Return the order statistic of every resample of the pairs (2, n): (2, RESAMPLES)."""
    n = pair.shape[1]
    generator = np.random.default_rng(n)
    found = np.empty((2, RESAMPLES))
    step = max(1, _CHUNK // n)
    for start in range(0, RESAMPLES, step):
        stop = min(RESAMPLES, start + step)
        chosen = generator.integers(0, n, (stop - start, n))
        for k in range(2):
            found[k, start:stop] = np.partition(pair[k][chosen], rank, axis=1)[:, rank]
    return found


def beyond_change(base: Bools, candidate: Bools, alpha_low: float, alpha_high: float) -> Change:
    """Return the change of the fraction of runs beyond a limit, with score bounds for paired fractions (Tango 1998).

    Only runs beyond it in one case and not in the other tell anything, as in McNemar's test.
    """
    n = len(base)
    more, less = int(np.sum(candidate & ~base)), int(np.sum(base & ~candidate))
    first, second = float(np.mean(base)), float(np.mean(candidate))
    low = _score_limit(n, more, less, float(stats.norm.isf(alpha_low)))
    high = -_score_limit(n, less, more, float(stats.norm.isf(alpha_high)))
    apart = first * (1.0 - first) + second * (1.0 - second)
    paired = (more + less) / n - (second - first) ** 2
    return Change(first, second, second - first, low, high, _worth(n, apart, paired) if apart else float("nan"))


def _score_limit(n: int, more: int, less: int, z: float) -> float:
    """Return the lower limit on the difference of paired fractions at which the score statistic is z."""

    def missing(difference: float) -> float:
        a = 2.0 * n
        b = (2.0 * n - more + less) * difference - more - less
        c = -less * difference * (1.0 - difference)
        nuisance = (np.sqrt(max(0.0, b * b - 4.0 * a * c)) - b) / (2.0 * a)
        variance = n * (2.0 * nuisance + difference * (1.0 - difference))
        return float(more - less - n * difference - z * np.sqrt(max(variance, 0.0)))

    lowest, below = -1.0 + 1e-12, (more - less) / n - 1e-9  # at the estimate itself the statistic may be 0 / 0
    if below <= lowest or missing(lowest) <= 0.0:
        return -1.0
    return float(optimize.brentq(missing, lowest, below, xtol=1e-12))


def verdict(low: float, high: float, effect: float) -> str:
    """Return "worse" where the change is shown to be above the smallest effect of interest, "not worse" where below."""
    return "worse" if low > effect else "not worse" if high < effect else "undecided"
