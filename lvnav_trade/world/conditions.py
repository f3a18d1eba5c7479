"""Conditions that switch a sensor or a fault: times, events, altitude, speed, dynamic pressure."""

from collections.abc import Callable, Iterable, Mapping
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from pydantic import ConfigDict, Field

from lvnav_trade.errors import InputError, Mistake
from lvnav_trade.records import Floats
from lvnav_trade.units import Angle, Card, Length, Pressure, SpeedSigma
from lvnav_trade.world.events import Instant, resolve

Mask = NDArray[np.bool_]
Intervals = tuple[tuple[float, float], ...]
"""Times (s), each from its start (included) to its end (excluded), one after the other; infinite where nothing bounds
them."""

ROUNDING = 1e-6  # s; an epoch that rounding has moved by less still lies on an interval's edge
_STEP, _MOST = 0.1, 20_000  # s between samples of a flight and how many there are at most
_HALVINGS = 40  # of a step: far below rounding of a time


class Conditions(Card):
    """When something is switched on: while all of the conditions hold that are stated."""

    model_config = ConfigDict(serialize_by_alias=True)

    from_: Instant | None = Field(
        None, alias="from", description="on from this time, such as '100 s', or event: 'stage1_cutoff + 20 s'"
    )
    until: Instant | None = Field(None, description="on until this time or event, as `from`")
    above: Length | None = Field(None, description="on at and above this altitude over the ellipsoid")
    below: Length | None = Field(None, description="on below this altitude over the ellipsoid")
    speed_above: SpeedSigma | None = Field(None, description="on at and above this speed relative to the Earth")
    speed_below: SpeedSigma | None = Field(None, description="on below this speed relative to the Earth")
    dynamic_pressure_above: Pressure | None = Field(
        None, description="on at and above this dynamic pressure (US Standard Atmosphere 1976, no wind)"
    )
    dynamic_pressure_below: Pressure | None = Field(None, description="on below this dynamic pressure")

    @property
    def stated(self) -> tuple[str, ...]:
        """The conditions that are stated, as they are written."""
        names = ("from_", "until", *BOUNDS, *ELEVATIONS)
        return tuple(name.rstrip("_") for name in names if getattr(self, name, None) is not None)

    def _faults(self) -> Iterable[str]:
        for low, high in PAIRS:
            least, most = getattr(self, low, None), getattr(self, high, None)
            if least is not None and most is not None and least >= most:
                yield f"{low}: should be less than {high}, or it never holds"


class SightConditions(Conditions):
    """Conditions where something is seen, by its elevation."""

    elevation_above: Angle | None = Field(None, description="on at and above this elevation of what is seen")
    elevation_below: Angle | None = Field(None, description="on below this elevation of what is seen")

    def _faults(self) -> Iterable[str]:
        yield from super()._faults()
        for name in ELEVATIONS:
            if abs(getattr(self, name) or 0.0) > 0.5 * np.pi:
                yield f"{name}: an elevation is between -90 deg and 90 deg"

    @property
    def by_elevation(self) -> tuple[str, ...]:
        """The conditions on elevation that are stated."""
        return tuple(name for name in ELEVATIONS if getattr(self, name) is not None)

    def sights(self, elevation: Floats) -> Mask:
        """Return which elevations (...,) rad meet the conditions on it, (...,)."""
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
"""The bounds of what a flight reaches: row of `Course.values`, and whether it holds above."""
ELEVATIONS = ("elevation_above", "elevation_below")
PAIRS = tuple((f"{name}above", f"{name}below") for name in ("", "speed_", "dynamic_pressure_", "elevation_"))
_SHOWN = (("altitude", 1e-3, "km"), ("speed", 1.0, "m/s"), ("dynamic pressure", 1e-3, "kPa"))


class Course:
    """A flight as conditions see it.

    instants: times (s) of its events by name, ``start`` and ``end`` among them; at: altitude (m), speed relative to the
    Earth (m/s) and dynamic pressure (Pa) at times t (n,) s, as (3, n), needed where something depends on them.
    """

    def __init__(self, instants: Mapping[str, float], at: Callable[[Floats], Floats] | None = None) -> None:
        self.instants, self._at = instants, at

    def begin(self, start: float) -> float:
        """Return the start (s) of an interval, that of the flight where it has none."""
        return self.instants["start"] if start == -np.inf else start

    @cached_property
    def times(self) -> Floats:
        """Times (n,) s at which the flight is sampled."""
        start, end = self.instants["start"], self.instants["end"]
        count = int(min(_MOST, max(1.0, np.ceil((end - start) / _STEP))))
        return np.linspace(start, end, count + 1)

    @cached_property
    def values(self) -> Floats:
        """Altitude, speed and dynamic pressure at these times, (3, n)."""
        return self.sampled(self.times)

    def sampled(self, t: Floats) -> Floats:
        """Return altitude, speed and dynamic pressure at times t (n,) s, (3, n)."""
        if self._at is None:
            raise ValueError("conditions on altitude, speed or dynamic pressure need a flight")
        return self._at(t)

    def beyond(self, name: str, level: float) -> Intervals:
        """Return when the flight meets a bound of `BOUNDS` (SI), infinite where it begins or ends so."""
        row, up = BOUNDS[name]
        on = (self.values[row] >= level) == up
        at = np.flatnonzero(on[1:] != on[:-1])
        low, high = self.times[at], self.times[at + 1]
        for _ in range(_HALVINGS if at.size else 0):
            middle = 0.5 * (low + high)
            same = ((self.sampled(middle)[row] >= level) == up) == on[at]
            low, high = np.where(same, middle, low), np.where(same, high, middle)
        edges = [-np.inf, *high.tolist(), np.inf]
        return tuple(pair for k, pair in enumerate(pairwise(edges)) if bool(on[0]) == (k % 2 == 0))

    def holding(self, conditions: Conditions) -> Intervals:
        """Return when all conditions hold, those on elevation apart.

        InputError, with the field as its path, where an event is not one of the flight.
        """
        found: Intervals = (self.window(conditions),)
        for name in BOUNDS:
            level = getattr(conditions, name)
            if level is not None:
                found = both(found, self.beyond(name, level))
        return found

    def window(self, conditions: Conditions) -> tuple[float, float]:
        """Return the interval that the conditions on time leave; InputError as of `holding`."""
        return self._time(conditions, "from", -np.inf), self._time(conditions, "until", np.inf)

    def _time(self, conditions: Conditions, field: str, otherwise: float) -> float:
        text = conditions.from_ if field == "from" else conditions.until
        return otherwise if text is None else self.time(text, field)

    def time(self, text: str, field: str) -> float:
        """Return the time (s) that a text states; InputError with the field as its path where there is none."""
        try:
            return float(resolve(text, self.instants))
        except InputError as error:
            raise InputError(records=[Mistake(error.records[0].message, field)]) from None


def both(one: Intervals, other: Intervals) -> Intervals:
    """Return the times that lie in both."""
    cut = ((max(a, c), min(b, d)) for a, b in one for c, d in other)
    return tuple(sorted((start, end) for start, end in cut if start < end))


def inside(intervals: Intervals, t: Floats) -> Mask:
    """Return which times (n,) s lie in one of the intervals, rounding forgiven, (n,)."""
    found = np.zeros(t.shape, dtype=bool)
    for start, end in intervals:
        found |= (t >= start - ROUNDING) & (t < end - ROUNDING)
    return found


def never(conditions: Conditions, course: Course) -> Mistake | None:
    """Return why conditions hold at no time of a flight, with the field to mend as its path; None where they do.

    InputError as of `Course.holding`. Conditions on elevation are left out.
    """
    first, last = course.instants["start"], course.instants["end"]
    flight: Intervals = ((first, last),)
    if not both((course.window(conditions),), flight):
        field = "until" if conditions.from_ is None else "from"
        return Mistake(f"holds at no time of the flight ({first:g} s to {last:g} s)", field)
    bounds = [name for name in BOUNDS if getattr(conditions, name) is not None]
    for name in bounds:
        if not both(course.beyond(name, getattr(conditions, name)), flight):
            what, factor, unit = _SHOWN[BOUNDS[name][0]]
            low, high = (factor * f(course.values[BOUNDS[name][0]]) for f in (np.min, np.max))
            return Mistake(f"holds at no time of the flight, whose {what} is {low:.4g} to {high:.4g} {unit}", name)
    if bounds and not both(course.holding(conditions), flight):
        return Mistake("holds at no time of the flight together with the other conditions", bounds[0])
    return None
