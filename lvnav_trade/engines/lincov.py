"""Linear covariance: covariance(prepared) -> CovHistory: formal, true, by source, on the nominal flight."""

from __future__ import annotations

import numpy as np
from scipy.special import chdtrc

from lvnav_trade.engines.adjoint import BackScratch, Backward, go_back
from lvnav_trade.engines.carried import Cover, Joint, Nominal, Scratch, Tape, new_tape
from lvnav_trade.engines.chained import N_JUDGED
from lvnav_trade.engines.cover import cover
from lvnav_trade.engines.prepare import Prepared
from lvnav_trade.engines.truth import (
    TrueModel,
    initial_cross,
    initial_shared,
    n_joint,
    source_names,
    start_sources,
    true_model,
)
from lvnav_trade.filters.belief import TIGHT
from lvnav_trade.filters.late import N_PAST
from lvnav_trade.frames import matrices
from lvnav_trade.kernels.strapdown import N_SUM
from lvnav_trade.kernels.transition import ATT, POS, VEL
from lvnav_trade.records import AdjointBudget, CovHistory, Floats


def _joint(prepared: Prepared, true: TrueModel) -> Joint:
    cross, variance = initial_cross(prepared, true)
    n, n_profile = n_joint(prepared), prepared.unit.profile_sensor.size
    return Joint(
        prepared.start.P.copy(), start_sources(true, cross), cross, variance, initial_shared(prepared, true),
        true.shared_start.copy(), np.zeros(n), np.zeros((n_profile, 3)),
    )  # fmt: skip


def _width(prepared: Prepared) -> int:
    """Return how many entries a row has."""
    return N_JUDGED if prepared.chain is not None else prepared.belief.entry.shape[1]


def nominal(prepared: Prepared) -> Nominal:
    """Return the work arrays of the nominal run, empty."""
    n_slot, belief = prepared.signals.used.shape[1], prepared.belief
    n_row = max(6, 2 * n_slot) + 1
    shapes = (
        (10,), (N_SUM,), (6,), (int(prepared.schedule.n_tick.max()), 6), (len(belief.levers), 12), (3,),
        (n_row, _width(prepared)), (n_row,), (n_slot, 2), (6,), (2,), (belief.n_state,),
        (max(1, belief.extra_offset.size),), (6, 6), (N_PAST,),
    )  # fmt: skip
    return Nominal(*(np.zeros(shape) for shape in shapes))


def _scratch(prepared: Prepared, true: TrueModel) -> Scratch:
    n, n_state = n_joint(prepared), prepared.layout.n_state
    shapes = (
        (prepared.belief.block_rows.size, 9),
        (true.nav_rows.size, 9),
        (n,),
        (3, n),
        (3, n),
        (9,),
        (n_state,),
        (n_state,),
        (n,),
        (9,),
    )
    return Scratch(*(np.zeros(shape) for shape in shapes))


def turns(prepared: Prepared) -> Floats:
    """Return the matrices (n_hist, n, n) from the filter's error state to the reporting axes at the history times."""
    n, record = prepared.layout.n_state, prepared.record
    turn = np.zeros((prepared.t_hist.size, n, n))
    turn[:, ATT : ATT + 3, ATT : ATT + 3] = np.swapaxes(matrices(record.q), 1, 2)
    turn[:, VEL : VEL + 3, VEL : VEL + 3] = record.axes
    turn[:, POS : POS + 3, POS : POS + 3] = record.axes
    turn[:, range(9, n), range(9, n)] = 1.0
    return turn


def _cover(prepared: Prepared, names: list[str], true: TrueModel, tape: Tape) -> Cover:
    n, n_hist, n_epoch = prepared.layout.n_state, prepared.t_hist.size, prepared.t_epoch.size
    out = Cover(
        np.zeros((n_hist, n, n)), np.zeros((n_hist, n, n)), np.zeros((n_hist, n)), np.zeros((n_hist, len(names), n)),
        np.zeros(n_epoch, dtype=np.int64), np.zeros(n_epoch), np.zeros(n_epoch),
    )  # fmt: skip
    axes_att = np.ascontiguousarray(np.swapaxes(matrices(prepared.record.q), 1, 2))
    cover(
        out, _joint(prepared, true), _scratch(prepared, true), tape, nominal(prepared), prepared.schedule,
        prepared.unit, prepared.signals, prepared.record, axes_att, prepared.belief, true, prepared.reference,
        prepared.chain, prepared.options.late, prepared.options.gains, prepared.options.altimeter,
    )  # fmt: skip
    return out


def covariance(prepared: Prepared) -> CovHistory:
    """Return the filter's own and the true covariance of a case over its nominal flight, the true one by source."""
    names = source_names(prepared)
    tape = new_tape(0, 0, n_joint(prepared), _width(prepared))
    return _history(prepared, names, _cover(prepared, names, true_model(prepared, names), tape))


def forward_tape(prepared: Prepared, true: TrueModel) -> Tape:
    """Return what a backward pass, or an observability analysis, needs of a forward one."""
    names = source_names(prepared)
    per_satellite = 2 if prepared.belief.kind == TIGHT else 0
    n_row = int(np.sum(np.maximum(6, per_satellite * prepared.signals.n_used) + 1)) + 1
    tape = new_tape(prepared.schedule.n_tick.size, n_row, n_joint(prepared), _width(prepared))
    _cover(prepared, names, true, tape)
    return tape


def adjoint(prepared: Prepared, time: float, bin_seconds: float = 10.0, tape: Tape | None = None) -> AdjointBudget:
    """Return what every source put into the navigation errors at a time, and when it did.

    Parameters
    ----------
    time
        s since lift-off; the history time nearest to it is taken (events are history times).
    bin_seconds
        Length of the bins of time (s) that contributions are summed over.
    tape
        The forward pass (`forward_tape`) where it is known already.
    """
    hist = int(np.argmin(np.abs(prepared.t_hist - time)))
    edges, contribution = _go_back(prepared, hist, turns(prepared)[hist, :9], bin_seconds, tape)
    names = tuple(source_names(prepared))
    return AdjointBudget(float(prepared.t_hist[hist]), edges, names, prepared.outputs[:9], contribution)


def source_covariances(prepared: Prepared, time: float, tape: Tape | None = None) -> Floats:
    """Return the true covariance of attitude, velocity and position at a time by source, (n_source, 3, 3, 3), in the
    reporting axes.

    By the backward pass for each component and for each sum of two: Cov(x, y) = (Var(x + y) - Var x - Var y) / 2.
    """
    hist = int(np.argmin(np.abs(prepared.t_hist - time)))
    single = turns(prepared)[hist, :9]
    pairs = [(3 * q + i, 3 * q + j) for q in range(3) for i, j in ((0, 1), (0, 2), (1, 2))]
    rows = np.vstack([single, [single[i] + single[j] for i, j in pairs]])
    variance = _go_back(prepared, hist, rows, float(np.ptp(prepared.t_hist)) + 1.0, tape)[1].sum(axis=2)
    found = np.zeros((variance.shape[1], 9, 9))
    found[:, range(9), range(9)] = variance[:9].T
    for row, (i, j) in enumerate(pairs, start=9):
        found[:, i, j] = found[:, j, i] = 0.5 * (variance[row] - variance[i] - variance[j])
    return np.stack([found[:, at : at + 3, at : at + 3] for at in (ATT, VEL, POS)], axis=1)


def _go_back(
    prepared: Prepared, hist: int, rows: Floats, bin_seconds: float, tape: Tape | None
) -> tuple[Floats, Floats]:
    """Return the edges of the bins and the variance (n_row, n_source, n_bin) that sources put into rows' e."""
    names = source_names(prepared)
    true, schedule = true_model(prepared, names), prepared.schedule
    n = n_joint(prepared)
    tape = tape or forward_tape(prepared, true)
    last = int(np.flatnonzero(schedule.hist == hist)[0])
    ends = prepared.reference.t[schedule.first_tick + schedule.n_tick]
    edges = np.arange(prepared.t_hist[0], ends[last] + bin_seconds, bin_seconds)
    bins = np.clip(np.searchsorted(edges, ends - 1e-9, side="right") - 1, 0, edges.size - 2)
    back = Backward(
        np.pad(np.array(rows, dtype=np.float64), ((0, 0), (0, n - rows.shape[1]))),
        np.zeros((len(rows), true.sensor.size, 3)),
        np.zeros((len(rows), true.shared_source.size)),
        np.zeros((len(rows), len(names), edges.size - 1)),
    )
    shapes = ((true.nav_rows.size, 9), (n,), (3, n), (3, n), (9,))
    scratch = BackScratch(*map(np.zeros, shapes))
    go_back(
        back, scratch, tape, last, bins, schedule, prepared.signals, true, prepared.belief, prepared.chain,
        prepared.options.late,
    )  # fmt: skip
    return edges, back.contribution


def expected_nees(formal: Floats, total: Floats) -> Floats:
    """Return tr(formal^-1 total) of each history time (n_hist,); NaN where the filter is certain of a state.

    Both (n_hist, m, m) are brought to the filter's sigmas first: states differ by ten orders of magnitude.
    """
    sigma = np.sqrt(np.diagonal(formal, axis1=1, axis2=2))
    sound = np.all(sigma > 0.0, axis=1)
    scale = sigma[sound, :, None] * sigma[sound, None, :]
    expected = np.full(len(formal), np.nan)
    expected[sound] = np.trace(np.linalg.solve(formal[sound] / scale, total[sound] / scale), axis1=1, axis2=2)
    return expected


def _history(prepared: Prepared, names: list[str], out: Cover) -> CovHistory:
    n, m = prepared.layout.n_state, prepared.layout.n_estimated
    turn = turns(prepared)
    total = out.true + out.mean[:, :, None] * out.mean[:, None, :]
    formal, true = turn @ out.formal @ np.swapaxes(turn, 1, 2), turn @ out.true @ np.swapaxes(turn, 1, 2)
    diagonal = range(n)
    return CovHistory(
        t=prepared.t_hist,
        formal=np.sqrt(formal[:, diagonal, diagonal]),
        true_sigma=np.sqrt(np.maximum(0.0, true[:, diagonal, diagonal])),
        mean=np.einsum("hij,hj->hi", turn, out.mean),
        sources=tuple(names),
        budget=out.budget,
        formal_cov=formal,
        true_cov=true,
        t_epoch=prepared.t_epoch,
        n_row=out.n_row.astype(np.int32),
        expected_nees=expected_nees(out.formal[:, :m, :m], total[:, :m, :m]),
        expected_nis=out.expected_nis,
        false_rejection=false_rejection(prepared.belief.gate_squared, out.worst_ratio),
    )


def false_rejection(gate_squared: float, ratio: Floats) -> Floats:
    """Return the probability (n_epoch,) that the gate rejects a good measurement, of the epoch's most endangered row.

    A row's normalised innovation is normal with the expected square `ratio`; a matched filter has 1.
    """
    return chdtrc(1, gate_squared / np.maximum(ratio, 1e-300)) if np.isfinite(gate_squared) else np.zeros_like(ratio)
