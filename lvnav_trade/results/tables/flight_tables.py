"""Tables of the flight of a case: true trajectory, events, states with their covariance, satellites and channels."""

from typing import Any

import numpy as np

from lvnav_trade.gnss.faults import periods, singled_out
from lvnav_trade.quantities import frames
from lvnav_trade.quantities.records import IDLE, TRACKING, CovHistory, Floats
from lvnav_trade.results.tables.table_files import Coded
from lvnav_trade.simulation.preparation.prepare import Prepared

STEP = 5.0  # s between stored states, or the step of the history if that is longer; events are stored as well
SKY_STEP = 1.0  # s, shortest interval between stored satellite positions; figures do not resolve 10 Hz
_COMPONENTS = [f"{quantity} {axis}" for quantity in ("velocity", "position") for axis in "xyz"]
_CHANGE = ("t_s", "satellite", "from_state", "to_state", "reason")


def flight_columns(prepared: Prepared, cov: CovHistory) -> dict[str, Any]:
    """Return the columns or rows of the tables of the flight, by name of the table."""
    return {
        "reference": _reference(prepared),
        "events": event_rows(prepared),
        "satellites": _satellites(prepared),
        "transitions": [dict(zip(_CHANGE, change, strict=True)) for change in prepared.sky.transitions],
        **state_columns(prepared, cov),
    }


def _reference(prepared: Prepared) -> dict[str, Any]:
    """Return the true trajectory at the history times."""
    t, r_i, v_i, _, f_b, w_ib_b = prepared.motion
    theta = frames.earth_angle(prepared.trajectory.theta0, t)
    latitude, longitude, altitude = frames.geodetic_from_ecef(frames.ecef_from_eci(r_i, theta))
    return {
        "t_s": t,
        "latitude_rad": latitude,
        "longitude_rad": longitude,
        "altitude_m": altitude,
        "inertial_speed_m_per_s": np.linalg.norm(v_i, axis=1),
        "ground_speed_m_per_s": np.linalg.norm(frames.earth_velocity(r_i, v_i), axis=1),
        "specific_force_m_per_s2": np.linalg.norm(f_b, axis=1),
        "body_rate_rad_per_s": np.linalg.norm(w_ib_b, axis=1),
    }


def event_rows(prepared: Prepared) -> list[dict[str, Any]]:
    """Return events and faults, with their times and the satellites that a fault affects individually."""
    events = prepared.trajectory.events.items()
    rows = [{"event": name, "kind": "event", "t_s": t, "t_end_s": t, "satellites": ""} for name, t in events]
    course, sky, faults = prepared.trajectory.course, prepared.sky, prepared.scenario.faults
    affected = singled_out(faults, course, sky.t, tuple(sky.names), sky.elevation, sky.tracked)
    for number, fault in enumerate(faults, start=1):
        active = periods(number - 1, fault, course)
        for part, (start, end) in enumerate(active, start=1):
            name = f"{fault.kind} {number}" + (f".{part}" if len(active) > 1 else "")
            span = {"t_s": course.begin(start), "t_end_s": course.instants["end"] if end == np.inf else end}
            rows.append({"event": name, "kind": "fault", **span, "satellites": " ".join(affected[number - 1])})
    return rows


def _satellites(prepared: Prepared) -> dict[str, Any]:
    """Return the satellites above the horizon or with a channel; if there are none, the one of highest elevation.

    So every epoch has at least one row.
    """
    sky, delays = prepared.sky, prepared.delays
    step = max(1, round(SKY_STEP / float(np.median(np.diff(sky.t))))) if len(sky.t) > 1 else 1
    elevation, tracked = sky.elevation[::step], sky.tracked[::step]
    shown = (elevation > 0.0) | tracked | (sky.state[::step] != IDLE)
    bare = ~np.any(shown, axis=1)
    shown[bare, np.argmax(elevation[bare], axis=1)] = True
    row, column = np.nonzero(shown)

    def picked(values: Any) -> Any:
        return np.asarray(values)[::step][row, column]

    def measured(values: Any) -> Any:
        return np.where(tracked[row, column], picked(values), np.nan)

    troposphere, ionosphere = delays.troposphere[:, :, 0], delays.ionosphere[:, :, 0]
    return {
        "t_s": sky.t[::step][row],
        "satellite": Coded(sky.names, column),
        "system": Coded(sky.systems, column),
        "azimuth_rad": picked(sky.azimuth),
        "elevation_rad": picked(sky.elevation),
        "tracked": picked(sky.tracked),
        "state": Coded(TRACKING, picked(sky.state)),
        "antenna_number": picked(sky.antenna).astype(np.int64) + 1,
        "cn0_db_hz": picked(sky.cn0),
        "range_sigma_m": measured(sky.range_sigma),
        "rate_sigma_m_per_s": measured(sky.rate_sigma),
        "troposphere_m": measured(troposphere),
        "troposphere_left_m": measured(troposphere - delays.modelled_troposphere[:, :, 0]),
        "ionosphere_m": measured(ionosphere),
        "ionosphere_left_m": measured(ionosphere - delays.modelled_ionosphere[:, :, 0]),
        "latency_s": (prepared.t_epoch - sky.t)[::step][row],
    }


def state_columns(prepared: Prepared, cov: CovHistory) -> dict[str, dict[str, Any]]:
    """Return the columns of `states` and `joint_covariances`; empty if the outputs have no velocity and position."""
    outputs = list(enumerate(prepared.outputs))
    index = [k for quantity in ("velocity", "position") for k, output in outputs if output.quantity == quantity]
    if len(index) != 6:
        return {"states": {}, "joint_covariances": {}}
    rows = _rows(prepared, cov)
    at = [k for _, k in rows]
    # the true state is at the time of the event, its errors at the first sample at or after it, in the axes there
    t, r_i, v_i, axes = (part[at] for part in (*prepared.motion[:3], prepared.record.axes))
    theta = frames.earth_angle(prepared.trajectory.theta0, t)
    return {
        "states": _states([event for event, _ in rows], t, r_i, v_i, theta, axes),
        "joint_covariances": _joint(rows, t, cov, index, axes),
    }


def _rows(prepared: Prepared, cov: CovHistory) -> list[tuple[str, int]]:
    """Return name of the event (or empty) and index in the history of every stored state: events, then a grid."""
    first, last = float(cov.t[0]), float(cov.t[-1])
    wanted = [(name, t) for name, t in prepared.trajectory.events.items() if first <= t <= last]
    events = [(name, int(np.argmin(np.abs(cov.t - t)))) for name, t in wanted]
    near = {int(np.argmin(np.abs(cov.t - t))) for t in np.arange(0.0, last + 1e-6, STEP)}
    return [*events, *(("", k) for k in sorted(near))]


def _states(events: list[str], t: Floats, r_i: Floats, v_i: Floats, theta: Floats, axes: Floats) -> dict[str, Any]:
    turn = frames.quaternions(np.swapaxes(axes, 1, 2), continuous=False)  # the rows are not in order of time
    return {
        "event": events,
        "t_s": t,
        "earth_angle_rad": theta,
        **{f"position_{axis}_m": r_i[:, k] for k, axis in enumerate("xyz")},
        **{f"velocity_{axis}_m_per_s": v_i[:, k] for k, axis in enumerate("xyz")},
        **{f"axes_q{k}_ratio": turn[:, k] for k in range(4)},
    }


def _joint(rows: list[tuple[str, int]], t: Floats, cov: CovHistory, index: list[int], axes: Floats) -> dict[str, Any]:
    """Return mean and upper triangle of the covariances (6, 6), rotated from reporting axes to frame i."""
    where = [k for _, k in rows]
    turn = np.zeros((len(rows), 6, 6))
    turn[:, :3, :3] = turn[:, 3:, 3:] = np.swapaxes(axes, 1, 2)
    true, formal = (
        turn @ part[np.ix_(where, index, index)] @ np.swapaxes(turn, 1, 2) for part in (cov.true_cov, cov.formal_cov)
    )
    mean = np.einsum("nij,nj->ni", turn, cov.mean[np.ix_(where, index)])
    i, j = np.triu_indices(6)
    return {
        "event": Coded([event for event, _ in rows], np.repeat(np.arange(len(rows)), i.size)),
        "t_s": np.repeat(t, i.size),
        "component": Coded(_COMPONENTS, np.tile(i, len(rows))),
        "other_component": Coded(_COMPONENTS, np.tile(j, len(rows))),
        "true_si2": true[:, i, j].ravel(),
        "formal_si2": formal[:, i, j].ravel(),
        "mean_si": np.where(i == j, mean[:, i], np.nan).ravel(),
    }
