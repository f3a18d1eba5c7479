"""A tightly coupled filter written apart, in numpy and scipy, that knows nothing but the files of reference vectors.

Strapdown in an inertial frame, gravitation as the gradient of a potential, transition by differences of the strapdown,
Kalman update scalar by scalar in its textbook form. Truth minus estimate; attitude error in the inertial frame.
"""

from __future__ import annotations

import io
from typing import NamedTuple

import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation

from lvnav_trade.kernels.earth import GM, J2, J3, J4, SEMI_MAJOR

QUATERNION = [f"quaternion_{part}" for part in "wxyz"]
VELOCITY = [f"velocity_{axis}_m_per_s" for axis in "xyz"]
POSITION = [f"position_{axis}_m" for axis in "xyz"]
BIASES = [f"gyro_bias_{axis}_rad_per_s" for axis in "xyz"] + [f"accel_bias_{axis}_m_per_s2" for axis in "xyz"]
CLOCK = ["clock_bias_time_m", "clock_drift_rate_m_per_s"]
N_STATE = 17


class State(NamedTuple):
    """Estimates, the last axis that of the components: attitude b to i, velocity, position, biases, clock."""

    C: Rotation
    v: np.ndarray
    r: np.ndarray
    bias: np.ndarray
    clock: np.ndarray


def tables_of(files: dict[str, bytes | str]) -> dict[str, pd.DataFrame]:
    """Read the CSV tables among files."""
    return {
        name.removesuffix(".csv"): pd.read_csv(io.StringIO(str(text)), keep_default_na=True)
        for name, text in files.items()
        if name.endswith(".csv")
    }


def state_of(row: pd.Series) -> State:
    """Return the estimates of a row of the table estimates."""
    x, y, z = (row[f"quaternion_{axis}"] for axis in "xyz")
    numbers = [row[names].to_numpy(float) for names in (VELOCITY, POSITION, BIASES, CLOCK)]
    return State(Rotation.from_quat([x, y, z, row.quaternion_w]), *numbers)


def covariance_of(table: pd.DataFrame, stage: str, epoch: int) -> np.ndarray:
    """Return a covariance (n, n) of the table covariance."""
    rows = table[(table.stage == stage) & (table.epoch == epoch)]
    return rows.drop(columns=["stage", "epoch", "t_s", "state"]).to_numpy(float)


def gravitation(r: np.ndarray) -> np.ndarray:
    """Return the gradient (n, 3) of the potential with J2, J3 and J4 at (n, 3), by central differences."""

    def potential(r: np.ndarray) -> np.ndarray:
        size = np.linalg.norm(r, axis=-1)
        s, q = r[..., 2] / size, SEMI_MAJOR / size
        zonal = J2 * q**2 * (1.5 * s**2 - 0.5) + J3 * q**3 * (2.5 * s**3 - 1.5 * s)
        zonal = zonal + J4 * q**4 * (4.375 * s**4 - 3.75 * s**2 + 0.375)
        return GM / size * zonal

    step = 100.0 * np.eye(3)
    off = [(potential(r + h) - potential(r - h)) / 200.0 for h in step]
    return -GM * r / np.linalg.norm(r, axis=-1, keepdims=True) ** 3 - np.stack(off, axis=-1)


def moved(state: State, imu: np.ndarray, dt: float) -> State:
    """Propagate states (one or several in parallel) by the samples (n, 6) of an IMU."""
    C, v, r = state.C, state.v, state.r
    for sample in imu:
        angle, dv = sample[:3] - state.bias[..., :3] * dt, sample[3:] - state.bias[..., 3:] * dt
        middle = r + 0.5 * dt * v
        gained = C.apply(dv + 0.5 * np.cross(angle, dv)) + dt * gravitation(middle)
        r, v, C = r + dt * (v + 0.5 * gained), v + gained, C * Rotation.from_rotvec(angle)
    clock = state.clock + np.stack([len(imu) * dt * state.clock[..., 1], np.zeros_like(state.clock[..., 1])], axis=-1)
    return State(C, v, r, state.bias, clock)


def corrected(state: State, x: np.ndarray) -> State:
    """Add error states (17,), or several in parallel, to an estimate."""
    C = Rotation.from_rotvec(x[..., :3]) * state.C
    parts = [x[..., 3:6], x[..., 6:9], x[..., 9:15], x[..., 15:17]]
    return State(C, *(part + one for part, one in zip(state[1:], parts, strict=True)))


def error(true: State, estimate: State) -> np.ndarray:
    """Return truth minus estimate as error states (n, 17)."""
    attitude = (true.C * estimate.C.inv()).as_rotvec()
    return np.hstack([attitude, *(a - b for a, b in zip(true[1:], estimate[1:], strict=True))])


def transition(state: State, imu: np.ndarray, dt: float) -> tuple[State, np.ndarray]:
    """Return the state after some samples, and the transition (17, 17) of its errors by central differences."""
    sizes = np.repeat([1e-5, 1e-3, 10.0, 1e-7, 1e-4, 1.0], [3, 3, 3, 3, 3, 2])
    end = moved(state, imu, dt)
    up, down = (error(moved(corrected(state, sign * np.diag(sizes)), imu, dt), end) for sign in (1.0, -1.0))
    return end, (0.5 * (up - down) / sizes[:, None]).T


def row_of(
    state: State, rate: np.ndarray, lever: np.ndarray, satellite: pd.Series, is_rate: bool
) -> tuple[float, np.ndarray]:
    """Return the predicted range or range rate, and its Jacobian row (17,).

    rate (3,) rad/s of the body, corrected, body axes; lever (3,) m from the IMU to the antenna, body axes
    """
    place, velocity = (satellite[names].to_numpy(float) for names in (POSITION, VELOCITY))
    arm, swing = state.C.apply(lever), state.C.apply(np.cross(rate, lever))
    away, moving = state.r + arm - place, state.v + swing - velocity
    distance = np.linalg.norm(away)
    u, h = away / distance, np.zeros(N_STATE)
    if is_rate:
        across = (moving - u * (u @ moving)) / distance
        h[:3], h[3:6], h[6:9] = np.cross(swing, u) + np.cross(arm, across), u, across
        h[9:12], h[16] = np.cross(state.C.inv().apply(u), lever), 1.0
        return u @ moving + state.clock[1], h
    h[:3], h[6:9], h[15] = np.cross(arm, u), u, 1.0
    return distance + state.clock[0], h


def updated(
    state: State, P: np.ndarray, rate: np.ndarray, tables: dict[str, pd.DataFrame], epoch: int
) -> tuple[State, np.ndarray, np.ndarray]:
    """Return estimate, covariance (17, 17) and normalised innovations after the measurements of an epoch.

    rate (3,) rad/s of the body, corrected, body axes
    """
    x, ratios = np.zeros(N_STATE), []
    of_epoch = {name: tables[name][tables[name].epoch == epoch] for name in ("measurements", "satellites")}
    by_name = of_epoch["satellites"].set_index("satellite")
    antennas = tables["antennas"].set_index("antenna")
    for one in of_epoch["measurements"].itertuples():
        satellite = by_name.loc[one.satellite]
        lever = antennas.loc[satellite.antenna].to_numpy(float).copy()
        predicted, h = row_of(state, rate, lever, satellite, one.unit == "m/s")
        innovation, variance = one.measured_si - predicted - h @ x, h @ P @ h + one.variance_si
        gain = P @ h / variance
        x, P = x + gain * innovation, P - np.outer(gain, h @ P)
        ratios.append(innovation / np.sqrt(variance))
    return corrected(state, x), P, np.array(ratios)
