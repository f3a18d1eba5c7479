"""When a flight is looked at: epochs, history times, ticks whose state is kept, and the windows between them."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from lvnav_trade.engines.setup.inputs import Schedule
from lvnav_trade.engines.setup.options import CloneTimes
from lvnav_trade.records import Floats, Ints, Reference
from lvnav_trade.scenario import Scenario, epoch_interval
from lvnav_trade.world.flight.trajectory import Trajectory


def _ticks(times: Floats, start: float, rate: float, n_imu: int, group: int = 1) -> Ints:
    """Return the tick nearest to each time, on a step of the strapdown (`group` ticks)."""
    return np.clip(np.rint((times - start) * rate / group).astype(np.int64) * group, 0, n_imu)


def _history_times(trajectory: Trajectory, start: float, end: float, every: float) -> Floats:
    """Return the grid and every event time, sorted; a time that is on the grid stands once."""
    grid = np.arange(math.ceil(start / every), math.floor(end / every) + 1) * every
    events = np.array([t for t in trajectory.events.values() if start <= t <= end])
    return np.unique(np.concatenate([[start], grid, events]))


def _schedule(
    n_imu: int, per_window: int, hist_tick: Ints, epoch_tick: Ints, kept: Ints, group: int
) -> tuple[Schedule, Ints]:
    """Cut the flight into windows at covariance steps, each at the strapdown step nearest to it (`group` ticks),
    epochs, history times and ticks whose state is kept; a second history time on the same tick gets a window of no
    ticks. Returns the schedule and the distinct window lengths in ticks.
    """
    steps = np.rint(np.arange(0, n_imu, per_window) / group).astype(np.int64) * group
    bounds = np.unique(np.concatenate([steps, hist_tick, epoch_tick, kept, [0, n_imu]]))
    begin = np.concatenate([[0], bounds[:-1]])
    epoch, hist = np.full(bounds.size, -1), np.full(bounds.size, -1)
    epoch[np.searchsorted(bounds, epoch_tick)] = np.arange(epoch_tick.size)
    seconds = np.ones(hist_tick.size, dtype=bool)
    seconds[np.unique(hist_tick, return_index=True)[1]] = False
    hist[np.searchsorted(bounds, hist_tick[~seconds])] = np.flatnonzero(~seconds)
    kept_rows = (bounds > 0) | (hist >= 0)
    rows = np.stack([begin, bounds - begin, epoch, hist], axis=1)[kept_rows]
    none = np.zeros(np.count_nonzero(seconds), dtype=np.int64)
    more = np.stack([hist_tick[seconds], none, none - 1, np.flatnonzero(seconds)], axis=1)
    order = np.argsort(np.concatenate([bounds[kept_rows], hist_tick[seconds]]), kind="stable")
    first, counts, epoch, hist = np.ascontiguousarray(np.concatenate([rows, more])[order].T)
    lengths, which = np.unique(counts, return_inverse=True)
    nothing = np.zeros_like(first)
    return Schedule(first, counts, which.astype(np.int64), epoch, hist, nothing - 1, nothing), lengths


def _with_steps(t_hist: Floats, steps: Floats, start: float, rate: float, n_imu: int, group: int) -> Floats:
    """Return history times and covariance steps (s), sorted; a step on the tick of a history time stands once."""
    grid = (start, rate, n_imu, group)
    return np.sort(np.concatenate([t_hist, steps[~np.isin(_ticks(steps, *grid), _ticks(t_hist, *grid))]]))


class Epochs(NamedTuple):
    """Epochs (s) and their ticks; ticks of the flight, and those to a strapdown step."""

    t: Floats
    tick: Ints
    n_imu: int
    group: int


class Times(NamedTuple):
    """When a flight is looked at: history times (s) with their ticks, windows, and their lengths (s)."""

    t_hist: Floats
    hist_tick: Ints
    schedule: Schedule
    lengths: Floats


def epochs_of(scenario: Scenario, ref: Reference) -> Epochs:
    """Return the epochs of a flight, on ticks of the strapdown."""
    rate, start, end = scenario.imu.rate, float(ref.t[0]), float(ref.t[-1])
    group = scenario.filter.strapdown.ratio
    n_imu = ref.dtheta.shape[0] // group * group
    interval = epoch_interval(scenario)
    n_epoch = math.floor((end - start) / interval + 1e-9)
    tick = _ticks(start + interval * np.arange(1, n_epoch + 1, dtype=np.float64), start, rate, n_imu, group)
    # increments end at ticks: half a tick is 20 m at orbital speed
    return Epochs(ref.t[tick], tick, n_imu, group)


def times_of(
    scenario: Scenario,
    trajectory: Trajectory,
    ref: Reference,
    epochs: Epochs,
    kept: Sequence[CloneTimes],
    history: float,
    every_step_beside: Floats | None,
) -> Times:
    """Return when a flight is looked at; history: interval (s) of the grid, every_step_beside as of `prepare`."""
    rate, n_imu, group = scenario.imu.rate, epochs.n_imu, epochs.group
    start, end = float(ref.t[0]), float(ref.t[-1])
    per_window = max(1, round(rate / scenario.filter.covariance_rate))
    t_hist = _history_times(trajectory, start, end, history)
    if every_step_beside is not None:
        t_hist = _with_steps(every_step_beside, ref.t[::per_window], start, rate, n_imu, group)
    hist_tick = _ticks(t_hist, start, rate, n_imu, group)
    looked = np.concatenate([np.zeros(0, dtype=np.int64), *(ticks for one in kept for ticks in (one.valid, one.early))])
    schedule, lengths = _schedule(n_imu, per_window, hist_tick, epochs.tick, looked, group)
    return Times(t_hist, hist_tick, schedule, lengths / rate)
