"""Jacobian rows of every measurement against central differences of the predicted measurement."""

from collections.abc import Callable, Iterator
from functools import partial
from typing import NamedTuple

import numpy as np

from lvnav_trade.covariance.diagnostics.perturbed_estimate import increments, place, place_previous_epoch, tick_at
from lvnav_trade.covariance.selfcheck.check import CheckResult
from lvnav_trade.covariance.selfcheck.state_checks import sizes
from lvnav_trade.covariance.workspace import Nominal, new_nominal
from lvnav_trade.filter.ekf import (
    fill_receiver,
    fill_sensor,
    place_antenna,
    receiver_channel,
    receiver_row_count,
    sensor_row,
)
from lvnav_trade.filter.policies.epoch_differences import is_present
from lvnav_trade.filter.states import TYPES
from lvnav_trade.kernels.transition import CONSTANT, GYRO
from lvnav_trade.kernels.vehicle import N_SAMPLE, fill_samples
from lvnav_trade.quantities.records import Bools, Floats, Ints
from lvnav_trade.quantities.state_layout import state_names
from lvnav_trade.sensors.family import measure
from lvnav_trade.simulation.preparation.prepare import PreparedCase

EPOCHS = 5
"""Number of epochs of the flight at which each measurement is checked."""
TOLERANCE = 1e-3
"""Largest relative difference of an entry; differences of ranges of 2e7 m have rounding errors."""
NEGLIGIBLE_FRACTION = 1e-6
"""Fraction of the largest entry of a row, in steps of the differences, below which entries are negligible."""


class EpochMeasurements(NamedTuple):
    """Scalar measurements of an epoch.

    names : (n_row,). Measurement of each row.
    H : (n_row, n_state). Jacobian.
    z : (n_row,). Measured minus predicted.
    """

    names: tuple[str, ...]
    H: Floats
    z: Floats


RowsAt = Callable[[PreparedCase, Nominal, int, Floats], EpochMeasurements]


def jacobians(prepared_case: PreparedCase) -> list[CheckResult]:
    """Return a check for each measurement of the filter, with state and time of its figure.

    The figure is the largest relative difference between an entry of its Jacobian and the central difference of the
    prediction.
    """
    size = sizes(prepared_case)
    n_state = size.size
    names = state_names(prepared_case.layout)
    work = new_nominal(prepared_case)
    quantities = np.array([name.partition(" ")[0] for name in names])
    groups = quantities[:, None] == quantities
    worst: dict[str, tuple[float, str]] = {}
    for epoch, rows_at in _checked_epochs(prepared_case):
        no_error = np.zeros(n_state)
        nominal = rows_at(prepared_case, work, epoch, no_error)
        differences = np.empty_like(nominal.H)
        for state in range(n_state):
            d = np.zeros(n_state)
            d[state] = size[state]
            plus = rows_at(prepared_case, work, epoch, d).z
            minus = rows_at(prepared_case, work, epoch, -d).z
            differences[:, state] = (plus - minus) / 2.0
        deviations, states = _deviations(nominal.H * size, differences, groups)
        for row, measurement in enumerate(nominal.names):
            deviation = float(deviations[row])
            largest, _ = worst.get(measurement, (-1.0, ""))
            if not deviation <= largest:  # also if the deviation is not a number
                remark = f"{names[states[row]]} at {prepared_case.t_epoch[epoch]:g} s"
                worst[measurement] = (deviation, remark)
    checks = []
    for name, (deviation, remark) in worst.items():
        checks.append(CheckResult("Jacobian", name, deviation, upper_limit=TOLERANCE, remark=remark))
    if prepared_case.options.vehicle is not None:
        checks += _sample_checks(prepared_case)
    for name in prepared_case.scenario.filter.measurements:
        if name in TYPES and name not in worst:
            checks.append(CheckResult("Jacobian", name, reason="it measures at no epoch of this flight"))
    return checks


def _deviations(rows: Floats, differences: Floats, groups: Bools) -> tuple[Floats, Ints]:
    """Return the largest relative deviation of differences from rows, (n_row,), and its state, (n_row,).

    A component of a vector may be near zero although the vector is not, so deviations are relative to the largest entry
    of the quantity.

    Parameters
    ----------
    rows, differences
        (n_row, n_state). Jacobian rows, and differences of measurements.
    groups
        (n_state, n_state). Whether two states belong to the same quantity.
    """
    magnitude = np.maximum(np.abs(rows), np.abs(differences))
    magnitude_of_group = np.where(groups, magnitude[:, None, :], 0.0)
    largest_of_quantity = np.max(magnitude_of_group, axis=2)
    largest_of_row = magnitude.max(axis=1, keepdims=True)
    min_scale = NEGLIGIBLE_FRACTION * largest_of_row + np.finfo(float).tiny
    scale = np.maximum(largest_of_quantity, min_scale)
    relative = np.abs(rows - differences) / scale
    return relative.max(axis=1), relative.argmax(axis=1)


def _checked_epochs(prepared_case: PreparedCase) -> Iterator[tuple[int, RowsAt]]:
    """Yield epochs with a function that returns their measurements: of the receiver, then of each sensor."""
    model = prepared_case.model
    signals = prepared_case.signals
    n_epoch = prepared_case.t_epoch.size
    measurement_epochs = [epoch for epoch in range(n_epoch) if receiver_row_count(model, signals, epoch) > 0]
    for epoch in _spread(np.array(measurement_epochs, dtype=np.int64)):
        yield epoch, _receiver_rows
    for k, device in enumerate(prepared_case.devices):
        first_channel = prepared_case.channels.first_channels[k]
        if model.is_processed[first_channel]:
            for epoch in _spread(np.flatnonzero(device.is_measuring)):
                yield epoch, partial(_sensor_rows, k)


def _spread(epochs: Ints) -> list[int]:
    """Return some of the epochs, evenly spread from first to last."""
    if not epochs.size:
        return []
    last = epochs.size - 1
    places = np.linspace(0, last, EPOCHS).astype(int)
    selected_epochs = epochs[places]
    return sorted({int(epoch) for epoch in selected_epochs})


def _estimate(prepared_case: PreparedCase, work: Nominal, epoch: int, d: Floats, time: float | None = None) -> None:
    """Set the estimate to the truth minus an error.

    The body rate, which moves the antenna, depends on the gyro bias or on the rate state only: Jacobian rows neglect
    other gyro parameters, so they are removed from the error for the rate.

    Parameters
    ----------
    prepared_case
        Prepared case.
    work
        Arrays of the nominal run, set here.
    epoch
        Index of the epoch.
    d
        (n_state,) SI. Error, truth minus estimate.
    time
        s since lift-off. Time of the truth; None: that of the epoch.
    """
    error = d.copy()
    motion = prepared_case.layout.motion
    dt = prepared_case.unit.dt
    for block in prepared_case.layout.parameters:
        is_gyro_bias = block.sensor == GYRO and block.driver == CONSTANT
        if not is_gyro_bias or motion >= 0:
            states = slice(block.offset, block.offset + 3)
            error[states] = 0.0
    place(prepared_case, work, epoch, error, time)
    if motion >= 0:
        rate_error = d[motion : motion + 3]
        work.previous[:3] -= dt * rate_error
        place_antenna(work, None, None, prepared_case.model, dt, epoch)


def _receiver_rows(prepared_case: PreparedCase, work: Nominal, epoch: int, d: Floats) -> EpochMeasurements:
    """Return the scalar measurements of the receiver that the filter processes."""
    model = prepared_case.model
    signals = prepared_case.signals
    differences = prepared_case.options.differences
    previous_epoch = place_previous_epoch(prepared_case, work, epoch, d)
    _estimate(prepared_case, work, epoch, d)
    fill_receiver(work, previous_epoch, differences, model, signals, epoch)
    rows = []
    for row in range(receiver_row_count(model, signals, epoch)):
        channel = receiver_channel(model, signals, epoch, row)
        if is_present(differences, model, epoch, channel):
            rows.append((row, channel))
    return _dense_rows(prepared_case, work, rows)


def _sensor_rows(k: int, prepared_case: PreparedCase, work: Nominal, epoch: int, d: Floats) -> EpochMeasurements:
    """Return the measurements of a sensor, which measures the truth at the time of validity in the filter.

    Parameters
    ----------
    k
        Index of the sensor.
    prepared_case
        Prepared case.
    work
        Arrays of the nominal run, set here.
    epoch
        Index of the epoch.
    d
        (n_state,) SI. Error of the estimate, truth minus estimate.
    """
    model = prepared_case.model
    sensors = prepared_case.sensors
    assert sensors is not None  # the case has this sensor
    first_channel = sensors.channel[k]
    first_row = sensor_row(model, work, first_channel)
    delay = prepared_case.devices[k].delay[epoch]
    time_of_validity = prepared_case.t_epoch[epoch] - delay
    _estimate(prepared_case, work, epoch, d, time_of_validity)
    truth = sensors.truth[k, epoch]
    measure(work.sensor_measurements[k], sensors.code[k], truth, 0.0, 0.0, 0.0)
    fill_sensor(work, None, None, model, prepared_case.signals, sensors, k, epoch)
    rows = [(first_row + i, first_channel + i) for i in range(sensors.scalars[k])]
    return _dense_rows(prepared_case, work, rows)


def _dense_rows(prepared_case: PreparedCase, work: Nominal, rows: list[tuple[int, int]]) -> EpochMeasurements:
    """Return rows, given with their channels, as dense Jacobian rows."""
    model = prepared_case.model
    names_by_type = {number: name for name, number in TYPES.items()}
    H = np.zeros((len(rows), prepared_case.layout.n_state))
    names = []
    for dense_row, (row, channel) in zip(H, rows, strict=True):
        n = model.n_entry[channel]
        entries = model.entry[channel, :n]
        states = model.column[channel, :n]
        dense_row[states] = work.H[row, entries]
        channel_type = int(model.channel_type[channel])
        names.append(names_by_type[channel_type])
    row_numbers = [row for row, _ in rows]
    z = work.z[row_numbers].copy()
    return EpochMeasurements(tuple(names), H, z)


def _sample_checks(prepared_case: PreparedCase) -> list[CheckResult]:
    """Return the check of the Jacobian of IMU samples, against the increments of an IMU with such parameters."""
    size = sizes(prepared_case)
    t = prepared_case.reference.t
    worst, remark = 0.0, ""
    for time in np.linspace(t[0], t[-1], EPOCHS + 2)[1:-1]:
        tick = tick_at(prepared_case, time)
        H = _sample_jacobian(prepared_case, tick)
        differences = _sample_differences(prepared_case, tick, size)
        difference = np.abs((H - differences) * size).max(axis=1)
        largest_entry = np.abs(H * size).max(axis=1)
        deviation = (difference / largest_entry).max()
        if deviation >= worst:
            worst = float(deviation)
            remark = f"{time:.0f} s"
    return [CheckResult("Jacobian", "imu", worst, upper_limit=TOLERANCE, remark=remark)]


def _sample_jacobian(prepared_case: PreparedCase, tick: int) -> Floats:
    """Return the Jacobian (6, n_state) of the IMU samples of a tick."""
    vehicle = prepared_case.options.vehicle
    reference = prepared_case.reference
    dt = prepared_case.unit.dt
    n_entry = vehicle.columns.shape[1]
    H = np.zeros((N_SAMPLE, prepared_case.layout.n_state))
    h = np.zeros((N_SAMPLE, n_entry))
    rate = reference.dtheta[tick] / dt
    force = reference.dvel[tick] / dt
    fill_samples(h, vehicle.blocks, rate, force)
    for row in range(N_SAMPLE):
        np.add.at(H[row], vehicle.columns[row], h[row])  # unused entries add zero
    return H


def _sample_differences(prepared_case: PreparedCase, tick: int, size: Floats) -> Floats:
    """Return the central differences (6, n_state) of the IMU samples of a tick, for errors of these sizes."""
    layout = prepared_case.layout
    dt = prepared_case.unit.dt
    motion = slice(layout.motion, layout.motion + N_SAMPLE)
    differences = np.zeros((N_SAMPLE, layout.n_state))
    differences[:, motion] = np.eye(N_SAMPLE)
    for block in layout.parameters:
        for state in range(block.offset, block.offset + 3):
            d = np.zeros(layout.n_state)
            d[state] = size[state]
            plus = increments(prepared_case, tick, 1, d)[0]
            minus = increments(prepared_case, tick, 1, -d)[0]
            differences[:, state] = (plus - minus) / (2.0 * dt * size[state])
    return differences
