"""Cards of constellations, and satellite states from nominal slots or an almanac."""

import math
from collections.abc import Iterator
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, field_validator

from lvnav_trade.gnss.almanac import AlmanacRecord, read_almanac, read_yuma
from lvnav_trade.gnss.kepler import (
    EARTH_RATE_BEIDOU,
    EARTH_RATE_GPS,
    GM_BEIDOU,
    GM_GPS,
    RELATIVITY_BEIDOU,
    RELATIVITY_GPS,
    Orbits,
)
from lvnav_trade.kernels.earth import J2, SEMI_MAJOR
from lvnav_trade.quantities import units
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.quantities.records import Floats
from lvnav_trade.quantities.times import gps_seconds, resolve_beidou_week, resolve_week

System = Literal["GPS", "Galileo", "GLONASS", "BeiDou"]
LETTERS: dict[str, str] = {"GPS": "G", "Galileo": "E", "GLONASS": "R", "BeiDou": "C"}  # as in RINEX

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
        if self.relativity and not any(_slot_shape(self, slot)[0] for slot in self.slots):
            yield "relativity: clocks of circular orbits have no periodic term; state an eccentricity"

    @field_validator("slots")
    @classmethod
    def _refuse_equal_names(cls, slots: tuple[Slot, ...]) -> tuple[Slot, ...]:
        names = [slot.name for slot in slots]
        repeated_names = [name for name in names if names.count(name) > 1]
        if repeated_names:  # draws are keyed by name
            raise ValueError(f"two slots are named {repeated_names[0]!r}")
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
    def _refuse_empty(cls, value: Any) -> Any:
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
    def _refuse_empty(cls, value: Any) -> Any:
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


def constellation_parts(constellation: Constellation) -> tuple[Part, ...]:
    """Return the parts of a combined constellation, or the constellation itself as its only part."""
    return constellation.parts if isinstance(constellation, CombinedConstellation) else (constellation,)


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
    file = constellation.almanac
    is_beidou = constellation.system == "BeiDou"
    records = read_yuma(file) if is_beidou else read_almanac(file)
    healthy_records = [record for record in records if record.health == 0]
    if not healthy_records:
        raise InputError(f"{file}: no healthy satellite")
    lift_off = gps_seconds(epoch)
    resolve = resolve_beidou_week if is_beidou else resolve_week
    usable_records = []
    ages = []
    usable_ages = []
    for record in healthy_records:
        age = lift_off - resolve(record.week, record.applicability, lift_off)
        ages.append(age)
        if abs(age) <= constellation.longest_age:
            usable_records.append(record)
            usable_ages.append(age)
    if not usable_records:
        days = min(ages, key=abs) / 86400.0
        limit = constellation.longest_age / 86400.0
        distance = f"{abs(days):.1f} days {'after' if days > 0.0 else 'before'} the time of applicability"
        raise InputError(f"{file}: the lift-off {epoch} is {distance}; longest_age allows {limit:g} days")
    return _almanac_orbits(usable_records, np.array(usable_ages), is_beidou)


def _nominal_orbits(card: NominalConstellation, epoch: str) -> Orbits:
    """Propagate the slots to the epoch: two-body motion plus the secular J2 rates of a circular orbit.

    Rates of node, perigee and mean anomaly: Vallado, Fundamentals of Astrodynamics and Applications, section 9.6.
    """
    time_from_epoch = gps_seconds(epoch) - gps_seconds(card.epoch)
    n_slot = len(card.slots)
    axis, inclination, node_rate, latitude_rate = np.array([_slot_orbit(card, slot) for slot in card.slots]).T
    eccentricity, perigee = np.array([_slot_shape(card, slot) for slot in card.slots]).T
    node_at_card_epoch = np.array([slot.node for slot in card.slots]) - card.greenwich
    node = node_at_card_epoch + (node_rate - EARTH_RATE_GPS) * time_from_epoch
    latitude = np.array([slot.latitude_argument for slot in card.slots]) + latitude_rate * time_from_epoch
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
        clock_bias=np.zeros(n_slot),
        clock_drift=np.zeros(n_slot),
        systems=(LETTERS[card.system],) * n_slot,
    )


def _slot_shape(card: NominalConstellation, slot: Slot) -> tuple[float, float]:
    """Return eccentricity and argument of perigee (rad) of a slot.

    The perigee is not propagated: it rotates by less than a degree in a month, and the argument of latitude is correct.
    """
    eccentricity = card.eccentricity if slot.eccentricity is None else slot.eccentricity
    perigee = card.perigee if slot.perigee is None else slot.perigee
    return eccentricity, perigee


def _slot_orbit(card: NominalConstellation, slot: Slot) -> tuple[float, float, float, float]:
    """Return axis (m), inclination (rad), and rates (rad/s) of node and argument of latitude of a slot.

    Rates of the constellation do not apply to a slot with its own semi-major axis.
    """
    axis = slot.semi_major_axis or card.semi_major_axis
    inclination = card.inclination if slot.inclination is None else slot.inclination
    rate_card = card if slot.semi_major_axis is None else slot
    node_rate = rate_card.node_rate if slot.node_rate is None else slot.node_rate
    latitude_rate = rate_card.latitude_rate if slot.latitude_rate is None else slot.latitude_rate
    n = math.sqrt(GM_GPS / axis**3)
    oblateness = 1.5 * n * J2 * (SEMI_MAJOR / axis) ** 2
    if node_rate is None:
        node_rate = -oblateness * math.cos(inclination)
    if latitude_rate is None:
        sin2 = math.sin(inclination) ** 2
        perigee_factor = 2.0 - 2.5 * sin2
        anomaly_factor = 1.0 - 1.5 * sin2
        latitude_rate = n + oblateness * (perigee_factor + anomaly_factor)
    return axis, inclination, node_rate, latitude_rate


def _almanac_orbits(records: list[AlmanacRecord], ages: Floats, is_beidou: bool) -> Orbits:
    """Propagate almanac elements to the reference time.

    The node counts from Greenwich at the start of the week. All BeiDou satellites, including geostationary satellites,
    use the algorithm of GPS (BDS-SIS-ICD, table 5-16).

    Parameters
    ----------
    records : list of AlmanacRecord
    ages : (n_sat,) s
        Reference time minus time of applicability.
    is_beidou : bool
        Whether the satellites are of BeiDou; otherwise of GPS.
    """
    gm = GM_BEIDOU if is_beidou else GM_GPS
    earth_rate = EARTH_RATE_BEIDOU if is_beidou else EARTH_RATE_GPS
    letter = "C" if is_beidou else "G"
    columns = np.array(records, dtype=float).T
    elements = dict(zip(AlmanacRecord._fields, columns, strict=True))
    axis = elements["root_axis"] ** 2
    mean_motion = np.sqrt(gm / axis**3)
    node_at_applicability = elements["node"] - earth_rate * elements["applicability"]
    relative_rate = elements["node_rate"] - earth_rate
    node = node_at_applicability + relative_rate * ages
    mean_anomaly = elements["mean_anomaly"] + mean_motion * ages
    clock_bias = elements["clock_bias"] + elements["clock_drift"] * ages
    return Orbits(
        names=tuple(f"{letter}{record.prn:02d}" for record in records),
        semi_major_axis=axis,
        eccentricity=elements["eccentricity"],
        inclination=elements["inclination"],
        node=np.mod(node, 2.0 * math.pi),
        node_rate=elements["node_rate"],
        perigee=elements["perigee"],
        mean_anomaly=np.mod(mean_anomaly, 2.0 * math.pi),
        mean_motion=mean_motion,
        clock_bias=clock_bias,
        clock_drift=elements["clock_drift"],
        systems=(letter,) * len(records),
        relativity_factor=RELATIVITY_BEIDOU if is_beidou else RELATIVITY_GPS,
    )
