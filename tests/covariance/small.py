"""A joint covariance made by hand, for tests: a few sources with a component each, in lanes as the engine has them."""

from __future__ import annotations

from collections import namedtuple

import numpy as np

from lvnav_trade.covariance.propagate import propagate_sources
from lvnav_trade.covariance.slots import align, arrange_lanes
from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.lanes import GROUP, grouped_zeros
from lvnav_trade.kernels.strapdown import N_SUM
from lvnav_trade.simulation.epoch.joint import _update_correlated_errors, _update_sources

# As much of the engine's records as propagation and update of the sources read.
Joint = namedtuple("Joint", "mean sources cross variance")
Work = namedtuple("Work", "D_true block input state_effect gain y b measurement_covariance noise innovation_variance")
Schedule = namedtuple("Schedule", "length_index first_tick n_tick")
WINDOW = Schedule(*[np.zeros(1, dtype=np.int64)] * 3)
Truth = namedtuple(
    "Truth",
    "group lane n_slot has_cross drives_motion component_decay noise echo source slot states state_from sensor driver "
    "profile first block_drives_motion nav_rows nav_columns white_variance state_decay first_correlated "
    "modelling_block noise_source",
)
FilterModel = namedtuple("FilterModel", "seconds clock")


def of_lanes(array, source):
    """Return what an array in groups, (n_group, ..., n_lane), holds of one source."""
    return array[source // GROUP, ..., source % GROUP]


def small(starts, variances, *, factor, noise, decay, white, blocks, rows, columns, seconds, clock=-1, **more):
    """Return (joint, scratch, true, model) of sources with one component each.

    starts : (n_source, n, n) covariances; variances, decay, noise : (n_source,) of the components; decay : (n,);
    white : (n_source, n) noise of a window; blocks, rows, columns : of the transition; more : fields of Truth
    """
    n_source, n = white.shape
    place = np.arange(n_source)
    group, lane = place // GROUP, place % GROUP
    n_group = int(group.max()) + 1

    def table(values):
        return align(np.swapaxes(arrange_lanes(np.asarray(values, dtype=float), group, lane), 0, 1))

    none, ones = np.zeros(0, dtype=np.int64), np.ones((n_group, 1), dtype=np.bool_)
    fields = {
        "group": group, "lane": lane, "n_slot": np.ones(n_group, dtype=np.int64), "has_cross": ones,
        "drives_motion": ones,
        "component_decay": table(np.reshape(factor, (n_source, 1, 1, 1))),
        "noise": table(np.reshape(noise, (n_source, 1, 1, 1))),
        "echo": table(np.zeros((n_source, 1, 1, 1))), "source": place, "slot": np.zeros(n_source, dtype=np.int64),
        "states": none, "state_from": np.zeros(n_source + 1, dtype=np.int64),
        "sensor": none, "driver": none, "profile": none, "first": none,
        "block_drives_motion": np.zeros(0, dtype=np.bool_), "nav_rows": rows, "nav_columns": columns,
        "white_variance": table(white[:, None]), "state_decay": decay[None],
        "first_correlated": 0, "modelling_block": none, "noise_source": np.array([n_source - 1]),
    }  # fmt: skip
    true = Truth(**(fields | more))
    joint = Joint(
        np.zeros(n),
        arrange_lanes(np.asarray(starts, dtype=float), group, lane),
        grouped_zeros((n_group, 1, n)),
        arrange_lanes(np.reshape(variances, (n_source, 1, 1)).astype(float), group, lane),
    )
    scratch = Work(
        blocks, np.zeros(9), np.zeros((9, 3)), np.zeros(n), np.zeros(n), grouped_zeros((n,)),
        grouped_zeros((n_group, 1, 9)), grouped_zeros((n_group, 1, 1)), grouped_zeros((n_group, 1, 1)),
        grouped_zeros((1,)),
    )  # fmt: skip
    return joint, scratch, true, FilterModel(np.array([seconds]), clock)


@jit
def _propagate(joint, scratch, true, model, sums, schedule):
    propagate_sources(joint, scratch, true, None, model, sums, schedule, 0)


def propagate(joint, scratch, true, model):
    """Propagate every source over the one window; how components enter stands in scratch.b."""
    _propagate(joint, scratch, true, model, np.zeros(N_SUM), WINDOW)


@jit
def _update(total, joint, scratch, true, h, entries, columns, source, noise):
    total[0] = _update_sources(joint, scratch, true, h, entries, columns, source, noise)


@jit
def _update_both(total, joint, scratch, true, h, entries, columns, source, noise, signals):
    total[0] = _update_sources(joint, scratch, true, h, entries, columns, source, noise)
    total[0] += _update_correlated_errors(joint, scratch, h, signals, true, 0, 0, False)


def update(joint, scratch, true, gain, h, entries, columns, source, noise, signals=None):
    """Update every source by a measurement, with the errors that it shares (signals, or None); return the true
    variance of the innovation.
    """
    total = np.zeros(1)
    scratch.gain[:] = gain
    given = (total, joint, scratch, true, h, entries, columns, source, noise)
    if signals is None:
        _update(*given)
    else:
        _update_both(*given, signals)
    return float(total[0])
