"""Layout of a filter's error states: names, offsets, units, and the outputs that are reported for them."""

import math
from typing import NamedTuple

from lvnav_trade.kernels.transition import ACCEL, CONSTANT, GYRO, OTHER_0, OWN_0, OWN_1, SQUARE
from lvnav_trade.quantities.per_axis import PerAxis, axes
from lvnav_trade.quantities.records import Ints, Output


class ParameterKind(NamedTuple):
    """A kind of IMU error parameter.

    sensor : GYRO or ACCEL.
    drivers : Quantities that it multiplies, as in `kernels.transition`; a block of three states for each.
    unit : SI unit.
    label_unit : Display unit.
    label_factor : Factor from SI to the display unit.
    """

    sensor: int
    drivers: tuple[int, ...]
    unit: str
    label_unit: str
    label_factor: float


_DEG_H = 206264.80624709636
_DEG_S, _MG = 180.0 / math.pi, 1e3 / 9.80665

NO_SENSOR = -1

# Every kind of IMU parameter by name. A kind with several drivers has a block of three states for each.
PARAMETERS = {
    "gyro_bias": ParameterKind(GYRO, (CONSTANT,), "rad/s", "deg/h", _DEG_H),
    "accel_bias": ParameterKind(ACCEL, (CONSTANT,), "m/s^2", "mg", _MG),
    "gyro_scale_factor": ParameterKind(GYRO, (OWN_0,), "1", "ppm", 1e6),
    "accel_scale_factor": ParameterKind(ACCEL, (OWN_0,), "1", "ppm", 1e6),
    "gyro_nonlinearity": ParameterKind(GYRO, (SQUARE,), "s/rad", "ppm/(deg/s)", 1e6 / _DEG_S),
    "accel_nonlinearity": ParameterKind(ACCEL, (SQUARE,), "s^2/m", "ppm/g", 1e9 / _MG),
    "gyro_misalignment": ParameterKind(GYRO, (OWN_1, OWN_1 + 1), "rad", "mrad", 1e3),
    "accel_misalignment": ParameterKind(ACCEL, (OWN_1, OWN_1 + 1), "rad", "mrad", 1e3),
    "gyro_g_sensitivity": ParameterKind(
        GYRO, (OTHER_0, OTHER_0 + 1, OTHER_0 + 2), "rad*s/m", "deg/h/g", _DEG_H * 9.80665
    ),
}


class ErrorTerm(NamedTuple):
    """An error parameter on the three axes of a sensor: true error of an IMU, or states of a filter.

    The error of the measured quantity is the parameter times its driver. The parameter is a stationary Gauss-Markov
    process of standard deviation `sigma`, or a constant with a random walk that starts at `sigma`.

    name : Physical cause of a true error; kind of a filter state, as in `PARAMETERS`.
    term_index : Index of the term among the terms of that name.
    sensor : GYRO, ACCEL, or NO_SENSOR for a disturbance of the vehicle.
    driver : Quantity that it multiplies, as in `kernels.transition`.
    sigma : SI, for all axes or by axis. Initial standard deviation.
    walk : SI per root second, for all axes or by axis. Root PSD of the random walk.
    time_constant : s. Correlation time of the Gauss-Markov process; infinite: a constant.
    triad : Index of the triad of the IMU array.
    offset : First of the three filter states that model it; -1 none.
    """

    name: str
    term_index: int
    sensor: int
    driver: int
    sigma: PerAxis
    walk: PerAxis = 0.0
    time_constant: float = math.inf
    triad: int = 0
    offset: int = -1

    @property
    def is_nonzero(self) -> bool:
        """Whether the error is not zero on every axis."""
        sizes = (*axes(self.sigma), *axes(self.walk))
        return max(sizes) > 0.0


# Every kind of extra state, shared by several measurements: SI unit, display unit, factor to the display unit.
EXTRAS = {
    "range_bias": ("m", "m", 1.0),
    "time_offset": ("m", "m", 1.0),
    "range_rate_offset": ("m/s", "m/s", 1.0),
    "timing": ("s", "ms", 1e3),
    "troposphere_scale": ("1", "%", 1e2),
    "ionosphere_scale": ("1", "%", 1e2),
    "troposphere_scale_by_satellite": ("1", "%", 1e2),
    "ionosphere_scale_by_satellite": ("1", "%", 1e2),
    "ambiguity": ("m", "m", 1.0),
    "phase_noise": ("m", "mm", 1e3),
    "code_noise": ("m", "m", 1.0),
    "position_bias": ("m", "m", 1.0),
    "velocity_bias": ("m/s", "m/s", 1.0),
    "gyro_relative_bias": ("rad/s", "deg/h", _DEG_H),
    "accel_relative_bias": ("m/s^2", "mg", _MG),
}
# Extra states by satellite that model one error common to all satellites.
BY_SATELLITE = {f"{name}_by_satellite": name for name in ("troposphere_scale", "ionosphere_scale")}
# Extra states that follow from the measurements of satellites; no card names them.
OF_OBSERVABLES = ("ambiguity", "phase_noise", "code_noise")
# Extra states of a filter that measures the difference of two IMUs, by measurement.
RELATIVE = {"angle_difference": "gyro_relative_bias", "velocity_difference": "accel_relative_bias"}


class ExtraBlock(NamedTuple):
    """States of one kind that several measurements share, or that belong to a sensor.

    name : Kind of the states, such as range_bias.
    labels : (n,). Label of each state: a satellite, a system or an axis; empty for a state common to all.
    offset : First state.
    member : (n_channel,). State of the block that enters the channel, -1 none.
    sigma : SI. Initial sigma; for a relative bias of all axes or by axis, like its walk and its correlation.
    time_constant : s. Correlation time; infinite for a constant.
    unit : SI unit, display unit, and factor from SI to display unit.
    walk : SI per root second. Root PSD of the random walk.
    correlation : Initial correlation of a relative bias with the bias of the combined triad.
    """

    name: str
    labels: tuple[str, ...]
    offset: int
    member: Ints
    sigma: PerAxis
    time_constant: float
    unit: tuple[str, str, float]
    walk: PerAxis = 0.0
    correlation: PerAxis = 0.0


def states_modelling(extras: tuple[ExtraBlock, ...], state: str, label: str) -> list[tuple[int, int]]:
    """Return the extra states that model a true error.

    Parameters
    ----------
    extras : blocks of extra states of the filter
    state : str
        Kind of the state, one of `EXTRAS`.
    label : str
        Satellite, system or axis; empty for an error common to all.

    Returns
    -------
    list of (int, int)
        Index of the block and index among all extra states: the state of that kind and label, or the states of all
        satellites if the filter models the error by satellite.
    """
    states = []
    number = 0
    for k, block in enumerate(extras):
        is_by_satellite = bool(state) and BY_SATELLITE.get(block.name) == state
        for member in block.labels:
            if is_by_satellite or (block.name, member) == (state, label):
                states.append((k, number))
            number += 1
    return states


class StateLayout(NamedTuple):
    """Order of the error states of a filter.

    Attitude, velocity and position come first (0, 3, 6), then parameters, clock and extra states, and the vehicle's
    motion. States from `n_estimated` on are considered, not estimated, except the `n_earlier_epoch` states from
    `earlier_epoch` on. These belong to the earlier epoch of a difference and are not reported: noise states of that
    epoch, then clones.

    parameters : IMU parameters, three states each.
    clock : State of the clock bias, followed by the drift; -1 without a clock.
    n_estimated : Number of estimated states before those of the earlier epoch.
    n_state : Number of states.
    extras : Blocks of extra states.
    motion : First of six states of the vehicle's motion, rate (3) and specific force (3); -1 none.
    samples : Whether errors of the IMU samples are reported after those of the states.
    earlier_epoch : First state of the earlier epoch.
    n_earlier_epoch : Number of states of the earlier epoch.
    clone : First cloned state, -1 none.
    cloned_states : States that are cloned, in the order of the clones.
    """

    parameters: tuple[ErrorTerm, ...]
    clock: int
    n_estimated: int
    n_state: int
    extras: tuple[ExtraBlock, ...] = ()
    motion: int = -1
    samples: bool = False
    earlier_epoch: int = 0
    n_earlier_epoch: int = 0
    clone: int = -1
    cloned_states: tuple[int, ...] = ()

    @property
    def reported_states(self) -> tuple[int, ...]:
        """Indices of the states whose errors are reported."""
        end = self.earlier_epoch + self.n_earlier_epoch
        earlier_states = range(self.earlier_epoch, end)
        return tuple(i for i in range(self.n_state) if i not in earlier_states)

    @property
    def has_reduced_clock(self) -> bool:
        """Whether the filter estimates the clock bias but not its drift, which is assumed to be zero."""
        return self.clock >= 0 and self.clock + 1 == self.n_estimated


# Rate and acceleration of the vehicle: SI unit, display unit, factor to the display unit
MOTION = (("rate", "rad/s", "deg/h", _DEG_H), ("acceleration", "m/s^2", "mg", _MG))
# IMU samples whose errors are reported next to those of the states: as measured, and less the estimated bias
SAMPLES = ("raw", "corrected")
_BODY = {"rate": ("roll", "pitch", "yaw"), "acceleration": ("x", "y", "z")}


def state_names(layout: StateLayout) -> tuple[str, ...]:
    """Return the names of the states in storage order, such as 'velocity x'.

    Navigation states are resolved in frame i, IMU parameters in body axes.
    """
    names = [f"{name} {axis}" for name in ("attitude", "velocity", "position") for axis in "xyz"]
    further_states = state_outputs(layout, "inertial")[len(names) :]
    for output in further_states:
        names.append(f"{output.quantity} {output.axis}")
    for clone, state in enumerate(layout.cloned_states, start=layout.clone):
        names[clone] = f"delayed_{names[state]}"
    return tuple(names)


AXES = {
    "ned": ("north", "east", "down"),
    "ecef": ("x", "y", "z"),
    "inertial": ("x", "y", "z"),
    "orbital": ("radial", "along", "cross"),
    "pad": ("azimuth", "range", "elevation"),
}


def outputs(layout: StateLayout, frame: str) -> tuple[Output, ...]:
    """Return the columns of a history: the reported states in storage order, then the errors of the IMU samples.

    Attitude errors are reported in body axes (roll, pitch, yaw), velocity and position errors in the axes of `frame`,
    one of `AXES`.
    """
    states = state_outputs(layout, frame)
    columns = [states[i] for i in layout.reported_states]
    if layout.samples:
        for sample in SAMPLES:
            columns += _motion_outputs(f"{sample}_")
    return tuple(columns)


def state_outputs(layout: StateLayout, frame: str) -> list[Output]:
    """Return quantity and unit of every state; a clone has those of its original state."""
    navigation = [Output("attitude", axis, "rad", "mrad", 1e3) for axis in _BODY["rate"]]
    navigation += _trajectory_outputs("", frame)
    table = dict(enumerate(navigation))
    for block in layout.parameters:
        _, drivers, unit, label_unit, factor = PARAMETERS[block.name]
        suffix = "" if len(drivers) == 1 else str(block.term_index + 1)
        for i, axis in enumerate("xyz"):
            state = block.offset + i
            table[state] = Output(block.name, axis + suffix, unit, label_unit, factor)
    if layout.clock >= 0:
        table[layout.clock] = Output("clock_bias", "time", "m", "m", 1.0)
        table[layout.clock + 1] = Output("clock_drift", "rate", "m/s", "m/s", 1.0)
    for extra in layout.extras:
        for i, label in enumerate(extra.labels):
            state = extra.offset + i
            table[state] = Output(extra.name, label or "all", *extra.unit)
    if layout.motion >= 0:
        motion = enumerate(_motion_outputs(""), start=layout.motion)
        table.update(motion)
    for clone, state in enumerate(layout.cloned_states, start=layout.clone):
        table[clone] = table[state]
    return [table[i] for i in range(layout.n_state)]


def _trajectory_outputs(prefix: str, frame: str) -> list[Output]:
    axis_names = AXES[frame]
    velocity = [Output(f"{prefix}velocity", axis, "m/s", "m/s", 1.0) for axis in axis_names]
    position = [Output(f"{prefix}position", axis, "m", "m", 1.0) for axis in axis_names]
    return velocity + position


def _motion_outputs(prefix: str) -> list[Output]:
    columns = []
    for name, unit, label_unit, factor in MOTION:
        columns += [Output(prefix + name, axis, unit, label_unit, factor) for axis in _BODY[name]]
    return columns


# Quantities with a protection level, and the SI unit of that level
PROTECTED = {"position": "m", "velocity": "m/s"}


def split_metric(name: str) -> tuple[str, str]:
    """Split a metric such as ``velocity_error_3d`` into quantity and axis; without an axis it is the norm, 3d."""
    quantity, _, axis = name.partition("_error")
    return quantity, axis.removeprefix("_") or "3d"


# Prefix of the errors of the backup strapdown, which the filter never corrects
BACKUP = "backup_"


def backup_outputs(frame: str) -> tuple[Output, ...]:
    """Return the outputs of the backup strapdown, which the filter never corrects; they follow all other outputs."""
    attitude = [Output(f"{BACKUP}attitude", axis, "rad", "mrad", 1e3) for axis in _BODY["rate"]]
    trajectory = _trajectory_outputs(BACKUP, frame)
    return (*attitude, *trajectory)


def solution_outputs(frame: str) -> tuple[Output, ...]:
    """Return the outputs of the receiver solution; they follow those of the filter states."""
    trajectory = _trajectory_outputs("solution_", frame)
    return (
        *trajectory,
        Output("receiver_clock_bias", "time", "m", "m", 1.0),
        Output("receiver_clock_drift", "rate", "m/s", "m/s", 1.0),
    )
