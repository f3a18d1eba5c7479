"""Cards of constellations, and satellite states from nominal slots or an almanac."""

import math
from collections.abc import Iterator
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from pydantic import Field, field_validator

from lvnav_trade.gnss.almanac import AlmanacRecord, read_almanac, read_yuma
from lvnav_trade.kernels.earth import J2, SEMI_MAJOR
from lvnav_trade.quantities import units
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.quantities.records import Floats
from lvnav_trade.quantities.times import gps_seconds, resolve_beidou_week, resolve_week

System = Literal["GPS", "Galileo", "GLONASS", "BeiDou"]
LETTERS: dict[str, str] = {"GPS": "G", "Galileo": "E", "GLONASS": "R", "BeiDou": "C"}  # as in RINEX

# Values prescribed by the GPS user algorithm (IS-GPS-200, table 20-IV); they differ from WGS-84 in the last digits.
GM_GPS = 3.986005e14  # m^3/s^2
EARTH_RATE_GPS = 7.2921151467e-5  # rad/s
RELATIVITY_GPS = -4.442807633e-10  # s/m^0.5: -2 sqrt(GM) / c^2
# CGCS2000 in the BeiDou user algorithm (BDS-SIS-ICD B1I 3.0, section 3.2 and table 5-11).
GM_BEIDOU = 3.986004418e14  # m^3/s^2
EARTH_RATE_BEIDOU = 7.2921150e-5  # rad/s
RELATIVITY_BEIDOU = -4.442807309e-10  # s/m^0.5: -2 sqrt(GM) / c^2


Eccentricity = Annotated[units.Share, Field(ge=0.0, le=0.1)]


class Slot(units.Card):
    """A satellite of a nominal constellation: its place at the epoch, and parameters that differ from other slots."""

    name: str  # such as A1
    node: units.Angle  # right ascension, at the epoch
    latitude_argument: units.Angle  # at the epoch
    semi_major_axis: Annotated[units.Length, Field(gt=0.0)] | None = Field(
        None, description="if absent: that of the constellation"
    )
    inclination: units.Angle | None = Field(None, description="if absent: that of the constellation")
    node_rate: units.AngularRate | None = Field(None, description="as for the constellation; from J2 if absent")
    latitude_rate: units.AngularRate | None = Field(None, description="as for the constellation")
    eccentricity: Eccentricity | None = Field(None, description="if absent: that of the constellation")
    perigee: units.Angle | None = Field(None, description="argument of perigee; if absent: that of the constellation")


class SignalErrors(units.Card):
    """Errors of the signals of a constellation (clock and ephemeris), and of the time of its system."""

    range_error: units.LengthSigma = Field(
        default=0.0, description="one sigma in range of each satellite's clock and ephemeris residual, Gauss-Markov"
    )
    range_error_time: units.TimeConstant | None = Field(
        default=None, description="time constant of the range error; constant over the flight if absent"
    )
    time_offset: units.LengthSigma = Field(
        default=0.0,
        description="one-sigma, in range, of the offset of the system's time from GPS time, equal for all its "
        "satellites",
    )
    time_offset_time: units.TimeConstant | None = Field(
        default=None, description="time constant of the time offset; constant over the flight if absent"
    )
    relativity: bool = Field(
        default=False, description="clocks have the periodic relativistic term of eccentric orbits, 2 r v / c in range"
    )

    def _faults(self) -> Iterator[str]:
        if getattr(self, "system", "") == "GPS" and self.time_offset > 0.0:
            yield "time_offset counts from GPS time, so a constellation of GPS has none"


class NominalConstellation(SignalErrors, units.NamedCard):
    """Orbits from published slots, circular by default, propagated from their epoch with secular rates."""

    kind: Literal["nominal"] = "nominal"
    system: System = "GPS"  # of all its satellites
    epoch: units.Epoch  # ISO 8601, UTC
    greenwich: units.Angle = Field(
        description="Greenwich hour angle of the direction from which nodes are counted, at epoch"
    )
    semi_major_axis: Annotated[units.Length, Field(gt=0.0)]  # of all orbits
    inclination: units.Angle  # of all orbits
    node_rate: units.AngularRate | None = Field(
        default=None, description="published rate of the nodes; if absent, that of J2 on a circular orbit"
    )
    latitude_rate: units.AngularRate | None = Field(
        default=None, description="published rate of the argument of latitude; if absent, two-body motion with J2"
    )
    eccentricity: Eccentricity = Field(default=0.0, description="eccentricity of all orbits; for GPS below 0.02")
    perigee: units.Angle = Field(default=0.0, description="argument of perigee of all orbits if they are eccentric")
    slots: tuple[Slot, ...] = Field(min_length=1)  # one satellite each

    def _faults(self) -> Iterator[str]:
        yield from super()._faults()
        if self.relativity and not any(_shape_of(self, slot)[0] for slot in self.slots):
            yield "relativity: clocks of circular orbits have no periodic term; state an eccentricity"

    @field_validator("slots")
    @classmethod
    def _own_names(cls, slots: tuple[Slot, ...]) -> tuple[Slot, ...]:
        names = [slot.name for slot in slots]
        repeated = [name for name in names if names.count(name) > 1]
        if repeated:  # draws are keyed by name
            raise ValueError(f"two slots are named {repeated[0]!r}")
        return slots


class AlmanacConstellation(SignalErrors):
    """A YUMA or SEM almanac file of the user, recognised by content; unhealthy satellites are omitted."""

    kind: Literal["almanac"] = "almanac"
    system: Literal["GPS", "BeiDou"] = Field(
        default="GPS", description="system of a YUMA file; weeks and times of a BeiDou file are in BeiDou time"
    )
    almanac: str = Field(description="path of a YUMA or SEM file", json_schema_extra={"path": True})
    longest_age: units.TimeConstant = Field(
        default=180 * 86400.0, description="largest time between lift-off and the time of applicability"
    )


class RinexConstellation(SignalErrors):
    """RINEX navigation files of the user: ephemerides of GPS, Galileo and BeiDou, state vectors of GLONASS."""

    kind: Literal["rinex"] = "rinex"
    rinex: str | tuple[str, ...] = Field(
        description="path of a RINEX 2 or 3 navigation file, gzip or plain, or a list of paths",
        json_schema_extra={"path": True},
    )
    systems: tuple[System, ...] | None = Field(
        default=None,
        description="satellite systems to use; if absent: all in the files, of the four that are supported",
    )
    longest_age: units.TimeConstant | None = Field(
        default=None,
        description="largest time between lift-off and a satellite's reference time; if absent: 2 h for GPS and "
        "BeiDou, 4 h for Galileo, 30 min for GLONASS",
    )
    time_correction: Literal["applied", "ignored"] = Field(
        default="applied",
        description="use of the offset between a system's time and GPS time in the files (TIME SYSTEM CORR) by the "
        "receiver: applied: only time_offset remains; ignored: ranges contain the offset too",
    )

    @field_validator("rinex", "systems")
    @classmethod
    def _some(cls, value: Any) -> Any:
        if value == ():
            raise ValueError("is an empty list")
        return value


class PreciseConstellation(SignalErrors):
    """Precise orbits in SP3 files of the user, as published by analysis centres days later, accurate to centimetres."""

    kind: Literal["sp3"] = "sp3"
    sp3: str | tuple[str, ...] = Field(
        description="path of an SP3 file, gzip or plain, or a list of consecutive files",
        json_schema_extra={"path": True},
    )
    systems: tuple[System, ...] | None = Field(
        default=None,
        description="satellite systems to use; if absent: all in the files, of the four that are supported",
    )

    @field_validator("sp3", "systems")
    @classmethod
    def _some(cls, value: Any) -> Any:
        if value == ():
            raise ValueError("is an empty list")
        return value


Part = NominalConstellation | AlmanacConstellation | RinexConstellation | PreciseConstellation


class CombinedConstellation(units.NamedCard):
    """Several constellations seen by one receiver; each system belongs to one part."""

    kind: Literal["combined"] = "combined"
    name: str = ""
    source: str = ""
    parts: tuple[Annotated[Part, Field(discriminator="kind")], ...] = Field(min_length=1)


Constellation = Part | CombinedConstellation


def parts_of(constellation: Constellation) -> tuple[Part, ...]:
    """Return the parts of a combined constellation, or the constellation itself as its only part."""
    return constellation.parts if isinstance(constellation, CombinedConstellation) else (constellation,)


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
        a, e = self.semi_major_axis, self.eccentricity
        anomaly = eccentric_anomaly(self.mean_anomaly + self.mean_motion * t, e)
        cos_e, sin_e, root = np.cos(anomaly), np.sin(anomaly), np.sqrt(1.0 - e * e)
        speed = a * self.mean_motion / (1.0 - e * cos_e)
        cos_w, sin_w = np.cos(self.perigee), np.sin(self.perigee)
        turn = np.array([[cos_w, -sin_w], [sin_w, cos_w]])
        own_axes = np.stack([a * (cos_e - e), a * root * sin_e]), np.stack([-speed * sin_e, speed * root * cos_e])
        flat, flat_rate = (np.einsum("ijs,j...s->i...s", turn, part) for part in own_axes)
        node_rate = self.node_rate - EARTH_RATE_GPS
        return earth_fixed(flat, flat_rate, self.node + node_rate * t, node_rate, self.inclination)

    def clock(self, t: Floats) -> Floats:
        """Return the clock offsets from system time by polynomial, (..., n_sat) s, without the relativistic term."""
        return np.asarray(self.clock_bias + self.clock_drift * t)

    def relativity(self, t: Floats) -> Floats:
        """Return the relativistic clock term F e sqrt(A) sin E, (..., n_sat) s (IS-GPS-200, 20.3.3.3.3.1)."""
        anomaly = eccentric_anomaly(self.mean_anomaly + self.mean_motion * t, self.eccentricity)
        return np.asarray(self.relativity_factor * self.eccentricity * np.sqrt(self.semi_major_axis) * np.sin(anomaly))


def orbits(constellation: NominalConstellation | AlmanacConstellation, epoch: str) -> Orbits:
    """Return the elements of all usable satellites with `epoch` (ISO 8601, UTC) as reference time.

    Raises
    ------
    InputError
        The almanac cannot be read (``file:line: what``), has no healthy satellite, or is too far from the epoch; or a
        time cannot be read.
    """
    if isinstance(constellation, NominalConstellation):
        return _nominal_orbits(constellation, epoch)
    beidou, file = constellation.system == "BeiDou", constellation.almanac
    records = [record for record in (read_yuma(file) if beidou else read_almanac(file)) if record.health == 0]
    if not records:
        raise InputError(f"{file}: no healthy satellite")
    lift_off = gps_seconds(epoch)
    week = resolve_beidou_week if beidou else resolve_week
    ages = [lift_off - week(record.week, record.applicability, lift_off) for record in records]
    recent = [abs(age) <= constellation.longest_age for age in ages]
    if not any(recent):
        age, limit = min(ages, key=abs) / 86400.0, constellation.longest_age / 86400.0
        when = f"{abs(age):.1f} days {'after' if age > 0.0 else 'before'} the time of applicability"
        raise InputError(f"{file}: the lift-off {epoch} is {when}; longest_age allows {limit:g} days")
    usable = [at for at, near in enumerate(recent) if near]
    return _almanac_orbits([records[at] for at in usable], np.array([ages[at] for at in usable]), beidou)


def _nominal_orbits(card: NominalConstellation, epoch: str) -> Orbits:
    """Propagate the slots to the epoch: two-body motion plus the secular J2 rates of a circular orbit.

    Rates of node, perigee and mean anomaly: Vallado, Fundamentals of Astrodynamics and Applications, section 9.6.
    """
    elapsed = gps_seconds(epoch) - gps_seconds(card.epoch)
    axis, inclination, node_rate, latitude_rate = np.array([_orbit_of(card, slot) for slot in card.slots]).T
    node = np.array([slot.node for slot in card.slots]) - card.greenwich + (node_rate - EARTH_RATE_GPS) * elapsed
    latitude = np.array([slot.latitude_argument for slot in card.slots]) + latitude_rate * elapsed
    eccentricity, perigee = np.array([_shape_of(card, slot) for slot in card.slots]).T
    none = np.zeros(len(card.slots))
    return Orbits(
        names=tuple(slot.name for slot in card.slots),
        semi_major_axis=axis,
        eccentricity=eccentricity,
        inclination=inclination,
        node=np.mod(node, 2.0 * math.pi),
        node_rate=node_rate,
        perigee=perigee,
        mean_anomaly=np.mod(latitude - perigee, 2.0 * math.pi),
        mean_motion=latitude_rate,
        clock_bias=none,
        clock_drift=none,
        systems=(LETTERS[card.system],) * len(card.slots),
    )


def _shape_of(card: NominalConstellation, slot: Slot) -> tuple[float, float]:
    """Return eccentricity and argument of perigee (rad) of a slot.

    The perigee is not propagated: it rotates by less than a degree in a month, and the argument of latitude is correct.
    """
    return (
        card.eccentricity if slot.eccentricity is None else slot.eccentricity,
        card.perigee if slot.perigee is None else slot.perigee,
    )


def _orbit_of(card: NominalConstellation, slot: Slot) -> tuple[float, float, float, float]:
    """Return axis (m), inclination (rad), and rates (rad/s) of node and argument of latitude of a slot.

    Rates of the constellation do not apply to a slot with its own semi-major axis.
    """
    axis = slot.semi_major_axis or card.semi_major_axis
    inclination = card.inclination if slot.inclination is None else slot.inclination
    n = math.sqrt(GM_GPS / axis**3)
    oblateness = 1.5 * n * J2 * (SEMI_MAJOR / axis) ** 2
    sin2 = math.sin(inclination) ** 2
    turning, running = -oblateness * math.cos(inclination), (2.0 - 2.5 * sin2) + (1.0 - 1.5 * sin2)
    common = card if slot.semi_major_axis is None else slot
    node_rate = common.node_rate if slot.node_rate is None else slot.node_rate
    latitude_rate = common.latitude_rate if slot.latitude_rate is None else slot.latitude_rate
    return (
        axis,
        inclination,
        turning if node_rate is None else node_rate,
        n + oblateness * running if latitude_rate is None else latitude_rate,
    )


def _almanac_orbits(records: list[AlmanacRecord], elapsed: Floats, beidou: bool) -> Orbits:
    """Propagate almanac elements by `elapsed` (n_sat,) s to the reference time.

    The node counts from Greenwich at the start of the week. All BeiDou satellites, including geostationary satellites,
    use the algorithm of GPS (BDS-SIS-ICD, table 5-16).
    """
    gm, rate = (GM_BEIDOU, EARTH_RATE_BEIDOU) if beidou else (GM_GPS, EARTH_RATE_GPS)
    letter = "C" if beidou else "G"
    of = dict(zip(AlmanacRecord._fields, np.array(records, dtype=float).T, strict=True))
    axis = of["root_axis"] ** 2
    mean_motion = np.sqrt(gm / axis**3)
    return Orbits(
        names=tuple(f"{letter}{record.prn:02d}" for record in records),
        semi_major_axis=axis,
        eccentricity=of["eccentricity"],
        inclination=of["inclination"],
        node=np.mod(of["node"] - rate * of["applicability"] + (of["node_rate"] - rate) * elapsed, 2.0 * math.pi),
        node_rate=of["node_rate"],
        perigee=of["perigee"],
        mean_anomaly=np.mod(of["mean_anomaly"] + mean_motion * elapsed, 2.0 * math.pi),
        mean_motion=mean_motion,
        clock_bias=of["clock_bias"] + of["clock_drift"] * elapsed,
        clock_drift=of["clock_drift"],
        systems=(letter,) * len(records),
        relativity_factor=RELATIVITY_BEIDOU if beidou else RELATIVITY_GPS,
    )


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
    (x, y), (vx, vy) = flat, flat_rate
    cos_n, sin_n, cos_i, sin_i = np.cos(node), np.sin(node), np.cos(inclination), np.sin(inclination)
    across, across_rate = y * cos_i, vy * cos_i - y * sin_i * tilting  # in the equator, across the line of nodes
    r_e = np.stack([x * cos_n - across * sin_n, x * sin_n + across * cos_n, y * sin_i], axis=-1)
    v_x = vx * cos_n - across_rate * sin_n - node_rate * r_e[..., 1]
    v_y = vx * sin_n + across_rate * cos_n + node_rate * r_e[..., 0]
    return r_e, np.stack([v_x, v_y, vy * sin_i + y * cos_i * tilting], axis=-1)


def eccentric_anomaly(mean_anomaly: Floats, eccentricity: Floats) -> Floats:
    """Return the eccentric anomaly (rad) by Newton's method, to rounding; arguments broadcast.

    The initial value E = M + 0.85 e sign(sin M) converges for every eccentricity below 1 (Danby and Burkardt, 1983).
    """
    mean = np.mod(mean_anomaly, 2.0 * math.pi)
    anomaly = mean + 0.85 * eccentricity * np.sign(np.sin(mean))
    for _ in range(30):
        step = (mean - anomaly + eccentricity * np.sin(anomaly)) / (1.0 - eccentricity * np.cos(anomaly))
        anomaly = anomaly + step
        if np.max(np.abs(step), initial=0.0) < 1e-13:
            break
    return anomaly
