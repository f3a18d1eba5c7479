"""Filter models of a scenario: assumed sensor errors and initial errors, and properties derived from its settings."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from lvnav_trade.filter.assumed import ImuModel, InitialModel, ReceiverModel
from lvnav_trade.gnss.constellation import constellation_parts
from lvnav_trade.gnss.receiver_cards import DirectSolution, SmoothingCard
from lvnav_trade.imu.array import ImuSet
from lvnav_trade.imu.differences import RelativeErrors, relative_errors
from lvnav_trade.imu.equivalent import equivalent
from lvnav_trade.imu.error_model import ImuCard
from lvnav_trade.kernels.transition import ACCEL, GYRO
from lvnav_trade.quantities.per_axis import PerAxis, each_axis
from lvnav_trade.quantities.state_layout import RELATIVE
from lvnav_trade.sensors.family import SENSOR_MEASUREMENTS, sensor_filter_model
from lvnav_trade.sensors.imu_difference import ImuDifferenceCard
from lvnav_trade.sensors.sensor import SensorCard

if TYPE_CHECKING:
    from lvnav_trade.scenario.scenario import Scenario


def sensors_measuring(scenario: Scenario, measurement: str) -> tuple[SensorCard, ...]:
    """Return the sensors of a scenario with a given measurement."""
    cards = [card for card in scenario.sensors.values() if card is not None]
    return tuple(card for card in cards if card.measurement == measurement)


def filter_measurements(scenario: Scenario) -> tuple[str, ...]:
    """Return the measurements of the filter, without those whose sensor is null."""
    return tuple(
        name
        for name in scenario.filter.measurements
        if name not in SENSOR_MEASUREMENTS or sensors_measuring(scenario, name)
    )


def used_sensors(scenario: Scenario) -> dict[str, SensorCard]:
    """Return the sensors whose measurements the filter uses, by name."""
    return {
        name: card
        for name, card in scenario.sensors.items()
        if card is not None and card.measurement in scenario.filter.measurements
    }


def sensor_model(scenario: Scenario, sensor: SensorCard) -> Any:
    """Return the filter model of a sensor; `matched` uses the numbers of the sensor's card.

    Parameters
    ----------
    scenario : Scenario
        Scenario with the filter.
    sensor : SensorCard
        A sensor of the scenario.

    Returns
    -------
    Any
        Model with the fields of the sensor's family.
    """
    model_card = getattr(scenario.filter.sensor_models, sensor.measurement)
    if isinstance(sensor, ImuDifferenceCard) and isinstance(model_card, str):
        model: Any = sensor.model
        return model.model_construct(random_walk=imu_difference_errors(scenario, sensor).random_walk)
    return sensor_filter_model(scenario.filter.sensor_models, sensor)


def imu_difference_errors(scenario: Scenario, sensor: ImuDifferenceCard) -> RelativeErrors:
    """Return the sigmas of the difference of the two IMUs of a difference sensor.

    Parameters
    ----------
    scenario : Scenario
        Scenario with an IMU array.
    sensor : ImuDifferenceCard
        Sensor that measures the difference of two of these IMUs.

    Returns
    -------
    RelativeErrors
        Errors of the difference, SI. They are those of the gyros if the sensor measures an angle (rad), otherwise those
        of the accelerometers.
    """
    assert isinstance(scenario.imu, ImuSet)  # the scenario is checked for it
    first, second = sensor.units  # numbers from 1
    quantity = GYRO if sensor.unit == "rad" else ACCEL
    return relative_errors(scenario.imu, quantity, first - 1, second - 1)


def has_receiver_solution(scenario: Scenario) -> bool:
    """Return whether the receiver computes its own solution.

    It does so for a loosely coupled filter, and for a solution that is reported next to a filter that does not use the
    receiver (an uncoupled system).
    """
    card = scenario.receiver.solution
    if isinstance(card, DirectSolution) or scenario.filter.tight:
        return False
    return scenario.filter.loose or card.reported


def is_solution_reported(scenario: Scenario) -> bool:
    """Return whether errors of the receiver's solution are reported in addition to those of the navigation filter."""
    card = scenario.receiver.solution
    return has_receiver_solution(scenario) and not isinstance(card, DirectSolution) and card.reported


def carrier_smoothing(scenario: Scenario) -> SmoothingCard | None:
    """Return the carrier smoothing of the ranges before the receiver's solution; None without such a solution."""
    card = scenario.receiver.solution
    if isinstance(card, DirectSolution) or not has_receiver_solution(scenario):
        return None
    return card.smoothing


def has_covariance(scenario: Scenario) -> bool:
    """Return whether every solution has a reported covariance, so that its scalars are processed together."""
    compensation = scenario.filter.delay_compensation
    is_extrapolated = compensation is not None and compensation.kind == "extrapolated" and scenario.filter.loose
    return has_receiver_solution(scenario) or is_extrapolated


def epoch_interval(scenario: Scenario) -> float:
    """Return the time (s) between epochs: that of the receiver if it computes a solution, otherwise of the filter."""
    rate = scenario.receiver.rate if has_receiver_solution(scenario) else scenario.filter.update_rate
    return 1.0 / rate


def _matched_imu(imu: ImuCard) -> ImuModel:
    """Return the filter model with the true numbers of an IMU.

    Parameters
    ----------
    imu : ImuCard
        Card of the IMU, SI; for an array that of the equivalent IMU.

    Notes
    -----
    The bias instability is part of the bias states. Its sigma is added in quadrature to their initial sigma. Its drift
    over short times, 2 sigma^2 / T, is added to the variance of their random walk.
    """
    model: dict[str, Any] = {"gyro_g_sensitivity": imu.gyro.g_sensitivity}
    for name, sensor in (("gyro", imu.gyro), ("accel", imu.accel)):
        instability = sensor.instability
        flicker = sensor.instability_axes(instability.sigma)
        rate = math.sqrt(2.0 / instability.time_constant)
        model |= {
            f"{name}_random_walk": sensor.random_walk,
            f"{name}_bias": each_axis(math.hypot, sensor.bias_repeatability, flicker),
            f"{name}_bias_walk": each_axis(
                lambda walk, sigma, rate=rate: math.hypot(walk, sigma * rate), sensor.rate_random_walk, flicker
            ),
            f"{name}_bias_time": None,
            f"{name}_scale_factor": sensor.scale_factor,
            f"{name}_misalignment": sensor.misalignment,
            f"{name}_nonlinearity": sensor.nonlinearity,
            f"{name}_full_scale": sensor.nonlinearity_scale,
        }
    # the numbers are in SI, without a unit, so that validation of the card is skipped
    return ImuModel.model_construct(**model)


def _with_differences(model: ImuModel, scenario: Scenario) -> ImuModel:
    """Return the model with the relative biases of the IMUs whose difference is measured."""
    relative: dict[str, PerAxis] = {}
    for card in used_sensors(scenario).values():
        if isinstance(card, ImuDifferenceCard):
            state, errors = RELATIVE[card.measurement], imu_difference_errors(scenario, card)
            relative |= {
                state: errors.bias,
                f"{state}_walk": errors.walk,
                f"{state}_correlation": errors.correlation,
            }
    return model.model_copy(update=relative)


class _Matched:
    """A filter model with true numbers, each computed on access, so that only settings with an effect are read."""

    def __init__(self, **numbers: Callable[[], Any]) -> None:
        self._numbers = numbers

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_") or name not in self._numbers:
            raise AttributeError(name)
        return self._numbers[name]()


def _matched_receiver(scenario: Scenario) -> Any:
    """Return a `ReceiverModel` with the true numbers of a scenario.

    Errors of several causes in a pseudorange are combined into one bias, with the time constant of the largest. A
    receiver that computes its solution reports its covariance, so that no sigmas of the solution are needed.
    """
    receiver = scenario.receiver
    air = scenario.atmosphere
    systems = constellation_parts(scenario.constellation)

    def largest(*pairs: tuple[float, float | None]) -> tuple[float, float | None]:
        return max(pairs, key=lambda pair: pair[0])

    def offset() -> tuple[float, float | None]:
        return largest(*((system.time_offset, system.time_offset_time) for system in systems))

    def multipath() -> float:
        return receiver.amplification * receiver.multipath

    def solution_number(name: str, default: float | None) -> Callable[[], Any]:
        def number() -> Any:
            has_number = isinstance(receiver.solution, DirectSolution)
            return getattr(receiver.solution, name) if has_number else default

        return number

    return _Matched(
        noise_by=lambda: receiver.noise_by,
        pseudorange_sigma=lambda: receiver.pseudorange_sigma,
        range_rate_sigma=lambda: receiver.range_rate_sigma,
        position_sigma=solution_number("position_sigma", 0.0),
        velocity_sigma=solution_number("velocity_sigma", 0.0),
        clock_h0=lambda: receiver.clock.h0,
        clock_h_minus2=lambda: receiver.clock.h_minus2,
        range_bias=lambda: math.hypot(max(system.range_error for system in systems), multipath()),
        range_bias_time=lambda: largest(
            *((system.range_error, system.range_error_time) for system in systems),
            (multipath(), receiver.multipath_time),
        )[1],
        range_rate_offset=lambda: math.hypot(receiver.range_rate_offset, receiver.range_rate_instability),
        range_rate_offset_time=lambda: largest(
            (receiver.range_rate_offset, None), (receiver.range_rate_instability, receiver.range_rate_instability_time)
        )[1],
        time_offset=lambda: offset()[0],
        time_offset_time=lambda: offset()[1],
        troposphere_scale=lambda: air.troposphere_scale,
        troposphere_scale_time=lambda: air.troposphere_scale_time,
        ionosphere_scale=lambda: air.ionosphere_scale,
        ionosphere_scale_time=lambda: air.ionosphere_scale_time,
        timing=lambda: receiver.latency_error,
        timing_time=lambda: None,
        position_bias=solution_number("position_bias", 0.0),
        position_bias_time=solution_number("bias_time", None),
        velocity_bias=solution_number("velocity_bias", 0.0),
        velocity_bias_time=solution_number("bias_time", None),
        carrier_phase_sigma=lambda: receiver.carrier_phase_sigma,
        ambiguity=lambda: receiver.carrier_ambiguity,
    )


def filter_models(scenario: Scenario) -> tuple[ImuModel, ReceiverModel, InitialModel]:
    """Return the filter models of IMU, receiver and initial errors; `matched` uses the true numbers.

    Returns
    -------
    ImuModel, ReceiverModel, InitialModel
        Models in SI units.
    """
    card, initial, clock = scenario.filter, scenario.initial, scenario.receiver.clock
    imu = card.imu
    if isinstance(imu, str):
        imu = _with_differences(_matched_imu(equivalent(scenario.imu)), scenario)
    receiver = _matched_receiver(scenario) if isinstance(card.receiver, str) else card.receiver
    if isinstance(card.initial, str):
        start = InitialModel.model_construct(
            tilt=initial.tilt,
            heading=initial.heading,
            position=initial.position,
            velocity=initial.velocity,
            clock_bias=clock.initial_bias,
            clock_drift=clock.initial_drift,
        )
    else:
        start = card.initial
    return imu, receiver, start
