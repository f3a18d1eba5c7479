"""Linear covariance: covariance(prepared) -> CovHistory: formal, true, by source, on the nominal flight."""

from __future__ import annotations

import numpy as np

from lvnav_trade.engines.cover import Cover, Joint, Nominal, Scratch, cover
from lvnav_trade.engines.prepare import Prepared
from lvnav_trade.engines.truth import TrueModel, initial_cross, source_names, start_sources, true_model
from lvnav_trade.frames import matrices
from lvnav_trade.kernels.transition import ATT, POS, VEL
from lvnav_trade.records import CovHistory, Floats


def _joint(prepared: Prepared, true: TrueModel) -> Joint:
    cross, variance = initial_cross(prepared, true)
    n = prepared.layout.n_state
    return Joint(prepared.start.P.copy(), start_sources(true, cross), cross, variance, np.zeros(n), np.zeros((2, 3)))


def _nominal(prepared: Prepared) -> Nominal:
    n_slot = prepared.signals.used.shape[1]
    n_row = max(6, 2 * n_slot)
    shapes = (
        (10,),
        (21,),
        (6,),
        (int(prepared.schedule.n_tick.max()), 6),
        (12,),
        (3,),
        (n_row, 10),
        (n_row,),
        (n_slot, 2),
        (6,),
        (2,),
    )
    return Nominal(*(np.zeros(shape) for shape in shapes))


def _scratch(prepared: Prepared, true: TrueModel) -> Scratch:
    n = prepared.layout.n_state
    shapes = (
        (n, n),
        (prepared.belief.block_rows.size, 9),
        (true.nav_rows.size, 9),
        (n,),
        (3, n),
        (3, n),
        (9,),
        (n,),
        (n,),
        (n,),
        (9,),
    )
    return Scratch(*(np.zeros(shape) for shape in shapes))


def covariance(prepared: Prepared) -> CovHistory:
    """Return the filter's own and the true covariance of a case over its nominal flight, the true one by source."""
    names = source_names(prepared)
    true = true_model(prepared, names)
    n, n_hist, n_epoch = prepared.layout.n_state, prepared.t_hist.size, prepared.t_epoch.size
    out = Cover(
        np.zeros((n_hist, n, n)), np.zeros((n_hist, n, n)), np.zeros((n_hist, n)), np.zeros((n_hist, len(names), n)),
        np.zeros(n_epoch, dtype=np.int64), np.zeros(n_epoch),
    )  # fmt: skip
    record = prepared.record
    axes_att = np.ascontiguousarray(np.swapaxes(matrices(record.q), 1, 2))
    cover(
        out, _joint(prepared, true), _scratch(prepared, true), _nominal(prepared), prepared.schedule, prepared.unit,
        prepared.signals, record, axes_att, prepared.belief, true, prepared.reference,
    )  # fmt: skip
    return _history(prepared, names, out, axes_att)


def _history(prepared: Prepared, names: list[str], out: Cover, axes_att: Floats) -> CovHistory:
    n, m = prepared.layout.n_state, prepared.layout.n_estimated
    turn = np.zeros((prepared.t_hist.size, n, n))
    turn[:, ATT : ATT + 3, ATT : ATT + 3] = axes_att
    turn[:, VEL : VEL + 3, VEL : VEL + 3] = prepared.record.axes
    turn[:, POS : POS + 3, POS : POS + 3] = prepared.record.axes
    turn[:, range(9, n), range(9, n)] = 1.0
    total = out.true + out.mean[:, :, None] * out.mean[:, None, :]
    expected = np.trace(np.linalg.solve(out.formal[:, :m, :m], total[:, :m, :m]), axis1=1, axis2=2)
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
        expected_nees=expected,
        expected_nis=out.expected_nis,
    )
