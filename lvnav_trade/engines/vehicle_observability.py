"""What the rows of a flight with an attitude reference can tell of its states, the unit's samples among them."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from lvnav_trade.engines.lincov import nominal
from lvnav_trade.engines.observability import TOLERANCE, Stretch, decompose, fold, initial_spread
from lvnav_trade.engines.prepare import Prepared
from lvnav_trade.engines.truth import source_names, true_model
from lvnav_trade.engines.vehicle import Vehicle
from lvnav_trade.engines.vehicle_carried import nominal_tick, nominal_window
from lvnav_trade.filters.ekf import fill_loose, place_antenna, rows_at
from lvnav_trade.kernels import transition
from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.joint import apply_phi
from lvnav_trade.kernels.strapdown import N_SUM, R, place
from lvnav_trade.kernels.transition import ATT
from lvnav_trade.kernels.vehicle import N_SAMPLE, advance_vector
from lvnav_trade.records import Floats


@jit
def _fold_epoch(triangle, phi, row_of, nominal, signals, belief, vehicle, epoch):
    """Fold in the rows of an epoch, in sigmas of their noise; return how many."""
    n, n_row = phi.shape[0], rows_at(belief, signals, epoch)
    if n_row > 0:
        fill_loose(nominal, belief, signals, epoch)
    for row in range(n_row):
        weight = 1.0 / np.sqrt(signals.variance[epoch, row])
        for j in range(n):
            total = 0.0
            for k in range(belief.n_entry[row]):
                total += nominal.H[row, belief.entry[row, k]] * phi[j, belief.column[row, k]]
            row_of[j] = weight * total
        fold(triangle, row_of)
    n_axis = 3 if vehicle.on[epoch] else 0
    for axis in range(n_axis):
        for j in range(n):
            row_of[j] = phi[j, ATT + axis] / np.sqrt(vehicle.believed)
        fold(triangle, row_of)
    return n_row + n_axis


@jit
def _fold_samples(triangle, phi, row_of, sums, vehicle, reference, first, n_tick, dt):
    """Fold in the samples of a window's ticks, and carry the transition over them; return how many rows."""
    n = phi.shape[0]
    for tick in range(first, first + n_tick):
        for r in range(N_SAMPLE):
            for j in range(n):
                row_of[j] = (phi[j, vehicle.motion + r] + phi[j, vehicle.bias + r]) / np.sqrt(vehicle.variance[r])
            fold(triangle, row_of)
        nominal_tick(sums, reference, tick, dt)
        for j in range(n):
            advance_vector(phi[j], sums, dt, vehicle.motion)
    return N_SAMPLE * n_tick


@jit
def _gather(triangle, phi, D, row_of, sums, increments, nominal, schedule, unit, signals, belief, vehicle, nav,
            reference, first_window, last_window):  # fmt: skip
    """Fold in every row of a stretch, times the transition since its start, in sigmas of its noise; return how many.

    triangle (n, n) and phi (n, n), the columns of the transition, updated; the rest is work and settings, nav the
    rows, columns, kinds and drivers of the blocks that are propagated by windows.
    """
    n, count = phi.shape[0], 0
    rows, columns, kinds, drivers = nav
    for w in range(first_window, last_window + 1):
        first, n_tick, epoch = schedule.first_tick[w], schedule.n_tick[w], schedule.epoch[w]
        if n_tick > 0:
            if vehicle.modelled:
                count += _fold_samples(triangle, phi, row_of, sums, vehicle, reference, first, n_tick, unit.dt)
                place(nominal.nav, reference, first)
            else:
                nominal_window(nominal, sums, increments, reference, first, n_tick, unit.dt, belief.gravity)
            length, at = schedule.length[w], nominal.nav
            transition.fill(D, kinds, drivers, sums, at[R], at[R + 1], at[R + 2], belief.seconds[length])
            for j in range(n):
                apply_phi(phi[j], D, rows, columns, belief.decay[length], belief.clock, belief.seconds[length])
        if epoch >= 0:
            place(nominal.nav, reference, first + n_tick)
            place_antenna(nominal, None, belief, unit.dt)
            count += _fold_epoch(triangle, phi, row_of, nominal, signals, belief, vehicle, epoch)
    return count


def observability(prepared: Prepared, edges: Floats) -> list[Stretch]:
    """Return the observability of the filter's states over the stretches between edges (s since lift-off).

    Evaluated on the nominal flight; edges outside it are moved to its ends. Steps of rate and acceleration are no
    rows: over a stretch the two are taken for constant, which is what asks most of the other states.
    """
    vehicle = prepared.vehicle
    assert vehicle is not None
    t = prepared.reference.t
    marks = np.unique(np.clip(edges, t[0], t[-1]))
    return [_stretch(prepared, vehicle, float(a), float(b)) for a, b in pairwise(marks)]


def _stretch(prepared: Prepared, vehicle: Vehicle, start: float, end: float) -> Stretch:
    schedule, belief, n = prepared.schedule, prepared.belief, prepared.layout.n_state
    ends = prepared.reference.t[schedule.first_tick + schedule.n_tick]
    inside = np.flatnonzero((ends > start + 1e-9) & (ends <= end + 1e-9))
    true = true_model(prepared, source_names(prepared))
    nav = (true.nav_rows, true.nav_columns, true.nav_kinds, true.nav_drivers)
    if vehicle.modelled:
        nav = (belief.block_rows, belief.block_columns, belief.block_kinds, belief.block_drivers)
    triangle, phi = np.zeros((n, n)), np.eye(n)  # row j of phi is the column of Phi that belongs to state j
    work = (np.zeros((nav[0].size, 9)), np.zeros(n), np.zeros(N_SUM))
    increments = np.zeros((int(schedule.n_tick.max()), 6))
    count = _gather(
        triangle, phi, *work, increments, nominal(prepared), schedule, prepared.unit, prepared.signals, belief, vehicle,
        nav, prepared.reference, int(inside[0]), int(inside[-1]),
    )  # fmt: skip
    scale, root = initial_spread(prepared.start.P)
    singular, directions = decompose(triangle * scale @ root, root)
    return Stretch(start, end, int(np.sum(singular > TOLERANCE)), singular, directions[-1], count, directions)
