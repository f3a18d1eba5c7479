"""Paired changes of error statistics from base to candidate, with bounds: RMS, quantiles, fractions beyond a limit."""

from typing import NamedTuple

import numpy as np
from scipy import optimize, special, stats

from lvnav_trade.quantities.records import Bools, Floats

# Number of resamples for the bounds on the change of a quantile.
RESAMPLES = 2000
# Smallest number of runs on either side of a quantile for a bound.
FEWEST_BEYOND = 5
_CHUNK = 2**22


class Change(NamedTuple):
    """Change of a statistic of the error from base to candidate.

    base : Statistic of the base.
    candidate : Statistic of the candidate.
    change : candidate / base - 1 if relative, otherwise candidate - base.
    low : Lower one-sided bound on the change, at its own confidence; NaN if the runs give none.
    high : Upper one-sided bound, likewise.
    effective_runs : Unpaired runs per case that would give the same variance; infinite if the paired errors are equal.
    """

    base: float
    candidate: float
    change: float
    low: float
    high: float
    effective_runs: float


UNKNOWN_CHANGE = Change(*[float("nan")] * 6)
"""Change of a statistic without a run that is good in both cases."""


def rms_change(base: Floats, candidate: Floats, relative: bool, alpha_low: float, alpha_high: float) -> Change:
    """Return the change of the root mean square of paired errors.

    Parameters
    ----------
    base, candidate : (n,) array
        Errors, paired run by run.
    relative : bool
        Whether the change is relative to the base.
    alpha_low, alpha_high : float
        Error probabilities of the lower and upper bound.

    Returns
    -------
    Change
        The bounds are Student's, with the jackknife variance of ln(candidate / base), or of the difference unless
        `relative` (Efron and Stein 1981: the jackknife does not underestimate the variance on average).
    """
    first_rms = float(np.sqrt(np.mean(base**2)))
    second_rms = float(np.sqrt(np.mean(candidate**2)))
    jackknife = _jackknife_rms(base), _jackknife_rms(candidate)
    return _student_change((first_rms, second_rms), jackknife, relative, (alpha_low, alpha_high), fewest=2)


def _student_change(
    statistics: tuple[float, float],
    jackknife: tuple[Floats, Floats],
    relative: bool,
    alphas: tuple[float, float],
    fewest: int,
) -> Change:
    """Return the change of a statistic with Student's bounds from its jackknife values.

    Parameters
    ----------
    statistics : (float, float)
        Statistic of base and candidate.
    jackknife : (Floats, Floats)
        (n,) each. Statistic of base and candidate without one run, for each of the n runs.
    relative : bool
        Whether the change is relative to the base. The jackknife is then that of the logarithm.
    alphas : (float, float)
        Error probabilities of the lower and upper bound.
    fewest : int
        Smallest number of runs for bounds; with fewer runs the bounds are NaN.

    Returns
    -------
    Change
        Change with bounds and the effective number of runs.
    """
    n = len(jackknife[0])
    scale = np.log if relative else np.asarray
    with np.errstate(divide="ignore", invalid="ignore"):
        first = scale(jackknife[0])
        second = scale(jackknife[1])
        centre = float(scale(statistics[1]) - scale(statistics[0]))
        paired_variance = _jackknife_variance(second - first)
        unpaired_variance = _jackknife_variance(first) + _jackknife_variance(second)
    low = high = float("nan")
    if n >= fewest and np.isfinite(paired_variance):
        low_factor, high_factor = -special.stdtrit(n - 1, alphas)  # faster than stats.t.isf
        low = centre - float(low_factor) * np.sqrt(paired_variance)
        high = centre + float(high_factor) * np.sqrt(paired_variance)
    if relative:
        centre, low, high = (float(np.expm1(value)) for value in (centre, low, high))
    return Change(
        base=statistics[0],
        candidate=statistics[1],
        change=centre,
        low=float(low),
        high=float(high),
        effective_runs=_effective_runs(n, unpaired_variance, paired_variance),
    )


def _jackknife_rms(error: Floats) -> Floats:
    """Return the root mean square of all runs except one, for each run, (n,)."""
    square = error**2
    square_sum = np.maximum(square.sum() - square, 0.0)
    return np.asarray(np.sqrt(square_sum / max(1, len(error) - 1)))


def _jackknife_variance(values: Floats) -> float:
    """Return the jackknife variance (n - 1) / n sum (x_k - mean)^2 of a statistic, from values x_k without run k."""
    n = len(values)
    return float((n - 1) / n * np.sum((values - values.mean()) ** 2))


def _effective_runs(n: int, unpaired_variance: float, paired_variance: float) -> float:
    """Return the number of unpaired runs with the variance of n paired runs: n times the ratio of the variances.

    Parameters
    ----------
    n : int
        Number of pairs of runs.
    unpaired_variance, paired_variance : float
        Variance of the change for independent runs, and for paired runs.

    Returns
    -------
    float
        Infinite if the paired variance is zero to rounding; NaN if a variance is not finite.
    """
    if not np.isfinite(unpaired_variance + paired_variance):
        return float("nan")
    if not paired_variance > 1e-12 * unpaired_variance:  # rounding
        return float("inf")
    return float(n * unpaired_variance / paired_variance)


def quantile_change(
    base: Floats, candidate: Floats, probability: float, relative: bool, alpha_low: float, alpha_high: float
) -> Change:
    """Return the change of a quantile of |error|, by resampling pairs of runs (percentile bootstrap).

    Parameters
    ----------
    base, candidate : (n,) array
        Errors, paired run by run.
    probability : float
        Probability of the quantile, which is the smallest order statistic that at least this fraction of the runs does
        not exceed.
    relative : bool
        Whether the change is relative to the base.
    alpha_low, alpha_high : float
        Error probabilities of the lower and upper bound.

    Returns
    -------
    Change
        Bounds and effective runs are NaN if there are too few runs for the quantile.

    Notes
    -----
    The resamples are the same in every call, so that results are reproducible.
    """
    pair = np.abs(np.stack([base, candidate]))
    n = pair.shape[1]
    rank = max(1, int(np.ceil(probability * n - 1e-9))) - 1
    first, second = np.sort(pair, axis=1)[:, rank]
    change = Change(
        base=float(first),
        candidate=float(second),
        change=float(_difference(first, second, relative)),
        low=float("nan"),
        high=float("nan"),
        effective_runs=float("nan"),
    )
    if not has_enough_runs(n, probability):
        return change
    quantiles = _resample_quantiles(pair, rank)
    differences = _difference(quantiles[0], quantiles[1], relative)
    low, high = np.quantile(differences, [alpha_low, 1.0 - alpha_high])
    if relative and np.all(quantiles > 0.0):
        quantiles = np.log(quantiles)
    unpaired_variance = float(quantiles.var(axis=1).sum())
    paired_variance = float(np.var(quantiles[1] - quantiles[0]))
    effective_runs = _effective_runs(n, unpaired_variance, paired_variance)
    return change._replace(low=float(low), high=float(high), effective_runs=effective_runs)


def has_enough_runs(runs: int, probability: float) -> bool:
    """Return whether a number of runs gives a bound on a quantile without an assumed distribution.

    Parameters
    ----------
    runs : int
        Number of runs.
    probability : float
        Probability of the quantile.
    """
    return min(runs * probability, runs * (1.0 - probability)) >= FEWEST_BEYOND - 1e-9


def fitted_quantile_change(
    base: Floats, candidate: Floats, probability: float, relative: bool, alpha_low: float, alpha_high: float
) -> Change:
    """Return the change of a quantile of |error|, from a fitted distribution, if too few runs exceed the quantile.

    Parameters
    ----------
    base, candidate : (n,) array
        Errors, paired run by run.
    probability : float
        Probability of the quantile.
    relative : bool
        Whether the change is relative to the base.
    alpha_low, alpha_high : float
        Error probabilities of the lower and upper bound.

    Returns
    -------
    Change
        The bounds are Student's with the jackknife variance.

    Notes
    -----
    The square of an error is a weighted sum of squared Gaussians. It is approximated by g times a chi-square variable
    with h degrees of freedom, with the mean and variance of the sample (Satterthwaite 1946). This is exact for a
    Gaussian scalar and for a norm of equal components. For a norm of unequal components, a far quantile is up to 4 %
    low, in base and candidate alike.
    """
    squares = np.stack([base**2, candidate**2])
    mean = squares.mean(axis=1)
    variance = squares.var(axis=1, ddof=1)
    quantiles = _fitted_quantile(mean, variance, probability)
    with np.errstate(divide="ignore", invalid="ignore"):
        jackknife = _jackknife_quantile(base, probability), _jackknife_quantile(candidate, probability)
    statistics = float(quantiles[0]), float(quantiles[1])
    return _student_change(statistics, jackknife, relative, (alpha_low, alpha_high), fewest=3)


def _fitted_quantile(mean: Floats, variance: Floats, probability: float) -> Floats:
    """Return the quantile of an error whose square has a given mean and variance.

    Parameters
    ----------
    mean, variance : (...,) array
        Mean and variance of the squared error.
    probability : float
        Probability of the quantile.

    Returns
    -------
    (...,) array
        Quantile of the error, in its unit.

    Notes
    -----
    The square is g chi-square(h), with h = 2 mean^2 / variance and g = mean / h.
    """
    freedom = 2.0 * mean**2 / variance
    chi_square = 2.0 * special.gammaincinv(0.5 * freedom, probability)  # faster than stats.chi2.ppf
    return np.asarray(np.sqrt(mean / freedom * chi_square))


def _jackknife_quantile(error: Floats, probability: float) -> Floats:
    """Return the fitted quantile of all runs except one, for each run, (n,)."""
    n = len(error)
    square = error**2
    mean = (square.sum() - square) / (n - 1)
    fourth_power_sum = np.sum(square**2) - square**2
    variance = np.maximum(fourth_power_sum - (n - 1) * mean**2, 0.0) / (n - 2)
    return _fitted_quantile(mean, variance, probability)


def _difference(base: Floats, candidate: Floats, relative: bool) -> Floats:
    """Return candidate - base, or candidate / base - 1 if relative."""
    if not relative:
        return np.asarray(candidate - base)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(candidate / base - 1.0)


def _resample_quantiles(pair: Floats, rank: int) -> Floats:
    """Return the order statistic of every resample of the pairs (2, n), (2, RESAMPLES)."""
    n = pair.shape[1]
    generator = np.random.default_rng(n)
    quantiles = np.empty((2, RESAMPLES))
    step = max(1, _CHUNK // n)
    for start in range(0, RESAMPLES, step):
        stop = min(RESAMPLES, start + step)
        indices = generator.integers(0, n, (stop - start, n))
        for k in range(2):
            quantiles[k, start:stop] = np.partition(pair[k][indices], rank, axis=1)[:, rank]
    return quantiles


def exceedance_change(base: Bools, candidate: Bools, alpha_low: float, alpha_high: float) -> Change:
    """Return the change of the fraction of runs beyond a limit, with score bounds for paired fractions (Tango 1998).

    Parameters
    ----------
    base, candidate : (n,) array of bool
        Whether each run is beyond the limit, paired run by run.
    alpha_low, alpha_high : float
        Error probabilities of the lower and upper bound.

    Returns
    -------
    Change
        Fractions of base and candidate, and their difference with bounds.

    Notes
    -----
    As in McNemar's test, only runs beyond the limit in one case but not in the other give information.
    """
    n = len(base)
    candidate_only = int(np.sum(candidate & ~base))
    base_only = int(np.sum(base & ~candidate))
    first = float(np.mean(base))
    second = float(np.mean(candidate))
    unpaired_variance = first * (1.0 - first) + second * (1.0 - second)
    paired_variance = (candidate_only + base_only) / n - (second - first) ** 2
    effective_runs = float("nan")
    if unpaired_variance:
        effective_runs = _effective_runs(n, unpaired_variance, paired_variance)
    return Change(
        base=first,
        candidate=second,
        change=second - first,
        low=_score_limit(n, candidate_only, base_only, float(stats.norm.isf(alpha_low))),
        high=-_score_limit(n, base_only, candidate_only, float(stats.norm.isf(alpha_high))),
        effective_runs=effective_runs,
    )


def _score_limit(n: int, candidate_only: int, base_only: int, z: float) -> float:
    """Return the lower limit on the difference of paired fractions, at which the score statistic equals z.

    Parameters
    ----------
    n : int
        Number of pairs of runs.
    candidate_only, base_only : int
        Number of pairs beyond the limit in the candidate only, and in the base only.
    z : float
        Normal quantile of the confidence of the limit.

    Returns
    -------
    float
        Lower limit on the fraction of the candidate minus that of the base; -1 if the runs exclude no difference.
    """

    def excess(difference: float) -> float:
        # The nuisance parameter, the probability that a run is beyond the limit in the base only, is the root of
        # a x^2 + b x + c that maximises the likelihood.
        a = 2.0 * n
        b = (2.0 * n - candidate_only + base_only) * difference - candidate_only - base_only
        c = -base_only * difference * (1.0 - difference)
        discriminant = max(0.0, b * b - 4.0 * a * c)
        nuisance = (np.sqrt(discriminant) - b) / (2.0 * a)
        variance = n * (2.0 * nuisance + difference * (1.0 - difference))
        return float(candidate_only - base_only - n * difference - z * np.sqrt(max(variance, 0.0)))

    lowest = -1.0 + 1e-12
    highest = (candidate_only - base_only) / n - 1e-9  # below the estimate, where the statistic may be 0 / 0
    if highest <= lowest or excess(lowest) <= 0.0:
        return -1.0
    return float(optimize.brentq(excess, lowest, highest, xtol=1e-12))


def verdict(low: float, high: float, effect: float) -> str:
    """Return the verdict on a change with respect to the smallest change of interest.

    Parameters
    ----------
    low, high : float
        Bounds on the change.
    effect : float
        Smallest change of interest, in the same unit.

    Returns
    -------
    str
        "worse" if the change is shown to exceed `effect`, "not worse" if it is shown to be below `effect`, otherwise
        "undecided".
    """
    if low > effect:
        return "worse"
    return "not worse" if high < effect else "undecided"
