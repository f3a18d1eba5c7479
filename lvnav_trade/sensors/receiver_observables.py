"""Partial derivatives of measurements beyond the navigation state: biases, delays, timing, lever arm.

Truth and filter model both use these functions, each with its own geometry: for correlated measurement errors, and for
extra states. A channel is an observable of a satellite (tight coupling: pseudorange, range rate, then further
observables) or an axis of the receiver's solution (loose coupling: position, velocity).
"""

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from lvnav_trade.quantities.records import Floats, Ints
from lvnav_trade.quantities.state_layout import BY_SATELLITE, RELATIVE

FURTHER = ("carrier_phase", "tdcp", "delta_pseudorange")
"""Observables of a satellite other than pseudorange and range rate, in the order of their channels."""
PHASES = ("carrier_phase", "tdcp")
DIFFERENCES = {"tdcp": "carrier_phase", "delta_pseudorange": "pseudorange"}
"""Observables that are the difference of another observable at two successive epochs."""
LABELS = {
    "pseudorange": "range",
    "range_rate": "range rate",
    "carrier_phase": "carrier phase",
    "tdcp": "phase difference",
    "delta_pseudorange": "range difference",
}
# Extra states for the error of a single observable.
OBSERVABLE_STATES = {"ambiguity": "carrier_phase", "phase_noise": "tdcp", "code_noise": "delta_pseudorange"}
LEVER_AXES = ("lever_x", "lever_y", "lever_z")
RANGE_ONLY = ("range_bias", "time_offset")
RATE_ONLY = ("range_rate_offset",)
SATELLITE_KINDS = (
    *RANGE_ONLY,
    *RATE_ONLY,
    "timing",
    "troposphere_scale",
    "ionosphere_scale",
    *BY_SATELLITE,
    *LEVER_AXES,
    *OBSERVABLE_STATES,
)
SOLUTION_KINDS = ("position_bias", "velocity_bias", "timing", "troposphere_scale", "ionosphere_scale")


class SensorState(NamedTuple):
    """An extra state of the filter for a lasting error of a sensor, as the filter models it.

    name : Name of the state.
    label : Label of the error; empty for a single error.
    sigma : SI. Initial standard deviation.
    time_constant : s. Infinite for a constant.
    unit : SI unit, display unit, and factor from SI to display unit.
    partial : (n_epoch, n_scalar). Derivative of the scalars by the state.
    """

    name: str
    label: str
    sigma: float
    time_constant: float
    unit: tuple[str, str, float]
    partial: Floats


class SensorChannels(NamedTuple):
    """Channels of a sensor other than the receiver.

    name : Name of the sensor in the scenario.
    measurement : Name of its measurement.
    labels : Label of each scalar.
    states : Extra states that a filter may have for its lasting errors.
    """

    name: str
    measurement: str
    labels: tuple[str, ...]
    states: tuple[SensorState, ...] = ()


class Channels(NamedTuple):
    """Measurement channels of a case, those of the receiver first.

    tight : Whether the filter measures satellites (tight coupling).
    satellites : (n_sat,). Names of the satellites.
    systems : (n_sat,). Letters of their systems.
    is_tracked : (n_sat,). Whether the satellite is ever tracked.
    receiver : Whether the filter uses the receiver.
    sensors : Other sensors, in the order of their channels.
    further : Observables of each satellite in addition to pseudorange and range rate.
    """

    tight: bool
    satellites: tuple[str, ...]
    systems: tuple[str, ...]
    is_tracked: tuple[bool, ...]
    receiver: bool = True
    sensors: tuple[SensorChannels, ...] = ()
    further: tuple[str, ...] = ()

    @property
    def observables(self) -> tuple[str, ...]:
        """Observables of a satellite, in the order of its channels."""
        return ("pseudorange", "range_rate", *self.further)

    def observable_slice(self, observable: str) -> slice:
        """Return the channels of an observable of all satellites."""
        return slice(self.observables.index(observable), self.n_receiver, len(self.observables))

    @property
    def n_channel(self) -> int:
        """Number of channels."""
        return self.n_receiver + sum(len(sensor.labels) for sensor in self.sensors)

    @property
    def n_receiver(self) -> int:
        """Number of channels of the receiver."""
        return len(self.observables) * len(self.satellites) if self.tight else 6

    @property
    def first_channels(self) -> tuple[int, ...]:
        """First channel of each sensor."""
        channels = []
        channel = self.n_receiver
        for sensor in self.sensors:
            channels.append(channel)
            channel += len(sensor.labels)
        return tuple(channels)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the channels: observables satellite by satellite, or axes of the solution, then those of sensors."""
        if self.tight:
            names = [f"{satellite} {LABELS[name]}" for satellite in self.satellites for name in self.observables]
        else:
            names = [f"{vector} {axis}" for vector in ("position", "velocity") for axis in "xyz"]
        for sensor in self.sensors:
            names += [f"{sensor.name} {label}".strip() for label in sensor.labels]
        return tuple(names)


class MeasurementGeometry(NamedTuple):
    """Geometry at the epochs from which the partial derivatives of measurements are computed, SI, frame i.

    rate : (n_epoch, n_sat) m/s. Range rate.
    acceleration : (n_epoch, n_sat) m/s^2. Second derivative of the range.
    velocity : (n_epoch, 3) m/s. Velocity of the antenna.
    antenna_acceleration : (n_epoch, 3) m/s^2. Acceleration of the antenna, without that by the lever arm.
    troposphere : (n_epoch, n_sat, 2) m, m/s. Tropospheric delay and its rate.
    ionosphere : (n_epoch, n_sat, 2) m, m/s. Ionospheric delay and its rate.
    solution_troposphere : (n_epoch, 6) m, m/s. Error that the tropospheric delay causes in a least-squares solution.
    solution_ionosphere : (n_epoch, 6) m, m/s. Error that the ionospheric delay causes in a least-squares solution.
    lever : (n_epoch, n_sat, 2, 3). Derivative of range and range rate with respect to the lever arm, body axes.
    """

    rate: Floats
    acceleration: Floats
    velocity: Floats
    antenna_acceleration: Floats
    troposphere: Floats
    ionosphere: Floats
    solution_troposphere: Floats
    solution_ionosphere: Floats
    lever: Floats


def members(error_type: str, channels: Channels) -> tuple[tuple[str, ...], Ints]:
    """Return the components of a kind of error, and the component in each channel.

    Parameters
    ----------
    error_type : str
        Kind of the error, a key of `state_layout.EXTRAS` or a lever-arm axis.
    channels : Channels

    Returns
    -------
    labels : tuple of str
        Label of each component. There is one component for each satellite ever tracked (range bias, scale factor by
        satellite, ambiguity, noise of an observable), for each system except GPS or the first (time offset), for each
        axis of frame i (bias of the solution) or of the body (relative bias of two IMUs), otherwise one for all
        channels.
    member : (n_channel,)
        Component in each channel, -1 none.
    """
    if error_type in RELATIVE.values():
        return _relative_members(error_type, channels)
    if not channels.tight:
        return _solution_members(error_type, channels)
    member = np.full(channels.n_channel, -1, dtype=np.int64)
    if error_type not in SATELLITE_KINDS:
        return (), member
    if error_type in OBSERVABLE_STATES and OBSERVABLE_STATES[error_type] not in channels.further:
        return (), member
    labels, owner = _satellite_members(error_type, channels)
    for observable in channels.observables:
        if _affects_observable(error_type, observable):
            member[channels.observable_slice(observable)] = owner
    return labels, member


def _relative_members(error_type: str, channels: Channels) -> tuple[tuple[str, ...], Ints]:
    """Return labels and members, see `members`, of a relative bias of two IMUs."""
    member = np.full(channels.n_channel, -1, dtype=np.int64)
    for first, sensor in zip(channels.first_channels, channels.sensors, strict=True):
        if RELATIVE.get(sensor.measurement) == error_type:
            member[first : first + 3] = range(3)
    labels = ("x", "y", "z") if np.any(member >= 0) else ()
    return labels, member


def _solution_members(error_type: str, channels: Channels) -> tuple[tuple[str, ...], Ints]:
    """Return labels and members, see `members`, of an error of the receiver's solution."""
    member = np.full(channels.n_channel, -1, dtype=np.int64)
    if error_type not in SOLUTION_KINDS:
        return (), member
    axes = {"position_bias": [0, 1, 2, -1, -1, -1], "velocity_bias": [-1, -1, -1, 0, 1, 2]}
    member[: channels.n_receiver] = axes.get(error_type, 0)
    labels = ("x", "y", "z") if error_type in axes else ("",)
    return labels, member


def _satellite_members(error_type: str, channels: Channels) -> tuple[tuple[str, ...], list[int]]:
    """Return the labels of an error of the satellites, and the component of each satellite, -1 none."""
    if error_type == "range_bias" or error_type in OBSERVABLE_STATES or error_type in BY_SATELLITE:
        owners = channels.satellites
        satellites = zip(owners, channels.is_tracked, strict=True)
        labels = tuple(name for name, is_tracked in satellites if is_tracked)
    elif error_type == "time_offset":
        owners = channels.systems
        reference = "G" if "G" in owners else owners[0]
        labels = tuple(system for system in dict.fromkeys(owners) if system != reference)
    else:
        return ("",), [0] * len(channels.satellites)
    components = [labels.index(name) if name in labels else -1 for name in owners]
    return labels, components


def sensor_states(name: str, channels: Channels) -> Iterator[tuple[SensorState, Ints, Floats]]:
    """Yield the extra states of a name for lasting errors of sensors.

    Each comes with its component in each channel, (n_channel,) with -1 for none, and its partials (n_epoch, n_channel).
    """
    for first, sensor in zip(channels.first_channels, channels.sensors, strict=True):
        columns = slice(first, first + len(sensor.labels))
        for state in sensor.states:
            if state.name == name:
                member = np.full(channels.n_channel, -1, dtype=np.int64)
                member[columns] = np.where(np.any(state.partial != 0.0, axis=0), 0, -1)
                partials = np.zeros((len(state.partial), channels.n_channel))
                partials[:, columns] = state.partial
                yield state, member, partials


def _affects_observable(error_type: str, observable: str) -> bool:
    """Return whether an error of a kind affects an observable of the satellites."""
    if error_type in OBSERVABLE_STATES:
        return OBSERVABLE_STATES[error_type] == observable
    is_rate = observable == "range_rate"
    return is_rate if error_type in RATE_ONLY else not (is_rate and error_type in RANGE_ONLY)


def partial(error_type: str, geometry: MeasurementGeometry, channels: Channels) -> Floats:
    """Return the derivative (n_epoch, n_channel) of the measurements with respect to an error of a kind.

    Parameters
    ----------
    error_type : str
        Kind of the error, as in `members`.
    geometry : MeasurementGeometry
    channels : Channels

    Returns
    -------
    (n_epoch, n_channel)
        Biases and lever arms: m/m and (m/s)/m. Scale factors of delays: m and m/s. Timing error: m/s and m/s^2,
        negative, because a measurement with latency s is that of s seconds earlier.
    """
    derivative = np.zeros((len(geometry.rate), channels.n_channel))
    if channels.tight:
        for observable in channels.observables:
            derivative[:, channels.observable_slice(observable)] = _range_partial(error_type, geometry, observable)
    else:
        position, velocity = _solution_partials(error_type, geometry)
        derivative[:, :3] = position
        derivative[:, 3 : channels.n_receiver] = velocity
    return derivative


def _solution_partials(error_type: str, geometry: MeasurementGeometry) -> tuple[Any, Any]:
    """Return the derivatives (n_epoch, 3), or single numbers, of position and velocity of a solution, see `partial`."""
    error_type = BY_SATELLITE.get(error_type, error_type)
    if error_type == "timing":
        return -geometry.velocity, -geometry.antenna_acceleration
    if error_type == "troposphere_scale":
        return geometry.solution_troposphere[:, :3], geometry.solution_troposphere[:, 3:]
    if error_type == "ionosphere_scale":
        return geometry.solution_ionosphere[:, :3], geometry.solution_ionosphere[:, 3:]
    if error_type in ("position_bias", "velocity_bias"):
        return 1.0, 1.0
    return 0.0, 0.0


def _range_partial(error_type: str, geometry: MeasurementGeometry, observable: str) -> Any:
    """Return the derivative (n_epoch, n_sat), or a single number, of an observable of the satellites, see `partial`.

    For a difference of two epochs it is the derivative with respect to the error at the later epoch.
    """
    if error_type in (*RANGE_ONLY, *RATE_ONLY, *OBSERVABLE_STATES):
        return float(_affects_observable(error_type, observable))
    order = int(observable == "range_rate")
    error_type = BY_SATELLITE.get(error_type, error_type)
    if error_type == "timing":
        return (-geometry.rate, -geometry.acceleration)[order]
    if error_type == "troposphere_scale":
        return geometry.troposphere[..., order]
    if error_type == "ionosphere_scale":
        # the ionosphere delays the code and advances the carrier
        sign = -1.0 if observable in PHASES else 1.0
        return sign * geometry.ionosphere[..., order]
    if error_type in LEVER_AXES:
        return geometry.lever[:, :, order, LEVER_AXES.index(error_type)]
    return 0.0
