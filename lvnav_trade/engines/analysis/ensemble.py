"""Process noise from an ensemble: the error of the filter's transition for perturbed inertial systems."""

import math
from typing import NamedTuple

import numpy as np

from lvnav_trade.engines.setup.inputs import Options
from lvnav_trade.engines.setup.prepare import Prepared
from lvnav_trade.engines.simulate.montecarlo import simulated
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


def step_errors(prepared: Prepared, seed: int, n_run: int) -> StepErrors:
    """Return what the filter's transition misses from one history time to the next, over an ensemble of unaided runs.

    Every run draws all errors of the unit and of the start, those that the filter models and those that it does not;
    the transition is evaluated on the run's own sensed motion, as a filter on board would.
    """
    unaided = prepared._replace(
        model=prepared.model._replace(aided=False),
        options=Options(misses=True),
        scenario=prepared.scenario.model_copy(
            update={"filter": prepared.scenario.filter.model_copy(update={"feedback": "open"})}
        ),
    )
    n_hist, n = prepared.t_hist.size, prepared.layout.n_state
    total, squares, size = np.zeros((n_hist, n)), np.zeros((n_hist, n, n)), np.zeros((n_hist, n))
    for misses in simulated(unaided, seed, n_run):
        total += misses.missed.sum(axis=0)
        squares += np.einsum("rhi,rhj->hij", misses.missed, misses.missed)
        size += np.sum(misses.error**2, axis=0)
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
