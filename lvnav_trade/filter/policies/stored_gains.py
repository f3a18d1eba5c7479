"""Stored gains in place of those of a covariance, computed on one flight and scheduled by its events or by time."""

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from typing import Any, Literal, NamedTuple

import numpy as np
from pydantic import Field

from lvnav_trade.quantities.records import Bools, Floats
from lvnav_trade.quantities.units import Card, NamedCard

# Measurements of a schedule that names none, in the order of their updates; frame i.
ROWS = ("position x", "position y", "position z", "velocity x", "velocity y", "velocity z")

Column = tuple[float, ...]


class GainKnot(Card):
    """Gains at one time, `since` s after the event of the segment: for each measurement the gain of every state, SI."""

    since: float
    gain: tuple[Column, ...]


class GainSegment(Card):
    """Gains from an event on (by time: from lift-off on): linear between knots, constant before and after them."""

    event: str
    knots: tuple[GainKnot, ...] = Field(min_length=1)

    def _faults(self) -> Iterator[str]:
        if any(later_knot.since <= earlier_knot.since for earlier_knot, later_knot in pairwise(self.knots)):
            yield f"segment {self.event!r}: the times of its knots should rise"


class GainSchedule(NamedCard):
    """Schedule of stored gains: gain of each state for each measurement, computed once on the flight in `source`."""

    flight: str = Field("", description="name of the trajectory for which the gains were computed")
    flight_digest: str = Field(
        "", description="digest of that trajectory; on another trajectory, the filter gives a warning"
    )
    by: Literal["event", "time"] = Field("event", description="reference of the times of a segment")
    states: tuple[str, ...] = Field(description="states in the order of the gains, such as 'velocity x'")
    measurements: tuple[str, ...] = Field(
        ROWS, description="measurements in the order of the gains: an axis of the solution, 'G05 range', 'altitude'"
    )
    segments: tuple[GainSegment, ...] = Field(min_length=1)
    digest: str = Field(description="digest of states and segments; gains that were changed by hand are refused")

    def _faults(self) -> list[str]:
        digest = schedule_digest(self.states, self.segments, self.measurements)
        n = len(self.states)
        m = len(self.measurements)
        gains = [knot.gain for segment in self.segments for knot in segment.knots]
        faults = []
        if digest != self.digest:
            faults.append(f"its numbers have digest {digest}, not {self.digest}: compute the schedule again")
        if any(len(column) != n for gain in gains for column in gain):
            faults.append(f"the gain of a measurement should have {n} numbers, one a state")
        if any(len(gain) != m for gain in gains):
            faults.append(f"a knot should have {m} gains, one a measurement")
        return faults


# Fraction of a gain's largest magnitude on the flight below which it is set to zero. Rounding errors reach 2.5e-11 of
# that magnitude, so smaller gains have fewer correct digits than are stored, and differ between processors.
NEGLIGIBLE = 1e-6


class StoredGains(NamedTuple):
    """Stored gains of a flight, as arrays for the kernels.

    gain : (n_epoch, n_channel, n_state) SI. Gain of each state.
    is_stored : (n_channel,). Whether the schedule has gains for the channel; other channels are not processed.
    """

    gain: Floats
    is_stored: Bools


def schedule_digest(states: Sequence[str], segments: Sequence[GainSegment], measurements: Sequence[str] = ROWS) -> str:
    """Return the digest of a schedule's content, 16 hexadecimal digits."""
    numbers = []
    for segment in segments:
        knots = [[knot.since, knot.gain] for knot in segment.knots]
        numbers.append([segment.event, knots])
    content: list[Any] = [list(states)]
    if tuple(measurements) != ROWS:
        content.append(list(measurements))
    content.append(numbers)
    return hashlib.sha256(json.dumps(content).encode()).hexdigest()[:16]


def evaluate_schedule(schedule: GainSchedule, t: Floats, events: Mapping[str, float]) -> Floats:
    """Return the gains of a schedule at given times of a flight.

    By event, the segment is that of the last event, and the gains are those at the time since that event. Before the
    first event they are the first gains of its segment.

    Parameters
    ----------
    schedule
        Schedule of gains.
    t
        (n,) s since lift-off.
    events
        s since lift-off, by name of the event.

    Returns
    -------
    ndarray
        (n, n_measurement, n_state) SI.

    Raises
    ------
    ValueError
        If the flight lacks an event of the schedule; the message names it.
    """
    starts = np.zeros(len(schedule.segments))
    if schedule.by == "event":
        names = [segment.event for segment in schedule.segments]
        missing = [name for name in names if name not in events]
        if missing:
            raise ValueError(f"the gain schedule {schedule.name!r} needs the event {missing[0]!r}")
        starts = np.array([events[name] for name in names])
    order = np.argsort(starts, kind="stable")
    last_started = np.searchsorted(starts[order], t + 1e-6, side="right") - 1
    place_of_segment = np.clip(last_started, 0, None)
    gains = np.empty((len(t), len(schedule.measurements), len(schedule.states)))
    for place, k in enumerate(order):
        in_segment = place_of_segment == place
        elapsed_time = t[in_segment] - starts[k]
        gains[in_segment] = _interpolate(schedule.segments[k], elapsed_time)
    return gains


def _interpolate(segment: GainSegment, elapsed_time: Floats) -> Floats:
    """Return the gains (n, n_measurement, n_state) of a segment at times (n,) s after its event, linear in time."""
    times = np.array([knot.since for knot in segment.knots])
    gains = np.array([knot.gain for knot in segment.knots])
    last = len(times) - 1
    next_knot = np.searchsorted(times, elapsed_time, side="right")
    next_index = np.clip(next_knot, min(1, last), last)
    previous_index = np.maximum(next_index - 1, 0)
    span = np.where(next_index > previous_index, times[next_index] - times[previous_index], 1.0)
    time_from_knot = elapsed_time - times[previous_index]
    fraction = np.clip(time_from_knot / span, 0.0, 1.0)[:, None, None]
    change = gains[next_index] - gains[previous_index]
    return np.asarray(gains[previous_index] + fraction * change)


def thin_knots(t: Floats, gains: Floats, tolerance: float, negligible: Floats | float = 0.0) -> list[int]:
    """Return the indices of knots that represent gains by linear interpolation (Douglas and Peucker).

    The sample with the largest error becomes a knot, until no error exceeds the tolerance.

    Parameters
    ----------
    t
        (n,) s. Times.
    gains
        (n, ...). Gains at these times.
    tolerance
        Largest error, as a fraction of the largest magnitude of each element.
    negligible
        (...,). Error that is always allowed, in the unit of the gain.
    """
    flat = gains.reshape(len(t), -1)
    # a scale of at least negligible / tolerance, so that an error of `negligible` is within the tolerance
    least_scale = np.maximum(np.ravel(negligible) / tolerance, 1e-300)
    largest = np.abs(flat).max(axis=0)
    relative_gains = flat / np.maximum(largest, least_scale)
    end = len(t) - 1
    knots = {0, end}
    open_spans = [(0, end)]
    while open_spans:
        first, last = open_spans.pop()
        if last - first < 2:
            continue
        inner = np.arange(first + 1, last)
        span = t[last] - t[first]
        fraction = ((t[inner] - t[first]) / span)[:, None]
        change = relative_gains[last] - relative_gains[first]
        line = relative_gains[first] + fraction * change
        error = np.abs(relative_gains[inner] - line).max(axis=1)
        if error.max() > tolerance:
            middle = int(inner[np.argmax(error)])
            knots.add(middle)
            open_spans.append((first, middle))
            open_spans.append((middle, last))
    return sorted(knots)


class GainHistory(NamedTuple):
    """Gains of a filter along a flight.

    states : Names of the states (n_state).
    measurements : Names of the measurements (n_measurement).
    t : (n,) s since lift-off. Times of the gains.
    gains : (n, n_measurement, n_state).
    """

    states: Sequence[str]
    measurements: Sequence[str]
    t: Floats
    gains: Floats


def build_gain_schedule(
    name: str,
    source: str,
    time_reference: Literal["event", "time"],
    history: GainHistory,
    events: Mapping[str, float],
    tolerance: float = 0.02,
) -> GainSchedule:
    """Return a schedule of the gains of a filter along a flight.

    Gains are rounded to four digits. Gains below `NEGLIGIBLE` of their largest magnitude on the flight are zero.

    Parameters
    ----------
    name, source
        Name of the schedule, and of the flight that it was computed on.
    time_reference
        Whether the times of a segment count from its event or from lift-off.
    history
        Gains along the flight.
    events
        s since lift-off, by name of the event.
    tolerance
        Largest error of the linear interpolation between knots, as a fraction of the largest gain in the segment.
    """
    t = history.t
    negligible = NEGLIGIBLE * np.abs(history.gains).max(axis=0)
    gains = np.where(np.abs(history.gains) < negligible, 0.0, history.gains)
    starts = [("liftoff", 0.0)] if time_reference == "time" else _segment_starts(t, events)
    segments = []
    for k, (event, start) in enumerate(starts):
        first_time = start if k > 0 else -np.inf  # gains before the first event belong to its segment
        end = starts[k + 1][1] if k + 1 < len(starts) else np.inf
        samples = np.flatnonzero(_is_within(t, first_time, end))
        if not samples.size:
            continue
        segment_gains = gains[samples]
        elapsed_time = t[samples] - (0.0 if time_reference == "time" else start)
        knots = []
        for i in thin_knots(elapsed_time, segment_gains, tolerance, negligible):
            knot_time = round(float(elapsed_time[i]), 6)
            knots.append(GainKnot(since=knot_time, gain=_round_gain(segment_gains[i])))
        segments.append(GainSegment(event=event, knots=tuple(knots)))
    states = tuple(history.states)
    return GainSchedule(
        name=name,
        source=source,
        by=time_reference,
        states=states,
        measurements=tuple(history.measurements),
        segments=tuple(segments),
        digest=schedule_digest(states, segments, history.measurements),
    )


def _segment_starts(t: Floats, events: Mapping[str, float]) -> list[tuple[str, float]]:
    """Return the events in order of time, with their times, without those (but the first) that no sample follows."""
    sorted_events = sorted((start, event) for event, start in events.items())
    starts = []
    for k, (start, event) in enumerate(sorted_events):
        end = sorted_events[k + 1][0] if k + 1 < len(sorted_events) else np.inf
        if k == 0 or np.any(_is_within(t, start, end)):
            starts.append((event, start))
    return starts


def _is_within(t: Floats, start: float, end: float) -> Bools:
    """Return which times are in [start, end), (n,); a microsecond allows for rounding."""
    return (t >= start - 1e-6) & (t < end - 1e-6)


def _round_gain(gain: Floats) -> tuple[Column, ...]:
    """Return the gains of a knot, rounded to four digits."""
    return tuple(tuple(float(f"{value:.3e}") for value in column) for column in gain)
