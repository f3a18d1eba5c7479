"""Outages in a recorded log: solutions are withheld from the filter, and its error at their end is assessed."""

import math
from typing import NamedTuple

import numpy as np

from lvnav_trade.kernels.transition import VEL
from lvnav_trade.quantities.records import Floats
from lvnav_trade.scenario.filter_models import filter_models
from lvnav_trade.simulation.montecarlo import end_of_run
from lvnav_trade.simulation.preparation.prepare import Prepared

_MOTION = 6  # velocity and position


class Outage(NamedTuple):
    """Outage of the solutions, and the error of the filter at the last withheld solution.

    begin : s. First withheld solution.
    end : s. Last withheld solution.
    error : (6,) m/s, m. Velocity and position error relative to that solution, reporting axes.
    covariance : (6, 6) SI squared. Covariance of the error by the filter: of its estimate plus the solution's noise.
    failed : Whether the error is not finite or beyond the limit of the case.
    """

    begin: float
    end: float
    error: Floats
    covariance: Floats
    failed: bool

    @property
    def sigma(self) -> Floats:
        """One-sigma (6,) of the error."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def square(self) -> float:
        """Normalised squared error per degree of freedom: 1 on average for a consistent filter; NaN if it failed."""
        if self.failed:
            return math.nan
        return float(self.error @ np.linalg.solve(self.covariance, self.error)) / _MOTION

    @property
    def inside(self) -> bool:
        """Whether velocity and position errors are within three sigma, each by the norms of error and sigma."""
        parts = [(self.error[at], self.sigma[at]) for at in (slice(0, 3), slice(3, 6))]
        return not self.failed and all(np.linalg.norm(error) <= 3.0 * np.linalg.norm(sigma) for error, sigma in parts)


def with_outage(prepared: Prepared, begin: float, end: float) -> Prepared:
    """Return a replayed case without solutions during an outage.

    Parameters
    ----------
    prepared
        Prepared case of a replay.
    begin, end
        s. First and last epoch without solutions, both included.
    """
    withheld = (prepared.t_epoch >= begin - 1e-9) & (prepared.t_epoch <= end + 1e-9)
    signals = prepared.signals
    return prepared._replace(signals=signals._replace(n_used=np.where(withheld, 0, signals.n_used)))


def outage(prepared: Prepared, begin: float, length: float) -> Outage | None:
    """Return the effect of an outage on a replayed case; None if the log has no solution at its end.

    Parameters
    ----------
    prepared
        Prepared case of a replay.
    begin, length
        s. Start and length of the outage.
    """
    last_epoch = float(prepared.t_epoch[-1])
    interval = float(prepared.signals.interval)
    has_solution = prepared.signals.n_used > 0
    t_withheld = prepared.t_epoch[(prepared.t_epoch <= begin + length + 1e-9) & has_solution]
    end = float(t_withheld[-1]) if t_withheld.size else begin
    if end < begin + length - 0.5 * interval or begin + length > last_epoch + 1e-9:
        return None
    # the run ends at the history time nearest to the last withheld solution
    history_time = int(np.argmin(np.abs(prepared.t_hist - end)))
    n_window = int(np.flatnonzero(prepared.schedule.hist == history_time)[0]) + 1
    schedule = type(prepared.schedule)(*(array[:n_window] for array in prepared.schedule))
    cut = with_outage(prepared, begin, end)._replace(schedule=schedule)
    error, covariance, failed = end_of_run(cut, history_time)
    states = slice(VEL, VEL + _MOTION)
    is_finite = np.isfinite(error[states]).all() and np.isfinite(covariance).all()
    P = covariance[states, states] + _noise(prepared, end)
    axes = np.kron(np.eye(2), prepared.record.axes[history_time])  # reporting axes of velocity and position
    return Outage(
        begin=begin,
        end=end,
        error=error[states],
        covariance=axes @ P @ axes.T,
        failed=failed or not is_finite,
    )


def _noise(prepared: Prepared, t: float) -> Floats:
    """Return the noise covariance (6, 6) of a solution's velocity and position at an epoch, in the filter model.

    A filter that processes ranges uses the sigmas of its receiver model.
    """
    if prepared.scenario.filter.tight:
        _, model, _ = filter_models(prepared.scenario)
        return np.diag(np.repeat([model.velocity_sigma**2, model.position_sigma**2], 3))
    epoch = int(np.argmin(np.abs(prepared.t_epoch - t)))
    position_and_velocity = prepared.signals.variance[epoch, :6]
    return np.diag(np.roll(position_and_velocity, 3))
