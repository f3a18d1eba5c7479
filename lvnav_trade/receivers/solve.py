"""What a receiver hands out at an epoch: its point solution, or that of its own filter."""

from __future__ import annotations

from lvnav_trade.kernels.jit import jit
from lvnav_trade.receivers.bancroft import solution
from lvnav_trade.receivers.ekf_gnss import step


@jit
def solve(rx, point, filtering, satellite, satellite_velocity, used, n_used, ranges):
    """Set solution and covariance of a receiver (Receiver, updated) at an epoch; return their quality.

    Parameters
    ----------
    point : PointModel; filtering : FilterModel, or None where the point solution itself is handed out
    satellite, satellite_velocity, used, n_used, ranges : as of `bancroft.fix`
    """
    if filtering is None:
        return solution(rx, point, satellite, satellite_velocity, used, n_used, ranges)
    return step(rx, filtering, point, satellite, satellite_velocity, used, n_used, ranges)
