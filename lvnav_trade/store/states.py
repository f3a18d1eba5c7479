"""The tables from which orbits and points of impact are computed: true states, covariances of velocity and position."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from lvnav_trade import frames
from lvnav_trade.engines.setup.prepare import reporting_axes
from lvnav_trade.records import CovHistory, Floats
from lvnav_trade.store.schema import TABLES

if TYPE_CHECKING:
    from lvnav_trade.engines.setup.prepare import Prepared

STEP = 5.0
"""Seconds between the stored states, or the step of the history where that is longer; events are stored too."""
_COMPONENTS = tuple((quantity, axis) for quantity in ("velocity", "position") for axis in "xyz")


def state_tables(prepared: Prepared, cov: CovHistory) -> dict[str, dict[str, Any]]:
    """Return the columns of `states` and `joint`; no rows where the outputs have no velocity and position."""
    index = _columns(prepared)
    if index is None:
        names = {table: [c.name for c in TABLES[table] if c.name != "case"] for table in ("states", "joint")}
        return {table: {name: [] for name in columns} for table, columns in names.items()}
    rows = _rows(prepared, cov)
    reference = prepared.reference
    at = np.searchsorted(0.5 * (reference.t[1:] + reference.t[:-1]), cov.t[[k for _, k in rows]])
    r_i, v_i, t = reference.r_i[at], reference.v_i[at], reference.t[at]
    theta0 = prepared.trajectory.theta0
    axes = reporting_axes(prepared.scenario.frame, t, r_i, v_i, theta0)
    return {
        "states": _states([event for event, _ in rows], t, r_i, v_i, frames.earth_angle(theta0, t), axes),
        "joint": _joint(rows, t, cov, index, axes),
    }


def _columns(prepared: Prepared) -> list[int] | None:
    """Return the columns of velocity and position, three each; None where there are no such."""
    outputs = prepared.outputs
    found = [k for quantity in ("velocity", "position") for k, o in enumerate(outputs) if o.quantity == quantity]
    return found if len(found) == 6 else None


def _rows(prepared: Prepared, cov: CovHistory) -> list[tuple[str, int]]:
    """Return (event, or empty; index into the history) of every stored state: events first, then a coarse grid."""
    first, last = float(cov.t[0]), float(cov.t[-1])
    events = [
        (name, int(np.argmin(np.abs(cov.t - t))))
        for name, t in prepared.trajectory.events.items()
        if first <= t <= last
    ]
    grid = np.arange(0.0, last + 1e-6, STEP)
    near = {int(np.argmin(np.abs(cov.t - t))) for t in grid}
    return [*events, *(("", k) for k in sorted(near))]


def _states(events: list[str], t: Floats, r_i: Floats, v_i: Floats, theta: Floats, axes: Floats) -> dict[str, Any]:
    turn = _quaternions(np.swapaxes(axes, 1, 2))
    return {
        "event": events,
        "t_s": t,
        "earth_angle_rad": theta,
        **{f"position_{axis}_m": r_i[:, k] for k, axis in enumerate("xyz")},
        **{f"velocity_{axis}_m_per_s": v_i[:, k] for k, axis in enumerate("xyz")},
        **{f"axes_q{k}_ratio": turn[:, k] for k in range(4)},
    }


def _quaternions(C: Floats) -> Floats:
    """Return the quaternion of each matrix by itself: the rows are not in the order of time."""
    return np.concatenate([frames.quaternions(C[k : k + 1]) for k in range(len(C))])


def _joint(rows: list[tuple[str, int]], t: Floats, cov: CovHistory, index: list[int], axes: Floats) -> dict[str, Any]:
    """List mean and upper triangle of the covariances (6, 6), turned to frame i."""
    where = [k for _, k in rows]
    turn = np.zeros((len(rows), 6, 6))
    turn[:, :3, :3] = turn[:, 3:, 3:] = np.swapaxes(axes, 1, 2)
    true, formal = (
        turn @ part[np.ix_(where, index, index)] @ np.swapaxes(turn, 1, 2) for part in (cov.true_cov, cov.formal_cov)
    )
    mean = np.einsum("nij,nj->ni", turn, cov.mean[np.ix_(where, index)])
    i, j = np.triu_indices(6)
    n = len(rows)
    return {
        "event": np.repeat([event for event, _ in rows], i.size),
        "t_s": np.repeat(t, i.size),
        "component": [" ".join(_COMPONENTS[k]) for k in i] * n,
        "other_component": [" ".join(_COMPONENTS[k]) for k in j] * n,
        "true_si2": true[:, i, j].ravel(),
        "formal_si2": formal[:, i, j].ravel(),
        "mean_si": np.where(i == j, mean[:, i], np.nan).ravel(),
    }
