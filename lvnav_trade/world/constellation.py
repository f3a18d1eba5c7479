"""Nominal slots or an almanac to satellite states."""

from __future__ import annotations

import math
from typing import Annotated, Literal, NamedTuple

import numpy as np
from pydantic import Field

from lvnav_trade.errors import InputError
from lvnav_trade.kernels.earth import J2, SEMI_MAJOR
from lvnav_trade.records import Floats
from lvnav_trade.units import Angle, Card, Length
from lvnav_trade.world.almanac import AlmanacRecord, read_yuma
from lvnav_trade.world.gps_time import gps_seconds, resolve_week

# Values that the GPS user algorithm prescribes (IS-GPS-200, table 20-IV); they differ from WGS-84's in the last digits.
GM_GPS = 3.986005e14  # m^3/s^2
EARTH_RATE_GPS = 7.2921151467e-5  # rad/s


class Slot(Card):
    """One satellite of a nominal constellation: right ascension of the node and argument of latitude at the epoch."""

    name: str
    node: Angle
    latitude_argument: Angle


class NominalConstellation(Card):
    """Circular orbits from published slots, carried from their epoch with the secular drift of J2."""

    kind: Literal["nominal"] = "nominal"
    name: str
    source: str
    epoch: str  # ISO 8601, UTC
    greenwich: Angle = Field(description="Greenwich hour angle of the direction that nodes are counted from, at epoch")
    semi_major_axis: Annotated[Length, Field(gt=0.0)]
    inclination: Angle
    slots: tuple[Slot, ...] = Field(min_length=1)


class AlmanacConstellation(Card):
    """A YUMA almanac file of the user's; satellites that it calls unhealthy are left out."""

    kind: Literal["almanac"] = "almanac"
    almanac: str = Field(description="path of a YUMA file", json_schema_extra={"path": True})


Constellation = NominalConstellation | AlmanacConstellation


class Orbits(NamedTuple):
    """Keplerian elements of all satellites at a reference time, (n_sat,) each, SI and radians.

    The node is counted from Greenwich at the reference time, node_rate relative to inertial space. Elements are brought
    to the lift-off first, because seconds counted from a distant epoch would round positions by a millimetre.
    """

    names: tuple[str, ...]
    semi_major_axis: Floats
    eccentricity: Floats
    inclination: Floats
    node: Floats
    node_rate: Floats
    perigee: Floats
    mean_anomaly: Floats
    mean_motion: Floats

    @property
    def systems(self) -> tuple[str, ...]:
        """Letters of the systems, (n_sat,)."""
        return ("G",) * len(self.names)

    def ecef(self, t: Floats) -> tuple[Floats, Floats]:
        """Return position and Earth-relative velocity as `satellite_ecef` does."""
        return satellite_ecef(self, t)


def orbits(constellation: NominalConstellation | AlmanacConstellation, epoch: str) -> Orbits:
    """Return the elements of all usable satellites with `epoch` (ISO 8601, UTC) as reference time.

    Raises
    ------
    InputError
        Where the almanac is broken (``file:line: what``), holds no healthy satellite, or a time cannot be read.
    """
    if isinstance(constellation, NominalConstellation):
        return _nominal_orbits(constellation, epoch)
    records = [record for record in read_yuma(constellation.almanac) if record.health == 0]
    if not records:
        raise InputError(f"{constellation.almanac}: no healthy satellite")
    return _almanac_orbits(records, gps_seconds(epoch))


def _nominal_orbits(card: NominalConstellation, epoch: str) -> Orbits:
    """Carry the slots to the epoch: two-body motion plus the secular J2 rates of a circular orbit.

    Rates of node, perigee and mean anomaly: Vallado, Fundamentals of Astrodynamics and Applications, section 9.6.
    """
    elapsed = gps_seconds(epoch) - gps_seconds(card.epoch)
    n = math.sqrt(GM_GPS / card.semi_major_axis**3)
    oblateness = 1.5 * n * J2 * (SEMI_MAJOR / card.semi_major_axis) ** 2
    sin2 = math.sin(card.inclination) ** 2
    node_rate = -oblateness * math.cos(card.inclination)
    latitude_rate = n + oblateness * ((2.0 - 2.5 * sin2) + (1.0 - 1.5 * sin2))
    node = np.array([slot.node for slot in card.slots]) - card.greenwich + (node_rate - EARTH_RATE_GPS) * elapsed
    latitude = np.array([slot.latitude_argument for slot in card.slots]) + latitude_rate * elapsed
    same = np.ones(len(card.slots))
    return Orbits(
        names=tuple(slot.name for slot in card.slots),
        semi_major_axis=card.semi_major_axis * same,
        eccentricity=0.0 * same,
        inclination=card.inclination * same,
        node=np.mod(node, 2.0 * math.pi),
        node_rate=node_rate * same,
        perigee=0.0 * same,
        mean_anomaly=np.mod(latitude, 2.0 * math.pi),
        mean_motion=latitude_rate * same,
    )


def _almanac_orbits(records: list[AlmanacRecord], reference: float) -> Orbits:
    """Carry broadcast elements to the reference time (s, GPS time); their node counts from Greenwich at week start."""
    applicability = np.array([record.applicability for record in records])
    elapsed = reference - np.array([resolve_week(r.week, r.applicability, reference) for r in records])
    axis = np.array([record.root_axis for record in records]) ** 2
    node_rate = np.array([record.node_rate for record in records])
    mean_motion = np.sqrt(GM_GPS / axis**3)
    node = np.array([record.node for record in records]) - EARTH_RATE_GPS * applicability
    mean_anomaly = np.array([record.mean_anomaly for record in records])
    return Orbits(
        names=tuple(f"G{record.prn:02d}" for record in records),
        semi_major_axis=axis,
        eccentricity=np.array([record.eccentricity for record in records]),
        inclination=np.array([record.inclination for record in records]),
        node=np.mod(node + (node_rate - EARTH_RATE_GPS) * elapsed, 2.0 * math.pi),
        node_rate=node_rate,
        perigee=np.array([record.perigee for record in records]),
        mean_anomaly=np.mod(mean_anomaly + mean_motion * elapsed, 2.0 * math.pi),
        mean_motion=mean_motion,
    )


def satellite_ecef(orbit: Orbits, t: Floats | float) -> tuple[Floats, Floats]:
    """Return position (m) and Earth-relative velocity (m/s) of all satellites, in the Earth-fixed axes of time t.

    Parameters
    ----------
    orbit
        Elements, (n_sat,).
    t
        Seconds since the reference time of the elements, any shape that broadcasts with a last axis of n_sat:
        (n_epoch, n_sat), or (n_epoch, 1) for the same times for all.

    Returns
    -------
    r_e, v_e
        (..., n_sat, 3) each; v_e is the derivative of r_e.

    Notes
    -----
    The user algorithm of IS-GPS-200, table 20-IV, with the terms that an almanac carries (no harmonic corrections).
    """
    anomaly = eccentric_anomaly(orbit.mean_anomaly + orbit.mean_motion * t, orbit.eccentricity)
    cos_e, sin_e, e = np.cos(anomaly), np.sin(anomaly), orbit.eccentricity
    root = np.sqrt(1.0 - e * e)
    flat = np.stack([orbit.semi_major_axis * (cos_e - e), orbit.semi_major_axis * root * sin_e])
    speed = orbit.semi_major_axis * orbit.mean_motion / (1.0 - e * cos_e)
    flat_rate = np.stack([-speed * sin_e, speed * root * cos_e])
    cos_w, sin_w = np.cos(orbit.perigee), np.sin(orbit.perigee)
    turn = np.array([[cos_w, -sin_w], [sin_w, cos_w]])
    x, y = np.einsum("ijs,j...s->i...s", turn, flat)
    vx, vy = np.einsum("ijs,j...s->i...s", turn, flat_rate)
    node_rate = orbit.node_rate - EARTH_RATE_GPS
    node = orbit.node + node_rate * t
    cos_n, sin_n, cos_i, sin_i = np.cos(node), np.sin(node), np.cos(orbit.inclination), np.sin(orbit.inclination)
    r_e = np.stack([x * cos_n - y * cos_i * sin_n, x * sin_n + y * cos_i * cos_n, y * sin_i], axis=-1)
    in_plane = np.stack([vx * cos_n - vy * cos_i * sin_n, vx * sin_n + vy * cos_i * cos_n, vy * sin_i], axis=-1)
    turning = np.stack([-node_rate * r_e[..., 1], node_rate * r_e[..., 0], np.zeros_like(x)], axis=-1)
    return r_e, in_plane + turning


def eccentric_anomaly(mean_anomaly: Floats, eccentricity: Floats) -> Floats:
    """Return the eccentric anomaly (rad) by Newton's method, to rounding; arguments broadcast.

    The start E = M + 0.85 e sign(sin M) converges for every eccentricity below one (Danby and Burkardt, 1983).
    """
    mean = np.mod(mean_anomaly, 2.0 * math.pi)
    anomaly = mean + 0.85 * eccentricity * np.sign(np.sin(mean))
    for _ in range(30):
        step = (mean - anomaly + eccentricity * np.sin(anomaly)) / (1.0 - eccentricity * np.cos(anomaly))
        anomaly = anomaly + step
        if np.max(np.abs(step), initial=0.0) < 1e-13:
            break
    return anomaly
