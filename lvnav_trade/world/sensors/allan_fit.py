"""Noise of one axis fitted to the Allan variance of its stream: four coefficients with intervals of 95 %.

The variance of second differences is linear in the squares of the coefficients of IEEE 952: quantisation q, white noise
N, bias instability B, rate random walk K. The fit is generalised least squares with the exact covariance of overlapping
Allan variances of Gaussian processes (a sum of squared covariances of second differences); rounding errors of a
quantiser are uniform, which has a smaller fourth moment.
"""

import math
from collections.abc import Sequence
from functools import lru_cache
from itertools import combinations_with_replacement, pairwise, product
from typing import NamedTuple

import numpy as np

from lvnav_trade.records import Floats, Ints
from lvnav_trade.world.sensors.allan import overlapping

NAMES = ("quantisation", "random_walk", "bias_instability", "rate_random_walk")
FEWEST = 500  # samples of a stream
_Z = 1.959963984540054
_Z_BOUND = 1.6448536269514722
_SHOWN = 2.5  # standard deviations of a squared coefficient above zero from which a stream shows it
_PER_DECADE = 6
_LEAST = 9  # intervals of the longest averaging time in the stream
_EXACT = 48  # terms of a sum between two kinks that are added one by one; of more the sum is an integral
_PASSES = 12
_UNIFORM = -1.2  # excess of the fourth moment of a uniform error, in squared variances
_SECOND = (1.0, -2.0, 1.0)


class Coefficient(NamedTuple):
    """A coefficient (SI of the sensor), its interval of 95 %, and whether the stream shows it; of one that it does not
    show value and low are 0 and high is the bound of 95 %.
    """

    value: float
    low: float
    high: float
    shown: bool


class AxisFit(NamedTuple):
    """tau (n,) s; deviation, sigma (n,) overlapping Allan deviation and its standard deviation; model (n,) that of the
    coefficients, which stand by the names of a card's fields; spread: root of the mean square of the residuals in their
    own standard deviations, by which the intervals are wider where it is beyond chance, 1 otherwise.
    """

    tau: Floats
    deviation: Floats
    sigma: Floats
    model: Floats
    coefficients: dict[str, Coefficient]
    spread: float


def ladder(n: int, dt: float, shortest: float = 0.0, longest: float = math.inf) -> list[int]:
    """Return averaging factors for a stream of n samples of dt s, six a decade, up to a ninth of the stream; only
    averaging times from shortest to longest (s).
    """
    first, last = (
        max(1, math.ceil(shortest / dt - 1e-9)),
        min(n // _LEAST, math.floor(min(longest, n * dt) / dt + 1e-9)),
    )
    if last < first:
        return []
    count = max(2, math.ceil(_PER_DECADE * math.log10(max(last / first, 1.0001))) + 1)
    return sorted({round(one) for one in np.geomspace(first, last, count)})


def fit(rates: Floats, dt: float, factors: Sequence[int]) -> AxisFit:
    """Return the coefficients of a stream of rates (n,), means over dt s each, by its deviations over factors."""
    m = np.array(factors, dtype=np.int64)
    observed = overlapping(rates, dt, factors) ** 2
    design = np.stack([variances(name, m, dt) for name in NAMES], axis=1)
    squares, cov, V = _solve(observed, design, m, rates.size, dt)
    model = design @ squares
    left = observed - model
    dof = m.size - int(np.count_nonzero(squares))
    chi2 = float(left @ np.linalg.solve(V, left))
    spread = math.sqrt(chi2 / dof) if dof > 0 and chi2 > dof + 4.0 * math.sqrt(2.0 * dof) else 1.0
    found = {}
    for k, name in enumerate(NAMES):
        sigma = spread * math.sqrt(cov[k])
        shown = squares[k] > _SHOWN * sigma
        high = 0.0 if shown else math.sqrt(_bound(squares, k, spread, design, m, rates.size, dt))
        found[name] = _coefficient(squares[k], sigma) if shown else Coefficient(0.0, 0.0, high, False)
    tau, root = dt * m.astype(float), np.sqrt(model)
    return AxisFit(tau, np.sqrt(observed), 0.5 * np.sqrt(np.diag(V)) / root, root, found, spread)


def variances(name: str, m: Ints, dt: float) -> Floats:
    """Return the Allan variance (n,) over m (n,) samples of dt s of a process whose coefficient is one."""
    second = 6.0 * _generalised(name, 0 * m, dt) - 8.0 * _generalised(name, m, dt) + 2.0 * _generalised(name, 2 * m, dt)
    return np.asarray(second / (2.0 * (m * dt) ** 2))


def _generalised(name: str, lag: Ints | Floats, dt: float) -> Floats:
    """Return the generalised covariance of the angle of a process at lags of samples, good for second differences.

    It is that of any process whose second differences are stationary: of white noise in the angle sigma^2 at lag 0, of
    a random walk of the angle -|t| / 2, of an integrated random walk |t|^3 / 12, of integrated flicker noise
    t^2 ln|t| / (2 pi).
    """
    t = np.abs(lag) * dt
    if name == "quantisation":
        return np.asarray((lag == 0) / 12.0)
    if name == "random_walk":
        return np.asarray(-0.5 * t)
    if name == "rate_random_walk":
        return np.asarray(t**3 / 12.0)
    return np.asarray(t**2 * np.log(np.maximum(t, 1e-300)) / (2.0 * math.pi))


def _solve(observed: Floats, design: Floats, m: Ints, n: int, dt: float) -> tuple[Floats, Floats, Floats]:
    """Return squared coefficients (4,), none below zero, their variances (4,), and the covariance of the observed."""
    from scipy.optimize import nnls  # 0.3 s of every process, for few units

    scale = 1.0 / observed
    squares = nnls(design * scale[:, None], observed * scale)[0]
    for _ in range(_PASSES):
        V = covariance(squares, m.tolist(), n, dt)
        L = np.linalg.cholesky(V)
        A, b = np.linalg.solve(L, design), np.linalg.solve(L, observed)
        size = np.linalg.norm(A, axis=0)
        before, squares = squares, nnls(A / size, b)[0] / size
        if np.allclose(before, squares, rtol=1e-6, atol=0.0):
            break
    return squares, _square_variances(design, V), V


def _square_variances(design: Floats, V: Floats) -> Floats:
    """Return the variances (4,) of squared coefficients that are fitted to observations of covariance V."""
    A = np.linalg.solve(np.linalg.cholesky(V), design)
    size = np.linalg.norm(A, axis=0)
    return np.asarray(np.diag(np.linalg.inv((A / size).T @ (A / size))) / size**2)


def _bound(squares: Floats, k: int, spread: float, design: Floats, m: Ints, n: int, dt: float) -> float:
    """Return the bound of 95 % on a squared coefficient that is not shown: the one that would be as much larger than
    what is fitted as its own standard deviation, with it in the covariance, explains.
    """
    bounded = squares.copy()
    for _ in range(_PASSES):
        sigma = math.sqrt(_square_variances(design, covariance(bounded, m.tolist(), n, dt))[k])
        bounded[k] = squares[k] + _Z_BOUND * spread * sigma
    return float(bounded[k])


def _coefficient(square: float, sigma: float) -> Coefficient:
    """Return a coefficient from its square and the standard deviation of that.

    The interval is symmetric in the cube root of the square (Wilson and Hilferty), in which a sum of squares is nearly
    Gaussian.
    """
    part = _Z * sigma / (3.0 * square)
    low, high = (square * max(0.0, 1.0 + sign * part) ** 3 for sign in (-1.0, 1.0))
    return Coefficient(math.sqrt(square), math.sqrt(low), math.sqrt(high), True)


def covariance(squares: Floats, m: Sequence[int], n: int, dt: float) -> Floats:
    """Return the covariance (n_factor, n_factor) of the overlapping Allan variances of n samples of dt s over m samples
    each, of processes whose squared coefficients are given (4,).
    """
    return np.einsum("ijkl,k,l->ij", _moments(tuple(m), n, dt), squares, squares)


@lru_cache(maxsize=8)
def _moments(m: tuple[int, ...], n: int, dt: float) -> Floats:
    """Return what the covariance is of each product of two squared coefficients (n_factor, n_factor, 4, 4)."""
    found = np.empty((len(m), len(m), 4, 4))
    for i, j in combinations_with_replacement(range(len(m)), 2):
        found[i, j] = found[j, i] = _pair(m[i], m[j], n, dt)
    return found


def _pair(a: int, b: int, n: int, dt: float) -> Floats:
    """Return (4, 4) what the covariance of the overlapping Allan variances over a and b samples is of each product of
    two squared coefficients: twice the sum, over all pairs of second differences, of products of their covariances.
    """
    n_a, n_b = n + 1 - 2 * a, n + 1 - 2 * b
    kinks = np.unique([j * b - i * a for i in range(3) for j in range(3)])
    lags, weights = _lags(kinks, n_a, n_b)
    smooth = _second_covariances(lags, a, b, dt)
    smooth[0] = 0.0
    total = np.einsum("l,kl,jl->kj", weights * _pairs(lags, n_a, n_b), smooth, smooth)
    at = kinks[(kinks > -n_b) & (kinks < n_a)]  # quantisation: white noise of the angle, at single lags
    single = _second_covariances(at, a, b, dt)
    beside = np.einsum("l,l,kl->k", _pairs(at, n_a, n_b), single[0], single)
    total[0, 1:] = total[1:, 0] = beside[1:]
    total[0, 0] = beside[0] + 0.5 * _UNIFORM * 36.0 / 144.0 * min(n_a, n_b)
    return np.asarray(2.0 * total / (4.0 * a * a * b * b * dt**4 * n_a * n_b))


def _pairs(lags: Floats, n_a: int, n_b: int) -> Floats:
    """Return how many pairs of a first and a second start have each lag, the first minus the second."""
    return np.asarray(np.maximum(0.0, np.minimum(n_a, n_b + lags) - np.maximum(0.0, lags)))


def _second_covariances(lags: Floats, a: int, b: int, dt: float) -> Floats:
    """Return the covariances (4, n_lag) of second differences of the angle over a and b samples that start a lag apart,
    of each process with a coefficient of one.
    """
    found = np.zeros((len(NAMES), len(lags)))
    for k, name in enumerate(NAMES):
        for (i, p), (j, q) in product(enumerate(_SECOND), repeat=2):
            found[k] += p * q * _generalised(name, lags + i * a - j * b, dt)
    return found


def _lags(kinks: Ints, n_a: int, n_b: int) -> tuple[Floats, Floats]:
    """Return lags and weights of a sum over all lags of a function that is smooth between kinks: term by term where
    they are close, Gauss' rule between the others.
    """
    first, last = 1 - n_b, n_a - 1
    reach = int(kinks[-1] - kinks[0])
    edges = [first, int(kinks[0]) - reach, int(kinks[0]) - reach // 8, *map(int, kinks)]
    edges = sorted({min(max(edge, first), last) for edge in [*edges, 0, n_a - n_b, *(-e for e in edges), last]})
    nodes, parts = np.polynomial.legendre.leggauss(16)
    lags, weights = [np.array(edges, dtype=float)], [np.ones(len(edges))]
    for low, high in pairwise(edges):
        if high - low - 1 <= _EXACT:
            lags.append(np.arange(low + 1, high, dtype=float))
            weights.append(np.ones(max(0, high - low - 1)))
        else:
            lags.append(0.5 * (low + high) + 0.5 * (high - low - 1) * nodes)
            weights.append(0.5 * (high - low - 1) * parts)
    return np.concatenate(lags), np.concatenate(weights)
