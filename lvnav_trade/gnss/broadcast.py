"""Positions, velocities and clocks from broadcast ephemerides (GPS, Galileo, BeiDou) and GLONASS state vectors."""

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from lvnav_trade.gnss.constellation import (
    EARTH_RATE_BEIDOU,
    EARTH_RATE_GPS,
    GM_BEIDOU,
    GM_GPS,
    RELATIVITY_BEIDOU,
    RELATIVITY_GPS,
    earth_fixed,
    eccentric_anomaly,
)
from lvnav_trade.gnss.rinex import Ephemeris, StateVector
from lvnav_trade.quantities.records import Bools, Floats

GM_GALILEO = 3.986004418e14  # m^3/s^2, Galileo OS SIS ICD, table 57; the rate of the Earth is that of GPS
RELATIVITY_GALILEO = -4.442807309e-10  # s/m^0.5: -2 sqrt(GM) / c^2
# BeiDou satellites C01 to C05 and C59 to C63 are geostationary (BDS-SIS-ICD B1I 3.0, table 4-1). Their elements refer
# to a plane tilted by 5 deg to the equator, in which node and inclination are defined (section 5.2.4.12).
GEOSTATIONARY = frozenset(f"C{prn:02d}" for prn in (*range(1, 6), *range(59, 64)))
TILT = math.radians(-5.0)
# GLONASS interface control document, edition 5.1, table 3.2 and section A.3.1.2 (PZ-90.02).
GM_PZ90 = 398600.4418e9  # m^3/s^2
EQUATOR_PZ90 = 6378136.0  # m
J2_PZ90 = 1082625.75e-9
EARTH_RATE_PZ90 = 7.2921151467e-5  # rad/s
# Half of the step that the document allows: 0.03 mm of error after a quarter of an hour (60 s: 0.4 mm).
STEP = 30.0  # s


class BroadcastEphemerides(NamedTuple):
    """One broadcast ephemeris per satellite, SI and radians. Times count from a reference such as the lift-off.

    names : (n_sat,). Names of the satellites.
    elements : (n_sat,) by name. Elements as broadcast, see `Ephemeris`; toe and toc counted from the reference.
    semi_major_axis : (n_sat,) m.
    mean_motion : (n_sat,) rad/s. With the broadcast correction.
    node : (n_sat,) rad. Longitude of the ascending node at toe.
    node_rate : (n_sat,) rad/s. Relative to the Earth; of a tilted satellite relative to axes that do not turn.
    relativity_factor : (n_sat,) s/m^0.5. Factor of the relativistic clock term.
    tilted : (n_sat,). Whether it is a geostationary satellite of BeiDou, whose elements refer to tilted axes.
    earth_rate : (n_sat,) rad/s. Earth rate of its system.
    systems : (n_sat,). Letter of its system.
    """

    names: tuple[str, ...]
    elements: Mapping[str, Floats]
    semi_major_axis: Floats
    mean_motion: Floats
    node: Floats
    node_rate: Floats
    relativity_factor: Floats  # s/m^0.5
    tilted: Bools
    earth_rate: Floats
    systems: tuple[str, ...]

    def ecef(self, t: Floats) -> tuple[Floats, Floats]:
        """Return position (m) and Earth-relative velocity (m/s), (..., n_sat, 3) each, in the Earth-fixed axes of t.

        The user algorithm of IS-GPS-200, table 20-IV, of the Galileo OS SIS ICD, table 58, and of the BDS-SIS-ICD,
        table 5-11, and its derivative.
        """
        of, n = self.elements, self.mean_motion
        elapsed, e = t - of["toe"], of["eccentricity"]
        anomaly = eccentric_anomaly(of["mean_anomaly"] + n * elapsed, e)
        cos_e, sin_e = np.cos(anomaly), np.sin(anomaly)
        root, swell = np.sqrt(1.0 - e * e), 1.0 - e * cos_e
        phase = np.arctan2(root * sin_e, cos_e - e) + of["perigee"]
        phase_rate = n * root / swell**2
        twice = np.stack([np.sin(2.0 * phase), np.cos(2.0 * phase)])
        twice_rate = 2.0 * phase_rate * np.stack([twice[1], -twice[0]])

        def harmonic(of_what: str) -> tuple[Floats, Floats]:
            pair = np.stack([of[f"{of_what}_sin"], of[f"{of_what}_cos"]])
            return np.einsum("is,i...s->...s", pair, twice), np.einsum("is,i...s->...s", pair, twice_rate)

        (du, du_rate), (dr, dr_rate), (di, di_rate) = map(harmonic, ("latitude", "radius", "inclination"))
        latitude, latitude_rate = phase + du, phase_rate + du_rate
        radius = self.semi_major_axis * swell + dr
        radius_rate = self.semi_major_axis * e * sin_e * n / swell + dr_rate
        cos_u, sin_u = np.cos(latitude), np.sin(latitude)
        x, y = radius * cos_u, radius * sin_u
        rate = np.stack([radius_rate * cos_u - y * latitude_rate, radius_rate * sin_u + x * latitude_rate])
        inclination = of["inclination"] + di + of["inclination_rate"] * elapsed
        node = self.node + self.node_rate * elapsed
        tilting = of["inclination_rate"] + di_rate
        r_e, v_e = earth_fixed(np.stack([x, y]), rate, node, self.node_rate, inclination, tilting)
        return self._turned(r_e, v_e, elapsed) if np.any(self.tilted) else (r_e, v_e)

    def _turned(self, r: Floats, v: Floats, elapsed: Floats) -> tuple[Floats, Floats]:
        """Return positions and velocities (..., n_sat, 3) with those of tilted satellites rotated to Earth-fixed axes.

        The rotation is about x by TILT, then about z by the rotation of the Earth in `elapsed` (..., n_sat) s.
        """
        down, across = math.cos(TILT), math.sin(TILT)
        tilt = np.array([[1.0, 0.0, 0.0], [0.0, down, across], [0.0, -across, down]])
        place, speed = r @ tilt.T, v @ tilt.T
        angle = self.earth_rate * elapsed
        c, s = np.cos(angle), np.sin(angle)

        def spun(x: Floats, y: Floats, z: Floats) -> Floats:
            return np.stack([c * x + s * y, c * y - s * x, z], axis=-1)

        r_e, v_e = spun(*np.moveaxis(place, -1, 0)), spun(*np.moveaxis(speed, -1, 0))
        v_e[..., 0] += self.earth_rate * r_e[..., 1]
        v_e[..., 1] -= self.earth_rate * r_e[..., 0]
        chosen = self.tilted[:, None]
        return np.where(chosen, r_e, r), np.where(chosen, v_e, v)

    def clock(self, t: Floats) -> Floats:
        """Return the clock offsets from system time by polynomial, (..., n_sat) s, without the relativistic term."""
        of = self.elements
        elapsed = t - of["toc"]
        return np.asarray(of["clock_bias"] + (of["clock_drift"] + of["clock_drift_rate"] * elapsed) * elapsed)

    def relativity(self, t: Floats) -> Floats:
        """Return the relativistic clock term F e sqrt(A) sin E, (..., n_sat) s (IS-GPS-200, 20.3.3.3.3.1)."""
        of = self.elements
        anomaly = eccentric_anomaly(of["mean_anomaly"] + self.mean_motion * (t - of["toe"]), of["eccentricity"])
        return np.asarray(self.relativity_factor * of["eccentricity"] * np.sqrt(self.semi_major_axis) * np.sin(anomaly))


def broadcast(ephemerides: Sequence[Ephemeris], reference: float) -> BroadcastEphemerides:
    """Return the satellites of the ephemerides, times counted from `reference` (s of GPS time), in the order given.

    Galileo system time is treated as GPS time: they agree to some tens of nanoseconds, less than a millimetre of orbit.
    """
    of = {name: np.array([item.elements[name] for item in ephemerides]) for name in ephemerides[0].elements}
    toe, toc = (np.array([getattr(item, name) for item in ephemerides]) - reference for name in ("toe", "toc"))
    axis = of["root_axis"] ** 2
    galileo, beidou = (np.array([item.name[0] == letter for item in ephemerides], dtype=bool) for letter in "EC")
    tilted = np.array([item.name in GEOSTATIONARY for item in ephemerides], dtype=bool)
    gm = np.where(galileo, GM_GALILEO, np.where(beidou, GM_BEIDOU, GM_GPS))
    rate = np.where(beidou, EARTH_RATE_BEIDOU, EARTH_RATE_GPS)
    return BroadcastEphemerides(
        names=tuple(item.name for item in ephemerides),
        elements=of | {"toe": toe, "toc": toc},
        semi_major_axis=axis,
        mean_motion=np.sqrt(gm / axis**3) + of["mean_motion_difference"],
        node=np.mod(of["node"] - rate * of["week_second"], 2.0 * np.pi),
        node_rate=of["node_rate"] - np.where(tilted, 0.0, rate),
        relativity_factor=np.where(galileo, RELATIVITY_GALILEO, np.where(beidou, RELATIVITY_BEIDOU, RELATIVITY_GPS)),
        tilted=tilted,
        earth_rate=rate,
        systems=tuple(item.name[0] for item in ephemerides),
    )


class IntegratedStates(NamedTuple):
    """One broadcast state per satellite, (n_sat,) and (n_sat, 3), SI; `start` (s) counts from a reference."""

    names: tuple[str, ...]
    systems: tuple[str, ...]  # letters
    start: Floats
    r_e: Floats
    v_e: Floats
    a_e: Floats  # acceleration by Moon and Sun
    clock_bias: Floats  # s
    clock_drift: Floats  # s/s

    def ecef(self, t: Floats) -> tuple[Floats, Floats]:
        """Return position (m) and Earth-relative velocity (m/s), (..., n_sat, 3) each, in the Earth-fixed axes of t.

        Axes are those of PZ-90.11, which agree with WGS-84 within 2 cm. Between the steps of the integration stands
        the polynomial of fifth degree that meets position, velocity and acceleration at both ends, so that velocity is
        the derivative of position.
        """
        steps = np.broadcast_to(t - self.start, np.broadcast_shapes(np.shape(t), self.start.shape)) / STEP
        if steps.size == 0:
            return np.empty((*steps.shape, 3)), np.empty((*steps.shape, 3))
        first = min(0, math.floor(steps.min()))
        last = max(1, math.ceil(steps.max()))
        nodes = _nodes(self, first, last)
        below = np.clip(np.floor(steps).astype(np.int64), first, last - 1)
        which = np.arange(self.start.size)
        before = [part[below - first, which] for part in nodes]
        return _between(before, [part[below - first + 1, which] for part in nodes], (steps - below)[..., None])

    def clock(self, t: Floats) -> Floats:
        """Return the broadcast clock offsets, (..., n_sat) s, which include the relativistic term."""
        return np.asarray(self.clock_bias + self.clock_drift * (t - self.start))

    def relativity(self, t: Floats) -> Floats:
        """Return zeros, (..., n_sat) s: the broadcast clock includes the relativistic term (ICD 5.1, section 3.3.3)."""
        return np.zeros(np.broadcast_shapes(np.shape(t), self.start.shape))


def integrated(states: Sequence[StateVector], reference: float) -> IntegratedStates:
    """Return the satellites of the states, times counted from `reference` (s of GPS time), in the order given."""
    names, time, bias, drift, r_e, v_e, a_e, _ = zip(*states, strict=True)
    systems, arrays = tuple(name[0] for name in names), map(np.array, (r_e, v_e, a_e, bias, drift))
    return IntegratedStates(names, systems, np.array(time) - reference, *arrays)


def acceleration(r_e: Floats, v_e: Floats, a_e: Floats) -> Floats:
    """Return the acceleration (..., 3) m/s^2 in Earth-fixed axes: attraction with J2, Moon and Sun, rotating axes.

    ICD 5.1, section A.3.1.2: a_e, by Moon and Sun, stays as broadcast in Earth-fixed axes.
    """
    r2 = np.sum(r_e * r_e, axis=-1, keepdims=True)
    attraction = -GM_PZ90 / (r2 * np.sqrt(r2))
    flattening = 1.5 * J2_PZ90 * EQUATOR_PZ90**2 / r2
    sine2 = 5.0 * r_e[..., 2:] ** 2 / r2
    spherical = r_e * (attraction * (1.0 + flattening * (np.array([1.0, 1.0, 3.0]) - sine2)))
    x, y = r_e[..., 0], r_e[..., 1]
    rate = EARTH_RATE_PZ90
    turning = np.stack(
        [rate * (rate * x + 2.0 * v_e[..., 1]), rate * (rate * y - 2.0 * v_e[..., 0]), np.zeros_like(x)], axis=-1
    )
    return np.asarray(spherical + turning + a_e)


def _nodes(above: IntegratedStates, first: int, last: int) -> tuple[Floats, Floats, Floats]:
    """Return position, velocity and acceleration (last - first + 1, n_sat, 3) at whole steps from the broadcast time.

    Classical Runge-Kutta, forwards and backwards in time.
    """
    size = (last - first + 1, above.start.size, 3)
    r, v = np.empty(size), np.empty(size)
    r[-first], v[-first] = above.r_e, above.v_e
    for sign, end in ((1, last), (-1, first)):
        h = sign * STEP
        here, moving = above.r_e, above.v_e
        for k in range(sign, end + sign, sign) if end != 0 else ():
            here, moving = _step(here, moving, above.a_e, h)
            r[k - first], v[k - first] = here, moving
    return r, v, acceleration(r, v, above.a_e)


def _step(r: Floats, v: Floats, a: Floats, h: float) -> tuple[Floats, Floats]:
    a1 = acceleration(r, v, a)
    v2 = v + 0.5 * h * a1
    a2 = acceleration(r + 0.5 * h * v, v2, a)
    v3 = v + 0.5 * h * a2
    a3 = acceleration(r + 0.5 * h * v2, v3, a)
    v4 = v + h * a3
    a4 = acceleration(r + h * v3, v4, a)
    return r + h / 6.0 * (v + 2.0 * (v2 + v3) + v4), v + h / 6.0 * (a1 + 2.0 * (a2 + a3) + a4)


def _between(before: list[Floats], after: list[Floats], s: Floats) -> tuple[Floats, Floats]:
    """Return position and velocity at the fraction s of a step, by the quintic Hermite polynomial.

    before, after : position, velocity and acceleration at both ends.
    """
    (r0, v0, a0), (r1, v1, a1) = before, after
    # time in steps; the first three terms of the Taylor series at the start are subtracted
    v0, v1, a0, a1 = v0 * STEP, v1 * STEP, a0 * STEP**2, a1 * STEP**2
    gap, gap_v, gap_a = r1 - r0 - v0 - 0.5 * a0, v1 - v0 - a0, a1 - a0
    c3 = 10.0 * gap - 4.0 * gap_v + 0.5 * gap_a
    c4 = -15.0 * gap + 7.0 * gap_v - gap_a
    c5 = 6.0 * gap - 3.0 * gap_v + 0.5 * gap_a
    r = r0 + s * (v0 + s * (0.5 * a0 + s * (c3 + s * (c4 + s * c5))))
    return r, (v0 + s * (a0 + s * (3.0 * c3 + s * (4.0 * c4 + s * (5.0 * c5))))) / STEP
