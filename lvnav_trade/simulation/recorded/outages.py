"""Outages in a recorded log: solutions are withheld from the filter, and its error at their end is assessed."""

import math
from typing import NamedTuple

import numpy as np

from lvnav_trade.kernels.transition import VEL
from lvnav_trade.quantities.records import Floats
from lvnav_trade.scenario.filter_models import filter_models
from lvnav_trade.simulation.montecarlo import first_run_errors
from lvnav_trade.simulation.preparation.prepare import PreparedCase

_MOTION = 6  # velocity and position


class Outage(NamedTuple):
    """Outage of the solutions, and the error of the filter at the last withheld solution.

    begin : s. First withheld solution.
    end : s. Last withheld solution.
    error : (6,) m/s, m. Velocity and position error relative to that solution, reporting axes.
    covariance : (6, 6) SI squared. Covariance of the error by the filter: of its estimate plus the solution's noise.
    has_failed : Whether the error is not finite or beyond the limit of the case.
    """

    begin: float
    end: float
    error: Floats
    covariance: Floats
    has_failed: bool

    @property
    def sigma(self) -> Floats:
        """One-sigma (6,) of the error."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def square(self) -> float:
        """Normalised squared error per degree of freedom: 1 on average for a consistent filter; NaN if it failed."""
        if self.has_failed:
            return math.nan
        weighted_error = np.linalg.solve(self.covariance, self.error)
        square = float(self.error @ weighted_error)
        return square / _MOTION

    @property
    def is_inside(self) -> bool:
        """Whether velocity and position errors are within three sigma, each by the norms of error and sigma."""
        blocks = (slice(0, 3), slice(3, 6))
        pairs = [(self.error[block], self.sigma[block]) for block in blocks]
        return not self.has_failed and all(
            np.linalg.norm(error) <= 3.0 * np.linalg.norm(sigma) for error, sigma in pairs
        )


def with_outage(prepared_case: PreparedCase, begin: float, end: float) -> PreparedCase:
    """Return a replayed case without solutions during an outage.

    Parameters
    ----------
    prepared_case
        Prepared case of a replay.
    begin, end
        s. First and last epoch without solutions, both included.
    """
    is_withheld = (prepared_case.t_epoch >= begin - 1e-9) & (prepared_case.t_epoch <= end + 1e-9)
    signals = prepared_case.signals
    n_used = np.where(is_withheld, 0, signals.n_used)
    remaining_signals = signals._replace(n_used=n_used)
    return prepared_case._replace(signals=remaining_signals)


def outage(prepared_case: PreparedCase, begin: float, length: float) -> Outage | None:
    """Return the effect of an outage on a replayed case; None if the log has no solution at its end.

    Parameters
    ----------
    prepared_case
        Prepared case of a replay.
    begin, length
        s. Start and length of the outage.
    """
    last_epoch = float(prepared_case.t_epoch[-1])
    interval = float(prepared_case.signals.interval)
    has_solution = prepared_case.signals.n_used > 0
    planned_end = begin + length
    is_before_end = prepared_case.t_epoch <= planned_end + 1e-9
    t_withheld = prepared_case.t_epoch[is_before_end & has_solution]
    end = float(t_withheld[-1]) if t_withheld.size else begin
    if end < planned_end - 0.5 * interval or planned_end > last_epoch + 1e-9:
        return None
    # the run ends at the history time nearest to the last withheld solution
    time_to_end = np.abs(prepared_case.t_hist - end)
    history_time = int(np.argmin(time_to_end))
    schedule = prepared_case.schedule
    last_window = np.flatnonzero(schedule.hist == history_time)[0]
    n_window = int(last_window) + 1
    cut_schedule = type(schedule)(*(array[:n_window] for array in schedule))
    truncated_case = with_outage(prepared_case, begin, end)._replace(schedule=cut_schedule)
    run_error, run_covariance, has_failed = first_run_errors(truncated_case, history_time)
    states = slice(VEL, VEL + _MOTION)
    error = run_error[states]
    is_finite = np.isfinite(error).all() and np.isfinite(run_covariance).all()
    P = run_covariance[states, states] + _noise(prepared_case, end)
    axes = np.kron(np.eye(2), prepared_case.record.axes[history_time])  # reporting axes of velocity and position
    covariance = axes @ P @ axes.T
    return Outage(
        begin=begin,
        end=end,
        error=error,
        covariance=covariance,
        has_failed=has_failed or not is_finite,
    )


def _noise(prepared_case: PreparedCase, t: float) -> Floats:
    """Return the noise covariance (6, 6) of a solution's velocity and position at an epoch, in the filter model.

    A filter that processes ranges uses the sigmas of its receiver model.
    """
    if prepared_case.scenario.filter.tight:
        _, model, _ = filter_models(prepared_case.scenario)
        velocity_variance = model.velocity_sigma**2
        position_variance = model.position_sigma**2
        return np.diag(np.repeat([velocity_variance, position_variance], 3))
    time_to_epochs = np.abs(prepared_case.t_epoch - t)
    epoch = int(np.argmin(time_to_epochs))
    position_and_velocity = prepared_case.signals.variance[epoch, :6]
    return np.diag(np.roll(position_and_velocity, 3))
