"""Splines of a user's file: through its rows, free to bend where a force jumps, and of an attitude that it lacks."""

from collections.abc import Sequence
from itertools import pairwise
from typing import Literal, NamedTuple

import numpy as np
from scipy.interpolate import BSpline, make_interp_spline
from scipy.optimize import brentq
from scipy.sparse import block_array, csc_array, csr_array, diags_array
from scipy.sparse.linalg import splu

from lvnav_trade import frames
from lvnav_trade.errors import InputError
from lvnav_trade.kernels.earth import gravity_along
from lvnav_trade.records import Floats
from lvnav_trade.world.ascent.steering_law import ascent_attitude, smoothsteps, stretch_knots, thrust_directions
from lvnav_trade.world.ascent.vehicle import Roll
from lvnav_trade.world.truth import joined, pad_times

_CLOSEST = 0.1  # s between knots at least: closer ones only turn the rounding of the rows into force
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(3)  # exact for the square of what is left after `order` derivatives
_TIE = 1e-4  # weight of the next lower derivative, which alone ties down a stretch with hardly a row
_EXACT = -9.0  # log10 of the weight of roughness that leaves the rows where they are
_SMOOTHEST = 8.0
_REFINEMENTS = 2  # of the normal equations, which lose half of the digits
_COAST = 0.5  # m/s^2; a stretch with less specific force than this (median) is a coast
_EDGE = 1e-9  # s by which a time is kept within its stretch: force is one-sided at a break


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

    breaks: times (s) within the rows, rising, at which derivative degree - 3 and above may jump: force, for a velocity
    of degree 4 or a position of degree 5. Smoothest means the least integrated square of derivative degree - 1: of the
    derivative of jerk, for the same two. noise: one sigma of a component of a row, in its unit; the spline leaves the
    rows by that much (RMS). Zero: it goes through every row, as far as rows closer than 0.1 s allow. steps: times (s)
    from which the rows may be offset by a constant; the spline stays without it.
    """
    spans = [float(t[0]), *breaks, float(t[-1])]
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
    weights = {degree - 1: 1.0, degree - 2: _TIE}
    scales = {order: weight * np.sqrt(cell * usual ** (2 * order - 1)) for order, weight in weights.items()}
    rough = block_array([[diags_array(s) @ _derivative(knots, degree, order, at)] for order, s in scales.items()])
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


_SLOW, _FAST = 1.0, 20.0  # m/s; upright below, along the velocity above, blended between


def along_path(
    position: BSpline, edges: list[float], theta0: float, along: Literal["thrust", "velocity"], roll: Roll, hold: float
) -> BSpline:
    """Return the quaternion spline of the body, from `hold` seconds before the first edge, at rest on the Earth there.

    position: spline in frame i; edges (n + 1,) of its n stretches, in s. InputError where the x axis is to lie along a
    thrust that is nowhere.
    """
    times = [stretch_knots(begin, end) for begin, end in pairwise(edges)]
    t = joined(times)
    x = _along_force(position, times) if along == "thrust" else _along_velocity(position, t, theta0)
    right_e = _right_of_path(position, edges, theta0)
    if hold > 0.0:
        before = pad_times(edges[0], hold)[:-1]
        fixed = frames.ecef_from_eci(x[0], frames.earth_angle(theta0, edges[0]))
        x = np.concatenate([frames.eci_from_ecef(fixed, frames.earth_angle(theta0, before)), x])
        t = np.concatenate([before, t])
    return ascent_attitude(t, x, right_e, theta0, roll)


def _along_force(position: BSpline, times: list[Floats]) -> Floats:
    """Return the directions (n, 3) along the specific force, and through the coasts from one thrust to the next."""
    thrusts: list[BSpline | None] = []
    for t in times:
        inside = np.clip(t, t[0] + _EDGE, t[-1] - _EDGE)
        force = position(inside, 2) - gravity_along(position(inside))
        powered = float(np.median(np.linalg.norm(force, axis=1))) > _COAST
        thrusts.append(make_interp_spline(t, frames.unit(force), k=5) if powered else None)
    if all(one is None for one in thrusts):
        raise InputError("there is no thrust to point along: give columns of attitude, or pointing: velocity")
    found = zip(thrust_directions(times, thrusts), thrusts, strict=True)
    return np.concatenate([part if thrust is None else frames.unit(part) for part, thrust in found])


def _along_velocity(position: BSpline, t: Floats, theta0: float) -> Floats:
    """Return the directions (n, 3) of the Earth-relative velocity, upright where there is none."""
    r = position(t)
    v = frames.earth_velocity(r, position(t, 1))
    speed = np.linalg.norm(v, axis=1)
    theta = frames.earth_angle(theta0, t)
    latitude, longitude, _ = frames.geodetic_from_ecef(frames.ecef_from_eci(r, theta))
    up = frames.eci_from_ecef(-frames.rotation_e_n(latitude, longitude)[:, 2], theta)
    weight = smoothsteps((speed - _SLOW) / (_FAST - _SLOW))[:, None]
    return frames.unit((1.0 - weight) * up + weight * v / np.maximum(speed, _SLOW)[:, None])


def _right_of_path(position: BSpline, edges: list[float], theta0: float) -> Floats:
    """Return the unit vector (3,) of frame e to the right of the path; to the south of one that goes straight up."""
    first, last = (frames.ecef_from_eci(position(t), frames.earth_angle(theta0, t)) for t in (edges[0], edges[-1]))
    latitude, longitude, _ = frames.geodetic_from_ecef(first)
    north, _, down = frames.rotation_e_n(latitude, longitude)
    right = np.cross(last - first, -down)
    length = float(np.linalg.norm(right))
    return np.asarray(right / length if length > 1.0 else -north)
