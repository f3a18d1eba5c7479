"""One flight with an attitude reference, of one run or eight: every sample of the unit is a measurement, or none is."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from lvnav_trade.engines.flight import record
from lvnav_trade.engines.inputs import Floats
from lvnav_trade.engines.sensing import begin, observe, sense
from lvnav_trade.filters.ekf import (
    absorb_and_count,
    clear_epoch,
    correct,
    correct_motion,
    fill_loose,
    place_antenna,
    predict_window,
    rows_at,
)
from lvnav_trade.kernels import processes
from lvnav_trade.kernels.covariance import absorb
from lvnav_trade.kernels.jit import inlined, jit
from lvnav_trade.kernels.lanes import like, sqrt, where
from lvnav_trade.kernels.random import normals
from lvnav_trade.kernels.strapdown import Q, mechanise
from lvnav_trade.kernels.vehicle import N_SAMPLE, absorb_samples, advance, mirror
from lvnav_trade.observables import attitude

_ZERO = np.uint64(0)
N_BESIDE = 12
"""Outputs beside the states: rate and acceleration, raw and corrected."""
FIRST_SAMPLE = 9
"""Innovation channel of the first row of the unit."""


class Own(NamedTuple):
    """Arrays of a run beside `Work`: motion (6,) estimated rate and acceleration; sample (6,) of the last tick; z,
    weight, residual (6,); gain (6, n_state), moved (9, n_state); measured (4,) attitude; row (1,), entry of a row.
    """

    motion: Floats
    sample: Floats
    z: Floats
    weight: Floats
    residual: Floats
    gain: Floats
    moved: Floats
    row: Floats


def own_shapes(n_state: int) -> dict[str, tuple[int, ...]]:
    """Return the shape of every array of Own for one run."""
    return {
        "motion": (6,), "sample": (6,), "z": (6,), "weight": (6,), "residual": (6,), "gain": (6, n_state),
        "moved": (9, n_state), "row": (1,),
    }  # fmt: skip


@jit
def feed_back(work, own, vehicle):
    """Add the error state to every estimate, biases by their blocks, and set it to zero."""
    x = work.x
    correct_motion(work.nav, x)
    for i in range(3):
        work.par[0, i] = work.par[0, i] + x[vehicle.bias + i]
        work.par[1, i] = work.par[1, i] + x[vehicle.bias + 3 + i]
    for i in range(N_SAMPLE):
        own.motion[i] = own.motion[i] + x[vehicle.motion + i]
    extra = vehicle.bias + 6
    for i in range(extra, vehicle.motion):
        work.extra[i - extra] = work.extra[i - extra] + x[i]
    for i in range(vehicle.motion + 6):
        x[i] = like(x[i], 0.0)


@jit
def take_samples(work, own, vehicle, tick, at, dt):
    """Absorb the samples of a tick that stand in row `at` of the increments, and put the estimates in their place."""
    m = vehicle.motion
    for i in range(N_SAMPLE):
        own.sample[i] = work.increments[at, i] / dt
        own.z[i] = own.sample[i] - own.motion[i] - work.par[i // 3, i % 3]
        work.P[m + i, m + i] = work.P[m + i, m + i] + vehicle.walk[tick, i]
    absorb_samples(work.P, work.x, own.gain, own.weight, own.residual, own.z, vehicle.variance, vehicle.bias, m)
    feed_back(work, own, vehicle)
    for i in range(N_SAMPLE):
        work.increments[0, i] = dt * own.motion[i]


@inlined
def filter_window(work, own, unit, belief, vehicle, first, n_tick, length):
    """Carry a filter that models the vehicle through a window, sample by sample; what is slow follows at its end."""
    for k in range(n_tick):
        take_samples(work, own, vehicle, first + k, k, unit.dt)
        mechanise(work.nav, work.sums, work.previous, work.increments, 1, unit.dt, belief.gravity)
        advance(work.P, own.moved, work.sums, unit.dt, vehicle.motion)
    mirror(work.P)
    predict_window(work, belief, length)


@inlined
def mechanise_window(work, own, unit, belief, first, n_tick, length):
    """Carry a filter without a model of the vehicle through a window: the increments, less biases, are its motion."""
    for i in range(N_SAMPLE):
        own.sample[i] = work.increments[n_tick - 1, i] / unit.dt
    processes.compensate(work.increments, n_tick, work.tables[0], work.tables[1], belief.lean, unit.dt)
    if belief.group > 1:
        processes.combine(work.increments, n_tick, belief.group)
    dt = unit.dt * belief.group
    mechanise(work.nav, work.sums, work.previous, work.increments, n_tick // belief.group, dt, belief.gravity)
    predict_window(work, belief, length)


@jit
def refer(work, own, belief, vehicle, epoch, k0, k1):
    """Absorb the attitude reference of an epoch; rows of the receiver may have been absorbed before."""
    n0, n1, n2, _ = normals(k0, k1, vehicle.source, work.run[0], np.uint64(epoch + 1), _ZERO)
    nav, t = work.nav, vehicle.attitude[epoch]
    m0, m1, m2, m3 = attitude.observe(t[0], t[1], t[2], t[3], vehicle.sigma, n0, n1, n2)
    z = attitude.innovation(m0, m1, m2, m3, nav[Q], nav[Q + 1], nav[Q + 2], nav[Q + 3])
    own.row[0] = like(n0, 1.0)
    for axis in range(3):
        normalised, weight = absorb(
            work.P, work.x, work.K, own.row, vehicle.entries, vehicle.columns[axis], z[axis], vehicle.believed,
            belief.gate_squared, belief.n_estimated, belief.joseph,
        )  # fmt: skip
        _count(work, epoch, 6 + axis, normalised, weight)


@jit
def _count(work, epoch, channel, normalised, weight):
    work.innovation[epoch, channel] = normalised
    believed = weight > 0.0
    work.nis[epoch] = work.nis[epoch] + where(believed, normalised * normalised, 0.0)
    work.n_row[epoch] = work.n_row[epoch] + where(believed, 1.0, 0.0)
    work.n_reject[epoch] = work.n_reject[epoch] + where(believed, 0.0, 1.0)


@inlined
def update_epoch(work, own, signals, belief, vehicle, epoch, dt, k0, k1):
    """Absorb what receiver and attitude reference put out at an epoch, linearised at one point, and correct."""
    clear_epoch(work, epoch, FIRST_SAMPLE + N_SAMPLE)
    if vehicle.modelled:
        for i in range(N_SAMPLE):
            _count(work, epoch, FIRST_SAMPLE + i, own.residual[i] * sqrt(own.weight[i]), own.weight[i])
    observe(work, None, signals, False, epoch, k0, k1)
    n_row = rows_at(belief, signals, epoch)
    if n_row > 0:
        place_antenna(work, None, belief, dt)
        fill_loose(work, belief, signals, epoch)
        for row in range(n_row):
            absorb_and_count(work, None, belief, signals, epoch, row, row, belief.gate_squared)
    if vehicle.on[epoch]:
        refer(work, own, belief, vehicle, epoch, k0, k1)
    if vehicle.modelled:
        feed_back(work, own, vehicle)
    else:
        correct(work, belief)


@inlined
def record_motion(work, own, history, shared, belief, vehicle, tick, hist):
    """Write errors, sigma and NEES at a history time; of rate and acceleration those of the tick that ends there."""
    n = belief.n_state
    if vehicle.modelled:
        for i in range(3):
            work.x[vehicle.motion + i] = vehicle.rate[tick, i] - own.motion[i]
            work.x[vehicle.motion + 3 + i] = vehicle.force[tick, i] - own.motion[3 + i]
    record(work, history, shared, belief, hist)
    for i in range(N_SAMPLE):
        true = vehicle.rate[tick, i % 3] if i < 3 else vehicle.force[tick, i % 3]
        bias = vehicle.bias + i
        work.err[hist, n + i] = true - own.sample[i]
        work.err[hist, n + 6 + i] = true - own.sample[i] + work.par[i // 3, i % 3]
        work.sigma[hist, n + i] = sqrt(like(work.P[0, 0], vehicle.raw[i]))
        work.sigma[hist, n + 6 + i] = sqrt(work.P[bias, bias] + vehicle.variance[i])


@inlined
def fly_vehicle(work, own, schedule, unit, signals, start, history, belief, vehicle, k0, k1):
    """Fly one run (float64 arrays) or eight (lane views) from start to end; `work` is filled.

    Parameters
    ----------
    work : Work; own : Own; schedule : Schedule; unit : Unit; signals : Signals; start : Start; history : Record
    belief : Belief; vehicle : Vehicle
    k0, k1 : key words of the campaign's seed
    """
    begin(work, unit, signals, start, belief, k0, k1)
    for i in range(N_SAMPLE):
        own.motion[i], own.sample[i] = like(work.nav[0], 0.0), like(work.nav[0], vehicle.rate[0, i % 3])
        if i >= 3:
            own.sample[i] = like(work.nav[0], vehicle.force[0, i % 3])
    dt = unit.dt * belief.group
    for w in range(schedule.n_tick.shape[0]):
        first, n_tick = schedule.first_tick[w], schedule.n_tick[w]
        if n_tick > 0:
            sense(work, unit, first, n_tick, k0, k1)
            if vehicle.modelled:
                filter_window(work, own, unit, belief, vehicle, first, n_tick, schedule.length[w])
            else:
                mechanise_window(work, own, unit, belief, first, n_tick, schedule.length[w])
        if schedule.epoch[w] >= 0:
            update_epoch(work, own, signals, belief, vehicle, schedule.epoch[w], dt, k0, k1)
        if schedule.hist[w] >= 0:
            tick = max(0, first + n_tick - 1)
            record_motion(work, own, history, signals.shared, belief, vehicle, tick, schedule.hist[w])
