"""Tables of a vehicle under attitude control: travel of the nozzle, motion against the envelope."""

from typing import Any

import numpy as np

from lvnav_trade.simulation.nozzle import AXES, FEEDS, PHASES, NozzleStatistics

# Columns of the statistics of motion after the number of ticks, in the order of `NozzleStatistics.turning`
_TURNING = (
    "angular_acceleration_inside_ratio",
    "jerk_inside_ratio",
    "angular_acceleration_peak_ratio",
    "jerk_peak_ratio",
    "attitude_error_rad",
    "rate_error_rad_per_s",
    "rate_sigma_rad_per_s",
)
# Columns of the history of motion, in the order of `NozzleStatistics.bin_motion`
_MOTION = (
    "angular_acceleration_rad_per_s2",
    "angular_acceleration_envelope_rad_per_s2",
    "jerk_m_per_s3",
    "jerk_envelope_m_per_s3",
)
WHOLE = "flight"  # all burns together


def controlled_columns(nozzle: NozzleStatistics) -> dict[str, dict[str, Any]]:
    """Return the columns of `nozzle_travel`, `nozzle_travel_history`, `motion_statistics`, `motion_history`."""
    return {
        "nozzle_travel": _travel(nozzle),
        "nozzle_travel_history": _travel_history(nozzle),
        "motion_statistics": _motion_statistics(nozzle),
        "motion_history": _motion_history(nozzle),
    }


def _travel(nozzle: NozzleStatistics) -> dict[str, Any]:
    feed, run, burn, axis = np.indices(nozzle.total.shape).reshape(4, -1)
    n_burn = nozzle.total.shape[2] - 1
    burn_names = [f"burn {number}" for number in range(1, n_burn + 1)]
    burns = np.array([WHOLE, *burn_names])
    return {
        "controller_rate": np.array(FEEDS)[feed],
        "run_number": run,
        "burn": burns[burn],
        "axis": np.array(AXES)[axis],
        "travel_rad": nozzle.total.ravel(),
    }


def _travel_history(nozzle: NozzleStatistics) -> dict[str, Any]:
    feed, time, axis = np.indices(nozzle.mean.shape).reshape(3, -1)
    return {
        "t_s": nozzle.t[time],
        "controller_rate": np.array(FEEDS)[feed],
        "axis": np.array(AXES)[axis],
        "mean_rad": nozzle.mean.ravel(),
        "minimum_rad": nozzle.low.ravel(),
        "maximum_rad": nozzle.high.ravel(),
    }


def _motion_statistics(nozzle: NozzleStatistics) -> dict[str, Any]:
    tick_counts = nozzle.turning[..., 0]
    feed, axis, phase = np.nonzero(tick_counts > 0.0)
    content = {
        "controller_rate": np.array(FEEDS)[feed],
        "axis": np.array(AXES)[axis],
        "phase": np.array(PHASES)[phase],
        "tick_count": tick_counts[feed, axis, phase].astype(np.int64),
    }
    for k, name in enumerate(_TURNING, start=1):
        content[name] = nozzle.turning[feed, axis, phase, k]
    return content


def _motion_history(nozzle: NozzleStatistics) -> dict[str, Any]:
    axis, time = np.indices((2, nozzle.bin_time.size)).reshape(2, -1)
    content = {
        "t_s": nozzle.bin_time[time],
        "axis": np.array(AXES)[axis],
    }
    for k, name in enumerate(_MOTION):
        content[name] = nozzle.bin_motion[time, axis, k]
    return content
