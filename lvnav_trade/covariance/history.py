"""Linear covariance of a case on its nominal flight: formal covariance, true covariance, and error budget by source."""

import numpy as np

from lvnav_trade.covariance.adjoint import BackwardMetrics, BackwardPass, run_backward
from lvnav_trade.covariance.components import build_components
from lvnav_trade.covariance.forward import expected_nees, false_rejection
from lvnav_trade.covariance.forward_pass import linear_case, run_pass
from lvnav_trade.covariance.injection_covariance import injection_law, injection_rows
from lvnav_trade.covariance.outputs import append_outputs, append_sample_outputs, append_solution_outputs
from lvnav_trade.covariance.segments import complete_outputs, has_uncorrected_outputs, output_case
from lvnav_trade.covariance.sources import n_joint, source_labels
from lvnav_trade.covariance.workspace import (
    PassResults,
    UpdateTape,
    new_backward_scratch,
    new_tape,
    row_width,
)
from lvnav_trade.filter.policies.integrity.state import fault_decisions
from lvnav_trade.kernels.transition import ATT, POS, VEL
from lvnav_trade.quantities.errors import InputError, Mistake
from lvnav_trade.quantities.frames import matrices
from lvnav_trade.quantities.records import (
    AdjointBudget,
    CovHistory,
    Floats,
    InjectionLaw,
    Ints,
)
from lvnav_trade.simulation.epoch.joint import NominalFlight
from lvnav_trade.simulation.preparation.prepare import PreparedCase
from lvnav_trade.trajectory.guided.guidance_plan import GuidancePlan, steering_times
from lvnav_trade.trajectory.guided.sensitivity import sensitivity

N_MOTION = 9  # attitude, velocity and position


def covariance(prepared_case: PreparedCase) -> CovHistory:
    """Return formal and true covariance of a case over its nominal flight.

    Parameters
    ----------
    prepared_case
        Prepared case.

    Returns
    -------
    CovHistory
        At the history times: formal sigma (filter model), true sigma and mean of the estimation error, error budget by
        source, expected NEES and NIS.

    Notes
    -----
    The gains of the filter follow from its own models. With these gains, the true covariance is the exact sum of the
    contributions of independent error sources, and deterministic errors are propagated as the mean.
    """
    components = build_components(prepared_case)
    no_tape = new_tape(0, 0, n_joint(prepared_case), row_width(prepared_case))
    tape = no_tape if prepared_case.plan is None else _whole_tape(prepared_case)
    outcome = run_pass(prepared_case, components, tape)
    _refuse_unbounded(prepared_case, outcome.results.formal)
    results, monitor, _ = complete_outputs(prepared_case, components, no_tape, outcome)
    history = _history(prepared_case, results)
    history = append_sample_outputs(prepared_case, components, history, results)
    history = append_solution_outputs(prepared_case, history, results)
    if prepared_case.plan is not None:
        injection = _injection(prepared_case, prepared_case.plan, tape, results)
        history = history._replace(injection=injection)
    if monitor is not None:
        decisions = fault_decisions(monitor.fault_type[None], monitor.is_excluded[None], prepared_case.t_epoch, 0)
        history = history._replace(decisions=decisions)
    if prepared_case.options.backup is None:
        return history
    unaided_outcome = run_pass(prepared_case, components, no_tape, has_aiding=False)
    return _append_backup(prepared_case, history, unaided_outcome.results)


def _append_backup(prepared_case: PreparedCase, history: CovHistory, unaided_results: PassResults) -> CovHistory:
    """Append the outputs of the backup strapdown to a history.

    The backup strapdown does not depend on measurements, so its covariance is that of a pass without them.

    Parameters
    ----------
    prepared_case
        Prepared case.
    history
        History to extend.
    unaided_results
        Results of the pass without measurements.
    """
    motion = slice(0, N_MOTION)
    turn = reporting_rotations(prepared_case)[:, motion, motion]
    turn_back = np.swapaxes(turn, 1, 2)
    budget = unaided_results.budget[:, :, motion]
    formal = turn @ unaided_results.formal[:, motion, motion] @ turn_back
    total = turn @ unaided_results.true[:, motion, motion] @ turn_back
    mean = np.einsum("hij,hj->hi", turn, unaided_results.mean[:, motion])
    return append_outputs(history, budget, mean, formal, total)


def _refuse_unbounded(prepared_case: PreparedCase, formal: Floats) -> None:
    """Raise InputError if no H-infinity filter bounds the required errors; formal (n_hist, n, n)."""
    is_unbounded = ~np.isfinite(formal).all(axis=(1, 2))
    if prepared_case.scenario.filter.h_infinity is not None and is_unbounded.any():
        first_unbounded = np.argmax(is_unbounded)
        time_text = f"{prepared_case.t_hist[first_unbounded]:g} s"
        message = (
            f"no filter bounds errors of these sizes within this time: from {time_text} on the covariance has no end"
        )
        raise InputError(records=[Mistake(message, "filter.h_infinity.time")])


def forward_tape(prepared_case: PreparedCase, has_aiding: bool = True) -> UpdateTape:
    """Return the tape of a forward pass, for a backward pass or an observability analysis.

    Parameters
    ----------
    prepared_case
        Prepared case.
    has_aiding
        Whether measurements are processed.
    """
    tape = _whole_tape(prepared_case)
    components = build_components(prepared_case)
    run_pass(prepared_case, components, tape, has_aiding)
    return tape


def _whole_tape(prepared_case: PreparedCase) -> UpdateTape:
    """Return an empty tape for a whole flight."""
    model = prepared_case.model
    per_satellite = model.n_observable if model.tight else 0
    n_sensor = sum(len(device.channels.labels) for device in prepared_case.devices)
    # upper bound by epoch: a solution has six scalars, and further sensors may add six
    n_receiver = np.maximum(6, per_satellite * prepared_case.signals.n_used)
    n_update = int(np.sum(n_receiver + n_sensor + 6)) + 1
    n_window = prepared_case.schedule.n_tick.size
    n_tick = 0
    if prepared_case.options.vehicle is not None:
        n_tick = prepared_case.reference.dtheta.shape[0]
    return new_tape(n_window, n_update, n_joint(prepared_case), row_width(prepared_case), n_tick)


def _injection(prepared_case: PreparedCase, plan: GuidancePlan, tape: UpdateTape, results: PassResults) -> InjectionLaw:
    """Return the linear covariance of the injection of a guided ascent, from tape and results of a forward pass."""
    if has_uncorrected_outputs(prepared_case):
        return InjectionLaw("a mode logic decides when the outputs of the open loop are corrected")
    steering_period = steering_times(plan, prepared_case.t_hist)
    derivatives = sensitivity(plan, prepared_case.t_hist[steering_period])
    if derivatives.reason:
        return InjectionLaw(derivatives.reason)
    rows = injection_rows(derivatives)
    hist_indices = np.flatnonzero(rows.any(axis=(1, 2)))  # without a sensitivity a time adds nothing
    bin_seconds = _whole_flight(prepared_case)
    _, contribution = _run_backward(prepared_case, hist_indices, rows[hist_indices], bin_seconds, tape)
    variance = contribution.sum(axis=2)
    mean = results.mean[steering_period, :N_MOTION]
    return injection_law(derivatives, source_labels(prepared_case), variance, mean)


def _whole_flight(prepared_case: PreparedCase) -> float:
    """Return a bin length (s) with which one bin covers the whole flight."""
    return float(np.ptp(prepared_case.t_hist)) + 1.0


def empty_tape(prepared_case: PreparedCase) -> UpdateTape:
    """Return the tape of a flight without updates."""
    n_window = prepared_case.schedule.n_tick.size
    return new_tape(n_window, 1, n_joint(prepared_case), row_width(prepared_case))


def compile_backward(prepared_case: PreparedCase) -> None:
    """Compile the backward pass, or load it from the cache, by a pass over the first window of an empty tape."""
    first_time = float(prepared_case.t_hist[0])
    adjoint(prepared_case, first_time, tape=empty_tape(prepared_case))


def reporting_rotations(prepared_case: PreparedCase) -> Floats:
    """Return the rotations (n_hist, n, n) of the reported error states to the reporting axes at the history times.

    Attitude is reported in body axes, velocity and position in the reporting frame, other states as they are.
    """
    n = len(prepared_case.layout.reported_states)
    record = prepared_case.record
    attitude = slice(ATT, ATT + 3)
    velocity = slice(VEL, VEL + 3)
    position = slice(POS, POS + 3)
    further = range(N_MOTION, n)
    turn = np.zeros((prepared_case.t_hist.size, n, n))
    turn[:, attitude, attitude] = np.swapaxes(matrices(record.q), 1, 2)
    turn[:, velocity, velocity] = record.axes
    turn[:, position, position] = record.axes
    turn[:, further, further] = 1.0
    return turn


def adjoint(
    prepared_case: PreparedCase, time: float, bin_seconds: float = 10.0, tape: UpdateTape | None = None
) -> AdjointBudget:
    """Return the contribution of each error source to the navigation errors at a time, by the time of its origin.

    Parameters
    ----------
    prepared_case
        Prepared case.
    time
        s since lift-off. The nearest history time is used (events are history times).
    bin_seconds
        s. Length of the time bins over which contributions are summed.
    tape
        Tape of the forward pass, of `forward_tape`; None: computed here.

    Returns
    -------
    AdjointBudget
        Variance by output, source and time bin; the outputs of a backup strapdown, if the case has one, are the last.
    """
    hist = int(np.argmin(np.abs(prepared_case.t_hist - time)))
    hist_indices = np.array([hist])
    rows = reporting_rotations(prepared_case)[None, hist, :N_MOTION]
    edges, contribution = _run_backward(prepared_case, hist_indices, rows, bin_seconds, tape)
    outputs = prepared_case.outputs[:N_MOTION]
    backup = prepared_case.options.backup
    if backup is not None:
        unaided_tape = forward_tape(prepared_case, has_aiding=False)
        _, unaided_contribution = _run_backward(prepared_case, hist_indices, rows, bin_seconds, unaided_tape)
        contribution = np.concatenate([contribution, unaided_contribution])
        backup_outputs = prepared_case.outputs[backup : backup + N_MOTION]
        outputs = (*outputs, *backup_outputs)
    event_time = float(prepared_case.t_hist[hist])
    return AdjointBudget(event_time, edges, source_labels(prepared_case), outputs, contribution)


def source_covariances(prepared_case: PreparedCase, time: float, tape: UpdateTape | None = None) -> Floats:
    """Return the true covariances of attitude, velocity and position at a time by source, in the reporting axes.

    Parameters
    ----------
    prepared_case, time, tape
        As in `adjoint`.

    Returns
    -------
    ndarray
        (n_source, 3, 3, 3) SI squared; (n_source, 6, 3, 3) with those of a backup strapdown as the last three.

    Notes
    -----
    The backward pass gives variances. Covariances follow from those of sums: Cov(x, y) = (Var(x + y) - Var x - Var y)
    / 2.
    """
    covariances = _motion_covariances(prepared_case, time, tape)
    if prepared_case.options.backup is None:
        return covariances
    unaided_tape = forward_tape(prepared_case, has_aiding=False)
    unaided_covariances = _motion_covariances(prepared_case, time, unaided_tape)
    return np.concatenate([covariances, unaided_covariances], axis=1)


def _motion_covariances(prepared_case: PreparedCase, time: float, tape: UpdateTape | None) -> Floats:
    """Return the true covariances of attitude, velocity and position by source at a time, (n_source, 3, 3, 3) SI.

    Parameters
    ----------
    prepared_case
        Prepared case.
    time
        s since lift-off. The nearest history time is used.
    tape
        Tape of the forward pass; None: computed here.
    """
    hist = int(np.argmin(np.abs(prepared_case.t_hist - time)))
    errors = reporting_rotations(prepared_case)[hist, :N_MOTION]
    pairs = []
    for x in (ATT, VEL, POS):
        y = x + 1
        z = x + 2
        pairs += [(x, y), (x, z), (y, z)]
    sums = [errors[i] + errors[j] for i, j in pairs]
    rows = np.vstack([errors, sums])
    bin_seconds = _whole_flight(prepared_case)
    _, contribution = _run_backward(prepared_case, np.array([hist]), rows[None], bin_seconds, tape)
    variance = contribution.sum(axis=2)
    n_source = variance.shape[1]
    diagonal = range(N_MOTION)
    P = np.zeros((n_source, N_MOTION, N_MOTION))
    P[:, diagonal, diagonal] = variance[:N_MOTION].T
    for row, (i, j) in enumerate(pairs, start=N_MOTION):
        covariance_of_pair = 0.5 * (variance[row] - variance[i] - variance[j])
        P[:, i, j] = covariance_of_pair
        P[:, j, i] = covariance_of_pair
    blocks = []
    for first in (ATT, VEL, POS):
        axes = slice(first, first + 3)
        blocks.append(P[:, axes, axes])
    return np.stack(blocks, axis=1)


def _run_backward(
    prepared_case: PreparedCase, hist: Ints, rows: Floats, bin_seconds: float, tape: UpdateTape | None
) -> tuple[Floats, Floats]:
    """Run a backward pass.

    Parameters
    ----------
    prepared_case
        Prepared case.
    hist
        (n_sum,). History times of the errors in the sums, ascending.
    rows
        (n_sum, n_row, n). Weights of the first n joint states at each of these times.
    bin_seconds
        s. Length of the time bins.
    tape
        Tape of the forward pass; None: computed here.

    Returns
    -------
    edges
        (n_bin + 1,) s since lift-off. Edges of the bins.
    variance
        (n_row, n_source, n_bin) SI squared. Variance of the linear sums of errors.
    """
    components = build_components(prepared_case)
    schedule = prepared_case.schedule
    if has_uncorrected_outputs(prepared_case):
        event_case = output_case(prepared_case, components, int(hist[-1]))
        tape = tape if event_case is prepared_case else forward_tape(event_case)
    tape = tape or forward_tape(prepared_case)
    last_window = int(np.flatnonzero(schedule.hist == hist[-1])[0])
    # a window belongs to the bin of its end; a nanosecond allows for rounding of times on an edge
    end_ticks = schedule.first_tick + schedule.n_tick
    ends = prepared_case.reference.t[end_ticks]
    edges = np.arange(prepared_case.t_hist[0], ends[last_window] + bin_seconds, bin_seconds)
    n_bin = edges.size - 1
    time_bins = np.searchsorted(edges, ends - 1e-9, side="right") - 1
    time_bins = np.clip(time_bins, 0, n_bin - 1)
    n_row = rows.shape[1]
    n = n_joint(prepared_case)
    backward_pass = BackwardPass(
        e=np.zeros((n_row, n)),
        c=np.zeros((n_row, components.source.size)),
        contribution=np.zeros((n_row, components.group.size, n_bin)),
    )
    row_index = np.full(prepared_case.t_hist.size, -1)
    row_index[hist] = np.arange(len(hist))
    n_further = n - rows.shape[2]  # receiver errors and clones, which no metric has
    weights = np.pad(np.array(rows, dtype=np.float64), ((0, 0), (0, 0), (0, n_further)))
    metrics = BackwardMetrics(row_index, weights)
    flight = NominalFlight(prepared_case.unit, prepared_case.reference, prepared_case.chain, None)
    scratch = new_backward_scratch(prepared_case, components)
    case = linear_case(prepared_case)
    run_backward(backward_pass, scratch, tape, components, case, flight, metrics, time_bins)
    return edges, backward_pass.contribution


def _history(prepared_case: PreparedCase, results: PassResults) -> CovHistory:
    """Return the history of a forward pass, rotated to the reporting axes."""
    reported_states = np.array(prepared_case.layout.reported_states)
    m = prepared_case.layout.n_estimated
    formal = results.formal
    true = results.true
    mean = results.mean
    budget = results.budget
    if reported_states.size < prepared_case.layout.n_state:
        rows = reported_states[:, None]
        formal = np.ascontiguousarray(formal[:, rows, reported_states])
        true = np.ascontiguousarray(true[:, rows, reported_states])
        mean = mean[:, reported_states]
        budget = budget[:, :, reported_states]
    total = true + mean[:, :, None] * mean[:, None, :]  # second moment of the true error
    nees = expected_nees(formal[:, :m, :m], total[:, :m, :m])
    turn = reporting_rotations(prepared_case)
    turn_back = np.swapaxes(turn, 1, 2)
    formal = turn @ formal @ turn_back
    true = turn @ true @ turn_back
    diagonal = range(reported_states.size)
    formal_variance = formal[:, diagonal, diagonal]
    true_variance = true[:, diagonal, diagonal]
    return CovHistory(
        t=prepared_case.t_hist,
        formal_sigma=np.sqrt(formal_variance),
        true_sigma=np.sqrt(np.maximum(0.0, true_variance)),
        mean=np.einsum("hij,hj->hi", turn, mean),
        sources=source_labels(prepared_case),
        budget=budget,
        formal_cov=formal,
        true_cov=true,
        t_epoch=prepared_case.t_epoch,
        n_row=results.n_row.astype(np.int32),
        expected_nees=nees,
        expected_nis=results.expected_nis,
        false_rejection=false_rejection(prepared_case.model.gate_squared, results.expected_row_nis),
        expected_row_nis=results.expected_row_nis,
    )
