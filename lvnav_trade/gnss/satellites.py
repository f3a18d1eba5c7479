"""Satellites of a constellation card: positions, velocities and clocks over time."""

import hashlib
from collections.abc import Iterable
from typing import NamedTuple, TypeVar

import numpy as np

from lvnav_trade.gnss.broadcast import BroadcastEphemerides, IntegratedStates, broadcast_ephemerides, integrated_states
from lvnav_trade.gnss.constellation import (
    LETTERS,
    AlmanacConstellation,
    CombinedConstellation,
    Constellation,
    Part,
    PreciseConstellation,
    RinexConstellation,
    constellation_parts,
    orbits,
)
from lvnav_trade.gnss.kepler import Orbits
from lvnav_trade.gnss.precise import PreciseEphemerides, precise_ephemerides, read_positions
from lvnav_trade.gnss.rinex import Ephemeris, NavigationFile, StateVector, TimeOffset, read_navigation
from lvnav_trade.kernels.clock import SPEED_OF_LIGHT
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.quantities.input_files import read_bytes
from lvnav_trade.quantities.input_limits import DATA_BYTES
from lvnav_trade.quantities.records import Floats
from lvnav_trade.quantities.times import gps_seconds

# Half the fit interval of GPS, the longest use of a Galileo ephemeris, two updates of BeiDou's, the interval of GLONASS
# broadcasts.
LONGEST_AGE = {"G": 7200.0, "E": 14400.0, "C": 7200.0, "R": 1800.0}  # s
_NAMES = {letter: name for name, letter in LETTERS.items()}
# Galileo sends the same orbits in two messages; single-frequency users of E1 use the clock of I/NAV.
_INAV_E1 = 1
# Bits of the health word for E1-B: data validity (0) and status (1, 2); others are for E5a and E5b (RINEX 3.04, A8).
_HEALTH_E1 = 0b111
# Accuracy without prediction: URA index 15, above 6144 m (IS-GPS-200, 20.3.3.3.1.3); SISA index 255, or -1 in RINEX
# (Galileo OS SIS ICD, section 5.1.12), whose largest value is 6 m.
_NO_URA, _NO_SISA = 6144.0, 255.0  # m


class CombinedSatellites(NamedTuple):
    """Several sets of satellites in succession, with orbits from different kinds of data.

    groups : Sets of satellites, in order. Times t, (..., n_sat) or (..., 1), are in s of GPS time since lift-off.
    """

    groups: "tuple[Satellites, ...]"

    @property
    def names(self) -> tuple[str, ...]:
        """Names such as "G05", (n_sat,), group after group."""
        return tuple(name for group in self.groups for name in group.names)

    @property
    def systems(self) -> tuple[str, ...]:
        """Letters as in RINEX, (n_sat,): G (GPS), E (Galileo), R (GLONASS)."""
        return tuple(letter for group in self.groups for letter in group.systems)

    def ecef(self, t: Floats) -> tuple[Floats, Floats]:
        """Return position (m) and Earth-relative velocity (m/s), (..., n_sat, 3) each, in the Earth-fixed axes of t."""
        positions = []
        velocities = []
        for group, times in self._split_times(t):
            r_e, v_e = group.ecef(times)
            positions.append(r_e)
            velocities.append(v_e)
        position = np.concatenate(positions, axis=-2)
        velocity = np.concatenate(velocities, axis=-2)
        return position, velocity

    def clock(self, t: Floats) -> Floats:
        """Return the clock offsets from system time, (..., n_sat) s, without the relativistic term."""
        clocks = [group.clock(times) for group, times in self._split_times(t)]
        return np.concatenate(clocks, axis=-1)

    def relativity(self, t: Floats) -> Floats:
        """Return the relativistic clock term due to the eccentricity of the orbit, (..., n_sat) s."""
        terms = [group.relativity(times) for group, times in self._split_times(t)]
        return np.concatenate(terms, axis=-1)

    def _split_times(self, t: Floats) -> "list[tuple[Satellites, Floats]]":
        sizes = [len(group.names) for group in self.groups]
        shape = np.broadcast_shapes(np.shape(t), (sum(sizes),))
        times = np.broadcast_to(t, shape)
        ends = np.cumsum(sizes)
        part_times = np.split(times, ends[:-1], axis=-1)
        return list(zip(self.groups, part_times, strict=True))


Satellites = Orbits | BroadcastEphemerides | IntegratedStates | PreciseEphemerides | CombinedSatellites


def satellites(constellation: Constellation, epoch: str) -> Satellites:
    """Return the usable satellites of a constellation around a lift-off at `epoch` (ISO 8601, UTC).

    A satellite has a single set of elements over the flight, with the reference time nearest to lift-off, so that its
    orbit is smooth. Errors of broadcast ephemerides are the range error of the card.

    Raises
    ------
    InputError
        A file cannot be read (``file:line: what``), has no healthy satellite of a required system, or none with a
        reference time near lift-off; two parts have the same system or satellite; or a time cannot be read.
    """
    if not isinstance(constellation, CombinedConstellation):
        return _part_satellites(constellation, epoch)
    combined_satellites = CombinedSatellites(tuple(_part_satellites(card, epoch) for card in constellation.parts))
    letters: list[str] = []
    for system_satellites in combined_satellites.groups:
        letters += sorted(set(system_satellites.systems))
    shared_systems = [_NAMES[letter] for letter in letters if letters.count(letter) > 1]
    if shared_systems:
        raise InputError(f"two parts of the combined constellation give {shared_systems[0]}")
    repeated_names = [name for name in combined_satellites.names if combined_satellites.names.count(name) > 1]
    if repeated_names:  # draws are keyed by name
        raise InputError(f"two parts of the combined constellation name a satellite {repeated_names[0]}")
    return combined_satellites


def file_digests(constellation: Constellation) -> str:
    """Return digests of the files of a constellation, empty without files; InputError if a file cannot be read."""
    digests = []
    for card in constellation_parts(constellation):
        for file in _files(card):
            file_content = read_bytes(file, DATA_BYTES)
            digest = hashlib.sha256(file_content).hexdigest()
            digests.append(digest)
    return " ".join(digests)


def _files(card: Part) -> tuple[str, ...]:
    """Return the paths of the files of a constellation card."""
    if isinstance(card, RinexConstellation):
        return (card.rinex,) if isinstance(card.rinex, str) else card.rinex
    if isinstance(card, PreciseConstellation):
        return (card.sp3,) if isinstance(card.sp3, str) else card.sp3
    return (card.almanac,) if isinstance(card, AlmanacConstellation) else ()


def _part_satellites(card: Part, epoch: str) -> Satellites:
    """Return the usable satellites of a constellation that is not combined."""
    if isinstance(card, PreciseConstellation):
        return _precise_satellites(card, epoch)
    if isinstance(card, RinexConstellation):
        return _broadcast_satellites(card, epoch)
    return orbits(card, epoch)


def _precise_satellites(card: PreciseConstellation, epoch: str) -> Satellites:
    """Return the satellites of files of precise orbits, in the order of their names."""
    files = [read_positions(file) for file in _files(card)]
    letters = [LETTERS[system] for system in card.systems or LETTERS]
    names = {name for file in files for name in file.r_e if name[0] in letters}
    try:
        return precise_ephemerides(files, sorted(names), gps_seconds(epoch))
    except InputError as error:
        raise InputError(f"{', '.join(_files(card))}: {error}") from None


def _contents(card: RinexConstellation) -> tuple[str, list[NavigationFile], list[Ephemeris | StateVector], list[str]]:
    """Return the names of a card's files, their contents, all records, and the letters of the systems to use."""
    files = _files(card)
    navigation = [read_navigation(file) for file in files]
    records: list[Ephemeris | StateVector] = []
    for file in navigation:
        records += file.ephemerides
        records += file.states
    if card.systems is None:
        letters = sorted({record.name[0] for record in records})
    else:
        letters = [LETTERS[system] for system in card.systems]
    return ", ".join(files), navigation, records, letters


def _broadcast_satellites(card: RinexConstellation, epoch: str) -> Satellites:
    """Return the satellites of navigation files in the order of their names, GLONASS after the other systems."""
    lift_off = gps_seconds(epoch)
    files, navigation, records, letters = _contents(card)
    usable_records: list[Ephemeris | StateVector] = []
    for letter in letters:
        system_records = [record for record in records if record.name[0] == letter]
        latest = nearest_records(system_records, lift_off)
        healthy_records = [record for record in latest.values() if is_usable(record)]
        if not healthy_records:
            fault = "" if latest else _first_fault(navigation, letter)
            raise InputError(fault or f"{files}: no healthy satellite of {_NAMES[letter]}")
        limit = LONGEST_AGE[letter] if card.longest_age is None else card.longest_age
        recent_records = [record for record in healthy_records if abs(_time(record) - lift_off) <= limit]
        if not recent_records:
            ages = [lift_off - _time(record) for record in healthy_records]
            smallest_age = min(ages, key=abs)
            message = _age_message(smallest_age, epoch, _NAMES[letter], limit)
            raise InputError(f"{files}: {message}")
        usable_records += recent_records
    usable_records.sort(key=lambda record: record.name)
    ephemerides = [record for record in usable_records if isinstance(record, Ephemeris)]
    states = [record for record in usable_records if isinstance(record, StateVector)]
    if not states:
        return broadcast_ephemerides(ephemerides, lift_off)
    if not ephemerides:
        return integrated_states(states, lift_off)
    kepler_satellites = broadcast_ephemerides(ephemerides, lift_off)
    glonass_satellites = integrated_states(states, lift_off)
    return CombinedSatellites((kepler_satellites, glonass_satellites))


def _first_fault(navigation: list[NavigationFile], letter: str) -> str:
    """Return the fault of the first broken record of a system, empty if there is none."""
    for file in navigation:
        for record in file.broken_records:
            if record.name[0] == letter:
                return record.fault
    return ""


def is_usable(item: Ephemeris | StateVector) -> bool:
    """Return whether a single-frequency user (L1, E1, B1 or G1) may use a satellite.

    Its signal on that frequency must be healthy, and its accuracy predicted.
    """
    if isinstance(item, StateVector):
        return item.health == 0.0
    if item.name[0] == "E":
        is_healthy = not int(item.health) & _HEALTH_E1
        return is_healthy and 0.0 <= item.accuracy < _NO_SISA
    return item.health == 0.0 and 0.0 <= item.accuracy <= _NO_URA


def broken_record_remarks(constellation: Constellation) -> list[str]:
    """Return a remark for each navigation file with broken records of satellites in use, except unhealthy satellites.

    InputError if a file cannot be read.
    """
    lines = []
    for card in constellation_parts(constellation):
        if not isinstance(card, RinexConstellation):
            continue
        systems = LETTERS if card.systems is None else card.systems
        letters = [LETTERS[system] for system in systems]
        for file in _files(card):
            broken_records = []
            for record in read_navigation(file).broken_records:
                if record.name[0] in letters and not record.is_unhealthy:
                    broken_records.append(record)
            if broken_records:
                satellite_names = {record.name for record in broken_records}
                names = ", ".join(sorted(satellite_names))
                plural = "s" if len(broken_records) > 1 else ""
                count = f"{len(broken_records)} broken record{plural} of {names}"
                place = broken_records[0].fault.removeprefix(f"{file}:")
                lines.append(f"{file}: {count} left out, the first at line {place}")
    return lines


_Item = TypeVar("_Item", bound=Ephemeris | StateVector)


def nearest_records(items: Iterable[_Item], time: float) -> dict[str, _Item]:
    """Return by name the record of each satellite whose reference time is nearest to `time` (s of GPS time).

    Among Galileo records with the same reference time that of the message on E1 (I/NAV) is preferred.
    """
    records: dict[str, tuple[tuple[float, bool], _Item]] = {}
    for item in items:
        distance = abs(_time(item) - time)
        rank = (distance, _is_other_message(item))
        if item.name not in records or rank < records[item.name][0]:
            records[item.name] = (rank, item)
    return {name: item for name, (_, item) in records.items()}


def _is_other_message(item: Ephemeris | StateVector) -> bool:
    """Return whether a Galileo record is from a message other than that on E1."""
    if not isinstance(item, Ephemeris) or item.name[0] != "E":
        return False
    return not int(item.elements["data_source"]) & _INAV_E1


def _time(item: Ephemeris | StateVector) -> float:
    """Return the reference time of a record, s of GPS time."""
    return item.toe if isinstance(item, Ephemeris) else item.time


def _age_message(age: float, epoch: str, system: str, limit: float) -> str:
    """Return the message that the nearest ephemeris of a system is older or younger than the limit.

    Parameters
    ----------
    age : float
        Lift-off minus reference time of the ephemeris (s).
    epoch : str
        Lift-off (ISO 8601, UTC).
    system : str
        Name of the system.
    limit : float
        Largest age (s).
    """
    hours = abs(age) / 3600.0
    days = abs(age) / 86400.0
    size = f"{hours:.1f} h" if abs(age) < 48.0 * 3600.0 else f"{days:.1f} days"
    side = "after" if age > 0.0 else "before"
    distance = f"{size} {side}"
    limit_hours = f"{limit / 3600.0:g} h"
    return f"the lift-off {epoch} is {distance} the nearest ephemeris of {system}; longest_age allows {limit_hours}"


def time_offsets(constellation: Constellation, systems: tuple[str, ...], epoch: str, t: Floats) -> Floats:
    """Return the errors (n_epoch, n_sat, 2) of ranges (m) and range rates (m/s) due to ignored offsets of system times.

    If the time of a system is ahead of GPS time, its signals are marked with a later transmission time, so that the
    range appears shorter.

    Parameters
    ----------
    constellation : card
    systems : (n_sat,)
        Letters of the systems of the satellites.
    epoch : str
        Lift-off (ISO 8601, UTC).
    t : (n_epoch,) s since lift-off

    Raises
    ------
    InputError
        The correction for a system is to be ignored, but no file has one.
    """
    errors = np.zeros((t.size, len(systems), 2))
    for card in constellation_parts(constellation):
        if not isinstance(card, RinexConstellation) or card.time_correction == "applied":
            continue
        files, navigation, _, letters = _contents(card)
        for letter in sorted({*letters} - {"G"}):
            lift_off = gps_seconds(epoch)
            offset = _nearest_offset(navigation, letter, lift_off)
            if offset is None:
                raise InputError(f"{files}: no TIME SYSTEM CORR between {_NAMES[letter]} and GPS time to ignore")
            age = lift_off + t - offset.time if offset.drift != 0.0 else np.zeros(t.size)
            bias = offset.bias + offset.drift * age
            is_of_system = np.array(systems) == letter
            range_error = -SPEED_OF_LIGHT * bias
            errors[:, is_of_system, 0] = range_error[:, None]
            errors[:, is_of_system, 1] = -SPEED_OF_LIGHT * offset.drift
    return errors


def _nearest_offset(navigation: list[NavigationFile], letter: str, time: float) -> TimeOffset | None:
    """Return the offset of a system's time whose reference time is nearest to a time; None if no file has an offset.

    Parameters
    ----------
    navigation : list of NavigationFile
    letter : str
        Letter of the system.
    time : float
        s of GPS time.
    """
    offsets = [offset for file in navigation for offset in file.offsets if offset.system == letter]
    return min(offsets, key=lambda offset: abs(time - offset.time), default=None)


def clock_relativity(constellation: Constellation, epoch: str, transmission_times: Floats) -> Floats:
    """Return the relativistic clock term of the satellites, (..., n_sat) s; zero for constellations without it.

    Parameters
    ----------
    constellation : card
    epoch : str
        Lift-off (ISO 8601, UTC).
    transmission_times : (..., n_sat) s since lift-off
        Times of transmission.

    Raises
    ------
    InputError
        As for `satellites`.
    """
    terms = np.zeros(transmission_times.shape)
    first = 0
    for card in constellation_parts(constellation):
        system_satellites = _part_satellites(card, epoch)
        end = first + len(system_satellites.names)
        if card.relativity:
            terms[..., first:end] = system_satellites.relativity(transmission_times[..., first:end])
        first = end
    return terms
