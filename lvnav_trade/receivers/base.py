"""What receivers that solve for position and velocity work with: settings in numbers, and the arrays of a run.

A solution is position, velocity, clock bias and drift in frame i from pseudoranges and range rates of satellites given
at transmission. What is not measured in a run is not-a-number there; what is not known has quality zero.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from scipy.special import chdtri

from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.lanes import zeros_of
from lvnav_trade.observables.base import N_ENTRY
from lvnav_trade.records import Floats, Ints

# Where a point solution stands.
FIX_POS, FIX_VEL, FIX_BIAS, FIX_DRIFT, N_FIX = 0, 3, 6, 7, 8

# What a quality number says of a point solution, and of a filtered one: the more the better.
NO_FIX, INCONSISTENT, UNTESTED, CONSISTENT = 0.0, 1.0, 2.0, 3.0
PROPAGATED, PARTIAL, FULL = 1.0, 2.0, 3.0

# States of the receiver's filter: acceleration stands where the common kernels have attitude.
ACC, VEL, POS, BIAS, DRIFT, N_STATE = 0, 3, 6, 9, 10, 11

# What the filter remembers beside its state and covariance.
STARTED, IDLE, MISSES, SINCE, LAST_VELOCITY, ACCELERATION, N_MEMORY = 0, 1, 2, 3, 4, 7, 10


class ReportedCovariance(NamedTuple):
    """The covariance that goes out with a solution: the solver's own (times a factor, with or without its
    correlations), or two constant variances (m^2, m^2/s^2) per axis.
    """

    own: bool = True
    correlated: bool = True
    factor: float = 1.0
    position_variance: float = 0.0
    velocity_variance: float = 0.0


class PointModel(NamedTuple):
    """Settings of the point solution: Newton steps after the closed form; limits (n,) of the sum of squared normalised
    residuals by number of satellites; variances that the receiver assumes (m^2, m^2/s^2); least quality that is output.
    """

    refinements: int
    limits: Floats
    range_variance: float
    rate_variance: float
    least_quality: float
    reported: ReportedCovariance


class ReceiverFilter(NamedTuple):
    """Settings of the receiver's filter over its interval (s).

    blocks (n_block, 9) of Phi at rows, columns (n_block,); ones, zeros (11,); decay, to_velocity, to_position: how
    acceleration acts; drive (3,): how the driving noise enters acceleration, velocity, position; its variance per axis
    is the larger of a floor and gain x acceleration^2; range and rate variances are the larger of a floor and gain x
    size of acceleration; clock: variance of the drift's derivative; start: variance of acceleration at the start;
    gate_squared, range_limit (m), rate_limit (m/s) of innovations; restart: epochs of mostly rejected rows; coast: s.
    """

    interval: float
    blocks: Floats
    rows: Ints
    columns: Ints
    ones: Floats
    zeros: Floats
    decay: float
    to_velocity: float
    to_position: float
    drive: Floats
    drive_floor: float
    drive_gain: float
    clock: float
    range_floor: float
    range_gain: float
    rate_floor: float
    rate_gain: float
    start: float
    gate_squared: float
    range_limit: float
    rate_limit: float
    restart: float
    coast: float
    reported: ReportedCovariance


class Solver(NamedTuple):
    """How a receiver makes a solution of its measurements: the point solution, the filter behind it, and the carrier
    smoothing in front of both (or None).
    """

    point: PointModel
    filter: Any = None
    smoothing: Any = None


class Receiver(NamedTuple):
    """Arrays of a receiver in a run, or lane views of eight; see `new_receiver`.

    near (3,) m where the point solution is looked for; fix (8,) the point solution; inverse (4, 4) of its normal
    matrix; verdict (2,) its quality and number of satellites; nav (11,), P (11, 11) state and covariance of the filter;
    innovation (2 n_sat,) normalised, by satellite (range and range rate in turn), not-a-number where there is none;
    average (n_sat,) m of code minus carrier, by satellite; memory (10,); used (2,) quality of the filtered solution and
    rows accepted; solution (6,) position and velocity output, not-a-number where there is none, covariance (6, 6)
    reported with it; the rest is work.
    """

    near: Floats
    fix: Floats
    inverse: Floats
    normal: Floats
    sides: Floats
    verdict: Floats
    nav: Floats
    P: Floats
    x: Floats
    K: Floats
    h: Floats
    at: Floats
    memory: Floats
    used: Floats
    solution: Floats
    covariance: Floats
    innovation: Floats
    average: Floats


def new_receiver(lanes: int = 0, n_sat: int = 64) -> Receiver:
    """Return the arrays of a receiver that is switched off: one run, or `lanes` runs on the last axis."""
    n = N_STATE
    shapes = {
        "near": (3,), "fix": (N_FIX,), "inverse": (4, 4), "normal": (4, 4), "sides": (2, 4), "verdict": (2,),
        "nav": (n,), "P": (n, n), "x": (n,), "K": (n,), "h": (N_ENTRY,), "at": (21,), "memory": (N_MEMORY,),
        "used": (2,), "solution": (6,), "covariance": (6, 6), "innovation": (2 * n_sat,),
        "average": (n_sat,),
    }  # fmt: skip
    return Receiver(**zeros_of(shapes, lanes))


@jit
def switch_on(rx: Any, x: Any, y: Any, z: Any) -> None:
    """Bring a receiver to its state before the first epoch; it looks for its first fix near (x, y, z), frame i (m)."""
    zero = 0.0 * x
    rx.near[0], rx.near[1], rx.near[2] = x, y, z
    for i in range(N_STATE):
        rx.nav[i] = zero
        for j in range(N_STATE):
            rx.P[i, j] = zero
    for i in range(N_MEMORY):
        rx.memory[i] = zero
    rx.memory[SINCE] = zero - 1.0
    for s in range(rx.average.shape[0]):
        rx.average[s] = zero


def point_model(
    reported: ReportedCovariance,
    range_sigma: float,
    rate_sigma: float,
    refinements: int = 2,
    false_alarm: float = 1e-3,
    least_quality: int = 1,
    most: int = 64,
) -> PointModel:
    """Turn settings of the point solution into numbers; `most` satellites at once.

    false_alarm is the probability that the residuals of good measurements are called inconsistent: two rows a satellite
    and eight unknowns leave 2 (n - 4) degrees of freedom.
    """
    limits = np.full(most + 1, math.inf)
    limits[5:] = chdtri(2 * (np.arange(5, most + 1) - 4), false_alarm)
    return PointModel(refinements, limits, range_sigma**2, rate_sigma**2, float(least_quality), reported)


def _acting(dt: float, time: float) -> tuple[float, float, float]:
    """Return what is left of an acceleration after dt, and what it has done to velocity and position, per unit."""
    if math.isinf(time):
        return 1.0, dt, 0.5 * dt * dt
    to_velocity = -time * math.expm1(-dt / time)
    return math.exp(-dt / time), to_velocity, time * (dt - to_velocity)


def receiver_filter(
    reported: ReportedCovariance,
    interval: float,
    range_sigma: float,
    rate_sigma: float,
    drive_sigma: float,
    clock_noise: float,
    acceleration: bool = True,
    acceleration_time: float | None = None,
    drive_gain: float = 0.0,
    range_gain: float = 0.0,
    rate_gain: float = 0.0,
    start_acceleration: float = 0.0,
    gate: float | None = None,
    range_limit: float | None = None,
    rate_limit: float | None = None,
    restart_after: int | None = None,
    longest_coast: float | None = None,
) -> ReceiverFilter:
    """Turn settings of the receiver's filter into numbers for one interval (s) between epochs.

    With `acceleration` its derivative is the driving noise (drive_sigma in m/s^3, drive_gain in 1/s^2); without it the
    acceleration itself is (drive_sigma in m/s^2, drive_gain a number), and its states stay at zero. acceleration_time
    (s) lets the acceleration decay, none: a random walk.
    """
    dt = interval
    decay, to_velocity, to_position = _acting(dt, math.inf if acceleration_time is None else acceleration_time)
    pairs = [(POS, VEL, dt)]
    if acceleration:
        pairs += [(POS, ACC, to_position), (VEL, ACC, to_velocity), (ACC, ACC, decay - 1.0)]  # as they act, one by one
    blocks = np.array([value * np.eye(3).ravel() for _, _, value in pairs])
    drive = [dt, 0.5 * dt**2, dt**3 / 6.0] if acceleration else [0.0, dt, 0.5 * dt**2]
    return ReceiverFilter(
        interval=dt,
        blocks=blocks,
        rows=np.array([row for row, _, _ in pairs], dtype=np.int64),
        columns=np.array([column for _, column, _ in pairs], dtype=np.int64),
        ones=np.ones(N_STATE),
        zeros=np.zeros(N_STATE),
        decay=decay,
        to_velocity=to_velocity,
        to_position=to_position,
        drive=np.array(drive),
        drive_floor=drive_sigma**2,
        drive_gain=drive_gain,
        clock=clock_noise**2,
        range_floor=range_sigma**2,
        range_gain=range_gain,
        rate_floor=rate_sigma**2,
        rate_gain=rate_gain,
        start=start_acceleration**2 if acceleration else 0.0,
        gate_squared=math.inf if gate is None else gate**2,
        range_limit=math.inf if range_limit is None else range_limit,
        rate_limit=math.inf if rate_limit is None else rate_limit,
        restart=math.inf if restart_after is None else float(restart_after),
        coast=math.inf if longest_coast is None else longest_coast,
        reported=reported,
    )


def transition(model: ReceiverFilter) -> Floats:
    """Return Phi (11, 11) of the receiver's filter over an interval."""
    phi = np.eye(N_STATE)
    for row, column, block in zip(model.rows, model.columns, model.blocks, strict=True):
        phi[row : row + 3, column : column + 3] += block.reshape(3, 3)
    phi[BIAS, DRIFT] += model.interval
    return phi
