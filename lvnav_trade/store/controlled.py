"""The tables of a vehicle under control: nozzle movement, motion against envelopes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from lvnav_trade.steering.nozzle import Controlled

FEEDS, AXES, PHASES = ("raw", "filtered", "true"), ("pitch", "yaw"), ("burn", "coast", "change")
_TURNING = (
    "inside_turning_ratio", "inside_jerk_ratio", "furthest_turning_ratio", "furthest_jerk_ratio", "attitude_error_rad",
    "rate_error_rad_per_s", "rate_sigma_rad_per_s",
)  # fmt: skip
WHOLE = "flight"
"""What stands for all burns together."""


def controlled_tables(found: Controlled | None) -> dict[str, dict[str, Any]]:
    """Return the tables of a case; empty ones where it has no vehicle under control."""
    if found is None:
        return {name: {} for name in ("nozzle", "movement", "turning", "motion")}
    return {
        "nozzle": _nozzle(found),
        "movement": _movement(found),
        "turning": _turning(found),
        "motion": _motion(found),
    }


def _nozzle(found: Controlled) -> dict[str, Any]:
    names = [WHOLE] + [f"burn {number}" for number in range(1, found.total.shape[2])]
    index = np.indices(found.total.shape).reshape(4, -1)
    return {
        "feed": [FEEDS[i] for i in index[0]],
        "run_number": index[1],
        "burn": [names[i] for i in index[2]],
        "axis": [AXES[i] for i in index[3]],
        "moved_rad": found.total.ravel(),
    }


def _movement(found: Controlled) -> dict[str, Any]:
    index = np.indices(found.mean.shape).reshape(3, -1)
    return {
        "t_s": found.t[index[1]],
        "feed": [FEEDS[i] for i in index[0]],
        "axis": [AXES[i] for i in index[2]],
        "mean_rad": found.mean.ravel(),
        "low_rad": found.low.ravel(),
        "high_rad": found.high.ravel(),
    }


def _turning(found: Controlled) -> dict[str, Any]:
    there = np.argwhere(found.turning[..., 0] > 0.0)
    rows = found.turning[tuple(there.T)]
    return {
        "feed": [FEEDS[feed] for feed, _, _ in there],
        "axis": [AXES[axis] for _, axis, _ in there],
        "phase": [PHASES[phase] for _, _, phase in there],
        "tick_count": rows[:, 0].astype(np.int64),
        **{name: rows[:, column] for column, name in enumerate(_TURNING, start=1)},
    }


def _motion(found: Controlled) -> dict[str, Any]:
    n = found.shown_t.size
    return {
        "t_s": np.tile(found.shown_t, 2),
        "axis": [name for name in AXES for _ in range(n)],
        "turning_rad_per_s2": found.shown[:, :, 0].T.ravel(),
        "turning_bound_rad_per_s2": found.shown[:, :, 1].T.ravel(),
        "jerk_m_per_s3": found.shown[:, :, 2].T.ravel(),
        "jerk_bound_m_per_s3": found.shown[:, :, 3].T.ravel(),
    }
