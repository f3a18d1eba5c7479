"""What a pass of linear covariance carries over the nominal flight, fills, and keeps for the way back."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lvnav_trade.kernels.strapdown import N_SUM
from lvnav_trade.records import Floats

Ints = NDArray[np.int64]


class Nominal(NamedTuple):
    """The one nominal run, in the form that the strapdown and the filter's rows take: see engines.flight.Work."""

    nav: Floats
    sums: Floats
    previous: Floats
    increments: Floats
    antenna: Floats
    rate: Floats
    H: Floats
    z: Floats
    ranges: Floats
    solution: Floats
    clock_hat: Floats
    x: Floats
    extra: Floats
    told: Floats
    past: Floats


class Joint(NamedTuple):
    """The state of the pass, updated: formal (n_state, n_state) the filter's covariance; sources (n_source, n, n) the
    true error's by source, of the n states of the joint vector (see `chained`); cross (n_block, 3, n) Cov(e, c);
    variance (n_block, 3) of c; shared_cross (n_component, n) and shared_variance (n_component,) the same of errors that
    measurements share; mean (n,); profile (n_profile, 3) present value.
    """

    formal: Floats
    sources: Floats
    cross: Floats
    variance: Floats
    shared_cross: Floats
    shared_variance: Floats
    mean: Floats
    profile: Floats


class Scratch(NamedTuple):
    """Work arrays: D, D_true (n_block, 9); y (n,); b, g (3, n); block (9,); K, x (n_state,); gain (n,);
    deviation (9,).
    """

    D: Floats
    D_true: Floats
    y: Floats
    b: Floats
    g: Floats
    block: Floats
    K: Floats
    x: Floats
    gain: Floats
    deviation: Floats


class Tape(NamedTuple):
    """What a backward pass needs of a forward one; of no length where none will follow.

    sums (n_window, 18), position (n_window, 3) of each window; gain (n_row, n), h (n_row, n_entry), epoch and channel
    (n_row,) of each row in the order absorbed; first_row (n_window + 1,) index of the first row after each window; used
    (1,) rows so far.
    """

    sums: Floats
    position: Floats
    gain: Floats
    h: Floats
    epoch: Ints
    channel: Ints
    first_row: Ints
    used: Ints


class Cover(NamedTuple):
    """What the pass fills: formal, true (n_hist, n, n) frame i; mean (n_hist, n) frame i; budget (n_hist, n_source, n)
    variances in reporting axes; n_row, expected_nis (n_epoch,); worst_ratio (n_epoch,) largest expected
    square of a normalised innovation among the epoch's rows.
    """

    formal: Floats
    true: Floats
    mean: Floats
    budget: Floats
    n_row: Ints
    expected_nis: Floats
    worst_ratio: Floats


def new_tape(n_window: int, n_row: int, n: int, n_entry: int) -> Tape:
    """Return an empty tape for a flight of n_window windows and n_row rows; n_row 0 keeps nothing."""
    windows = n_window if n_row else 0
    return Tape(
        np.zeros((windows, N_SUM)), np.zeros((windows, 3)), np.zeros((n_row, n)), np.zeros((n_row, n_entry)),
        np.zeros(n_row, dtype=np.int64), np.zeros(n_row, dtype=np.int64), np.zeros(windows + 1, dtype=np.int64),
        np.zeros(1, dtype=np.int64),
    )  # fmt: skip
