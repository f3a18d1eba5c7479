"""What a pass of linear covariance holds over the nominal flight, fills, and records for the backward pass."""

from collections import namedtuple
from typing import Any, NamedTuple

import numpy as np

from lvnav_trade.engines.lincov.components import Components, initial_state
from lvnav_trade.engines.lincov.receiver_error import N_SOLUTION_ENTRY
from lvnav_trade.engines.lincov.slots import as_lanes
from lvnav_trade.engines.lincov.sources import n_joint
from lvnav_trade.engines.lincov.successive import N_ENTRIES
from lvnav_trade.engines.setup.prepare import Prepared
from lvnav_trade.filters.delayed import Earlier, new_earlier
from lvnav_trade.filters.late import N_PAST
from lvnav_trade.kernels.groups import grouped_zeros
from lvnav_trade.kernels.lanes import zeros_of
from lvnav_trade.kernels.strapdown import N_SUM
from lvnav_trade.kernels.vehicle import N_SAMPLE
from lvnav_trade.receivers.base import N_STATE
from lvnav_trade.records import Floats, Ints


class JointCovariance(NamedTuple):
    """State of the pass, updated. N states: the filter's error e (n), the receiver's solution error, clones.

    formal (n, n) the filter's covariance; mean (N,); sources (n_group, N, N, n_lane) the true covariance, a source a
    lane; cross (n_group, n_slot, N, n_lane) covariance of the N states with each error component and variance
    (n_group, n_slot, 1, n_lane) of it; profile (n_profile, 3) present value of biases that are the same in every run.
    """

    formal: Floats
    mean: Floats
    sources: Floats
    cross: Floats
    variance: Floats
    profile: Floats


class Tape(NamedTuple):
    """What a backward pass needs of a forward one; empty if none is requested.

    sums (n_window, 18), position (n_window, 3) of each window; gain (n_update, N), h (n_update, n_entry), epoch and
    channel (n_update,) of each scalar update in order; first (n_window + 1,) number of updates before each window's
    end; used (1,) updates so far; sample_gain (n_tick, 6, n) of the IMU's samples where they are measurements.
    """

    sums: Floats
    position: Floats
    gain: Floats
    h: Floats
    epoch: Ints
    channel: Ints
    first: Ints
    used: Ints
    sample_gain: Floats


class Recorded(NamedTuple):
    """What the pass fills: formal, true (n_hist, n, n) frame i; mean (n_hist, n) frame i; budget (n_hist, n_source, n)
    variances in reporting axes; samples (n_hist, n_source, 12) variance of the errors of the IMU's samples, raw and
    corrected; receiver (n_hist, n_source, 11, 11) and receiver_mean (n_hist, 11) error of the receiver's last solution,
    frame i, and held, held_mean the same of the present one; n_row, expected_nis (n_epoch,); worst_ratio (n_epoch,)
    largest expected square of a normalised innovation of the epoch.
    """

    formal: Floats
    true: Floats
    mean: Floats
    budget: Floats
    samples: Floats
    receiver: Floats
    receiver_mean: Floats
    held: Floats
    held_mean: Floats
    n_row: Floats
    expected_nis: Floats
    worst_ratio: Floats


# Work arrays of the nominal run, by the names that the filter's kernels read; shapes: `new_nominal`.
Nominal = namedtuple(
    "Nominal",
    "nav sums rates held previous increments antenna rate H z expected ranges solution observed clock_hat par x extra "
    "reported past P",
)
# Work arrays of the forward pass; shapes: `new_scratch`.
Scratch = namedtuple(
    "Scratch", "D D_true block input mean_input shift K x gain deviation receiver y b seen noise spread budget"
)
# Work arrays of a filter that measures the samples of its IMU; shapes: `new_sample_scratch`.
SampleScratch = namedtuple(
    "SampleScratch",
    "sums h K gain weight residual still seen deviation moved expected turned moved_source Y S noise a seen_source "
    "through",
)
# Work arrays of the backward pass; shapes: `new_backward_scratch`.
BackwardScratch = namedtuple("BackwardScratch", "D y input mean_input block sums h b a")


def _record(kind: Any, alone: dict[str, tuple[int, ...]], grouped: dict[str, tuple[int, ...]]) -> Any:
    """Return a record of zeros: arrays of the given shapes, and arrays with the lanes of a group behind theirs."""
    found = {name: np.zeros(shape) for name, shape in alone.items()}
    return kind(**found, **{name: grouped_zeros(shape) for name, shape in grouped.items()})


def row_width(prepared: Prepared) -> int:
    """Return how many entries a Jacobian row has."""
    if prepared.options.delayed is not None:
        return prepared.model.entry.shape[1] + N_ENTRIES
    return prepared.model.entry.shape[1] + (0 if prepared.chain is None else N_SOLUTION_ENTRY)


def new_nominal(prepared: Prepared) -> Nominal:
    """Return the work arrays of the nominal run, empty."""
    model, late, signals = prepared.model, prepared.options.late, prepared.signals
    found = Nominal(**zeros_of({
        "nav": (10,), "sums": (N_SUM,), "rates": (2, N_SUM), "held": (N_SUM,), "previous": (6,),
        "increments": (int(prepared.schedule.n_tick.max()), 6), "antenna": (len(model.lever_arms), 21),
        "rate": (3,), "H": (prepared.n_row, row_width(prepared)), "z": (prepared.n_row,),
        "expected": (prepared.n_row,), "ranges": (signals.used.shape[1], model.n_kind), "solution": (6,),
        "observed": (max(1, len(prepared.devices)), 4), "clock_hat": (2,),
        "par": (max(1, len(prepared.layout.parameters)), 3), "x": (model.n_state,),
        "extra": (max(1, model.extra_offset.size),), "reported": (6, 6),
        "past": (1 + (0 if late is None else late.buffered.size), N_PAST), "P": (1, 1),
    }))  # fmt: skip
    if prepared.options.delayed is not None:  # the error of a measurement, and that of the epoch before
        found.H[:, -N_ENTRIES:] = 1.0, -1.0
    return found


def new_nominal_earlier(prepared: Prepared) -> Earlier | None:
    """Return what the nominal run stores of the epoch before, empty; None where no difference is measured."""
    delayed, model = prepared.options.delayed, prepared.model
    if delayed is None:
        return None
    return new_earlier(delayed, len(model.lever_arms), model.extra_offset.size, model.n_state)


def new_joint(prepared: Prepared, true: Components) -> JointCovariance:
    """Return the joint covariance at the start of the flight."""
    mean, vehicle = np.zeros(n_joint(prepared)), prepared.options.vehicle
    if vehicle is not None:  # the estimated motion starts at zero
        mean[vehicle.motion : vehicle.motion + 6] = *vehicle.rate[0], *vehicle.force[0]
    profile = np.zeros((prepared.unit.profile_sensor.size, 3))
    return JointCovariance(prepared.start.P.copy(), mean, *initial_state(prepared, true), profile)


def new_scratch(prepared: Prepared, true: Components) -> Scratch:
    """Return the work arrays of the forward pass: D, D_true blocks of the transition, block and input (9, 3) of the
    components of a block; in lanes b how components enter attitude, velocity and position, seen what a measurement has
    of each, noise of a measurement.
    """
    n, n_state, (n_group, n_slot) = n_joint(prepared), prepared.layout.n_state, true.followed.shape
    return _record(
        Scratch,
        {
            "D": (prepared.model.block_rows.size, 9), "D_true": (true.nav_rows.size, 9), "block": (9,),
            "input": (9, 3), "mean_input": (2, 3), "shift": (n,), "K": (n_state,), "x": (n_state,), "gain": (n,),
            "deviation": (12,), "receiver": (n,),
        },
        {
            "y": (n,), "b": (n_group, n_slot, 9), "seen": (n_group, n_slot, 1), "noise": (n_group, 1, 1),
            "spread": (1,), "budget": (n_group, n_state, 1),
        },
    )  # fmt: skip


def new_sample_scratch(prepared: Prepared, true: Components) -> SampleScratch | None:
    """Return work arrays for the samples of the IMU, None where they are no measurements: sums of a tick; h, K, gain,
    weight, residual, deviation of the six; still zeros. In lanes S of the innovations, noise of the samples by source,
    a partials with respect to components.
    """
    vehicle = prepared.options.vehicle
    if vehicle is None:
        return None
    n, n_state, (n_group, n_slot), six = n_joint(prepared), prepared.layout.n_state, true.followed.shape, N_SAMPLE
    found: SampleScratch = _record(
        SampleScratch,
        {
            "sums": (N_SUM,), "h": (six, vehicle.columns.shape[1]), "K": (six, n_state), "gain": (six, n),
            "weight": (six,), "residual": (six,), "still": (six,), "seen": (six,), "deviation": (six,),
            "moved": (9, n), "expected": (six, six), "turned": (six, six),
        },
        {
            "moved_source": (9, n), "Y": (six, n), "S": (n_group, six, six), "noise": (n_group, six),
            "a": (n_group, n_slot, six), "seen_source": (six,), "through": (n,),
        },
    )  # fmt: skip
    found.noise[:] = as_lanes(true.sample_noise, true.group, true.lane)
    return found


def new_backward_scratch(prepared: Prepared, true: Components) -> BackwardScratch:
    """Return the work arrays of the backward pass; b, a as of `new_scratch` and `new_sample_scratch`."""
    vehicle = prepared.options.vehicle
    n_entry = 1 if vehicle is None else vehicle.columns.shape[1]
    alone = {
        "D": (true.nav_rows.size, 9), "y": (max(n_joint(prepared), N_SAMPLE),), "input": (9, 3),
        "mean_input": (2, 3), "block": (9,), "sums": (N_SUM,), "h": (N_SAMPLE, n_entry),
    }  # fmt: skip
    return _record(BackwardScratch, alone, {"b": (*true.followed.shape, 9), "a": (*true.followed.shape, N_SAMPLE)})


def new_record(prepared: Prepared, n_source: int) -> Recorded:
    """Return what the pass fills, empty."""
    n, n_hist, n_epoch, options = prepared.layout.n_state, prepared.t_hist.size, prepared.t_epoch.size, prepared.options
    n_sampled, n_reported = (0 if one is None else n_hist for one in (options.samples, options.report))
    return Recorded(**zeros_of({
        "formal": (n_hist, n, n), "true": (n_hist, n, n), "mean": (n_hist, n), "budget": (n_hist, n_source, n),
        "samples": (n_sampled, n_source, 2 * N_SAMPLE), "receiver": (n_reported, n_source, N_STATE, N_STATE),
        "receiver_mean": (n_reported, N_STATE), "held": (n_source, N_STATE, N_STATE), "held_mean": (N_STATE,),
        "n_row": (n_epoch,), "expected_nis": (n_epoch,), "worst_ratio": (n_epoch,),
    }))  # fmt: skip


def new_tape(n_window: int, n_update: int, n: int, n_entry: int, n_tick: int = 0, n_state: int = 0) -> Tape:
    """Return an empty tape for n_window windows and n_update scalar updates; n_update 0 records nothing."""
    windows = n_window if n_update else 0
    return Tape(
        np.zeros((windows, N_SUM)), np.zeros((windows, 3)), np.zeros((n_update, n)), np.zeros((n_update, n_entry)),
        np.zeros(n_update, dtype=np.int64), np.zeros(n_update, dtype=np.int64), np.zeros(windows + 1, dtype=np.int64),
        np.zeros(1, dtype=np.int64), np.zeros((n_tick, 6, n_state)),
    )  # fmt: skip
