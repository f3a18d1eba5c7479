"""White noise of receiver measurements by channel: true sigma, and variance in the filter model."""

import math
from typing import Any

import numpy as np

from lvnav_trade.filter.assumed import ReceiverModel
from lvnav_trade.gnss.faults import FaultEffects
from lvnav_trade.gnss.receiver_cards import ReceiverCard
from lvnav_trade.gnss.reception import factors
from lvnav_trade.quantities.records import Floats, Sky
from lvnav_trade.scenario.filter_models import carrier_smoothing, has_receiver_solution
from lvnav_trade.scenario.scenario import Scenario
from lvnav_trade.sensors.family import RECEIVER_SOLUTION
from lvnav_trade.sensors.receiver_observables import DIFFERENCES, PHASES, Channels
from lvnav_trade.simulation.preparation.options import direct_solution
from lvnav_trade.simulation.preparation.sensors import Sensor
from lvnav_trade.simulation.preparation.signals.lines_of_sight import Lines
from lvnav_trade.trajectory.flight import Trajectory


def channel_table(
    channels: Channels,
    n_epoch: int,
    receiver_values: tuple[Any, ...],
    devices: tuple[Sensor, ...],
    field: str,
) -> Floats:
    """Return a table (n_epoch, n_channel) of values by channel.

    Parameters
    ----------
    channels
        Measurement channels.
    n_epoch
        Number of epochs.
    receiver_values
        Values of the receiver: for each observable, a number or (n_epoch, n_sat); or for position and velocity, a
        number or (n_epoch, 1).
    devices, field
        Sensors other than the receiver, and the field of `Sensor` with their values.
    """
    table = np.empty((n_epoch, channels.n_channel))
    n = channels.n_receiver
    if channels.tight:
        for observable, value in zip(channels.observables, receiver_values, strict=True):
            table[:, channels.observable_slice(observable)] = value
    else:
        table[:, :3], table[:, 3:n] = receiver_values
    for first, device in zip(channels.first_channels, devices, strict=True):
        values = getattr(device, field)
        n_scalar = values.shape[1]
        table[:, first : first + n_scalar] = values
    return table


def rate_sigma_of(scenario: Scenario, sky: Sky, trajectory: Trajectory) -> Floats:
    """Return the sigma (n_epoch, n_sat) m/s of range rates from Doppler, or from differences of carrier phase.

    Parameters
    ----------
    scenario
        Validated model of the case.
    sky
        Satellites at the epochs.
    trajectory
        True flight.
    """
    smoothing = carrier_smoothing(scenario)
    if smoothing is None or smoothing.velocity == "doppler":
        return sky.rate_sigma
    sigma = phase_sigma(scenario.receiver, sky, trajectory)
    return math.sqrt(2.0) / smoothing.rate_interval * sigma


def phase_sigma(receiver: ReceiverCard, sky: Sky, trajectory: Trajectory) -> Floats:
    """Return the sigma (n_epoch, n_sat) m of carrier phases.

    Parameters
    ----------
    receiver
        Card of the receiver.
    sky
        Satellites at the epochs.
    trajectory
        True flight, for the tables of the noise.
    """
    (factor,) = factors(receiver.noise_by, ("carrier_phase",), trajectory, sky.t)
    sigma = receiver.amplification * receiver.carrier_phase_sigma
    return np.full(sky.rate_sigma.shape, sigma) * factor


def true_sigma(scenario: Scenario, sky: Sky, line: Lines, channels: Channels) -> tuple[Any, ...]:
    """Return the sigmas of white noise of a receiver without faults, see `receiver_values` in `channel_table`.

    The sigma of a difference of two epochs is that of the differenced observable.

    Parameters
    ----------
    scenario
        Validated model of the case.
    sky, line
        Satellites at the epochs, lines of sight.
    channels
        Measurement channels.
    """
    if channels.tight:
        rate = rate_sigma_of(scenario, sky, line.trajectory)
        return tuple(rate if name == "range_rate" else _sky_sigma(sky, name) for name in channels.observables)
    solution = direct_solution(scenario)
    position_factor, velocity_factor = line.noise_factors(scenario.receiver.noise_by, RECEIVER_SOLUTION)
    position_sigma = solution.position_sigma * position_factor
    velocity_sigma = solution.velocity_sigma * velocity_factor
    return position_sigma, velocity_sigma


def sigma_with_faults(sigma: Floats, channels: Channels, failures: FaultEffects) -> Floats:
    """Return the true sigma with the factors of faults, (n_epoch, n_channel) SI.

    Parameters
    ----------
    sigma
        (n_epoch, n_channel) SI. Sigma without faults, which the filter may use; it is not changed.
    channels
        Measurement channels.
    failures
        Effects of faults on the receiver.
    """
    if channels.tight:
        factor = np.repeat(failures.noise, len(channels.observables), axis=1)
    else:
        factor = failures.solution_noise[:, None]
    n = channels.n_receiver
    scaled_sigma = sigma.copy()
    scaled_sigma[:, :n] = sigma[:, :n] * factor
    return scaled_sigma


def assumed_variance(
    scenario: Scenario,
    model: ReceiverModel,
    channels: Channels,
    sky: Sky,
    line: Lines,
    devices: tuple[Sensor, ...],
) -> Floats:
    """Return the noise variance of the measurements in the filter model, (n_epoch, n_channel) SI squared.

    It is that of the filter's receiver model, or that of the true receiver if the model is `matched`. It is 1 for a
    receiver that reports a covariance with each solution.

    Parameters
    ----------
    scenario, model
        Validated model of the case, and the filter's receiver model.
    channels
        Measurement channels of the filter.
    sky, line
        Satellites at the epochs, lines of sight.
    devices
        Sensors other than the receiver.
    """
    variances: tuple[Any, ...]
    if channels.tight:
        variances = tuple(_observable_variance(scenario, model, sky, line, name) for name in channels.observables)
    elif isinstance(scenario.filter.receiver, str):
        variances = tuple(sigma**2 for sigma in true_sigma(scenario, sky, line, channels))
    else:
        position_factor, velocity_factor = line.noise_factors(model.noise_by, RECEIVER_SOLUTION)
        variances = ((model.position_sigma * position_factor) ** 2, (model.velocity_sigma * velocity_factor) ** 2)
    if has_receiver_solution(scenario):
        variances = (1.0, 1.0)
    return channel_table(channels, sky.t.size, variances, devices, "variance")


def _observable_variance(scenario: Scenario, model: ReceiverModel, sky: Sky, line: Lines, name: str) -> Floats:
    """Return the noise variance of an observable in the filter model, (n_epoch, n_sat) SI squared.

    A difference of two epochs has white noise of its own only if the card says so; otherwise its noise is a state.

    Parameters
    ----------
    scenario, model
        Validated model of the case, and the filter's receiver model.
    sky, line
        Satellites at the epochs, lines of sight.
    name
        Name of the observable.
    """
    card = scenario.filter
    variance = assumed_sigma(scenario, model, sky, line, name) ** 2
    if name not in card.differences:
        return variance
    if card.previous_noise == "white":
        return _difference_variance(variance)
    return 0.0 * variance


def assumed_sigma(scenario: Scenario, model: ReceiverModel, sky: Sky, line: Lines, observable: str) -> Floats:
    """Return the sigma of an observable's noise in the filter model, (n_epoch, n_sat) SI.

    For a difference of two epochs it is that of the differenced observable.

    Parameters
    ----------
    scenario, model
        Validated model of the case, and the filter's receiver model.
    sky, line
        Satellites at the epochs, lines of sight.
    observable
        Name of the observable.
    """
    if isinstance(scenario.filter.receiver, str):
        return _sky_sigma(sky, observable)
    name = DIFFERENCES.get(observable, observable)
    (factor,) = line.noise_factors(model.noise_by, (name,))
    sigma = getattr(model, f"{name}_sigma")
    shape = sky.is_tracked.shape
    return np.asarray(sigma * factor * np.ones(shape))


def _sky_sigma(sky: Sky, observable: str) -> Floats:
    if observable in PHASES:
        return sky.phase_sigma
    return sky.rate_sigma if observable == "range_rate" else sky.range_sigma


def _difference_variance(variance: Floats) -> Floats:
    """Return the variance (n_epoch, n_sat) of the difference between each epoch and the previous one."""
    previous_variance = np.vstack([variance[:1], variance[:-1]])
    return np.asarray(variance + previous_variance)
