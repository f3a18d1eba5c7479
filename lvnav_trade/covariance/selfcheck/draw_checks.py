"""Statistics of the draws of IMU errors and initial errors: mean, variance and correlation against the cards."""

import math
from collections.abc import Iterator

import numpy as np
from scipy import stats

from lvnav_trade.covariance.selfcheck.check import CheckResult
from lvnav_trade.imu.array import list_triads
from lvnav_trade.imu.error_model import ImuCard
from lvnav_trade.kernels import processes
from lvnav_trade.kernels.attitude import small_rotation
from lvnav_trade.kernels.random import seed_words
from lvnav_trade.kernels.strapdown import R, V
from lvnav_trade.quantities.error_sources import label_of
from lvnav_trade.quantities.frames import reporting_axes
from lvnav_trade.quantities.per_axis import axes, rms, squares
from lvnav_trade.quantities.records import Floats
from lvnav_trade.quantities.state_layout import ErrorTerm
from lvnav_trade.simulation.imu_array import new_units, sense_units
from lvnav_trade.simulation.preparation.prepare import PreparedCase
from lvnav_trade.simulation.run_arrays import new_work
from lvnav_trade.simulation.sensing import draw_initial_state

RUNS = 128
KIND = "draws"
_STEPS = 400
"""Largest number of process steps over which correlations are checked."""
_TICKS, _NOISE_RUNS = 500, 16


def moments(quantity: str, z: Floats, remark: str = "") -> list[CheckResult]:
    """Return checks of mean and variance of draws that should be standard normals.

    Parameters
    ----------
    quantity
        Name of the quantity.
    z
        Draws of any shape, in sigmas.
    remark
        Time or place, for the report.
    """
    n = z.size
    mean = float(z.mean())
    mean_square = float(np.mean(z**2))
    mean_law = stats.norm(0.0, 1.0 / math.sqrt(n))
    variance_law = stats.chi2(n, scale=1.0 / n)
    return [
        CheckResult(KIND, f"{quantity}, mean (sigma)", mean, remark=remark, distribution=mean_law),
        CheckResult(KIND, f"{quantity}, variance", mean_square, remark=remark, distribution=variance_law),
    ]


def correlation(
    quantity: str, first_values: Floats, later_values: Floats, expected_correlation: float, seconds: float
) -> CheckResult:
    """Return the check of the correlation between standard normals and their values some time later.

    Parameters
    ----------
    quantity
        Name of the quantity.
    first_values, later_values
        Standard normals, and the same quantities later.
    expected_correlation
        Expected correlation.
    seconds
        s. Time in between.
    """
    variance = (1.0 + expected_correlation**2) / first_values.size
    law = stats.norm(expected_correlation, math.sqrt(variance))
    estimate = float(np.mean(first_values * later_values))
    remark = f"after {seconds:.3g} s; expected {expected_correlation:.3f}"
    return CheckResult(KIND, f"{quantity}, correlation", estimate, remark=remark, distribution=law)


def imu_checks(prepared_case: PreparedCase, seed: int) -> list[CheckResult]:
    """Return the checks of the IMU parameters (and of the gravity disturbance) by source, and of the white noise."""
    checks: list[CheckResult] = []
    unit = prepared_case.unit
    sources = prepared_case.sources
    first_parameters, later_parameters, lags = _processes(prepared_case, seed)
    step = unit.process_ticks * unit.dt
    for source in dict.fromkeys(block.name for block in sources):
        blocks = [k for k, block in enumerate(sources) if block.name == source]
        first_block = blocks[0]
        first_values = first_parameters[:, blocks]
        later_values = later_parameters[:, blocks]
        checks += _parameter_checks(sources[first_block], first_values, later_values, lags[first_block], step)
    for name, z in _white_noise(prepared_case, seed):
        checks += moments(name, z)
        checks.append(correlation(name, z[:, :-1], z[:, 1:], 0.0, unit.dt))
    return checks


def _parameter_checks(
    block: ErrorTerm, first_values: Floats, later_values: Floats, lag: int, step: float
) -> list[CheckResult]:
    """Return the checks of the parameters of a source.

    Parameters
    ----------
    block
        Error term of the source.
    first_values, later_values
        (n_run, n_block, 3) SI. Parameters at the start, and some steps later.
    lag
        Number of steps in between; 0 if the parameter does not vary.
    step
        s. Process step.
    """
    checks: list[CheckResult] = []
    name = label_of(block.name)
    seconds = lag * step
    start_sigma = np.array(axes(block.sigma))
    later_sigma = np.sqrt(_variance(block, step, lag))
    has_start = start_sigma > 0.0
    has_later = later_sigma > 0.0
    if has_start.any():
        z_start = first_values[..., has_start] / start_sigma[has_start]
        checks += moments(name, z_start, "at the start")
    if lag:
        sigma = later_sigma[has_later]
        z_later = later_values[..., has_later] / sigma
        checks += moments(name, z_later, f"after {seconds:.3g} s")
        if math.isfinite(block.time_constant):
            z_first = first_values[..., has_later] / sigma
            expected_correlation = math.exp(-seconds / block.time_constant)
            checks.append(correlation(name, z_first, z_later, expected_correlation, seconds))
    return checks


def _variance(block: ErrorTerm, step: float, count: int) -> Floats:
    """Return the variance of an error parameter after some steps by its card, (3,) SI squared.

    Parameters
    ----------
    block
        Error term.
    step
        s. Process step.
    count
        Number of steps.
    """
    start = np.array(squares(block.sigma))
    rate = np.array(squares(block.walk))
    if math.isinf(block.time_constant):
        return np.asarray(start + rate * step * count)
    decay = math.exp(-2.0 * step / block.time_constant)  # of the variance over a step; the driving noise is a sum
    driven_variance = rate * step * (1.0 - decay**count) / (1.0 - decay)
    return np.asarray(start + driven_variance)


def _lag(block: ErrorTerm, step: float) -> int:
    """Return the number of steps after which a parameter is checked again; 0 if it does not vary."""
    if math.isinf(block.time_constant):
        return _STEPS if rms(block.walk) > 0.0 else 0
    n_step = round(block.time_constant / step)
    return min(_STEPS, max(1, n_step))


def _processes(prepared_case: PreparedCase, seed: int) -> tuple[Floats, Floats, list[int]]:
    """Return the parameters (n_run, n_block, 3) at the start of runs and after some steps, and the numbers of steps."""
    unit = prepared_case.unit
    k0, k1 = seed_words(seed)
    step_seconds = unit.process_ticks * unit.dt
    lags = [_lag(block, step_seconds) for block in prepared_case.sources]
    n_block = len(lags)
    first_values = np.zeros((RUNS, n_block, 3))
    later_values = np.zeros((RUNS, n_block, 3))
    values = np.zeros((max(1, n_block), 3))
    blocks_by_lag = {lag: np.array(lags) == lag for lag in set(lags)}
    n_run = RUNS if lags else 0
    for run in range(n_run):
        run_key = np.uint64(run)
        processes.start(values, unit.sigma, unit.sources, k0, k1, run_key)
        first_values[run] = values
        for step in range(1, max(lags) + 1):
            processes.step(values, unit.decay, unit.walk, unit.sources, k0, k1, run_key, np.uint64(step))
            if step in blocks_by_lag:
                blocks = blocks_by_lag[step]
                later_values[run, blocks] = values[blocks]
    return first_values, later_values, lags


def _white_noise(prepared_case: PreparedCase, seed: int) -> Iterator[tuple[str, Floats]]:
    """Yield the white noise of every sensor of every IMU, (n_run, n_tick, n_axis) in sigmas of its card."""
    imu = prepared_case.scenario.imu
    dt = prepared_case.unit.dt
    n = min(_TICKS, len(prepared_case.unit.dtheta))
    if isinstance(imu, ImuCard):
        noise = _imu_noise(prepared_case, seed, n)
        yield from _normalised_noise(imu, "", noise, 3, dt)
        return
    noise = _array_noise(prepared_case, seed, n)
    for k, triad in enumerate(list_triads(imu)):
        card = imu.units[triad.unit]
        name = f"unit {triad.unit + 1} "
        yield from _normalised_noise(card, name, noise[:, k], triad.n_axis, dt)


def _normalised_noise(card: ImuCard, name: str, noise: Floats, n_axis: int, dt: float) -> Iterator[tuple[str, Floats]]:
    """Yield the noise of gyro and accelerometer in sigmas of the card, for axes with noise.

    Parameters
    ----------
    card
        Card of the IMU.
    name
        Beginning of the names that are yielded.
    noise
        (n_run, n_tick, 6) rad, m/s. Noise of the increments.
    n_axis
        Number of sensing axes.
    dt
        s. Tick.
    """
    for first, label, sensor in ((0, "gyro", card.gyro), (3, "accelerometer", card.accel)):
        random_walk = np.array(axes(sensor.random_walk))
        sigma = random_walk[:n_axis] * math.sqrt(dt)
        has_noise = sigma > 0.0
        if has_noise.any():
            axis_noise = noise[:, :, first : first + n_axis]
            z = axis_noise[..., has_noise] / sigma[has_noise]
            yield f"{name}{label} random walk", z


def _imu_noise(prepared_case: PreparedCase, seed: int, n: int) -> Floats:
    """Return the increments' noise of an IMU without other errors, (n_run, n, 6) rad and m/s.

    Parameters
    ----------
    prepared_case
        Prepared case.
    seed
        Seed of the draws.
    n
        Number of ticks.
    """
    unit = prepared_case.unit
    k0, k1 = seed_words(seed)
    increments = np.zeros((_NOISE_RUNS, n, 6))
    no_errors = np.zeros(processes.N_TABLE)
    white = np.array([*unit.white[:6], 0.0, 0.0])  # without quantisation, whose remainder is not white
    for run in range(_NOISE_RUNS):
        processes.corrupt(
            increments[run],
            first_row=0,
            first_tick=0,
            n_tick=n,
            dtheta=unit.dtheta,
            dvel=unit.dvel,
            gyro=no_errors,
            accel=no_errors,
            noise=white,
            remainder=np.zeros(6),
            unit=unit,
            k0=k0,
            k1=k1,
            run=np.uint64(run),
        )
    return np.asarray(increments - np.hstack([unit.dtheta[:n], unit.dvel[:n]]))


def _array_noise(prepared_case: PreparedCase, seed: int, n: int) -> Floats:
    """Return the increments' noise of the IMUs of an array, (n_run, n_triad, n, 6) rad and m/s.

    The difference of two runs over sqrt(2) has the noise of one run, without deterministic errors.

    Parameters
    ----------
    prepared_case
        Prepared case.
    seed
        Seed of the draws.
    n
        Number of ticks.
    """
    units = prepared_case.options.imu_array
    dt = prepared_case.unit.dt
    key = seed_words(seed)
    work, _ = new_work(prepared_case, uses_lanes=False)
    work = work._replace(increments=np.zeros((n, 6)))
    no_quantisation = np.repeat([1.0, 0.0], [6, 2])
    units = units._replace(white=units.white * no_quantisation, redundant=None)
    array_work = new_units(units, n)
    sensed_increments = []
    for run in range(2 * _NOISE_RUNS):
        work.run[0] = run
        sense_units(work, array_work, units, 0, 0, n, dt, *key)
        sensed_increments.append(array_work.increments.copy())
    runs = np.array(sensed_increments)
    even_runs = runs[::2]
    odd_runs = runs[1::2]
    return np.asarray((even_runs - odd_runs) / math.sqrt(2.0))


def initial_error_checks(prepared_case: PreparedCase, seed: int) -> list[CheckResult]:
    """Return the checks of the initial errors: tilt, heading, velocity, position."""
    start = prepared_case.initial_state
    card = prepared_case.scenario.initial
    reference = prepared_case.reference
    key = seed_words(seed)
    work, _ = new_work(prepared_case, uses_lanes=False)
    theta0 = prepared_case.trajectory.theta0
    C_i_n = reporting_axes("ned", reference.t[:1], reference.r_i[:1], reference.v_i[:1], theta0)[0]
    velocity = slice(V, V + 3)
    position = slice(R, R + 3)
    errors = np.empty((RUNS, 9))
    for run in range(RUNS):
        q = draw_initial_state(work, start, *key, np.uint64(run))
        tilt = small_rotation(*start.nav[:4], *q)
        errors[run, :3] = C_i_n @ tilt
        errors[run, 3:6] = start.nav[velocity] - work.nav[velocity]
        errors[run, 6:] = start.nav[position] - work.nav[position]
    tilt_errors = errors[:, :2]
    heading_errors = errors[:, 2]
    velocity_errors = errors[:, 3:6]
    position_errors = errors[:, 6:]
    checks = []
    for name, sigma, draws in (
        ("initial tilt", card.tilt, tilt_errors),
        ("initial heading", card.heading, heading_errors),
        ("initial velocity", card.velocity, velocity_errors),
        ("initial position", card.position, position_errors),
    ):
        if sigma > 0.0:
            checks += moments(name, draws / sigma)
    return checks
