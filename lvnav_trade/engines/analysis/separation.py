"""Alarms of solution separation in runs: every run is flown again by each sub-filter, from the same draws.

A separation beyond its limit, on any axis of position or velocity, is an alarm; it names the satellite whose sub-filter
is furthest beyond. Linear covariance has the alarms of a run without noise, by the mean of the separations.
"""

import numpy as np

from lvnav_trade.engines.analysis.protection import Protection, columns_of, without_satellite
from lvnav_trade.engines.setup.prepare import Prepared
from lvnav_trade.engines.simulate.montecarlo import run_block
from lvnav_trade.records import OF_SEPARATION, CovHistory, Floats, RunBlock

_ROUNDING = 1e-6  # of a sigma: filters that have used the same measurements so far differ by less


def furthest(apart: Floats, found: Protection) -> Floats:
    """Return how far separations (..., n_satellite, n_hist, n_quantity, 3) are beyond their limits at most, over axes
    and quantities, (..., n_satellite, n_hist): above one is an alarm. What is no number, of a failed run, is none.
    """
    ratio = np.abs(apart) / (found.limits + _ROUNDING * found.sigma + np.finfo(float).tiny)
    return np.asarray(np.where(np.isfinite(ratio), ratio, 0.0).max(axis=(-2, -1)))


def alarms(ratio: Floats, t: Floats, channels: Floats, first_run: int) -> Floats:
    """Return the decisions (n, 4) of runs by ratios (n_run, n_satellite, n_hist): an alarm where one begins, or names
    another satellite than at the time before; channels (n_satellite,) are the first of each. See RunBlock.decisions.
    """
    if not ratio.shape[1]:
        return np.zeros((0, 4))
    named = np.where(ratio.max(axis=1) > 1.0, np.argmax(ratio, axis=1), -1)
    before = np.concatenate([np.full((len(named), 1), -1), named[:, :-1]], axis=1)
    run, at = np.nonzero((named >= 0) & (named != before))
    kind = np.full(run.size, float(OF_SEPARATION))
    return np.column_stack([first_run + run, t[at], kind, channels[named[run, at]]]).astype(float)


def _channels(prepared: Prepared, found: Protection) -> Floats:
    """Return the first channel of each satellite that a sub-filter is without."""
    return np.array([prepared.model.n_kind * prepared.sky.names.index(name) for name in found.satellites], dtype=float)


def with_alarms(runs: RunBlock, prepared: Prepared, found: Protection | None, seed: int) -> RunBlock:
    """Return the runs with the alarms among their decisions: one further block of flights for every satellite. Without
    protection levels, or where they ask for no alarms, the runs are returned as they are.
    """
    if found is None or not found.alarms:
        return runs
    columns, n_run = columns_of(prepared), len(runs.failed)
    ratio = np.zeros((n_run, len(found.satellites), runs.t.size))
    for number, name in enumerate(found.satellites):
        other = run_block(without_satellite(prepared, prepared.sky.names.index(name)), seed, runs.first_run, n_run)
        one = found._replace(limits=found.limits[number])
        ratio[:, number] = furthest(runs.err[:, :, columns] - other.err[:, :, columns], one)
    return runs._replace(
        decisions=_joined(runs.decisions, alarms(ratio, runs.t, _channels(prepared, found), runs.first_run))
    )


def with_nominal_alarms(history: CovHistory, prepared: Prepared, found: Protection | None) -> CovHistory:
    """Return linear covariance with the alarms of a run without noise among its decisions, where they are asked for."""
    if found is None or not found.alarms:
        return history
    ratio = furthest(found.apart, found)[None]
    return history._replace(decisions=_joined(history.decisions, alarms(ratio, found.t, _channels(prepared, found), 0)))


def _joined(decisions: Floats, more: Floats) -> Floats:
    """Return decisions run after run, in time order."""
    both = np.concatenate([decisions, more])
    return both[np.lexsort((both[:, 1], both[:, 0]))]
