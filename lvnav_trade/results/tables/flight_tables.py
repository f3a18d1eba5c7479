"""Tables of the flight of a case: true trajectory, events, states with their covariance, satellites and channels."""

from typing import Any, NamedTuple

import numpy as np

from lvnav_trade.gnss.faults import individual_satellites, periods
from lvnav_trade.quantities import frames
from lvnav_trade.quantities.records import IDLE, TRACKING, CovHistory, Floats
from lvnav_trade.results.tables.table_files import Coded
from lvnav_trade.simulation.preparation.prepare import PreparedCase

STEP = 5.0  # s between stored states, or the step of the history if that is longer; events are stored as well
SKY_STEP = 1.0  # s, shortest interval between stored satellite positions; figures do not resolve 10 Hz
_COMPONENTS = [f"{quantity} {axis}" for quantity in ("velocity", "position") for axis in "xyz"]


def flight_columns(prepared_case: PreparedCase, cov: CovHistory) -> dict[str, Any]:
    """Return the columns or rows of the tables of the flight, by name of the table."""
    return {
        "reference": _reference(prepared_case),
        "events": event_rows(prepared_case),
        "satellites": _satellites(prepared_case),
        "transitions": _transitions(prepared_case),
        **state_columns(prepared_case, cov),
    }


def _transitions(prepared_case: PreparedCase) -> list[dict[str, Any]]:
    """Return the changes of the state of a receiver channel."""
    columns = ("t_s", "satellite", "from_state", "to_state", "reason")
    return [dict(zip(columns, transition, strict=True)) for transition in prepared_case.sky.transitions]


def _reference(prepared_case: PreparedCase) -> dict[str, Any]:
    """Return the true trajectory at the history times."""
    t, r_i, v_i, _, f_b, w_ib_b = prepared_case.motion
    theta = frames.earth_angle(prepared_case.trajectory.theta0, t)
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


def event_rows(prepared_case: PreparedCase) -> list[dict[str, Any]]:
    """Return events and faults, with their times and the satellites that a fault affects individually."""
    rows: list[dict[str, Any]] = []
    for event, t in prepared_case.trajectory.events.items():
        rows.append(
            {
                "event": event,
                "kind": "event",
                "t_s": t,
                "t_end_s": t,
                "satellites": "",
            }
        )
    flight_profile = prepared_case.trajectory.flight_profile
    sky = prepared_case.sky
    faults = prepared_case.scenario.faults
    affected_satellites = individual_satellites(
        faults, flight_profile, sky.t, tuple(sky.names), sky.elevation, sky.is_tracked
    )
    for k, fault in enumerate(faults):
        fault_name = f"{fault.kind} {k + 1}"
        active = periods(k, fault, flight_profile)
        for period_number, (start, end) in enumerate(active, start=1):
            suffix = f".{period_number}" if len(active) > 1 else ""
            rows.append(
                {
                    "event": f"{fault_name}{suffix}",
                    "kind": "fault",
                    "t_s": flight_profile.begin(start),
                    "t_end_s": flight_profile.instants["end"] if end == np.inf else end,
                    "satellites": " ".join(affected_satellites[k]),
                }
            )
    return rows


def _satellites(prepared_case: PreparedCase) -> dict[str, Any]:
    """Return the satellites above the horizon or with a channel; if there are none, the highest satellite.

    So every epoch has at least one row.
    """
    sky = prepared_case.sky
    delays = prepared_case.atmospheric_delays
    step = 1  # every n-th epoch is stored
    if len(sky.t) > 1:
        interval = float(np.median(np.diff(sky.t)))
        step = max(1, round(SKY_STEP / interval))
    elevation = sky.elevation[::step]
    is_tracked = sky.is_tracked[::step]
    is_stored = (elevation > 0.0) | is_tracked | (sky.state[::step] != IDLE)
    is_empty = ~np.any(is_stored, axis=1)
    is_stored[is_empty, np.argmax(elevation[is_empty], axis=1)] = True
    epoch, satellite = np.nonzero(is_stored)

    def pick(values: Any) -> Any:
        """Return the values of stored satellites."""
        return np.asarray(values)[::step][epoch, satellite]

    def pick_tracked(values: Any) -> Any:
        """Return the values of stored satellites, NaN unless they are tracked."""
        return np.where(is_tracked[epoch, satellite], pick(values), np.nan)

    troposphere = delays.troposphere[:, :, 0]
    ionosphere = delays.ionosphere[:, :, 0]
    return {
        "t_s": sky.t[::step][epoch],
        "satellite": Coded(sky.names, satellite),
        "system": Coded(sky.systems, satellite),
        "azimuth_rad": pick(sky.azimuth),
        "elevation_rad": pick(sky.elevation),
        "tracked": pick(sky.is_tracked),
        "state": Coded(TRACKING, pick(sky.state)),
        "antenna_number": pick(sky.antenna).astype(np.int64) + 1,
        "cn0_db_hz": pick(sky.cn0),
        "range_sigma_m": pick_tracked(sky.range_sigma),
        "rate_sigma_m_per_s": pick_tracked(sky.rate_sigma),
        "troposphere_m": pick_tracked(troposphere),
        "troposphere_left_m": pick_tracked(troposphere - delays.modelled_troposphere[:, :, 0]),
        "ionosphere_m": pick_tracked(ionosphere),
        "ionosphere_left_m": pick_tracked(ionosphere - delays.modelled_ionosphere[:, :, 0]),
        "latency_s": (prepared_case.t_epoch - sky.t)[::step][epoch],
    }


class _StoredTimes(NamedTuple):
    """Times of the stored states.

    events : (n,). Name of the event; empty between events.
    indices : (n,). Index in the history.
    """

    events: list[str]
    indices: list[int]


def state_columns(prepared_case: PreparedCase, cov: CovHistory) -> dict[str, dict[str, Any]]:
    """Return the columns of `states` and `joint_covariances`; empty if the outputs have no velocity and position."""
    errors: list[int] = []  # outputs of the errors of velocity and position
    for quantity in ("velocity", "position"):
        errors += [k for k, output in enumerate(prepared_case.outputs) if output.quantity == quantity]
    if len(errors) != 6:
        return {"states": {}, "joint_covariances": {}}
    times = _stored_times(prepared_case, cov)
    # the true state is at the time of the event, its errors at the first sample at or after it, in the axes there
    motion = prepared_case.motion
    t = motion[0][times.indices]
    axes = prepared_case.record.axes[times.indices]
    return {
        "states": {
            "event": times.events,
            "t_s": t,
            "earth_angle_rad": frames.earth_angle(prepared_case.trajectory.theta0, t),
            **_state_components(motion[1][times.indices], motion[2][times.indices], axes),
        },
        "joint_covariances": _joint_covariances(times, t, cov, errors, axes),
    }


def _stored_times(prepared_case: PreparedCase, cov: CovHistory) -> _StoredTimes:
    """Return the times of the events, then those of a grid."""
    first = float(cov.t[0])
    last = float(cov.t[-1])
    events: list[str] = []
    indices: list[int] = []
    for event, t in prepared_case.trajectory.events.items():
        if first <= t <= last:
            events.append(event)
            indices.append(int(np.argmin(np.abs(cov.t - t))))
    grid_times = np.arange(0.0, last + 1e-6, STEP)
    grid = {int(np.argmin(np.abs(cov.t - t))) for t in grid_times}
    no_events = [""] * len(grid)
    return _StoredTimes(
        events=[*events, *no_events],
        indices=[*indices, *sorted(grid)],
    )


def _state_components(r_i: Floats, v_i: Floats, axes: Floats) -> dict[str, Any]:
    """Return the columns of true states.

    Parameters
    ----------
    r_i, v_i : (n, 3) array
        Position (m) and velocity (m/s), frame i.
    axes : (n, 3, 3) array
        Reporting axes of each state as rows, frame i.

    Returns
    -------
    dict of str to (n,) array
        Components of position and velocity, and the quaternion of the rotation from the reporting axes to frame i.
    """
    rotation_to_inertial = np.swapaxes(axes, 1, 2)
    turn = frames.quaternions(rotation_to_inertial, continuous=False)  # the rows are not in order of time
    content = {f"position_{axis}_m": r_i[:, k] for k, axis in enumerate("xyz")}
    content |= {f"velocity_{axis}_m_per_s": v_i[:, k] for k, axis in enumerate("xyz")}
    content |= {f"axes_q{k}_ratio": turn[:, k] for k in range(4)}
    return content


def _joint_covariances(
    times: _StoredTimes, t: Floats, cov: CovHistory, errors: list[int], axes: Floats
) -> dict[str, Any]:
    """Return mean and upper triangle of the covariances (6, 6), rotated from reporting axes to frame i.

    Parameters
    ----------
    times : _StoredTimes
        The n stored times: indices in the history, and events.
    t : (n,) array
        Times (s).
    cov : CovHistory
        Linear covariance.
    errors : list of int
        Indices of the six outputs of the errors of velocity and position.
    axes : (n, 3, 3) array
        Reporting axes at each time as rows, frame i.
    """
    n = len(times.indices)
    rotation_to_inertial = np.swapaxes(axes, 1, 2)
    turn = np.zeros((n, 6, 6))
    turn[:, :3, :3] = rotation_to_inertial
    turn[:, 3:, 3:] = rotation_to_inertial
    back = np.swapaxes(turn, 1, 2)
    block = np.ix_(times.indices, errors, errors)
    true = turn @ cov.true_cov[block] @ back
    formal = turn @ cov.formal_cov[block] @ back
    reporting_mean = cov.mean[np.ix_(times.indices, errors)]
    mean = np.einsum("nij,nj->ni", turn, reporting_mean)
    i, j = np.triu_indices(6)
    return {
        "event": Coded(times.events, np.repeat(np.arange(n), i.size)),
        "t_s": np.repeat(t, i.size),
        "component": Coded(_COMPONENTS, np.tile(i, n)),
        "other_component": Coded(_COMPONENTS, np.tile(j, n)),
        "true_si2": true[:, i, j].ravel(),
        "formal_si2": formal[:, i, j].ravel(),
        "mean_si": np.where(i == j, mean[:, i], np.nan).ravel(),
    }
