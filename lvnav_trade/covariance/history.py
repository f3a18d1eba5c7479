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
    true, nothing = components(prepared), new_tape(0, 0, n_joint(prepared), row_width(prepared))
    tape = nothing if prepared.plan is None else _whole_tape(prepared)
    passed = run_pass(prepared, true, tape)
    _refuse_unbounded(prepared, passed.out.formal)
    out, monitor, _ = with_outputs(prepared, true, nothing, passed)
    history = solution_outputs_of(prepared, sample_outputs(prepared, true, _history(prepared, out), out), out)
    if prepared.plan is not None:
        history = history._replace(injection=_injection(prepared, prepared.plan, tape, out))
    if monitor is not None:
        logs = (monitor.isolated[None], monitor.excluded[None])
        history = history._replace(decisions=decisions_of(*logs, prepared.t_epoch, 0))
    if prepared.options.backup is None:
        return history
    # the backup strapdown does not depend on measurements, so its covariance is that of a pass without them
    alone, motion = run_pass(prepared, true, nothing, aided=False).out, slice(0, N_MOTION)
    turn = turns(prepared)[:, motion, motion]
    formal, total = (turn @ P[:, motion, motion] @ np.swapaxes(turn, 1, 2) for P in (alone.formal, alone.true))
    mean = np.einsum("hij,hj->hi", turn, alone.mean[:, motion])
    return append_outputs(history, alone.budget[:, :, motion], mean, formal, total)


def _refuse_unbounded(prepared: Prepared, formal: Floats) -> None:
    """Raise InputError where no H-infinity filter has the errors that are asked for; formal (n_hist, n, n)."""
    lost = ~np.isfinite(formal).all(axis=(1, 2))
    if prepared.scenario.filter.h_infinity is not None and lost.any():
        when = f"{prepared.t_hist[np.argmax(lost)]:g} s"
        message = f"no filter bounds errors of these sizes within this time: from {when} on the covariance has no end"
        raise InputError(records=[Mistake(message, "filter.h_infinity.time")])


def forward_tape(prepared: Prepared, aided: bool = True) -> UpdateTape:
    """Return the tape of a forward pass, for a backward pass or an observability analysis.

    aided : whether measurements are processed
    """
    tape = _whole_tape(prepared)
    run_pass(prepared, components(prepared), tape, aided)
    return tape


def _whole_tape(prepared: Prepared) -> UpdateTape:
    """Return an empty tape for a whole flight."""
    per_satellite = prepared.model.n_kind if prepared.model.tight else 0
    n_sensor = sum(len(device.channels.labels) for device in prepared.devices)
    n_update = int(np.sum(np.maximum(6, per_satellite * prepared.signals.n_used) + n_sensor + 6)) + 1
    sampled = prepared.reference.dtheta.shape[0] if prepared.options.vehicle is not None else 0
    return new_tape(prepared.schedule.n_tick.size, n_update, n_joint(prepared), row_width(prepared), sampled)


def _injection(prepared: Prepared, plan: GuidancePlan, tape: UpdateTape, out: PassResults) -> InjectionLaw:
    """Return the linear covariance of the injection of a guided ascent, from tape and results of a forward pass."""
    if has_uncorrected_outputs(prepared):
        return InjectionLaw("a mode logic decides when the outputs of the open loop are corrected")
    steered = steering_times(plan, prepared.t_hist)
    by_error = sensitivity(plan, prepared.t_hist[steered])
    if by_error.why:
        return InjectionLaw(by_error.why)
    rows = injection_rows(by_error)
    times = np.flatnonzero(rows.any(axis=(1, 2)))
    variance = _go_back(prepared, times, rows[times], _whole(prepared), tape)[1].sum(axis=2)
    return injection_law(by_error, source_labels(prepared), variance, out.mean[steered, :N_MOTION])


def _whole(prepared: Prepared) -> float:
    """Return a bin length (s) with which one bin covers the whole flight."""
    return float(np.ptp(prepared.t_hist)) + 1.0


def empty_tape(prepared: Prepared) -> UpdateTape:
    """Return the tape of a flight without updates."""
    return new_tape(prepared.schedule.n_tick.size, 1, n_joint(prepared), row_width(prepared))


def compile_backward(prepared: Prepared) -> None:
    """Compile the backward pass, or load it from the cache, by a pass over the first window of an empty tape."""
    adjoint(prepared, float(prepared.t_hist[0]), tape=empty_tape(prepared))


def turns(prepared: Prepared) -> Floats:
    """Return the rotations (n_hist, n, n) of the reported error states to the reporting axes at the history times.

    Attitude is reported in body axes, velocity and position in the reporting frame, other states as they are.
    """
    n, record = len(prepared.layout.reported), prepared.record
    turn = np.zeros((prepared.t_hist.size, n, n))
    turn[:, ATT : ATT + 3, ATT : ATT + 3] = np.swapaxes(matrices(record.q), 1, 2)
    turn[:, VEL : VEL + 3, VEL : VEL + 3] = record.axes
    turn[:, POS : POS + 3, POS : POS + 3] = record.axes
    turn[:, range(9, n), range(9, n)] = 1.0
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
    rows, first = turns(prepared)[hist, :N_MOTION], prepared.options.backup
    edges, contribution = _go_back(prepared, np.array([hist]), rows[None], bin_seconds, tape)
    sources, shown = source_labels(prepared), prepared.outputs[:N_MOTION]
    if first is not None:
        alone = _go_back(prepared, np.array([hist]), rows[None], bin_seconds, forward_tape(prepared, aided=False))[1]
        contribution = np.concatenate([contribution, alone])
        shown = (*shown, *prepared.outputs[first : first + N_MOTION])
    return AdjointBudget(float(prepared.t_hist[hist]), edges, sources, shown, contribution)


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
    covariances = _by_source(prepared, time, tape)
    if prepared.options.backup is None:
        return covariances
    return np.concatenate([covariances, _by_source(prepared, time, forward_tape(prepared, aided=False))], axis=1)


def _by_source(prepared: Prepared, time: float, tape: UpdateTape | None) -> Floats:
    """Return the true covariances (n_source, 3, 3, 3) of attitude, velocity and position by source at a time."""
    hist = int(np.argmin(np.abs(prepared.t_hist - time)))
    single = turns(prepared)[hist, :9]
    pairs = [(3 * q + i, 3 * q + j) for q in range(3) for i, j in ((0, 1), (0, 2), (1, 2))]
    rows = np.vstack([single, [single[i] + single[j] for i, j in pairs]])
    variance = _go_back(prepared, np.array([hist]), rows[None], _whole(prepared), tape)[1].sum(axis=2)
    P = np.zeros((variance.shape[1], 9, 9))
    P[:, range(9), range(9)] = variance[:9].T
    for row, (i, j) in enumerate(pairs, start=9):
        P[:, i, j] = P[:, j, i] = 0.5 * (variance[row] - variance[i] - variance[j])
    return np.stack([P[:, at : at + 3, at : at + 3] for at in (ATT, VEL, POS)], axis=1)


def _go_back(
    prepared: Prepared, hist: Ints, rows: Floats, bin_seconds: float, tape: UpdateTape | None
) -> tuple[Floats, Floats]:
    """Run a backward pass; return the bin edges (s) and the variance (n_row, n_source, n_bin) of linear sums of errors.

    hist : (n_sum,). History times of the errors in the sums, ascending.
    rows : (n_sum, n_row, n). Weights of the first n joint states at each of these times.
    """
    true, schedule = components(prepared), prepared.schedule
    if has_uncorrected_outputs(prepared):
        described = case_at(prepared, true, int(hist[-1]))
        tape = tape if described is prepared else forward_tape(described)
    tape = tape or forward_tape(prepared)
    last = int(np.flatnonzero(schedule.hist == hist[-1])[0])
    ends = prepared.reference.t[schedule.first_tick + schedule.n_tick]
    edges = np.arange(prepared.t_hist[0], ends[last] + bin_seconds, bin_seconds)
    bins = np.clip(np.searchsorted(edges, ends - 1e-9, side="right") - 1, 0, edges.size - 2)
    n_row, n = rows.shape[1], n_joint(prepared)
    back = BackwardPass(
        np.zeros((n_row, n)),
        np.zeros((n_row, true.source.size)),
        np.zeros((n_row, true.group.size, edges.size - 1)),
    )
    place = np.full(prepared.t_hist.size, -1)
    place[hist] = np.arange(len(hist))
    entering = BackwardMetrics(
        place, np.pad(np.array(rows, dtype=np.float64), ((0, 0), (0, 0), (0, n - rows.shape[2])))
    )
    flight = NominalFlight(prepared.unit, prepared.reference, prepared.chain, None)
    go_back(back, new_backward_scratch(prepared, true), tape, true, linear_case(prepared), flight, entering, bins)
    return edges, back.contribution


def _history(prepared: Prepared, out: PassResults) -> CovHistory:
    """Return the history of a forward pass, rotated to the reporting axes."""
    reported, m = np.array(prepared.layout.reported), prepared.layout.n_estimated
    n, turn = reported.size, turns(prepared)
    formal, true, mean, budget = out.formal, out.true, out.mean, out.budget
    if n < prepared.layout.n_state:
        formal, true = (np.ascontiguousarray(values[:, reported[:, None], reported]) for values in (formal, true))
        mean, budget = mean[:, reported], budget[:, :, reported]
    total = true + mean[:, :, None] * mean[:, None, :]  # second moment of the true error
    nees = expected_nees(formal[:, :m, :m], total[:, :m, :m])
    formal, true = turn @ formal @ np.swapaxes(turn, 1, 2), turn @ true @ np.swapaxes(turn, 1, 2)
    diagonal = range(n)
    return CovHistory(
        t=prepared.t_hist,
        formal=np.sqrt(formal[:, diagonal, diagonal]),
        true_sigma=np.sqrt(np.maximum(0.0, true[:, diagonal, diagonal])),
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
