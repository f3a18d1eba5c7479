"""The Earth's magnetic field by IGRF-14: spherical harmonics to degree 13, coefficients in `igrf14.txt`.

Alken et al., International Geomagnetic Reference Field: the thirteenth generation, Earth Planets Space 73:49 (2021),
equations 1 and 2; coefficients of the fourteenth: IAGA Division V-MOD, doi:10.5281/zenodo.14012302.
"""

import math
from datetime import UTC, datetime
from functools import lru_cache
from importlib.resources import files

import numpy as np

from lvnav_trade.quantities.records import Floats

DEGREE = 13
RADIUS = 6371.2e3
"""Reference radius of the expansion, m."""
TESLA = 1e-9
"""The coefficients are in nT."""


@lru_cache(maxsize=1)
def _table() -> tuple[Floats, Floats, Floats]:
    """Return years (n_year,) and coefficients g, h (14, 14, n_year) nT, by degree and order."""
    text = (files(__package__) / "igrf14.txt").read_text("utf-8")
    header, *records = [line for line in text.splitlines() if line[:1] != "#"]
    years = np.array(header.split(), dtype=float)
    shape = (DEGREE + 1, DEGREE + 1, years.size)
    g = np.zeros(shape)
    h = np.zeros(shape)
    for record in records:
        n, m, *values = record.split()
        degree = int(n)
        order = int(m)
        table = g if order >= 0 else h  # orders of h are negative in the file
        table[degree, abs(order)] = np.array(values, dtype=float)
    return years, g, h


def decimal_year(epoch: str) -> float:
    """Return the decimal year of an ISO 8601 time (UTC)."""
    moment = datetime.fromisoformat(epoch)
    moment = moment.replace(tzinfo=UTC) if moment.tzinfo is None else moment.astimezone(UTC)
    start = datetime(moment.year, 1, 1, tzinfo=UTC)
    end = datetime(moment.year + 1, 1, 1, tzinfo=UTC)
    fraction = (moment - start) / (end - start)
    return moment.year + fraction


def model_years() -> tuple[float, float]:
    """Return the first and the last year of the model."""
    years = _table()[0]
    return float(years[0]), float(years[-1])


def coefficients(year: float) -> tuple[Floats, Floats]:
    """Return the coefficients g, h (14, 14) nT at a decimal year, by degree and order.

    They are linear between the five-year epochs of the model. ValueError outside the years of the model.
    """
    years, g, h = _table()
    if not years[0] <= year <= years[-1]:
        raise ValueError(f"IGRF-14 is of {years[0]:g} to {years[-1]:g}, not of {year:.1f}")
    next_epoch = int(np.searchsorted(years, year))
    next_index = min(max(next_epoch, 1), years.size - 1)
    previous_index = next_index - 1
    interval = years[next_index] - years[previous_index]
    next_weight = (year - years[previous_index]) / interval
    previous_weight = 1.0 - next_weight
    g_now = previous_weight * g[..., previous_index] + next_weight * g[..., next_index]
    h_now = previous_weight * h[..., previous_index] + next_weight * h[..., next_index]
    return g_now, h_now


def field(r_e: Floats, year: float, degree: int = DEGREE) -> Floats:
    """Return the magnetic field (..., 3) T in frame e.

    Parameters
    ----------
    r_e : (..., 3) m, frame e
        Positions, not on the polar axis.
    year : float
        Decimal year.
    degree : int
        Largest degree of the expansion.

    Notes
    -----
    The field is -grad V with the potential V = a sum (a / r)^(n + 1) (g cos m lon + h sin m lon) P_n^m(cos colatitude).
    """
    g, h = coefficients(year)
    r_e = np.asarray(r_e, dtype=float)
    x = r_e[..., 0]
    y = r_e[..., 1]
    z = r_e[..., 2]
    distance = np.linalg.norm(r_e, axis=-1)
    axis_distance = np.hypot(x, y)
    cosine = z / distance
    sine = axis_distance / distance
    up = r_e / distance[..., None]
    eastern = np.stack([-y, x, np.zeros_like(axis_distance)], axis=-1)
    east = eastern / axis_distance[..., None]
    south = np.cross(east, up)
    longitude = np.arctan2(y.copy(), x.copy())  # contiguous, as in `frames.geodetic_from_ecef`
    P, dP = legendre(cosine, sine, degree)
    radial = np.zeros_like(distance)
    southward = np.zeros_like(distance)
    eastward = np.zeros_like(distance)
    for n in range(1, degree + 1):
        ratio_power = (RADIUS / distance) ** (n + 2)
        for m in range(n + 1):
            c = np.cos(m * longitude)
            s = np.sin(m * longitude)
            harmonic = g[n, m] * c + h[n, m] * s
            harmonic_slope = m * (g[n, m] * s - h[n, m] * c)  # minus its derivative by longitude
            radial += ratio_power * (n + 1) * harmonic * P[n][m]
            southward -= ratio_power * harmonic * dP[n][m]
            eastward += ratio_power * harmonic_slope * P[n][m] / sine
    nanotesla = radial[..., None] * up + southward[..., None] * south + eastward[..., None] * east
    return TESLA * nanotesla


def legendre(cosine: Floats, sine: Floats, degree: int) -> tuple[list[list[Floats]], list[list[Floats]]]:
    """Return Schmidt semi-normalised associated Legendre functions and their derivatives.

    Parameters
    ----------
    cosine, sine : (...,)
        Cosine and sine of the colatitude.
    degree : int
        Largest degree.

    Returns
    -------
    P, dP : list of list of (...,)
        Functions, and their derivatives with respect to the colatitude (rad), by degree and order.
    """
    P = [[np.ones_like(cosine)]]
    dP = [[np.zeros_like(cosine)]]
    for n in range(1, degree + 1):
        functions = []
        slopes = []
        previous = P[n - 1]
        previous_slopes = dP[n - 1]
        for m in range(n):
            # P_n^m = a cos P_(n-1)^m - b P_(n-2)^m, the last term for m up to n - 2 only
            difference = n * n - m * m
            a = (2 * n - 1) / math.sqrt(difference)
            function = a * cosine * previous[m]
            slope = a * (cosine * previous_slopes[m] - sine * previous[m])
            if m <= n - 2:
                previous_difference = (n - 1) ** 2 - m * m
                b = math.sqrt(previous_difference / difference)
                function = function - b * P[n - 2][m]
                slope = slope - b * dP[n - 2][m]
            functions.append(function)
            slopes.append(slope)
        # P_n^n = c sin P_(n-1)^(n-1)
        c = math.sqrt(1.0 - 1.0 / (2.0 * n)) if n > 1 else 1.0
        sectoral = previous[n - 1]
        sectoral_slope = previous_slopes[n - 1]
        functions.append(c * sine * sectoral)
        slopes.append(c * (sine * sectoral_slope + cosine * sectoral))
        P.append(functions)
        dP.append(slopes)
    return P, dP


def gradient(r_e: Floats, year: float, degree: int = DEGREE, step: float = 1e3) -> Floats:
    """Return the gradient of the field by position in frame e.

    Central differences over `step`, accurate to 1e-6 of the gradient.

    Parameters
    ----------
    r_e : (..., 3) m, frame e
        Positions, not on the polar axis.
    year : float
        Decimal year.
    degree : int
        Largest degree of the expansion.
    step : float
        Half the distance of the differences (m).

    Returns
    -------
    (..., 3, 3) T/m
        Rows: components of the field; columns: components of the position.
    """
    columns = []
    for axis in range(3):
        offset = step * np.eye(3)[axis]
        difference = field(r_e + offset, year, degree) - field(r_e - offset, year, degree)
        columns.append(difference / (2.0 * step))
    return np.stack(columns, axis=-1)
