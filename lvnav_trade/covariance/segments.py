"""Open loop with a mode logic on its nominal flight: restarts of the filter, and outputs that it does not correct."""

from typing import NamedTuple

import numpy as np

from lvnav_trade.covariance.components import Components
from lvnav_trade.covariance.forward_pass import PassOutcome, run_pass
from lvnav_trade.covariance.outputs import last_epoch
from lvnav_trade.covariance.sources import n_joint
from lvnav_trade.covariance.workspace import PassResults, UpdateTape, new_tape, row_width
from lvnav_trade.filter.policies.mode_logic import PREDICTED
from lvnav_trade.quantities.records import AIDING, CONVERGING, PREDICTING, STOPPED, WAITING, Bools, Floats, Ints
from lvnav_trade.simulation.preparation.prepare import Prepared

_RUNNING = (CONVERGING, AIDING, PREDICTING)  # modes in which the filter runs
_CORRECTING = (AIDING, PREDICTING)  # modes in which the outputs are corrected by the filter's error state


def has_uncorrected_outputs(prepared: Prepared) -> bool:
    """Return whether a mode logic decides when the outputs of an open loop are corrected instead of the INS's own."""
    return prepared.options.rules is not None and prepared.scenario.filter.feedback == "open"


class Segment(NamedTuple):
    """Part of a nominal flight from one start of the filter to the next.

    case : Case whose filter gets no sample before those that start it here.
    first : Epoch of the start.
    passed : Results of a forward pass of this case; they describe the segment.
    mode : (n_epoch,). Mode after each epoch, by the log of this pass.
    """

    case: Prepared
    first: int
    passed: PassOutcome
    mode: Floats


def segments_of(prepared: Prepared, true: Components, passed: PassOutcome) -> list[Segment]:
    """Return the segments of a nominal flight; more than one if the mode logic restarts the filter of an open loop.

    A restart discards all estimates. The error is then that of the inertial system, with all its correlations, as
    before a first start. A restart is therefore computed as the first start of a filter that got no sample before.

    Parameters
    ----------
    prepared
        Prepared case.
    true
        Its error components.
    passed
        Results of a pass of the case itself.
    """
    no_tape = new_tape(0, 0, n_joint(prepared), row_width(prepared))
    mode = _mode_log(prepared, passed)
    starts = _starts(prepared, mode)
    first = int(starts[0]) if starts.size else 0
    segments = [Segment(prepared, first, passed, mode)]
    later = starts[starts > first]
    while later.size:
        first = int(later[0])
        case = _started_at(prepared, first)
        passed = run_pass(case, true, no_tape)
        mode = _mode_log(case, passed)
        segments.append(Segment(case, first, passed, mode))
        starts = _starts(case, mode)
        later = starts[starts > first]
    return segments


def _mode_log(prepared: Prepared, passed: PassOutcome) -> Floats:
    """Return the mode of the filter after each epoch, (n_epoch,); waiting without a mode logic."""
    if passed.mode_state is None:
        return np.full(prepared.t_epoch.size, float(WAITING))
    return passed.mode_state.mode


def _updates(prepared: Prepared) -> Ints:
    """Return the epochs at which the mode logic has a step."""
    interval = prepared.model.every
    return np.arange(interval - 1, prepared.t_epoch.size, interval)


def _last_update(prepared: Prepared) -> Ints:
    """Return the last step of the mode logic up to each history time, (n_hist,); negative before the first."""
    interval = prepared.model.every
    n_epoch = last_epoch(prepared) + 1  # epochs up to each history time
    n_step = n_epoch // interval
    return n_step * interval - 1


def _starts(prepared: Prepared, mode: Floats) -> Ints:
    """Return the epochs at which the filter starts; mode (n_epoch,) after each epoch."""
    epochs = _updates(prepared)
    is_running = np.isin(mode[epochs], _RUNNING)
    was_running = np.concatenate([[False], is_running[:-1]])
    is_start = is_running & ~was_running
    return epochs[is_start]


def _started_at(prepared: Prepared, epoch: int) -> Prepared:
    """Return the case whose filter gets no sample before those that start it at an epoch."""
    # the filter starts with the last of the required number of good samples
    n_before = round(prepared.options.rules.start_after - 1)
    first = epoch - n_before * prepared.model.every
    epochs = np.arange(prepared.t_epoch.size)
    return _with_samples(prepared, epochs >= first)


def _unaided_after(prepared: Prepared, epoch: int) -> Prepared:
    """Return the case whose filter gets no sample from an epoch on, so that it only predicts."""
    epochs = np.arange(prepared.t_epoch.size)
    return _with_samples(prepared, epochs < epoch)


def _with_samples(prepared: Prepared, permitted: Bools) -> Prepared:
    """Return the case whose filter gets samples of the receiver at the permitted epochs (n_epoch,) only."""
    rules = prepared.options.rules
    rules = rules._replace(good=rules.good & permitted)
    options = prepared.options._replace(rules=rules)
    return prepared._replace(options=options)


def uncorrected(prepared: Prepared) -> Prepared:
    """Return the case with a filter that never starts: the outputs are those of the INS over the whole flight."""
    return _unaided_after(prepared, 0)


def times_of(prepared: Prepared, segments: list[Segment]) -> list[Bools]:
    """Return the history times (n_hist,) of each segment; the first begins with the flight."""
    firsts = np.array([segment.first for segment in segments[1:]], dtype=np.int64)
    number = np.searchsorted(firsts, _last_update(prepared), side="right")
    return [number == k for k in range(len(segments))]


def uncorrected_outputs(prepared: Prepared, segments: list[Segment]) -> list[tuple[Prepared, Bools]]:
    """Return the cases that describe the outputs while the filter does not correct them, with the history times
    (n_hist,) of each: the inertial system alone, or, after a stop, the prediction of the correction.
    """
    update = _last_update(prepared)
    cases = [uncorrected(prepared)]
    times = [np.zeros(update.size, dtype=bool)]
    for segment, is_in_segment in zip(segments, times_of(prepared, segments), strict=True):
        is_correcting = (update >= 0) & np.isin(segment.mode[update], _CORRECTING)
        is_uncorrected = is_in_segment & ~is_correcting
        stop = _predicted_stop(prepared, segment)
        if stop is None:
            times[-1] = times[-1] | is_uncorrected
            continue
        is_before = is_uncorrected & (update < stop)
        times[-1] = times[-1] | is_before
        cases.append(_unaided_after(segment.case, stop))
        times.append(is_uncorrected & ~is_before)
    return list(zip(cases, times, strict=True))


def _predicted_stop(prepared: Prepared, segment: Segment) -> int | None:
    """Return the epoch of a segment's first stop after which the correction is predicted; None if there is none."""
    if prepared.options.rules.after_stop != PREDICTED:
        return None
    updates = _updates(prepared)
    earlier = updates[:-1]
    later = updates[1:]
    was_correcting = np.isin(segment.mode[earlier], _CORRECTING)
    is_stopped = segment.mode[later] == STOPPED
    stops = later[was_correcting & is_stopped]
    stops = stops[stops >= segment.first]
    return int(stops[0]) if stops.size else None


def with_outputs(prepared: Prepared, true: Components, tape: UpdateTape, passed: PassOutcome) -> PassOutcome:
    """Return the results of a pass, completed for the mode logic of an open loop.

    Results after a restart are those of its segment. While the filter does not correct the outputs, their errors are
    those of the inertial system or of the predicted correction.

    Parameters
    ----------
    prepared
        Prepared case.
    true
        Its error components.
    tape
        Tape for the additional passes.
    passed
        Outcome of the pass over the flight; its results are updated in place.
    """
    if not has_uncorrected_outputs(prepared):
        return passed
    out = passed.out
    segments = segments_of(prepared, true, passed)
    restarts = zip(segments[1:], times_of(prepared, segments)[1:], strict=True)
    for segment, times in restarts:
        restarted = segment.passed
        epochs = slice(segment.first, None)
        _copy_times(out, restarted.out, times)
        out.formal[times] = restarted.out.formal[times]
        for name in ("n_row", "expected_nis", "row_ratio"):
            values = getattr(out, name)
            values[epochs] = getattr(restarted.out, name)[epochs]
        if passed.monitor is not None and restarted.monitor is not None:
            for name in ("isolated", "excluded"):
                values = getattr(passed.monitor, name)
                values[epochs] = getattr(restarted.monitor, name)[epochs]
    for case, times in uncorrected_outputs(prepared, segments):
        if times.any():
            uncorrected_pass = run_pass(case, true, tape)
            _copy_times(out, uncorrected_pass.out, times)
    return passed


def _copy_times(out: PassResults, source: PassResults, times: Bools) -> None:
    """Copy the true covariance, the mean, the budget and the errors of samples at some history times (n_hist,)."""
    for name in ("true", "mean", "budget", "samples"):
        values = getattr(out, name)
        if len(values):
            values[times] = getattr(source, name)[times]


def case_at(prepared: Prepared, true: Components, hist: int) -> Prepared:
    """Return the case whose pass describes the outputs of an open loop with a mode logic at a history time.

    Parameters
    ----------
    prepared
        Prepared case.
    true
        Its error components.
    hist
        Index of the history time.
    """
    no_tape = new_tape(0, 0, n_joint(prepared), row_width(prepared))
    passed = run_pass(prepared, true, no_tape)
    segments = segments_of(prepared, true, passed)
    for case, times in uncorrected_outputs(prepared, segments):
        if times[hist]:
            return case
    restarts = zip(segments[1:], times_of(prepared, segments)[1:], strict=True)
    for segment, times in restarts:
        if times[hist]:
            return segment.case
    return prepared
