"""Sums over a block of runs and their kernels: one pass over its errors, one over its innovations.

Inner loops run over neighbours in memory and use few arrays each, so that the compiler vectorises them.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.random import log_unit
from lvnav_trade.quantities.records import Floats, Ints, RunBlock


class ErrorBins(NamedTuple):
    """Bins of errors, of equal width in the logarithm of their size.

    unit : (n * n_column,). Upper edge of the first bin.
    width : Width of a bin in ln(|error| / unit).
    number : Number of bins; the last is for all larger errors, and for those that are not counted.
    """

    unit: Floats
    width: float
    number: int


class ErrorSpans(NamedTuple):
    """Spans of the history over which errors are bounded.

    t : (n,) s. Times of the history.
    bounds : (n_span + 1,). Indices of the bounds of the spans.
    """

    t: Floats
    bounds: Ints


class ErrorSums(NamedTuple):
    """Sums over the errors of a block of runs.

    total : (n * n_column,). Sums of errors.
    squares : (n * n_column,). Sums of the squares of errors.
    sigma_squares : (n * n_column,). Sums of the squares of the filter's standard deviations.
    bins : (n_run, n * n_column). Bin of each error.
    worst : (n_run, n_span, n_column). Largest magnitude of an error in each span.
    mean_square : (n_run, n_span, n_column). Mean square in each span, times its length (s).
    """

    total: Floats
    squares: Floats
    sigma_squares: Floats
    bins: NDArray[np.uint16]
    worst: Floats
    mean_square: Floats


def summed_errors(block: RunBlock, end_times: Floats, bounds: Ints, groups: Ints, size: ErrorBins) -> dict[str, Any]:
    """Return the sums over the errors of runs, and by span of the history, by field of `statistics.BlockSummary`.

    Parameters
    ----------
    block
        Block of runs.
    end_times
        (n_run,) s. Time from which a run does not count.
    bounds
        (n_span + 1,). Indices of the history times that bound the spans.
    groups
        (n_norm, 3). Outputs of three-axis quantities; their norms are the columns after the outputs.
    size
        Bins of the errors.
    """
    n_run, n_hist, n_out = block.err.shape
    n_column = n_out + len(groups)
    n_span = len(bounds) - 1
    total, squares, sigma_squares = np.zeros((3, n_hist, n_column))
    worst, mean_square = np.zeros((2, n_run, n_span, n_column))
    bins = np.empty((n_run, n_hist, n_column), dtype=np.uint16)
    sums = ErrorSums(
        total=total.ravel(),
        squares=squares.ravel(),
        sigma_squares=sigma_squares.ravel(),
        bins=bins.reshape(n_run, -1),
        worst=worst,
        mean_square=mean_square,
    )
    add_errors(
        np.ascontiguousarray(block.err),
        np.ascontiguousarray(block.sigma),
        groups,
        np.searchsorted(block.t, end_times),
        size,
        ErrorSpans(block.t, bounds),
        sums,
        np.empty((n_hist, n_column)),
    )
    mean_square /= np.diff(block.t[bounds])[:, None]
    return {
        "total": total,
        "squares": squares,
        "sigma_squares": sigma_squares,
        "bins": bins,
        "worst": worst,
        "mean_square": mean_square,
    }


@jit
def add_errors(
    error: Floats,
    sigma: Floats,
    groups: Ints,
    time_counts: Ints,
    size: ErrorBins,
    spans: ErrorSpans,
    sums: ErrorSums,
    row: Floats,
) -> None:
    """Add errors and standard deviations of runs to the sums, and find their bins and largest magnitudes.

    Parameters
    ----------
    error, sigma
        (n_run, n, n_out). Errors, and standard deviations in the filter's covariance.
    groups
        (n_norm, 3). Outputs of three-axis quantities; their norms are the columns after the outputs.
    time_counts
        (n_run,). Number of times of each run that count in the sums: those before a failure.
    size, spans
        Bins, spans.
    sums
        Sums, updated in place.
    row
        (n, n_column). Scratch.
    """
    total = sums.total
    squares = sums.squares
    sigma_squares = sums.sigma_squares
    bins = sums.bins
    worst = sums.worst
    mean_square = sums.mean_square
    t = spans.t
    edges = spans.bounds
    n_run, n, _ = error.shape
    n_column = row.shape[1]
    n_span = worst.shape[1]
    flat = row.reshape(n * n_column)
    for run in range(n_run):
        n_cell = time_counts[run] * n_column
        _with_norms(sigma[run], groups, row)
        for cell in range(n_cell):
            cell_sigma = flat[cell]
            sigma_squares[cell] += cell_sigma * cell_sigma
        _with_norms(error[run], groups, row)
        for cell in range(n_cell):
            cell_error = flat[cell]
            total[cell] += cell_error
            squares[cell] += cell_error * cell_error
        _find_bins(flat[:n_cell], size.unit, size.width, size.number, bins[run])
        bins[run, n_cell:] = size.number - 1
        for span in range(n_span):
            first = edges[span]
            last = edges[span + 1]
            for k in range(first, last + 1):
                for c in range(n_column):
                    magnitude = abs(row[k, c])
                    if magnitude > worst[run, span, c] or magnitude != magnitude:  # not-a-number is propagated
                        worst[run, span, c] = magnitude
            for k in range(first, last):
                step = t[k + 1] - t[k]
                for c in range(n_column):
                    sum_of_squares = row[k + 1, c] ** 2 + row[k, c] ** 2
                    mean_square[run, span, c] += step * sum_of_squares / 2.0


@jit
def _with_norms(values: Floats, groups: Ints, row: Floats) -> None:
    """Copy values to scratch rows, followed by the norms of the groups.

    Parameters
    ----------
    values
        (n, n_out). Errors or standard deviations of a run.
    groups
        (n_norm, 3). Outputs of three-axis quantities.
    row
        (n, n_out + n_norm). Set here.
    """
    n, n_out = values.shape
    for k in range(n):
        for c in range(n_out):
            row[k, c] = values[k, c]
        for g in range(len(groups)):
            x = values[k, groups[g, 0]]
            y = values[k, groups[g, 1]]
            z = values[k, groups[g, 2]]
            square = x * x + y * y + z * z
            row[k, n_out + g] = np.sqrt(square)


@jit
def _find_bins(error: Floats, unit: Floats, width: float, n_bin: int, bins: Ints) -> None:
    """Set the bins of errors by the logarithm of their magnitude.

    Parameters
    ----------
    error
        (n,). Errors.
    unit
        (n,). Upper edge of the first bin of each error.
    width
        Width of a bin in ln(|error| / unit).
    n_bin
        Number of bins; larger errors are in the last bin.
    bins
        (n,) or longer. Set here.
    """
    for cell in range(len(error)):
        relative_error = abs(error[cell]) / unit[cell]
        place = log_unit(relative_error) / width
        at_least_first = max(place + 1.0, 0.0)
        bins[cell] = int(min(at_least_first, n_bin - 1.0))


@jit
def count_bins(histogram: Ints, bins: Ints) -> None:
    """Count the bins (n_run, n, n_column) of runs in a histogram (n, n_column, n_bin)."""
    n_run, n, n_column = bins.shape
    for k in range(n):
        for run in range(n_run):
            for c in range(n_column):
                histogram[k, c, bins[run, k, c]] += 1


class LagSums(NamedTuple):
    """Sums of products of innovations by lag in epochs, and scratch.

    total : (n_lag, n_used). Sums of products.
    number : (n_lag, n_used). Numbers of products.
    value : (n_epoch, n_used). Innovations of a run; 0 without a measurement.
    presence : (n_epoch, n_used). 1 where the run has an innovation.
    count_of_run : (n_lag, n_used). Numbers of products of a run.
    """

    total: Floats
    number: Floats
    value: Floats
    presence: Floats
    count_of_run: Floats


def lag_products(block: RunBlock, end_times: Floats, n_lag: int) -> tuple[Floats, Ints]:
    """Return sums and numbers of products of innovations by lag in epochs and channel, (n_lag, n_channel) each.

    Parameters
    ----------
    block
        Block of runs.
    end_times
        (n_run,) s. Time from which a run does not count.
    n_lag
        Number of lags, from 0.
    """
    innovation = np.ascontiguousarray(block.innovation)
    _, n_epoch, n_channel = innovation.shape
    has_innovation = np.isfinite(innovation).any(axis=(0, 1))
    channels = np.flatnonzero(has_innovation)
    n_used = len(channels)
    by_lag = (n_lag, n_used)
    by_epoch = (n_epoch, n_used)
    sums = LagSums(
        total=np.zeros(by_lag),
        number=np.zeros(by_lag),
        value=np.zeros(by_epoch),
        presence=np.zeros(by_epoch),
        count_of_run=np.zeros(by_lag),
    )
    add_lags(innovation, block.t_epoch, end_times, channels, sums)
    total, count = np.zeros((2, n_lag, n_channel))
    total[:, channels] = sums.total
    count[:, channels] = sums.number
    return total, count.astype(np.int64)


@jit
def add_lags(innovation: Floats, t: Floats, end_times: Floats, channels: Ints, sums: LagSums) -> None:
    """Add products of innovations by lag in epochs, where both exist and before a run fails.

    Parameters
    ----------
    innovation
        (n_run, n, n_channel). Normalised innovations.
    t
        (n,) s. Epochs.
    end_times
        (n_run,) s. Time from which a run does not count.
    channels
        (n_used,). Channels with any innovation.
    sums
        Sums, updated in place.
    """
    total, number, value, presence, count_of_run = sums
    n_run, n, _ = innovation.shape
    for run in range(n_run):
        is_other = run == 0  # most runs have their innovations at the same epochs
        for k in range(n):
            for c in range(len(channels)):
                e = innovation[run, k, channels[c]]
                is_present = np.isfinite(e) and t[k] < end_times[run]
                was_present = presence[k, c] == 1.0
                value[k, c] = e if is_present else 0.0
                is_other |= is_present != was_present
                presence[k, c] = 1.0 if is_present else 0.0
        if is_other:
            count_of_run[:] = 0.0
        for lag in range(min(len(total), n)):
            for k in range(lag, n):
                earlier_epoch = k - lag
                _add_products(value[earlier_epoch], value[k], total[lag])
                if is_other:
                    _add_products(presence[earlier_epoch], presence[k], count_of_run[lag])
        number += count_of_run


@jit
def _add_products(earlier_values: Floats, later_values: Floats, total: Floats) -> None:
    for c in range(len(total)):
        total[c] += earlier_values[c] * later_values[c]
