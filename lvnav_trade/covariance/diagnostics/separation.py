"""Alarms of solution separation in runs: every run is simulated again with each sub-filter, with the same draws.

A separation beyond its limit on any axis of position or velocity is an alarm. It names the satellite whose sub-filter
exceeds its limit most. Linear covariance has the alarms of a run without noise, from the mean separations.
"""

import numpy as np

from lvnav_trade.covariance.diagnostics.protection import Protection, columns_of, without_satellite
from lvnav_trade.quantities.records import OF_SEPARATION, CovHistory, Floats, RunBlock
from lvnav_trade.simulation.montecarlo import run_block
from lvnav_trade.simulation.preparation.prepare import Prepared

_ROUNDING = 1e-6  # of a sigma: filters that have used the same measurements so far differ by less


def furthest(apart: Floats, found: Protection) -> Floats:
    """Return the largest ratio of separation to limit over axes and quantities; above 1 is an alarm.

    Parameters
    ----------
    apart
        (..., n_satellite, n_hist, n_quantity, 3) SI. Separations; not-a-number, of a failed run, is no alarm.
    found
        Protection levels with the limits.

    Returns
    -------
    ndarray
        (..., n_satellite, n_hist).
    """
    ratio = np.abs(apart) / (found.limits + _ROUNDING * found.sigma + np.finfo(float).tiny)
    return np.asarray(np.where(np.isfinite(ratio), ratio, 0.0).max(axis=(-2, -1)))


def alarms(ratio: Floats, t: Floats, channels: Floats, first_run: int) -> Floats:
    """Return the alarms of runs as decisions (n, 4), see RunBlock.decisions.

    An alarm is recorded when it begins, and when it names another satellite than at the previous time.

    Parameters
    ----------
    ratio
        (n_run, n_satellite, n_hist). Ratios of `furthest`.
    t
        (n_hist,) s since lift-off.
    channels
        (n_satellite,). First channel of each satellite.
    first_run
        Number of the first run.
    """
    if not ratio.shape[1]:
        return np.zeros((0, 4))
    named = np.where(ratio.max(axis=1) > 1.0, np.argmax(ratio, axis=1), -1)
    before = np.concatenate([np.full((len(named), 1), -1), named[:, :-1]], axis=1)
    run, at = np.nonzero((named >= 0) & (named != before))
    kind = np.full(run.size, float(OF_SEPARATION))
    return np.column_stack([first_run + run, t[at], kind, channels[named[run, at]]]).astype(float)


def _channels(prepared: Prepared, found: Protection) -> Floats:
    """Return the first channel of each satellite that has a sub-filter without it."""
    return np.array([prepared.model.n_kind * prepared.sky.names.index(name) for name in found.satellites], dtype=float)


def with_alarms(runs: RunBlock, prepared: Prepared, found: Protection | None, seed: int) -> RunBlock:
    """Return the runs with alarms among their decisions, by one further block of runs for every satellite.

    Without protection levels or alarms the runs are returned unchanged.
    """
    if found is None or not found.alarms:
        return runs
    columns, n_run = columns_of(prepared), len(runs.failed)
    ratio = np.zeros((n_run, len(found.satellites), runs.t.size))
    for number, name in enumerate(found.satellites):
        other = run_block(without_satellite(prepared, prepared.sky.names.index(name)), seed, runs.first_run, n_run)
        of_satellite = found._replace(limits=found.limits[number])
        ratio[:, number] = furthest(runs.err[:, :, columns] - other.err[:, :, columns], of_satellite)
    return runs._replace(
        decisions=_joined(runs.decisions, alarms(ratio, runs.t, _channels(prepared, found), runs.first_run))
    )


def with_nominal_alarms(history: CovHistory, prepared: Prepared, found: Protection | None) -> CovHistory:
    """Return the linear covariance with the alarms of a run without noise among its decisions, if requested."""
    if found is None or not found.alarms:
        return history
    ratio = furthest(found.apart, found)[None]
    return history._replace(decisions=_joined(history.decisions, alarms(ratio, found.t, _channels(prepared, found), 0)))


def _joined(decisions: Floats, more: Floats) -> Floats:
    """Return decisions sorted by run, then by time."""
    joined = np.concatenate([decisions, more])
    return joined[np.lexsort((joined[:, 1], joined[:, 0]))]
