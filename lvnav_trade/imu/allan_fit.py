"""Fit of the noise of one IMU axis to the Allan variance of a data stream: four coefficients with 95 % intervals.

The Allan variance is linear in the squared coefficients of IEEE 952: quantisation q, white noise N, bias instability B,
rate random walk K. The fit is generalised least squares with the exact covariance of overlapping Allan variances of
Gaussian processes, a sum of squared covariances of second differences. Quantisation errors are uniform, and therefore
have a smaller fourth moment.
"""

import math
from collections.abc import Sequence
from functools import lru_cache
from itertools import combinations_with_replacement, pairwise, product
from typing import NamedTuple

import numpy as np

from lvnav_trade.imu.allan import overlapping
from lvnav_trade.quantities.records import Floats, Ints

NAMES = ("quantisation", "random_walk", "bias_instability", "rate_random_walk")
FEWEST = 500  # samples of a stream
_Z = 1.959963984540054
_Z_BOUND = 1.6448536269514722
_SHOWN = 2.5  # standard deviations above zero from which a squared coefficient counts as observed
_PER_DECADE = 6
_LEAST = 9  # fewest averaging intervals in the stream
_EXACT = 48  # largest number of terms between two kinks that are summed exactly; longer sums are integrated
_PASSES = 12
_UNIFORM = -1.2  # excess of the fourth moment of a uniform error, in squared variances
_SECOND = (1.0, -2.0, 1.0)


class Coefficient(NamedTuple):
    """A noise coefficient, SI.

    value : Estimate; 0 if the stream does not show the coefficient.
    low : Lower bound of the 95 % confidence interval; 0 if the stream does not show it.
    high : Upper bound of the interval; if the stream does not show it, the one-sided 95 % upper bound.
    shown : Whether the stream shows the coefficient.
    """

    value: float
    low: float
    high: float
    shown: bool


class AxisFit(NamedTuple):
    """Fit of one axis.

    tau : (n,) s. Averaging times.
    deviation : (n,). Overlapping Allan deviation.
    sigma : (n,). Its standard deviation.
    model : (n,). Allan deviation of the fitted coefficients.
    coefficients : Coefficients by the names of the card's fields.
    spread : Factor on the intervals: root mean square of the normalised residuals if that is significant, otherwise 1.
    """

    tau: Floats
    deviation: Floats
    sigma: Floats
    model: Floats
    coefficients: dict[str, Coefficient]
    spread: float


def ladder(n: int, dt: float, shortest: float = 0.0, longest: float = math.inf) -> list[int]:
    """Return averaging factors (samples) for a stream, six per decade, up to a ninth of the stream.

    Parameters
    ----------
    n : int
        Number of samples.
    dt : float
        Sampling interval (s).
    shortest, longest : float
        Smallest and largest averaging time (s).

    Returns
    -------
    list of int
        Rising; empty if the stream is too short.
    """
    # 1e-9: an averaging time that is a multiple of dt remains a multiple after rounding
    first = max(1, math.ceil(shortest / dt - 1e-9))
    last = min(n // _LEAST, math.floor(min(longest, n * dt) / dt + 1e-9))
    if last < first:
        return []
    decades = math.log10(max(last / first, 1.0001))
    count = max(2, math.ceil(_PER_DECADE * decades) + 1)
    return sorted({round(factor) for factor in np.geomspace(first, last, count)})


def fit(rates: Floats, dt: float, factors: Sequence[int]) -> AxisFit:
    """Return the noise coefficients of a data stream.

    Parameters
    ----------
    rates : (n,) rad/s or m/s^2
        Successive rates, each the mean over dt.
    dt : float
        Sampling interval (s).
    factors : sequence of int
        Averaging times in samples, as from `ladder`.
    """
    m = np.array(factors, dtype=np.int64)
    n = rates.size
    observed = overlapping(rates, dt, factors) ** 2
    design = np.stack([variances(name, m, dt) for name in NAMES], axis=1)
    squares, square_variances, V = _solve(observed, design, m, n, dt)
    model = design @ squares
    spread = _interval_factor(observed - model, V, n_fitted=int(np.count_nonzero(squares)))
    coefficients = {}
    for k, name in enumerate(NAMES):
        sigma = spread * math.sqrt(square_variances[k])
        if squares[k] > _SHOWN * sigma:
            coefficients[name] = _coefficient(squares[k], sigma)
        else:
            bound = _bound(squares, k, spread, design, m, n, dt)
            coefficients[name] = Coefficient(value=0.0, low=0.0, high=math.sqrt(bound), shown=False)
    model_deviation = np.sqrt(model)
    return AxisFit(
        tau=dt * m.astype(float),
        deviation=np.sqrt(observed),
        sigma=0.5 * np.sqrt(np.diag(V)) / model_deviation,  # of a root: half the relative sigma of the square
        model=model_deviation,
        coefficients=coefficients,
        spread=spread,
    )


def variances(name: str, m: Ints, dt: float) -> Floats:
    """Return the Allan variance (n,) of a process with unit coefficient.

    Parameters
    ----------
    name : str
        Process, one of `NAMES`.
    m : (n,)
        Averaging times in samples.
    dt : float
        Sampling interval (s).
    """
    at_0 = _generalised(name, 0 * m, dt)
    at_m = _generalised(name, m, dt)
    at_2m = _generalised(name, 2 * m, dt)
    second_difference = 6.0 * at_0 - 8.0 * at_m + 2.0 * at_2m
    return np.asarray(second_difference / (2.0 * (m * dt) ** 2))


def _interval_factor(residual: Floats, V: Floats, n_fitted: int) -> float:
    """Return the factor on the confidence intervals: root of chi-square per degree of freedom if it is significant.

    Chi-square has mean dof and variance 2 dof; intervals are widened beyond four sigmas.

    Parameters
    ----------
    residual : (n,)
        Observed minus modelled Allan variances.
    V : (n, n)
        Covariance of the Allan variances.
    n_fitted : int
        Number of coefficients above zero.
    """
    dof = residual.size - n_fitted
    chi2 = float(residual @ np.linalg.solve(V, residual))
    if dof > 0 and chi2 > dof + 4.0 * math.sqrt(2.0 * dof):
        return math.sqrt(chi2 / dof)
    return 1.0


def _generalised(name: str, lag: Ints | Floats, dt: float) -> Floats:
    """Return the generalised covariance of the angle of a process with unit coefficient, same shape as `lag`.

    It gives the covariances of second differences, which are stationary: sigma^2 at lag 0 for white noise of the angle,
    -|t| / 2 for a random walk, |t|^3 / 12 for an integrated random walk, t^2 ln|t| / (2 pi) for integrated flicker
    noise.

    Parameters
    ----------
    name : str
        Process, one of `NAMES`.
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
    log_t = np.log(np.maximum(t, 1e-300))  # t^2 ln t is 0 at t = 0
    return np.asarray(t**2 * log_t / (2.0 * math.pi))


def _solve(observed: Floats, design: Floats, m: Ints, n: int, dt: float) -> tuple[Floats, Floats, Floats]:
    """Return the squared coefficients of a generalised least-squares fit, none negative.

    The covariance of the observations depends on the coefficients, so that the fit is repeated until they no longer
    change.

    Parameters
    ----------
    observed : (n_factor,)
        Observed Allan variances.
    design : (n_factor, 4)
        Allan variances of processes with unit coefficient.
    m : (n_factor,)
        Averaging times in samples.
    n : int
        Number of samples of the stream.
    dt : float
        Sampling interval (s).

    Returns
    -------
    squares, square_variances : (4,)
        Squared coefficients and their variances.
    V : (n_factor, n_factor)
        Covariance of the observations.
    """
    from scipy.optimize import nnls  # the import takes 0.3 s in every worker, and few need it

    # first guess: every observation with the same relative error
    scale = 1.0 / observed
    squares = nnls(design * scale[:, None], observed * scale)[0]
    for _ in range(_PASSES):
        V = covariance(squares, m.tolist(), n, dt)
        L = np.linalg.cholesky(V)
        A = np.linalg.solve(L, design)
        b = np.linalg.solve(L, observed)
        column_norm = np.linalg.norm(A, axis=0)
        previous = squares
        squares = nnls(A / column_norm, b)[0] / column_norm
        if np.allclose(previous, squares, rtol=1e-6, atol=0.0):
            break
    return squares, _square_variances(design, V), V


def _square_variances(design: Floats, V: Floats) -> Floats:
    """Return the variances (4,) of squared coefficients fitted to observations with covariance V: (A' V^-1 A)^-1."""
    A = np.linalg.solve(np.linalg.cholesky(V), design)
    column_norm = np.linalg.norm(A, axis=0)  # the squares differ by many orders of magnitude
    scaled = A / column_norm
    return np.asarray(np.diag(np.linalg.inv(scaled.T @ scaled)) / column_norm**2)


def _bound(squares: Floats, k: int, spread: float, design: Floats, m: Ints, n: int, dt: float) -> float:
    """Return the 95 % upper bound on a squared coefficient that the stream does not show.

    The bound b solves b = fitted + 1.645 sigma(b), where sigma is computed with the coefficient b in the covariance.
    """
    bounded = squares.copy()
    for _ in range(_PASSES):
        V = covariance(bounded, m.tolist(), n, dt)
        sigma = math.sqrt(_square_variances(design, V)[k])
        bounded[k] = squares[k] + _Z_BOUND * spread * sigma
    return float(bounded[k])


def _coefficient(square: float, sigma: float) -> Coefficient:
    """Return a coefficient from its square and the standard deviation of its square.

    The interval is symmetric in the cube root of the square (Wilson and Hilferty), in which a sum of squares is nearly
    Gaussian.
    """
    half_width = _Z * sigma / (3.0 * square)  # of the cube root, relative to it
    low = square * max(0.0, 1.0 - half_width) ** 3
    high = square * max(0.0, 1.0 + half_width) ** 3
    return Coefficient(math.sqrt(square), math.sqrt(low), math.sqrt(high), shown=True)


def covariance(squares: Floats, m: Sequence[int], n: int, dt: float) -> Floats:
    """Return the covariance (n_factor, n_factor) of overlapping Allan variances.

    Parameters
    ----------
    squares : (4,)
        Squared coefficients of the processes, in the order of `NAMES`.
    m : (n_factor,)
        Averaging times in samples.
    n : int
        Number of samples of the stream.
    dt : float
        Sampling interval (s).
    """
    return np.einsum("ijkl,k,l->ij", _quadratic_forms(tuple(m), n, dt), squares, squares)


@lru_cache(maxsize=8)
def _quadratic_forms(m: tuple[int, ...], n: int, dt: float) -> Floats:
    """Return the coefficients (n_factor, n_factor, 4, 4) of the covariance as a quadratic form of the squares."""
    moments = np.empty((len(m), len(m), 4, 4))
    for i, j in combinations_with_replacement(range(len(m)), 2):
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
    kinks = np.unique([j * b - i * a for i in range(3) for j in range(3)])
    lags, weights = _summation_lags(kinks, n_a, n_b)
    smooth = _second_covariances(lags, a, b, dt)
    smooth[0] = 0.0
    lag_weights = weights * _n_pair(lags, n_a, n_b)
    total = np.einsum("l,kl,jl->kj", lag_weights, smooth, smooth)
    # quantisation is white noise of the angle: its covariances are zero except at single lags
    single_lags = kinks[(kinks > -n_b) & (kinks < n_a)]
    single = _second_covariances(single_lags, a, b, dt)
    n_single = _n_pair(single_lags, n_a, n_b)
    discrete = np.einsum("l,l,kl->k", n_single, single[0], single)
    total[0, 1:] = discrete[1:]
    total[1:, 0] = discrete[1:]
    total[0, 0] = discrete[0] + 0.5 * _UNIFORM * 36.0 / 144.0 * min(n_a, n_b)
    scale = 4.0 * a * a * b * b * dt**4 * n_a * n_b
    return np.asarray(2.0 * total / scale)


def _n_pair(lags: Floats, n_a: int, n_b: int) -> Floats:
    """Return the number of pairs of second differences with each lag (start of the first minus start of the second).

    lags : (n_lag,) in samples; n_a, n_b : numbers of second differences over a and b samples
    """
    end = np.minimum(n_a, n_b + lags)
    start = np.maximum(0.0, lags)
    return np.asarray(np.maximum(0.0, end - start))


def _second_covariances(lags: Floats, a: int, b: int, dt: float) -> Floats:
    """Return the covariances (4, n_lag) of second differences of the angle, by process and lag of their starts.

    Each process has a unit coefficient.

    lags : (n_lag,) in samples; a, b : averaging times in samples; dt : s, sampling interval
    """
    covariances = np.zeros((len(NAMES), len(lags)))
    for k, name in enumerate(NAMES):
        for (i, p), (j, q) in product(enumerate(_SECOND), repeat=2):
            shifted = lags + i * a - j * b
            covariances[k] += p * q * _generalised(name, shifted, dt)
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
            lags.append(np.arange(low + 1, high, dtype=float))
            weights.append(np.ones(max(0, n_term)))
        else:
            half = 0.5 * n_term
            lags.append(0.5 * (low + high) + half * nodes)
            weights.append(half * node_weights)
    return np.concatenate(lags), np.concatenate(weights)


def _piece_edges(kinks: Ints, n_a: int, n_b: int) -> list[int]:
    """Return the lags between which the summed function is smooth, rising, from the smallest to the largest lag."""
    first = 1 - n_b
    last = n_a - 1
    start = int(kinks[0])
    reach = int(kinks[-1]) - start
    edges = [first, start - reach, start - reach // 8]  # shorter pieces next to the kinks, where the function is steep
    edges += [int(kink) for kink in kinks]
    mirrored = [-edge for edge in edges]
    edges += [0, n_a - n_b, *mirrored, last]
    return sorted({min(max(edge, first), last) for edge in edges})
