"""Positions, velocities and clocks from broadcast ephemerides (GPS, Galileo, BeiDou) and GLONASS state vectors."""

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from lvnav_trade.gnss.kepler import (
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
    is_geostationary : (n_sat,). Whether it is a geostationary satellite of BeiDou, whose elements refer to tilted axes.
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
    is_geostationary: Bools
    earth_rate: Floats
    systems: tuple[str, ...]

    def ecef(self, t: Floats) -> tuple[Floats, Floats]:
        """Return position (m) and Earth-relative velocity (m/s), (..., n_sat, 3) each, in the Earth-fixed axes of t.

        The user algorithm of IS-GPS-200, table 20-IV, of the Galileo OS SIS ICD, table 58, and of the BDS-SIS-ICD,
        table 5-11, and its derivative.
        """
        elements = self.elements
        n = self.mean_motion
        e = elements["eccentricity"]
        time_from_epoch = t - elements["toe"]
        mean_anomaly = elements["mean_anomaly"] + n * time_from_epoch
        anomaly = eccentric_anomaly(mean_anomaly, e)
        cos_e = np.cos(anomaly)
        sin_e = np.sin(anomaly)
        root = np.sqrt(1.0 - e * e)
        radius_ratio = 1.0 - e * cos_e  # r / a
        true_anomaly = np.arctan2(root * sin_e, cos_e - e)
        # argument of latitude without corrections
        phase = true_anomaly + elements["perigee"]
        phase_rate = n * root / radius_ratio**2
        # second harmonics
        sin_twice = np.sin(2.0 * phase)
        cos_twice = np.cos(2.0 * phase)
        harmonic = np.stack([sin_twice, cos_twice])
        harmonic_rate = 2.0 * phase_rate * np.stack([cos_twice, -sin_twice])
        du, du_rate = _harmonic(elements, "latitude", harmonic, harmonic_rate)
        dr, dr_rate = _harmonic(elements, "radius", harmonic, harmonic_rate)
        di, di_rate = _harmonic(elements, "inclination", harmonic, harmonic_rate)
        latitude = phase + du
        latitude_rate = phase_rate + du_rate
        radius = self.semi_major_axis * radius_ratio + dr
        radius_rate = self.semi_major_axis * e * sin_e * n / radius_ratio + dr_rate
        cos_u = np.cos(latitude)
        sin_u = np.sin(latitude)
        x = radius * cos_u
        y = radius * sin_u
        x_rate = radius_rate * cos_u - y * latitude_rate
        y_rate = radius_rate * sin_u + x * latitude_rate
        node = self.node + self.node_rate * time_from_epoch
        inclination = elements["inclination"] + di + elements["inclination_rate"] * time_from_epoch
        r_e, v_e = earth_fixed(
            np.stack([x, y]),
            np.stack([x_rate, y_rate]),
            node,
            self.node_rate,
            inclination,
            elements["inclination_rate"] + di_rate,
        )
        if np.any(self.is_geostationary):
            return self._rotate_geostationary(r_e, v_e, time_from_epoch)
        return r_e, v_e

    def _rotate_geostationary(self, r: Floats, v: Floats, time_from_epoch: Floats) -> tuple[Floats, Floats]:
        """Return positions and velocities (..., n_sat, 3) with those of tilted satellites rotated to Earth-fixed axes.

        The rotation is about x by TILT, then about z by the rotation of the Earth in `time_from_epoch` (..., n_sat) s.
        """
        cos_tilt = math.cos(TILT)
        sin_tilt = math.sin(TILT)
        x_axis = (1.0, 0.0, 0.0)
        y_axis = (0.0, cos_tilt, sin_tilt)
        z_axis = (0.0, -sin_tilt, cos_tilt)
        tilt = np.array([x_axis, y_axis, z_axis])
        angle = self.earth_rate * time_from_epoch
        r_e = _rotate_z(r @ tilt.T, angle)
        v_e = _rotate_z(v @ tilt.T, angle)
        v_e[..., 0] += self.earth_rate * r_e[..., 1]
        v_e[..., 1] -= self.earth_rate * r_e[..., 0]
        is_geostationary = self.is_geostationary[:, None]
        return np.where(is_geostationary, r_e, r), np.where(is_geostationary, v_e, v)

    def clock(self, t: Floats) -> Floats:
        """Return the clock offsets from system time by polynomial, (..., n_sat) s, without the relativistic term."""
        elements = self.elements
        time_from_epoch = t - elements["toc"]
        drift = elements["clock_drift"] + elements["clock_drift_rate"] * time_from_epoch
        return np.asarray(elements["clock_bias"] + drift * time_from_epoch)

    def relativity(self, t: Floats) -> Floats:
        """Return the relativistic clock term F e sqrt(A) sin E, (..., n_sat) s (IS-GPS-200, 20.3.3.3.3.1)."""
        e = self.elements["eccentricity"]
        time_from_epoch = t - self.elements["toe"]
        mean_anomaly = self.elements["mean_anomaly"] + self.mean_motion * time_from_epoch
        anomaly = eccentric_anomaly(mean_anomaly, e)
        return np.asarray(self.relativity_factor * e * np.sqrt(self.semi_major_axis) * np.sin(anomaly))


def _harmonic(
    elements: Mapping[str, Floats], name: str, harmonic: Floats, harmonic_rate: Floats
) -> tuple[Floats, Floats]:
    """Return the second-harmonic correction of an orbit parameter, (..., n_sat), and its rate.

    harmonic, harmonic_rate : (2, ..., n_sat). Sine and cosine of twice the argument of latitude, and their rates.
    """
    amplitudes = np.stack([elements[f"{name}_sin"], elements[f"{name}_cos"]])
    correction = np.einsum("is,i...s->...s", amplitudes, harmonic)
    rate = np.einsum("is,i...s->...s", amplitudes, harmonic_rate)
    return correction, rate


def _rotate_z(vector: Floats, angle: Floats) -> Floats:
    """Return the components of vectors (..., 3) in axes rotated about z by an angle (...,) rad."""
    c = np.cos(angle)
    s = np.sin(angle)
    x, y, z = np.moveaxis(vector, -1, 0)
    rotated_x = c * x + s * y
    rotated_y = c * y - s * x
    return np.stack([rotated_x, rotated_y, z], axis=-1)


def broadcast_ephemerides(ephemerides: Sequence[Ephemeris], reference: float) -> BroadcastEphemerides:
    """Return the satellites of the ephemerides, times counted from `reference` (s of GPS time), in the order given.

    Galileo system time is treated as GPS time: they agree to some tens of nanoseconds, less than a millimetre of orbit.
    """
    names = tuple(item.name for item in ephemerides)
    systems = tuple(name[0] for name in names)
    elements = {}
    for element in ephemerides[0].elements:
        elements[element] = np.array([item.elements[element] for item in ephemerides])
    toe = np.array([item.toe for item in ephemerides]) - reference
    toc = np.array([item.toc for item in ephemerides]) - reference
    axis = elements["root_axis"] ** 2
    is_galileo = np.array([letter == "E" for letter in systems], dtype=bool)
    is_beidou = np.array([letter == "C" for letter in systems], dtype=bool)
    is_geostationary = np.array([name in GEOSTATIONARY for name in names], dtype=bool)
    gm = _system_constant(is_galileo, is_beidou, GM_GPS, GM_GALILEO, GM_BEIDOU)
    rate = np.where(is_beidou, EARTH_RATE_BEIDOU, EARTH_RATE_GPS)
    relativity = _system_constant(is_galileo, is_beidou, RELATIVITY_GPS, RELATIVITY_GALILEO, RELATIVITY_BEIDOU)
    kepler_motion = np.sqrt(gm / axis**3)
    node = elements["node"] - rate * elements["week_second"]
    axes_rate = np.where(is_geostationary, 0.0, rate)
    return BroadcastEphemerides(
        names=names,
        elements=elements | {"toe": toe, "toc": toc},
        semi_major_axis=axis,
        mean_motion=kepler_motion + elements["mean_motion_difference"],
        node=np.mod(node, 2.0 * np.pi),
        node_rate=elements["node_rate"] - axes_rate,
        relativity_factor=relativity,
        is_geostationary=is_geostationary,
        earth_rate=rate,
        systems=systems,
    )


def _system_constant(is_galileo: Bools, is_beidou: Bools, gps: float, galileo: float, beidou: float) -> Floats:
    """Return the constant of the system of each satellite, (n_sat,)."""
    return np.where(is_galileo, galileo, np.where(is_beidou, beidou, gps))


class IntegratedStates(NamedTuple):
    """One broadcast state per satellite.

    names : (n_sat,). Names of the satellites.
    systems : (n_sat,). Letters of their systems.
    start : (n_sat,) s. Times of the states, from a reference such as the lift-off.
    r_e : (n_sat, 3) m. Position at that time, Earth-fixed axes.
    v_e : (n_sat, 3) m/s. Velocity relative to the Earth, Earth-fixed axes.
    a_e : (n_sat, 3) m/s^2. Acceleration by Moon and Sun, Earth-fixed axes.
    clock_bias : (n_sat,) s.
    clock_drift : (n_sat,) s/s.
    """

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

        Axes are those of PZ-90.11, which agree with WGS-84 within 2 cm. Between the steps of the integration, a
        polynomial of fifth degree matches position, velocity and acceleration at both ends, so that velocity is the
        derivative of position.
        """
        shape = np.broadcast_shapes(np.shape(t), self.start.shape)
        steps = np.broadcast_to(t - self.start, shape) / STEP
        if steps.size == 0:
            return np.empty((*shape, 3)), np.empty((*shape, 3))
        first = min(0, math.floor(steps.min()))
        last = max(1, math.ceil(steps.max()))
        nodes = _integrate(self, first, last)
        whole_steps = np.floor(steps).astype(np.int64)
        step_index = np.clip(whole_steps, first, last - 1)
        satellite = np.arange(self.start.size)
        node = step_index - first
        start_state = [values[node, satellite] for values in nodes]
        end_state = [values[node + 1, satellite] for values in nodes]
        fraction = steps - step_index
        return _interpolate_step(start_state, end_state, fraction[..., None])

    def clock(self, t: Floats) -> Floats:
        """Return the broadcast clock offsets, (..., n_sat) s, which include the relativistic term."""
        return np.asarray(self.clock_bias + self.clock_drift * (t - self.start))

    def relativity(self, t: Floats) -> Floats:
        """Return zeros, (..., n_sat) s: the broadcast clock includes the relativistic term (ICD 5.1, section 3.3.3)."""
        return np.zeros(np.broadcast_shapes(np.shape(t), self.start.shape))


def integrated_states(states: Sequence[StateVector], reference: float) -> IntegratedStates:
    """Return the satellites of the states, times counted from `reference` (s of GPS time), in the order given."""
    return IntegratedStates(
        names=tuple(state.name for state in states),
        systems=tuple(state.name[0] for state in states),
        start=np.array([state.time for state in states]) - reference,
        r_e=np.array([state.r_e for state in states]),
        v_e=np.array([state.v_e for state in states]),
        a_e=np.array([state.a_e for state in states]),
        clock_bias=np.array([state.clock_bias for state in states]),
        clock_drift=np.array([state.clock_drift for state in states]),
    )


def acceleration(r_e: Floats, v_e: Floats, a_e: Floats) -> Floats:
    """Return the acceleration of a GLONASS satellite, (..., 3) m/s^2, Earth-fixed axes.

    It is the sum of attraction with J2, acceleration by Moon and Sun, and centrifugal and Coriolis acceleration of the
    rotating axes (ICD 5.1, section A.3.1.2).

    Parameters
    ----------
    r_e : (..., 3) m
        Position, Earth-fixed axes.
    v_e : (..., 3) m/s
        Velocity relative to the Earth, Earth-fixed axes.
    a_e : (..., 3) m/s^2
        Acceleration by Moon and Sun as broadcast, constant in Earth-fixed axes.
    """
    r2 = np.sum(r_e * r_e, axis=-1, keepdims=True)
    attraction = -GM_PZ90 / (r2 * np.sqrt(r2))
    flattening = 1.5 * J2_PZ90 * EQUATOR_PZ90**2 / r2
    sine2 = 5.0 * r_e[..., 2:] ** 2 / r2
    # factor of the attraction by axis
    oblateness = 1.0 + flattening * (np.array([1.0, 1.0, 3.0]) - sine2)
    gravitation = r_e * (attraction * oblateness)
    # centrifugal and Coriolis acceleration of the rotating axes
    rate = EARTH_RATE_PZ90
    x = r_e[..., 0]
    y = r_e[..., 1]
    vx = v_e[..., 0]
    vy = v_e[..., 1]
    rotation_x = rate * (rate * x + 2.0 * vy)
    rotation_y = rate * (rate * y - 2.0 * vx)
    rotation_z = np.zeros_like(x)
    rotation = np.stack([rotation_x, rotation_y, rotation_z], axis=-1)
    return np.asarray(gravitation + rotation + a_e)


def _integrate(satellites: IntegratedStates, first: int, last: int) -> tuple[Floats, Floats, Floats]:
    """Return position (m), velocity (m/s) and acceleration (m/s^2) at whole steps from the broadcast time.

    Classical Runge-Kutta, forwards and backwards in time.

    Parameters
    ----------
    satellites : IntegratedStates
    first, last : int
        First step (zero or negative) and last step, in steps of `STEP` from the broadcast time.

    Returns
    -------
    three of (last - first + 1, n_sat, 3)
        Earth-fixed axes.
    """
    size = (last - first + 1, satellites.start.size, 3)
    r = np.empty(size)
    v = np.empty(size)
    start = -first  # node at the broadcast time
    r[start] = satellites.r_e
    v[start] = satellites.v_e
    for node in range(start + 1, last - first + 1):
        r_next, v_next = _step(r[node - 1], v[node - 1], satellites.a_e, STEP)
        r[node] = r_next
        v[node] = v_next
    for node in range(start - 1, -1, -1):
        r_next, v_next = _step(r[node + 1], v[node + 1], satellites.a_e, -STEP)
        r[node] = r_next
        v[node] = v_next
    return r, v, acceleration(r, v, satellites.a_e)


def _step(r: Floats, v: Floats, a: Floats, h: float) -> tuple[Floats, Floats]:
    """Return position (m) and velocity (m/s) after a Runge-Kutta step, (..., 3) each, Earth-fixed axes.

    Parameters
    ----------
    r, v : (..., 3) m, m/s
        Position and velocity at the start.
    a : (..., 3) m/s^2
        Acceleration by Moon and Sun.
    h : float
        Step (s), may be negative.
    """
    a1 = acceleration(r, v, a)
    v2 = v + 0.5 * h * a1
    a2 = acceleration(r + 0.5 * h * v, v2, a)
    v3 = v + 0.5 * h * a2
    a3 = acceleration(r + 0.5 * h * v2, v3, a)
    v4 = v + h * a3
    a4 = acceleration(r + h * v3, v4, a)
    r_after = r + h / 6.0 * (v + 2.0 * (v2 + v3) + v4)
    v_after = v + h / 6.0 * (a1 + 2.0 * (a2 + a3) + a4)
    return r_after, v_after


def _interpolate_step(start_state: list[Floats], end_state: list[Floats], s: Floats) -> tuple[Floats, Floats]:
    """Return position (m) and velocity (m/s) within a step, by the quintic Hermite polynomial.

    Parameters
    ----------
    start_state, end_state : list of three (..., 3)
        Position (m), velocity (m/s) and acceleration (m/s^2) at both ends.
    s : (..., 1)
        Fraction of the step, 0 to 1.
    """
    r0, v0, a0 = start_state
    r1, v1, a1 = end_state
    # time in steps
    v0 = v0 * STEP
    v1 = v1 * STEP
    a0 = a0 * STEP**2
    a1 = a1 * STEP**2
    # remainder, at the end, of the Taylor series to second order at the start
    gap = r1 - r0 - v0 - 0.5 * a0
    gap_v = v1 - v0 - a0
    gap_a = a1 - a0
    c3 = 10.0 * gap - 4.0 * gap_v + 0.5 * gap_a
    c4 = -15.0 * gap + 7.0 * gap_v - gap_a
    c5 = 6.0 * gap - 3.0 * gap_v + 0.5 * gap_a
    higher = c3 + s * (c4 + s * c5)
    higher_rate = 3.0 * c3 + s * (4.0 * c4 + s * (5.0 * c5))
    r = r0 + s * (v0 + s * (0.5 * a0 + s * higher))
    v = v0 + s * (a0 + s * higher_rate)
    return r, v / STEP
