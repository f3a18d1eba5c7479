"""Splines through rows of a user's file: smooth between declared times, free to bend where a force jumps."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline
from scipy.optimize import brentq
from scipy.sparse import block_array, csc_array, csr_array, diags_array
from scipy.sparse.linalg import splu

Floats = NDArray[np.float64]

_CLOSEST = 0.1  # s between knots at least: closer ones only turn the rounding of the rows into force
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(3)  # exact for the square of what is left after `order` derivatives
_TIE = 1e-4  # weight of the next lower derivative, which alone ties down a stretch with hardly a row
_EXACT = -9.0  # log10 of the weight of roughness that leaves the rows where they are
_SMOOTHEST = 8.0
_REFINEMENTS = 2  # of the normal equations, which lose half of the digits


class Fit(NamedTuple):
    """A spline (n, m), the steps (n_step, m) found in the rows, and the RMS of spline minus rows (after the steps)."""

    spline: BSpline
    steps: Floats
    misfit: float


class _Rows(NamedTuple):
    """Rows of the fit: values at the data, steps appended as columns, and roughness; the data itself."""

    values: csr_array
    rough: csr_array
    data: Floats

    def solve(self, log_weight: float) -> tuple[Floats, float]:
        """Return the coefficients with roughness of a weight, and the RMS misfit."""
        rough = 10.0 ** (0.5 * log_weight) * self.rough
        normal = csc_array(self.values.T @ self.values + rough.T @ rough)
        # Where steps hardly differ from a bend of the spline the matrix is all but singular.
        factors = splu(csc_array(normal + 1e-14 * diags_array(normal.diagonal())))
        c = np.zeros((normal.shape[0], self.data.shape[1]))
        for _ in range(1 + _REFINEMENTS):
            c += factors.solve(self.values.T @ (self.data - self.values @ c) - rough.T @ (rough @ c))
        return c, float(np.sqrt(np.mean((self.values @ c - self.data) ** 2)))


def fit(t: Floats, y: Floats, breaks: Sequence[float], degree: int, noise: float, steps: Sequence[float] = ()) -> Fit:
    """Return the smoothest spline through rows y (n, m) at times t (n,).

    Parameters
    ----------
    breaks
        Times (s) at which derivative degree - 3 and above may jump: force, for a velocity of degree 4 or a position of
        degree 5.
    degree
        Of the spline. Smoothest means the least integrated square of derivative degree - 1: of the derivative of jerk,
        for the same two.
    noise
        One sigma of a component of a row, in its unit; the spline leaves the rows by that much (RMS). Zero: it goes
        through every row, as far as rows closer than 0.1 s allow.
    steps
        Times (s) from which the rows may be offset by a constant; the spline stays without it.
    """
    spans = [float(t[0]), *_inside(breaks, t), float(t[-1])]
    knots = _knots(t, spans, degree)
    rows = _rows(t, y, knots, degree, steps)
    size = len(knots) - degree - 1

    def made(log_weight: float) -> Fit:
        c, misfit = rows.solve(log_weight)
        return Fit(BSpline(knots, c[:size], degree), c[size:], misfit)

    exact = made(_EXACT)
    if noise <= exact.misfit:
        return exact
    smoothest = made(_SMOOTHEST)
    if smoothest.misfit <= noise:
        return smoothest
    return made(float(brentq(lambda weight: rows.solve(weight)[1] - noise, _EXACT, _SMOOTHEST, xtol=0.05)))


def _inside(breaks: Sequence[float], t: Floats) -> list[float]:
    """Return the breaks within the rows, in order, each once."""
    found: list[float] = []
    for time in sorted(breaks):
        if t[0] + 1e-6 < time < t[-1] - 1e-6 and (not found or time > found[-1] + 1e-6):
            found.append(float(time))
    return found


def _knots(t: Floats, spans: list[float], degree: int) -> Floats:
    """Return a knot at every row that is not too close to the one before, and four at each break."""
    inner: list[float] = []
    for number, (begin, end) in enumerate(pairwise(spans)):
        inner += [] if number == 0 else [begin] * 4
        last = begin
        for time in t[(t > begin) & (t < end)]:
            if time - last > 0.99 * _CLOSEST and end - time > 0.5 * _CLOSEST:
                inner.append(float(time))
                last = float(time)
    return np.array([spans[0]] * (degree + 1) + inner + [spans[-1]] * (degree + 1))


def _rows(t: Floats, y: Floats, knots: Floats, degree: int, steps: Sequence[float]) -> _Rows:
    """Return the rows; roughness is weighted so that one stands for the interval between rows whatever its length."""
    values = csr_array(BSpline.design_matrix(t, knots, degree))
    ends = np.unique(knots)
    length = np.diff(ends)
    at = (ends[:-1, None] + 0.5 * length[:, None] * (1.0 + _NODES)).ravel()
    cell, usual = (0.5 * length[:, None] * _WEIGHTS).ravel(), float(np.median(np.diff(t)))
    parts = []
    for order, weight in ((degree - 1, 1.0), (degree - 2, _TIE)):
        scale = weight * np.sqrt(cell * usual ** (2 * order - 1))
        parts.append([diags_array(scale) @ _derivative(knots, degree, order, at)])
    rough = csr_array(block_array(parts))
    if steps:
        after = csr_array((t[:, None] >= np.asarray(steps)).astype(float))
        values = csr_array(block_array([[values, after]]))
        rough = block_array([[rough, csr_array((rough.shape[0], len(steps)))]])
    return _Rows(values, csr_array(rough), y)


def _derivative(knots: Floats, degree: int, order: int, at: Floats) -> csr_array:
    """Return the matrix from coefficients to derivative `order` at times within the knots' intervals."""
    lower: csr_array | None = None
    for k in range(degree, degree - order, -1):
        size = len(knots) - k - 1
        span = knots[k + 1 : -1] - knots[1:size]
        slope = np.divide(float(k), span, out=np.zeros_like(span), where=span > 0.0)  # no support: no part in it
        step = csr_array(diags_array([-slope, slope], offsets=[0, 1], shape=(size - 1, size)))
        lower = step if lower is None else csr_array(step @ lower)
        knots = knots[1:-1]
    assert lower is not None
    return csr_array(csr_array(BSpline.design_matrix(at, knots, degree - order)) @ lower)
