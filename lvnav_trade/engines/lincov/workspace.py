"""What a pass of linear covariance holds over the nominal flight, fills, and records for the backward pass."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lvnav_trade.kernels.strapdown import N_SUM
from lvnav_trade.records import Floats

Ints = NDArray[np.int64]


class Nominal(NamedTuple):
    """Work arrays of the nominal run, by the names that the filter's kernels read."""

    nav: Floats
    sums: Floats
    previous: Floats
    increments: Floats
    antenna: Floats
    rate: Floats
    H: Floats
    z: Floats
    expected: Floats
    ranges: Floats
    solution: Floats
    observed: Floats
    clock_hat: Floats
    par: Floats
    x: Floats
    extra: Floats
    reported: Floats
    past: Floats
    P: Floats


class JointCovariance(NamedTuple):
    """State of the pass, updated. N states: the filter's error e (n), the receiver's solution error, clones.

    formal (n, n) the filter's covariance; mean (N,); sources (n_group, N, N, n_lane) the true covariance, a source a
    lane; cross (n_group, n_slot, N, n_lane) covariance of the N states with each error component and variance (n_group,
    n_slot, 1, n_lane) of it; profile (n_profile, 3) present value of biases that are the same in every run.
    """

    formal: Floats
    mean: Floats
    sources: Floats
    cross: Floats
    variance: Floats
    profile: Floats


class Scratch(NamedTuple):
    """Work arrays. D, D_true (n_block, 9) blocks of the transition; block (9,); input (9, 3) of the
    three components of a block; shift (N,); K, x (n,); gain (N,); deviation (9,); receiver (11,).

    In lanes: y (N,); b (n_group, n_slot, 9) how components enter attitude, velocity and position; seen (n_group,
    n_slot, 1) what a measurement has of each component; noise (n_group, 1, 1) of a measurement; spread (1,); budget
    (n_group, n, 1).
    """

    D: Floats
    D_true: Floats
    block: Floats
    input: Floats
    shift: Floats
    K: Floats
    x: Floats
    gain: Floats
    deviation: Floats
    receiver: Floats
    y: Floats
    b: Floats
    seen: Floats
    noise: Floats
    spread: Floats
    budget: Floats


class SampleScratch(NamedTuple):
    """Work arrays of a filter that measures the samples of its IMU: sums (18,) of a tick; h (6, n_entry); gain (6, N);
    weight, residual, still (6,) zeros, seen (6,), deviation (6,); moved (9, N); expected, turned (6, 6).

    In lanes: moved_source (9, N), Y (6, N), S (n_group, 6, 6), noise (n_group, 6) of the samples by source, a (n_group,
    n_slot, 6) partials of the samples with respect to components, seen_source (6,), propagated (N,).
    """

    sums: Floats
    h: Floats
    K: Floats
    gain: Floats
    weight: Floats
    residual: Floats
    still: Floats
    seen: Floats
    deviation: Floats
    moved: Floats
    expected: Floats
    turned: Floats
    moved_source: Floats
    Y: Floats
    S: Floats
    noise: Floats
    a: Floats
    seen_source: Floats
    through: Floats


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
    frame i; n_row, expected_nis (n_epoch,); worst_ratio (n_epoch,) largest expected square of a normalised innovation
    of the epoch.
    """

    formal: Floats
    true: Floats
    mean: Floats
    budget: Floats
    samples: Floats
    receiver: Floats
    receiver_mean: Floats
    n_row: Ints
    expected_nis: Floats
    worst_ratio: Floats


def new_tape(n_window: int, n_update: int, n: int, n_entry: int, n_tick: int = 0, n_state: int = 0) -> Tape:
    """Return an empty tape for n_window windows and n_update scalar updates; n_update 0 records nothing."""
    windows = n_window if n_update else 0
    return Tape(
        np.zeros((windows, N_SUM)), np.zeros((windows, 3)), np.zeros((n_update, n)), np.zeros((n_update, n_entry)),
        np.zeros(n_update, dtype=np.int64), np.zeros(n_update, dtype=np.int64), np.zeros(windows + 1, dtype=np.int64),
        np.zeros(1, dtype=np.int64), np.zeros((n_tick, 6, n_state)),
    )  # fmt: skip
