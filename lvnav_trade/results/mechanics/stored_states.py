"""True states of a case, their error Gaussians by linear covariance and the errors of the runs, from stored results."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from lvnav_trade.quantities import frames
from lvnav_trade.quantities.records import Bools, Floats
from lvnav_trade.results.tables.read import Tables, cache_result, pick


class State(NamedTuple):
    """True state at an event or time.

    event : Name of the event; empty between events.
    t : Time (s).
    r_i : (3,), m. Position, frame i.
    v_i : (3,), m/s. Velocity, frame i.
    earth_angle : rad. Angle from the inertial to the Earth-fixed x axis.
    turn : (3, 3). Rotation from the reporting axes to frame i.
    """

    event: str
    t: float
    r_i: Floats
    v_i: Floats
    earth_angle: float
    turn: Floats


class ErrorGaussian(NamedTuple):
    """Gaussian of the error of velocity and position by linear covariance, frame i, SI.

    mean : (6,). Mean of the true error.
    true : (6, 6). Covariance of the true error.
    formal : (6, 6). Covariance assumed by the filter.
    """

    mean: Floats
    true: Floats
    formal: Floats


@cache_result
def states(tables: Tables, case: str) -> list[State]:
    """Return the stored true states of a case, in stored order.

    States at events have a name; states in between have none.
    """
    rows = pick(tables.states, case=case)
    r_i = rows.filter(regex=r"^position_._m$").to_numpy()
    v_i = rows.filter(regex=r"^velocity_._m_per_s$").to_numpy()
    turns = frames.matrices(rows.filter(regex=r"^axes_q").to_numpy())
    columns = zip(rows.event, rows.t_s, r_i, v_i, rows.earth_angle_rad, turns, strict=True)
    return [
        State(
            event=event,
            t=t,
            r_i=position,
            v_i=velocity,
            earth_angle=earth_angle,
            turn=turn,
        )
        for event, t, position, velocity, earth_angle, turn in columns
    ]


def state_at(tables: Tables, case: str, event: str) -> State | None:
    """Return the true state at an event; None if it is not stored.

    Parameters
    ----------
    tables : Tables
        Tables of the results.
    case : str
        Digest of the case.
    event : str
        Name of the event.
    """
    if not event:
        return None
    for state in states(tables, case):
        if state.event == event:
            return state
    return None


@cache_result
def laws(tables: Tables, case: str) -> list[ErrorGaussian]:
    """Return the Gaussian of velocity and position by linear covariance at each of `states`."""
    rows = pick(tables.joint_covariances, case=case)
    return error_gaussians(
        mean=rows.mean_si.to_numpy(dtype=float),
        true=rows.true_si2.to_numpy(dtype=float),
        formal=rows.formal_si2.to_numpy(dtype=float),
    )


def error_gaussians(mean: Floats, true: Floats, formal: Floats) -> list[ErrorGaussian]:
    """Return the Gaussians stored in columns of length 21 n_state.

    Parameters
    ----------
    mean : (21 n_state,) array
        Mean errors, stored on the diagonals of the upper triangles.
    true, formal : (21 n_state,) array
        Upper triangles, row by row, of the covariances (6, 6) of the true error and assumed by the filter.

    Returns
    -------
    list of ErrorGaussian
        Gaussian of velocity and position at each state, frame i, SI.
    """
    n = len(mean) // 21
    i, j = np.triu_indices(6)
    means = mean.reshape(n, 21)[:, i == j]
    true_covariances = _symmetric_matrices(true)
    formal_covariances = _symmetric_matrices(formal)
    return [
        ErrorGaussian(
            mean=means[k],
            true=true_covariances[k],
            formal=formal_covariances[k],
        )
        for k in range(n)
    ]


def _symmetric_matrices(column: Floats) -> Floats:
    """Return the symmetric matrices (n, 6, 6) whose upper triangles are stored row by row in a column (21 n,)."""
    triangles = column.reshape(-1, 21)
    i, j = np.triu_indices(6)
    matrices = np.zeros((len(triangles), 6, 6))
    matrices[:, i, j] = triangles
    matrices[:, j, i] = triangles
    return matrices


def law_at(tables: Tables, case: str, event: str) -> ErrorGaussian:
    """Return the Gaussian of velocity and position by linear covariance at an event with a stored state.

    Parameters
    ----------
    tables : Tables
        Tables of the results.
    case : str
        Digest of the case.
    event : str
        Name of an event with a stored state.
    """
    events = [state.event for state in states(tables, case)]
    return laws(tables, case)[events.index(event)]


def run_errors(tables: Tables, case: str, state: State) -> tuple[Floats, Bools]:
    """Return errors of velocity and position at the event of a state, and which runs failed.

    Parameters
    ----------
    tables : Tables
        Tables of the results.
    case : str
        Digest of the case.
    state : State
        True state at an event.

    Returns
    -------
    (n_run, 6) array, (n_run,) array of bool
        Errors of velocity (m/s) and position (m), frame i; whether each run failed.
    """
    rows = pick(tables.runs, case=case, event=state.event)
    outputs = pick(tables.outputs, case=case)
    axes = outputs[outputs.axis != "3d"]

    def components(quantity: str, suffix: str) -> Floats:
        """Return the errors (n_run, 3) of a quantity in the reporting axes."""
        columns = [f"{quantity}_{axis}_error_{suffix}" for axis in axes.axis[axes.quantity == quantity]]
        return np.asarray(rows[columns].to_numpy(dtype=float))

    has_failed = rows.failure.to_numpy() != ""
    return inertial_errors(state, components("velocity", "m_per_s"), components("position", "m"), has_failed)


def inertial_errors(state: State, velocity: Floats, position: Floats, has_failed: Bools) -> tuple[Floats, Bools]:
    """Return state errors in frame i, and which runs failed.

    Parameters
    ----------
    state : State
        True state, with the rotation from the reporting axes to frame i.
    velocity, position : (n_run, 3) array
        Errors (m/s and m) in the reporting axes.
    has_failed : (n_run,) array of bool
        Failed runs.

    Returns
    -------
    (n_run, 6) array, (n_run,) array of bool
        Errors of velocity (m/s) and position (m), frame i; failed runs, including those whose error is not finite.
    """
    velocity_i = velocity @ state.turn.T
    position_i = position @ state.turn.T
    error = np.concatenate([velocity_i, position_i], axis=1)
    return error, has_failed | ~np.isfinite(error).all(axis=1)


def good_errors(tables: Tables, case: str, state: State) -> Floats:
    """Return `run_errors` of the runs that did not fail, (n_good, 6).

    Parameters
    ----------
    tables : Tables
        Tables of the results.
    case : str
        Digest of the case.
    state : State
        True state at an event.
    """
    error, has_failed = run_errors(tables, case, state)
    return error[~has_failed]
