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
from lvnav_trade.simulation.preparation.prepare import PreparedCase

_RUNNING_MODES = (CONVERGING, AIDING, PREDICTING)  # modes in which the filter runs
_CORRECTING_MODES = (AIDING, PREDICTING)  # modes in which the outputs are corrected by the filter's error state


def has_uncorrected_outputs(prepared_case: PreparedCase) -> bool:
    """Return whether a mode logic decides when the outputs of an open loop are corrected instead of the INS's own."""
    return prepared_case.options.rules is not None and prepared_case.scenario.filter.feedback == "open"


class Segment(NamedTuple):
    """Part of a nominal flight from one start of the filter to the next.

    case : Case whose filter gets no sample before those that start it here.
    first : Epoch of the start.
    outcome : Results of a forward pass of this case; they describe the segment.
    mode : (n_epoch,). Mode after each epoch, by the log of this pass.
    """

    case: PreparedCase
    first: int
    outcome: PassOutcome
    mode: Floats


def flight_segments(prepared_case: PreparedCase, components: Components, outcome: PassOutcome) -> list[Segment]:
    """Return the segments of a nominal flight; more than one if the mode logic restarts the filter of an open loop.

    A restart discards all estimates. The error is then that of the inertial system, with all its correlations, as
    before a first start. A restart is therefore computed as the first start of a filter that got no sample before.

    Parameters
    ----------
    prepared_case
        Prepared case.
    components
        Its error components.
    outcome
        Results of a pass of the case itself.
    """
    no_tape = new_tape(0, 0, n_joint(prepared_case), row_width(prepared_case))
    mode = _mode_log(prepared_case, outcome)
    starts = _starts(prepared_case, mode)
    first = int(starts[0]) if starts.size else 0
    segments = [Segment(prepared_case, first, outcome, mode)]
    later_starts = starts[starts > first]
    while later_starts.size:
        first = int(later_starts[0])
        case = _restarted_case(prepared_case, first)
        outcome = run_pass(case, components, no_tape)
        mode = _mode_log(case, outcome)
        segments.append(Segment(case, first, outcome, mode))
        starts = _starts(case, mode)
        later_starts = starts[starts > first]
    return segments


def _mode_log(prepared_case: PreparedCase, outcome: PassOutcome) -> Floats:
    """Return the mode of the filter after each epoch, (n_epoch,); waiting without a mode logic."""
    if outcome.mode_state is None:
        return np.full(prepared_case.t_epoch.size, float(WAITING))
    return outcome.mode_state.mode


def _updates(prepared_case: PreparedCase) -> Ints:
    """Return the epochs at which the mode logic has a step."""
    interval = prepared_case.model.decimation
    return np.arange(interval - 1, prepared_case.t_epoch.size, interval)


def _last_update(prepared_case: PreparedCase) -> Ints:
    """Return the last step of the mode logic up to each history time, (n_hist,); negative before the first."""
    interval = prepared_case.model.decimation
    n_epoch = last_epoch(prepared_case) + 1  # epochs up to each history time
    n_step = n_epoch // interval
    return n_step * interval - 1


def _starts(prepared_case: PreparedCase, mode: Floats) -> Ints:
    """Return the epochs at which the filter starts; mode (n_epoch,) after each epoch."""
    epochs = _updates(prepared_case)
    is_running = np.isin(mode[epochs], _RUNNING_MODES)
    was_running = np.concatenate([[False], is_running[:-1]])
    is_start = is_running & ~was_running
    return epochs[is_start]


def _restarted_case(prepared_case: PreparedCase, epoch: int) -> PreparedCase:
    """Return the case whose filter gets no sample before those that start it at an epoch."""
    # the filter starts with the last of the required number of good samples
    n_before = round(prepared_case.options.rules.start_after - 1)
    first = epoch - n_before * prepared_case.model.decimation
    epochs = np.arange(prepared_case.t_epoch.size)
    return _restrict_samples(prepared_case, epochs >= first)


def _prediction_case(prepared_case: PreparedCase, epoch: int) -> PreparedCase:
    """Return the case whose filter gets no sample from an epoch on, so that it only predicts."""
    epochs = np.arange(prepared_case.t_epoch.size)
    return _restrict_samples(prepared_case, epochs < epoch)


def _restrict_samples(prepared_case: PreparedCase, is_permitted: Bools) -> PreparedCase:
    """Return the case whose filter gets samples of the receiver at the permitted epochs (n_epoch,) only."""
    rules = prepared_case.options.rules
    rules = rules._replace(is_good=rules.is_good & is_permitted)
    options = prepared_case.options._replace(rules=rules)
    return prepared_case._replace(options=options)


def uncorrected_case(prepared_case: PreparedCase) -> PreparedCase:
    """Return the case with a filter that never starts: the outputs are those of the INS over the whole flight."""
    return _prediction_case(prepared_case, 0)


def segment_times(prepared_case: PreparedCase, segments: list[Segment]) -> list[Bools]:
    """Return the history times (n_hist,) of each segment; the first begins with the flight."""
    firsts = np.array([segment.first for segment in segments[1:]], dtype=np.int64)
    number = np.searchsorted(firsts, _last_update(prepared_case), side="right")
    return [number == k for k in range(len(segments))]


def uncorrected_outputs(prepared_case: PreparedCase, segments: list[Segment]) -> list[tuple[PreparedCase, Bools]]:
    """Return the cases that describe the outputs while the filter does not correct them, with the history times
    (n_hist,) of each: the inertial system alone, or, after a stop, the prediction of the correction.
    """
    update = _last_update(prepared_case)
    cases = [uncorrected_case(prepared_case)]
    times = [np.zeros(update.size, dtype=bool)]
    for segment, is_in_segment in zip(segments, segment_times(prepared_case, segments), strict=True):
        is_correcting = (update >= 0) & np.isin(segment.mode[update], _CORRECTING_MODES)
        is_uncorrected = is_in_segment & ~is_correcting
        stop = _predicted_stop(prepared_case, segment)
        if stop is None:
            times[-1] = times[-1] | is_uncorrected
            continue
        is_before = is_uncorrected & (update < stop)
        times[-1] = times[-1] | is_before
        cases.append(_prediction_case(segment.case, stop))
        times.append(is_uncorrected & ~is_before)
    return list(zip(cases, times, strict=True))


def _predicted_stop(prepared_case: PreparedCase, segment: Segment) -> int | None:
    """Return the epoch of a segment's first stop after which the correction is predicted; None if there is none."""
    if prepared_case.options.rules.after_stop != PREDICTED:
        return None
    updates = _updates(prepared_case)
    previous_updates = updates[:-1]
    next_updates = updates[1:]
    was_correcting = np.isin(segment.mode[previous_updates], _CORRECTING_MODES)
    is_stopped = segment.mode[next_updates] == STOPPED
    stops = next_updates[was_correcting & is_stopped]
    stops = stops[stops >= segment.first]
    return int(stops[0]) if stops.size else None


def complete_outputs(
    prepared_case: PreparedCase, components: Components, tape: UpdateTape, outcome: PassOutcome
) -> PassOutcome:
    """Return the results of a pass, completed for the mode logic of an open loop.

    Results after a restart are those of its segment. While the filter does not correct the outputs, their errors are
    those of the inertial system or of the predicted correction.

    Parameters
    ----------
    prepared_case
        Prepared case.
    components
        Its error components.
    tape
        Tape for the additional passes.
    outcome
        Outcome of the pass over the flight; its results are updated in place.
    """
    if not has_uncorrected_outputs(prepared_case):
        return outcome
    results = outcome.results
    segments = flight_segments(prepared_case, components, outcome)
    restarts = zip(segments[1:], segment_times(prepared_case, segments)[1:], strict=True)
    for segment, times in restarts:
        segment_outcome = segment.outcome
        epochs = slice(segment.first, None)
        _copy_times(results, segment_outcome.results, times)
        results.formal[times] = segment_outcome.results.formal[times]
        for name in ("n_row", "expected_nis", "expected_row_nis"):
            values = getattr(results, name)
            values[epochs] = getattr(segment_outcome.results, name)[epochs]
        if outcome.monitor is not None and segment_outcome.monitor is not None:
            for name in ("fault_type", "is_excluded"):
                values = getattr(outcome.monitor, name)
                values[epochs] = getattr(segment_outcome.monitor, name)[epochs]
    for case, times in uncorrected_outputs(prepared_case, segments):
        if times.any():
            uncorrected_pass = run_pass(case, components, tape)
            _copy_times(results, uncorrected_pass.results, times)
    return outcome


def _copy_times(results: PassResults, source: PassResults, times: Bools) -> None:
    """Copy the true covariance, the mean, the budget and the errors of samples at some history times (n_hist,)."""
    for name in ("true", "mean", "budget", "samples"):
        values = getattr(results, name)
        if len(values):
            values[times] = getattr(source, name)[times]


def output_case(prepared_case: PreparedCase, components: Components, hist: int) -> PreparedCase:
    """Return the case whose pass describes the outputs of an open loop with a mode logic at a history time.

    Parameters
    ----------
    prepared_case
        Prepared case.
    components
        Its error components.
    hist
        Index of the history time.
    """
    no_tape = new_tape(0, 0, n_joint(prepared_case), row_width(prepared_case))
    outcome = run_pass(prepared_case, components, no_tape)
    segments = flight_segments(prepared_case, components, outcome)
    for case, times in uncorrected_outputs(prepared_case, segments):
        if times[hist]:
            return case
    restarts = zip(segments[1:], segment_times(prepared_case, segments)[1:], strict=True)
    for segment, times in restarts:
        if times[hist]:
            return segment.case
    return prepared_case
