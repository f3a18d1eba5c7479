"""Matching of the cases of a candidate with those of a base, and paired statistics of their runs."""

import difflib
from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd
from scipy import optimize, stats

from lvnav_trade.quantities.errors import InputError, Mistake, refuse_all
from lvnav_trade.quantities.records import Bools, Floats
from lvnav_trade.results.statistics.select import SAME_TIME, flight_events, pick
from lvnav_trade.results.tables.read import Tables

# Largest distance (m) between equal trajectories: rounding of different compilers
_SAME_PLACE = 1.0
_EARTH = 6378137.0


class Pair(NamedTuple):
    """A pair of cases to compare."""

    base: str  # digest in the base
    candidate: str  # digest in the candidate
    label: str


def match(base: Tables, candidate: Tables, mapping: Mapping[str, str] | None = None) -> list[Pair]:
    """Return the pairs of cases to compare, in the order of the base.

    Cases with equal labels form a pair. A single case on each side forms a pair with any labels.

    Parameters
    ----------
    base, candidate : Tables
        The two result sets.
    mapping : mapping of str to str, optional
        Name in the candidate by name in the base, of a case (label or digest) or of a level of an axis
        (``{"tactical_fog": "tactical_fog_worse"}``).

    Returns
    -------
    list of Pair
        Pairs of cases.

    Raises
    ------
    InputError
        One line per reason: another seed, no common case, an unknown name in `mapping`, another trajectory or other
        events.
    """
    seeds = base.campaign.get("seed"), candidate.campaign.get("seed")
    if seeds[0] != seeds[1]:
        raise InputError(
            f"does not compare: other seed ({base.folder} drew with {seeds[0]}, {candidate.folder} with {seeds[1]}); "
            "runs belong together only on the same draws"
        )
    pairs = _pairs(base, candidate, dict(mapping or {}))
    reasons = (_another_flight(base, candidate, pair) for pair in pairs)
    refuse_all([Mistake(f"does not compare: {why}") for why in reasons if why])
    return pairs


def left_out(base: Tables, candidate: Tables, pairs: Sequence[Pair]) -> list[str]:
    """Return a note on the cases that have no partner."""
    sides = ((base, {pair.base for pair in pairs}, candidate), (candidate, {pair.candidate for pair in pairs}, base))
    return [
        f"Not compared, because {opposite.folder} has no such case: {'; '.join(alone)}."
        for tables, compared, opposite in sides
        if (alone := [label for case, label in tables.labels.items() if case not in compared])
    ]


def _pairs(base: Tables, candidate: Tables, mapping: dict[str, str]) -> list[Pair]:
    digests = {label: case for case, label in candidate.labels.items()}
    _check(base, mapping)
    _check(candidate, mapping.values())
    pairs = []
    for case, levels in base.levels.items():
        label = base.labels[case]
        mapped = mapping.get(label) or mapping.get(case)
        renamed = {axis: mapping.get(level, level) for axis, level in levels.items()}
        if mapped or renamed == levels:
            mapped_label = mapped or label
            partner = digests.get(mapped_label) or (mapped_label if mapped_label in candidate.labels else None)
        else:
            partner = next((digest for digest, of_other in candidate.levels.items() if of_other == renamed), None)
        if partner is not None:
            pairs.append((case, partner))
    if not pairs and len(base.labels) == len(candidate.labels) == 1:
        pairs = list(zip(base.labels, candidate.labels, strict=True))
    if not pairs:
        raise InputError(
            f"does not compare: no common case; {base.folder} has {_named(base)}, {candidate.folder} has "
            f"{_named(candidate)}; --map BASE:CANDIDATE says which belong together"
        )
    labels = [(base.labels[case], candidate.labels[partner]) for case, partner in pairs]
    names = [label if candidate_label == label else f"{label} → {candidate_label}" for label, candidate_label in labels]
    return [Pair(*pair, label) for pair, label in zip(pairs, names, strict=True)]


def _check(tables: Tables, names: Iterable[str]) -> None:
    levels = [level for of_case in tables.levels.values() for _, level in sorted(of_case.items())]
    words = list(dict.fromkeys([*tables.labels, *tables.labels.values(), *levels]))
    for name in names:
        if name not in words:
            near = difflib.get_close_matches(name, words, 1)
            hint = f" (did you mean {near[0]!r}?)" if near else f"; it has {_named(tables)}"
            raise InputError(f"--map: {tables.folder} has no case or level {name!r}{hint}")


def _named(tables: Tables) -> str:
    return "; ".join(tables.labels.values()) or "no case"


def _another_flight(base: Tables, candidate: Tables, pair: Pair) -> str:
    """Return the difference between the trajectories of a pair, in words; empty if they are equal."""
    sides = ((base, pair.base), (candidate, pair.candidate))
    first, second = (tables.cases.set_index("case").epoch[case] for tables, case in sides)
    if first != second:
        return f"{pair.label}: other trajectory (lift-off at {first} and at {second})"
    times, other_times = (flight_events(tables, case).set_index("event").t_s.to_dict() for tables, case in sides)
    if set(times) != set(other_times):
        return (
            f"{pair.label}: other events (only one of the two has {', '.join(sorted(set(times) ^ set(other_times)))})"
        )
    for name, t in times.items():
        if abs(t - other_times[name]) > SAME_TIME:
            return f"{pair.label}: other events ({name} at {t:g} s and at {other_times[name]:g} s)"
    if not all((tables.folder / "reference.parquet").exists() for tables, _ in sides):
        return ""
    apart = _distance(*(pick(tables.reference, case=case) for tables, case in sides))
    return f"{pair.label}: other trajectory ({apart:.3g} m apart)" if apart > _SAME_PLACE else ""


def _distance(first: pd.DataFrame, second: pd.DataFrame) -> float:
    """Return the largest distance (m) between two trajectories at their common times."""
    common = first.merge(second, on="t_s", suffixes=("", "_other"))
    if common.empty:
        return 0.0
    north = (common.latitude_rad - common.latitude_rad_other) * _EARTH
    east = (
        np.angle(np.exp(1j * (common.longitude_rad - common.longitude_rad_other)))
        * _EARTH
        * np.cos(common.latitude_rad)
    )
    return float(np.sqrt(north**2 + east**2 + (common.altitude_m - common.altitude_m_other) ** 2).max())


# Number of resamples for the bounds on the change of a quantile.
RESAMPLES = 2000
# Smallest number of runs on either side of a quantile for a bound.
FEWEST_BEYOND = 5
_CHUNK = 2**22


class Change(NamedTuple):
    """Change of a statistic of the error from base to candidate.

    base, candidate : Statistic of each.
    change : candidate / base - 1 if relative, otherwise candidate - base.
    low, high : One-sided bounds on the change, each at its own confidence; NaN if the runs give none.
    effective_runs : Unpaired runs per case that would give the same variance; infinite if the paired errors are equal.
    """

    base: float
    candidate: float
    change: float
    low: float
    high: float
    effective_runs: float


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
    n, scale = len(base), np.log if relative else np.asarray
    sizes = np.sqrt(np.mean(base**2)), np.sqrt(np.mean(candidate**2))
    with np.errstate(divide="ignore", invalid="ignore"):
        first, second = (scale(_rms_without(error)) for error in (base, candidate))
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
    """Return the root mean square of all runs except one, for each run, (n,)."""
    square = error**2
    return np.asarray(np.sqrt(np.maximum(square.sum() - square, 0.0) / max(1, len(error) - 1)))


def _jackknife(without: Floats) -> float:
    """Return the jackknife variance (n - 1) / n sum (x_k - mean)^2 of a statistic, from values x_k without run k."""
    n = len(without)
    return float((n - 1) / n * np.sum((without - without.mean()) ** 2))


def _worth(n: int, apart: float, paired: float) -> float:
    """Return the number of unpaired runs with the variance of n paired runs: n times the ratio of the variances."""
    if not np.isfinite(apart + paired):
        return float("nan")
    return float(n * apart / paired) if paired > 1e-12 * apart else float("inf")


def quantile_change(
    base: Floats, candidate: Floats, probability: float, relative: bool, alpha_low: float, alpha_high: float
) -> Change:
    """Return the change of a quantile of |error|, by resampling pairs of runs (percentile bootstrap).

    The quantile is the smallest order statistic that at least the fraction `probability` of runs does not exceed. The
    resamples are the same in every call, so that results are reproducible. The other arguments are those of
    `rms_change`.
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
    """Return whether a number of runs gives a bound on a quantile without an assumed distribution."""
    return min(runs * probability, runs * (1.0 - probability)) >= FEWEST_BEYOND - 1e-9


def fitted_quantile_change(
    base: Floats, candidate: Floats, probability: float, relative: bool, alpha_low: float, alpha_high: float
) -> Change:
    """Return the change of a quantile of |error|, from a fitted distribution, if too few runs exceed the quantile.

    The square of an error is a weighted sum of squared Gaussians. It is approximated by g times a chi-square variable
    with h degrees of freedom, with the mean and variance of the sample (Satterthwaite 1946). This is exact for a
    Gaussian scalar and for a norm of equal components. For a norm of unequal components, a far quantile is up to 4 %
    low, in base and candidate alike. The bounds are Student's with the jackknife variance. The arguments are those of
    `rms_change`.
    """
    n, scale = len(base), np.log if relative else np.asarray
    squares = np.stack([base**2, candidate**2])
    sizes = _fitted_quantile(squares.mean(axis=1), squares.var(axis=1, ddof=1), probability)
    with np.errstate(divide="ignore", invalid="ignore"):
        first, second = (scale(_fitted_without(error, probability)) for error in (base, candidate))
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
    """Return the quantile of an error whose square has a given mean and variance.

    The square is g chi-square(h), with h = 2 mean^2 / variance and g = mean / h.
    """
    freedom = 2.0 * mean**2 / variance
    return np.asarray(np.sqrt(mean / freedom * stats.chi2.ppf(probability, freedom)))


def _fitted_without(error: Floats, probability: float) -> Floats:
    """Return the fitted quantile of all runs except one, for each run, (n,)."""
    square, n = error**2, len(error)
    mean = (square.sum() - square) / (n - 1)
    squares = np.sum(square**2) - square**2
    return _fitted_quantile(mean, np.maximum(squares - (n - 1) * mean**2, 0.0) / (n - 2), probability)


def _difference(base: Floats, candidate: Floats, relative: bool) -> Floats:
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(candidate / base - 1.0 if relative else candidate - base)


def _resampled(pair: Floats, rank: int) -> Floats:
    """Return the order statistic of every resample of the pairs (2, n), (2, RESAMPLES)."""
    n = pair.shape[1]
    generator = np.random.default_rng(n)
    quantiles = np.empty((2, RESAMPLES))
    step = max(1, _CHUNK // n)
    for start in range(0, RESAMPLES, step):
        stop = min(RESAMPLES, start + step)
        chosen = generator.integers(0, n, (stop - start, n))
        for k in range(2):
            quantiles[k, start:stop] = np.partition(pair[k][chosen], rank, axis=1)[:, rank]
    return quantiles


def beyond_change(base: Bools, candidate: Bools, alpha_low: float, alpha_high: float) -> Change:
    """Return the change of the fraction of runs beyond a limit, with score bounds for paired fractions (Tango 1998).

    As in McNemar's test, only runs beyond the limit in one case but not in the other give information.

    base, candidate : (n,), whether each run is beyond the limit
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
    """Return the lower limit on the difference of paired fractions, at which the score statistic equals z.

    n : pairs of runs
    more, less : pairs beyond the limit in the candidate only, and in the base only
    """

    def missing(difference: float) -> float:
        a = 2.0 * n
        b = (2.0 * n - more + less) * difference - more - less
        c = -less * difference * (1.0 - difference)
        nuisance = (np.sqrt(max(0.0, b * b - 4.0 * a * c)) - b) / (2.0 * a)
        variance = n * (2.0 * nuisance + difference * (1.0 - difference))
        return float(more - less - n * difference - z * np.sqrt(max(variance, 0.0)))

    lowest, below = -1.0 + 1e-12, (more - less) / n - 1e-9  # stay below the estimate, where the statistic may be 0 / 0
    if below <= lowest or missing(lowest) <= 0.0:
        return -1.0
    return float(optimize.brentq(missing, lowest, below, xtol=1e-12))


def verdict(low: float, high: float, effect: float) -> str:
    """Return "worse" if the change is shown to exceed the smallest change of interest, "not worse" if shown to be below
    it.

    low, high : bounds on the change
    effect : smallest change of interest
    """
    return "worse" if low > effect else "not worse" if high < effect else "undecided"
