"""Conditions that switch a sensor or a fault: events, times, altitude, speed, dynamic pressure."""

import difflib
import re
from collections.abc import Callable, Iterable, Mapping
from functools import cached_property
from itertools import pairwise
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, ConfigDict, Field

from lvnav_trade.quantities.errors import InputError, Mistake
from lvnav_trade.quantities.records import Floats
from lvnav_trade.quantities.units import Angle, Card, Length, Pressure, SpeedSigma, parse

_TIMED = re.compile(r"\s*(?P<name>[A-Za-z_]\w*)\s*(?:(?P<sign>[+-])\s*(?P<offset>\S.*))?$")


def resolve(text: str, events: Mapping[str, float]) -> float:
    """Return the time, in s since lift-off, of an event, an event plus or minus a duration, or a plain time.

    Parameters
    ----------
    text : str
        Such as ``"stage1_cutoff"``, ``"stage1_cutoff + 20 s"`` or ``"100 s"``.
    events : mapping
        Times (s) of the events of the flight.

    Raises
    ------
    InputError
        The flight has no such event (the message offers the nearest name), or the duration has no unit.
    """
    match = _TIMED.match(text)
    if match is None:
        return _seconds(text, text)
    name = match["name"]
    if name not in events:
        near = difflib.get_close_matches(name, list(events), n=1, cutoff=0.5)
        hint = f"did you mean {near[0]!r}?" if near else f"the flight has {', '.join(events)}"
        raise InputError(f"{text!r}: no event {name!r} ({hint})")
    duration = _seconds(match["offset"], text) if match["offset"] else 0.0
    offset = -duration if match["sign"] == "-" else duration
    return events[name] + offset


def _seconds(duration: str, text: str) -> float:
    try:
        return parse(duration.strip(), "s")
    except ValueError as error:
        raise InputError(f"{text!r} is not a time: {error}") from None


def _check_instant(text: str) -> str:
    """Return the text after a check of its duration; ValueError if that is no time. Events are checked later."""
    match = _TIMED.match(text)
    duration = text if match is None else match["offset"]
    try:
        parse((duration or "0 s").strip(), "s")
    except ValueError as error:
        raise ValueError(f"{text!r} is not a time: {error}") from None
    return text


Instant = Annotated[str, AfterValidator(_check_instant)]
"""Text for `resolve`. The unit is checked when the card is read, the event when the flight is known."""


Mask = NDArray[np.bool_]
Intervals = tuple[tuple[float, float], ...]
"""Intervals of time (s) in order, each with its start and without its end; infinite without a bound."""

ROUNDING = 1e-6  # s; an epoch closer than this to the edge of an interval counts as on it
_STEP, _MOST = 0.1, 20_000  # s between samples of a flight, and their largest number
_HALVINGS = 40  # bisections of a step: far below rounding of a time


class Conditions(Card):
    """Conditions that switch a sensor or fault on. It is on while every given condition is true."""

    model_config = ConfigDict(serialize_by_alias=True)

    from_: Instant | None = Field(
        None, alias="from", description="active from this time, such as '100 s', or event: 'stage1_cutoff + 20 s'"
    )
    until: Instant | None = Field(None, description="active until this time or event, in the same form as `from`")
    above: Length | None = Field(None, description="active at and above this altitude above the ellipsoid")
    below: Length | None = Field(None, description="active below this altitude above the ellipsoid")
    speed_above: SpeedSigma | None = Field(None, description="active at and above this speed relative to the Earth")
    speed_below: SpeedSigma | None = Field(None, description="active below this speed relative to the Earth")
    dynamic_pressure_above: Pressure | None = Field(
        None, description="active at and above this dynamic pressure (US Standard Atmosphere 1976, no wind)"
    )
    dynamic_pressure_below: Pressure | None = Field(None, description="active below this dynamic pressure")

    @property
    def condition_keys(self) -> tuple[str, ...]:
        """Keys of the conditions that the card gives, as the user writes them."""
        names = ("from_", "until", *BOUNDS, *ELEVATIONS)
        return tuple(name.rstrip("_") for name in names if getattr(self, name, None) is not None)

    def _faults(self) -> Iterable[str]:
        for low, high in PAIRS:
            lower = getattr(self, low, None)
            upper = getattr(self, high, None)
            if lower is not None and upper is not None and lower >= upper:
                yield f"{low}: should be less than {high}, or it never holds"


class SightConditions(Conditions):
    """Conditions that may also depend on the elevation of a satellite or transmitter."""

    elevation_above: Angle | None = Field(
        None, description="active at and above this elevation of the satellite, or of the vehicle seen from a station"
    )
    elevation_below: Angle | None = Field(
        None, description="active below this elevation of the satellite, or of the vehicle seen from a station"
    )

    def _faults(self) -> Iterable[str]:
        yield from super()._faults()
        for name in ELEVATIONS:
            if abs(getattr(self, name) or 0.0) > 0.5 * np.pi:
                yield f"{name}: an elevation is between -90 deg and 90 deg"

    @property
    def elevation_keys(self) -> tuple[str, ...]:
        """Keys of the conditions on elevation that the card gives."""
        return tuple(name for name in ELEVATIONS if getattr(self, name) is not None)

    def meets_elevation(self, elevation: Floats) -> Mask:
        """Return which elevations (...,) rad meet the conditions on elevation, (...,) bool."""
        low = -np.inf if self.elevation_above is None else self.elevation_above
        high = np.inf if self.elevation_below is None else self.elevation_below
        return np.asarray((elevation >= low) & (elevation < high))


BOUNDS = {
    "above": (0, True),
    "below": (0, False),
    "speed_above": (1, True),
    "speed_below": (1, False),
    "dynamic_pressure_above": (2, True),
    "dynamic_pressure_below": (2, False),
}
"""Bounds on the flight: row of `FlightProfile.values`, and whether the condition is true above the bound."""
ELEVATIONS = ("elevation_above", "elevation_below")
PAIRS = tuple((f"{name}above", f"{name}below") for name in ("", "speed_", "dynamic_pressure_", "elevation_"))
_SHOWN = (("altitude", 1e-3, "km"), ("speed", 1.0, "m/s"), ("dynamic pressure", 1e-3, "kPa"))


class FlightProfile:
    """A flight as conditions evaluate it.

    Parameters
    ----------
    instants : mapping
        Times (s since lift-off) of the events by name, with ``start`` and ``end``.
    evaluate : callable, optional
        Function of times (n,) s that returns altitude (m), speed relative to the Earth (m/s) and dynamic pressure (Pa)
        as (3, n). Required by conditions on these quantities.
    """

    def __init__(self, instants: Mapping[str, float], evaluate: Callable[[Floats], Floats] | None = None) -> None:
        self.instants = instants
        self._evaluate = evaluate

    def begin(self, start: float) -> float:
        """Return the start (s) of an interval; for an interval without a start that of the flight."""
        return self.instants["start"] if start == -np.inf else start

    @cached_property
    def times(self) -> Floats:
        """Sampling times (n,) s of the flight."""
        start = self.instants["start"]
        end = self.instants["end"]
        steps = np.ceil((end - start) / _STEP)
        count = int(min(_MOST, max(1.0, steps)))
        return np.linspace(start, end, count + 1)

    @cached_property
    def values(self) -> Floats:
        """Altitude (m), speed (m/s) and dynamic pressure (Pa) at the sampling times, (3, n)."""
        return self.values_at(self.times)

    def values_at(self, t: Floats) -> Floats:
        """Return altitude (m), speed (m/s) and dynamic pressure (Pa) at times t (n,) s, (3, n)."""
        if self._evaluate is None:
            raise ValueError("conditions on altitude, speed or dynamic pressure need a flight")
        return self._evaluate(t)

    def bound_intervals(self, name: str, level: float) -> Intervals:
        """Return the intervals in which the flight meets a bound.

        Crossings are found by bisection between samples. An interval that lasts to the start or end of the flight is
        infinite there.

        Parameters
        ----------
        name : str
            Key of `BOUNDS`.
        level : float
            Value of the bound (SI).
        """
        row, is_above = BOUNDS[name]
        is_met = (self.values[row] >= level) == is_above
        steps = np.flatnonzero(is_met[1:] != is_met[:-1])
        low = self.times[steps]
        high = self.times[steps + 1]
        for _ in range(_HALVINGS if steps.size else 0):
            middle = 0.5 * (low + high)
            value = self.values_at(middle)[row]
            is_met_there = (value >= level) == is_above
            is_before = is_met_there == is_met[steps]
            low = np.where(is_before, middle, low)
            high = np.where(is_before, high, middle)
        edges = [-np.inf, *high.tolist(), np.inf]
        intervals = tuple(pairwise(edges))  # the condition is true in every other interval
        first = 0 if is_met[0] else 1
        return intervals[first::2]

    def active_intervals(self, conditions: Conditions) -> Intervals:
        """Return the intervals in which all conditions are true, except those on elevation.

        Raises
        ------
        InputError
            The flight has no such event. The path is the field.
        """
        intervals: Intervals = (self.window(conditions),)
        for name in BOUNDS:
            level = getattr(conditions, name)
            if level is not None:
                intervals = intersection(intervals, self.bound_intervals(name, level))
        return intervals

    def window(self, conditions: Conditions) -> tuple[float, float]:
        """Return the interval (s) that the conditions on time define; InputError as in `active_intervals`."""
        start = self._time(conditions, "from", -np.inf)
        end = self._time(conditions, "until", np.inf)
        return start, end

    def _time(self, conditions: Conditions, field: str, default: float) -> float:
        text = conditions.from_ if field == "from" else conditions.until
        return default if text is None else self.time(text, field)

    def time(self, text: str, field: str) -> float:
        """Return the time (s) of a text such as "stage1_cutoff + 20 s"; InputError as in `active_intervals`."""
        try:
            return float(resolve(text, self.instants))
        except InputError as error:
            message = error.records[0].message
            raise InputError(records=[Mistake(message, field)]) from None


def intersection(first: Intervals, second: Intervals) -> Intervals:
    """Return the intersection of two lists of intervals."""
    overlaps = []
    for first_start, first_end in first:
        for second_start, second_end in second:
            start = max(first_start, second_start)
            end = min(first_end, second_end)
            if start < end:
                overlaps.append((start, end))
    return tuple(sorted(overlaps))


def is_inside(intervals: Intervals, t: Floats) -> Mask:
    """Return which times t (n,) s lie in one of the intervals, (n,) bool, with a tolerance of `ROUNDING`."""
    mask = np.zeros(t.shape, dtype=bool)
    for start, end in intervals:
        mask |= (t >= start - ROUNDING) & (t < end - ROUNDING)
    return mask


def never_active_mistake(conditions: Conditions, flight_profile: FlightProfile) -> Mistake | None:
    """Return the input error of conditions that are true at no time of a flight; None if there is such a time.

    The path of the error is the field to change. Conditions on elevation are not examined. InputError as in
    `FlightProfile.active_intervals`.
    """
    first = flight_profile.instants["start"]
    last = flight_profile.instants["end"]
    flight: Intervals = ((first, last),)
    window = flight_profile.window(conditions)
    if not intersection((window,), flight):
        field = "until" if conditions.from_ is None else "from"
        return Mistake(f"holds at no time of the flight ({first:g} s to {last:g} s)", field)
    bounds = [name for name in BOUNDS if getattr(conditions, name) is not None]
    for name in bounds:
        level = getattr(conditions, name)
        if not intersection(flight_profile.bound_intervals(name, level), flight):
            row, _ = BOUNDS[name]
            quantity, factor, unit = _SHOWN[row]
            values = flight_profile.values[row]
            low = factor * np.min(values)
            high = factor * np.max(values)
            return Mistake(f"holds at no time of the flight, whose {quantity} is {low:.4g} to {high:.4g} {unit}", name)
    if bounds and not intersection(flight_profile.active_intervals(conditions), flight):
        return Mistake("holds at no time of the flight together with the other conditions", bounds[0])
    return None
