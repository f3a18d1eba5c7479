"""Optional features of a case from its cards: receiver solution, delay compensation, stored gains, iterated update."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from lvnav_trade.filter.assumed import ReceiverModel
from lvnav_trade.filter.card import FilterCard
from lvnav_trade.filter.policies.delay import DelayProcessing
from lvnav_trade.filter.policies.iterated import IterationSettings
from lvnav_trade.filter.policies.stored_gains import StoredGains, evaluate_schedule
from lvnav_trade.filter.receivers.carrier_smoothing import Smoothing
from lvnav_trade.filter.receivers.receiver import (
    FilterSettings,
    ReportedCovariance,
    Solver,
    point_model,
    receiver_filter,
)
from lvnav_trade.gnss.receiver_cards import BancroftSolution, ComputedCovariance, DirectSolution, FilteredSolution
from lvnav_trade.quantities.errors import InputError, Mistake
from lvnav_trade.quantities.records import Floats, Ints
from lvnav_trade.quantities.state_layout import StateLayout, state_names
from lvnav_trade.scenario.filter_models import epoch_interval, has_receiver_solution
from lvnav_trade.scenario.scenario import Scenario
from lvnav_trade.sensors.receiver_observables import Channels
from lvnav_trade.simulation.preparation.inputs import Schedule
from lvnav_trade.simulation.preparation.sensors import Sensor


class CompensatedDelay(NamedTuple):
    """Delay that the filter compensates.

    sensor : Number of the sensor; -1 the receiver.
    delay : (n_epoch,) s.
    """

    sensor: int
    delay: Floats


def iteration_settings(card: FilterCard, layout: StateLayout) -> IterationSettings | None:
    """Return the settings of an iterated update; None without."""
    if card.algorithm != "iterated":
        return None
    return IterationSettings(card.iterations - 1, layout.clone if layout.clone >= 0 else layout.n_state)


class CloneTimes(NamedTuple):
    """Times at which states are stored for a delayed measurement.

    state_tick : (n_epoch,). Tick at whose end the state of the time of validity is stored.
    velocity_tick : (n_epoch,). Tick at whose end the earlier velocity is stored.
    offset : (n_epoch,) s. Time of validity minus the time of `state_tick`.
    base : (n_epoch,) s. Time of validity minus the time of `velocity_tick`.
    """

    state_tick: Ints
    velocity_tick: Ints
    offset: Floats
    base: Floats


def direct_solution(scenario: Scenario) -> DirectSolution:
    """Return the card of a directly simulated solution; zero sigmas if the receiver computes its solution itself."""
    card = scenario.receiver.solution
    if isinstance(card, DirectSolution):
        return card
    return DirectSolution.model_construct(position_sigma=0.0, velocity_sigma=0.0)


def epochs_per_update(scenario: Scenario) -> int:
    """Return n for a filter that updates at every n-th epoch; n > 1 only if the receiver computes its solution."""
    return round(scenario.receiver.rate / scenario.filter.update_rate) if has_receiver_solution(scenario) else 1


def gains_of(
    scenario: Scenario,
    layout: StateLayout,
    channels: Channels,
    t_epoch: Floats,
    events: Mapping[str, float],
) -> StoredGains | None:
    """Return the stored gains of a filter at the epochs; None without a schedule.

    Parameters
    ----------
    scenario
        Validated model of the case.
    layout, channels
        States and measurement channels of the filter.
    t_epoch
        (n_epoch,) s since lift-off.
    events
        s since lift-off, by name of the event.

    Raises
    ------
    InputError
        If the schedule has other states than the filter, no gains for its measurements, or an event that the flight
        lacks.
    """
    schedule = scenario.filter.gains
    if schedule is None:
        return None
    names = state_names(layout)
    if tuple(schedule.states) != names:
        raise _input_error(
            "filter.gains",
            f"the schedule {schedule.name!r} is of the states {', '.join(schedule.states)}; the filter has "
            f"{', '.join(names)}",
        )
    try:
        scheduled_gains = evaluate_schedule(schedule, t_epoch, events)
    except ValueError as error:
        raise _input_error("filter.gains", str(error)) from None
    gain = np.zeros((t_epoch.size, channels.n_channel, len(names)))
    has_gains = np.zeros(channels.n_channel, dtype=np.bool_)
    for k, name in enumerate(schedule.measurements):
        if name in channels.names:
            channel = channels.names.index(name)
            gain[:, channel] = scheduled_gains[:, k]
            has_gains[channel] = True
    if not has_gains.any():
        first_channels = ", ".join(channels.names[:6])
        raise _input_error("filter.gains", f"the schedule {schedule.name!r} has no gains for {first_channels}")
    return StoredGains(np.ascontiguousarray(gain), has_gains)


def _input_error(path: str, message: str) -> InputError:
    """Return the input error for a field of the scenario."""
    return InputError(records=[Mistake(message, path)])


def _reported_covariance(
    card: BancroftSolution | FilteredSolution, scenario: Scenario, model: ReceiverModel
) -> ReportedCovariance:
    """Return the settings of the reported covariance; a filter with its own receiver model uses the sigmas of that."""
    covariance_card = card.reported_covariance if isinstance(scenario.filter.receiver, str) else model
    if isinstance(covariance_card, ComputedCovariance):
        return ReportedCovariance(has_correlations=covariance_card.correlated, factor=covariance_card.factor)
    return ReportedCovariance(False, False, 1.0, covariance_card.position_sigma**2, covariance_card.velocity_sigma**2)


def solver_of(
    scenario: Scenario, model: ReceiverModel, max_satellites: int, smoothing: Smoothing | None = None
) -> Solver | None:
    """Return the settings by which the receiver computes its solution; None if the solution is simulated directly.

    Parameters
    ----------
    scenario
        Validated model of the case.
    model
        Filter model of the receiver.
    max_satellites
        Largest number of satellites in use at once.
    smoothing
        Carrier smoothing of the ranges; None without.
    """
    card = scenario.receiver.solution
    if isinstance(card, DirectSolution) or not has_receiver_solution(scenario):
        return None
    reported_covariance = _reported_covariance(card, scenario, model)
    if isinstance(card, BancroftSolution):
        point = point_model(reported_covariance, **card.numbers(), max_satellite_count=max_satellites)
        return Solver(point, None, smoothing)
    point = point_model(reported_covariance, **card.fix.numbers(), max_satellite_count=max_satellites)
    settings = FilterSettings(**card.numbers())
    return Solver(point, receiver_filter(reported_covariance, epoch_interval(scenario), settings), smoothing)


def compensated_delays(
    scenario: Scenario, t_epoch: Floats, t_valid: Floats, devices: Sequence[Sensor] = ()
) -> tuple[CompensatedDelay, ...]:
    """Return the delays that the filter compensates, that of the receiver first; empty without compensation.

    Parameters
    ----------
    scenario
        Validated model of the case.
    t_epoch, t_valid
        (n_epoch,) s. Epochs, and time tags of the receiver's measurements.
    devices
        Sensors other than the receiver that the filter uses.
    """
    card = scenario.filter.delay_compensation
    if card is None or not scenario.filter.is_aided:
        return ()
    delays = []
    if scenario.filter.tight or scenario.filter.loose:
        if isinstance(card.delay, str):  # by the time tags of the measurements
            delay = t_epoch - t_valid
        else:
            delay = np.full(t_epoch.size, card.delay)
        delays.append(CompensatedDelay(-1, delay))
    for number, device in enumerate(devices):
        if np.any(device.delay > 0.0):
            delays.append(CompensatedDelay(number, device.delay))
    return tuple(delays)


def delay_processing(
    scenario: Scenario,
    delays: Sequence[CompensatedDelay],
    storage_times: Sequence[CloneTimes],
    schedule: Schedule,
    channels: Channels,
) -> DelayProcessing | None:
    """Return the delay compensation as arrays for the kernels; None without.

    Parameters
    ----------
    scenario
        Validated model of the case.
    delays, storage_times
        Delays of `compensated_delays`, and the storage times of `clone_times` for each.
    schedule
        Windows of the flight.
    channels
        Measurement channels of the filter.
    """
    card = scenario.filter.delay_compensation
    if card is None or not delays:
        return None
    window_end = np.where(schedule.n_tick > 0, schedule.first_tick + schedule.n_tick, -1)
    ticks_per_epoch = scenario.imu.rate * epoch_interval(scenario)
    sensors = [item.sensor for item in delays]
    has_receiver = sensors[0] < 0
    is_extrapolated = card.kind == "extrapolated" and has_receiver
    of_sensor = [sensors.index(k) if k in sensors else -1 for k in range(len(channels.sensors))]
    n_ring = np.array([_n_stored(times, ticks_per_epoch) for times in storage_times], dtype=np.int64)
    is_buffered = [not is_extrapolated or sensor >= 0 for sensor in sensors]
    return DelayProcessing(
        is_extrapolated=is_extrapolated,
        receiver_line=0 if has_receiver else -1,
        line=_channel_lines(sensors, channels),
        sensor_line=np.array(of_sensor, np.int64),
        n_ring=n_ring,
        first=np.cumsum(n_ring) - n_ring,
        is_buffered=np.repeat(is_buffered, n_ring),
        state_epochs=np.stack([_epochs_at(window_end, times.state_tick) for times in storage_times]),
        velocity_epochs=np.stack([_epochs_at(window_end, times.velocity_tick) for times in storage_times]),
        delay=delays[0].delay,
        offset=np.stack([times.offset for times in storage_times]),
        base=storage_times[0].base,
        interval=epoch_interval(scenario),
        delay_variance=card.delay_sigma**2,
        acceleration_variance=card.acceleration_sigma**2,
    )


def _channel_lines(sensors: list[int], channels: Channels) -> Ints:
    """Return the delay line of each channel, (n_channel,), -1 not late; sensors: that of each line, -1 the receiver."""
    line = np.full(channels.n_channel, -1, dtype=np.int64)
    for number, sensor in enumerate(sensors):
        if sensor < 0:
            line[: channels.n_receiver] = number
        else:
            first = channels.first_channels[sensor]
            line[first : first + len(channels.sensors[sensor].labels)] = number
    return line


def _n_stored(times: CloneTimes, ticks_per_epoch: float) -> int:
    """Return the number of states stored at once. A state is stored until its epoch is over."""
    epoch = np.arange(1, times.state_tick.size + 1)
    storing_tick = np.minimum(times.state_tick, times.velocity_tick)
    epoch_of_storing = storing_tick / ticks_per_epoch
    epochs_stored = epoch - epoch_of_storing
    n_stored = np.floor(epochs_stored + 1e-9) + 1
    return max(1, int(n_stored.max(initial=1)))


def _epochs_at(ends: Ints, ticks: Ints) -> Ints:
    """Return the range of epochs whose tick is the end of each window, (n_window, 2): first, and one after the last.

    ends : (n_window,) last ticks of the windows; ticks : (n_epoch,) ascending
    """
    first = np.searchsorted(ticks, ends, "left")
    after_last = np.searchsorted(ticks, ends, "right")
    return np.stack([first, after_last], axis=1).astype(np.int64)


def clone_times(
    scenario: Scenario,
    t_epoch: Floats,
    delays: Sequence[CompensatedDelay],
    t: Floats,
    group: int,
) -> tuple[CloneTimes, ...]:
    """Return the times at which states are stored for each delay.

    Parameters
    ----------
    scenario
        Validated model of the case.
    t_epoch
        (n_epoch,) s since lift-off.
    delays
        Delays of `compensated_delays`.
    t
        (n_tick + 1,) s. Times of the ticks.
    group
        Ticks of a strapdown step.
    """
    card = scenario.filter.delay_compensation
    if card is None:
        return ()
    times = []
    for item in delays:
        base = card.base if item.sensor < 0 else 0.0
        times.append(_clone_times(t_epoch - item.delay, base, t, group))
    return tuple(times)


def _clone_times(t_valid: Floats, velocity_interval: float, t: Floats, group: int) -> CloneTimes:
    """Return the storage times of the states for a delayed measurement.

    Parameters
    ----------
    t_valid
        (n_epoch,) s. Times of validity.
    velocity_interval
        s. Interval from the earlier velocity to the state; 0: no earlier velocity is stored.
    t
        (n_tick + 1,) s. Times of the ticks.
    group
        Ticks of a strapdown step.
    """
    dt = float(t[1] - t[0])
    step = dt * group
    # states are stored at the end of a step, so the earliest are those of the first two steps
    steps_since_start = (t_valid - t[0]) / step
    nearest_step = np.rint(steps_since_start).astype(np.int64)
    state_tick = np.maximum(2 * group, nearest_step * group)
    velocity_tick = state_tick
    if velocity_interval > 0.0:
        steps_before = max(1, round(velocity_interval / step))
        velocity_tick = np.maximum(group, state_tick - steps_before * group)
    t_clone = t[state_tick]
    t_early = t[velocity_tick]
    # rounding errors of the times need no propagation by a fraction of a step
    offset = t_valid - t_clone
    is_rounding = np.abs(offset) < 1e-6 * dt
    offset = np.where(is_rounding, 0.0, offset)
    base = t_valid - t_early
    is_within_step = base < 0.5 * dt * group
    base = np.where(is_within_step, t_clone - t_early, base)
    return CloneTimes(state_tick, velocity_tick, offset, base)
