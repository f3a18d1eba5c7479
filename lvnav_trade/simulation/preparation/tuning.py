"""Filter tuning on the nominal flight: measurement weights, noise at region changes, sampled linearisation."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from lvnav_trade.filter.assumed import ImuModel
from lvnav_trade.filter.card import FilterCard
from lvnav_trade.filter.measurement_tuning import ProcessNoiseTable, RegionNoiseCard, UnderweightingCard
from lvnav_trade.filter.states import TYPES
from lvnav_trade.gnss.reception import dynamics_at
from lvnav_trade.kernels.transition import ATT, EVERY_WINDOW, FIRST, KEPT, POS, RENEWED, VEL
from lvnav_trade.quantities.conditions import ROUNDING, FlightProfile, is_inside
from lvnav_trade.quantities.records import Bools, Floats, Ints, Reference
from lvnav_trade.quantities.state_layout import StateLayout
from lvnav_trade.trajectory.flight import Trajectory


def weights(
    cards: Sequence[UnderweightingCard], flight_profile: FlightProfile, channel_type: Ints, t_epoch: Floats
) -> tuple[Floats, Floats]:
    """Return underweighting and noise factors of the measurements.

    Parameters
    ----------
    cards
        Underweighting cards of the filter.
    flight_profile
        Conditions of the trajectory.
    channel_type
        (n_channel,). Measurement types.
    t_epoch
        (n_epoch,) s since lift-off.

    Returns
    -------
    beta
        (n_epoch, n_channel). Fraction of H P H' added to the innovation variance.
    factor
        (n_epoch, n_channel). Factor on the noise variance.
    """
    beta = np.zeros((t_epoch.size, channel_type.size))
    factor = np.ones_like(beta)
    for card in cards:
        types = [TYPES[name] for name in card.measurements or TYPES]
        in_condition = is_inside(flight_profile.active_intervals(card), t_epoch)
        applies = in_condition[:, None] & np.isin(channel_type, types)
        beta += np.where(applies, card.beta, 0.0)
        factor *= np.where(applies, card.noise_factor, 1.0)
    return beta, factor


class TickWindows(NamedTuple):
    """Windows of IMU ticks, (n_window,) each.

    first_tick : First tick.
    n_tick : Number of ticks.
    """

    first_tick: Ints
    n_tick: Ints


def injections(
    card: FilterCard,
    trajectory: Trajectory,
    ref: Reference,
    windows: TickWindows,
    layout: StateLayout,
    imu: ImuModel,
) -> tuple[Ints, Floats]:
    """Return the variances that are added to states at changes of region, and by tables of process noise.

    Parameters
    ----------
    card
        Filter card.
    trajectory, ref
        True flight, and true motion at the ticks.
    windows
        Windows of ticks.
    layout
        States of the filter.
    imu
        Filter model of the IMU.

    Returns
    -------
    number
        (n_window,). Row of `added_variance` that is added at the end of each window, -1 none.
    added_variance
        (n_injection, n_state) SI squared. At least one row.
    """
    n_window = windows.n_tick.size
    number = np.full(n_window, -1, dtype=np.int64)
    has_ticks = windows.n_tick > 0
    first = windows.first_tick[has_ticks]
    end = (windows.first_tick + windows.n_tick)[has_ticks]
    added_variance = np.zeros((n_window, layout.n_state))
    for region in card.region_noise:
        is_changed = np.zeros(n_window, dtype=bool)
        is_changed[has_ticks] = _changes(region, trajectory.flight_profile, ref, first, end)
        added_variance[is_changed] += _variance(region, layout, imu)
    if card.process_noise_by:
        added_variance[has_ticks, :9] += _tabled_variance(card.process_noise_by, trajectory, ref.t[first], ref.t[end])
    injection_windows = np.flatnonzero(np.any(added_variance > 0.0, axis=1))
    if not injection_windows.size:
        return number, np.zeros((1, layout.n_state))
    number[injection_windows] = np.arange(injection_windows.size)
    return number, added_variance[injection_windows]


def _changes(card: RegionNoiseCard, flight_profile: FlightProfile, ref: Reference, first: Ints, end: Ints) -> Bools:
    """Return whether the operating region changes within each window, (n,).

    Parameters
    ----------
    card
        Card of the region noise, with conditions and thresholds.
    flight_profile
        Conditions of the trajectory.
    ref
        True motion and ideal increments.
    first, end
        (n,). First tick of each window, and the tick after its last.
    """
    intervals = flight_profile.active_intervals(card)
    t_first = ref.t[first]
    t_end = ref.t[end]
    if card.force_change is None and card.rate_change is None:
        edges = np.array([edge for interval in intervals for edge in interval])
        window_start = t_first[:, None] + ROUNDING
        window_end = t_end[:, None] + ROUNDING
        is_in_window = (edges >= window_start) & (edges < window_end)
        return np.asarray(np.any(is_in_window, axis=1))
    is_changed = np.zeros(first.size, dtype=bool)
    for limit, increments in ((card.force_change, ref.dvel), (card.rate_change, ref.dtheta)):
        if limit is None:
            continue
        sums = np.cumsum(increments, axis=0)
        increment_sums = np.concatenate([np.zeros((1, 3)), sums])
        window_increment = increment_sums[end] - increment_sums[first]
        window_length = (t_end - t_first)[:, None]
        window_mean = window_increment / window_length
        has_jump = _jumps(window_mean, limit)
        is_changed |= has_jump
    return is_changed & is_inside(intervals, t_end)


def _tabled_variance(tables: Sequence[ProcessNoiseTable], trajectory: Trajectory, start: Floats, end: Floats) -> Floats:
    """Return the process-noise variance of attitude, velocity and position by tables, (n, 9) SI squared.

    The tables are read for the motion in the middle of each window.

    Parameters
    ----------
    tables
        Tables of process noise.
    trajectory
        True flight.
    start, end
        (n,) s since lift-off. Start and end of the windows.
    """
    middle = 0.5 * (start + end)
    length = end - start
    dynamics = dynamics_at(trajectory, middle)
    variance = np.zeros((start.size, 9))
    for table in tables:
        for name, first in (("attitude", ATT), ("velocity", VEL), ("position", POS)):
            values = getattr(table, name)
            if values:
                argument = getattr(dynamics, table.independent_quantity)
                grid = getattr(table, table.independent_quantity)
                density = np.interp(argument, grid, values) ** 2
                added_variance = density * length
                variance[:, first : first + 3] += added_variance[:, None]
    return variance


def _jumps(values: Floats, limit: float) -> Bools:
    """Return whether values (n, 3) differ by a limit or more from those at the last such change, (n,)."""
    is_jump = np.zeros(len(values), dtype=bool)
    reference = values[0]
    for k, value in enumerate(values):
        if np.linalg.norm(value - reference) >= limit:
            is_jump[k] = True
            reference = value
    return is_jump


def _variance(card: RegionNoiseCard, layout: StateLayout, imu: ImuModel) -> Floats:
    """Return the variance that a change of region adds to the states, (n_state,) SI squared.

    Parameters
    ----------
    card
        Card of the region noise.
    layout
        States of the filter.
    imu
        Filter model of the IMU; a nonlinearity is divided by its full scale.
    """
    variance = np.zeros(layout.n_state)
    first_states = [("attitude", ATT), ("velocity", VEL), ("position", POS)]
    first_states += [(block.name, block.offset) for block in layout.parameters]
    for name, first in first_states:
        sigma = getattr(card, name, 0.0) / imu.full_scale(name)
        variance[first : first + 3] = sigma**2
    if layout.clock >= 0:
        variance[layout.clock] = card.clock_bias**2
        if not layout.has_reduced_clock:
            variance[layout.clock + 1] = card.clock_drift**2
    return variance


def linearisations(card: FilterCard, rate: float, windows: TickWindows) -> Ints:
    """Return the code of `transition.linearise` for each window, (n_window,).

    Parameters
    ----------
    card
        Filter card.
    rate
        Hz. Sampling rate of the IMU.
    windows
        Windows of ticks.
    """
    codes = np.full(windows.n_tick.size, EVERY_WINDOW, dtype=np.int64)
    if card.transition_rate is None:
        return codes
    has_ticks = windows.n_tick > 0
    ticks_per_step = max(1, round(rate / card.transition_rate))
    step = windows.first_tick[has_ticks] // ticks_per_step
    is_new_step = np.diff(step, prepend=-1) > 0
    tick_codes = np.where(is_new_step, RENEWED, KEPT)
    # no estimate exists before the first window, so it is linearised at its own means; the second renews the rates
    tick_codes[:2] = (FIRST, RENEWED)[: tick_codes.size]
    codes[has_ticks] = tick_codes
    return codes
