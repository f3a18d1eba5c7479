"""Corridor of the impact point on the ground: geometry, probability and the runs outside."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy import special

from lvnav_trade.kernels.earth import ECCENTRICITY_2, SEMI_MAJOR
from lvnav_trade.quantities.records import Bools, Floats
from lvnav_trade.results.mechanics import free_fall, stored_states
from lvnav_trade.results.mechanics.stored_states import State
from lvnav_trade.results.statistics.case_results import parse_number
from lvnav_trade.results.tables.read import Tables


class Corridor(NamedTuple):
    """Corridor on the ground within which the impact point must remain.

    corners : (m, 2), rad. Latitude and longitude, longitudes unwrapped.
    probability : Required probability.
    confidence : Confidence required of the runs.
    """

    corners: Floats
    probability: float
    confidence: float


def corridor_of(tables: Tables) -> Corridor | None:
    """Return the corridor of a campaign; None if it has none."""
    card: dict[str, Any] | None = tables.campaign.get("corridor")
    if not card:
        return None
    corners = np.array([[parse_number(value, "rad") for value in corner] for corner in card["polygon"]])
    corners[:, 1] = np.unwrap(corners[:, 1])  # an edge takes the shorter way around the Earth
    return Corridor(
        corners=corners,
        probability=float(card.get("probability", 0.999)),
        confidence=float(card.get("confidence", 0.9)),
    )


def unwrapped_longitude(longitude: ArrayLike, corners: Floats) -> Floats:
    """Return longitudes (...,) in rad, shifted by full turns to the range of the corridor.

    Parameters
    ----------
    longitude : (...,) array
        Longitude (rad).
    corners : (m, 2) array
        Corners of the corridor, latitude and unwrapped longitude (rad).
    """
    middle = 0.5 * (corners[:, 1].min() + corners[:, 1].max())
    turns = np.round((middle - np.asarray(longitude)) / (2.0 * np.pi))
    return np.asarray(longitude + 2.0 * np.pi * turns)


def metres(latitude: float) -> Floats:
    """Return metres per radian of latitude and of longitude on the ellipsoid, (2,).

    Parameters
    ----------
    latitude : float
        Geodetic latitude (rad).
    """
    w2 = 1.0 - ECCENTRICITY_2 * np.sin(latitude) ** 2
    meridian_radius = SEMI_MAJOR * (1.0 - ECCENTRICITY_2) / w2**1.5
    parallel_radius = SEMI_MAJOR * np.cos(latitude) / np.sqrt(w2)
    return np.array([meridian_radius, parallel_radius])


def probability(polygon: ArrayLike, mean: ArrayLike, covariance: ArrayLike) -> tuple[float, float]:
    """Return the probability that a Gaussian point lies in a polygon, and the margin of its mean.

    Parameters
    ----------
    polygon : (m, 2) array
        Corners.
    mean : (2,) array
        Mean, in the unit of the polygon.
    covariance : (2, 2) array
        Covariance, in its square.

    Returns
    -------
    probability : float
        Exact also in the far tails. In the whitened plane it is the winding number less two values of Owen's T function
        for each edge (Annals of Mathematical Statistics 27, 1956).
    margin : float
        Mahalanobis distance (sigmas) from the mean to the nearest edge; negative outside.
    """
    corners = np.asarray(polygon, dtype=float)
    centre = np.asarray(mean, dtype=float)
    # Corners in the whitened plane, where the point is a standard Gaussian
    root = np.linalg.cholesky(np.asarray(covariance, dtype=float))
    offset = corners - centre
    start = np.linalg.solve(root, offset.T).T
    end = np.roll(start, -1, axis=0)
    edge = end - start
    length = np.linalg.norm(edge, axis=1)
    is_edge = length > 0.0
    start = start[is_edge]
    end = end[is_edge]

    # Edges by the signed distance of their line from the mean, and the positions of their ends along it
    edge_length = length[is_edge][:, None]
    along = (end - start) / edge_length
    distance = _cross(start, along)
    first = np.sum(start * along, axis=1)
    last = np.sum(end * along, axis=1)

    is_off_mean = distance != 0.0
    h = np.abs(distance[is_off_mean])
    sign = np.sign(distance[is_off_mean])
    a = first[is_off_mean] / h
    b = last[is_off_mean] / h
    angle = np.arctan(b) - np.arctan(a)
    turns = angle / (2.0 * np.pi)
    winding = float(np.sum(sign * turns))
    tail = special.owens_t(h, b) - special.owens_t(h, a)
    outside = float(np.sum(sign * tail))

    twice_area = np.sum(_cross(start, end))
    orientation = np.sign(twice_area)
    signed_probability = orientation * (winding - outside)
    inside = float(np.clip(signed_probability, 0.0, 1.0))
    beyond_end = np.clip(0.0, first, last)
    margin = float(np.hypot(beyond_end, distance).min())
    if orientation * winding > 0.5:
        return inside, margin
    return inside, -margin


def _cross(first: Floats, second: Floats) -> Floats:
    """Return the cross products (n,) of vectors (n, 2) in a plane."""
    return first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]


def contains(polygon: ArrayLike, points: ArrayLike) -> Bools:
    """Return which points lie in a polygon: a ray from such a point crosses an odd number of edges.

    Parameters
    ----------
    polygon : (m, 2) array
        Corners.
    points : (n, 2) array
        Points, in the unit of the corners.

    Returns
    -------
    (n,) array of bool
        Whether each point is inside.
    """
    start = np.asarray(polygon, dtype=float)
    end = np.roll(start, -1, axis=0)
    points = np.asarray(points, dtype=float)
    x = points[:, :1]
    y = points[:, 1:]
    start_x = start[:, 0]
    start_y = start[:, 1]
    end_x = end[:, 0]
    end_y = end[:, 1]
    is_crossed = (start_y > y) != (end_y > y)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = (y - start_y) / (end_y - start_y)
        crossing_x = start_x + share * (end_x - start_x)
    is_on_ray = x < crossing_x
    crossings = np.sum(is_crossed & is_on_ray, axis=1)
    return np.asarray(crossings % 2 == 1)


def outside_runs(tables: Tables, case: str, corridor: Corridor) -> tuple[int, int]:
    """Return the number of runs that failed or were outside the corridor at an event, and the number of all runs.

    Parameters
    ----------
    tables : Tables
        Tables of the results.
    case : str
        Digest of the case.
    corridor : Corridor
        The corridor.
    """
    failures = []
    for state in stored_states.states(tables, case):
        if state.event:
            error, has_failed = stored_states.run_errors(tables, case, state)
            failures.append(has_failed | outside_corridor(state, error, corridor))
    if not failures:
        return 0, 0
    return int(np.any(failures, axis=0).sum()), len(failures[0])


def outside_corridor(state: State, error: Floats, corridor: Corridor) -> Bools:
    """Return which estimated points are outside the corridor.

    Parameters
    ----------
    state : State
        True state.
    error : (n, 6) array
        Errors of velocity (m/s) and position (m), frame i.
    corridor : Corridor
        The corridor.

    Returns
    -------
    (n,) array of bool
        False for errors that are not finite; all False if the true state has no impact point.
    """
    is_outside = np.zeros(len(error), dtype=bool)
    is_finite = np.isfinite(error).all(axis=1)
    if not is_finite.any():
        return is_outside
    true = free_fall.impact(state.r_i, state.v_i, state.earth_angle)
    if not np.isfinite(true.fall[0]):
        return is_outside
    estimated_impact = free_fall.impact(
        state.r_i - error[is_finite, 3:],
        state.v_i - error[is_finite, :3],
        state.earth_angle,
        lowest=0.0,
    )
    longitude = unwrapped_longitude(estimated_impact.longitude, corridor.corners)
    points = np.stack([estimated_impact.latitude, longitude], axis=1)
    is_outside[is_finite] = ~contains(corridor.corners, points)
    return is_outside


def probability_inside(
    corridor: Corridor,
    point: free_fall.Impact,
    covariance: Floats,
    bias: Floats,
) -> tuple[float, float]:
    """Return the probability that the estimated point is in the corridor, and the margin, as `probability`.

    Parameters
    ----------
    corridor : Corridor
        The corridor.
    point : free_fall.Impact
        True impact point.
    covariance : (2, 2) array
        Covariance (km^2) of the error, down-range and cross-range.
    bias : (2,) array
        Mean (km) of the error, down-range and cross-range.

    Returns
    -------
    float, float
        Probability; margin in sigmas, negative if the mean point is outside.

    Notes
    -----
    The estimated point is the true point minus the error. Edges of the corridor are straight lines in latitude and
    longitude.
    """
    c = np.cos(point.heading)
    s = np.sin(point.heading)
    rotation = np.array([[c, -s], [s, c]])
    true_point = np.array([point.latitude, unwrapped_longitude(point.longitude, corridor.corners)])
    corners_km = (corridor.corners - true_point) * metres(float(point.latitude)) * 1e-3
    regular = 1e-12 * np.eye(2)  # a millimetre, so that the matrix is regular
    return probability(corners_km, -rotation @ bias, rotation @ covariance @ rotation.T + regular)
