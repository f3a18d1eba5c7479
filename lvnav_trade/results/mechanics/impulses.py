"""Least delta-v that corrects an injection error: impulses anywhere in one revolution, linear in the error.

The impulses null the errors of the orbit, which are those of angular momentum and eccentricity vector. These five
numbers determine semi-major axis, eccentricity, perigee, inclination and node. The position along the orbit is not
corrected.

The least sum of impulses is the support function of the set of primers, {p: |B_k' p| <= 1 at every position k} (Lawden,
Optimal Trajectories for Space Navigation, 1963). It is therefore a norm of the error, and is bounded from both sides.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from lvnav_trade.kernels.earth import GM
from lvnav_trade.quantities.frames import unit
from lvnav_trade.quantities.records import Floats
from lvnav_trade.results.mechanics.orbits import osculating

# Positions along the revolution where an impulse may act; the spacing costs 0.2 % of delta-v.
PLACES = 48
_ROUNDS = 400
_CHUNK = 1024
# Powers of the rounds: 1 is the plain rule, 2 in every round is faster and may lose the rank. A large step after some
# plain steps takes two thirds of the time of 1.5 in every round.
_POWERS = (1, 1, 1, 6)
_FLOOR = 1e-9  # smallest weight of a position, which keeps the equations regular


class Correction(NamedTuple):
    """Least delta-v and a lower bound on it.

    delta_v : (n,), m/s. Sum of the impulses of the best solution.
    bound : (n,), m/s. Lower bound on the least sum.
    """

    delta_v: Floats
    bound: Floats


def orbit_errors(r_i: ArrayLike, v_i: ArrayLike) -> Floats:
    """Return the matrix that maps a state error to the error of the orbit, to first order.

    Parameters
    ----------
    r_i, v_i : (3,) array
        True position (m) and velocity (m/s), frame i.

    Returns
    -------
    (5, 6) array
        Columns: velocity (m/s), position (m), frame i. Rows 0 to 2: error of the angular momentum over its magnitude,
        along the position, 90 degrees ahead of it, and along the angular momentum itself. Rows 3, 4: error of the
        eccentricity vector along the position and 90 degrees ahead.
    """
    r_i = np.asarray(r_i, dtype=float)
    v_i = np.asarray(v_i, dtype=float)
    r = np.linalg.norm(r_i)
    h_i = np.cross(r_i, v_i)
    h = np.linalg.norm(h_i)
    identity = np.eye(3)
    zero = np.zeros((3, 3))

    # h = r x v. Derivatives have the columns velocity, position.
    momentum_by_velocity = np.cross(r_i, identity)
    momentum_by_position = np.cross(identity, v_i)
    momentum_slope = np.concatenate([momentum_by_velocity, momentum_by_position]).T
    # e = v x h / GM - r / |r|
    cross_slope = np.concatenate([np.cross(identity, h_i), zero]).T
    cross_slope = cross_slope + np.cross(v_i, momentum_slope.T).T
    direction_by_position = (identity - np.outer(r_i, r_i) / r**2) / r
    direction_slope = np.concatenate([zero, direction_by_position]).T
    eccentricity_slope = cross_slope / GM - direction_slope

    towards = unit(r_i)
    normal = unit(h_i)
    ahead = np.cross(normal, towards)
    axes = np.stack([towards, ahead, normal])
    momentum_rows = axes @ momentum_slope / h
    eccentricity_rows = axes[:2] @ eccentricity_slope
    return np.concatenate([momentum_rows, eccentricity_rows])


def control(r_i: ArrayLike, v_i: ArrayLike, n_position: int = PLACES) -> Floats:
    """Return the effect of an impulse on the error of the orbit, at positions along one revolution.

    Parameters
    ----------
    r_i, v_i : (3,) array
        Position (m) and velocity (m/s), frame i.
    n_position : int
        Number of positions, evenly spaced.

    Returns
    -------
    (places, 5, 3) array
        Change of `orbit_errors` per m/s of an impulse; columns: radial, ahead, normal.
    """
    r_i = np.asarray(r_i, dtype=float)
    v_i = np.asarray(v_i, dtype=float)
    orbit = osculating(r_i, v_i)
    h = float(np.linalg.norm(orbit.h_i))
    towards = unit(r_i)
    normal = unit(orbit.h_i)
    transverse = np.cross(normal, towards)
    ex = float(orbit.e_i @ towards)
    ey = float(orbit.e_i @ transverse)

    # Axes of the orbital plane: towards the position, ahead, normal
    angle = np.linspace(0.0, 2.0 * np.pi, n_position, endpoint=False)
    c = np.cos(angle)
    s = np.sin(angle)
    zero = np.zeros(n_position)
    radius = h**2 / GM / (1.0 + ex * c + ey * s)
    hodograph = np.stack([-(s + ey), c + ex, zero], axis=1)
    velocity = GM / h * hodograph
    radial = np.stack([c, s, zero], axis=1)
    ahead = np.stack([-s, c, zero], axis=1)
    normals = np.broadcast_to([0.0, 0.0, 1.0], (n_position, 3))
    momentum = np.array([0.0, 0.0, h])

    effect = np.empty((n_position, 5, 3))
    for k, impulse in enumerate((radial, ahead, normals)):
        # dh = r x dv and de = (dv x h + v x dh) / GM
        momentum_change = radius[:, None] * np.cross(radial, impulse)
        cross_change = np.cross(impulse, momentum) + np.cross(velocity, momentum_change)
        eccentricity_change = cross_change / GM
        effect[:, :3, k] = momentum_change / h
        effect[:, 3:, k] = eccentricity_change[:, :2]
    return effect


def least_correction(error: ArrayLike, impulse_effects: Floats, tolerance: float = 5e-3) -> Correction:
    """Return the least delta-v that nulls errors of the orbit.

    Parameters
    ----------
    error : (n, 5) array
        Errors of the orbit, as `orbit_errors`.
    impulse_effects : (m, 5, 3) array
        Effects B_k of an impulse at each position, as `control`.
    tolerance : float
        Largest relative difference of delta-v and bound at which the iteration ends.

    Returns
    -------
    Correction
        Delta-v and bound (n,), m/s.

    Notes
    -----
    Iteratively reweighted least squares. With weights w_k and p = (sum w_k B_k B_k')^-1 error, the impulses w_k B_k' p
    are a solution. The vector p, scaled so that max |B_k' p| = 1, is a primer and gives the lower bound p' error.
    """
    error = np.atleast_2d(np.asarray(error, dtype=float))
    corrections = []
    for k in range(0, len(error), _CHUNK):
        chunk = error[k : k + _CHUNK]
        corrections.append(_iterate(chunk, impulse_effects, tolerance))
    return Correction(
        delta_v=np.concatenate([correction.delta_v for correction in corrections]),
        bound=np.concatenate([correction.bound for correction in corrections]),
    )


def _iterate(error: Floats, impulse_effects: Floats, tolerance: float) -> Correction:
    """Return the solutions of `least_correction` for errors (n, 5).

    Errors that have converged are dropped from the iteration.

    Parameters
    ----------
    error : (n, 5) array
        Errors of the orbit, as `orbit_errors`.
    impulse_effects : (m, 5, 3) array
        Effects B_k of an impulse at each position, as `control`.
    tolerance : float
        Largest relative difference of delta-v and bound at which the iteration ends.
    """
    n = len(error)
    m = len(impulse_effects)
    effects_by_axis = np.concatenate([impulse_effects[:, :, axis] for axis in range(3)])  # (3 m, 5)
    products = np.einsum("kij,klj->ilk", impulse_effects, impulse_effects)
    squares = products.reshape(25, m)  # B_k B_k'

    # The problem scales with the error: unit errors are solved.
    size = np.linalg.norm(error, axis=1)
    is_nonzero = size > 0.0
    nonzero_error = np.where(is_nonzero[:, None], error, 1.0)
    nonzero_size = np.where(is_nonzero, size, 1.0)
    unit_errors = (nonzero_error / nonzero_size[:, None]).T

    weight = np.full((m, n), 1.0 / m)  # errors are the last axis: every operation runs along it
    best = np.full(n, np.inf)
    bound = np.zeros(n)
    active = np.arange(n)
    for k in range(_ROUNDS):
        weighted_squares = (squares @ weight).reshape(5, 5, -1)
        primer = _solve(weighted_squares, unit_errors)
        component_squares = np.square(effects_by_axis @ primer).reshape(3, m, -1)
        length = np.sqrt(np.sum(component_squares, axis=0))  # |B_k' p|
        top = length.max(axis=0)
        weight *= length  # magnitudes of the impulses w_k B_k' p
        delta_v = weight.sum(axis=0)
        lower_bound = np.sum(primer * unit_errors, axis=0) / top
        best[active] = np.minimum(best[active], delta_v)
        bound[active] = np.maximum(bound[active], lower_bound)

        gap = best[active] - bound[active]
        is_unconverged = gap > tolerance * best[active]
        active = active[is_unconverged]
        if not len(active):
            break
        unit_errors = unit_errors[:, is_unconverged]
        weight = weight[:, is_unconverged]
        power = _POWERS[k % len(_POWERS)]
        if power > 1:
            relative_length = length[:, is_unconverged] / top[is_unconverged]
            weight *= relative_length ** (power - 1)
        weight = weight / weight.sum(axis=0) + _FLOOR
    return Correction(size * best, size * bound)


def _solve(matrices: Floats, right_sides: Floats) -> Floats:
    """Return the solutions of systems of equations, by elimination without pivoting.

    Parameters
    ----------
    matrices : (k, k, n) array
        Symmetric positive definite matrices, which are overwritten.
    right_sides : (k, n) array
        Right-hand sides.

    Returns
    -------
    (k, n) array
        Solutions.
    """
    x = right_sides.copy()
    for i in range(len(x)):
        for j in range(i + 1, len(x)):
            factor = matrices[i, j] / matrices[i, i]
            matrices[j, j:] -= factor * matrices[i, j:]
            x[j] -= factor * x[i]
    for i in reversed(range(len(x))):
        terms = matrices[i, i + 1 :] * x[i + 1 :]
        x[i] -= np.sum(terms, axis=0)
        x[i] /= matrices[i, i]
    return x


def least_state_correction(r_i: ArrayLike, v_i: ArrayLike, error: ArrayLike) -> Correction:
    """Return the least delta-v that corrects state errors.

    Parameters
    ----------
    r_i, v_i : (3,) array
        True position (m) and velocity (m/s), frame i.
    error : (n, 6) array
        Errors of velocity (m/s) and position (m), frame i.

    Returns
    -------
    Correction
        Delta-v and bound (n,), m/s; NaN unless the orbit is an ellipse suited to averaging (`OrbitVectors.elliptic`).
    """
    error = np.atleast_2d(np.asarray(error, dtype=float))
    if not bool(osculating(r_i, v_i).elliptic):
        nan_values = np.full(len(error), np.nan)
        return Correction(nan_values, nan_values)
    return least_correction(error @ orbit_errors(r_i, v_i).T, control(r_i, v_i))
