"""Checks of the error states: a known error is found and removed, and is propagated linearly over every gap."""

import numpy as np

from lvnav_trade.covariance.diagnostics.confirming_runs import gaps
from lvnav_trade.covariance.diagnostics.nonlinearity import Nonlinearity, nonlinearity
from lvnav_trade.covariance.diagnostics.perturbed_estimate import navigation
from lvnav_trade.covariance.history import reporting_rotations
from lvnav_trade.covariance.selfcheck.check import CheckResult
from lvnav_trade.filter.ekf import correct
from lvnav_trade.filter.policies.imu_samples import correct_vehicle
from lvnav_trade.quantities.records import CovHistory, Floats
from lvnav_trade.quantities.state_layout import state_names, state_outputs
from lvnav_trade.simulation.epoch.filter_case import OptionalState, case_of
from lvnav_trade.simulation.preparation.prepare import PreparedCase
from lvnav_trade.simulation.recording import record
from lvnav_trade.simulation.run_arrays import Work, new_work

SIZE = {"attitude": 1e-3, "velocity": 1.0, "position": 100.0}
"""Errors that are applied (rad, m/s, m); for any other state, its unit."""
TOLERANCE = 1e-6
"""Largest relative deviation: rounding of positions, and second order of a rotation of a milliradian."""


def sizes(prepared_case: PreparedCase) -> Floats:
    """Return the error (n_state,) that is applied to each state, SI."""
    outputs = state_outputs(prepared_case.layout, prepared_case.scenario.frame)
    state_errors = []
    for output in outputs:
        unit = 1.0 / output.label_factor
        state_errors.append(SIZE.get(output.quantity, unit))
    return np.array(state_errors)


def round_trip(prepared_case: PreparedCase) -> list[CheckResult]:
    """Return a check for each quantity of the filter's state, at start, middle and end of the flight.

    A given error is applied, recorded as in runs, fed back by the filter, and recorded again. Figures are relative to
    the error.
    """
    work, optional_state = new_work(prepared_case, uses_lanes=False)
    size = sizes(prepared_case)
    names = state_names(prepared_case.layout)
    turn = reporting_rotations(prepared_case)
    reported_states = np.array(prepared_case.layout.reported_states)
    n_hist = prepared_case.t_hist.size
    worst: dict[str, tuple[float, str]] = {}
    for hist in sorted({0, n_hist // 2, n_hist - 1}):
        turn_back = turn[hist].T
        for state in reported_states.tolist():
            d = np.zeros(prepared_case.layout.n_state)
            d[state] = size[state]
            _apply_error(prepared_case, work, optional_state, hist, d)
            error = np.zeros_like(d)
            residual = np.zeros_like(d)
            error[reported_states] = turn_back @ _recorded_error(prepared_case, work, optional_state, hist)
            _feed_back(prepared_case, work, optional_state, error)
            residual[reported_states] = turn_back @ _recorded_error(prepared_case, work, optional_state, hist)
            recorded_deviation = np.abs((error - d) / size).max()
            residual_deviation = np.abs(residual / size).max()
            deviation = float(max(recorded_deviation, residual_deviation))
            name = names[state]
            quantity, _, _ = name.partition(" ")
            largest, _ = worst.get(quantity, (-1.0, ""))
            if not deviation <= largest:  # also if the deviation is not a number
                worst[quantity] = (deviation, f"{name} at {prepared_case.t_hist[hist]:g} s")
    return [
        CheckResult("error definition", quantity, deviation, upper_limit=TOLERANCE, remark=remark)
        for quantity, (deviation, remark) in worst.items()
    ]


def _tick(prepared_case: PreparedCase, hist: int) -> int:
    """Return the last tick before a history time."""
    tick_after = int(prepared_case.hist_tick[hist])
    return max(0, tick_after - 1)


def _apply_error(prepared_case: PreparedCase, work: Work, optional_state: OptionalState, hist: int, d: Floats) -> None:
    """Set the estimate of a run to the truth minus an error; true parameters, clock and correlated errors are zero.

    Parameters
    ----------
    prepared_case
        Prepared case.
    work, optional_state
        Arrays of the run, set here.
    hist
        Index of the history time.
    d
        (n_state,) SI. Error, truth minus estimate, frame i.
    """
    model = prepared_case.model
    truth = prepared_case.record
    vehicle = prepared_case.options.vehicle
    q = truth.q[hist]
    v = truth.v[hist]
    r = truth.r[hist]
    work.nav[:] = navigation(q, v, r, d)
    work.P[:] = np.eye(model.n_state)
    for block, offset in enumerate(model.par_offset):
        work.par[block] = -d[offset : offset + 3]
    if model.clock >= 0:
        clock_states = slice(model.clock, model.clock + 2)
        work.clock_hat[:] = -d[clock_states]
    for extra, offset in enumerate(model.extra_offset):
        work.extra[extra] = -d[offset]
    if vehicle is not None:
        tick = _tick(prepared_case, hist)
        first_rate = vehicle.motion
        first_force = vehicle.motion + 3
        rate_error = d[first_rate : first_rate + 3]
        force_error = d[first_force : first_force + 3]
        optional_state.motion.rate[:] = vehicle.rate[tick] - rate_error
        optional_state.motion.force[:] = vehicle.force[tick] - force_error


def _recorded_error(prepared_case: PreparedCase, work: Work, optional_state: OptionalState, hist: int) -> Floats:
    """Return the error that a run records, (n_reported,) SI, in reporting axes.

    Parameters
    ----------
    prepared_case
        Prepared case.
    work, optional_state
        Arrays of the run.
    hist
        Index of the history time.
    """
    options = prepared_case.options._replace(reported_samples=None, reported_solution=None, backup=None)
    states_only = case_of(prepared_case, options=options)
    optional_state = OptionalState(units=optional_state.units, motion=optional_state.motion)
    tick = _tick(prepared_case, hist)
    record(work, optional_state, states_only, None, prepared_case.record, tick, hist)
    n_reported = len(prepared_case.layout.reported_states)
    return np.array(work.err[hist, :n_reported])


def _feed_back(prepared_case: PreparedCase, work: Work, optional_state: OptionalState, x: Floats) -> None:
    """Feed an error state x (n_state,), frame i, back to the estimate."""
    work.x[:] = x
    correct_vehicle(work, optional_state.motion, prepared_case.model, prepared_case.options.vehicle)
    correct(work, None, None, prepared_case.model)


GAP_TOLERANCE = 0.1
"""Largest deviation of a one-sigma error from its linear propagation over a gap, in sigmas at its end."""
KIND = "propagation"


def propagation(prepared_case: PreparedCase, history: CovHistory, events: dict[str, float]) -> list[CheckResult]:
    """Return a check for every gap without measurements, and one for the update intervals at the events.

    Directions are one-sigma errors of the filter's covariance at the beginning of the gap, propagated with both signs
    by the strapdown and by the filter's transition. Figures are in formal sigmas at the end.

    Parameters
    ----------
    prepared_case
        Prepared case.
    history
        Linear covariance of the case.
    events
        s since lift-off. Times of the events by name.
    """
    if prepared_case.options.vehicle is not None:
        reason = "samples of the IMU are measurements: there is no window without one"
        return [CheckResult(KIND, "transition", reason=reason)]
    formal = history._replace(true_cov=history.formal_cov)
    names = state_names(prepared_case.layout)
    intervals = []
    for gap in gaps(history):
        seconds = gap.end - gap.begin
        intervals.append((f"gap of {seconds:.0f} s", gap.begin, gap.end))
    if not (history.n_row > 0).any():
        start = float(history.t[0])
        end = float(history.t[-1])
        intervals = [("the whole flight, unaided", start, end)]
    checks = []
    for interval, begin, end in intervals:
        result = nonlinearity(prepared_case, formal, begin, end=end)
        deviation = _deviation(result)
        state = names[result.state]
        remark = f"{state}, {begin:g} to {end:g} s"
        checks.append(CheckResult(KIND, interval, deviation, upper_limit=GAP_TOLERANCE, remark=remark))
    event_results = {name: nonlinearity(prepared_case, formal, t) for name, t in events.items()}
    if event_results:
        event = max(event_results, key=lambda name: _deviation(event_results[name]))
        result = event_results[event]
        deviation = _deviation(result)
        state = names[result.state]
        remark = f"{state} at {event}"
        checks.append(CheckResult(KIND, "update interval", deviation, upper_limit=GAP_TOLERANCE, remark=remark))
    return checks


def _deviation(result: Nonlinearity) -> float:
    return max(result.motion, result.transition)
