"""Sobol's indices of a function that is known at some points: those of a fit by Legendre polynomials."""

from itertools import combinations

import numpy as np
from numpy.polynomial import legendre

from lvnav_trade.quantities.records import Floats

DEGREE = 3
POINTS, NODES = 512, 6  # of quadrature for the indices of a fit


def basis(d: int) -> list[tuple[tuple[int, int], ...]]:
    """Return the polynomials of `chaos`, each as (variable, degree): single ones to `DEGREE`, products of two lines."""
    single = [((k, degree),) for k in range(d) for degree in range(1, DEGREE + 1)]
    return [(), *single, *(((i, 1), (j, 1)) for i, j in combinations(range(d), 2))]


def _terms(u: Floats) -> Floats:
    """Return the normalised polynomials of `basis` at points (n, d), as (n, n_term)."""
    single = [np.ones_like(u)]
    single += [np.sqrt(2 * g + 1) * legendre.legval(u, [0.0] * g + [1.0]) for g in range(1, DEGREE + 1)]
    found = np.ones((len(basis(u.shape[1])), len(u)))
    for column, term in zip(found, basis(u.shape[1]), strict=True):
        for k, g in term:
            column *= single[g][:, k]
    return found.T


def fitted(u: Floats, value: Floats) -> Floats:
    """Return the coefficients (n_term,) of polynomials that fit the logarithm of values (n,) at points (n, d) even in
    [-1, 1], by least squares.
    """
    return np.asarray(np.linalg.lstsq(_terms(u), np.log(value), rcond=None)[0])


def predicted(u: Floats, value: Floats) -> float:
    """Return 1 - (mean squared error of values that are left out of the fit, one by one) / variance."""
    design, log = _terms(u), np.log(value)
    leverage = np.minimum(np.sum(np.linalg.qr(design)[0] ** 2, axis=1), 1.0 - 1e-9)
    left_out = (log - design @ fitted(u, value)) / (1.0 - leverage)
    return float(1.0 - np.mean((value - np.exp(log - left_out)) ** 2) / np.var(value))


def fitted_indices(coefficients: Floats, d: int) -> Floats:
    """Return first-order and total indices of the exponentials of fits (n_fit, n_term), as (2, n_fit, d).

    Over each variable by Gauss's quadrature, over the others by the mean of `POINTS` Sobol points: the first-order
    index is the variance of the conditional mean, the total one the mean of the conditional variance.
    """
    from scipy.stats import qmc  # half a second of every process, for few campaigns

    nodes, weights = legendre.leggauss(NODES)
    weights = 0.5 * weights
    even, found = 2.0 * qmc.Sobol(d, scramble=True, seed=0).random_base2(POINTS.bit_length() - 1) - 1.0, []
    for k in range(d):
        at = np.repeat(even[None], NODES, axis=0)
        at[:, :, k] = nodes[:, None]
        value = np.exp(coefficients @ _terms(at.reshape(-1, d)).T).reshape(-1, NODES, POINTS)
        square = np.einsum("fqn,q->f", value**2, weights) / POINTS
        by_variable, by_others = value.mean(axis=2), np.einsum("fqn,q->fn", value, weights)
        mean = by_variable @ weights
        found.append([by_variable**2 @ weights - mean**2, square - np.mean(by_others**2, axis=1), square - mean**2])
    first, whole, variance = np.moveaxis(np.array(found), 0, 2)
    return np.array([first, whole]) / variance.mean(axis=1)[None, :, None]
