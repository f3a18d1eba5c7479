"""Receivers that compute position and velocity: settings as numbers, and the arrays of a run.

A solution is position, velocity, clock bias and clock drift in frame i from pseudoranges and range rates of satellites
whose positions are given at transmission. Missing measurements of a run are NaN; the quality of no solution is zero.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from scipy.special import chdtri

from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.lanes import zeros_of
from lvnav_trade.quantities.records import Floats, Ints
from lvnav_trade.sensors.jacobian_row import N_ENTRY

# Indices of a point solution.
FIX_POS, FIX_VEL, FIX_BIAS, FIX_DRIFT, N_FIX = 0, 3, 6, 7, 8

# Quality numbers of a point solution, then of a filtered solution; larger is better.
NO_FIX, INCONSISTENT, UNTESTED, CONSISTENT = 0.0, 1.0, 2.0, 3.0
PROPAGATED, PARTIAL, FULL = 1.0, 2.0, 3.0

# States of the receiver's filter: acceleration takes the place of attitude in the common kernels.
ACC, VEL, POS, BIAS, DRIFT, N_STATE = 0, 3, 6, 9, 10, 11

# Indices of the memory of the filter, which it has besides state and covariance.
STARTED, IDLE, MISSES, SINCE, LAST_VELOCITY, ACCELERATION, N_MEMORY = 0, 1, 2, 3, 4, 7, 10


class ReportedCovariance(NamedTuple):
    """Settings of the covariance reported with a solution.

    is_computed : Whether it is the covariance of the solver; otherwise it is constant and diagonal.
    has_correlations : Whether the covariance of the solver is reported with its correlations.
    factor : Factor on the covariance of the solver.
    position_variance : m^2. Constant variance of position per axis.
    velocity_variance : m^2/s^2. Constant variance of velocity per axis.
    """

    is_computed: bool = True
    has_correlations: bool = True
    factor: float = 1.0
    position_variance: float = 0.0
    velocity_variance: float = 0.0


class PointModel(NamedTuple):
    """Settings of the point solution.

    refinements : Number of Newton steps after the closed form.
    limits : (n,). Limit of the sum of squared normalised residuals, by number of satellites.
    range_variance : m^2. Variance that the receiver assumes for a pseudorange.
    rate_variance : m^2/s^2. Variance that the receiver assumes for a range rate.
    least_quality : Lowest quality that is output.
    reported_covariance : Covariance that is reported with the solution.
    """

    refinements: int
    limits: Floats
    range_variance: float
    rate_variance: float
    least_quality: float
    reported_covariance: ReportedCovariance


class ReceiverFilter(NamedTuple):
    """Settings of the receiver's Kalman filter, as numbers for the interval between epochs.

    interval : s. Time between epochs.
    blocks : (n_block, 9). 3 x 3 blocks that the transition matrix has beyond the identity.
    rows : (n_block,). First row of each block.
    columns : (n_block,). First column of each block.
    unit_decay : (11,). Decay factors of the states, all 1, as the common kernel needs them.
    zero_noise : (11,). Process noise of the states, all 0, as the common kernel needs it.
    decay : Decay factor of the acceleration.
    velocity_effect : s. Velocity change per acceleration.
    position_effect : s^2. Position change per acceleration.
    drive : (3,). Effect of the driving noise on acceleration, velocity and position.
    drive_floor : Smallest variance of the driving noise per axis: m^2/s^6 (jerk) or m^2/s^4 (acceleration).
    drive_gain : Variance of the driving noise per squared acceleration; the larger of the two is used.
    clock : m^2/s^4. Variance of the derivative of the clock drift.
    range_floor : m^2. Smallest variance of a range.
    range_gain : m s^2. Variance of a range per acceleration; the larger of the two is used.
    rate_floor : m^2/s^2. Smallest variance of a range rate.
    rate_gain : m. Variance of a range rate per acceleration; the larger of the two is used.
    start : m^2/s^4. Variance of the acceleration at the start.
    gate_squared : Largest square of a normalised innovation; infinite without a gate.
    range_limit : m. Largest innovation of a range.
    rate_limit : m/s. Largest innovation of a range rate.
    restart : Epochs with most measurements rejected after which the filter restarts.
    coast : s. Longest time without an accepted measurement for which a solution is output.
    reported_covariance : Covariance that is reported with the solution.
    """

    interval: float
    blocks: Floats
    rows: Ints
    columns: Ints
    unit_decay: Floats
    zero_noise: Floats
    decay: float
    velocity_effect: float
    position_effect: float
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
    reported_covariance: ReportedCovariance


class Solver(NamedTuple):
    """Processing of a receiver's measurements.

    point : Point solution.
    filter : Kalman filter (ReceiverFilter); None: the point solution is output.
    smoothing : Carrier smoothing of the ranges before the solution; None: none.
    """

    point: PointModel
    filter: Any = None
    smoothing: Any = None


class Receiver(NamedTuple):
    """Arrays of a receiver in a run, or lane views of eight runs; see `new_receiver`. Quantities in frame i, SI.

    NaN marks an innovation or a solution that does not exist.

    position_guess : (3,) m. Position at which the point solution starts its search.
    fix : (8,). Point solution: position, velocity, clock bias, clock drift.
    inverse : (4, 4). Inverse of the normal matrix of the point solution.
    normal : (4, 4). Normal matrix, factorised in place.
    sides : (2, 4). Two right-hand sides of the normal equations, then their solutions.
    verdict : (2,). Quality of the point solution and number of satellites.
    nav : (11,). State of the filter: acceleration, velocity, position, clock bias, clock drift.
    P : (11, 11). Covariance of the filter.
    x : (11,). Scratch: error state of an update.
    K : (11,). Scratch: gain of a scalar measurement.
    h : (N_ENTRY,). Scratch: Jacobian row of a scalar measurement.
    antenna_state : (21,). Scratch: antenna state, as in `line_of_sight.antenna`.
    memory : (10,). Memory of the filter besides state and covariance, from STARTED to ACCELERATION.
    filter_verdict : (2,). Quality of the filtered solution and number of accepted scalar measurements.
    solution : (6,) m, m/s. Position and velocity that the receiver outputs.
    covariance : (6, 6). Covariance reported with the solution.
    innovation : (2 n_sat,). Normalised innovation by satellite: range, then range rate.
    average : (n_sat,) m. Smoothed code minus carrier by satellite.
    """

    position_guess: Floats
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
    antenna_state: Floats
    memory: Floats
    filter_verdict: Floats
    solution: Floats
    covariance: Floats
    innovation: Floats
    average: Floats


def new_receiver(lanes: int = 0, n_sat: int = 64) -> Receiver:
    """Return the arrays of a receiver before `switch_on`.

    lanes : Number of runs on the last axis; 0: a single run without that axis.
    n_sat : Number of satellites of the constellation.
    """
    n = N_STATE
    shapes = {
        "position_guess": (3,),
        "fix": (N_FIX,),
        "inverse": (4, 4),
        "normal": (4, 4),
        "sides": (2, 4),
        "verdict": (2,),
        "nav": (n,),
        "P": (n, n),
        "x": (n,),
        "K": (n,),
        "h": (N_ENTRY,),
        "antenna_state": (21,),
        "memory": (N_MEMORY,),
        "filter_verdict": (2,),
        "solution": (6,),
        "covariance": (6, 6),
        "innovation": (2 * n_sat,),
        "average": (n_sat,),
    }
    return Receiver(**zeros_of(shapes, lanes))


@jit
def switch_on(receiver: Any, x: Any, y: Any, z: Any) -> None:
    """Set a receiver to its state before the first epoch; x, y, z (m, frame i) is the guess for its first fix."""
    zero = 0.0 * x
    receiver.position_guess[0] = x
    receiver.position_guess[1] = y
    receiver.position_guess[2] = z
    for i in range(N_STATE):
        receiver.nav[i] = zero
        for j in range(N_STATE):
            receiver.P[i, j] = zero
    for i in range(N_MEMORY):
        receiver.memory[i] = zero
    receiver.memory[SINCE] = zero - 1.0  # negative: no point solution yet
    for s in range(receiver.average.shape[0]):
        receiver.average[s] = zero


def point_model(
    reported_covariance: ReportedCovariance,
    range_sigma: float,
    rate_sigma: float,
    refinements: int = 2,
    false_alarm: float = 1e-3,
    least_quality: int = 1,
    max_satellite_count: int = 64,
) -> PointModel:
    """Return the settings of the point solution as numbers.

    Parameters
    ----------
    reported_covariance : ReportedCovariance
    range_sigma, rate_sigma : float
        Standard deviations (m, m/s) that the receiver assumes.
    refinements : int
        Newton steps after the closed form.
    false_alarm : float
        Probability that the residuals of good measurements are declared inconsistent. With two measurements per
        satellite and eight unknowns their sum of squares is chi-square with 2 (n - 4) degrees of freedom.
    least_quality : int
        Lowest quality that is output.
    max_satellite_count : int
        Largest number of satellites in a solution.
    """
    limits = np.full(max_satellite_count + 1, math.inf)
    degrees_of_freedom = 2 * (np.arange(5, max_satellite_count + 1) - 4)
    limits[5:] = chdtri(degrees_of_freedom, false_alarm)
    return PointModel(refinements, limits, range_sigma**2, rate_sigma**2, float(least_quality), reported_covariance)


def _acceleration_effect(dt: float, time: float) -> tuple[float, float, float]:
    """Return decay factor of an acceleration over dt (s), and its effect on velocity (s) and position (s^2).

    time : s. Time constant of the acceleration; infinite: constant.
    """
    if math.isinf(time):
        return 1.0, dt, 0.5 * dt * dt
    decay = math.exp(-dt / time)
    velocity_effect = -time * math.expm1(-dt / time)
    position_effect = time * (dt - velocity_effect)
    return decay, velocity_effect, position_effect


class FilterSettings(NamedTuple):
    """Settings of the receiver's Kalman filter.

    range_sigma : m. Noise of a pseudorange.
    rate_sigma : m/s. Noise of a range rate.
    drive_sigma : m/s^3. Driving noise: derivative of the acceleration; without acceleration states the acceleration
        itself, m/s^2.
    clock_noise : m/s^2. Sigma of the derivative of the clock drift, constant over an interval.
    acceleration : Whether the acceleration is a state.
    acceleration_time : s. Time constant of its decay; None: a random walk.
    drive_gain : 1/s^2, without acceleration states a number. Driving variance per squared acceleration, if larger.
    range_gain : m s^2. Variance of a pseudorange per acceleration, if larger.
    rate_gain : m. Variance of a range rate per acceleration, if larger.
    start_acceleration : m/s^2. Sigma of the acceleration at the start.
    gate : Normalised innovation beyond which a measurement is rejected; None: no limit, like the settings below.
    range_limit : m. Innovation of a pseudorange beyond which it is rejected.
    rate_limit : m/s. Innovation of a range rate beyond which it is rejected.
    restart_after : Epochs with most measurements rejected after which the filter restarts.
    longest_coast : s. Longest time without an accepted measurement for which a solution is output.
    """

    range_sigma: float
    rate_sigma: float
    drive_sigma: float
    clock_noise: float
    acceleration: bool = True
    acceleration_time: float | None = None
    drive_gain: float = 0.0
    range_gain: float = 0.0
    rate_gain: float = 0.0
    start_acceleration: float = 0.0
    gate: float | None = None
    range_limit: float | None = None
    rate_limit: float | None = None
    restart_after: int | None = None
    longest_coast: float | None = None


def receiver_filter(
    reported_covariance: ReportedCovariance, interval: float, settings: FilterSettings
) -> ReceiverFilter:
    """Return the settings of the receiver's filter as numbers for an interval (s) between epochs."""
    dt = interval
    acceleration = settings.acceleration
    time = settings.acceleration_time
    decay, velocity_effect, position_effect = _acceleration_effect(dt, math.inf if time is None else time)
    pairs = [(POS, VEL, dt)]
    if acceleration:
        # the kernel applies the blocks in this order: position and velocity first, by the acceleration before its decay
        pairs.append((POS, ACC, position_effect))
        pairs.append((VEL, ACC, velocity_effect))
        pairs.append((ACC, ACC, decay - 1.0))
    identity = np.eye(3).ravel()
    blocks = np.array([value * identity for _, _, value in pairs])
    drive = [dt, 0.5 * dt**2, dt**3 / 6.0] if acceleration else [0.0, dt, 0.5 * dt**2]
    return ReceiverFilter(
        interval=dt,
        blocks=blocks,
        rows=np.array([row for row, _, _ in pairs], dtype=np.int64),
        columns=np.array([column for _, column, _ in pairs], dtype=np.int64),
        unit_decay=np.ones(N_STATE),
        zero_noise=np.zeros(N_STATE),
        decay=decay,
        velocity_effect=velocity_effect,
        position_effect=position_effect,
        drive=np.array(drive),
        drive_floor=settings.drive_sigma**2,
        drive_gain=settings.drive_gain,
        clock=settings.clock_noise**2,
        range_floor=settings.range_sigma**2,
        range_gain=settings.range_gain,
        rate_floor=settings.rate_sigma**2,
        rate_gain=settings.rate_gain,
        start=settings.start_acceleration**2 if acceleration else 0.0,
        gate_squared=_limit(settings.gate) ** 2,
        range_limit=_limit(settings.range_limit),
        rate_limit=_limit(settings.rate_limit),
        restart=_limit(settings.restart_after),
        coast=_limit(settings.longest_coast),
        reported_covariance=reported_covariance,
    )


def _limit(limit: float | None) -> float:
    """Return a limit as a number; None becomes infinity."""
    return math.inf if limit is None else float(limit)


def transition(model: ReceiverFilter) -> Floats:
    """Return Phi (11, 11) of the receiver's filter over an interval."""
    phi = np.eye(N_STATE)
    for row, column, block in zip(model.rows, model.columns, model.blocks, strict=True):
        phi[row : row + 3, column : column + 3] += block.reshape(3, 3)
    phi[BIAS, DRIFT] += model.interval
    return phi
