"""Process noise from an ensemble: what the filter's transition misses of perturbed inertial systems, step by step."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from lvnav_trade.engines.flight import true_parameter
from lvnav_trade.engines.inputs import Work
from lvnav_trade.engines.montecarlo import new_work
from lvnav_trade.engines.prepare import Prepared
from lvnav_trade.engines.sensing import begin, sense
from lvnav_trade.kernels import processes, transition
from lvnav_trade.kernels.attitude import small_rotation
from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.joint import apply_phi
from lvnav_trade.kernels.random import seed_words
from lvnav_trade.kernels.strapdown import Q, R, V, mechanise
from lvnav_trade.kernels.transition import ATT, POS, VEL
from lvnav_trade.records import Floats


class StepErrors(NamedTuple):
    """Ensemble statistics of the error per step: true error at a step's end minus the transition of the one at its
    start.

    t (n_step,) s end of each step; seconds (n_step,) its length; mean (n_step, n_state), covariance (n_step, n_state,
    n_state) over the runs, SI, frame i (parameters in body axes); error (n_step, n_state) root mean square of the error
    itself, to hold the miss against; n_run.
    """

    t: Floats
    seconds: Floats
    mean: Floats
    covariance: Floats
    error: Floats
    n_run: int


class Densities(NamedTuple):
    """Process noise that stands for the error per step, as root densities: attitude rad/sqrt(s), velocity m/s/sqrt(s),
    position m/sqrt(s), gyro and accelerometer bias rad/s/sqrt(s) and m/s^2/sqrt(s), mean over axes and steps.
    """

    attitude: float
    velocity: float
    position: float
    gyro_bias: float
    accel_bias: float


@jit
def _true_error(x, work, history, belief, hist):
    """Set x (n_state,) to truth minus the uncorrected inertial system at a history time, frame i."""
    nav, q = work.nav, history.q[hist]
    x[ATT], x[ATT + 1], x[ATT + 2] = small_rotation(q[0], q[1], q[2], q[3], nav[Q], nav[Q + 1], nav[Q + 2], nav[Q + 3])
    for i in range(3):
        x[VEL + i] = history.v[hist, i] - nav[V + i]
        x[POS + i] = history.r[hist, i] - nav[R + i]
    for b in range(belief.par_offset.shape[0]):
        for i in range(3):
            at = belief.par_offset[b] + i
            x[at] = true_parameter(work.true_tables, belief.par_sensor[b], belief.par_driver[b], i)


@jit
def _miss(error, missed, work, schedule, unit, signals, start, history, belief, k0, k1):
    """Fly one run unaided; fill the error at each history time, and what the transition missed of it since the one
    before, both (n_hist, n_state).
    """
    begin(work, unit, signals, start, belief, k0, k1)
    processes.gather(work.true_tables, work.true_par, unit.sensors, unit.drivers)
    n, last = belief.n_state, -1
    for w in range(schedule.n_tick.shape[0]):
        first, n_tick = schedule.first_tick[w], schedule.n_tick[w]
        if n_tick > 0:
            sense(work, unit, first, n_tick, k0, k1)
            if belief.group > 1:
                processes.combine(work.increments, n_tick, belief.group)
            mechanise(
                work.nav, work.sums, work.previous, work.increments, n_tick // belief.group, unit.dt * belief.group,
                belief.gravity,
            )  # fmt: skip
            if last >= 0:
                length, nav = schedule.length[w], work.nav
                seconds = belief.seconds[length]
                transition.fill(
                    work.D, belief.block_kinds, belief.block_drivers, work.sums, nav[R], nav[R + 1], nav[R + 2], seconds
                )
                apply_phi(work.x, work.D, belief.block_rows, belief.block_columns, belief.decay[length], -1, seconds)
        hist = schedule.hist[w]
        if hist >= 0:
            _true_error(error[hist], work, history, belief, hist)
            for i in range(n):
                missed[hist, i] = error[hist, i] - work.x[i] if last >= 0 else 0.0
                work.x[i] = error[hist, i]
            last = hist


def step_errors(prepared: Prepared, seed: int, n_run: int) -> StepErrors:
    """Return what the filter's transition misses from one history time to the next, over an ensemble of unaided runs.

    Every run draws all errors of the unit and of the start, those that the filter models and those that it does not;
    the transition is evaluated on the run's own sensed motion, as a filter on board would.
    """
    n_hist, n = prepared.t_hist.size, prepared.layout.n_state
    total, squares, size = np.zeros((n_hist, n)), np.zeros((n_hist, n, n)), np.zeros((n_hist, n))
    error, missed = np.empty((n_hist, n)), np.empty((n_hist, n))
    work: Work = new_work(prepared, lanes=False)
    words = seed_words(seed)
    for run in range(n_run):
        work.run[0] = run
        _miss(
            error, missed, work, prepared.schedule, prepared.unit, prepared.signals, prepared.start, prepared.record,
            prepared.belief, *words,
        )  # fmt: skip
        total += missed
        squares += missed[:, :, None] * missed[:, None, :]
        size += error**2
    mean = total / n_run
    covariance = (squares - n_run * mean[:, :, None] * mean[:, None, :]) / max(1, n_run - 1)
    return StepErrors(
        prepared.t_hist[1:], np.diff(prepared.t_hist), mean[1:], covariance[1:], np.sqrt(size / n_run)[1:], n_run
    )


def densities(found: StepErrors, prepared: Prepared, since: float = 0.0, until: float = math.inf) -> Densities:
    """Return the process noise that has the ensemble's mean square error per step, over the steps of a stretch of
    flight (s since lift-off).
    """
    chosen = (found.t > since) & (found.t <= until) & (found.seconds > 0.0)
    variance = np.diagonal(found.covariance, axis1=1, axis2=2) + found.mean**2
    density = variance[chosen].sum(axis=0) / found.seconds[chosen].sum()

    def root(at: int) -> float:
        return float(np.sqrt(density[at : at + 3].mean()))

    by_name = {block.name: block.offset for block in prepared.layout.parameters}
    biases = [root(by_name[name]) if name in by_name else 0.0 for name in ("gyro_bias", "accel_bias")]
    return Densities(root(ATT), root(VEL), root(POS), *biases)
