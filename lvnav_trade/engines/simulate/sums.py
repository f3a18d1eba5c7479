"""Kernels of a block's statistics: one pass over its errors, one over its innovations.

Loops are over neighbours in memory and touch few arrays each, so that the compiler makes vectors of them.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.random import log_unit
from lvnav_trade.records import Floats, Ints


class ErrorBins(NamedTuple):
    """Bins of errors, of equal width in the logarithm of their size.

    unit : (n * n_column,). Upper edge of the first bin.
    width : Width of a bin in ln(|error| / unit).
    number : Number of bins; the last is for all that is larger or not counted.
    """

    unit: Floats
    width: float
    number: int


class Spans(NamedTuple):
    """Spans of the history over which errors are bounded.

    t : (n,) s. Times of the history.
    at : (n_span + 1,). Indices of the times at which spans begin and end.
    """

    t: Floats
    at: Ints


class ErrorSums(NamedTuple):
    """What is added up of the errors of a block of runs.

    total, squares : (n * n_column,). Sums of errors and of their squares.
    sigma_squares : (n * n_column,). Sums of the squares of the filter's standard deviations.
    bins : (n_run, n * n_column). Bin of each error.
    worst : (n_run, n_span, n_column). Largest size of an error in each span.
    mean_square : (n_run, n_span, n_column). Mean square in each span, times its length (s).
    """

    total: Floats
    squares: Floats
    sigma_squares: Floats
    bins: NDArray[np.uint16]
    worst: Floats
    mean_square: Floats


@jit
def add_errors(
    error: Floats,
    sigma: Floats,
    groups: Ints,
    counted: Ints,
    size: ErrorBins,
    spans: Spans,
    sums: ErrorSums,
    row: Floats,
) -> None:
    """Add up errors and standard deviations (n_run, n, n_out), run after run; count and bound them.

    groups (n_norm, 3) indices of three-axis quantities, whose norms are the columns after the outputs. The first
    counted (n_run,) times of a run count in the sums, which are updated. row (n, n_column) is a work array.
    """
    total, squares, sigma_squares, bins = sums.total, sums.squares, sums.sigma_squares, sums.bins
    worst, mean_square, t, at = sums.worst, sums.mean_square, spans.t, spans.at
    n_run, n, _ = error.shape
    n_column, n_span = row.shape[1], worst.shape[1]
    flat = row.reshape(n * n_column)
    for run in range(n_run):
        n_cell = counted[run] * n_column
        _with_norms(sigma[run], groups, row)
        for cell in range(n_cell):
            sigma_squares[cell] += flat[cell] * flat[cell]
        _with_norms(error[run], groups, row)
        for cell in range(n_cell):
            total[cell] += flat[cell]
            squares[cell] += flat[cell] * flat[cell]
        _find_bins(flat[:n_cell], size.unit, size.width, size.number, bins[run])
        bins[run, n_cell:] = size.number - 1
        for span in range(n_span):
            for k in range(at[span], at[span + 1] + 1):
                for c in range(n_column):
                    magnitude = abs(row[k, c])
                    if magnitude > worst[run, span, c] or magnitude != magnitude:  # what is no number stays
                        worst[run, span, c] = magnitude
            for k in range(at[span], at[span + 1]):
                step = t[k + 1] - t[k]
                for c in range(n_column):
                    mean_square[run, span, c] += step * (row[k + 1, c] ** 2 + row[k, c] ** 2) / 2.0


@jit
def _with_norms(values: Floats, groups: Ints, row: Floats) -> None:
    """Copy values (n, n_out) into rows (n, n_column), and the norms of groups after them."""
    n, n_out = values.shape
    for k in range(n):
        for c in range(n_out):
            row[k, c] = values[k, c]
        for g in range(len(groups)):
            x, y, z = values[k, groups[g, 0]], values[k, groups[g, 1]], values[k, groups[g, 2]]
            row[k, n_out + g] = np.sqrt(x * x + y * y + z * z)


@jit
def _find_bins(error: Floats, unit: Floats, width: float, n_bin: int, bins: Ints) -> None:
    """Write the bins of errors (n,)."""
    for cell in range(len(error)):
        place = log_unit(abs(error[cell]) / unit[cell]) / width
        bins[cell] = int(min(max(place + 1.0, 0.0), n_bin - 1.0))


@jit
def count_bins(histogram: Ints, bins: Ints) -> None:
    """Count the bins (n_run, n, n_column) of runs in a histogram (n, n_column, n_bin)."""
    n_run, n, n_column = bins.shape
    for k in range(n):
        for run in range(n_run):
            for c in range(n_column):
                histogram[k, c, bins[run, k, c]] += 1


class LagSums(NamedTuple):
    """Sums of products of innovations some epochs apart, and the arrays that they are computed in.

    total : (n_lag, n_used). Sums of products.
    number : (n_lag, n_used). Numbers of products.
    value : (n_epoch, n_used). Innovations of a run, 0 where there is none.
    there : (n_epoch, n_used). 1 where the run has an innovation.
    count_of_run : (n_lag, n_used). Numbers of products of a run.
    """

    total: Floats
    number: Floats
    value: Floats
    there: Floats
    count_of_run: Floats


@jit
def add_lags(innovation: Floats, t: Floats, until: Floats, channels: Ints, sums: LagSums) -> None:
    """Add up products of innovations (n_run, n, n_channel) some epochs apart, where both exist and the run counts.

    A run counts at times t (n,) s before until (n_run,) s. channels (n_used,) those that have any innovation; sums are
    updated.
    """
    total, number, value, there, count_of_run = sums
    n_run, n, _ = innovation.shape
    for run in range(n_run):
        is_other = run == 0  # most runs have their innovations at the same epochs
        for k in range(n):
            for c in range(len(channels)):
                e = innovation[run, k, channels[c]]
                is_there = np.isfinite(e) and t[k] < until[run]
                value[k, c] = e if is_there else 0.0
                is_other |= is_there != (there[k, c] == 1.0)
                there[k, c] = 1.0 if is_there else 0.0
        if is_other:
            count_of_run[:] = 0.0
        for lag in range(min(len(total), n)):
            for k in range(lag, n):
                _add_products(value[k - lag], value[k], total[lag])
                if is_other:
                    _add_products(there[k - lag], there[k], count_of_run[lag])
        number += count_of_run


@jit
def _add_products(early: Floats, late: Floats, total: Floats) -> None:
    for c in range(len(total)):
        total[c] += early[c] * late[c]
