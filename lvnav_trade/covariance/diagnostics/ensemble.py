"""Process noise from an ensemble: the error of the filter's transition for perturbed inertial systems."""

import math
from typing import NamedTuple

import numpy as np

from lvnav_trade.kernels.transition import ATT, POS, VEL
from lvnav_trade.quantities.records import Floats
from lvnav_trade.simulation.montecarlo import simulate_transition_errors
from lvnav_trade.simulation.preparation.inputs import Options
from lvnav_trade.simulation.preparation.prepare import PreparedCase


class StepErrors(NamedTuple):
    """Ensemble statistics of the transition error per step: true error at its end minus the propagated initial error.

    t : (n_step,) s since lift-off. End of each step.
    seconds : (n_step,) s. Length of each step.
    mean : (n_step, n_state) SI. Mean over the runs, frame i (parameters in body axes).
    covariance : (n_step, n_state, n_state) SI squared. Covariance over the runs.
    error : (n_step, n_state) SI. Root mean square of the error itself, for comparison.
    n_run : Number of runs.
    """

    t: Floats
    seconds: Floats
    mean: Floats
    covariance: Floats
    error: Floats
    n_run: int


class Densities(NamedTuple):
    """Process noise equivalent to the transition error per step, as root PSDs averaged over axes and steps.

    attitude : rad/sqrt(s).
    velocity : m/s/sqrt(s).
    position : m/sqrt(s).
    gyro_bias : rad/s/sqrt(s).
    accel_bias : m/s^2/sqrt(s).
    """

    attitude: float
    velocity: float
    position: float
    gyro_bias: float
    accel_bias: float


def step_errors(prepared_case: PreparedCase, seed: int, n_run: int) -> StepErrors:
    """Return the statistics of the transition error between history times, over an ensemble of unaided runs.

    Each run draws all errors of IMU and start, modelled by the filter or not. The transition is evaluated at the motion
    sensed in the run, as in a filter on board.

    Parameters
    ----------
    prepared_case
        Prepared case.
    seed, n_run
        Seed of the campaign, and number of runs.
    """
    scenario = prepared_case.scenario
    open_loop = scenario.filter.model_copy(update={"feedback": "open"})
    unaided_case = prepared_case._replace(
        model=prepared_case.model._replace(has_epochs=False),
        options=Options(has_transition_errors=True),
        scenario=scenario.model_copy(update={"filter": open_loop}),
    )
    n_hist = prepared_case.t_hist.size
    n = prepared_case.layout.n_state
    total = np.zeros((n_hist, n))
    products = np.zeros((n_hist, n, n))
    squares = np.zeros((n_hist, n))
    for run_group in simulate_transition_errors(unaided_case, seed, n_run):
        transition_errors = run_group.transition_error
        total += transition_errors.sum(axis=0)
        products += np.einsum("rhi,rhj->hij", transition_errors, transition_errors)
        squares += np.sum(run_group.error**2, axis=0)
    mean = total / n_run
    scatter = products - n_run * mean[:, :, None] * mean[:, None, :]
    covariance = scatter / max(1, n_run - 1)
    error = np.sqrt(squares / n_run)
    # the first history time has no step before it
    return StepErrors(
        t=prepared_case.t_hist[1:],
        seconds=np.diff(prepared_case.t_hist),
        mean=mean[1:],
        covariance=covariance[1:],
        error=error[1:],
        n_run=n_run,
    )


def densities(errors: StepErrors, prepared_case: PreparedCase, begin: float = 0.0, end: float = math.inf) -> Densities:
    """Return the process noise with the mean square transition error of the ensemble.

    Parameters
    ----------
    errors
        Statistics of the transition error.
    prepared_case
        Prepared case.
    begin, end
        s since lift-off. Interval of the flight whose steps are used.
    """
    in_interval = (errors.t > begin) & (errors.t <= end) & (errors.seconds > 0.0)
    variance = np.diagonal(errors.covariance, axis1=1, axis2=2) + errors.mean**2
    # white noise of density q adds q T per step, so q is the sum of the variances over the sum of the times
    total_variance = variance[in_interval].sum(axis=0)
    total_time = errors.seconds[in_interval].sum()
    density = total_variance / total_time

    offsets = {"attitude": ATT, "velocity": VEL, "position": POS}
    offsets |= {block.name: block.offset for block in prepared_case.layout.parameters}
    roots = dict.fromkeys(Densities._fields, 0.0)
    for name in Densities._fields:
        if name in offsets:
            first = offsets[name]
            axis_mean = density[first : first + 3].mean()
            roots[name] = float(np.sqrt(axis_mean))
    return Densities(**roots)
