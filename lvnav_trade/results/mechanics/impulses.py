"""The least delta-v that corrects an injection error: impulses anywhere in one revolution, linear in the error.

Nulled are the errors of the orbit: angular momentum and eccentricity vector, which stand for semi-major axis,
eccentricity, perigee, inclination and node (five numbers). The place along the orbit is left as it is. The least sum
of impulses is the support function of the set of primers, {p: |B_k' p| <= 1 at every place k} (Lawden, Optimal
Trajectories for Space Navigation, 1963), so it is a norm of the error; it is found from both sides.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from lvnav_trade.kernels.earth import GM
from lvnav_trade.quantities.frames import unit
from lvnav_trade.quantities.records import Floats
from lvnav_trade.results.mechanics.orbits import osculating

# Places along the revolution where an impulse may be; between two of them 0.2 % are lost.
PLACES = 48
_ROUNDS = 400
_CHUNK = 1024
# Powers of the rounds: 1 is the plain rule, 2 in every round is faster and may lose the rank; one large step after some
# plain ones takes two thirds of the time of 1.5 in every round
_POWERS = (1, 1, 1, 6)
_FLOOR = 1e-9  # least part of the weight that a place keeps, so that what is solved stays regular


class Correction(NamedTuple):
    """Least delta-v (n,) in m/s, and a lower bound on it (n,)."""

    delta_v: Floats
    bound: Floats


def orbit_errors(r_i: ArrayLike, v_i: ArrayLike) -> Floats:
    """Return the matrix (5, 6) from an error of velocity and position (frame i) to that of the orbit, first order.

    Three rows: angular momentum over its size, along the position, 90 degrees ahead, and along itself; two: the
    eccentricity vector along the position and ahead.
    """
    r_i, v_i = np.asarray(r_i, dtype=float), np.asarray(v_i, dtype=float)
    eye = np.eye(3)
    h_i = np.cross(r_i, v_i)
    r = np.linalg.norm(r_i)
    turn = np.concatenate([np.cross(r_i, eye), np.cross(eye, v_i)]).T  # of h_i, by velocity and by position
    shift = np.concatenate([np.cross(eye, h_i), np.zeros((3, 3))]).T + np.cross(v_i, turn.T).T
    shift = shift / GM - np.concatenate([np.zeros((3, 3)), (eye - np.outer(r_i, r_i) / r**2) / r]).T
    towards, normal = unit(r_i), unit(h_i)
    axes = np.stack([towards, np.cross(normal, towards), normal])
    return np.concatenate([axes @ turn / np.linalg.norm(h_i), axes[:2] @ shift])


def control(r_i: ArrayLike, v_i: ArrayLike, places: int = PLACES) -> Floats:
    """Return the matrices (places, 5, 3): what an impulse there (radial, ahead, normal) changes of `orbit_errors`."""
    r_i, v_i = np.asarray(r_i, dtype=float), np.asarray(v_i, dtype=float)
    orbit = osculating(r_i, v_i)
    towards, normal = unit(r_i), unit(orbit.h_i)
    h = float(np.linalg.norm(orbit.h_i))
    ex, ey = float(orbit.e_i @ towards), float(orbit.e_i @ np.cross(normal, towards))
    angle = np.linspace(0.0, 2.0 * np.pi, places, endpoint=False)
    c, s = np.cos(angle), np.sin(angle)
    radius = h**2 / GM / (1.0 + ex * c + ey * s)
    zero = np.zeros(places)
    radial, along = np.stack([c, s, zero], axis=1), np.stack([-s, c, zero], axis=1)
    speed = GM / h * np.stack([-(s + ey), c + ex, zero], axis=1)
    found = np.empty((places, 5, 3))
    for k, push in enumerate((radial, along, np.broadcast_to([0.0, 0.0, 1.0], (places, 3)))):
        turn = radius[:, None] * np.cross(radial, push)
        shift = (np.cross(push, np.array([0.0, 0.0, h])) + np.cross(speed, turn)) / GM
        found[:, :3, k], found[:, 3:, k] = turn / h, shift[:, :2]
    return found


def least(error: ArrayLike, pushes: Floats, tolerance: float = 5e-3) -> Correction:
    """Return the least delta-v that nulls orbit errors (n, 5) with impulses of the matrices (m, 5, 3).

    Iteratively re-weighted least squares: impulses w_k B_k' p with p = (sum w B B')^-1 error are a solution, and p,
    scaled to a primer, is a bound from below. Rounds end where the two are within the tolerance of each other.
    """
    error = np.atleast_2d(np.asarray(error, dtype=float))
    parts = [_least(error[k : k + _CHUNK], pushes, tolerance) for k in range(0, len(error), _CHUNK)]
    return Correction(*(np.concatenate(values) for values in zip(*parts, strict=True)))


def _least(error: Floats, pushes: Floats, tolerance: float) -> Correction:
    m = len(pushes)
    flat = np.concatenate([pushes[:, :, axis] for axis in range(3)])
    squares = np.einsum("kij,klj->ilk", pushes, pushes).reshape(25, m)
    size = np.linalg.norm(error, axis=1)
    goal = (np.where(size[:, None] > 0.0, error, 1.0) / np.where(size > 0.0, size, 1.0)[:, None]).T
    weight = np.full((m, len(error)), 1.0 / m)  # errors are the last axis: every operation runs along it
    best, bound = np.full(len(error), np.inf), np.zeros(len(error))
    left = np.arange(len(error))
    for turn in range(_ROUNDS):
        primer = _solved((squares @ weight).reshape(5, 5, -1), goal)
        length = np.sqrt(np.sum(np.square(flat @ primer).reshape(3, m, -1), axis=0))
        top = length.max(axis=0)
        weight *= length
        best[left] = np.minimum(best[left], weight.sum(axis=0))
        bound[left] = np.maximum(bound[left], np.sum(primer * goal, axis=0) / top)
        far = best[left] - bound[left] > tolerance * best[left]
        left, goal, length, weight = left[far], goal[:, far], length[:, far] / top[far], weight[:, far]
        if not len(left):
            break
        if _POWERS[turn % len(_POWERS)] > 1:
            weight *= length ** (_POWERS[turn % len(_POWERS)] - 1)
        weight = weight / weight.sum(axis=0) + _FLOOR
    return Correction(size * best, size * bound)


def _solved(square: Floats, right: Floats) -> Floats:
    """Return x (k, n) of square x = right for symmetric definite matrices (k, k, n), which are overwritten."""
    x = right.copy()
    for i in range(len(x)):
        for j in range(i + 1, len(x)):
            part = square[i, j] / square[i, i]
            square[j, j:] -= part * square[i, j:]
            x[j] -= part * x[i]
    for i in reversed(range(len(x))):
        x[i] -= np.sum(square[i, i + 1 :] * x[i + 1 :], axis=0)
        x[i] /= square[i, i]
    return x


def least_at(r_i: ArrayLike, v_i: ArrayLike, error: ArrayLike) -> Correction:
    """Return the least delta-v for errors of velocity and position (n, 6), frame i, at a true state; NaN where the
    orbit is no ellipse that is flown round.
    """
    error = np.atleast_2d(np.asarray(error, dtype=float))
    if not bool(osculating(r_i, v_i).elliptic):
        return Correction(np.full(len(error), np.nan), np.full(len(error), np.nan))
    return least(error @ orbit_errors(r_i, v_i).T, control(r_i, v_i))
