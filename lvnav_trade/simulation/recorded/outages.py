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
    """Return a replayed case without solutions from begin to end (s), bounds included."""
    withheld = (prepared.t_epoch >= begin - 1e-9) & (prepared.t_epoch <= end + 1e-9)
    signals = prepared.signals
    return prepared._replace(signals=signals._replace(n_used=np.where(withheld, 0, signals.n_used)))


def outage(prepared: Prepared, begin: float, length: float) -> Outage | None:
    """Return the effect of an outage of a given length (s) on a replayed case; None if the log has no solution at its
    end.
    """
    ends = prepared.t_epoch[(prepared.t_epoch <= begin + length + 1e-9) & (prepared.signals.n_used > 0)]
    end = float(ends[-1]) if ends.size else begin
    if end < begin + length - 0.5 * float(prepared.signals.interval) or begin + length > prepared.t_epoch[-1] + 1e-9:
        return None
    at = int(np.argmin(np.abs(prepared.t_hist - end)))
    schedule = prepared.schedule
    last = int(np.flatnonzero(schedule.hist == at)[0]) + 1
    cut = with_outage(prepared, begin, end)._replace(schedule=type(schedule)(*(part[:last] for part in schedule)))
    error, covariance, failed = end_of_run(cut, at)
    turn = prepared.record.axes[at]
    states = slice(VEL, VEL + _MOTION)
    turns = np.kron(np.eye(2), turn)
    failed = failed or not (np.isfinite(error[states]).all() and np.isfinite(covariance).all())
    P = covariance[states, states] + _noise(prepared, end)
    return Outage(begin, end, error[states], turns @ P @ turns.T, failed)


def _noise(prepared: Prepared, t: float) -> Floats:
    """Return the noise covariance (6, 6) of a solution's velocity and position at an epoch, in the filter model.

    A filter that processes ranges uses the sigmas of its receiver model.
    """
    if prepared.scenario.filter.tight:
        model = filter_models(prepared.scenario)[1]
        return np.diag(np.repeat([model.velocity_sigma**2, model.position_sigma**2], 3))
    return np.diag(np.roll(prepared.signals.variance[int(np.argmin(np.abs(prepared.t_epoch - t))), :6], 3))
