"""A reference from a speed and altitude record: the card, and the flight rebuilt from it."""

from __future__ import annotations

import math
import re
from typing import Annotated, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator
from scipy.optimize import root_scalar

from lvnav_trade.errors import InputError
from lvnav_trade.frames import gmst
from lvnav_trade.units import Angle, Card, Duration, Epoch, Length, Pause, Speed
from lvnav_trade.world.ascent.groundtrack import Course, course, end_state, pointing, tracks_of
from lvnav_trade.world.ascent.launch import achieved, pad_track, phases_of
from lvnav_trade.world.ascent.record import Record, read
from lvnav_trade.world.ascent.smoothing import Climb, smooth
from lvnav_trade.world.ascent.vehicle import STANDARD_GRAVITY, Roll, Site
from lvnav_trade.world.oscillation import OscillationCard
from lvnav_trade.world.truth import Phase, Trajectory, motion

Floats = NDArray[np.float64]

_BREAK = re.compile(r"stage\d+_(ignition|cutoff)(_\d+)?$")


class RecordedAscent(Card):
    """A trajectory rebuilt from a record of Earth-relative speed and altitude against time.

    The file is CSV with the header ``time_s,speed_m_s,altitude_m``; lines that begin with # are comments. Altitude
    counts from the site. Thrust is taken to jump at the events ``stageN_ignition`` and ``stageN_cutoff``, and to be off
    from a cut-off to the next ignition.
    """

    kind: Literal["profile"] = "profile"
    name: str
    source: str
    epoch: Epoch = Field(description="lift-off, ISO 8601 UTC")
    site: Site
    azimuth: Angle | None = Field(None, description="of the ground track at the site, from north over east")
    inclination: Angle | None = Field(None, description="of the final orbit; gives the azimuth where that is not set")
    direction: Literal["ascending", "descending"] = "ascending"
    file: str = Field(description="the record", json_schema_extra={"path": True})
    events: dict[str, Duration] = Field(description="times of the named events, from lift-off")
    speed_noise: Annotated[Speed, Field(gt=0.0)] = Field(description="one-sigma error of a recorded speed")
    altitude_noise: Annotated[Length, Field(gt=0.0)] = Field(description="one-sigma error of a recorded altitude")
    pad_hold: Pause = 60.0
    roll: Roll = Roll()
    coast_after_injection: Annotated[Duration, Field(gt=0.0)] = 20.0
    oscillation: tuple[OscillationCard, ...] = Field((), description="coning and vibration, by parts of the flight")

    @model_validator(mode="after")
    def _aimed(self) -> Self:
        if (self.azimuth is None) == (self.inclination is None):
            raise ValueError("give the azimuth or the inclination, one of the two")
        if "injection" not in self.events:
            raise ValueError("events must name injection")
        return self


def rebuild(card: RecordedAscent) -> Trajectory:
    """Return the flight of a recorded ascent.

    Altitude and level speed are fitted together to the record; the ground track is a great circle of the ellipsoid's
    normals (fixed to the Earth) from the site by the azimuth; the body's x axis lies along the specific force, drag and
    thrust not being distinguished, and turns smoothly through the coasts. InputError where the record is broken or does
    not reach injection, or the inclination is out of reach.
    """
    record = _until_injection(card, read(card.file))
    breaks = sorted(time for name, time in card.events.items() if _BREAK.match(name) and time < record.t[-1])
    coasts = _coasts(card, breaks)
    climb = smooth(record, breaks, coasts, card.speed_noise, card.altitude_noise)
    way = course(card.site, _azimuth(card, climb, breaks), climb, breaks, gmst(card.epoch))
    tracks = tracks_of(way, card.coast_after_injection)
    pad = [pad_track(card.site, way.theta0, card.pad_hold)] if card.pad_hold > 0.0 else []
    attitude = pointing(card.site, way, tracks, coasts, card.roll, card.pad_hold)
    ground = phases_of(pad, attitude)
    phases = (*ground, *(Phase(k.name, k.start, k.end, k.position, attitude) for k in tracks))
    events = dict(sorted({"liftoff": 0.0, **card.events}.items(), key=lambda item: item[1]))
    flight = Trajectory(phases, events, way.theta0, card.epoch)
    flight.facts.update(_facts(card, record, climb, way, flight))
    return flight


def _until_injection(card: RecordedAscent, record: Record) -> Record:
    """Return the record from lift-off to injection, both included."""
    injection = card.events["injection"]
    usual = float(np.median(np.diff(record.t)))
    for name, time in card.events.items():
        if not 0.0 <= time <= injection:
            raise InputError(f"{card.name}: event {name!r} at {time:g} s is outside lift-off to injection")
    if record.t[0] > usual or record.t[-1] < injection - usual:
        raise InputError(
            f"{card.file}: the record goes from {record.t[0]:g} to {record.t[-1]:g} s, lift-off to injection at "
            f"{injection:g} s is needed"
        )
    keep = (record.t > 0.0) & (record.t < injection)
    t = np.concatenate([[0.0], record.t[keep], [injection]])
    speed, altitude = (np.interp(t, record.t, column) for column in record[1:])
    return Record(t, speed, altitude)


def _coasts(card: RecordedAscent, breaks: list[float]) -> list[tuple[float, float]]:
    """Return the coasts, each from a cut-off to the next ignition, or to injection."""
    cutoffs = sorted(time for name, time in card.events.items() if _BREAK.match(name) and "cutoff" in name)
    ends = [*breaks[1:], card.events["injection"]]
    return [(begin, end) for begin, end in zip(breaks, ends, strict=False) if begin in cutoffs]


def _azimuth(card: RecordedAscent, climb: Climb, breaks: list[float]) -> float:
    """Return the azimuth of the card, or the one that ends in the card's inclination."""
    if card.azimuth is not None:
        return card.azimuth
    assert card.inclination is not None
    inclination = card.inclination
    sine = math.cos(inclination) / math.cos(card.site.latitude)
    if abs(sine) >= 1.0:
        raise InputError(
            f"{card.name}: an inclination of {math.degrees(inclination):.2f} deg cannot be reached from a latitude of "
            f"{math.degrees(card.site.latitude):.2f} deg"
        )
    first = math.asin(sine) if card.direction == "ascending" else math.pi - math.asin(sine)

    def excess(azimuth: float) -> float:
        return achieved(end_state(course(card.site, azimuth, climb, breaks, gmst(card.epoch))))[2] - inclination

    found = root_scalar(excess, x0=first, x1=first + 0.01, xtol=1e-10, maxiter=30)
    if not found.converged or abs(excess(found.root)) > 1e-6:
        raise InputError(f"{card.name}: no azimuth ends in an inclination of {math.degrees(inclination):.2f} deg")
    return float(found.root)


def _facts(
    card: RecordedAscent, record: Record, climb: Climb, way: Course, flight: Trajectory
) -> dict[str, float | str]:
    """Return what the report says of the flight and of the smoothing, SI."""
    speed = climb.speed(record.t) - record.speed
    altitude = climb.altitude(record.t) - record.altitude
    low, high, inclination = achieved(end_state(way))
    powered = motion(flight, np.linspace(0.0, flight.end, 4000))
    facts: dict[str, float | str] = {
        "record": card.source,
        "perigee_m": low,
        "apogee_m": high,
        "inclination_rad": inclination,
        "azimuth_rad": way.azimuth,
        "max_load_g": float(np.max(np.linalg.norm(powered.f_b, axis=1))) / STANDARD_GRAVITY,
        "smoothing_misfit": climb.misfit,
    }
    for name, unit, residual in (("speed", "m_s", speed), ("altitude", "m", altitude)):
        worst = int(np.argmax(np.abs(residual)))
        facts[f"smoothing_{name}_rms_{unit}"] = float(np.sqrt(np.mean(residual**2)))
        facts[f"smoothing_{name}_worst_{unit}"] = float(residual[worst])
        facts[f"smoothing_{name}_worst_at_s"] = float(record.t[worst])
    return facts
