"""Runs that check linear covariance: a spot check of its verdicts, and alarms of solution separation.

A separation beyond its limit on any axis of position or velocity is an alarm. It names the satellite whose sub-filter
exceeds its limit most. Linear covariance has the alarms of a run without noise, from the mean separations.
"""

from typing import NamedTuple

import numpy as np
from scipy.special import erfc, gammainc, gammaincc

from lvnav_trade.covariance.diagnostics.protection import Protection, exclude_satellite, output_columns
from lvnav_trade.kernels.covariance import N_NAV_ERROR
from lvnav_trade.kernels.vector import WIDTH
from lvnav_trade.quantities.records import OF_SEPARATION, CovHistory, Floats, RunBlock
from lvnav_trade.simulation.montecarlo import run_block
from lvnav_trade.simulation.preparation.prepare import PreparedCase
from lvnav_trade.simulation.statistics import BlockSummary, merge, summarise

GAP = 5.0
"""Seconds without a measurement after which the next measurement is assessed separately."""
GAP_END_PREFIX = "first measurement at "
"""Beginning of the name of such a time."""


SUSPICION_LEVEL = 0.2
"""Level of the test over all errors of a case at all times, below which the second half of the runs is simulated."""


def spot_check(
    prepared_case: PreparedCase, history: CovHistory, events: dict[str, float], seed: int, runs: int
) -> BlockSummary:
    """Simulate runs of a case and return their statistics at the events and after every gap.

    Half of the runs are simulated first; the others only if an error is larger or smaller than expected. The draws are
    those of the campaign's runs with the same numbers.

    Parameters
    ----------
    prepared_case
        Prepared case.
    history
        Linear covariance of the case.
    events
        s since lift-off, by name of the event.
    seed, runs
        Seed of the campaign, and number of runs.
    """
    first_time = prepared_case.t_hist[0]
    last_time = prepared_case.t_hist[-1]
    times = {name: t for name, t in events.items() if first_time <= t <= last_time}
    times |= {gap.name: gap.end for gap in gaps(history)}

    def summary(first: int, count: int) -> BlockSummary:
        block = run_block(prepared_case, seed, first, count)
        return summarise(block, times, history.true_sigma, prepared_case.outputs)

    n_pair = -(-runs // (2 * WIDTH))  # rounded up
    half = WIDTH * n_pair  # whole groups of lanes
    first_half = summary(0, min(half, runs))
    if half >= runs or not _is_suspect(first_half, history):
        return first_half
    second_half = summary(half, runs - half)
    return merge([first_half, second_half])


def _is_suspect(summary: BlockSummary, history: CovHistory) -> bool:
    """Return whether navigation errors of some runs contradict linear covariance, at level `SUSPICION_LEVEL` in total.

    Tested are the mean square about the mean, by chi-square, and the largest error, by the Gaussian distribution.
    """
    hist = np.searchsorted(history.t, summary.t_event - 1e-9)
    sigma = history.true_sigma[hist, :N_NAV_ERROR]
    mean = history.mean[hist, :N_NAV_ERROR]
    error = summary.event_error[:, :, :N_NAV_ERROR]
    with np.errstate(divide="ignore", invalid="ignore"):
        z: Floats = (error - mean) / sigma
    z = z[:, sigma > 0.0]
    if not z.size:
        return False
    if not np.isfinite(z).all():
        return True  # a run failed
    n, n_row = z.shape
    half_square = 0.5 * np.sum(z**2, axis=0)
    # two-sided levels of the chi-square test, and of the largest of n errors (Bonferroni over the n_row errors)
    lower_tail = gammainc(0.5 * n, half_square)
    upper_tail = gammaincc(0.5 * n, half_square)
    square_level = 2.0 * np.minimum(lower_tail, upper_tail)
    largest_error = np.abs(z).max()
    largest_level = n * erfc(largest_error / np.sqrt(2.0))
    smallest_level = min(square_level.min(), largest_level)
    return bool(smallest_level < SUSPICION_LEVEL / n_row)


class Gap(NamedTuple):
    """Interval without measurements.

    name : Name of the measurement that ends it.
    begin : s since lift-off. Last measurement before.
    end : s since lift-off. First history time with the measurement that ends it.
    """

    name: str
    begin: float
    end: float


def gaps(history: CovHistory) -> tuple[Gap, ...]:
    """Return the gaps of a flight: intervals without measurements longer than `GAP` and three update intervals.

    The time before the first measurement counts too. The name of a gap contains its end.
    """
    measurement_epochs = np.flatnonzero(history.n_row > 0)
    if not measurement_epochs.size:
        return ()
    t = history.t_epoch[measurement_epochs]
    median_interval = float(np.median(np.diff(t))) if t.size > 1 else 0.0
    previous_times = np.concatenate([history.t[:1], t[:-1]])
    interval = t - previous_times
    is_gap = interval > max(GAP, 3.0 * median_interval)
    last_hist = history.t.size - 1
    end_times = t[is_gap]
    hist = np.searchsorted(history.t, end_times - 1e-9)
    hist = np.minimum(hist, last_hist)
    begins = previous_times[is_gap].tolist()
    ends = history.t[hist].tolist()
    intervals = []
    for begin, end in zip(begins, ends, strict=True):
        name = f"{GAP_END_PREFIX}{end:g} s"
        intervals.append(Gap(name, begin, end))
    return tuple(intervals)


_ROUNDING = 1e-6  # of a sigma: filters that have used the same measurements so far differ by less


def separation_ratio(separation: Floats, protection: Protection) -> Floats:
    """Return the largest ratio of separation to limit over axes and quantities; above 1 is an alarm.

    Parameters
    ----------
    separation
        (..., n_satellite, n_hist, n_quantity, 3) SI. Separations; not-a-number, of a failed run, is no alarm.
    protection
        Protection levels with the limits.

    Returns
    -------
    ndarray
        (..., n_satellite, n_hist).
    """
    tolerance = _ROUNDING * protection.sigma
    limit = protection.limits + tolerance + np.finfo(float).tiny
    ratio = np.abs(separation) / limit
    ratio = np.where(np.isfinite(ratio), ratio, 0.0)
    return np.asarray(ratio.max(axis=(-2, -1)))


def alarms(ratio: Floats, t: Floats, channels: Floats, first_run: int) -> Floats:
    """Return the alarms of runs as decisions (n, 4), see RunBlock.decisions.

    An alarm is recorded when it begins, and when it names another satellite than at the previous time.

    Parameters
    ----------
    ratio
        (n_run, n_satellite, n_hist). Ratios of `separation_ratio`.
    t
        (n_hist,) s since lift-off.
    channels
        (n_satellite,). First channel of each satellite.
    first_run
        Number of the first run.
    """
    if not ratio.shape[1]:
        return np.zeros((0, 4))
    is_alarm = ratio.max(axis=1) > 1.0
    worst = np.argmax(ratio, axis=1)
    satellite_numbers = np.where(is_alarm, worst, -1)
    no_alarm = np.full((len(satellite_numbers), 1), -1)
    previous_numbers = np.concatenate([no_alarm, satellite_numbers[:, :-1]], axis=1)
    begins = (satellite_numbers >= 0) & (satellite_numbers != previous_numbers)
    run, hist = np.nonzero(begins)
    satellite = satellite_numbers[run, hist]
    test = np.full(run.size, float(OF_SEPARATION))
    table = np.column_stack([first_run + run, t[hist], test, channels[satellite]])
    return table.astype(float)


def _channels(prepared_case: PreparedCase, protection: Protection) -> Floats:
    """Return the first channel of each satellite that has a sub-filter without it."""
    names = prepared_case.sky.names
    satellites = [names.index(name) for name in protection.satellites]
    return prepared_case.model.n_observable * np.array(satellites, dtype=float)


def add_alarms(runs: RunBlock, prepared_case: PreparedCase, protection: Protection | None, seed: int) -> RunBlock:
    """Return the runs with alarms among their decisions, by one further block of runs for every satellite.

    Without protection levels or alarms the runs are returned unchanged.

    Parameters
    ----------
    runs
        Block of runs of the case.
    prepared_case
        Prepared case.
    protection
        Protection levels of the case, or None.
    seed
        Seed of the campaign.
    """
    if protection is None or not protection.alarms:
        return runs
    columns = output_columns(prepared_case)
    n_run = len(runs.failed)
    n_satellite = len(protection.satellites)
    ratio = np.zeros((n_run, n_satellite, runs.t.size))
    for number, name in enumerate(protection.satellites):
        satellite = prepared_case.sky.names.index(name)
        sub_filter = exclude_satellite(prepared_case, satellite)
        sub_runs = run_block(sub_filter, seed, runs.first_run, n_run)
        error = runs.err[:, :, columns]
        sub_error = sub_runs.err[:, :, columns]
        limits = protection.limits[number]
        ratio[:, number] = separation_ratio(error - sub_error, protection._replace(limits=limits))
    channels = _channels(prepared_case, protection)
    run_decisions = alarms(ratio, runs.t, channels, runs.first_run)
    return runs._replace(decisions=_sorted_decisions(runs.decisions, run_decisions))


def add_nominal_alarms(history: CovHistory, prepared_case: PreparedCase, protection: Protection | None) -> CovHistory:
    """Return the linear covariance with the alarms of a run without noise among its decisions, if requested.

    Parameters
    ----------
    history
        Linear covariance of the case.
    prepared_case
        Prepared case.
    protection
        Protection levels of the case, or None.
    """
    if protection is None or not protection.alarms:
        return history
    ratio = separation_ratio(protection.separation, protection)[None]
    channels = _channels(prepared_case, protection)
    nominal_decisions = alarms(ratio, protection.t, channels, 0)
    return history._replace(decisions=_sorted_decisions(history.decisions, nominal_decisions))


def _sorted_decisions(decisions: Floats, alarm_decisions: Floats) -> Floats:
    """Return two tables of decisions as one, sorted by run, then by time."""
    table = np.concatenate([decisions, alarm_decisions])
    run = table[:, 0]
    time = table[:, 1]
    order = np.lexsort((time, run))
    return table[order]
