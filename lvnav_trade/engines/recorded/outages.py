"""Outages of a recorded log: solutions that are withheld from the filter, and its error when they end."""

import math
from typing import NamedTuple

import numpy as np

from lvnav_trade.engines.setup.prepare import Prepared
from lvnav_trade.engines.simulate.montecarlo import end_of_run
from lvnav_trade.filter_models import filter_models
from lvnav_trade.kernels.transition import VEL
from lvnav_trade.records import Floats

_MOTION = 6  # velocity and position


class Outage(NamedTuple):
    """A stretch without solutions, begin and end s: at its last solution, before the filter sees one again, the error
    (6,) of velocity and position in the reporting axes against the solution withheld, and its covariance (6, 6) by the
    filter: that of its estimate, and the noise that it assumes of a solution; failed: it is not finite, or beyond the
    case's limit.
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
        """Normalised square of the error per degree of freedom: one on average of a filter that knows its error; NaN
        where it failed.
        """
        if self.failed:
            return math.nan
        return float(self.error @ np.linalg.solve(self.covariance, self.error)) / _MOTION

    @property
    def inside(self) -> bool:
        """Whether velocity and position are within three sigma: each against the root of its trace."""
        parts = [(self.error[at], self.sigma[at]) for at in (slice(0, 3), slice(3, 6))]
        return not self.failed and all(np.linalg.norm(error) <= 3.0 * np.linalg.norm(sigma) for error, sigma in parts)


def with_outage(prepared: Prepared, begin: float, end: float) -> Prepared:
    """Return a replayed case that gets no solutions from begin to end (s), both with them."""
    gone = (prepared.t_epoch >= begin - 1e-9) & (prepared.t_epoch <= end + 1e-9)
    signals = prepared.signals
    return prepared._replace(signals=signals._replace(n_used=np.where(gone, 0, signals.n_used)))


def outage(prepared: Prepared, begin: float, length: float) -> Outage | None:
    """Return what an outage does to a replayed case; None where the log has no solution at its end."""
    ends = prepared.t_epoch[(prepared.t_epoch <= begin + length + 1e-9) & (prepared.signals.n_used > 0)]
    end = float(ends[-1]) if ends.size else begin
    if end < begin + length - 0.5 * float(prepared.signals.interval) or begin + length > prepared.t_epoch[-1] + 1e-9:
        return None
    at = int(np.argmin(np.abs(prepared.t_hist - end)))
    schedule = prepared.schedule
    last = int(np.flatnonzero(schedule.hist == at)[0]) + 1
    cut = with_outage(prepared, begin, end)._replace(schedule=type(schedule)(*(part[:last] for part in schedule)))
    error, covariance, failed = end_of_run(cut, at)
    turn, own = prepared.record.axes[at], slice(VEL, VEL + _MOTION)
    both = np.kron(np.eye(2), turn)
    failed = failed or not (np.isfinite(error[own]).all() and np.isfinite(covariance).all())
    return Outage(begin, end, error[own], both @ (covariance[own, own] + _noise(prepared, end)) @ both.T, failed)


def _noise(prepared: Prepared, t: float) -> Floats:
    """Return the covariance (6, 6) of velocity and position of the solution at an epoch, as the filter assumes it; one
    that takes ranges by its card alone.
    """
    if prepared.scenario.filter.tight:
        model = filter_models(prepared.scenario)[1]
        return np.diag(np.repeat([model.velocity_sigma**2, model.position_sigma**2], 3))
    return np.diag(np.roll(prepared.signals.variance[int(np.argmin(np.abs(prepared.t_epoch - t))), :6], 3))
