"""Allan variance of the noise processes of an IMU axis, and the covariance of overlapping Allan variances.

The covariance is exact for Gaussian processes: a sum of squared covariances of second differences. Quantisation errors
are uniform, and therefore have a smaller fourth moment.
"""

import math
from collections.abc import Sequence
from functools import lru_cache
from itertools import combinations_with_replacement, pairwise, product

import numpy as np

from lvnav_trade.quantities.records import Floats, Ints

PROCESSES = ("quantisation", "random_walk", "bias_instability", "rate_random_walk")
_EXACT = 48  # largest number of terms between two kinks that are summed exactly; longer sums are integrated
_UNIFORM = -1.2  # excess of the fourth moment of a uniform error, in squared variances
_SECOND = (1.0, -2.0, 1.0)


def variances(name: str, m: Ints, dt: float) -> Floats:
    """Return the Allan variance (n,) of a process with unit coefficient.

    Parameters
    ----------
    name : str
        Process, one of `PROCESSES`.
    m : (n,)
        Averaging times in samples.
    dt : float
        Sampling interval (s).
    """
    at_0 = _generalised_covariance(name, 0 * m, dt)
    at_m = _generalised_covariance(name, m, dt)
    at_2m = _generalised_covariance(name, 2 * m, dt)
    second_difference = 6.0 * at_0 - 8.0 * at_m + 2.0 * at_2m
    tau = m * dt
    return np.asarray(second_difference / (2.0 * tau**2))


def _generalised_covariance(name: str, lag: Ints | Floats, dt: float) -> Floats:
    """Return the generalised covariance of the angle of a process with unit coefficient, same shape as `lag`.

    It gives the covariances of second differences, which are stationary: sigma^2 at lag 0 for white noise of the angle,
    -|t| / 2 for a random walk, |t|^3 / 12 for an integrated random walk, t^2 ln|t| / (2 pi) for integrated flicker
    noise.

    Parameters
    ----------
    name : str
        Process, one of `PROCESSES`.
    lag : (...,)
        Lags in samples.
    dt : float
        Sampling interval (s).
    """
    t = np.abs(lag) * dt
    if name == "quantisation":
        return np.asarray((lag == 0) / 12.0)
    if name == "random_walk":
        return np.asarray(-0.5 * t)
    if name == "rate_random_walk":
        return np.asarray(t**3 / 12.0)
    above_zero = np.maximum(t, 1e-300)  # t^2 ln t is 0 at t = 0
    log_t = np.log(above_zero)
    return np.asarray(t**2 * log_t / (2.0 * math.pi))


def covariance(squares: Floats, m: Sequence[int], n: int, dt: float) -> Floats:
    """Return the covariance (n_factor, n_factor) of overlapping Allan variances.

    Parameters
    ----------
    squares : (4,)
        Squared coefficients of the processes, in the order of `PROCESSES`.
    m : (n_factor,)
        Averaging times in samples.
    n : int
        Number of samples of the stream.
    dt : float
        Sampling interval (s).
    """
    forms = _quadratic_forms(tuple(m), n, dt)
    return np.einsum("ijkl,k,l->ij", forms, squares, squares)


@lru_cache(maxsize=8)
def _quadratic_forms(m: tuple[int, ...], n: int, dt: float) -> Floats:
    """Return the coefficients (n_factor, n_factor, 4, 4) of the covariance as a quadratic form of the squares."""
    n_factor = len(m)
    moments = np.empty((n_factor, n_factor, 4, 4))
    for i, j in combinations_with_replacement(range(n_factor), 2):
        form = _covariance_form(m[i], m[j], n, dt)
        moments[i, j] = form
        moments[j, i] = form
    return moments


def _covariance_form(a: int, b: int, n: int, dt: float) -> Floats:
    """Return the quadratic form (4, 4) of the covariance of the Allan variances over a and b samples.

    It is twice the sum, over all pairs of second differences, of products of their covariances (Isserlis' theorem).
    """
    n_a = n + 1 - 2 * a
    n_b = n + 1 - 2 * b
    kink_lags = [j * b - i * a for i in range(3) for j in range(3)]
    kinks = np.unique(kink_lags)
    lags, weights = _summation_lags(kinks, n_a, n_b)
    smooth = _second_covariances(lags, a, b, dt)
    smooth[0] = 0.0
    n_pair = _n_pair(lags, n_a, n_b)
    lag_weights = weights * n_pair
    total = np.einsum("l,kl,jl->kj", lag_weights, smooth, smooth)
    # quantisation is white noise of the angle: its covariances are zero except at single lags
    is_overlapping = (kinks > -n_b) & (kinks < n_a)
    single_lags = kinks[is_overlapping]
    single_covariances = _second_covariances(single_lags, a, b, dt)
    quantisation = single_covariances[0]
    n_single = _n_pair(single_lags, n_a, n_b)
    n_common = min(n_a, n_b)
    discrete = np.einsum("l,l,kl->k", n_single, quantisation, single_covariances)
    total[0, 1:] = discrete[1:]
    total[1:, 0] = discrete[1:]
    fourth_moment = 0.5 * _UNIFORM * 36.0 / 144.0 * n_common
    total[0, 0] = discrete[0] + fourth_moment
    scale = 4.0 * a * a * b * b * dt**4 * n_a * n_b
    return np.asarray(2.0 * total / scale)


def _n_pair(lags: Floats, n_a: int, n_b: int) -> Floats:
    """Return the number of pairs of second differences with each lag (start of the first minus start of the second).

    lags : (n_lag,) in samples; n_a, n_b : numbers of second differences over a and b samples
    """
    end = np.minimum(n_a, n_b + lags)
    start = np.maximum(0.0, lags)
    n_pair = np.maximum(0.0, end - start)
    return np.asarray(n_pair)


def _second_covariances(lags: Floats, a: int, b: int, dt: float) -> Floats:
    """Return the covariances (4, n_lag) of second differences of the angle, by process and lag of their starts.

    Each process has a unit coefficient.

    lags : (n_lag,) in samples; a, b : averaging times in samples; dt : s, sampling interval
    """
    covariances = np.zeros((len(PROCESSES), len(lags)))
    index_pairs = list(product(range(3), repeat=2))
    for k, name in enumerate(PROCESSES):
        for i, j in index_pairs:
            factor = _SECOND[i] * _SECOND[j]
            lag = lags + i * a - j * b
            term = _generalised_covariance(name, lag, dt)
            covariances[k] += factor * term
    return covariances


def _summation_lags(kinks: Ints, n_a: int, n_b: int) -> tuple[Floats, Floats]:
    """Return lags and weights for a sum over all lags of a function that is smooth between kinks.

    Short pieces are summed term by term, long pieces by Gauss-Legendre quadrature.
    """
    edges = _piece_edges(kinks, n_a, n_b)
    nodes, node_weights = np.polynomial.legendre.leggauss(16)
    lags = [np.array(edges, dtype=float)]
    weights = [np.ones(len(edges))]
    for low, high in pairwise(edges):
        n_term = high - low - 1  # lags between the edges, which have terms of their own
        if n_term <= _EXACT:
            inner_lags = np.arange(low + 1, high, dtype=float)
            lags.append(inner_lags)
            weights.append(np.ones(max(0, n_term)))
        else:
            half = 0.5 * n_term
            centre = 0.5 * (low + high)
            lags.append(centre + half * nodes)
            weights.append(half * node_weights)
    all_lags = np.concatenate(lags)
    all_weights = np.concatenate(weights)
    return all_lags, all_weights


def _piece_edges(kinks: Ints, n_a: int, n_b: int) -> list[int]:
    """Return the lags between which the summed function is smooth, rising, from the smallest to the largest lag."""
    first = 1 - n_b
    last = n_a - 1
    start = int(kinks[0])
    reach = int(kinks[-1]) - start
    # shorter pieces next to the kinks, where the function is steep
    far_edge = start - reach
    near_edge = start - reach // 8
    edges = [first, far_edge, near_edge]
    edges += [int(kink) for kink in kinks]
    mirror_edges = [-edge for edge in edges]
    edges += [0, n_a - n_b, *mirror_edges, last]
    distinct_edges = {min(max(edge, first), last) for edge in edges}
    return sorted(distinct_edges)
