"""Broadcast ephemerides of GPS and Galileo to positions, velocities and clocks."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from lvnav_trade.records import Floats
from lvnav_trade.world.sky.constellation import EARTH_RATE_GPS, GM_GPS, RELATIVITY_GPS, eccentric_anomaly
from lvnav_trade.world.sky.rinex import Ephemeris

GM_GALILEO = 3.986004418e14  # m^3/s^2, Galileo OS SIS ICD, table 57; the rate of the Earth is that of GPS
RELATIVITY_GALILEO = -4.442807309e-10  # s/m^0.5: -2 sqrt(GM) / c^2


class Broadcast(NamedTuple):
    """One ephemeris per satellite, (n_sat,) each, SI and radians; times count from a reference such as the lift-off.

    toe and toc (s) are the reference times of orbit and clock; node is the longitude of the node at toe, and node_rate
    its rate relative to the Earth. Pairs (2, n_sat) hold the sine and the cosine of harmonic corrections.
    """

    names: tuple[str, ...]
    toe: Floats
    toc: Floats
    semi_major_axis: Floats
    eccentricity: Floats
    mean_anomaly: Floats
    mean_motion: Floats
    perigee: Floats
    inclination: Floats
    inclination_rate: Floats
    node: Floats
    node_rate: Floats
    latitude_harmonic: Floats
    radius_harmonic: Floats
    inclination_harmonic: Floats
    clock_polynomial: Floats  # (3, n_sat): s, s/s, s/s^2
    relativity_factor: Floats  # s/m^0.5
    group_delay: Floats  # s

    @property
    def systems(self) -> tuple[str, ...]:
        """Letters of the systems, (n_sat,)."""
        return tuple(name[0] for name in self.names)

    def ecef(self, t: Floats) -> tuple[Floats, Floats]:
        """Return position (m) and Earth-relative velocity (m/s), (..., n_sat, 3) each, in the Earth-fixed axes of t.

        The user algorithm of IS-GPS-200, table 20-IV, and of the Galileo OS SIS ICD, table 58, and its derivative.
        """
        elapsed = t - self.toe
        e, n = self.eccentricity, self.mean_motion
        anomaly = eccentric_anomaly(self.mean_anomaly + n * elapsed, e)
        cos_e, sin_e = np.cos(anomaly), np.sin(anomaly)
        root, swell = np.sqrt(1.0 - e * e), 1.0 - e * cos_e
        phase = np.arctan2(root * sin_e, cos_e - e) + self.perigee
        phase_rate = n * root / swell**2
        twice = np.stack([np.sin(2.0 * phase), np.cos(2.0 * phase)])
        twice_rate = 2.0 * phase_rate * np.stack([twice[1], -twice[0]])

        def corrected(harmonic: Floats) -> tuple[Floats, Floats]:
            return np.einsum("is,i...s->...s", harmonic, twice), np.einsum("is,i...s->...s", harmonic, twice_rate)

        (du, du_rate), (dr, dr_rate) = corrected(self.latitude_harmonic), corrected(self.radius_harmonic)
        di, di_rate = corrected(self.inclination_harmonic)
        latitude, latitude_rate = phase + du, phase_rate + du_rate
        radius = self.semi_major_axis * swell + dr
        radius_rate = self.semi_major_axis * e * sin_e * n / swell + dr_rate
        cos_u, sin_u = np.cos(latitude), np.sin(latitude)
        x, y = radius * cos_u, radius * sin_u
        vx, vy = radius_rate * cos_u - y * latitude_rate, radius_rate * sin_u + x * latitude_rate
        inclination = self.inclination + di + self.inclination_rate * elapsed
        tilting = self.inclination_rate + di_rate
        node = self.node + self.node_rate * elapsed
        cos_n, sin_n, cos_i, sin_i = np.cos(node), np.sin(node), np.cos(inclination), np.sin(inclination)
        across, across_rate = y * cos_i, vy * cos_i - y * sin_i * tilting  # in the equator, across the line of nodes
        r_e = np.stack([x * cos_n - across * sin_n, x * sin_n + across * cos_n, y * sin_i], axis=-1)
        v_e = np.stack(
            [
                vx * cos_n - across_rate * sin_n - self.node_rate * r_e[..., 1],
                vx * sin_n + across_rate * cos_n + self.node_rate * r_e[..., 0],
                vy * sin_i + y * cos_i * tilting,
            ],
            axis=-1,
        )
        return r_e, v_e

    def clock(self, t: Floats) -> Floats:
        """Return what the satellites' clocks are ahead by their polynomials, (..., n_sat) s, relativity apart."""
        bias, drift, rate = self.clock_polynomial
        elapsed = t - self.toc
        return np.asarray(bias + (drift + rate * elapsed) * elapsed)

    def relativity(self, t: Floats) -> Floats:
        """Return F e sqrt(A) sin E, (..., n_sat) s: what eccentricity adds to the clocks (IS-GPS-200, 20.3.3.3.3.1)."""
        anomaly = eccentric_anomaly(self.mean_anomaly + self.mean_motion * (t - self.toe), self.eccentricity)
        size = self.relativity_factor * self.eccentricity * np.sqrt(self.semi_major_axis)
        return np.asarray(size * np.sin(anomaly))


def broadcast(ephemerides: Sequence[Ephemeris], reference: float) -> Broadcast:
    """Return the satellites of the ephemerides, times counted from `reference` (s of GPS time), in the order given.

    Galileo system time is taken as GPS time: they are kept within some tens of nanoseconds, less than a millimetre of
    orbit.
    """

    def column(field: str) -> Floats:
        return np.array([getattr(item, field) for item in ephemerides], dtype=float)

    axis = column("root_axis") ** 2
    galileo = np.array([item.name[0] == "E" for item in ephemerides], dtype=bool)
    return Broadcast(
        names=tuple(item.name for item in ephemerides),
        toe=column("toe") - reference,
        toc=column("toc") - reference,
        semi_major_axis=axis,
        eccentricity=column("eccentricity"),
        mean_anomaly=column("mean_anomaly"),
        mean_motion=np.sqrt(np.where(galileo, GM_GALILEO, GM_GPS) / axis**3) + column("mean_motion_difference"),
        perigee=column("perigee"),
        inclination=column("inclination"),
        inclination_rate=column("inclination_rate"),
        node=np.mod(column("node") - EARTH_RATE_GPS * column("week_second"), 2.0 * np.pi),
        node_rate=column("node_rate") - EARTH_RATE_GPS,
        latitude_harmonic=np.stack([column("latitude_sin"), column("latitude_cos")]),
        radius_harmonic=np.stack([column("radius_sin"), column("radius_cos")]),
        inclination_harmonic=np.stack([column("inclination_sin"), column("inclination_cos")]),
        clock_polynomial=np.stack([column("clock_bias"), column("clock_drift"), column("clock_drift_rate")]),
        relativity_factor=np.where(galileo, RELATIVITY_GALILEO, RELATIVITY_GPS),
        group_delay=column("group_delay"),
    )
