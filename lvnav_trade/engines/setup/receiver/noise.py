"""White noise of receiver measurements by channel: true sigma, and variance in the filter model."""

import math
from typing import Any

import numpy as np

from lvnav_trade.engines.setup.options import direct
from lvnav_trade.engines.setup.receiver.lines import Lines
from lvnav_trade.engines.setup.sensors import Sensor
from lvnav_trade.filter_models import smoothing_of, solves
from lvnav_trade.filters.base import ReceiverModel
from lvnav_trade.observables.partials import DIFFERENCES, PHASES, Channels
from lvnav_trade.observables.sensors import RECEIVER_SOLUTION
from lvnav_trade.records import Floats, Sky
from lvnav_trade.scenario import Scenario
from lvnav_trade.world.faults import Failures
from lvnav_trade.world.flight.trajectory import Trajectory
from lvnav_trade.world.receiver.dynamics import factors
from lvnav_trade.world.receiver.receiver import ReceiverCard


def by_channel(
    channels: Channels, n_epoch: int, own: tuple[Any, ...], devices: tuple[Sensor, ...], field: str
) -> Floats:
    """Return a table (n_epoch, n_channel) of values of the receiver's channels (of each observable of the satellites,
    or of position and velocity), each a number or (n_epoch, n_sat), and of a field of the sensors beside it.
    """
    table, n = np.empty((n_epoch, channels.n_channel)), channels.n_receiver
    if channels.tight:
        for observable, value in zip(channels.observables, own, strict=True):
            table[:, channels.of(observable)] = value
    else:
        table[:, :3], table[:, 3:n] = own
    for at, device in zip(channels.first, devices, strict=True):
        values = getattr(device, field)
        table[:, at : at + values.shape[1]] = values
    return table


def rate_sigma_of(scenario: Scenario, seen: Sky, trajectory: Trajectory) -> Floats:
    """Return the sigma of range rates (n_epoch, n_sat): of the Doppler, or of differences of carrier phase."""
    smoothing, receiver = smoothing_of(scenario), scenario.receiver
    if smoothing is None or smoothing.velocity == "doppler":
        return seen.rate_sigma
    return math.sqrt(2.0) / smoothing.rate_interval * phase_sigma(receiver, seen, trajectory)


def phase_sigma(receiver: ReceiverCard, seen: Sky, trajectory: Trajectory) -> Floats:
    """Return the sigma of carrier phase (n_epoch, n_sat) m."""
    (grown,) = factors(receiver.noise_by, ("carrier_phase",), trajectory, seen.t)
    return np.full(seen.rate_sigma.shape, receiver.amplification * receiver.carrier_phase_sigma) * grown


def true_sigma(scenario: Scenario, seen: Sky, line: Lines, channels: Channels) -> tuple[Any, ...]:
    """Return the sigmas of white noise of a receiver in which nothing has failed, of a difference that of what it is
    the difference of; see `by_channel`.
    """
    if channels.tight:
        rate = rate_sigma_of(scenario, seen, line.trajectory)
        return tuple(rate if name == "range_rate" else _of_sky(seen, name) for name in channels.observables)
    solution = direct(scenario)
    of_position, of_velocity = line.noise_factors(scenario.receiver.noise_by, RECEIVER_SOLUTION)
    return solution.position_sigma * of_position, solution.velocity_sigma * of_velocity


def grown_sigma(sigma: Floats, channels: Channels, failed: Failures) -> Floats:
    """Return the true sigma, grown by what has failed; `sigma`, which the filter may assume, stays as it is."""
    n, grown = channels.n_receiver, sigma.copy()
    n_kind = len(channels.observables)
    factor = np.repeat(failed.noise, n_kind, axis=1) if channels.tight else failed.solution_noise[:, None]
    grown[:, :n] = sigma[:, :n] * factor
    return grown


def assumed_variance(
    scenario: Scenario, model: ReceiverModel, channels: Channels, seen: Sky, line: Lines, devices: tuple[Sensor, ...]
) -> Floats:
    """Return the variance (n_epoch, n_channel) that the filter gives rows: its own numbers, or what the receiver tells
    of its noise where the card says so; one for a receiver that reports the covariance with every solution.
    """
    if channels.tight:
        card = scenario.filter
        own = tuple(assumed_sigma(scenario, model, seen, line, name) ** 2 for name in channels.observables)
        own = tuple(
            (_of_difference(one) if card.previous_noise == "white" else 0.0 * one) if name in card.differences else one
            for name, one in zip(channels.observables, own, strict=True)
        )
    elif isinstance(scenario.filter.receiver, str):
        own = tuple(sigma**2 for sigma in true_sigma(scenario, seen, line, channels))
    else:
        grown = line.noise_factors(model.noise_by, RECEIVER_SOLUTION)
        own = tuple(
            (getattr(model, f"{name}_sigma") * factor) ** 2
            for name, factor in zip(RECEIVER_SOLUTION, grown, strict=True)
        )
    return by_channel(channels, seen.t.size, (1.0, 1.0) if solves(scenario) else own, devices, "variance")


def assumed_sigma(scenario: Scenario, model: ReceiverModel, seen: Sky, line: Lines, observable: str) -> Floats:
    """Return the one-sigma (n_epoch, n_sat) that the filter assumes of an observable's noise, of a difference that of
    what it is the difference of.
    """
    if isinstance(scenario.filter.receiver, str):
        return _of_sky(seen, observable)
    name = DIFFERENCES.get(observable, observable)
    (factor,) = line.noise_factors(model.noise_by, (name,))
    return np.asarray(getattr(model, f"{name}_sigma") * factor * np.ones(seen.tracked.shape))


def _of_sky(seen: Sky, observable: str) -> Floats:
    if observable in PHASES:
        return seen.phase_sigma
    return seen.rate_sigma if observable == "range_rate" else seen.range_sigma


def _of_difference(variance: Floats) -> Floats:
    """Return the variance (n_epoch, n_sat) of the difference of each epoch with the one before."""
    return np.asarray(variance + np.vstack([variance[:1], variance[:-1]]))
