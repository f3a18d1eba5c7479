"""A corridor on the ground, and the probability that a Gaussian point lies in it."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import special

from lvnav_trade.kernels.earth import ECCENTRICITY_2, SEMI_MAJOR
from lvnav_trade.metrics.basics.select import number_in
from lvnav_trade.records import Floats
from lvnav_trade.store import Tables


class Corridor(NamedTuple):
    """corners (m, 2): latitude and longitude in rad, longitudes unwrapped; the probability and confidence asked for."""

    corners: Floats
    probability: float
    confidence: float


def corridor_of(tables: Tables) -> Corridor | None:
    """Return the campaign's corridor; None where it names none."""
    card: dict[str, Any] | None = tables.campaign.get("corridor")
    if not card:
        return None
    corners = np.array([[number_in(value, "rad") for value in corner] for corner in card["polygon"]])
    corners[:, 1] = np.unwrap(corners[:, 1])  # an edge goes the short way round
    return Corridor(corners, float(card.get("probability", 0.999)), float(card.get("confidence", 0.9)))


def beside(longitude: ArrayLike, corners: Floats) -> Floats:
    """Return longitudes (...,) in rad in the turn in which the corridor lies."""
    middle = 0.5 * (corners[:, 1].min() + corners[:, 1].max())
    return np.asarray(longitude + 2.0 * np.pi * np.round((middle - np.asarray(longitude)) / (2.0 * np.pi)))


def metres(latitude: float) -> Floats:
    """Return metres per radian of latitude and of longitude on the ellipsoid (2,)."""
    w2 = 1.0 - ECCENTRICITY_2 * np.sin(latitude) ** 2
    return np.array([SEMI_MAJOR * (1.0 - ECCENTRICITY_2) / w2**1.5, SEMI_MAJOR * np.cos(latitude) / np.sqrt(w2)])


def probability(polygon: ArrayLike, mean: ArrayLike, covariance: ArrayLike) -> tuple[float, float]:
    """Return the probability that a Gaussian point lies in a polygon (m, 2), and its margin in sigmas.

    mean (2,), covariance (2, 2) in the polygon's unit. The margin is the Mahalanobis distance from the mean to the
    nearest edge, negative outside. In the whitened plane the probability is the winding number less, edge by edge, two
    values of Owen's T function (Annals of Mathematical Statistics 27, 1956): exact, far tails too.
    """
    root = np.linalg.cholesky(np.asarray(covariance, dtype=float))
    start = np.linalg.solve(root, (np.asarray(polygon, dtype=float) - np.asarray(mean, dtype=float)).T).T
    end = np.roll(start, -1, axis=0)
    length = np.linalg.norm(end - start, axis=1)
    start, end, length = start[length > 0.0], end[length > 0.0], length[length > 0.0]
    along = (end - start) / length[:, None]
    away = start[:, 0] * along[:, 1] - start[:, 1] * along[:, 0]  # signed distance of the edge's line
    first, last = np.sum(start * along, axis=1), np.sum(end * along, axis=1)
    off = away != 0.0
    h, sign = np.abs(away[off]), np.sign(away[off])
    a, b = first[off] / h, last[off] / h
    winding = float(np.sum(sign * (np.arctan(b) - np.arctan(a)) / (2.0 * np.pi)))
    outside = float(np.sum(sign * (special.owens_t(h, b) - special.owens_t(h, a))))
    around = np.sign(np.sum(start[:, 0] * end[:, 1] - start[:, 1] * end[:, 0]))
    margin = float(np.hypot(np.clip(0.0, first, last), away).min())
    inside = around * (winding - outside)
    return float(np.clip(inside, 0.0, 1.0)), margin if around * winding > 0.5 else -margin


def contains(polygon: ArrayLike, points: ArrayLike) -> NDArray[np.bool_]:
    """Return which points (n, 2) lie in a polygon (m, 2): a ray from each crosses an odd number of edges."""
    start, points = np.asarray(polygon, dtype=float), np.asarray(points, dtype=float)
    end = np.roll(start, -1, axis=0)
    x, y = points[:, :1], points[:, 1:]
    crosses = (start[:, 1] > y) != (end[:, 1] > y)
    with np.errstate(divide="ignore", invalid="ignore"):
        where = start[:, 0] + (y - start[:, 1]) / (end[:, 1] - start[:, 1]) * (end[:, 0] - start[:, 0])
    return np.asarray(np.sum(crosses & (x < where), axis=1) % 2 == 1)
