"""Linear covariance of a case on its nominal flight: formal covariance, true covariance, and error budget by source."""

import numpy as np

from lvnav_trade.covariance.adjoint import BackwardMetrics, BackwardPass, go_back
from lvnav_trade.covariance.components import components
from lvnav_trade.covariance.forward import expected_nees, false_rejection
from lvnav_trade.covariance.forward_pass import linear_case, run_pass
from lvnav_trade.covariance.injection_covariance import injection_law, injection_rows
from lvnav_trade.covariance.outputs import append_outputs, sample_outputs, solution_outputs_of
from lvnav_trade.covariance.segments import case_at, has_uncorrected_outputs, with_outputs
from lvnav_trade.covariance.sources import n_joint, source_labels
from lvnav_trade.covariance.workspace import (
    PassResults,
    UpdateTape,
    new_backward_scratch,
    new_tape,
    row_width,
)
from lvnav_trade.filter.policies.integrity.state import decisions_of
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
from lvnav_trade.simulation.preparation.prepare import Prepared
from lvnav_trade.trajectory.guided.guidance_plan import GuidancePlan, steering_times
from lvnav_trade.trajectory.guided.sensitivity import sensitivity

N_MOTION = 9  # attitude, velocity and position


def covariance(prepared: Prepared) -> CovHistory:
    """Return formal and true covariance of a case over its nominal flight.

    Parameters
    ----------
    prepared
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
    true = components(prepared)
    no_tape = new_tape(0, 0, n_joint(prepared), row_width(prepared))
    tape = no_tape if prepared.plan is None else _whole_tape(prepared)
    passed = run_pass(prepared, true, tape)
    _refuse_unbounded(prepared, passed.out.formal)
    out, monitor, _ = with_outputs(prepared, true, no_tape, passed)
    history = _history(prepared, out)
    history = sample_outputs(prepared, true, history, out)
    history = solution_outputs_of(prepared, history, out)
    if prepared.plan is not None:
        injection = _injection(prepared, prepared.plan, tape, out)
        history = history._replace(injection=injection)
    if monitor is not None:
        decisions = decisions_of(monitor.isolated[None], monitor.excluded[None], prepared.t_epoch, 0)
        history = history._replace(decisions=decisions)
    if prepared.options.backup is None:
        return history
    unaided = run_pass(prepared, true, no_tape, aided=False)
    return _append_backup(prepared, history, unaided.out)


def _append_backup(prepared: Prepared, history: CovHistory, unaided: PassResults) -> CovHistory:
    """Append the outputs of the backup strapdown to a history.

    The backup strapdown does not depend on measurements, so its covariance is that of a pass without them.

    Parameters
    ----------
    prepared
        Prepared case.
    history
        History to extend.
    unaided
        Results of the pass without measurements.
    """
    motion = slice(0, N_MOTION)
    turn = turns(prepared)[:, motion, motion]
    turn_back = np.swapaxes(turn, 1, 2)
    budget = unaided.budget[:, :, motion]
    formal = turn @ unaided.formal[:, motion, motion] @ turn_back
    total = turn @ unaided.true[:, motion, motion] @ turn_back
    mean = np.einsum("hij,hj->hi", turn, unaided.mean[:, motion])
    return append_outputs(history, budget, mean, formal, total)


def _refuse_unbounded(prepared: Prepared, formal: Floats) -> None:
    """Raise InputError if no H-infinity filter bounds the required errors; formal (n_hist, n, n)."""
    is_unbounded = ~np.isfinite(formal).all(axis=(1, 2))
    if prepared.scenario.filter.h_infinity is not None and is_unbounded.any():
        first_unbounded = np.argmax(is_unbounded)
        when = f"{prepared.t_hist[first_unbounded]:g} s"
        message = f"no filter bounds errors of these sizes within this time: from {when} on the covariance has no end"
        raise InputError(records=[Mistake(message, "filter.h_infinity.time")])


def forward_tape(prepared: Prepared, aided: bool = True) -> UpdateTape:
    """Return the tape of a forward pass, for a backward pass or an observability analysis.

    Parameters
    ----------
    prepared
        Prepared case.
    aided
        Whether measurements are processed.
    """
    tape = _whole_tape(prepared)
    true = components(prepared)
    run_pass(prepared, true, tape, aided)
    return tape


def _whole_tape(prepared: Prepared) -> UpdateTape:
    """Return an empty tape for a whole flight."""
    model = prepared.model
    per_satellite = model.n_kind if model.tight else 0
    n_sensor = sum(len(device.channels.labels) for device in prepared.devices)
    # upper bound by epoch: a solution has six scalars, and further sensors may add six
    n_receiver = np.maximum(6, per_satellite * prepared.signals.n_used)
    n_update = int(np.sum(n_receiver + n_sensor + 6)) + 1
    n_window = prepared.schedule.n_tick.size
    n_tick = 0
    if prepared.options.vehicle is not None:
        n_tick = prepared.reference.dtheta.shape[0]
    return new_tape(n_window, n_update, n_joint(prepared), row_width(prepared), n_tick)


def _injection(prepared: Prepared, plan: GuidancePlan, tape: UpdateTape, out: PassResults) -> InjectionLaw:
    """Return the linear covariance of the injection of a guided ascent, from tape and results of a forward pass."""
    if has_uncorrected_outputs(prepared):
        return InjectionLaw("a mode logic decides when the outputs of the open loop are corrected")
    steered = steering_times(plan, prepared.t_hist)
    derivatives = sensitivity(plan, prepared.t_hist[steered])
    if derivatives.why:
        return InjectionLaw(derivatives.why)
    rows = injection_rows(derivatives)
    times = np.flatnonzero(rows.any(axis=(1, 2)))  # without a sensitivity a time adds nothing
    bin_seconds = _whole_flight(prepared)
    _, contribution = _go_back(prepared, times, rows[times], bin_seconds, tape)
    variance = contribution.sum(axis=2)
    mean = out.mean[steered, :N_MOTION]
    return injection_law(derivatives, source_labels(prepared), variance, mean)


def _whole_flight(prepared: Prepared) -> float:
    """Return a bin length (s) with which one bin covers the whole flight."""
    return float(np.ptp(prepared.t_hist)) + 1.0


def empty_tape(prepared: Prepared) -> UpdateTape:
    """Return the tape of a flight without updates."""
    n_window = prepared.schedule.n_tick.size
    return new_tape(n_window, 1, n_joint(prepared), row_width(prepared))


def compile_backward(prepared: Prepared) -> None:
    """Compile the backward pass, or load it from the cache, by a pass over the first window of an empty tape."""
    first_time = float(prepared.t_hist[0])
    adjoint(prepared, first_time, tape=empty_tape(prepared))


def turns(prepared: Prepared) -> Floats:
    """Return the rotations (n_hist, n, n) of the reported error states to the reporting axes at the history times.

    Attitude is reported in body axes, velocity and position in the reporting frame, other states as they are.
    """
    n = len(prepared.layout.reported)
    record = prepared.record
    attitude = slice(ATT, ATT + 3)
    velocity = slice(VEL, VEL + 3)
    position = slice(POS, POS + 3)
    further = range(N_MOTION, n)
    turn = np.zeros((prepared.t_hist.size, n, n))
    turn[:, attitude, attitude] = np.swapaxes(matrices(record.q), 1, 2)
    turn[:, velocity, velocity] = record.axes
    turn[:, position, position] = record.axes
    turn[:, further, further] = 1.0
    return turn


def adjoint(
    prepared: Prepared, time: float, bin_seconds: float = 10.0, tape: UpdateTape | None = None
) -> AdjointBudget:
    """Return the contribution of each error source to the navigation errors at a time, by the time of its origin.

    Parameters
    ----------
    prepared
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
    hist = int(np.argmin(np.abs(prepared.t_hist - time)))
    times = np.array([hist])
    rows = turns(prepared)[None, hist, :N_MOTION]
    edges, contribution = _go_back(prepared, times, rows, bin_seconds, tape)
    outputs = prepared.outputs[:N_MOTION]
    backup = prepared.options.backup
    if backup is not None:
        unaided_tape = forward_tape(prepared, aided=False)
        _, unaided = _go_back(prepared, times, rows, bin_seconds, unaided_tape)
        contribution = np.concatenate([contribution, unaided])
        backup_outputs = prepared.outputs[backup : backup + N_MOTION]
        outputs = (*outputs, *backup_outputs)
    event_time = float(prepared.t_hist[hist])
    return AdjointBudget(event_time, edges, source_labels(prepared), outputs, contribution)


def source_covariances(prepared: Prepared, time: float, tape: UpdateTape | None = None) -> Floats:
    """Return the true covariances of attitude, velocity and position at a time by source, in the reporting axes.

    Parameters
    ----------
    prepared, time, tape
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
    covariances = _motion_covariances(prepared, time, tape)
    if prepared.options.backup is None:
        return covariances
    unaided_tape = forward_tape(prepared, aided=False)
    unaided = _motion_covariances(prepared, time, unaided_tape)
    return np.concatenate([covariances, unaided], axis=1)


def _motion_covariances(prepared: Prepared, time: float, tape: UpdateTape | None) -> Floats:
    """Return the true covariances of attitude, velocity and position by source at a time, (n_source, 3, 3, 3) SI.

    Parameters
    ----------
    prepared
        Prepared case.
    time
        s since lift-off. The nearest history time is used.
    tape
        Tape of the forward pass; None: computed here.
    """
    hist = int(np.argmin(np.abs(prepared.t_hist - time)))
    errors = turns(prepared)[hist, :N_MOTION]
    pairs = []
    for x in (ATT, VEL, POS):
        y = x + 1
        z = x + 2
        pairs += [(x, y), (x, z), (y, z)]
    sums = [errors[i] + errors[j] for i, j in pairs]
    rows = np.vstack([errors, sums])
    bin_seconds = _whole_flight(prepared)
    _, contribution = _go_back(prepared, np.array([hist]), rows[None], bin_seconds, tape)
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


def _go_back(
    prepared: Prepared, hist: Ints, rows: Floats, bin_seconds: float, tape: UpdateTape | None
) -> tuple[Floats, Floats]:
    """Run a backward pass.

    Parameters
    ----------
    prepared
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
    true = components(prepared)
    schedule = prepared.schedule
    if has_uncorrected_outputs(prepared):
        described = case_at(prepared, true, int(hist[-1]))
        tape = tape if described is prepared else forward_tape(described)
    tape = tape or forward_tape(prepared)
    last_window = int(np.flatnonzero(schedule.hist == hist[-1])[0])
    # a window belongs to the bin of its end; a nanosecond allows for rounding of times on an edge
    end_ticks = schedule.first_tick + schedule.n_tick
    ends = prepared.reference.t[end_ticks]
    edges = np.arange(prepared.t_hist[0], ends[last_window] + bin_seconds, bin_seconds)
    n_bin = edges.size - 1
    time_bins = np.searchsorted(edges, ends - 1e-9, side="right") - 1
    time_bins = np.clip(time_bins, 0, n_bin - 1)
    n_row = rows.shape[1]
    n = n_joint(prepared)
    back = BackwardPass(
        e=np.zeros((n_row, n)),
        c=np.zeros((n_row, true.source.size)),
        contribution=np.zeros((n_row, true.group.size, n_bin)),
    )
    place = np.full(prepared.t_hist.size, -1)
    place[hist] = np.arange(len(hist))
    n_further = n - rows.shape[2]  # receiver errors and clones, which no metric has
    weights = np.pad(np.array(rows, dtype=np.float64), ((0, 0), (0, 0), (0, n_further)))
    entering = BackwardMetrics(place, weights)
    flight = NominalFlight(prepared.unit, prepared.reference, prepared.chain, None)
    scratch = new_backward_scratch(prepared, true)
    case = linear_case(prepared)
    go_back(back, scratch, tape, true, case, flight, entering, time_bins)
    return edges, back.contribution


def _history(prepared: Prepared, out: PassResults) -> CovHistory:
    """Return the history of a forward pass, rotated to the reporting axes."""
    reported = np.array(prepared.layout.reported)
    m = prepared.layout.n_estimated
    formal = out.formal
    true = out.true
    mean = out.mean
    budget = out.budget
    if reported.size < prepared.layout.n_state:
        rows = reported[:, None]
        formal = np.ascontiguousarray(formal[:, rows, reported])
        true = np.ascontiguousarray(true[:, rows, reported])
        mean = mean[:, reported]
        budget = budget[:, :, reported]
    total = true + mean[:, :, None] * mean[:, None, :]  # second moment of the true error
    nees = expected_nees(formal[:, :m, :m], total[:, :m, :m])
    turn = turns(prepared)
    turn_back = np.swapaxes(turn, 1, 2)
    formal = turn @ formal @ turn_back
    true = turn @ true @ turn_back
    diagonal = range(reported.size)
    formal_variance = formal[:, diagonal, diagonal]
    true_variance = true[:, diagonal, diagonal]
    return CovHistory(
        t=prepared.t_hist,
        formal=np.sqrt(formal_variance),
        true_sigma=np.sqrt(np.maximum(0.0, true_variance)),
        mean=np.einsum("hij,hj->hi", turn, mean),
        sources=source_labels(prepared),
        budget=budget,
        formal_cov=formal,
        true_cov=true,
        t_epoch=prepared.t_epoch,
        n_row=out.n_row.astype(np.int32),
        expected_nees=nees,
        expected_nis=out.expected_nis,
        false_rejection=false_rejection(prepared.model.gate_squared, out.row_ratio),
        row_ratio=out.row_ratio,
    )
