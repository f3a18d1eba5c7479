"""A great circle on the sphere of ellipsoid normals, the ground track of a rebuilt ascent."""

import math

import numpy as np

from lvnav_trade.kernels.earth import ECCENTRICITY_2, SEMI_MAJOR
from lvnav_trade.quantities.frames import rotation_e_n
from lvnav_trade.quantities.records import Floats
from lvnav_trade.trajectory.ascent.legs import site_axes
from lvnav_trade.trajectory.ascent.vehicle_cards import Site


def circle_coordinates(site: Site, azimuth: float, psi: Floats, height: Floats) -> tuple[Floats, Floats, Floats]:
    """Return latitude and longitude (n,) rad along the circle, and its derivatives north and east (n, 2) m/rad.

    psi : (n,) rad. Angles from the site.
    height : (n,) m. Heights.
    """
    circle_azimuth = _circle_azimuth(site, azimuth)
    up, downrange, _ = site_axes(site, circle_azimuth)
    cosine_psi = np.cos(psi)[:, None]
    sine_psi = np.sin(psi)[:, None]
    normal = cosine_psi * up + sine_psi * downrange
    tangent = cosine_psi * downrange - sine_psi * up
    x = normal[:, 0].copy()
    y = normal[:, 1].copy()
    z = normal[:, 2].copy()
    latitude = np.arcsin(z)
    longitude = np.arctan2(y, x)
    C_e_n = rotation_e_n(latitude, longitude)
    north, east, _ = np.einsum("kij,kj->ik", C_e_n, tangent)
    # Radii of curvature in the prime vertical and in the meridian
    root = np.sqrt(1.0 - ECCENTRICITY_2 * z**2)
    vertical_radius = SEMI_MAJOR / root
    meridian_radius = vertical_radius**3 * (1.0 - ECCENTRICITY_2) / SEMI_MAJOR**2
    north_derivative = (meridian_radius + height) * north
    east_derivative = (vertical_radius + height) * east
    derivatives = np.stack([north_derivative, east_derivative], axis=1)
    return latitude, longitude, derivatives


def _circle_azimuth(site: Site, azimuth: float) -> float:
    """Return the azimuth (rad) on the sphere of normals for an azimuth on the ellipsoid.

    They differ by the ratio of the radii of curvature, of the meridian over the prime vertical.
    """
    sine = math.sin(site.latitude)
    ratio = (1.0 - ECCENTRICITY_2) / (1.0 - ECCENTRICITY_2 * sine * sine)
    east = ratio * math.sin(azimuth)
    north = math.cos(azimuth)
    return math.atan2(east, north)
