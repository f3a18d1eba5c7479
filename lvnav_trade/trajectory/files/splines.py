"""Splines of a user's file: through its rows, with jumps of force at events, and along the path without attitude."""

from collections.abc import Sequence
from itertools import pairwise
from typing import Literal, NamedTuple

import numpy as np
from scipy.interpolate import BSpline, make_interp_spline
from scipy.optimize import brentq
from scipy.sparse import block_array, csc_array, csr_array, diags_array
from scipy.sparse.linalg import splu

from lvnav_trade.kernels.earth import gravity_along
from lvnav_trade.quantities import frames
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.quantities.records import Floats
from lvnav_trade.trajectory.ascent.steering_law import ascent_attitude, smoothsteps, stretch_knots, thrust_directions
from lvnav_trade.trajectory.ascent.vehicle_cards import Roll
from lvnav_trade.trajectory.truth import join_samples, pad_times

_CLOSEST = 0.1  # s; smallest interval of knots, because closer knots turn the rounding of the rows into force
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(3)  # exact for the square of the derivatives below
_TIE = 1e-4  # weight of the next lower derivative, which determines the spline in a part with few rows
_EXACT = -9.0  # log10 of the weight of roughness at which the spline passes through the rows
_SMOOTHEST = 8.0
_REFINEMENTS = 2  # of the normal equations, which lose half of the digits
_COAST = 0.5  # m/s^2; a part with less specific force (median) is a coast
_EDGE = 1e-9  # s; distance of the first and last time from the ends of a part, because force jumps there


class SplineFit(NamedTuple):
    """A spline through rows.

    spline : Spline of m components.
    steps : (n_step, m). Steps of the rows.
    misfit : RMS of spline minus rows, after removal of the steps.
    """

    spline: BSpline
    steps: Floats
    misfit: float


class _FitProblem(NamedTuple):
    """Least-squares problem of the fit.

    values : Matrix from coefficients (and steps, as last columns) to values at the data.
    rough : Matrix from coefficients to weighted derivatives.
    data : (n, m). The data.
    """

    values: csr_array
    rough: csr_array
    data: Floats

    def solve(self, log_weight: float) -> tuple[Floats, float]:
        """Return the coefficients for a weight of the roughness (log10), and the RMS misfit."""
        values, data = self.values, self.data
        weight_root = 10.0 ** (0.5 * log_weight)
        rough = weight_root * self.rough
        normal = csc_array(values.T @ values + rough.T @ rough)
        # The matrix is nearly singular if a step hardly differs from a bend of the spline.
        diagonal = diags_array(normal.diagonal())
        regular_matrix = csc_array(normal + 1e-14 * diagonal)
        factors = splu(regular_matrix)
        c = np.zeros((normal.shape[0], data.shape[1]))
        for _ in range(1 + _REFINEMENTS):
            residual = data - values @ c
            roughness = rough @ c
            gradient = values.T @ residual - rough.T @ roughness
            c += factors.solve(gradient)
        difference = values @ c - data
        misfit = np.sqrt(np.mean(difference**2))
        return c, float(misfit)


def fit(
    t: Floats, y: Floats, breaks: Sequence[float], degree: int, noise: float, steps: Sequence[float] = ()
) -> SplineFit:
    """Return the smoothest spline through rows, within their noise.

    The smoothest spline has the least integrated square of derivative degree - 1: for a velocity of degree 4 and a
    position of degree 5 this is the derivative of jerk.

    Parameters
    ----------
    t : (n,) s
        Times of the rows, rising.
    y : (n, m)
        Rows.
    breaks : sequence of float
        Times (s) within the rows, rising, at which derivatives of order degree - 3 and above may jump: force, for the
        degrees above.
    degree : int
        Degree of the spline.
    noise : float
        One sigma of a component of a row: RMS of spline minus rows. With 0 the spline passes through every row, as far
        as rows closer than 0.1 s allow.
    steps : sequence of float
        Times (s) after which the rows may have a constant offset, which the spline does not follow.
    """
    spans = [float(t[0]), *breaks, float(t[-1])]
    knots = _knots(t, spans, degree)
    problem = _fit_problem(t, y, knots, degree, steps)
    n_coefficient = len(knots) - degree - 1

    def solution(log_weight: float) -> SplineFit:
        c, misfit = problem.solve(log_weight)
        spline = BSpline(knots, c[:n_coefficient], degree)
        step_sizes = c[n_coefficient:]
        return SplineFit(spline, step_sizes, misfit)

    def excess_misfit(log_weight: float) -> float:
        _, misfit = problem.solve(log_weight)
        return misfit - noise

    exact = solution(_EXACT)
    if noise <= exact.misfit:
        return exact
    smoothest = solution(_SMOOTHEST)
    if smoothest.misfit <= noise:
        return smoothest
    return solution(float(brentq(excess_misfit, _EXACT, _SMOOTHEST, xtol=0.05)))


def _knots(t: Floats, spans: list[float], degree: int) -> Floats:
    """Return knots at the rows, at least `_CLOSEST` apart, and four at each break.

    t : (n,) s. Times of the rows.
    spans : s. Start, breaks and end.
    """
    inner: list[float] = []
    for number, (begin, end) in enumerate(pairwise(spans)):
        if number > 0:
            inner += [begin] * 4
        last = begin
        inner_times = t[(t > begin) & (t < end)]
        for time in inner_times:
            is_far = time - last > 0.99 * _CLOSEST and end - time > 0.5 * _CLOSEST
            if is_far:
                inner.append(float(time))
                last = float(time)
    first_knots = [spans[0]] * (degree + 1)
    last_knots = [spans[-1]] * (degree + 1)
    return np.array(first_knots + inner + last_knots)


def _fit_problem(t: Floats, y: Floats, knots: Floats, degree: int, steps: Sequence[float]) -> _FitProblem:
    """Return the least-squares problem; the weight of the roughness does not depend on the interval of the rows.

    t : (n,) s. Times of the rows.
    y : (n, m). Values of the rows.
    knots : s. Knots of the spline, of this degree.
    steps : s. Times at which the values may have a step.
    """
    values = csr_array(BSpline.design_matrix(t, knots, degree))
    interval = float(np.median(np.diff(t)))
    nodes, cell = _quadrature(knots)
    blocks = []
    for order, weight in ((degree - 1, 1.0), (degree - 2, _TIE)):
        interval_power = interval ** (2 * order - 1)
        scale = weight * np.sqrt(cell * interval_power)
        derivative = _derivative(knots, degree, order, nodes)
        blocks.append([diags_array(scale) @ derivative])
    rough = block_array(blocks)
    if steps:
        is_after = t[:, None] >= np.asarray(steps)
        step_values = csr_array(is_after.astype(float))
        no_roughness = csr_array((rough.shape[0], len(steps)))
        values = csr_array(block_array([[values, step_values]]))
        rough = block_array([[rough, no_roughness]])
    return _FitProblem(values=values, rough=csr_array(rough), data=y)


def _quadrature(knots: Floats) -> tuple[Floats, Floats]:
    """Return nodes and weights (n,) of the Gauss-Legendre quadrature of an integral between knots."""
    ends = np.unique(knots)
    half_length = 0.5 * np.diff(ends)[:, None]
    distance = half_length * (1.0 + _NODES)
    nodes = ends[:-1, None] + distance
    weights = half_length * _WEIGHTS
    return nodes.ravel(), weights.ravel()


def _derivative(knots: Floats, degree: int, order: int, t: Floats) -> csr_array:
    """Return the sparse matrix (n, n_basis) from coefficients to a derivative of the spline.

    order : order of the derivative
    t : (n,) s. Times within the intervals of the knots.
    """
    lower: csr_array | None = None
    for k in range(degree, degree - order, -1):
        size = len(knots) - k - 1
        span = knots[k + 1 : -1] - knots[1:size]
        coincident_slope = np.zeros_like(span)
        slope = np.divide(float(k), span, out=coincident_slope, where=span > 0.0)
        differences = diags_array([-slope, slope], offsets=[0, 1], shape=(size - 1, size))
        step = csr_array(differences)
        lower = step if lower is None else csr_array(step @ lower)
        knots = knots[1:-1]
    assert lower is not None
    basis = csr_array(BSpline.design_matrix(t, knots, degree - order))
    return csr_array(basis @ lower)


_SLOW, _FAST = 1.0, 20.0  # m/s; upright below, along the velocity above, blended between


def path_attitude(
    position: BSpline,
    edges: list[float],
    theta0: float,
    direction: Literal["thrust", "velocity"],
    roll: Roll,
    hold: float,
) -> BSpline:
    """Return the quaternion spline of a body that points along its thrust or its velocity.

    Parameters
    ----------
    position : BSpline
        Position (m, frame i).
    edges : (n + 1,) s
        Edges of its n parts.
    theta0 : float
        Earth angle at lift-off (rad).
    direction : {"thrust", "velocity"}
        Direction of the x axis.
    roll : Roll
    hold : float
        Time (s) at rest on the Earth before the first edge.

    Raises
    ------
    InputError
        The x axis should lie along a thrust, and no part has any.
    """
    times = [stretch_knots(begin, end) for begin, end in pairwise(edges)]
    t = join_samples(times)
    x = _along_force(position, times) if direction == "thrust" else _along_velocity(position, t, theta0)
    right_e = _right_direction(position, edges, theta0)
    if hold > 0.0:
        pad_t = pad_times(edges[0], hold)[:-1]
        first_theta = frames.earth_angle(theta0, edges[0])
        pad_theta = frames.earth_angle(theta0, pad_t)
        x_e = frames.ecef_from_eci(x[0], first_theta)
        pad_x = frames.eci_from_ecef(x_e, pad_theta)
        x = np.concatenate([pad_x, x])
        t = np.concatenate([pad_t, t])
    return ascent_attitude(t, x, right_e, theta0, roll)


def _along_force(position: BSpline, times: list[Floats]) -> Floats:
    """Return the directions (n, 3), frame i, of the specific force; in coasts a rotation from one thrust to the next.

    position : spline of position (m, frame i)
    times : s. Knots of each part.

    InputError if there is no thrust.
    """
    thrusts: list[BSpline | None] = []
    for t in times:
        inside = np.clip(t, t[0] + _EDGE, t[-1] - _EDGE)
        gravity = gravity_along(position(inside))
        force = position(inside, 2) - gravity
        size = np.linalg.norm(force, axis=1)
        is_powered = float(np.median(size)) > _COAST
        thrusts.append(make_interp_spline(t, frames.unit(force), k=5) if is_powered else None)
    if all(thrust is None for thrust in thrusts):
        raise InputError("there is no thrust to point along: give columns of attitude, or pointing: velocity")
    directions = thrust_directions(times, thrusts)
    for number, thrust in enumerate(thrusts):
        if thrust is not None:
            directions[number] = frames.unit(directions[number])
    return np.concatenate(directions)


def _along_velocity(position: BSpline, t: Floats, theta0: float) -> Floats:
    """Return the directions (n, 3), frame i, of the Earth-relative velocity, blended with the vertical at low speed.

    position : spline of position (m, frame i)
    t : (n,) s. Times.
    theta0 : rad. Earth angle at lift-off.
    """
    r = position(t)
    v = frames.earth_velocity(r, position(t, 1))
    speed = np.linalg.norm(v, axis=1)
    theta = frames.earth_angle(theta0, t)
    r_e = frames.ecef_from_eci(r, theta)
    latitude, longitude, _ = frames.geodetic_from_ecef(r_e)
    C_e_n = frames.rotation_e_n(latitude, longitude)
    up_e = -C_e_n[:, 2]
    up = frames.eci_from_ecef(up_e, theta)
    progress = smoothsteps((speed - _SLOW) / (_FAST - _SLOW))
    weight = progress[:, None]
    divisor = np.maximum(speed, _SLOW)[:, None]
    blend = (1.0 - weight) * up + weight * v / divisor
    return frames.unit(blend)


def _right_direction(position: BSpline, edges: list[float], theta0: float) -> Floats:
    """Return the unit vector (3,), frame e, to the right of the path; for a vertical path it points south."""
    first_t, last_t = edges[0], edges[-1]
    first_theta = frames.earth_angle(theta0, first_t)
    last_theta = frames.earth_angle(theta0, last_t)
    first = frames.ecef_from_eci(position(first_t), first_theta)
    last = frames.ecef_from_eci(position(last_t), last_theta)
    path = last - first
    latitude, longitude, _ = frames.geodetic_from_ecef(first)
    north, _, down = frames.rotation_e_n(latitude, longitude)
    right = np.cross(path, -down)
    length = float(np.linalg.norm(right))
    return np.asarray(right / length if length > 1.0 else -north)
