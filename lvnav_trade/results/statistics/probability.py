"""Intervals of mean squares and fractions, multiple tests, Gaussian probabilities, Sobol's indices of a fit."""

from bisect import bisect_left
from itertools import combinations

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import ArrayLike
from scipy import optimize, special, stats

from lvnav_trade.quantities.records import Floats

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(96)
_LEAST_PROBABILITY = 1e-15  # keeps a normal quantile finite
_REACH = 9.0  # sigmas; the probability of a Gaussian beyond is 2e-19


def rms_interval(rms: ArrayLike, freedom: ArrayLike, alpha: float = 0.05) -> tuple[Floats, Floats]:
    """Return the confidence interval of a true root mean square.

    Parameters
    ----------
    rms : (n,) array
        Sample root mean squares, any unit.
    freedom : (n,) array
        Degrees of freedom of each.
    alpha : float
        One minus the confidence.

    Returns
    -------
    (n,) array, (n,) array
        Lower and upper limits in the unit of `rms`; NaN without degrees of freedom.
    """
    low, high = ratio_interval(freedom, alpha)
    return np.asarray(rms) / high, np.asarray(rms) / low


def ratio_interval(freedom: ArrayLike, alpha: float = 0.05) -> tuple[Floats, Floats]:
    """Return the limits of the ratio of sample to true RMS, exceeded with probability alpha / 2 each."""
    low, high = mean_square_interval(freedom, alpha)
    return np.sqrt(low), np.sqrt(high)


def mean_square_interval(freedom: ArrayLike, alpha: float = 0.05) -> tuple[Floats, Floats]:
    """Return the limits of chi-square divided by its degrees of freedom, exceeded with probability alpha / 2 each."""
    degrees = np.asarray(freedom, dtype=float)
    degrees = np.where(degrees > 0, degrees, np.nan)
    low = stats.chi2.ppf(alpha / 2.0, degrees) / degrees
    high = stats.chi2.ppf(1.0 - alpha / 2.0, degrees) / degrees
    return low, high


def success_bounds(runs: int, failures: int, confidence: float) -> tuple[float, float]:
    """Return the one-sided Clopper-Pearson bounds on a probability of success.

    Parameters
    ----------
    runs, failures : int
        Number of runs, and of failures among them.
    confidence : float
        Confidence of each bound.

    Returns
    -------
    float, float
        Lower and upper bound.
    """
    successes = runs - failures
    low, high = 0.0, 1.0
    if successes:
        low = float(stats.beta.ppf(1.0 - confidence, successes, failures + 1))
    if failures:
        high = float(stats.beta.ppf(confidence, successes + 1, failures))
    return low, high


def success_verdict(runs: int, failures: int, probability: float, confidence: float) -> str:
    """Return the verdict on a required probability of success.

    Parameters
    ----------
    runs, failures : int
        Number of runs, and of failures among them.
    probability, confidence : float
        Required probability of success, and confidence of each bound of `success_bounds`.

    Returns
    -------
    str
        "met" if the lower bound reaches the required probability, "violated" if the upper bound is below it, otherwise
        "undecided".
    """
    low, high = success_bounds(runs, failures, confidence)
    if runs and low >= probability:
        return "met"
    return "violated" if high < probability else "undecided"


def is_demonstrated(runs: int, failures: int, probability: float, confidence: float) -> bool:
    """Whether a number of failures is small enough to demonstrate a probability of success at a confidence."""
    if runs <= failures:
        return False
    chance = float(stats.binom.cdf(failures, runs, 1.0 - probability))  # of so few failures, if it were just missed
    return chance <= 1.0 - confidence


def runs_needed(failures: int, probability: float, confidence: float) -> int:
    """Return the smallest number of runs that demonstrates a probability of success in spite of some failures."""

    def is_enough(runs: int) -> bool:
        return is_demonstrated(runs, failures, probability, confidence)

    high = max(2, 2 * (failures + 1))
    while not is_enough(high):
        high *= 2
    first = high // 2 + 1 if high > 2 else 1
    return bisect_left(range(high), True, first, key=is_enough)


def holm(p_values: ArrayLike) -> Floats:
    """Return p-values (n,) adjusted by Holm's step-down method.

    With true null hypotheses, the probability that any adjusted p-value of the family is below alpha is at most alpha.
    """
    p = np.asarray(p_values, dtype=float)
    order = np.argsort(p, kind="stable")
    remaining_tests = len(p) - np.arange(len(p))
    cumulative_p = np.maximum.accumulate(p[order] * remaining_tests)
    adjusted_p = np.empty_like(p)
    adjusted_p[order] = np.minimum(cumulative_p, 1.0)
    return adjusted_p


def norm_probability(mean: ArrayLike, covariance: ArrayLike, limit: float) -> float:
    """Return the probability that the norm of a Gaussian vector is below a limit.

    Parameters
    ----------
    mean : (k,) array
        Mean, k at most 3.
    covariance : (k, k) array
        Covariance.
    limit : float
        Limit of the norm.

    Returns
    -------
    float
        P(|x| < limit), accurate to about 1e-9.

    Notes
    -----
    In the principal axes the squared norm is a weighted sum of non-central chi-squares. The axis of largest sigma is
    integrated in closed form. The others are integrated by Gauss-Legendre quadrature over the sphere, with
    x = x_mid + h sin(angle), which makes the integrand smooth at the edge of the sphere.
    """
    if not limit > 0.0:
        return 0.0
    P = np.atleast_2d(np.asarray(covariance, dtype=float))
    m = np.atleast_1d(np.asarray(mean, dtype=float))
    variance, axes = np.linalg.eigh(P)
    sigma = np.sqrt(np.maximum(0.0, variance))  # ascending: the last axis, of largest sigma, is done in closed form
    centre = axes.T @ m
    radius_squared = np.array([limit**2])
    weight = np.array([1.0])
    for k in range(len(sigma) - 1):
        radius_squared, weight = _integrate_axis(radius_squared, weight, float(centre[k]), float(sigma[k]))
    radius = np.sqrt(radius_squared)
    inside = _probability_within(radius, float(centre[-1]), float(sigma[-1]))
    return float(np.clip(np.sum(weight * inside), 0.0, 1.0))


def box_probability(mean: ArrayLike, covariance: ArrayLike, limits: ArrayLike) -> float:
    """Return the probability that every component of a Gaussian vector is below its limit in magnitude.

    Parameters
    ----------
    mean : (3,) array
        Mean.
    covariance : (3, 3) array
        Covariance.
    limits : (3,) array
        Limit of each component.

    Returns
    -------
    float
        P(|x_k| < limit_k for all k), accurate to about 1e-9 for correlations up to 0.9.

    Notes
    -----
    Genz (1992): with the Cholesky factor the components are integrated one after the other, each conditional on those
    before. Two are integrated by Gauss-Legendre quadrature, the last in closed form.
    """
    half_width = np.asarray(limits, dtype=float)
    if not np.all(half_width > 0.0):
        return 0.0
    # In components scaled by their limits the box is -1 to 1 along every axis.
    centre = np.asarray(mean, dtype=float) / half_width
    scaled_covariance = np.asarray(covariance, dtype=float) / np.outer(half_width, half_width)
    total_variance = float(np.trace(scaled_covariance))
    jitter = 1e-14 * max(total_variance, 1e-300)  # a component without variance has a factor, too
    factor = np.linalg.cholesky(scaled_covariance + jitter * np.eye(3))
    weight = np.array([1.0])
    normals = np.zeros((1, 0))  # (n, k): independent standard normals of the components before k, at the nodes
    for k in range(2):
        conditional_mean = (centre[k] + normals @ factor[k, :k])[:, None]
        sigma = factor[k, k]
        low = np.clip((-1.0 - conditional_mean) / sigma, -_REACH, _REACH)
        high = np.clip((1.0 - conditional_mean) / sigma, -_REACH, _REACH)
        width = high - low
        middle = 0.5 * (high + low)
        x = middle + 0.5 * width * _NODES
        density = np.exp(-0.5 * x * x) / np.sqrt(2.0 * np.pi)
        probability = density * 0.5 * width * _WEIGHTS
        weight = (weight[:, None] * probability).ravel()
        earlier_normals = np.repeat(normals, len(_NODES), axis=0)
        normals = np.column_stack([earlier_normals, x.ravel()])
    conditional_mean = centre[2] + normals @ factor[2, :2]
    sigma = factor[2, 2]
    low = (-1.0 - conditional_mean) / sigma
    high = (1.0 - conditional_mean) / sigma
    last = probability_between(low, high)
    return float(np.clip(np.sum(weight * last), 0.0, 1.0))


def probability_between(low: Floats, high: Floats) -> Floats:
    """Return the probability (n,) that a standard normal lies between two limits (n,)."""
    probability: Floats = special.ndtr(high) - special.ndtr(low)
    return probability


def _integrate_axis(radius_squared: Floats, weight: Floats, centre: float, sigma: float) -> tuple[Floats, Floats]:
    """Integrate over one axis: return at each node the squared radius for the remaining axes, and the weight."""
    radius = np.sqrt(radius_squared)
    if sigma == 0.0:
        inside = np.abs(centre) < radius
        rest_squared = np.maximum(radius_squared - centre**2, 0.0)
        return rest_squared[inside], weight[inside]
    low = np.maximum(-radius, centre - _REACH * sigma)
    high = np.minimum(radius, centre + _REACH * sigma)
    is_wide = high > low
    low, high = low[is_wide], high[is_wide]
    radius_squared, weight = radius_squared[is_wide], weight[is_wide]
    # x = x_mid + h sin(angle), dx = h cos(angle) d(angle), with the angle from -pi/2 to pi/2
    angle = 0.5 * np.pi * _NODES
    middle = 0.5 * (high + low)[:, None]
    half = 0.5 * (high - low)[:, None]
    x = middle + half * np.sin(angle)
    step = half * np.cos(angle) * (0.5 * np.pi * _WEIGHTS)
    normalised_x = (x - centre) / sigma
    exponent = -0.5 * normalised_x**2
    density = np.exp(exponent) / (sigma * np.sqrt(2.0 * np.pi))
    rest_squared = np.maximum(radius_squared[:, None] - x**2, 0.0)
    node_weight = weight[:, None] * density * step
    return rest_squared.ravel(), node_weight.ravel()


def _probability_within(radius: Floats, centre: float, sigma: float) -> Floats:
    """Return the probability (n,) that the last component lies within plus or minus each radius (n,)."""
    if sigma == 0.0:
        return (np.abs(centre) < radius).astype(float)
    return probability_between((-radius - centre) / sigma, (radius - centre) / sigma)


def ellipse_points(covariance: Floats, sigmas: float = 3.0, points: int = 97) -> Floats:
    """Return the points (points, 2) of the error ellipse of a covariance (2, 2) for a number of sigmas."""
    variance, axes = np.linalg.eigh(covariance)
    semi_axes = sigmas * np.sqrt(np.maximum(variance, 0.0))
    angle = np.linspace(0.0, 2.0 * np.pi, points)
    circle = np.stack([np.cos(angle), np.sin(angle)])
    return np.asarray((axes * semi_axes @ circle).T)


def norm_quantile(mean: ArrayLike, covariance: ArrayLike, probability: float) -> float:
    """Return the P-quantile of the norm |x| of a Gaussian vector x, to 1e-9.

    Parameters
    ----------
    mean, covariance : (k,) array, (k, k) array
        Mean and covariance of x, with k at most 3.
    probability : float
        Probability P of the quantile.

    Returns
    -------
    float
        Quantile, in the unit of the mean. A vector without size gives 0.

    Notes
    -----
    The search starts at the quantile of the scaled chi-square of equal mean and variance (Satterthwaite 1946). The
    residual is a normal quantile, in which the distribution is close to a straight line.
    """
    centre = np.atleast_1d(np.asarray(mean, dtype=float))
    variance = np.atleast_2d(np.asarray(covariance, dtype=float))
    start = _approximate_quantile(centre, variance, probability)
    if start == 0.0:
        return 0.0
    required_quantile = special.ndtri(probability)

    def excess(limit: float) -> float:
        probability_below = norm_probability(centre, variance, limit)
        finite = np.clip(probability_below, _LEAST_PROBABILITY, 1.0 - _LEAST_PROBABILITY)
        return float(special.ndtri(finite) - required_quantile)

    low, high = 0.99 * start, 1.01 * start
    while excess(low) > 0.0:
        low, high = 0.8 * low, low
    while excess(high) < 0.0:
        low, high = high, 1.25 * high
    return float(optimize.brentq(excess, low, high, xtol=1e-9 * low, rtol=1e-9))


def _approximate_quantile(centre: Floats, variance: Floats, probability: float) -> float:
    """Return the quantile of |x| with the squared norm taken as a scaled chi-square; 0 for a vector without size."""
    # Moments of the squared norm: E = m'm + tr(P), V = 2 tr(P^2) + 4 m'P m
    mean_square = float(centre @ centre + np.trace(variance))
    if mean_square == 0.0:
        return 0.0
    variance_of_square = float(2.0 * np.sum(variance * variance) + 4.0 * centre @ variance @ centre)
    start = np.sqrt(mean_square)
    if variance_of_square > 0.0:
        scale = variance_of_square / (2.0 * mean_square)
        start = np.sqrt(scale * special.chdtri(mean_square / scale, 1.0 - probability)) or start
    return start


DEGREE = 3
POINTS, NODES = 512, 6  # of quadrature for the indices of a fit


def basis(d: int) -> list[tuple[tuple[int, int], ...]]:
    """Return the polynomials of `fit_polynomials`, each as factors (variable, degree).

    They are the constant, powers of each variable up to `DEGREE`, and products of two variables.
    """
    constant: tuple[tuple[int, int], ...] = ()
    single = [((k, degree),) for k in range(d) for degree in range(1, DEGREE + 1)]
    products = [((first, 1), (second, 1)) for first, second in combinations(range(d), 2)]
    return [constant, *single, *products]


def _polynomials(u: Floats) -> Floats:
    """Return the normalised polynomials of `basis` at points (n, d), as (n, n_term)."""
    legendre_values = [np.ones_like(u)]  # by degree, each (n, d), of mean square one over [-1, 1]
    for degree in range(1, DEGREE + 1):
        coefficients = [0.0] * degree + [1.0]
        legendre_values.append(np.sqrt(2 * degree + 1) * legendre.legval(u, coefficients))
    polynomials = basis(u.shape[1])
    values = np.ones((len(polynomials), len(u)))
    for row, polynomial in zip(values, polynomials, strict=True):
        for k, degree in polynomial:
            row *= legendre_values[degree][:, k]
    return values.T


def fit_polynomials(u: Floats, value: Floats) -> Floats:
    """Return the coefficients (n_term,) of polynomials that fit the logarithm of values (n,) at points (n, d) even in
    [-1, 1], by least squares.
    """
    return np.asarray(np.linalg.lstsq(_polynomials(u), np.log(value), rcond=None)[0])


def predicted_variance_share(u: Floats, value: Floats) -> float:
    """Return the predicted share of the variance: 1 - (mean squared error of leave-one-out prediction) / variance."""
    design = _polynomials(u)
    log_value = np.log(value)
    # Without point i the residual of point i is r_i / (1 - h_i), h the diagonal of the hat matrix Q Q' (PRESS).
    orthonormal, _ = np.linalg.qr(design)
    leverage = np.minimum(np.sum(orthonormal**2, axis=1), 1.0 - 1e-9)
    residual = (log_value - design @ fit_polynomials(u, value)) / (1.0 - leverage)
    prediction = np.exp(log_value - residual)
    squared_error = (value - prediction) ** 2
    return float(1.0 - np.mean(squared_error) / np.var(value))


def fitted_indices(coefficients: Floats, d: int) -> Floats:
    """Return first-order and total indices of the exponentials of fits (n_fit, n_term), as (2, n_fit, d).

    Over each variable by Gauss's quadrature, over the others by the mean of `POINTS` Sobol points: the first-order
    index is the variance of the conditional mean, the total one the mean of the conditional variance.
    """
    from scipy.stats import qmc  # half a second of every process, for few campaigns

    nodes, weights = legendre.leggauss(NODES)
    weights = 0.5 * weights  # of the uniform density in [-1, 1]
    sobol = qmc.Sobol(d, scramble=True, seed=0).random_base2(POINTS.bit_length() - 1)
    even_points = 2.0 * sobol - 1.0
    variance_rows = []  # by variable: variances of the fits (3, n_fit)
    for k in range(d):
        points = np.repeat(even_points[None], NODES, axis=0)
        points[:, :, k] = nodes[:, None]
        value = np.exp(coefficients @ _polynomials(points.reshape(-1, d)).T).reshape(-1, NODES, POINTS)
        mean_square = np.einsum("fqn,q->f", value**2, weights) / POINTS
        mean_over_others = value.mean(axis=2)  # E[y | u_k], (n_fit, NODES)
        mean_over_variable = np.einsum("fqn,q->fn", value, weights)  # E[y | the others], (n_fit, POINTS)
        mean = mean_over_others @ weights
        first_variance = mean_over_others**2 @ weights - mean**2  # V(E[y | u_k])
        total_variance = mean_square - np.mean(mean_over_variable**2, axis=1)  # E(V[y | the others])
        variance_rows.append([first_variance, total_variance, mean_square - mean**2])
    first, total, variance = np.moveaxis(np.array(variance_rows), 0, 2)
    return np.array([first, total]) / variance.mean(axis=1)[None, :, None]
