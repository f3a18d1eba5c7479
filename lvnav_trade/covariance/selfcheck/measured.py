"""Statistics of the draws of receiver and sensor errors: mean, variance and correlation against the cards."""

import math
from collections import defaultdict
from typing import NamedTuple

import numpy as np

from lvnav_trade.covariance.diagnostics.perturbed_estimate import navigation_at, tick_at
from lvnav_trade.covariance.selfcheck.check import CheckResult
from lvnav_trade.covariance.selfcheck.draw_checks import RUNS, correlation, moments
from lvnav_trade.gnss.fault_cards import DegradedNoise
from lvnav_trade.gnss.faults import active
from lvnav_trade.gnss.receiver_cards import DirectSolution
from lvnav_trade.gnss.reception import factors
from lvnav_trade.kernels.clock import step_covariance
from lvnav_trade.kernels.random import seed_words
from lvnav_trade.quantities.error_sources import label_of
from lvnav_trade.quantities.records import Bools, Floats, Ints
from lvnav_trade.scenario.filter_models import solves
from lvnav_trade.sensors.family import RECEIVER_SOLUTION, fill, measure
from lvnav_trade.sensors.imu_difference import ImuDifferenceCard
from lvnav_trade.sensors.jacobian_row import N_ENTRY
from lvnav_trade.simulation.epoch.filter_case import case_of
from lvnav_trade.simulation.montecarlo import Truth
from lvnav_trade.simulation.preparation.correlated import RECORDED
from lvnav_trade.simulation.preparation.prepare import Prepared
from lvnav_trade.simulation.preparation.signals.noise import rate_sigma_of
from lvnav_trade.simulation.run_arrays import Work, new_work
from lvnav_trade.simulation.sensing import begin, measure_sensors, observe

_EPOCHS = 24
_OF_SENSOR = 8
"""Number of additional epochs for a sensor that measures at few of the others."""


class EpochDraws(NamedTuple):
    """Draws of runs at some epochs.

    start : (n_run, 2) m, m/s. Initial clock bias and drift.
    steps : (n_run, n_epoch, 2) m, m/s. Noise of the clock steps.
    shared : (n_run, 1 + n_epoch, n_component) SI. Correlated measurement errors, at the start and at the epochs.
    white : White measurement noise by source, in sigmas of its card.
    """

    start: Floats
    steps: Floats
    shared: Floats
    white: dict[str, Floats]


def of_measurements(prepared: Prepared, seed: int) -> list[CheckResult]:
    """Return the checks of the receiver's clock, of correlated measurement errors, and of white noise."""
    if not prepared.t_epoch.size or not prepared.model.aided:
        return []
    draws = _simulate_draws(prepared, seed)
    checks = []
    if _has_ranges(prepared) and prepared.channels.receiver:
        checks += _clock_checks(prepared, draws)
    checks += _family_checks(prepared, draws)
    for name, z in draws.white.items():
        checks += moments(name, z)
    return checks


def _family_checks(prepared: Prepared, draws: EpochDraws) -> list[CheckResult]:
    """Return the checks of correlated measurement errors: at the start, and after a correlation time."""
    checks: list[CheckResult] = []
    first, interval = 0, prepared.signals.interval
    for family in prepared.families:
        components = slice(first, first + len(family.labels))
        first = components.stop
        if family.kind == RECORDED:
            continue
        z = draws.shared[:, :, components] / family.sigma
        z_start = z[:, 0]
        name = label_of(family.source)
        checks += moments(name, z_start, "at the start")
        if math.isfinite(family.time_constant):
            last = z.shape[1] - 1
            n_epoch = round(family.time_constant / interval)
            lag = min(last, max(1, n_epoch))
            z_later = z[:, lag]
            seconds = lag * interval
            expected = 0.0
            if family.time_constant > 0.0:
                expected = math.exp(-seconds / family.time_constant)
            checks += moments(name, z_later, f"after {seconds:.3g} s")
            checks.append(correlation(name, z_start, z_later, expected, seconds))
    return checks


def _has_ranges(prepared: Prepared) -> bool:
    """Return whether ranges are drawn, for the filter or for the receiver's solution."""
    return bool(prepared.model.tight or solves(prepared.scenario))


def _clock_checks(prepared: Prepared, draws: EpochDraws) -> list[CheckResult]:
    """Return the checks of the receiver's clock: start, and steps of bias and drift."""
    card = prepared.scenario.receiver.clock
    q11, _, q22 = step_covariance(prepared.signals.interval, card.h0, card.h_minus2)
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


def _checked_epochs(prepared: Prepared) -> Ints:
    """Return epochs over the flight, with some of each sensor; without frozen epochs."""

    def spread(epochs: Ints, count: int) -> Ints:
        if not epochs.size:
            return epochs
        last = epochs.size - 1
        places = np.linspace(0, last, count).astype(int)
        return epochs[places]

    is_live = ~prepared.signals.frozen
    live_epochs = np.flatnonzero(is_live)
    chosen = [spread(live_epochs, _EPOCHS)]
    for device in prepared.devices:
        sensor_epochs = np.flatnonzero(device.on & is_live)
        chosen.append(spread(sensor_epochs, _OF_SENSOR))
    return np.unique(np.concatenate(chosen))


def _nominal_epochs(prepared: Prepared) -> Bools:
    """Return whether no fault increases the noise at the epochs, (n_epoch,)."""
    is_nominal = np.ones(prepared.t_epoch.size, dtype=np.bool_)
    faults = prepared.scenario.faults
    course = prepared.trajectory.course
    for _, _, is_degraded, *_ in active(faults, DegradedNoise, course, prepared.t_epoch):
        is_nominal &= ~is_degraded
    return is_nominal


def _simulate_draws(prepared: Prepared, seed: int) -> EpochDraws:
    """Simulate receiver and sensors of some runs at some epochs of the nominal flight, and return their draws."""
    signals = prepared.signals
    interval = signals.interval
    key = seed_words(seed)
    epochs = _checked_epochs(prepared)
    n_epoch = epochs.size
    is_nominal = _nominal_epochs(prepared)
    has_ranges = _has_ranges(prepared)
    work, parts = new_work(prepared, lanes=False)
    truth = Truth(prepared.unit, prepared.start, prepared.record)
    start_case = case_of(prepared)
    # ranges also if the receiver computes a solution from them, which itself draws nothing
    model = prepared.model._replace(tight=has_ranges)
    case = case_of(prepared, model=model)
    exact = {epoch: _innovations(prepared, work, epoch, exact=True) for epoch in epochs.tolist()}
    n_shared = signals.shared.start.size
    start = np.empty((RUNS, 2))
    steps = np.empty((RUNS, n_epoch, 2))
    shared = np.zeros((RUNS, 1 + n_epoch, n_shared))
    white = defaultdict[str, list[Floats]](list)
    for run in range(RUNS):
        work.run[0] = run
        begin(work, parts.units, start_case, truth, key)
        start[run] = work.clock
        shared[run, 0] = work.shared[:n_shared]
        for k, epoch in enumerate(epochs.tolist()):
            bias, drift = work.clock
            jump = signals.clock_jump[epoch]
            observe(work, parts, case, None, key, epoch)
            measure_sensors(work, parts.units, prepared.sensors, None, signals, key, epoch)
            bias += interval * drift + jump[0]
            drift += jump[1]
            steps[run, k] = work.clock - (bias, drift)
            shared[run, k + 1] = work.shared[:n_shared]
            if is_nominal[epoch] and prepared.channels.receiver:
                _add_receiver(white, prepared, work, epoch, has_ranges)
                _add_phases(white, prepared, work, parts.previous_observables, epoch)
            for name, (z, sigma) in _innovations(prepared, work, epoch).items():
                exact_z, _ = exact[epoch][name]
                white[name].append(_normalised(z - exact_z, sigma))
    joined = {name: np.concatenate(draws) for name, draws in white.items()}
    return EpochDraws(
        start=start,
        steps=steps,
        shared=shared,
        white={name: z for name, z in joined.items() if z.size},
    )


def _normalised(error: Floats, sigma: Floats) -> Floats:
    """Return errors (n,) over their sigmas, where these are positive."""
    has_noise = sigma > 0.0
    return error[has_noise] / sigma[has_noise]


def _shared_errors(prepared: Prepared, work: Work, epoch: int, channels: Ints) -> Floats:
    """Return the sum of the correlated errors in measured channels (n,) at an epoch."""
    shared = prepared.signals.shared
    if not shared.member.size:
        return np.zeros(channels.size)
    member = shared.member[:, channels]
    is_member = member >= 0
    component = np.maximum(member, 0)
    values = np.where(is_member, work.shared[component], 0.0)
    partial = shared.partial[:, epoch, channels]
    return np.asarray(np.sum(partial * values, axis=0))


def _add_receiver(white: dict[str, list[Floats]], prepared: Prepared, work: Work, epoch: int, ranges: bool) -> None:
    """Append the white noise of the receiver's measurements, in sigmas of its card (or of its tracking loops)."""
    if ranges:
        _add_ranges(white, prepared, work, epoch)
        return
    signals = prepared.signals
    card = prepared.scenario.receiver
    assert isinstance(card.solution, DirectSolution)
    true = np.concatenate([signals.position[epoch], signals.velocity[epoch]])
    lasting = _shared_errors(prepared, work, epoch, np.arange(6))
    error = work.solution - true - lasting
    time = prepared.sky.t[epoch : epoch + 1]
    noise_factors = factors(card.noise_by, RECEIVER_SOLUTION, prepared.trajectory, time)
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


def _add_ranges(white: dict[str, list[Floats]], prepared: Prepared, work: Work, epoch: int) -> None:
    """Append the white noise of pseudoranges and range rates, in sigmas of the card (or of the tracking loops)."""
    signals = prepared.signals
    sky = prepared.sky
    n_kind = prepared.model.n_kind
    n_used = signals.n_used[epoch]
    satellites = signals.used[epoch, :n_used]
    rate_sigma = rate_sigma_of(prepared.scenario, sky, prepared.trajectory)
    for k, (name, true, sigma) in enumerate(
        (
            ("pseudorange noise", signals.range, sky.range_sigma),
            ("range-rate noise", signals.rate, rate_sigma),
        )
    ):
        measured = work.ranges[: satellites.size, k]
        channels = n_kind * satellites + k
        error = measured - true[epoch, satellites] - work.clock[k]
        error -= _shared_errors(prepared, work, epoch, channels)
        white[name].append(_normalised(error, sigma[epoch, satellites]))


def _add_phases(
    white: dict[str, list[Floats]], prepared: Prepared, work: Work, last: Floats | None, epoch: int
) -> None:
    """Append the white noise of the receiver's carrier phases, in their sigmas.

    last : (n_sat, n_kind), phases with which differences are formed
    """
    signals = prepared.signals
    further = prepared.options.further
    n_kind = prepared.model.n_kind
    if further is None or last is None:
        return
    n_used = signals.n_used[epoch]
    satellites = signals.used[epoch, :n_used]
    sigma = prepared.sky.phase_sigma[epoch, satellites]
    for observable in np.flatnonzero(further.is_phase):
        if further.is_difference[observable]:
            measured = last[satellites, observable]
        else:
            measured = work.ranges[: satellites.size, observable]
        channels = n_kind * satellites + observable
        true = further.phase[epoch, satellites]
        error = measured - true - work.clock[0]
        error = error - _shared_errors(prepared, work, epoch, channels)
        white["carrier-phase noise"].append(_normalised(error, sigma))


def _innovations(prepared: Prepared, work: Work, epoch: int, exact: bool = False) -> dict[str, tuple[Floats, Floats]]:
    """Return innovations at the truth, minus lasting errors, and noise sigmas (n_scalar,) of the sensors at an epoch.

    The result is by noise source. exact : whether measurements have no error
    """
    by_source = {}
    signals = prepared.signals
    H = np.zeros((4, N_ENTRY))
    z = np.zeros(4)
    no_error = np.zeros(prepared.layout.n_state)
    for k, device in enumerate(prepared.devices):
        if not device.on[epoch] or isinstance(device.card, ImuDifferenceCard):  # their noise is that of the IMUs
            continue
        sensors = prepared.sensors
        n = len(device.channels.labels)
        assert sensors is not None  # the case has this sensor
        code = sensors.code[k]
        observed = work.observed[k]
        if exact:
            measure(observed, code, sensors.truth[k, epoch], 0.0, 0.0, 0.0)
        time_of_validity = prepared.t_epoch[epoch] - device.delay[epoch]
        tick = tick_at(prepared, time_of_validity)
        nav = navigation_at(prepared, tick, no_error)
        fill(H, z, 0, code, observed, nav, sensors.theta[k, epoch], sensors.known[k, epoch])
        channels = np.arange(n) + sensors.channel[k] + signals.shift
        lasting = np.zeros(n) if exact else _shared_errors(prepared, work, epoch, channels)
        by_source[device.noise] = (z[:n] - lasting, device.sigma[epoch, :n])
    return by_source
