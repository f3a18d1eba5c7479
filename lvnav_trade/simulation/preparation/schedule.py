"""Schedule of a flight: history times, ticks at which states are stored, and the windows between them."""

import math
from typing import NamedTuple

import numpy as np

from lvnav_trade.quantities.records import Floats, Ints
from lvnav_trade.quantities.state_layout import StateLayout
from lvnav_trade.scenario.filter_models import filter_models
from lvnav_trade.scenario.scenario import Scenario
from lvnav_trade.simulation.preparation.inputs import Schedule
from lvnav_trade.simulation.preparation.options import CloneTimes, CompensatedDelay, clone_times, delays_taken
from lvnav_trade.simulation.preparation.true_flight import TrueFlight, ticks_of
from lvnav_trade.simulation.preparation.tuning import TickWindows, injections, linearisations

_SAME_TICK = 1e-6
"""Fraction of a step by which a time may follow a tick and still count as at the tick."""


def _history_times(events: Floats, start: float, end: float, every: float) -> Floats:
    """Return the grid of history times and the times of events, sorted, without duplicates."""
    grid = np.arange(math.ceil(start / every), math.floor(end / every) + 1) * every
    return np.unique(np.concatenate([[start], grid, events]))


def _history_ticks(t_hist: Floats, events: Floats, start: float, rate: float, n_imu: int, group: int) -> Ints:
    """Return the ticks (n_hist,) at which errors are recorded, ascending.

    For an event it is the end of the first strapdown step at or after it, because the thrust acts until a cut-off. For
    any other time it is the nearest tick.
    """
    after = np.ceil((t_hist - start) * rate / group - _SAME_TICK).astype(np.int64) * group
    nearest = ticks_of(t_hist, start, rate, n_imu, group)
    ticks = np.where(np.isin(t_hist, events), np.clip(after, 0, n_imu), nearest)
    return np.asarray(np.maximum.accumulate(ticks))


class _Windows(NamedTuple):
    """Windows of a flight, (n_window,) each: first tick, number of ticks; epoch, history time at the end (-1 none)."""

    first_tick: Ints
    n_tick: Ints
    epoch: Ints
    hist: Ints


def _cut(n_imu: int, per_window: int, hist_tick: Ints, epoch_tick: Ints, kept: Ints, group: int) -> _Windows:
    """Divide the flight into windows.

    Windows end at covariance steps (rounded to strapdown steps of `group` ticks), epochs, history times, and ticks at
    which a state is stored. A second history time at the same tick gets a window without ticks.
    """
    steps = np.rint(np.arange(0, n_imu, per_window) / group).astype(np.int64) * group
    bounds = np.unique(np.concatenate([steps, hist_tick, epoch_tick, kept, [0, n_imu]]))
    begin = np.concatenate([[0], bounds[:-1]])
    epoch = np.full(bounds.size, -1)
    hist = np.full(bounds.size, -1)
    epoch[np.searchsorted(bounds, epoch_tick)] = np.arange(epoch_tick.size)
    seconds = np.ones(hist_tick.size, dtype=bool)
    seconds[np.unique(hist_tick, return_index=True)[1]] = False
    hist[np.searchsorted(bounds, hist_tick[~seconds])] = np.flatnonzero(~seconds)
    kept_rows = (bounds > 0) | (hist >= 0)
    rows = np.stack([begin, bounds - begin, epoch, hist], axis=1)[kept_rows]
    none = np.zeros(np.count_nonzero(seconds), dtype=np.int64)
    more = np.stack([hist_tick[seconds], none, none - 1, np.flatnonzero(seconds)], axis=1)
    order = np.argsort(np.concatenate([bounds[kept_rows], hist_tick[seconds]]), kind="stable")
    return _Windows(*np.ascontiguousarray(np.concatenate([rows, more])[order].T))


def _with_steps(t_hist: Floats, steps: Floats, start: float, rate: float, n_imu: int, group: int) -> Floats:
    """Return history times and covariance steps (s), sorted; a step at the tick of a history time is omitted."""
    grid = (start, rate, n_imu, group)
    return np.sort(np.concatenate([t_hist, steps[~np.isin(ticks_of(steps, *grid), ticks_of(t_hist, *grid))]]))


class Times(NamedTuple):
    """Schedule of a flight: history times and windows.

    t_hist : (n_hist,) s since lift-off. History times.
    hist_tick : (n_hist,). Ticks at which errors are recorded for them.
    schedule : Windows of IMU ticks.
    lengths : (n_length,) s. Window lengths that occur.
    injected : (n_injection, n_state) SI squared. Variances added to the filter's states at changes of region.
    delayed : Delays that the filter compensates.
    kept : For each of these delays, the times at which states are stored.
    """

    t_hist: Floats
    hist_tick: Ints
    schedule: Schedule
    lengths: Floats
    injected: Floats
    delayed: tuple[CompensatedDelay, ...]
    kept: tuple[CloneTimes, ...]


def times_of(
    scenario: Scenario, flight: TrueFlight, layout: StateLayout, history: float, every_step_beside: Floats | None = None
) -> Times:
    """Return the schedule of a flight.

    Parameters
    ----------
    scenario, flight
        Validated model of the case, and its true flight.
    layout
        States of the filter.
    history
        s. Interval of the history times; every event time is added.
    every_step_beside
        As in `prepare`.
    """
    card, ref, (_, tick, n_imu, group) = scenario.filter, flight.reference, flight.epochs
    rate = scenario.imu.rate
    start = float(ref.t[0])
    delayed = delays_taken(scenario, flight.epochs.t, flight.stamped, flight.devices)
    stored_times = clone_times(scenario, flight.epochs.t, delayed, ref.t, group)
    per_window = max(1, round(rate / card.covariance_rate))
    # an event within the last fraction of a tick has the errors of the last tick
    end = flight.trajectory.end
    events = np.array([t for t in flight.trajectory.events.values() if start <= t <= end], dtype=np.float64)
    t_hist = _history_times(events, start, float(ref.t[-1]), history)
    if every_step_beside is not None:
        t_hist = _with_steps(every_step_beside, ref.t[::per_window], start, rate, n_imu, group)
    hist_tick = _history_ticks(t_hist, events, start, rate, n_imu, group)
    stored = np.concatenate(
        [np.zeros(0, dtype=np.int64), *(ticks for at in stored_times for ticks in (at.valid, at.early))]
    )
    cut = _cut(n_imu, per_window, hist_tick, tick, stored, group)
    windows = TickWindows(cut.first_tick, cut.n_tick)
    lengths, length = np.unique(cut.n_tick, return_inverse=True)
    imu, *_ = filter_models(scenario)
    injection, injected = injections(card, flight.trajectory, ref, windows, layout, imu)
    schedule = Schedule(
        first_tick=cut.first_tick,
        n_tick=cut.n_tick,
        length=length.astype(np.int64),
        epoch=cut.epoch,
        hist=cut.hist,
        injection=injection,
        linearised=linearisations(card, rate, windows),
    )
    return Times(t_hist, hist_tick, schedule, lengths / rate, injected, delayed, stored_times)
