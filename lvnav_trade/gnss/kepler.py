"""Satellites on Keplerian orbits with secular rates: positions, velocities and clocks in Earth-fixed axes."""

import math
from typing import NamedTuple

import numpy as np

from lvnav_trade.quantities.records import Floats

# Values prescribed by the GPS user algorithm (IS-GPS-200, table 20-IV); they differ from WGS-84 in the last digits.
GM_GPS = 3.986005e14  # m^3/s^2
EARTH_RATE_GPS = 7.2921151467e-5  # rad/s
RELATIVITY_GPS = -4.442807633e-10  # s/m^0.5: -2 sqrt(GM) / c^2
# CGCS2000 in the BeiDou user algorithm (BDS-SIS-ICD B1I 3.0, section 3.2 and table 5-11).
GM_BEIDOU = 3.986004418e14  # m^3/s^2
EARTH_RATE_BEIDOU = 7.2921150e-5  # rad/s
RELATIVITY_BEIDOU = -4.442807309e-10  # s/m^0.5: -2 sqrt(GM) / c^2


class Orbits(NamedTuple):
    """Keplerian elements of all satellites at a reference time, SI and radians.

    The reference time is lift-off, because seconds since a distant epoch would round positions by a millimetre.
    """

    names: tuple[str, ...]  # (n_sat,), names of the satellites
    semi_major_axis: Floats  # (n_sat,) m
    eccentricity: Floats  # (n_sat,)
    inclination: Floats  # (n_sat,) rad
    node: Floats  # (n_sat,) rad, counted from Greenwich at the reference time
    node_rate: Floats  # (n_sat,) rad/s, relative to inertial space
    perigee: Floats  # (n_sat,) rad, argument of perigee
    mean_anomaly: Floats  # (n_sat,) rad, at the reference time
    mean_motion: Floats  # (n_sat,) rad/s
    clock_bias: Floats  # (n_sat,) s
    clock_drift: Floats  # (n_sat,) s/s
    systems: tuple[str, ...]  # (n_sat,), letter of the system
    relativity_factor: float = RELATIVITY_GPS  # s/m^0.5, factor of the relativistic clock term

    def ecef(self, t: Floats | float) -> tuple[Floats, Floats]:
        """Return position (m) and Earth-relative velocity (m/s), (..., n_sat, 3) each, in the Earth-fixed axes of t.

        The user algorithm of IS-GPS-200, table 20-IV, with the terms of an almanac (no harmonic corrections), and its
        derivative.

        t : (..., n_sat) or (..., 1) s since the reference time of the elements.
        """
        a = self.semi_major_axis
        e = self.eccentricity
        mean_anomaly = self.mean_anomaly + self.mean_motion * t
        anomaly = eccentric_anomaly(mean_anomaly, e)
        cos_e = np.cos(anomaly)
        sin_e = np.sin(anomaly)
        root = np.sqrt(1.0 - e * e)
        speed = a * self.mean_motion / (1.0 - e * cos_e)
        # first axis towards perigee, then rotated to the ascending node
        to_perigee = a * (cos_e - e)
        across = a * root * sin_e
        to_perigee_rate = -speed * sin_e
        across_rate = speed * root * cos_e
        perifocal = np.stack([to_perigee, across])
        perifocal_rate = np.stack([to_perigee_rate, across_rate])
        cos_w = np.cos(self.perigee)
        sin_w = np.sin(self.perigee)
        rotation = np.array([[cos_w, -sin_w], [sin_w, cos_w]])
        flat = np.einsum("ijs,j...s->i...s", rotation, perifocal)
        flat_rate = np.einsum("ijs,j...s->i...s", rotation, perifocal_rate)
        node_rate = self.node_rate - EARTH_RATE_GPS
        node = self.node + node_rate * t
        return earth_fixed(flat, flat_rate, node, node_rate, self.inclination)

    def clock(self, t: Floats) -> Floats:
        """Return the clock offsets from system time by polynomial, (..., n_sat) s, without the relativistic term."""
        return np.asarray(self.clock_bias + self.clock_drift * t)

    def relativity(self, t: Floats) -> Floats:
        """Return the relativistic clock term F e sqrt(A) sin E, (..., n_sat) s (IS-GPS-200, 20.3.3.3.3.1)."""
        e = self.eccentricity
        mean_anomaly = self.mean_anomaly + self.mean_motion * t
        anomaly = eccentric_anomaly(mean_anomaly, e)
        root_axis = np.sqrt(self.semi_major_axis)
        return np.asarray(self.relativity_factor * e * root_axis * np.sin(anomaly))


def earth_fixed(
    flat: Floats, flat_rate: Floats, node: Floats, node_rate: Floats, inclination: Floats, tilting: Floats | float = 0.0
) -> tuple[Floats, Floats]:
    """Return position (m) and Earth-relative velocity (m/s), (..., n_sat, 3) each, in the Earth-fixed axes of the time.

    Parameters
    ----------
    flat, flat_rate : (2, ..., n_sat) m, m/s
        Position and velocity in the orbital plane, first axis towards the ascending node.
    node, node_rate : (..., n_sat) rad, rad/s
        Longitude of the ascending node, and its rate relative to the Earth.
    inclination, tilting : (..., n_sat) rad, rad/s
        Inclination and its rate.
    """
    x, y = flat
    vx, vy = flat_rate
    cos_n = np.cos(node)
    sin_n = np.sin(node)
    cos_i = np.cos(inclination)
    sin_i = np.sin(inclination)
    # in the equator, across the line of nodes
    across = y * cos_i
    across_rate = vy * cos_i - y * sin_i * tilting
    r_x = x * cos_n - across * sin_n
    r_y = x * sin_n + across * cos_n
    r_z = y * sin_i
    r_e = np.stack([r_x, r_y, r_z], axis=-1)
    v_x = vx * cos_n - across_rate * sin_n - node_rate * r_y
    v_y = vx * sin_n + across_rate * cos_n + node_rate * r_x
    v_z = vy * sin_i + y * cos_i * tilting
    v_e = np.stack([v_x, v_y, v_z], axis=-1)
    return r_e, v_e


def eccentric_anomaly(mean_anomaly: Floats, eccentricity: Floats) -> Floats:
    """Return the eccentric anomaly (rad) by Newton's method, to rounding; arguments broadcast.

    The initial value E = M + 0.85 e sign(sin M) converges for every eccentricity below 1 (Danby and Burkardt, 1983).
    """
    mean = np.mod(mean_anomaly, 2.0 * math.pi)
    half_of_orbit = np.sign(np.sin(mean))
    anomaly = mean + 0.85 * eccentricity * half_of_orbit
    for _ in range(30):
        # Kepler's equation: M = E - e sin E
        residual = mean - anomaly + eccentricity * np.sin(anomaly)
        slope = 1.0 - eccentricity * np.cos(anomaly)
        step = residual / slope
        anomaly = anomaly + step
        largest_step = np.max(np.abs(step), initial=0.0)
        if largest_step < 1e-13:
            break
    return anomaly
