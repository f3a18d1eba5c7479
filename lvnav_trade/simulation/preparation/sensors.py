"""Sensors other than the receiver on the nominal flight: times, true measurements, filter model."""

from collections.abc import Collection, Iterable
from functools import cache
from typing import NamedTuple

import numpy as np

from lvnav_trade.kernels.random import source_word
from lvnav_trade.quantities.conditions import FlightProfile, is_inside
from lvnav_trade.quantities.errors import InputError, Mistake
from lvnav_trade.quantities.frames import earth_angle, earth_velocity, geodetic_from_ecef
from lvnav_trade.quantities.records import Bools, Floats
from lvnav_trade.scenario.filter_models import imu_difference_errors, sensor_model, used_sensors
from lvnav_trade.scenario.scenario import Scenario
from lvnav_trade.sensors.family import SENSORS, card_kind
from lvnav_trade.sensors.imu_difference import ImuDifferenceCard
from lvnav_trade.sensors.receiver_observables import Channels, SensorChannels, SensorState
from lvnav_trade.sensors.sensor import N_FILTER_PARAMETER, N_TRUTH, CorrelatedError, FlightView, SensorCard, SensorModel
from lvnav_trade.simulation.preparation.inputs import Sensors
from lvnav_trade.trajectory.flight import Trajectory, motion
from lvnav_trade.trajectory.truth import remove_oscillations

# m/s relative to the Earth below which a vehicle is at rest: splines on the pad stay below 1e-8, a launch exceeds it at
# once.
STILL = 1e-3
_KINDS = tuple(map(card_kind, SENSORS))  # the index of a type is its number in the kernels


class Sensor(NamedTuple):
    """A sensor other than the receiver, at the epochs.

    name : Name in the scenario.
    card : Card of the sensor.
    channels : Its measurement channels.
    noise : Name of the source of its white noise.
    is_measuring : (n_epoch,). Whether it measures.
    truth : (n_epoch, 4). True quantities from which the measurement is simulated, see the sensor's module.
    sigma : (n_epoch, n_scalar). True sigma of its white noise, SI.
    variance : (n_epoch, n_scalar). Noise variance in the filter model, SI squared.
    lasting_errors : Lasting errors, each with its partial derivatives (n_epoch, n_scalar, n_label).
    filter_parameters : (n_epoch, N_FILTER_PARAMETER). Quantities known to the filter, see the sensor's module.
    theta : (n_epoch,) rad. Earth rotation angle that the filter uses.
    delay : (n_epoch,) s. Latency that the filter compensates.
    time_since_measurement : (n_epoch,) s. Time since the previous measurement, for a difference of two IMUs; otherwise
        empty.
    """

    name: str
    card: SensorCard
    channels: SensorChannels
    noise: str
    is_measuring: Bools
    truth: Floats
    sigma: Floats
    variance: Floats
    lasting_errors: tuple[tuple[CorrelatedError, Floats], ...]
    filter_parameters: Floats
    theta: Floats
    delay: Floats
    time_since_measurement: Floats


def flight_view(trajectory: Trajectory, t: Floats) -> FlightView:
    """Return the true flight at times t (n,) s, as sensors need it; before its start it is that of the start."""
    t = np.maximum(t, trajectory.start)
    vehicle = motion(trajectory, t)
    steady = motion(remove_oscillations(trajectory), t)
    v_e = earth_velocity(steady.r_i, steady.v_i)
    speed_e = np.linalg.norm(v_e, axis=1)
    # heights may be computed in frame i, since it is rotated about the axis of the ellipsoid only
    _, _, height = geodetic_from_ecef(vehicle.r_i)
    return FlightView(
        t=t,
        r_i=vehicle.r_i,
        v_i=vehicle.v_i,
        q_b_i=vehicle.q_b_i,
        height=height,
        theta=np.asarray(earth_angle(trajectory.theta0, t)),
        w_ib_b=vehicle.w_ib_b,
        epoch=trajectory.epoch,
        r_rest=steady.r_i,
        q_rest=steady.q_b_i,
        is_at_rest=np.logical_and.accumulate(speed_e < STILL),
    )


def _named_error(error: CorrelatedError, name: str) -> CorrelatedError:
    """Return a lasting error with the name of its sensor, if several sensors measure the same quantity."""
    labels = tuple(" ".join((name, label)).strip() for label in error.labels)
    return error._replace(source=f"{error.source} {name}", labels=labels)


def _states(
    model: SensorModel, lasting_errors: Iterable[tuple[CorrelatedError, Floats]], names: Collection[str]
) -> tuple[SensorState, ...]:
    """Return the filter states that model lasting errors of a sensor.

    Parameters
    ----------
    model
        Filter model of the sensor.
    lasting_errors
        Lasting errors with their partial derivatives (n_epoch, n_scalar, n_label).
    names
        Names of the states that the filter has.
    """
    states = []
    for error, partials in lasting_errors:
        if error.field not in model.states:
            continue
        state = model.states[error.field]
        if state.name not in names:
            continue
        for k, label in enumerate(error.labels):
            states.append(
                SensorState(
                    state.name,
                    label,
                    getattr(model, error.field),
                    model.time_constant(error.field),
                    state[1:],
                    np.ascontiguousarray(partials[:, :, k]),
                )
            )
    return tuple(states)


def measures(scenario: Scenario, card: SensorCard, flight_profile: FlightProfile, t_epoch: Floats) -> Bools:
    """Return whether a sensor measures at the epochs, (n_epoch,).

    It measures at multiples of its interval since lift-off that are epochs of the filter.

    Parameters
    ----------
    scenario
        Validated model of the case.
    card
        Card of the sensor.
    flight_profile
        Conditions of the trajectory.
    t_epoch
        (n_epoch,) s since lift-off.

    Raises
    ------
    InputError
        If a condition of the card names an event that the flight lacks.
    """
    rate = card.rate or scenario.filter.update_rate
    samples = t_epoch * rate
    deviation = np.abs(samples - np.rint(samples))
    is_due = deviation < 1e-6 * max(1.0, rate)
    is_active = is_inside(flight_profile.active_intervals(card), t_epoch)
    return is_active & is_due


def _time_since_measurement(is_measuring: Bools, t_epoch: Floats, start: float) -> Floats:
    """Return the time since the previous measurement, or since the start of the flight, (n_epoch,) s.

    Parameters
    ----------
    is_measuring
        (n_epoch,). Whether the sensor measures.
    t_epoch
        (n_epoch,) s since lift-off.
    start
        s since lift-off. Start of the flight.
    """
    measurement_times = np.where(is_measuring, t_epoch, start)
    last = np.maximum.accumulate(measurement_times)
    previous = np.concatenate([[start], last[:-1]])
    return np.asarray(t_epoch - previous)


def sensors_of(scenario: Scenario, trajectory: Trajectory, t_epoch: Floats, start: float = 0.0) -> tuple[Sensor, ...]:
    """Return the sensors other than the receiver that the filter of a scenario uses, at the epochs.

    Parameters
    ----------
    scenario, trajectory
        Validated model of the case, and its true flight.
    t_epoch
        (n_epoch,) s since lift-off.
    start
        s since lift-off. Start of the flight.

    Raises
    ------
    InputError
        If a sensor that measures on the pad only has no measurement.
    """
    cards = used_sensors(scenario)
    if not cards:
        return ()
    views = cache(lambda delay: flight_view(trajectory, t_epoch - delay))
    measurements = [card.measurement for card in cards.values()]
    compensates = scenario.filter.delay_compensation is not None
    state_names = (*scenario.filter.extra_states, *scenario.filter.consider, *scenario.filter.as_noise)
    sensors = []
    for name, card in cards.items():
        is_alone = measurements.count(card.measurement) == 1
        model = sensor_model(scenario, card)
        view = views(card.latency)
        assumed_view = views(model.latency if compensates else 0.0)
        truth = card.truth(view)
        filter_parameters = card.filter_parameters(model, assumed_view)
        is_measuring = measures(scenario, card, trajectory.flight_profile, t_epoch) & card.is_available(view)
        if card.is_on_pad and not is_measuring.any():
            message = "it measures on the pad only, and at none of its times is the vehicle on the pad"
            raise InputError(records=[Mistake(message, f"sensors.{name}")])
        time_since_measurement = np.zeros(0)
        if isinstance(card, ImuDifferenceCard):
            time_since_measurement = _time_since_measurement(is_measuring, t_epoch, start)
        sigma, variance = _white_noise(scenario, card, model, view, assumed_view, time_since_measurement)
        errors = [error if is_alone else _named_error(error, name) for error in card.correlated_errors()]
        n_scalar = len(card.scalars)
        modelled_errors = [(error, error.partials(assumed_view, n_scalar)) for error in errors]
        states = _states(model, modelled_errors, state_names)
        sensors.append(
            Sensor(
                name=name,
                card=card,
                channels=SensorChannels(card.measurement if is_alone else name, card.measurement, card.scalars, states),
                noise=card.noise if is_alone else f"{card.noise} {name}",
                is_measuring=is_measuring,
                truth=_pad_columns(truth, N_TRUTH),
                sigma=sigma,
                variance=variance,
                lasting_errors=tuple((error, error.partials(view, n_scalar)) for error in errors),
                filter_parameters=_pad_columns(filter_parameters, N_FILTER_PARAMETER),
                theta=assumed_view.theta,
                delay=t_epoch - assumed_view.t,
                time_since_measurement=time_since_measurement,
            )
        )
    return tuple(sensors)


def _white_noise(
    scenario: Scenario,
    card: SensorCard,
    model: SensorModel,
    view: FlightView,
    assumed_view: FlightView,
    time_since_measurement: Floats,
) -> tuple[Floats, Floats]:
    """Return true sigma and assumed variance of the white noise of a sensor, (n_epoch, n_scalar) SI and SI squared.

    Parameters
    ----------
    scenario, card, model
        Validated model of the case, card of the sensor, and its filter model.
    view, assumed_view
        True flight at the true times of the measurements, and at those that the filter assumes.
    time_since_measurement
        (n_epoch,) s. Time since the previous measurement, for a difference of two IMUs.
    """
    shape = (view.t.size, len(card.scalars))
    sigma = np.array(np.broadcast_to(card.noise_sigma(view), shape))
    variance = np.array(np.broadcast_to(card.assumed_variance(model, assumed_view), shape))
    if isinstance(card, ImuDifferenceCard):  # a sum of increments since the previous measurement
        walk = np.array(imu_difference_errors(scenario, card).axis_random_walks)
        sigma = walk * np.sqrt(np.repeat(time_since_measurement[:, None], 3, axis=1))
        is_matched = isinstance(getattr(scenario.filter.sensor_models, card.measurement), str)
        variance = (walk**2 if is_matched else variance) * time_since_measurement[:, None]
    return sigma, variance


def _pad_columns(values: Floats, width: int) -> Floats:
    """Return values (n_epoch, n) padded with zeros to (n_epoch, width)."""
    n_missing = width - values.shape[1]
    padded_values = np.pad(values, ((0, 0), (0, n_missing)))
    return np.ascontiguousarray(padded_values)


def sensor_arrays(sensors: tuple[Sensor, ...], channels: Channels, n_epoch: int) -> Sensors:
    """Return the sensors as arrays for the kernels.

    Parameters
    ----------
    sensors
        Sensors other than the receiver; may be empty.
    channels
        Measurement channels.
    n_epoch
        Number of epochs.
    """
    n = len(sensors)
    codes = [_KINDS.index(card_kind(type(sensor.card))) for sensor in sensors]
    n_scalar = [len(sensor.channels.labels) for sensor in sensors]
    is_measuring = np.array([sensor.is_measuring for sensor in sensors], dtype=np.bool_)
    truth = np.array([sensor.truth for sensor in sensors], dtype=float)
    filter_parameters = np.array([sensor.filter_parameters for sensor in sensors], dtype=float)
    theta = np.array([sensor.theta for sensor in sensors], dtype=float)
    source_keys = [source_word(sensor.noise) for sensor in sensors]
    return Sensors(
        code=np.array(codes, dtype=np.int64),
        channel=np.array(channels.first_channels, dtype=np.int64),
        scalars=np.array(n_scalar, dtype=np.int64),
        is_measuring=is_measuring.reshape(n, n_epoch),
        truth=truth.reshape(n, n_epoch, N_TRUTH),
        filter_parameters=filter_parameters.reshape(n, n_epoch, N_FILTER_PARAMETER),
        theta=theta.reshape(n, n_epoch),
        source_keys=np.array(source_keys, dtype=np.uint64),
    )
