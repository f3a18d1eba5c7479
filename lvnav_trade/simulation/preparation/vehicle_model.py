"""Vehicle model of a filter: process noise from the motion envelope, IMU samples as measurements."""

import math

import numpy as np

from lvnav_trade.filter.policies.imu_samples import VehicleModel
from lvnav_trade.kernels.transition import ACCEL, CONSTANT, GYRO
from lvnav_trade.kernels.vehicle import N_SAMPLE
from lvnav_trade.quantities.per_axis import PerAxis, squares
from lvnav_trade.quantities.records import Bools, Floats, Reference
from lvnav_trade.quantities.shared_cards import EnvelopeCard, is_changing
from lvnav_trade.quantities.state_layout import ErrorTerm, StateLayout
from lvnav_trade.scenario.filter_models import filter_models
from lvnav_trade.scenario.scenario import Scenario
from lvnav_trade.simulation.preparation.inputs import ReportedSamples
from lvnav_trade.trajectory.guided.course import stage_event_times
from lvnav_trade.trajectory.truth import Trajectory


def _sensor_variances(gyro: PerAxis, accel: PerAxis) -> Floats:
    """Return the squares (6,) of one-sigmas of the gyro and of the accelerometer."""
    gyro_variances = squares(gyro)
    accel_variances = squares(accel)
    return np.array([*gyro_variances, *accel_variances])


def vehicle_of(scenario: Scenario, trajectory: Trajectory, ref: Reference, layout: StateLayout) -> VehicleModel | None:
    """Return the vehicle model of a filter; None unless it processes IMU samples as measurements.

    Parameters
    ----------
    scenario
        Validated model of the case.
    trajectory, ref
        True flight, and true motion at the ticks.
    layout
        States of the filter.
    """
    if layout.motion < 0:
        return None
    dt = 1.0 / scenario.imu.rate
    imu, _, _ = filter_models(scenario)
    sensor_blocks: tuple[list[tuple[int, ErrorTerm]], ...] = ([], [])  # of gyro and accelerometer
    for number, block in enumerate(layout.parameters):
        if block.sensor in (GYRO, ACCEL):
            sensor_blocks[block.sensor].append((number, block))
    max_blocks = max(len(blocks) for blocks in sensor_blocks)
    blocks = np.full((2, max_blocks, 2), (-1, CONSTANT), dtype=np.int64)
    motion_states = layout.motion + np.arange(N_SAMPLE)
    columns = np.repeat(motion_states[:, None], 1 + max_blocks, axis=1)
    for sensor, sensor_entries in enumerate(sensor_blocks):
        rows = slice(3 * sensor, 3 * sensor + 3)
        for k, (number, block) in enumerate(sensor_entries):
            blocks[sensor, k] = number, block.driver
            columns[rows, 1 + k] = block.offset + np.arange(3)
    return VehicleModel(
        motion=layout.motion,
        blocks=blocks,
        columns=columns,
        walk=walks(scenario.filter.envelope or EnvelopeCard(), trajectory, ref),
        variance=_sensor_variances(imu.gyro_random_walk, imu.accel_random_walk) / dt,
        rate=ref.dtheta / dt,
        force=ref.dvel / dt,
    )


def samples_of(scenario: Scenario, ref: Reference, layout: StateLayout) -> ReportedSamples | None:
    """Return the inputs of the reported errors of IMU samples; None if they are not reported.

    Parameters
    ----------
    scenario
        Validated model of the case.
    ref
        True motion and ideal increments.
    layout
        States of the filter.
    """
    if not layout.samples:
        return None
    dt = 1.0 / scenario.imu.rate
    imu, _, _ = filter_models(scenario)
    noise = _sensor_variances(imu.gyro_random_walk, imu.accel_random_walk) / dt
    par = np.full(2, -1, dtype=np.int64)
    bias = np.full(6, -1, dtype=np.int64)
    for number, block in enumerate(layout.parameters):
        if block.driver == CONSTANT and block.sensor in (GYRO, ACCEL):
            par[block.sensor] = number
            bias[3 * block.sensor : 3 * block.sensor + 3] = block.offset + np.arange(3)
    return ReportedSamples(
        rate=ref.dtheta / dt,
        force=ref.dvel / dt,
        par=par,
        bias=bias,
        raw=noise + _sensor_variances(imu.gyro_bias, imu.accel_bias),
        variance=noise,
    )


def walks(card: EnvelopeCard, trajectory: Trajectory, ref: Reference) -> Floats:
    """Return the variances of the steps of angular rate and specific force into each tick, (n_tick, 6) SI squared.

    The envelope depends on commanded rates and nozzle angles. Without control they are the rates of the trajectory and
    a fixed nozzle; under control they are the commands of the controller.

    Parameters
    ----------
    card
        Envelope card.
    trajectory, ref
        True flight, and true motion at the ticks.
    """
    t = ref.t[:-1]
    rate = ref.w_ib_b[:-1, 1:]
    nozzle = np.zeros((t.size, 2))
    if trajectory.commands is not None:
        rate, nozzle = trajectory.commands.sample(t)
    is_burning = burning(trajectory, t)
    bounds = envelopes(card, t, is_burning, stage_event_times(trajectory), rate, nozzle)
    dt = t[1] - t[0]
    return np.hstack(bounds) ** 2 * dt**2


def burning(trajectory: Trajectory, t: Floats) -> Bools:
    """Return whether a motor burns at times t (n,) s: from lift-off or an ignition to the next cut-off."""
    is_burning = np.zeros(t.size, dtype=bool)
    for start, end in burns(trajectory):
        is_burning |= (t >= start) & (t < end)
    return is_burning


def burns(trajectory: Trajectory) -> list[tuple[float, float]]:
    """Return start and end (s) of each burn, from the names of events; a burn without a cut-off lasts to the end."""
    marks: list[tuple[float, bool]] = []
    for name, t in trajectory.events.items():
        is_cutoff = "cutoff" in name
        if is_cutoff or name == "liftoff" or "ignition" in name:
            marks.append((t, is_cutoff))
    intervals: list[tuple[float, float]] = []
    start: float | None = None
    for t, is_cutoff in sorted(marks):
        if is_cutoff and start is not None:
            intervals.append((start, t))
            start = None
        elif not is_cutoff and start is None:
            start = t
    if start is not None:
        intervals.append((start, trajectory.end))
    return intervals


def envelopes(
    card: EnvelopeCard,
    t: Floats,
    is_burning: Bools,
    changes: Floats,
    commanded_rate: Floats,
    nozzle_command: Floats,
) -> tuple[Floats, Floats]:
    """Return the motion envelope at equidistant times: standard deviations of angular acceleration and jerk.

    Derivatives are backward differences; before the first tick the nozzle is centred. A command acts from the next tick
    on. A change of phase does not count as coast, because air and next motor may already rotate the vehicle.

    Parameters
    ----------
    card
        Envelope card.
    t
        (n,) s since lift-off.
    is_burning
        (n,). Whether a motor burns.
    changes
        s since lift-off. Times of phase changes.
    commanded_rate, nozzle_command
        (n, 2) rad/s and rad. Commanded rates and nozzle angles, pitch and yaw.

    Returns
    -------
    turning
        (n, 3) rad/s^2. Roll, pitch, yaw.
    jerk
        (n, 3) m/s^3. Body axes.
    """
    dt = float(t[1] - t[0])
    is_change = is_changing(card, t, changes)
    is_disturbed = is_burning | is_change
    uncommanded_motion = np.asarray(np.where(is_disturbed, card.burn, card.coast))
    # pitch and yaw: response to commanded rates, and motion without a command
    commanded_acceleration = _slope(commanded_rate, commanded_rate[:1], dt)
    commanded_turning = card.turn_gain * commanded_acceleration
    response = np.abs(_lag_response(commanded_turning, card.turn_time, dt))
    turning = np.empty((t.size, 3))
    turning[:, 0] = card.roll
    turning[:, 1:] = response + uncommanded_motion[:, np.newaxis]
    # a nozzle angle in pitch pushes along the axis of yaw, and vice versa
    nozzle_rate = _slope(nozzle_command, np.zeros((1, 2)), dt)
    nozzle_jerk = card.nozzle_gain * nozzle_rate
    nozzle_response = np.abs(_lag_response(nozzle_jerk, card.nozzle_time, dt))
    lateral = nozzle_response + card.lateral
    axial = np.where(is_burning, card.axial_burn, card.axial_coast)
    axial = np.where(is_change, card.axial_change, axial)
    return turning, np.column_stack([axial, lateral[:, 1], lateral[:, 0]])


def _slope(value: Floats, initial_value: Floats, dt: float) -> Floats:
    """Return the backward difference (n, k) per second; initial_value: (1, k) value before the first."""
    return np.diff(value, axis=0, prepend=initial_value) / dt


def _lag_response(drive: Floats, time_constant: float, dt: float) -> Floats:
    """Return the response (n, k) of a first-order lag to an input that is constant over each tick, from zero.

    Parameters
    ----------
    drive
        (n, k). Input at each tick.
    time_constant
        s.
    dt
        s. Tick.
    """
    from scipy.signal import lfilter  # imported here: it loads scipy.stats, 30 MiB and 0.5 s, and few filters need it

    factor = math.exp(-dt / time_constant)
    numerator = [0.0, 1.0 - factor]
    denominator = [1.0, -factor]
    return np.asarray(lfilter(numerator, denominator, drive, axis=0))
