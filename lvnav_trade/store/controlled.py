"""The tables of a vehicle under control: nozzle movement, motion against envelopes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from lvnav_trade.steering.nozzle import Controlled

FEEDS, AXES, PHASES = np.array(["raw", "filtered", "true"]), np.array(["pitch", "yaw"]), ("burn", "coast", "change")
_TURNING = (
    "inside_turning_ratio", "inside_jerk_ratio", "furthest_turning_ratio", "furthest_jerk_ratio", "attitude_error_rad",
    "rate_error_rad_per_s", "rate_sigma_rad_per_s",
)  # fmt: skip
_MOTION = ("turning_rad_per_s2", "turning_bound_rad_per_s2", "jerk_m_per_s3", "jerk_bound_m_per_s3")
WHOLE = "flight"
"""What stands for all burns together."""


def controlled_columns(found: Controlled) -> dict[str, dict[str, Any]]:
    """Return the columns of `nozzle`, `movement`, `turning` and `motion`."""
    burns = np.array([WHOLE] + [f"burn {number}" for number in range(1, found.total.shape[2])])
    feed, run, burn, axis = np.indices(found.total.shape).reshape(4, -1)
    nozzle = {
        "feed": FEEDS[feed],
        "run_number": run,
        "burn": burns[burn],
        "axis": AXES[axis],
        "moved_rad": found.total.ravel(),
    }
    feed, time, axis = np.indices(found.mean.shape).reshape(3, -1)
    sizes = {"mean_rad": found.mean, "low_rad": found.low, "high_rad": found.high}
    movement = {"t_s": found.t[time], "feed": FEEDS[feed], "axis": AXES[axis]}
    movement |= {name: values.ravel() for name, values in sizes.items()}
    feed, axis, phase = np.nonzero(found.turning[..., 0] > 0.0)
    ticks, *ratios = found.turning[feed, axis, phase].T
    turning = {"feed": FEEDS[feed], "axis": AXES[axis], "phase": np.array(PHASES)[phase]}
    turning |= {"tick_count": ticks.astype(np.int64), **dict(zip(_TURNING, ratios, strict=True))}
    axis, time = np.indices((2, found.shown_t.size)).reshape(2, -1)
    motion = {"t_s": found.shown_t[time], "axis": AXES[axis]}
    motion |= dict(zip(_MOTION, found.shown[time, axis].T, strict=True))
    return {"nozzle": nozzle, "movement": movement, "turning": turning, "motion": motion}
