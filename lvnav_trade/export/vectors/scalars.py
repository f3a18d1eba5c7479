"""Scalar measurements of reference vectors, in the order of processing."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

from lvnav_trade.filter.ekf import receiver_channel, receiver_row_count
from lvnav_trade.filter.policies.epoch_differences import is_present
from lvnav_trade.filter.policies.reference_satellite import is_reference
from lvnav_trade.sensors.receiver_observables import LABELS
from lvnav_trade.simulation.montecarlo import TapedRun
from lvnav_trade.simulation.preparation.prepare import PreparedCase


def _receiver_scalars(prepared_case: PreparedCase, taped_run: TapedRun, epoch: int) -> Iterator[_Scalar]:
    """Yield the scalar measurements of the receiver at an epoch, in the order of processing.

    Measurements that are absent, and those of the reference satellite, are omitted.
    """
    model, signals, tape = prepared_case.model, prepared_case.signals, taped_run.tape
    units = ["m/s" if "rate" in LABELS[name] else "m" for name in prepared_case.channels.observables]
    for row in range(_python(receiver_row_count)(model, signals, epoch)):
        channel = _python(receiver_channel)(model, signals, epoch, row)
        if not _python(is_present)(prepared_case.options.differences, model, epoch, channel):
            continue
        if not model.tight:
            yield _Scalar(row, channel, tape.solution[epoch, row], "m" if row < 3 else "m/s")
        elif not _python(is_reference)(model, signals, epoch, row):
            slot, observable = divmod(row, model.n_observable)
            yield _Scalar(row, channel, tape.ranges[epoch, slot, observable], units[observable])


def _sensor_scalars(prepared_case: PreparedCase, epoch: int) -> Iterator[_Scalar]:
    """Yield the scalar measurements of the other sensors at an epoch."""
    sensors = prepared_case.sensors
    if sensors is None:
        return
    first_row = prepared_case.n_row - prepared_case.channels.n_channel
    for k, device in enumerate(prepared_case.devices):
        if not (sensors.is_measuring[k, epoch] and prepared_case.model.is_processed[sensors.channel[k]]):
            continue
        for i in range(sensors.scalars[k]):
            channel = sensors.channel[k] + i
            yield _Scalar(first_row + channel, channel, math.nan, device.card.unit)


class _Scalar(NamedTuple):
    """A scalar measurement.

    row : Position among the measurements of the epoch.
    channel : Channel.
    value : Measured value (SI).
    unit : SI unit.
    """

    row: int
    channel: int
    value: float
    unit: str


def _python(kernel: Any) -> Any:
    """Return the Python function of a kernel; for a few calls compilation is not worthwhile."""
    return getattr(kernel, "py_func", kernel)


def measurement_rows(prepared_case: PreparedCase, taped_run: TapedRun) -> Iterator[tuple[Any, ...]]:
    """Yield the rows of the table of measurements; none if the filter is not aided."""
    channels, signals, names = prepared_case.channels, prepared_case.signals, prepared_case.channel_names
    has_reports = reports_covariance(prepared_case)
    if not prepared_case.model.has_epochs:
        return
    for epoch, t in enumerate(prepared_case.t_epoch):
        scalars = [*_receiver_scalars(prepared_case, taped_run, epoch), *_sensor_scalars(prepared_case, epoch)]
        for row, channel, value, unit in scalars:
            is_of_receiver = channel < channels.n_receiver
            satellite = ""
            if channels.tight and is_of_receiver:
                satellite = channels.satellites[channel // prepared_case.model.n_observable]
            variance = signals.variance[epoch, channel]
            if has_reports and is_of_receiver:
                variance = taped_run.tape.covariance[epoch, row, row] * signals.scale[epoch, channel] ** 2
            yield (
                epoch,
                t,
                row,
                names[channel],
                satellite,
                value,
                unit,
                variance,
                taped_run.innovation[epoch, channel],
            )


def reports_covariance(prepared_case: PreparedCase) -> bool:
    """Return whether the receiver reports the covariance of its solution and the filter uses it."""
    return bool(prepared_case.model.has_reported_covariance) and prepared_case.options.solver is not None
