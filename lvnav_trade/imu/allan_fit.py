"""Fit of the noise of one IMU axis to the Allan variance of a data stream: four coefficients with 95 % intervals.

The Allan variance is linear in the squared coefficients of IEEE 952: quantisation q, white noise N, bias instability B,
rate random walk K. The fit is generalised least squares with the covariance of `allan_covariance`.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from lvnav_trade.imu.allan import overlapping
from lvnav_trade.imu.allan_covariance import PROCESSES, covariance, variances
from lvnav_trade.quantities.records import Floats, Ints

NAMES = PROCESSES
FEWEST = 500  # samples of a stream
_Z = 1.959963984540054
_Z_BOUND = 1.6448536269514722
_SHOWN = 2.5  # standard deviations above zero from which a squared coefficient counts as observed
_PER_DECADE = 6
_LEAST = 9  # fewest averaging intervals in the stream
_PASSES = 12


class Coefficient(NamedTuple):
    """A noise coefficient, SI.

    value : Estimate; 0 if the stream does not show the coefficient.
    low : Lower bound of the 95 % confidence interval; 0 if the stream does not show it.
    high : Upper bound of the interval; if the stream does not show it, the one-sided 95 % upper bound.
    is_significant : Whether the stream shows the coefficient.
    """

    value: float
    low: float
    high: float
    is_significant: bool


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
    longest_time = min(longest, n * dt)
    longest_factor = math.floor(longest_time / dt + 1e-9)
    last = min(n // _LEAST, longest_factor)
    if last < first:
        return []
    ratio = max(last / first, 1.0001)
    decades = math.log10(ratio)
    count = max(2, math.ceil(_PER_DECADE * decades) + 1)
    factors = np.geomspace(first, last, count)
    return sorted({round(factor) for factor in factors})


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
    allan_variances = overlapping(rates, dt, factors) ** 2
    columns = [variances(name, m, dt) for name in NAMES]
    design = np.stack(columns, axis=1)
    squares, square_variances, V = _solve(allan_variances, design, m, n, dt)
    model = design @ squares
    n_fitted = int(np.count_nonzero(squares))
    spread = _interval_factor(allan_variances - model, V, n_fitted=n_fitted)
    coefficients = {}
    for k, name in enumerate(NAMES):
        sigma = spread * math.sqrt(square_variances[k])
        if squares[k] > _SHOWN * sigma:
            coefficients[name] = _coefficient(squares[k], sigma)
        else:
            bound = _bound(squares, k, spread, design, m, n, dt)
            coefficients[name] = Coefficient(value=0.0, low=0.0, high=math.sqrt(bound), is_significant=False)
    model_deviation = np.sqrt(model)
    observation_sigma = np.sqrt(np.diag(V))
    return AxisFit(
        tau=dt * m.astype(float),
        deviation=np.sqrt(allan_variances),
        sigma=0.5 * observation_sigma / model_deviation,  # of a root: half the relative sigma of the square
        model=model_deviation,
        coefficients=coefficients,
        spread=spread,
    )


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
    weighted_residual = np.linalg.solve(V, residual)
    chi2 = float(residual @ weighted_residual)
    if dof > 0 and chi2 > dof + 4.0 * math.sqrt(2.0 * dof):
        return math.sqrt(chi2 / dof)
    return 1.0


def _solve(allan_variances: Floats, design: Floats, m: Ints, n: int, dt: float) -> tuple[Floats, Floats, Floats]:
    """Return the squared coefficients of a generalised least-squares fit, none negative.

    The covariance of the observations depends on the coefficients, so that the fit is repeated until they no longer
    change.

    Parameters
    ----------
    allan_variances : (n_factor,)
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
    scale = 1.0 / allan_variances
    scaled_design = design * scale[:, None]
    squares = nnls(scaled_design, allan_variances * scale)[0]
    factors = m.tolist()
    for _ in range(_PASSES):
        V = covariance(squares, factors, n, dt)
        L = np.linalg.cholesky(V)
        A = np.linalg.solve(L, design)
        b = np.linalg.solve(L, allan_variances)
        column_norm = np.linalg.norm(A, axis=0)
        previous = squares
        scaled_squares = nnls(A / column_norm, b)[0]
        squares = scaled_squares / column_norm
        if np.allclose(previous, squares, rtol=1e-6, atol=0.0):
            break
    square_variances = _square_variances(design, V)
    return squares, square_variances, V


def _square_variances(design: Floats, V: Floats) -> Floats:
    """Return the variances (4,) of squared coefficients fitted to observations with covariance V: (A' V^-1 A)^-1."""
    L = np.linalg.cholesky(V)
    A = np.linalg.solve(L, design)
    column_norm = np.linalg.norm(A, axis=0)  # the squares differ by many orders of magnitude
    scaled_A = A / column_norm
    scaled_covariance = np.linalg.inv(scaled_A.T @ scaled_A)
    scaled_variances = np.diag(scaled_covariance)
    return np.asarray(scaled_variances / column_norm**2)


def _bound(squares: Floats, k: int, spread: float, design: Floats, m: Ints, n: int, dt: float) -> float:
    """Return the 95 % upper bound on a squared coefficient that the stream does not show.

    The bound b solves b = fitted + 1.645 sigma(b), where sigma is computed with the coefficient b in the covariance.
    """
    bounded_squares = squares.copy()
    factors = m.tolist()
    for _ in range(_PASSES):
        V = covariance(bounded_squares, factors, n, dt)
        variance = _square_variances(design, V)[k]
        sigma = math.sqrt(variance)
        bounded_squares[k] = squares[k] + _Z_BOUND * spread * sigma
    return float(bounded_squares[k])


def _coefficient(square: float, sigma: float) -> Coefficient:
    """Return a coefficient from its square and the standard deviation of its square.

    The interval is symmetric in the cube root of the square (Wilson and Hilferty), in which a sum of squares is nearly
    Gaussian.
    """
    half_width = _Z * sigma / (3.0 * square)  # of the cube root, relative to it
    low_root = max(0.0, 1.0 - half_width)
    high_root = max(0.0, 1.0 + half_width)
    low = math.sqrt(square * low_root**3)
    high = math.sqrt(square * high_root**3)
    return Coefficient(math.sqrt(square), low, high, is_significant=True)
