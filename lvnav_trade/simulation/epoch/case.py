"""Inputs of an epoch of the filter: the case, and the arrays of its optional features."""

from collections import namedtuple
from typing import Any, NamedTuple

from lvnav_trade.simulation.preparation.prepare import Prepared


class FilterCase(NamedTuple):
    """Inputs of the filter of a case, the same in every run. Optional fields are None if the case lacks the feature.

    Functions of an epoch pass it on as a whole. Functions at the lowest level take single fields, so that one compiled
    version serves many cases; an optional field is an argument of its own, so that the compiler drops `if ... is None`.

    schedule : Schedule. Windows of IMU ticks.
    signals : Signals. Satellites and receiver at the epochs.
    sensors : Sensors. The other sensors.
    model : FilterModel. The filter as arrays.
    options : Options. Optional features.
    tick : s. Sampling interval of the IMU.
    step : s. Step of the strapdown.
    """

    schedule: Any
    signals: Any
    sensors: Any
    model: Any
    options: Any
    tick: float
    step: float


def case_of(prepared: Prepared, **changed: Any) -> FilterCase:
    """Return the filter inputs of a prepared case, with some fields replaced."""
    tick = prepared.unit.dt
    case = FilterCase(
        prepared.schedule,
        prepared.signals,
        prepared.sensors,
        prepared.model,
        prepared.options,
        tick,
        tick * prepared.model.strapdown.subsamples,
    )
    return case._replace(**changed)


Parts = namedtuple(
    "Parts",
    "run rx open_loop watch past motion held missed units backup earlier last points monitor again tape",
    defaults=(None, None, None, None, None, None, None, None, None, None, None, None, None, None, None, None),
)
"""Arrays of the optional features of a case; None without the feature, so that other kernels are compiled once.

run : (1,). Number of the run; None in linear covariance.
rx : filter.receivers.receiver.Receiver. Receiver that computes its solution; in linear covariance the covariance that it reports.
open_loop : filter.policies.open_loop.OpenLoop. Open-loop correction.
watch : filter.policies.mode_logic.Watch. Mode logic.
past : (n_place + 1, N_PAST). Stored states of delay compensation, see filter.policies.delay.
motion : filter.policies.imu_samples.Motion. IMU samples as measurements, or reported.
held : Held. Reported error of the receiver's solution.
missed : Misses. Error of the filter's transition.
units : UnitWork. IMU array.
backup : filter.policies.backup.Backup. Backup strapdown, which is never corrected.
earlier : filter.policies.epoch_differences.Earlier. Differences of two epochs.
last : (n_sat, n_kind). Observables of the epoch before, from which differences are formed.
points : filter.policies.unscented.Points. Sigma points.
monitor : filter.policies.integrity.state.Monitor. Tests for faults.
again : filter.policies.iterated.Again. Iterated update.
tape : simulation.tape.Tape. Record of one run.
"""
