"""Tables of reference vectors with unit and meaning of every column."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from lvnav_trade.export.scope import refuse_redundant_imus
from lvnav_trade.export.vectors.scalars import measurement_rows, reports_covariance
from lvnav_trade.quantities.records import Floats
from lvnav_trade.quantities.state_layout import state_names, state_outputs
from lvnav_trade.results.tables.dictionary import unit_suffix
from lvnav_trade.simulation.montecarlo import TapedRun, record_run
from lvnav_trade.simulation.preparation.prepare import PreparedCase
from lvnav_trade.simulation.tape import Estimates

START, BEFORE, AFTER, END = "start", "before", "after", "end"
"""Stages of an estimate: at the start, before and after the measurements of an epoch, at the end of the flight."""
NO_EPOCH = -1
_XYZ = ("x", "y", "z")
_EPOCH = {
    "epoch": ("", "number of the epoch, from 0; -1 at the start and at the end of the flight"),
    "t_s": ("s", "time since lift-off"),
}
_STAGE = {"stage": ("", "start, before or after the measurements of an epoch, or end of the flight")}


class VectorTable(NamedTuple):
    """A table of reference vectors.

    description : Description of its content.
    frame : Its rows.
    columns : Unit (SI) and meaning of every column, in order.
    """

    description: str
    frame: pd.DataFrame
    columns: Mapping[str, tuple[str, str]]


def vectors_of(prepared_case: PreparedCase, seed: int, run: int) -> dict[str, VectorTable]:
    """Return the tables of reference vectors of a run by name.

    Parameters
    ----------
    prepared_case : PreparedCase
        The prepared scenario.
    seed, run : int
        Seed of the campaign and number of the run.

    Raises
    ------
    InputError
        Redundant IMUs are tested ahead of the filter.
    """
    refuse_redundant_imus(prepared_case)
    taped_run = record_run(prepared_case, seed, run)
    tables = {
        "imu": _imu(prepared_case, taped_run.tape.increments),
        "windows": _windows(prepared_case),
        "epochs": _epochs(prepared_case, taped_run),
        "measurements": _measurements(prepared_case, taped_run),
        "antennas": _antennas(prepared_case),
        "satellites": _satellites(prepared_case),
        "sensors": _sensors(prepared_case, taped_run.tape.sensor_measurements),
        "reported_covariance": _reported_covariance(prepared_case, taped_run.tape.covariance),
        "states": _states(prepared_case),
        "model": _model(prepared_case),
        "estimates": _estimates(prepared_case, taped_run),
        "covariance": _covariance(prepared_case, taped_run),
    }
    return {name: table for name, table in tables.items() if len(table.frame)}


def _table(description: str, columns: Mapping[str, tuple[str, str]], values: Iterable[Any]) -> VectorTable:
    """Return a table from arrays, one per column.

    description : description of the table
    columns : unit and meaning by name of the column
    values : (n,) arrays, in the order of the columns
    """
    return VectorTable(description, pd.DataFrame(dict(zip(columns, values, strict=True))), dict(columns))


def _row_table(
    description: str, columns: Mapping[str, tuple[str, str]], rows: Iterable[tuple[Any, ...]]
) -> VectorTable:
    """Return a table from rows; `description` and `columns` as in `_table`."""
    return VectorTable(description, pd.DataFrame(list(rows), columns=list(columns)), dict(columns))


def _axes(stem: str, unit: str, meaning: str) -> dict[str, tuple[str, str]]:
    """Return the columns of the components of a vector: unit and meaning by name.

    stem : first part of the names, before axis and unit
    """
    return {f"{stem}_{axis}_{unit_suffix(unit)}": (unit, f"{meaning}, axis {axis}") for axis in _XYZ}


# ------------------------------------------------------------------------------------------------- inputs


def _imu(prepared_case: PreparedCase, increments: Floats) -> VectorTable:
    ticks = np.arange(len(increments))
    columns = {
        "tick": ("", "number of the sample, from 0"),
        "t_s": ("s", "end of the sampling interval, since lift-off"),
    }
    columns |= _axes("delta_angle", "rad", "angle increment as the IMU outputs it, body axes")
    columns |= _axes("delta_velocity", "m/s", "velocity increment as the IMU outputs it, body axes")
    t = prepared_case.unit.start + prepared_case.unit.dt * (ticks + 1)
    return _table("IMU samples, in order", columns, [ticks, t, *increments.T])


def _windows(prepared_case: PreparedCase) -> VectorTable:
    schedule, model = prepared_case.schedule, prepared_case.model
    columns = {
        "window": ("", "number of the window, from 0"),
        "first_tick": ("", "first IMU sample of the window"),
        "n_tick": ("", "number of IMU samples"),
        "length": ("", "index of the window's length in the table model"),
        "length_s": ("s", "length of the window"),
        "epoch": ("", "epoch at its end, -1 none"),
    }
    length = model.seconds[schedule.length_index]
    values = [
        np.arange(length.size),
        schedule.first_tick,
        schedule.n_tick,
        schedule.length_index,
        length,
        schedule.epoch,
    ]
    return _table("Windows over which the covariance is propagated", columns, values)


def _epochs(prepared_case: PreparedCase, taped_run: TapedRun) -> VectorTable:
    options = prepared_case.options
    columns: dict[str, tuple[str, str]] = {
        **_EPOCH,
        "n_accepted": ("", "scalar measurements that the filter accepts"),
        "n_rejected": ("", "scalar measurements that its gate rejects"),
    }
    values = [
        np.arange(prepared_case.t_epoch.size),
        prepared_case.t_epoch,
        taped_run.accepted_count.astype(int),
        taped_run.rejected_count.astype(int),
    ]
    if options.delay_processing is not None:
        columns["delay_s"] = ("s", "delay of the receiver that the filter compensates")
        values.append(options.delay_processing.delay)
    if options.rules is not None:
        columns["good"] = ("", "whether the receiver's sample passes the checks at the input")
        values.append(options.rules.is_good)
    return _table("Epochs at which measurements are processed", columns, values)


def _measurements(prepared_case: PreparedCase, taped_run: TapedRun) -> VectorTable:
    columns = {
        **_EPOCH,
        "row": ("", "order of processing within the epoch"),
        "channel": ("", "what is measured"),
        "satellite": ("", "satellite of the channel, empty for none"),
        "measured_si": (
            "as in the column unit",
            "measured value, ranges less what the filter corrects; of another sensor empty: see the table sensors",
        ),
        "unit": ("", "unit of the measured value"),
        "variance_si": ("square of it", "noise variance in the filter model"),
        "innovation_ratio": ("1", "expected innovation over its standard deviation; empty: not processed"),
    }
    return _row_table("Scalar measurements", columns, measurement_rows(prepared_case, taped_run))


def _antennas(prepared_case: PreparedCase) -> VectorTable:
    columns = {"antenna": ("", "number of the antenna, from 0")}
    columns |= _axes("lever", "m", "phase centre relative to the IMU in the filter model, body axes")
    rows = [(number, *lever) for number, lever in enumerate(prepared_case.model.lever_arms)]
    return _row_table("Antennas of the receiver", columns, rows)


def _satellites(prepared_case: PreparedCase) -> VectorTable:
    columns = {**_EPOCH, "satellite": ("", "its name"), "antenna": ("", "antenna that receives it, from 0")}
    columns |= _axes("position", "m", "position at transmission that the filter uses, frame i at reception")
    columns |= _axes("velocity", "m/s", "derivative of that position by the time of reception, frame i")
    rows = _satellite_rows(prepared_case) if prepared_case.channels.tight else ()
    return _row_table("Satellites in use", columns, rows)


def _satellite_rows(prepared_case: PreparedCase) -> Iterator[tuple[Any, ...]]:
    """Yield the rows of the table of satellites."""
    signals = prepared_case.signals
    for epoch, t in enumerate(prepared_case.t_epoch):
        for satellite in signals.satellite_by_slot[epoch, : signals.n_used[epoch]]:
            yield (
                epoch,
                t,
                prepared_case.sky.names[satellite],
                signals.antenna[epoch, satellite],
                *signals.satellite_position[epoch, satellite],
                *signals.satellite_velocity[epoch, satellite],
            )


def _sensors(prepared_case: PreparedCase, outputs: Floats) -> VectorTable:
    sensors = prepared_case.sensors
    n_known = 0
    if sensors is not None:
        is_set = np.any(sensors.filter_parameters != 0.0, axis=(0, 1))
        n_known = int(np.flatnonzero(is_set).max(initial=-1)) + 1
    columns: dict[str, tuple[str, str]] = {**_EPOCH, "sensor": ("", "its name")}
    meaning = "output: scalars in the order of the channels; an attitude as quaternion, an azimuth as cosine and sine"
    columns |= {f"output_{i}_si": ("SI", meaning) for i in range(outputs.shape[2])}
    columns["earth_angle_rad"] = ("rad", "Earth rotation angle that the filter uses")
    meaning = "quantity that the filter's model of the sensor is given, in the order of the model"
    columns |= {f"known_{i}_si": ("SI", meaning) for i in range(n_known)}
    description = "Outputs of the other sensors, and what the filter's models of them are given"
    return _row_table(description, columns, _sensor_rows(prepared_case, outputs, n_known))


def _sensor_rows(prepared_case: PreparedCase, outputs: Floats, n_known: int) -> Iterator[tuple[Any, ...]]:
    """Yield the rows of the table of sensors, one for each sensor and epoch with an output.

    outputs : (n_epoch, n_sensor, n_output). Outputs, SI.
    n_known : number of known quantities of each sensor in the table
    """
    sensors = prepared_case.sensors
    if sensors is None:
        return
    for k, device in enumerate(prepared_case.devices):
        for epoch in np.flatnonzero(sensors.is_measuring[k]):
            yield (
                epoch,
                prepared_case.t_epoch[epoch],
                device.name,
                *outputs[epoch, k],
                sensors.theta[k, epoch],
                *sensors.filter_parameters[k, epoch, :n_known],
            )


def _reported_covariance(prepared_case: PreparedCase, covariance: Floats) -> VectorTable:
    columns = dict(_EPOCH)
    row, column = np.tril_indices(6)  # lower triangle, row by row
    for i, j in zip(row, column, strict=True):
        columns[f"c_{i}_{j}_si"] = ("SI", "position (0 to 2), velocity (3 to 5), frame i")
    rows = []
    if reports_covariance(prepared_case):
        for epoch, t in enumerate(prepared_case.t_epoch):
            rows.append((epoch, t, *covariance[epoch][row, column]))
    return _row_table("Covariance that the receiver reports with its solution", columns, rows)


# -------------------------------------------------------------------------------------------------- model


def column_of_state(name: str) -> str:
    """Return the column name of a state, without its unit."""
    return re.sub(r"\W+", "_", name).strip("_").lower()


def _states(prepared_case: PreparedCase) -> VectorTable:
    layout = prepared_case.layout
    columns = {
        "state": ("", "number of the state, from 0"),
        "name": ("", "its name; attitude, velocity and position in frame i, IMU parameters in body axes"),
        "column": ("", "its column in the table covariance"),
        "unit": ("", "its SI unit"),
        "initial_sigma_si": ("as in the column unit", "standard deviation at the start"),
        "estimated": ("", "whether it is corrected; otherwise it is considered"),
    }
    names = state_names(layout)
    number = np.arange(layout.n_state)
    is_delayed = (number >= layout.earlier_epoch) & (number < layout.earlier_epoch + layout.n_earlier_epoch)
    values = [
        number,
        names,
        [column_of_state(name) for name in names],
        [output.unit for output in state_outputs(layout, "inertial")],
        np.sqrt(np.diagonal(prepared_case.initial_state.P)),
        (number < layout.n_estimated) | is_delayed,
    ]
    return _table("Error states, truth minus estimate", columns, values)


def _model(prepared_case: PreparedCase) -> VectorTable:
    model = prepared_case.model
    columns = {
        "length": ("", "index of the window's length"),
        "length_s": ("s", "length of the window"),
        "name": ("", "name of the state"),
        "decay_ratio": ("1", "decay factor over the window"),
        "noise_si": ("square of the state's unit", "variance of process noise added over the window"),
    }
    rows = []
    for k, seconds in enumerate(model.seconds):
        for i, name in enumerate(state_names(prepared_case.layout)):
            rows.append((k, seconds, name, model.decay[k, i], model.noise[k, i]))
    return _row_table("Process noise and decay by length of a window", columns, rows)


# ------------------------------------------------------------------------------------------------ outputs


def _estimate_columns(prepared_case: PreparedCase) -> dict[str, tuple[str, str]]:
    layout = prepared_case.layout
    names = state_names(layout)
    units = [output.unit for output in state_outputs(layout, "inertial")]
    columns = {**_STAGE, **_EPOCH}
    for axis in ("w", *_XYZ):
        columns[f"quaternion_{axis}"] = ("1", "rotation from body axes to frame i, scalar first")
    columns |= _axes("velocity", "m/s", "inertial velocity, frame i")
    columns |= _axes("position", "m", "position, frame i")
    states = [block.offset + i for block in layout.parameters for i in range(3)]
    if layout.clock >= 0:
        states += [layout.clock, layout.clock + 1]
    states += map(int, prepared_case.model.extra_offset)
    for state in states:
        name = f"{column_of_state(names[state])}_{unit_suffix(units[state])}"
        columns[name] = (units[state], f"estimate of {names[state]}")
    if _is_open(prepared_case):
        for state_name, unit in zip(names, units, strict=True):
            name = f"error_{column_of_state(state_name)}_{unit_suffix(unit)}"
            columns[name] = (unit, f"estimated error of {state_name}, truth minus estimate")
    return columns


def _is_open(prepared_case: PreparedCase) -> bool:
    """Return whether the error state is separate from the estimates (open loop)."""
    return prepared_case.scenario.filter.feedback == "open"


def _estimate_row(prepared_case: PreparedCase, estimates: Estimates, index: int) -> list[float]:
    """Return the estimates at an index of a record, in the order of the columns.

    estimates : record of estimates, by epoch
    index : index of the record
    """
    n_parameter = len(prepared_case.layout.parameters)
    row = [*estimates.nav[index], *estimates.par[index, :n_parameter].ravel()]
    if prepared_case.layout.clock >= 0:
        row += [*estimates.clock[index]]
    row += [*estimates.extra[index, : prepared_case.model.extra_offset.size]]
    if _is_open(prepared_case):
        row += [*estimates.x[index]]
    return row


def _stages(prepared_case: PreparedCase, taped_run: TapedRun) -> Iterator[tuple[str, int, float, Estimates, int]]:
    """Yield stage, epoch, time (s), and the record with the index of its estimates."""
    tape = taped_run.tape
    for epoch, t in enumerate(prepared_case.t_epoch):
        yield BEFORE, epoch, t, tape.estimates_before, epoch
        yield AFTER, epoch, t, tape.estimates_after, epoch
    schedule = prepared_case.schedule
    n_tick = int(schedule.first_tick[-1] + schedule.n_tick[-1])
    t_end = prepared_case.unit.start + prepared_case.unit.dt * n_tick
    yield END, NO_EPOCH, t_end, tape.estimates_after, -1


def _estimates(prepared_case: PreparedCase, taped_run: TapedRun) -> VectorTable:
    columns = _estimate_columns(prepared_case)
    start = [START, NO_EPOCH, prepared_case.unit.start, *taped_run.tape.start]
    zeros = [0.0] * (len(columns) - len(start))
    rows: list[tuple[Any, ...]] = [(*start, *zeros)]
    for stage, epoch, t, estimates, index in _stages(prepared_case, taped_run):
        rows.append((stage, epoch, t, *_estimate_row(prepared_case, estimates, index)))
    return _row_table("Expected estimates", columns, rows)


def _covariance(prepared_case: PreparedCase, taped_run: TapedRun) -> VectorTable:
    names = state_names(prepared_case.layout)
    columns = {**_STAGE, **_EPOCH, "state": ("", "name of the state of the row")}
    state_columns = [column_of_state(name) for name in names]
    for column, name in zip(state_columns, names, strict=True):
        columns[column] = ("product of both units", f"covariance with {name}")
    keys = [pd.DataFrame({"stage": START, "epoch": NO_EPOCH, "t_s": prepared_case.unit.start, "state": names})]
    covariances = [prepared_case.initial_state.P]
    for stage, epoch, t, estimates, index in _stages(prepared_case, taped_run):
        keys.append(pd.DataFrame({"stage": stage, "epoch": epoch, "t_s": t, "state": names}))
        covariances.append(estimates.P[index])
    numbers = pd.DataFrame(np.concatenate(covariances), columns=state_columns)
    frame = pd.concat([pd.concat(keys, ignore_index=True), numbers], axis=1)
    return VectorTable("Expected covariance of the error states, a row per state", frame, columns)
