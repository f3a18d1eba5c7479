"""Statistics of the draws of receiver and sensor errors: mean, variance and correlation against the cards."""

import math
from collections import defaultdict
from typing import NamedTuple

import numpy as np

from lvnav_trade.covariance.diagnostics.perturbed_estimate import navigation_at, tick_at
from lvnav_trade.covariance.selfcheck.check import CheckResult
from lvnav_trade.covariance.selfcheck.draw_checks import RUNS, correlation, moments
from lvnav_trade.gnss.fault_cards import DegradedNoise
from lvnav_trade.gnss.faults import active_intervals
from lvnav_trade.gnss.receiver_cards import DirectSolution
from lvnav_trade.gnss.reception import factors
from lvnav_trade.kernels.clock import step_covariance
from lvnav_trade.kernels.random import seed_words
from lvnav_trade.quantities.error_sources import label_of
from lvnav_trade.quantities.records import Bools, Floats, Ints
from lvnav_trade.scenario.filter_models import has_receiver_solution
from lvnav_trade.sensors.family import RECEIVER_SOLUTION, fill, measure
from lvnav_trade.sensors.imu_difference import ImuDifferenceCard
from lvnav_trade.sensors.jacobian_row import N_ENTRY
from lvnav_trade.simulation.epoch.filter_case import case_of
from lvnav_trade.simulation.montecarlo import Truth
from lvnav_trade.simulation.preparation.correlated import RECORDED
from lvnav_trade.simulation.preparation.prepare import PreparedCase
from lvnav_trade.simulation.preparation.signals.noise import rate_sigma_of
from lvnav_trade.simulation.run_arrays import Work, new_work
from lvnav_trade.simulation.sensing import begin, measure_sensors, observe

_EPOCHS = 24
_SENSOR_EPOCHS = 8
"""Number of additional epochs for a sensor that measures at few of the others."""


class EpochDraws(NamedTuple):
    """Draws of runs at some epochs.

    start : (n_run, 2) m, m/s. Initial clock bias and drift.
    steps : (n_run, n_epoch, 2) m, m/s. Noise of the clock steps.
    correlated_errors : (n_run, 1 + n_epoch, n_component) SI. Correlated measurement errors, at the start and at the
        epochs.
    white_noise : White measurement noise by source, in sigmas of its card.
    """

    start: Floats
    steps: Floats
    correlated_errors: Floats
    white_noise: dict[str, Floats]


def measurement_checks(prepared_case: PreparedCase, seed: int) -> list[CheckResult]:
    """Return the checks of the receiver's clock, of correlated measurement errors, and of white noise."""
    if not prepared_case.t_epoch.size or not prepared_case.model.has_epochs:
        return []
    draws = _simulate_draws(prepared_case, seed)
    checks = []
    if _has_ranges(prepared_case) and prepared_case.channels.receiver:
        checks += _clock_checks(prepared_case, draws)
    checks += _family_checks(prepared_case, draws)
    for name, z in draws.white_noise.items():
        checks += moments(name, z)
    return checks


def _family_checks(prepared_case: PreparedCase, draws: EpochDraws) -> list[CheckResult]:
    """Return the checks of correlated measurement errors: at the start, and after a correlation time."""
    checks: list[CheckResult] = []
    first, interval = 0, prepared_case.signals.interval
    for family in prepared_case.families:
        components = slice(first, first + len(family.labels))
        first = components.stop
        if family.error_type == RECORDED:
            continue
        z = draws.correlated_errors[:, :, components] / family.sigma
        z_start = z[:, 0]
        name = label_of(family.source)
        checks += moments(name, z_start, "at the start")
        if math.isfinite(family.time_constant):
            last = z.shape[1] - 1
            n_epoch = round(family.time_constant / interval)
            lag = min(last, max(1, n_epoch))
            z_later = z[:, lag]
            seconds = lag * interval
            expected_correlation = 0.0
            if family.time_constant > 0.0:
                expected_correlation = math.exp(-seconds / family.time_constant)
            checks += moments(name, z_later, f"after {seconds:.3g} s")
            checks.append(correlation(name, z_start, z_later, expected_correlation, seconds))
    return checks


def _has_ranges(prepared_case: PreparedCase) -> bool:
    """Return whether ranges are drawn, for the filter or for the receiver's solution."""
    return bool(prepared_case.model.tight or has_receiver_solution(prepared_case.scenario))


def _clock_checks(prepared_case: PreparedCase, draws: EpochDraws) -> list[CheckResult]:
    """Return the checks of the receiver's clock: start, and steps of bias and drift."""
    card = prepared_case.scenario.receiver.clock
    q11, _, q22 = step_covariance(prepared_case.signals.interval, card.h0, card.h_minus2)
    checks: list[CheckResult] = []
    for name, sigma, values in (
        ("clock bias", card.initial_bias, draws.start[:, 0]),
        ("clock drift", card.initial_drift, draws.start[:, 1]),
        ("step of clock bias", math.sqrt(q11), draws.steps[..., 0]),
        ("step of clock drift", math.sqrt(q22), draws.steps[..., 1]),
    ):
        if sigma > 0.0:
            z = values / sigma
            checks += moments(name, z)
    return checks


def _checked_epochs(prepared_case: PreparedCase) -> Ints:
    """Return epochs over the flight, with some of each sensor; without frozen epochs."""

    def spread(epochs: Ints, count: int) -> Ints:
        if not epochs.size:
            return epochs
        last = epochs.size - 1
        places = np.linspace(0, last, count).astype(int)
        return epochs[places]

    is_live = ~prepared_case.signals.is_frozen
    live_epochs = np.flatnonzero(is_live)
    epoch_sets = [spread(live_epochs, _EPOCHS)]
    for device in prepared_case.devices:
        sensor_epochs = np.flatnonzero(device.is_measuring & is_live)
        epoch_sets.append(spread(sensor_epochs, _SENSOR_EPOCHS))
    return np.unique(np.concatenate(epoch_sets))


def _nominal_epochs(prepared_case: PreparedCase) -> Bools:
    """Return whether no fault increases the noise at the epochs, (n_epoch,)."""
    is_nominal = np.ones(prepared_case.t_epoch.size, dtype=np.bool_)
    faults = prepared_case.scenario.faults
    flight_profile = prepared_case.trajectory.flight_profile
    for _, _, is_degraded, *_ in active_intervals(faults, DegradedNoise, flight_profile, prepared_case.t_epoch):
        is_nominal &= ~is_degraded
    return is_nominal


def _simulate_draws(prepared_case: PreparedCase, seed: int) -> EpochDraws:
    """Simulate receiver and sensors of some runs at some epochs of the nominal flight, and return their draws."""
    signals = prepared_case.signals
    interval = signals.interval
    key = seed_words(seed)
    epochs = _checked_epochs(prepared_case)
    n_epoch = epochs.size
    is_nominal = _nominal_epochs(prepared_case)
    has_ranges = _has_ranges(prepared_case)
    work, optional_state = new_work(prepared_case, uses_lanes=False)
    truth = Truth(prepared_case.unit, prepared_case.initial_state, prepared_case.record)
    start_case = case_of(prepared_case)
    # ranges also if the receiver computes a solution from them, which itself draws nothing
    model = prepared_case.model._replace(tight=has_ranges)
    case = case_of(prepared_case, model=model)
    exact_innovations = {epoch: _innovations(prepared_case, work, epoch, exact=True) for epoch in epochs.tolist()}
    error_count = signals.correlated_errors.initial_sigma.size
    start = np.empty((RUNS, 2))
    steps = np.empty((RUNS, n_epoch, 2))
    correlated_errors = np.zeros((RUNS, 1 + n_epoch, error_count))
    white_noise = defaultdict[str, list[Floats]](list)
    for run in range(RUNS):
        work.run[0] = run
        begin(work, optional_state.units, start_case, truth, key)
        start[run] = work.clock
        correlated_errors[run, 0] = work.correlated_errors[:error_count]
        for k, epoch in enumerate(epochs.tolist()):
            bias, drift = work.clock
            jump = signals.clock_jump[epoch]
            observe(work, optional_state, case, None, key, epoch)
            measure_sensors(work, optional_state.units, prepared_case.sensors, None, signals, key, epoch)
            bias += interval * drift + jump[0]
            drift += jump[1]
            steps[run, k] = work.clock - (bias, drift)
            correlated_errors[run, k + 1] = work.correlated_errors[:error_count]
            if is_nominal[epoch] and prepared_case.channels.receiver:
                _add_receiver(white_noise, prepared_case, work, epoch, has_ranges)
                _add_phases(white_noise, prepared_case, work, optional_state.previous_observables, epoch)
            for name, (z, sigma) in _innovations(prepared_case, work, epoch).items():
                exact_z, _ = exact_innovations[epoch][name]
                white_noise[name].append(_normalise(z - exact_z, sigma))
    noise_by_source = {name: np.concatenate(draws) for name, draws in white_noise.items()}
    return EpochDraws(
        start=start,
        steps=steps,
        correlated_errors=correlated_errors,
        white_noise={name: z for name, z in noise_by_source.items() if z.size},
    )


def _normalise(error: Floats, sigma: Floats) -> Floats:
    """Return errors (n,) over their sigmas, where these are positive."""
    has_noise = sigma > 0.0
    return error[has_noise] / sigma[has_noise]


def _shared_errors(prepared_case: PreparedCase, work: Work, epoch: int, channels: Ints) -> Floats:
    """Return the sum of the correlated errors in measured channels (n,) at an epoch."""
    correlated_errors = prepared_case.signals.correlated_errors
    if not correlated_errors.member.size:
        return np.zeros(channels.size)
    member = correlated_errors.member[:, channels]
    is_member = member >= 0
    component = np.maximum(member, 0)
    values = np.where(is_member, work.correlated_errors[component], 0.0)
    partial = correlated_errors.partial[:, epoch, channels]
    return np.asarray(np.sum(partial * values, axis=0))


def _add_receiver(
    white: dict[str, list[Floats]], prepared_case: PreparedCase, work: Work, epoch: int, ranges: bool
) -> None:
    """Append the white noise of the receiver's measurements, in sigmas of its card (or of its tracking loops)."""
    if ranges:
        _add_ranges(white, prepared_case, work, epoch)
        return
    signals = prepared_case.signals
    card = prepared_case.scenario.receiver
    assert isinstance(card.solution, DirectSolution)
    true = np.concatenate([signals.position[epoch], signals.velocity[epoch]])
    correlated_error = _shared_errors(prepared_case, work, epoch, np.arange(6))
    error = work.solution - true - correlated_error
    time = prepared_case.sky.t[epoch : epoch + 1]
    noise_factors = factors(card.noise_by, RECEIVER_SOLUTION, prepared_case.trajectory, time)
    sigmas = {
        "position solution noise": card.solution.position_sigma,
        "velocity solution noise": card.solution.velocity_sigma,
    }
    for k, (name, sigma) in enumerate(sigmas.items()):
        if sigma > 0.0:
            first = 3 * k
            axis_error = error[first : first + 3]
            axis_sigma = sigma * np.ravel(noise_factors[k])
            white[name].append(axis_error / axis_sigma)


def _add_ranges(white: dict[str, list[Floats]], prepared_case: PreparedCase, work: Work, epoch: int) -> None:
    """Append the white noise of pseudoranges and range rates, in sigmas of the card (or of the tracking loops)."""
    signals = prepared_case.signals
    sky = prepared_case.sky
    n_observable = prepared_case.model.n_observable
    n_used = signals.n_used[epoch]
    satellites = signals.satellite_by_slot[epoch, :n_used]
    rate_sigma = rate_sigma_of(prepared_case.scenario, sky, prepared_case.trajectory)
    for k, (name, true, sigma) in enumerate(
        (
            ("pseudorange noise", signals.range, sky.range_sigma),
            ("range-rate noise", signals.rate, rate_sigma),
        )
    ):
        measurements = work.ranges[: satellites.size, k]
        channels = n_observable * satellites + k
        error = measurements - true[epoch, satellites] - work.clock[k]
        error -= _shared_errors(prepared_case, work, epoch, channels)
        white[name].append(_normalise(error, sigma[epoch, satellites]))


def _add_phases(
    white: dict[str, list[Floats]], prepared_case: PreparedCase, work: Work, previous_phases: Floats | None, epoch: int
) -> None:
    """Append the white noise of the receiver's carrier phases, in their sigmas.

    previous_phases : (n_sat, n_observable), phases with which differences are formed
    """
    signals = prepared_case.signals
    further = prepared_case.options.further_observables
    n_observable = prepared_case.model.n_observable
    if further is None or previous_phases is None:
        return
    n_used = signals.n_used[epoch]
    satellites = signals.satellite_by_slot[epoch, :n_used]
    sigma = prepared_case.sky.phase_sigma[epoch, satellites]
    for observable in np.flatnonzero(further.is_phase):
        if further.is_difference[observable]:
            measurements = previous_phases[satellites, observable]
        else:
            measurements = work.ranges[: satellites.size, observable]
        channels = n_observable * satellites + observable
        true = further.phase[epoch, satellites]
        error = measurements - true - work.clock[0]
        error = error - _shared_errors(prepared_case, work, epoch, channels)
        white["carrier-phase noise"].append(_normalise(error, sigma))


def _innovations(
    prepared_case: PreparedCase, work: Work, epoch: int, exact: bool = False
) -> dict[str, tuple[Floats, Floats]]:
    """Return innovations at the truth, minus correlated errors, and noise sigmas (n_scalar,) of sensors at an epoch.

    The result is by noise source. exact : whether measurements have no error
    """
    by_source = {}
    signals = prepared_case.signals
    H = np.zeros((4, N_ENTRY))
    z = np.zeros(4)
    no_error = np.zeros(prepared_case.layout.n_state)
    for k, device in enumerate(prepared_case.devices):
        # the noise of differences of two IMUs is that of the IMUs
        if not device.is_measuring[epoch] or isinstance(device.card, ImuDifferenceCard):
            continue
        sensors = prepared_case.sensors
        n = len(device.channels.labels)
        assert sensors is not None  # the case has this sensor
        code = sensors.code[k]
        measurement = work.sensor_measurements[k]
        if exact:
            measure(measurement, code, sensors.truth[k, epoch], 0.0, 0.0, 0.0)
        time_of_validity = prepared_case.t_epoch[epoch] - device.delay[epoch]
        tick = tick_at(prepared_case, time_of_validity)
        nav = navigation_at(prepared_case, tick, no_error)
        fill(H, z, 0, code, measurement, nav, sensors.theta[k, epoch], sensors.filter_parameters[k, epoch])
        channels = np.arange(n) + sensors.channel[k] + signals.shift
        correlated_error = np.zeros(n) if exact else _shared_errors(prepared_case, work, epoch, channels)
        by_source[device.noise] = (z[:n] - correlated_error, device.sigma[epoch, :n])
    return by_source
