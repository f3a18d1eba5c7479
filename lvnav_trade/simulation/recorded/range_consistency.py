"""Consistency of the recorded ranges of a log: their residuals relative to the solutions of the log.

Single ranges with impossible residuals are omitted. A column that contradicts the solutions throughout is refused, with
the interpretation that fits, if there is one.
"""

from collections import Counter
from typing import NamedTuple

import numpy as np

from lvnav_trade.kernels.clock import SPEED_OF_LIGHT
from lvnav_trade.quantities.errors import InputError
from lvnav_trade.quantities.line_of_sight import sight
from lvnav_trade.quantities.records import Bools, Floats
from lvnav_trade.simulation.preparation.prepare import PreparedCase

_COLUMNS = ("pseudorange_m", "range_rate_m_s")
_UNITS = ("m", "m/s")
_FEWEST_RESIDUALS = 4  # smallest number of satellites of an epoch for the median that removes the receiver clock
_CONTRADICTED = (300.0, 10.0)  # m and m/s, limits of the median: above almanac and delay errors, below a wrong time
_WILD = (500.0, 10.0)  # m and m/s, limits of a single residual
_SCATTERS = 15.0  # limit of a single residual as a multiple of the median
_MOST_WILD = 0.1  # largest fraction of measurements that may be omitted
_FITS = 0.1  # fraction of the median residual that a fitting interpretation of the column may leave
_NAMED = 6
_WAVELENGTH = SPEED_OF_LIGHT / 1575.42e6
_READINGS = (
    (-1.0, "its sign is reversed: is it a Doppler shift in m/s?"),
    (-_WAVELENGTH, "it fits as a Doppler shift in Hz of 1575.42 MHz: multiply it by -0.190294 m"),
    (_WAVELENGTH, "it fits as a range rate in cycles of 1575.42 MHz: multiply it by 0.190294 m"),
    (1000.0, "it fits in km/s"),
    (0.001, "it fits in mm/s"),
)


class RecordedRanges(NamedTuple):
    """Recorded ranges and range rates.

    measured_ranges : (n_epoch, n_sat, 2) m, m/s. As measured.
    corrections : (n_epoch, n_sat, 2) m, m/s. Corrections to be added.
    is_used : (n_epoch, n_sat). Whether they are used.
    columns : Columns that the filter processes.
    """

    measured_ranges: Floats
    corrections: Floats
    is_used: Bools
    columns: list[int]


def check_ranges(prepared_case: PreparedCase, log: RecordedRanges, file: str) -> tuple[Bools, tuple[str, ...]]:
    """Return whether measurements are used (n_epoch, n_sat), and notes on those that contradict the solutions.

    Parameters
    ----------
    prepared_case
        Prepared case, with the solutions of the log.
    log
        Recorded ranges.
    file
        Name of the file, for messages.

    Raises
    ------
    InputError
        If the measurements contradict the solutions throughout.
    """
    predicted_ranges = _predicted_ranges(prepared_case)
    compared_ranges = _near_solution(prepared_case)[:, None] & log.is_used
    is_omitted = np.zeros_like(log.is_used)
    largest: list[str] = []
    for column in log.columns:
        measurement = log.measured_ranges[:, :, column] + log.corrections[:, :, column]
        difference = measurement - predicted_ranges[:, :, column]
        residuals = _residuals(difference, compared_ranges)
        sizes = np.abs(residuals[np.isfinite(residuals)])
        if not sizes.size:
            continue
        typical_residual = float(np.median(sizes))
        if typical_residual > _CONTRADICTED[column]:
            rate = predicted_ranges[:, :, 1]
            if column == 0:
                hint = _range_hint(residuals, rate)
            else:
                hint = _rate_hint(log, rate, compared_ranges, typical_residual)
            raise InputError(
                f"{file}: {_COLUMNS[column]} contradicts the solutions: without the receiver's "
                f"clock, half of them are off by more than {_quantity(typical_residual, column)}; {hint}"
            )
        residual_limit = max(_WILD[column], _SCATTERS * typical_residual)
        wild = np.abs(np.nan_to_num(residuals)) > residual_limit
        is_omitted |= wild
        if wild.any():
            largest_size = float(sizes.max())
            largest.append(_quantity(largest_size, column))
    n_omitted = int(np.count_nonzero(is_omitted))
    if not n_omitted:
        return log.is_used, ()
    n_compared = np.count_nonzero(compared_ranges)
    by_satellite = _omitted_by_satellite(is_omitted, prepared_case.sky.names)
    note = f"{n_omitted} of {n_compared} ranges contradict the solutions, by up to {' and '.join(largest)}"
    if n_omitted > max(1.0, _MOST_WILD * n_compared):
        raise InputError(f"{file}: {note}: {by_satellite}")
    return log.is_used & ~is_omitted, (f"{note}: left out, by satellite: {by_satellite}",)


def _omitted_by_satellite(is_omitted: Bools, names: tuple[str, ...]) -> str:
    """Return the number of omitted ranges (n_epoch, n_sat) of the first satellites, as text."""
    _, satellites = np.nonzero(is_omitted)
    counts = Counter(names[k] for k in satellites.tolist())
    first_counts = sorted(counts.items())[:_NAMED]
    return ", ".join(f"{name} ({count})" for name, count in first_counts)


def _quantity(size: float, column: int) -> str:
    unit = _UNITS[column]
    if size >= 1e3:
        return f"{size * 1e-3:.4g} k{unit}"
    return f"{size:.3g} {unit}"


def _predicted_ranges(prepared_case: PreparedCase) -> Floats:
    """Return the ranges and range rates (n_epoch, n_sat, 2) m and m/s by the solutions, without clocks."""
    sky, signals = prepared_case.sky, prepared_case.signals
    relative_position = sky.r_i - signals.position[:, None, :]
    relative_velocity = sky.v_i - signals.velocity[:, None, :]
    line = sight(relative_position, relative_velocity)
    return np.stack([line.distance, line.rate], axis=2)


def _near_solution(prepared_case: PreparedCase) -> Bools:
    """Return whether the epochs (n_epoch,) have a solution of the log."""
    return np.asarray(prepared_case.signals.n_used > 0)


def _residuals(difference: Floats, is_compared: Bools) -> Floats:
    """Return differences (n_epoch, n_sat) minus the median of their epoch; NaN if unused or with too few satellites."""
    is_used = is_compared & np.isfinite(difference)
    residuals = np.where(is_used, difference, np.nan)
    n_residual = np.isfinite(residuals).sum(axis=1)
    is_enough = n_residual >= _FEWEST_RESIDUALS
    residuals[~is_enough] = np.nan
    epoch_median = np.nanmedian(residuals[is_enough], axis=1, keepdims=True)
    residuals[is_enough] -= epoch_median
    return residuals


def _range_hint(residuals: Floats, rate: Floats) -> str:
    """Return a hint on the cause of range residuals: a time offset of the satellites if it explains them."""
    motion = _residuals(rate, np.isfinite(residuals))
    is_finite = np.isfinite(residuals) & np.isfinite(motion)
    size = residuals[is_finite]
    slope = motion[is_finite]
    # least squares of residual = time offset * rate
    sum_of_squares = max(np.sum(slope**2), 1e-9)
    offset = float(np.sum(size * slope) / sum_of_squares)
    remaining_residual = np.median(np.abs(size - offset * slope))
    typical_size = np.median(np.abs(size))
    if remaining_residual <= _FITS * typical_size:
        direction = "later" if offset > 0.0 else "earlier"
        return (
            f"the satellites fit {abs(offset):.1f} s {direction}: is the epoch UTC, and do "
            "the columns of time count from it (leap seconds: time_scale)?"
        )
    return "are the epoch, the constellation (of that day) and the unit right?"


def _rate_hint(log: RecordedRanges, rate: Floats, is_compared: Bools, typical_residual: float) -> str:
    """Return a hint on an interpretation of the range-rate column that fits the solutions.

    Parameters
    ----------
    log
        Recorded ranges.
    rate
        (n_epoch, n_sat) m/s. Range rates by the solutions.
    is_compared
        (n_epoch, n_sat). Whether the measurement is compared.
    typical_residual
        m/s. Median residual with the present interpretation.
    """
    observed_rate = log.measured_ranges[:, :, 1]
    correction = log.corrections[:, :, 1]
    for factor, hint in _READINGS:
        difference = factor * observed_rate + correction - rate
        residuals = _residuals(difference, is_compared)
        size = np.nanmedian(np.abs(residuals))
        if size <= min(_CONTRADICTED[1], _FITS * typical_residual):
            return hint
    return "are the epoch and the unit right?"
