"""True flight of a case: motion, satellites, sensors, and effects of faults on measurements."""

import math
from typing import NamedTuple

import numpy as np

from lvnav_trade.gnss.faults import FaultEffects, delay, failures
from lvnav_trade.gnss.interference import spoofer_errors
from lvnav_trade.quantities.records import Floats, Ints, Reference, Sky
from lvnav_trade.scenario.filter_models import epoch_interval, has_receiver_solution
from lvnav_trade.scenario.scenario import Scenario
from lvnav_trade.sensors.receiver_observables import FURTHER, Channels
from lvnav_trade.simulation.preparation.cache import cached_reference, cached_sky, cached_trajectory, identity
from lvnav_trade.simulation.preparation.sensors import Sensor, sensors_of
from lvnav_trade.simulation.preparation.signals.atmospheric_delays import Delays, delays
from lvnav_trade.simulation.preparation.signals.lines_of_sight import Lines, lines_of
from lvnav_trade.trajectory.flight import Trajectory


class Epochs(NamedTuple):
    """Update epochs of the filter, and the grid of IMU ticks on which they lie.

    t : (n_epoch,) s since lift-off.
    tick : (n_epoch,). Tick of each epoch.
    n_tick : Ticks of the flight.
    group : Ticks of a step of the strapdown.
    """

    t: Floats
    tick: Ints
    n_tick: int
    group: int


class TrueFlight(NamedTuple):
    """True flight of a case, the same in every run and independent of the filter's estimates.

    trajectory : True flight.
    reference : True motion and ideal increments on the ticks of the IMU.
    epochs : Epochs on these ticks.
    sky : Satellites at the epochs.
    lines : Lines of sight to them.
    time_tags : (n_epoch,) s. Time tags of the receiver's measurements.
    devices : Sensors other than the receiver that the filter uses.
    channels : Measurement channels of the filter.
    ranging : Channels measured by the receiver: ranges, if it computes its position itself.
    atmospheric_delays : Tropospheric and ionospheric delays, true and as corrected by the filter.
    failures : Effects of faults on the measurements.
    fault_errors : (n_epoch, n_sat, 2) m, m/s. Errors of ranges and range rates by faults and spoofers.
    """

    trajectory: Trajectory
    reference: Reference
    epochs: Epochs
    sky: Sky
    lines: Lines
    time_tags: Floats
    devices: tuple[Sensor, ...]
    channels: Channels
    ranging: Channels
    atmospheric_delays: Delays
    failures: FaultEffects
    fault_errors: Floats


def flight_of(scenario: Scenario, given_flight: tuple[Trajectory, Reference] | None = None) -> TrueFlight:
    """Return the true flight of a scenario.

    Parameters
    ----------
    scenario
        Validated model of the case.
    given_flight
        Trajectory and its samples, in place of those of the scenario.
    """
    trajectory, ref = given_flight or _sampled_trajectory(scenario)
    flight_profile = trajectory.flight_profile
    epochs = epochs_of(scenario, ref)
    t = epochs.t
    start = float(ref.t[0])
    sky = cached_sky(scenario, trajectory, t, start)
    devices = sensors_of(scenario, trajectory, t, start)
    channels = channels_of(scenario, sky, devices)
    lines = lines_of(trajectory, np.array(scenario.receiver.lever_b), sky)
    fault_effects = failures(scenario.faults, flight_profile, t, sky.names, sky.elevation, sky.is_tracked)
    spoofing_errors = spoofer_errors(scenario.faults, trajectory, t, lines.position, lines.sight)
    return TrueFlight(
        trajectory=trajectory,
        reference=ref,
        epochs=epochs,
        sky=sky,
        lines=lines,
        time_tags=np.minimum(t, sky.t + delay(scenario.faults, flight_profile, t)),
        devices=devices,
        channels=channels,
        ranging=channels._replace(tight=True) if has_receiver_solution(scenario) else channels,
        atmospheric_delays=delays(trajectory, scenario.receiver, sky, scenario.atmosphere, scenario.filter.corrections),
        failures=fault_effects,
        fault_errors=np.stack([fault_effects.bias, fault_effects.drift], axis=2) + spoofing_errors,
    )


def _sampled_trajectory(scenario: Scenario) -> tuple[Trajectory, Reference]:
    """Return the trajectory of a scenario and its samples at the IMU ticks."""
    card = scenario.trajectory
    text = identity(card)
    return cached_trajectory(text, card), cached_reference(text, card, scenario.imu.rate)


def ticks_of(times: Floats, start: float, rate: float, n_tick: int, group: int = 1) -> Ints:
    """Return the tick nearest to each time, at the end of a strapdown step.

    Parameters
    ----------
    times, start
        s since lift-off. Times, and time of tick 0.
    rate
        Hz. Sampling rate of the IMU.
    n_tick, group
        Number of ticks; ticks of a strapdown step.
    """
    steps_since_start = (times - start) * rate / group
    nearest_step = np.rint(steps_since_start).astype(np.int64)
    return np.clip(nearest_step * group, 0, n_tick)


def epochs_of(scenario: Scenario, ref: Reference) -> Epochs:
    """Return the update epochs of a flight, at ends of strapdown steps."""
    rate = scenario.imu.rate
    start = float(ref.t[0])
    end = float(ref.t[-1])
    group = scenario.filter.strapdown.ratio
    n_sampled_tick = ref.dtheta.shape[0]
    n_tick = n_sampled_tick // group * group
    interval = epoch_interval(scenario)
    length = end - start
    n_epoch = math.floor(length / interval + 1e-9)
    count = np.arange(1, n_epoch + 1, dtype=np.float64)
    grid = start + interval * count
    tick = ticks_of(grid, start, rate, n_tick, group)
    # the times are those of the ticks, where increments end: half a tick is 20 m at orbital speed
    return Epochs(ref.t[tick], tick, n_tick, group)


def channels_of(scenario: Scenario, sky: Sky, devices: tuple[Sensor, ...] = ()) -> Channels:
    """Return the measurement channels of a filter."""
    card = scenario.filter
    ever_tracked = np.any(sky.is_tracked, axis=0).tolist()
    sensors = tuple(device.channels for device in devices)
    has_receiver = card.tight or card.loose
    further = tuple(name for name in card.measurements if name in FURTHER)
    return Channels(card.tight, sky.names, sky.systems, tuple(ever_tracked), has_receiver, sensors, further)
