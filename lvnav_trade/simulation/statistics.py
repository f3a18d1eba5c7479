"""Statistics of a block of runs: sums, histograms, one row per run and event; mergeable in run order."""

from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lvnav_trade.quantities.records import (
    NO_CHANGES,
    NO_DECISIONS,
    NO_INJECTIONS,
    NO_LOST,
    Bools,
    Floats,
    Ints,
    Output,
    RunBlock,
)
from lvnav_trade.simulation.sums import ErrorBins, count_bins, lag_products, summed_errors

# Axis name of the norm of a three-axis quantity.
NORM = "3d"
# Width of a histogram bin in ln(|error| / scale): quantiles come out within half of it, 1 %.
BIN = 0.02
# Range of |error| / scale that the bins resolve; below is one bin, above another.
LOWEST, HIGHEST = 1e-3, 1e3
N_BIN = int(np.ceil(np.log(HIGHEST / LOWEST) / BIN)) + 2
# Lags of the innovation products: 0 to 10 epochs.
N_LAG = 11
_COUNTED = 8  # blocks whose bins are counted together
NOT_FINITE = 1
NO_COUNTS = np.zeros((0, 0, N_BIN), dtype=np.uint32)


class BlockSummary(NamedTuple):
    """Streamed statistics of some runs, SI. A *column* is an output or, after the outputs, the norm of a three-axis
    quantity.

    A failed run counts in the sums until it fails. Per run and event there is a row for failed runs too.

    runs : (n_run,). Run numbers.
    failed : (n_run,). Failure codes, as in RunBlock.
    t_failed : (n_run,) s since lift-off. Time of the failure, NaN without.
    t : (n_hist,) s since lift-off. History times.
    scale : (n_hist, n_column). Scale of the histogram: true sigma by linear covariance.
    n_good : (n_hist,). Number of runs in the sums at the history time.
    n_good_epoch : (n_epoch,). Number of runs in the sums at the epoch.
    total : (n_hist, n_column). Sum of the error, of a norm the sum of the norm.
    squares : (n_hist, n_column). Sum of the squared error.
    sigma_squares : (n_hist, n_column). Sum of the filter's own variance, of a norm the sum of the trace.
    bins : (n_run, n_hist, n_column). Histogram bin of |error| / scale in a block; the last bin from a failure on.
    nees : (n_hist,). Sum of the normalised estimation error squared.
    t_epoch : (n_epoch,) s since lift-off. Epochs.
    nis : (n_epoch,). Sum of squared normalised innovations.
    n_row : (n_epoch,). Sum of accepted scalar measurements.
    n_reject : (n_epoch,). Sum of rejected scalar measurements.
    lag_sum : (N_LAG, n_channel). Sum of products of two normalised innovations, by their distance in epochs.
    lag_count : (N_LAG, n_channel). Number of these products.
    events : Names of the events, in time order.
    t_event : (n_event,) s since lift-off.
    event_error : (n_run, n_event, n_column). Error at the event.
    event_sigma : (n_run, n_event, n_column). Standard deviation in the filter's own covariance at the event.
    event_nees : (n_run, n_event). Normalised estimation error squared at the event.
    t_bound : (n_interval + 1,) s since lift-off. Events and both ends of the history.
    worst : (n_run, n_interval, n_column). Largest |error| in the interval, both bounds included.
    mean_square : (n_run, n_interval, n_column). Mean over time of the squared error (trapezoidal rule).
    changes : (n_change, 5). Mode changes, as in RunBlock.
    decisions : (n_decision, 4). Fault decisions, as in RunBlock.
    injections : (n_run, n). Ends of guided ascents, as in RunBlock; empty without guidance.
    lost : (n_draw, 4). Draws of the vehicles that do not reach their cut-off, as in RunBlock.
    histogram : (n_hist, n_column, N_BIN). Counts of `bins` after blocks are merged.
    """

    runs: Ints
    failed: NDArray[np.int8]
    t_failed: Floats
    t: Floats
    scale: Floats
    n_good: Ints
    n_good_epoch: Ints
    total: Floats
    squares: Floats
    sigma_squares: Floats
    bins: NDArray[np.uint16]
    nees: Floats
    t_epoch: Floats
    nis: Floats
    n_row: Ints
    n_reject: Ints
    lag_sum: Floats
    lag_count: Ints
    events: tuple[str, ...]
    t_event: Floats
    event_error: Floats
    event_sigma: Floats
    event_nees: Floats
    t_bound: Floats
    worst: Floats
    mean_square: Floats
    changes: Floats = NO_CHANGES
    decisions: Floats = NO_DECISIONS
    injections: Floats = NO_INJECTIONS
    lost: Floats = NO_LOST
    histogram: NDArray[np.uint32] = NO_COUNTS

    @property
    def first_run(self) -> int:
        """Number of the first run."""
        return int(self.runs[0])

    @property
    def n_run(self) -> int:
        """Number of runs, failed runs included."""
        return len(self.runs)


_SUMMED = (
    "n_good",
    "n_good_epoch",
    "total",
    "squares",
    "sigma_squares",
    "nees",
    "nis",
    "n_row",
    "n_reject",
    "lag_sum",
    "lag_count",
)
_PER_RUN = ("runs", "failed", "t_failed")
_ROWS = (
    "event_error",
    "event_sigma",
    "event_nees",
    "worst",
    "mean_square",
    "changes",
    "decisions",
    "injections",
    "lost",
)
_SHARED = ("t", "scale", "t_epoch", "t_event", "t_bound")


def norm_groups(outputs: tuple[Output, ...]) -> dict[str, list[int]]:
    """Return the indices of the outputs of each quantity that has exactly three axes, by name of the quantity."""
    by_quantity: dict[str, list[int]] = {}
    for index, output in enumerate(outputs):
        indices = by_quantity.setdefault(output.quantity, [])
        indices.append(index)
    return {quantity: indices for quantity, indices in by_quantity.items() if len(indices) == 3}


def columns(outputs: tuple[Output, ...]) -> tuple[Output, ...]:
    """Return the outputs, followed by one `Output` with axis "3d" per three-axis quantity."""
    groups = norm_groups(outputs)
    first_of_group = [outputs[indices[0]] for indices in groups.values()]
    norms = [output._replace(axis=NORM) for output in first_of_group]
    return (*outputs, *norms)


def add_norms(components: Floats, outputs: tuple[Output, ...]) -> Floats:
    """Append to components (..., n_out) the root sum of squares of each three-axis quantity: (..., n_column)."""
    columns = [components]
    for indices in norm_groups(outputs).values():
        square = np.sum(components[..., indices] ** 2, axis=-1)
        norm = np.sqrt(square)
        columns.append(norm[..., None])
    return np.concatenate(columns, axis=-1)


def summarise(
    block: RunBlock, event_times: dict[str, float], scale: Floats, outputs: tuple[Output, ...]
) -> BlockSummary:
    """Return the streamed statistics of a block of runs.

    Parameters
    ----------
    block
        Errors in the axes of `outputs`.
    event_times
        s since lift-off, by name of the event; each must be a history time.
    scale
        (n_hist, n_out) SI. True sigma by linear covariance, the unit of the histograms; the same for all blocks.
    outputs
        Error components (PreparedCase.outputs); three-axis quantities get a norm.

    Raises
    ------
    ValueError
        If an event is not a history time.
    """
    names = tuple(sorted(event_times, key=lambda name: (event_times[name], name)))
    t_event = np.array([event_times[name] for name in names], dtype=float)
    at_event = _history_index(block.t, names, t_event)
    n_run = len(block.err)
    failure_codes = _failure_codes(block)
    end_times, alive, alive_epoch = _validity_masks(block, failure_codes)
    unit = add_norms(scale, outputs)
    unit = np.where(np.isfinite(unit) & (unit > 0), unit, 1.0)  # errors of zero sigma are binned in SI units
    groups = np.array(list(norm_groups(outputs).values()), dtype=np.int64).reshape(-1, 3)
    size = ErrorBins((unit * LOWEST).ravel(), BIN, N_BIN)
    lag_sum, lag_count = lag_products(block, end_times, N_LAG)
    t_bound = np.unique(np.concatenate([block.t[[0, -1]], block.t[at_event]]))
    return BlockSummary(
        runs=np.arange(block.first_run, block.first_run + n_run, dtype=np.int64),
        failed=failure_codes.astype(np.int8),
        t_failed=np.asarray(block.t_failed, dtype=float),
        t=block.t,
        scale=unit,
        n_good=_count(alive, n_run, block.t),
        n_good_epoch=_count(alive_epoch, n_run, block.t_epoch),
        **summed_errors(block, end_times, np.searchsorted(block.t, t_bound), groups, size),
        nees=_mask_after_failure(block.nees, alive).sum(axis=0),
        t_epoch=block.t_epoch,
        nis=_mask_after_failure(block.nis, alive_epoch).sum(axis=0),
        n_row=_mask_after_failure(block.n_row, alive_epoch).sum(axis=0, dtype=np.int64),
        n_reject=_mask_after_failure(block.n_reject, alive_epoch).sum(axis=0, dtype=np.int64),
        lag_sum=lag_sum,
        lag_count=lag_count,
        events=names,
        t_event=t_event,
        event_error=add_norms(block.err[:, at_event], outputs),
        event_sigma=add_norms(block.sigma[:, at_event], outputs),
        event_nees=block.nees[:, at_event],
        t_bound=t_bound,
        changes=block.changes,
        decisions=block.decisions,
        injections=block.injections,
        lost=block.lost_draws,
    )


def _failure_codes(block: RunBlock) -> NDArray[np.int8]:
    """Return the failure codes of the runs; a run with an error that is not finite has failed."""
    is_finite = np.isfinite(block.err).all(axis=(1, 2))
    has_failed = block.failed != 0
    return np.where(is_finite | has_failed, block.failed, NOT_FINITE)


def _validity_masks(block: RunBlock, failure_codes: NDArray[np.int8]) -> tuple[Floats, Bools | None, Bools | None]:
    """Return until when (s) each run counts, and whether it counts at history times and epochs; None if none fails."""
    end_times = _valid_end_times(block, failure_codes)
    if end_times is None:
        return np.full(len(failure_codes), np.inf), None, None
    counts_at_history = block.t < end_times[:, None]
    counts_at_epochs = block.t_epoch < end_times[:, None]
    return end_times, counts_at_history, counts_at_epochs


def _valid_end_times(block: RunBlock, failure_codes: NDArray[np.int8]) -> Floats | None:
    """Return until when (s) each run counts: its failure, or its first error that is not finite; None if none fails."""
    if not failure_codes.any():
        return None
    finite = np.all(np.isfinite(block.err), axis=2)
    all_finite = np.all(finite, axis=1)
    first_time = block.t[np.argmin(finite, axis=1)]
    first_bad = np.where(all_finite, np.inf, first_time)
    has_no_time = np.isnan(block.t_failed)
    t_failed = np.where(has_no_time, np.inf, block.t_failed)
    end = np.minimum(first_bad, t_failed)
    return np.asarray(np.where(failure_codes == 0, np.inf, end))


def _mask_after_failure(values: Any, alive: Bools | None) -> Any:
    """Return values (n_run, n, ...) where a run counts (n_run, n), and zero after its failure."""
    if alive is None:
        return values
    mask = alive.reshape(*alive.shape, *[1] * (values.ndim - 2))
    return np.where(mask, values, 0.0)


def _count(alive: Bools | None, runs: int, t: Floats) -> Ints:
    """Return the number of runs that count at the times, (n,)."""
    if alive is None:
        return np.full(len(t), runs, dtype=np.int64)
    return alive.sum(axis=0, dtype=np.int64)


def _history_index(t: Floats, names: tuple[str, ...], t_event: Floats) -> NDArray[np.intp]:
    """Return the indices (n_event,) of the history times of events; ValueError if an event is at none."""
    insertion = np.searchsorted(t, t_event - 1e-9)
    index = np.clip(insertion, 0, len(t) - 1)
    for name, t_wanted, nearest in zip(names, t_event, t[index], strict=True):
        if abs(t_wanted - nearest) > 1e-6:
            raise ValueError(f"event {name} at {t_wanted} s is not a history time (nearest after it {nearest} s)")
    return index


def merge(summaries: Iterable[BlockSummary], rows: bool = True) -> BlockSummary:
    """Return the summary of all parts together, merged in run order.

    Parameters
    ----------
    summaries
        Summaries: a list in any order, or an iterator in run order, which is consumed one part at a time.
    rows
        Whether fields with a row per run are merged. Otherwise they are empty, and memory grows by 17 bytes per run.

    Raises
    ------
    ValueError
        If parts overlap or belong to different histories, or if there is no part.
    """
    if isinstance(summaries, list):
        summaries = sorted(summaries, key=lambda part: part.first_run)
    stream = iter(summaries)
    first = next(stream, None)
    if first is None:
        raise ValueError("there is no part to merge")
    sums: dict[str, Any] = {name: getattr(first, name).copy() for name in _SUMMED}
    histogram = counts(first) if len(first.bins) else first.histogram.copy()
    joined_names = _PER_RUN + _ROWS if rows else _PER_RUN
    values_by_name = {name: [getattr(first, name)] for name in joined_names}
    none = {} if rows else {name: getattr(first, name)[:0].copy() for name in _ROWS}
    no_bins = first.bins[:0].copy()
    first = first._replace(**none, bins=no_bins)  # frees the bins of the first part
    bins = []
    for summary in stream:
        _check_follows(first, values_by_name["runs"][-1], summary)
        for name in _SUMMED:
            sums[name] += getattr(summary, name)
        for name, values in values_by_name.items():
            values.append(getattr(summary, name))
        bins.append(summary.bins)
        if len(bins) == _COUNTED:  # the histogram is far larger than the bins of a block
            count_bins(histogram, np.concatenate(bins))
            bins.clear()
    if bins:
        count_bins(histogram, np.concatenate(bins))
    joined_values: dict[str, Any] = {name: np.concatenate(values) for name, values in values_by_name.items()}
    return first._replace(**sums, **joined_values, histogram=histogram)


def _check_follows(first: BlockSummary, runs_before: Ints, summary: BlockSummary) -> None:
    if summary.first_run <= runs_before[-1]:
        raise ValueError(f"run {summary.first_run} is in two parts, or the parts are not in run order")
    is_same_history = all(np.array_equal(getattr(first, name), getattr(summary, name)) for name in _SHARED)
    if not is_same_history or first.events != summary.events:
        raise ValueError(f"the part that starts at run {summary.first_run} belongs to another history")


def counts(summary: BlockSummary) -> NDArray[np.uint32]:
    """Return the histogram (n_hist, n_column, N_BIN) of merged summaries, or of a block."""
    if not len(summary.bins):
        return summary.histogram
    histogram = np.zeros((*summary.bins.shape[1:], N_BIN), dtype=np.uint32)
    count_bins(histogram, summary.bins)
    return histogram


def compile_kernels() -> None:
    """Compile the kernels of the statistics, or load them from the cache, with a block of one run at one time."""
    zero = np.zeros(1)
    no_columns = np.zeros((1, 1, 0))
    no_rows = np.zeros((1, 1), dtype=np.int32)
    block = RunBlock(
        first_run=0,
        t=zero,
        err=no_columns,
        sigma=no_columns,
        nees=zero[None],
        t_epoch=zero,
        nis=zero[None],
        n_row=no_rows,
        n_reject=no_rows,
        innovation=no_columns,
        failed=np.zeros(1, np.int8),
        t_failed=zero,
    )
    merge([summarise(block, {}, no_columns[0], ())])


def quantiles(summary: BlockSummary, *probabilities: float) -> list[Floats]:
    """Return quantiles of |error|, (n_hist, n_column) SI each, accurate to half a bin (1 %).

    A quantile is the geometric mean of the bin with the run of rank ceil(probability * n), n including failed runs. It
    is 0 below the bins and infinite above.

    Parameters
    ----------
    summary
        Statistics of the runs.
    probabilities
        Probabilities of the quantiles, between 0 and 1.
    """
    n_run = summary.n_run
    ranks = [max(1, int(np.ceil(probability * n_run - 1e-9))) for probability in probabilities]
    shape = (len(ranks), *summary.total.shape)
    bins = np.empty(shape, dtype=np.int64)
    for k, histogram in enumerate(counts(summary)):  # time by time: the cumulated counts are as large again
        cumulative_counts = np.cumsum(histogram, axis=-1, dtype=np.uint32)
        for number, rank in enumerate(ranks):
            is_reached = cumulative_counts >= rank
            bins[number, k] = np.argmax(is_reached, axis=-1)
    magnitude = np.exp((bins - 0.5) * BIN)
    centre = summary.scale * LOWEST * magnitude
    is_last_bin = bins == N_BIN - 1
    values = np.where(is_last_bin, np.inf, centre)
    return list(np.where(bins == 0, 0.0, values))
