"""Schedule of a flight: history times, ticks at which states are stored, and the windows between them."""

import math
from typing import NamedTuple

import numpy as np

from lvnav_trade.quantities.records import Floats, Ints
from lvnav_trade.quantities.state_layout import StateLayout
from lvnav_trade.scenario.filter_models import filter_models
from lvnav_trade.scenario.scenario import Scenario
from lvnav_trade.simulation.preparation.inputs import Schedule
from lvnav_trade.simulation.preparation.options import CloneTimes, CompensatedDelay, clone_times, compensated_delays
from lvnav_trade.simulation.preparation.true_flight import TrueFlight, ticks_of
from lvnav_trade.simulation.preparation.tuning import TickWindows, injections, linearisations

_SAME_TICK = 1e-6
"""Fraction of a step by which a time may follow a tick and still count as at the tick."""


def _history_times(events: Floats, start: float, end: float, interval: float) -> Floats:
    """Return the grid of history times and the times of events, sorted, without duplicates."""
    first = math.ceil(start / interval)
    last = math.floor(end / interval)
    grid = np.arange(first, last + 1) * interval
    return np.unique(np.concatenate([[start], grid, events]))


def _history_ticks(t_hist: Floats, events: Floats, start: float, rate: float, n_tick: int, group: int) -> Ints:
    """Return the ticks (n_hist,) at which errors are recorded, ascending.

    For an event it is the end of the first strapdown step at or after it, because the thrust acts until a cut-off. For
    any other time it is the nearest tick.
    """
    steps = (t_hist - start) * rate / group
    next_step = np.ceil(steps - _SAME_TICK).astype(np.int64)
    next_tick = np.clip(next_step * group, 0, n_tick)
    nearest = ticks_of(t_hist, start, rate, n_tick, group)
    is_event = np.isin(t_hist, events)
    ticks = np.where(is_event, next_tick, nearest)
    return np.asarray(np.maximum.accumulate(ticks))


class _Windows(NamedTuple):
    """Windows of a flight, (n_window,) each.

    first_tick : First tick.
    n_tick : Number of ticks.
    epoch : Epoch at the end, -1 none.
    hist : History time at the end, -1 none.
    """

    first_tick: Ints
    n_tick: Ints
    epoch: Ints
    hist: Ints


def _divide(
    n_tick: int, per_window: int, hist_tick: Ints, epoch_tick: Ints, storage_ticks: Ints, group: int
) -> _Windows:
    """Divide the flight into windows.

    Windows end at covariance steps (rounded to strapdown steps), epochs, history times, and ticks at which a state is
    stored. A second history time at the same tick gets a window without ticks.

    Parameters
    ----------
    n_tick
        Number of ticks of the flight.
    per_window
        Ticks of a covariance step.
    hist_tick, epoch_tick, storage_ticks
        Ticks of history times and epochs, and ticks at which a state is stored.
    group
        Ticks of a strapdown step.
    """
    regular_ticks = np.arange(0, n_tick, per_window)
    strapdown_steps = np.rint(regular_ticks / group).astype(np.int64)
    step_ticks = strapdown_steps * group
    ends = np.concatenate([step_ticks, hist_tick, epoch_tick, storage_ticks, [0, n_tick]])
    end = np.unique(ends)
    first = np.concatenate([[0], end[:-1]])
    epoch = np.full(end.size, -1)
    epoch_window = np.searchsorted(end, epoch_tick)
    epoch[epoch_window] = np.arange(epoch_tick.size)
    is_repeated = np.ones(hist_tick.size, dtype=bool)
    _, first_at_tick = np.unique(hist_tick, return_index=True)
    is_repeated[first_at_tick] = False
    is_single = ~is_repeated
    hist = np.full(end.size, -1)
    hist_window = np.searchsorted(end, hist_tick[is_single])
    hist[hist_window] = np.flatnonzero(is_single)
    # the empty window at tick 0 is needed only if a history time is there
    is_needed = (end > 0) | (hist >= 0)
    columns_of_windows = [first, end - first, epoch, hist]
    windows = np.stack(columns_of_windows, axis=1)[is_needed]
    repeated_tick = hist_tick[is_repeated]
    n_repeated = repeated_tick.size
    empty_windows = np.empty((n_repeated, 4), dtype=np.int64)
    empty_windows[:, 0] = repeated_tick
    empty_windows[:, 1] = 0  # ticks
    empty_windows[:, 2] = -1  # epoch
    empty_windows[:, 3] = np.flatnonzero(is_repeated)
    all_ends = np.concatenate([end[is_needed], repeated_tick])
    order = np.argsort(all_ends, kind="stable")
    all_windows = np.concatenate([windows, empty_windows])
    columns = all_windows[order].T
    return _Windows(*np.ascontiguousarray(columns))


def _add_steps(t_hist: Floats, steps: Floats, start: float, rate: float, n_tick: int, group: int) -> Floats:
    """Return history times and covariance steps (s), sorted; a step at the tick of a history time is omitted.

    Parameters
    ----------
    t_hist, steps
        (n,) s since lift-off. History times and covariance steps.
    start
        s since lift-off. Time of tick 0.
    rate
        Hz. Sampling rate of the IMU.
    n_tick
        Number of ticks of the flight.
    group
        Ticks of a strapdown step.
    """
    step_ticks = ticks_of(steps, start, rate, n_tick, group)
    hist_ticks = ticks_of(t_hist, start, rate, n_tick, group)
    is_at_history = np.isin(step_ticks, hist_ticks)
    additional = steps[~is_at_history]
    return np.sort(np.concatenate([t_hist, additional]))


class Times(NamedTuple):
    """Schedule of a flight: history times and windows.

    t_hist : (n_hist,) s since lift-off. History times.
    hist_tick : (n_hist,). Ticks at which errors are recorded for them.
    schedule : Windows of IMU ticks.
    lengths : (n_length,) s. Window lengths that occur.
    injected_variance : (n_injection, n_state) SI squared. Variances added to the filter's states at changes of region.
    delays : Delays that the filter compensates.
    clone_times : For each of these delays, the times at which states are stored.
    """

    t_hist: Floats
    hist_tick: Ints
    schedule: Schedule
    lengths: Floats
    injected_variance: Floats
    delays: tuple[CompensatedDelay, ...]
    clone_times: tuple[CloneTimes, ...]


def times_of(
    scenario: Scenario,
    flight: TrueFlight,
    layout: StateLayout,
    history: float,
    additional_times: Floats | None = None,
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
    additional_times
        As in `prepare`.
    """
    card, ref, trajectory = scenario.filter, flight.reference, flight.trajectory
    _, epoch_tick, n_tick, group = flight.epochs
    rate = scenario.imu.rate
    start = float(ref.t[0])
    delays = compensated_delays(scenario, flight.epochs.t, flight.time_tags, flight.devices)
    stored_times = clone_times(scenario, flight.epochs.t, delays, ref.t, group)
    per_window = max(1, round(rate / card.covariance_rate))
    # an event within the last fraction of a tick has the errors of the last tick
    in_flight = [t for t in trajectory.events.values() if start <= t <= trajectory.end]
    events = np.array(in_flight, dtype=np.float64)
    t_hist = _history_times(events, start, float(ref.t[-1]), history)
    if additional_times is not None:
        t_hist = _add_steps(additional_times, ref.t[::per_window], start, rate, n_tick, group)
    hist_tick = _history_ticks(t_hist, events, start, rate, n_tick, group)
    stored_ticks = [np.zeros(0, dtype=np.int64)]
    for times in stored_times:
        stored_ticks += [times.state_tick, times.velocity_tick]
    divisions = _divide(n_tick, per_window, hist_tick, epoch_tick, np.concatenate(stored_ticks), group)
    windows = TickWindows(divisions.first_tick, divisions.n_tick)
    lengths, length_index = np.unique(divisions.n_tick, return_inverse=True)
    imu, _, _ = filter_models(scenario)
    injection, injected_variance = injections(card, trajectory, ref, windows, layout, imu)
    schedule = Schedule(
        first_tick=divisions.first_tick,
        n_tick=divisions.n_tick,
        length_index=length_index.astype(np.int64),
        epoch=divisions.epoch,
        hist=divisions.hist,
        injection=injection,
        linearisation=linearisations(card, rate, windows),
    )
    return Times(
        t_hist=t_hist,
        hist_tick=hist_tick,
        schedule=schedule,
        lengths=lengths / rate,
        injected_variance=injected_variance,
        delays=delays,
        clone_times=stored_times,
    )
