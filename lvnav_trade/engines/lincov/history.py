"""Linear covariance: covariance(prepared) -> CovHistory: formal, true, by source, on the nominal flight."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.special import chdtrc

from lvnav_trade.engines.lincov.adjoint import BackScratch, Backward, go_back
from lvnav_trade.engines.lincov.components import Components, components, initial_state
from lvnav_trade.engines.lincov.forward import forward
from lvnav_trade.engines.lincov.outputs import sample_outputs, solution_outputs_of
from lvnav_trade.engines.lincov.receiver_error import N_SOLUTION_ENTRY
from lvnav_trade.engines.lincov.sources import n_joint, source_names
from lvnav_trade.engines.lincov.workspace import (
    JointCovariance,
    Nominal,
    Recorded,
    SampleScratch,
    Scratch,
    Tape,
    new_tape,
)
from lvnav_trade.engines.setup.prepare import Prepared
from lvnav_trade.filters.late import N_PAST
from lvnav_trade.filters.monitor import new_watch
from lvnav_trade.frames import matrices
from lvnav_trade.kernels.groups import grouped_zeros
from lvnav_trade.kernels.strapdown import N_SUM
from lvnav_trade.kernels.transition import ATT, POS, VEL
from lvnav_trade.kernels.vehicle import N_SAMPLE
from lvnav_trade.receivers.base import N_STATE
from lvnav_trade.records import AdjointBudget, CovHistory, Floats
from lvnav_trade.sources import label_of


def _width(prepared: Prepared) -> int:
    """Return how many entries a Jacobian row has."""
    return prepared.model.entry.shape[1] + (0 if prepared.chain is None else N_SOLUTION_ENTRY)


def nominal(prepared: Prepared) -> Nominal:
    """Return the work arrays of the nominal run, empty."""
    model, late, signals = prepared.model, prepared.options.late, prepared.signals
    shapes = {
        "nav": (10,), "sums": (N_SUM,), "previous": (6,),
        "increments": (int(prepared.schedule.n_tick.max()), 6), "antenna": (len(model.lever_arms), 21),
        "rate": (3,), "H": (prepared.n_row, _width(prepared)), "z": (prepared.n_row,), "expected": (prepared.n_row,),
        "ranges": (signals.used.shape[1], 2), "solution": (6,), "observed": (max(1, len(prepared.devices)), 4),
        "clock_hat": (2,), "par": (max(1, len(prepared.layout.parameters)), 3), "x": (model.n_state,),
        "extra": (max(1, model.extra_offset.size),), "reported": (6, 6),
        "past": (1 + (0 if late is None else late.n_ring), N_PAST), "P": (1, 1),
    }  # fmt: skip
    return Nominal(**{name: np.zeros(shape) for name, shape in shapes.items()})


def _joint(prepared: Prepared, true: Components) -> JointCovariance:
    mean = np.zeros(n_joint(prepared))
    vehicle = prepared.options.vehicle
    if vehicle is not None:  # the estimated motion starts at zero
        mean[vehicle.motion : vehicle.motion + 3] = vehicle.rate[0]
        mean[vehicle.motion + 3 : vehicle.motion + 6] = vehicle.force[0]
    profile = np.zeros((prepared.unit.profile_sensor.size, 3))
    return JointCovariance(prepared.start.P.copy(), mean, *initial_state(prepared, true), profile)


def _scratch(prepared: Prepared, true: Components) -> Scratch:
    n, n_state, n_group = n_joint(prepared), prepared.layout.n_state, true.n_slot.size
    n_slot = true.followed.shape[1]
    shapes = {
        "D": (prepared.model.block_rows.size, 9), "D_true": (true.nav_rows.size, 9), "block": (9,), "input": (9, 3),
        "shift": (n,), "K": (n_state,), "x": (n_state,), "gain": (n,), "deviation": (9,), "receiver": (N_STATE + 6,),
    }  # fmt: skip
    lanes = {
        "y": (n,), "b": (n_group, n_slot, 9), "seen": (n_group, n_slot, 1), "noise": (n_group, 1, 1), "spread": (1,),
        "budget": (n_group, n_state, 1),
    }  # fmt: skip
    return Scratch(
        **{name: np.zeros(shape) for name, shape in shapes.items()},
        **{name: grouped_zeros(shape) for name, shape in lanes.items()},
    )


def _sample_scratch(prepared: Prepared, true: Components) -> SampleScratch | None:
    """Return work arrays for the samples of the IMU, None where they are no measurements."""
    vehicle = prepared.options.vehicle
    if vehicle is None:
        return None
    n, n_state, n_group = n_joint(prepared), prepared.layout.n_state, true.n_slot.size
    n_entry, n_slot = vehicle.columns.shape[1], true.followed.shape[1]
    shapes = {
        "sums": (N_SUM,), "h": (N_SAMPLE, n_entry), "K": (N_SAMPLE, n_state), "gain": (N_SAMPLE, n),
        "weight": (N_SAMPLE,), "residual": (N_SAMPLE,), "still": (N_SAMPLE,), "seen": (N_SAMPLE,),
        "deviation": (N_SAMPLE,), "moved": (9, n), "expected": (N_SAMPLE, N_SAMPLE), "turned": (N_SAMPLE, N_SAMPLE),
    }  # fmt: skip
    lanes = {
        "moved_source": (9, n), "Y": (N_SAMPLE, n), "S": (n_group, N_SAMPLE, N_SAMPLE), "noise": (n_group, N_SAMPLE),
        "a": (n_group * n_slot, N_SAMPLE, 1), "seen_source": (N_SAMPLE,), "through": (n,),
    }  # fmt: skip
    found: dict[str, Any] = {name: np.zeros(shape) for name, shape in shapes.items()}
    found |= {name: grouped_zeros(shape) for name, shape in lanes.items()}
    for source, values in enumerate(true.sample_noise):
        found["noise"][true.group[source], :, true.lane[source]] = values
    return SampleScratch(**found)


def _pass(prepared: Prepared, names: list[str], true: Components, tape: Tape) -> Recorded:
    n, n_hist, n_epoch = prepared.layout.n_state, prepared.t_hist.size, prepared.t_epoch.size
    options, n_source = prepared.options, len(names)
    n_reported, n_sampled = (n_hist if one is not None else 0 for one in (options.report, options.samples))
    out = Recorded(
        np.zeros((n_hist, n, n)), np.zeros((n_hist, n, n)), np.zeros((n_hist, n)), np.zeros((n_hist, n_source, n)),
        np.zeros((n_sampled, n_source, 2 * N_SAMPLE)), np.zeros((n_reported, n_source, N_STATE, N_STATE)),
        np.zeros((n_reported, N_STATE)), np.zeros(n_epoch, dtype=np.int64), np.zeros(n_epoch), np.zeros(n_epoch),
    )  # fmt: skip
    held = None if options.report is None else (np.zeros((n_source, N_STATE, N_STATE)), np.zeros(N_STATE))
    watch = None if options.rules is None else new_watch(n_epoch, prepared.channels.n_receiver, prepared.n_row)
    axes_att = np.ascontiguousarray(np.swapaxes(matrices(prepared.record.q), 1, 2))
    forward(
        out, _joint(prepared, true), _scratch(prepared, true), _sample_scratch(prepared, true), tape,
        nominal(prepared), prepared.schedule, prepared.unit, prepared.signals, prepared.sensors, prepared.record,
        axes_att, prepared.model, true, prepared.reference, prepared.chain, options.late, options.gains,
        options.rules, watch, options.vehicle, options.samples, held,
    )  # fmt: skip
    return out


def covariance(prepared: Prepared) -> CovHistory:
    """Return the filter's own and the true covariance of a case over its nominal flight, the true one by source."""
    names = source_names(prepared)
    tape = new_tape(0, 0, n_joint(prepared), _width(prepared))
    out = _pass(prepared, names, components(prepared, names), tape)
    history = _history(prepared, names, out)
    return solution_outputs_of(prepared, sample_outputs(prepared, names, history, out), out)


def forward_tape(prepared: Prepared, true: Components) -> Tape:
    """Return what a backward pass, or an observability analysis, needs of a forward one."""
    per_satellite = 2 if prepared.model.tight else 0
    n_sensor = sum(len(device.channels.labels) for device in prepared.devices)
    n_update = int(np.sum(np.maximum(6, per_satellite * prepared.signals.n_used) + n_sensor + 6)) + 1
    sampled = prepared.reference.dtheta.shape[0] if prepared.options.vehicle is not None else 0
    tape = new_tape(
        prepared.schedule.n_tick.size, n_update, n_joint(prepared), _width(prepared), sampled, prepared.layout.n_state
    )
    _pass(prepared, source_names(prepared), true, tape)
    return tape


def turns(prepared: Prepared) -> Floats:
    """Return the matrices (n_hist, n, n) from the filter's error state to the reporting axes at the history times."""
    n, record = prepared.layout.n_state, prepared.record
    turn = np.zeros((prepared.t_hist.size, n, n))
    turn[:, ATT : ATT + 3, ATT : ATT + 3] = np.swapaxes(matrices(record.q), 1, 2)
    turn[:, VEL : VEL + 3, VEL : VEL + 3] = record.axes
    turn[:, POS : POS + 3, POS : POS + 3] = record.axes
    turn[:, range(9, n), range(9, n)] = 1.0
    return turn


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
    names = tuple(label_of(name) for name in source_names(prepared))
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
    true, schedule, vehicle = components(prepared, names), prepared.schedule, prepared.options.vehicle
    n, n_slot = n_joint(prepared), true.followed.shape[1]
    tape = tape or forward_tape(prepared, true)
    last = int(np.flatnonzero(schedule.hist == hist)[0])
    ends = prepared.reference.t[schedule.first_tick + schedule.n_tick]
    edges = np.arange(prepared.t_hist[0], ends[last] + bin_seconds, bin_seconds)
    bins = np.clip(np.searchsorted(edges, ends - 1e-9, side="right") - 1, 0, edges.size - 2)
    back = Backward(
        np.pad(np.array(rows, dtype=np.float64), ((0, 0), (0, n - rows.shape[1]))),
        np.zeros((len(rows), len(names), n_slot)),
        np.zeros((len(rows), len(names), edges.size - 1)),
    )
    n_entry = 1 if vehicle is None else vehicle.columns.shape[1]
    shapes = ((true.nav_rows.size, 9), (max(n, N_SAMPLE),), (9, 3), (9,), (N_SUM,), (N_SAMPLE, n_entry))
    arrays: list[Floats] = [np.zeros(shape) for shape in shapes]
    scratch = BackScratch(*arrays, a=grouped_zeros((true.n_slot.size * n_slot, N_SAMPLE, 1)))  # type: ignore[misc]
    go_back(
        back, scratch, tape, last, bins, schedule, prepared.unit,
        prepared.signals, true, prepared.model, prepared.chain, prepared.options.late, vehicle, prepared.reference,
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


def _history(prepared: Prepared, names: list[str], out: Recorded) -> CovHistory:
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
        sources=tuple(label_of(name) for name in names),
        budget=out.budget,
        formal_cov=formal,
        true_cov=true,
        t_epoch=prepared.t_epoch,
        n_row=out.n_row.astype(np.int32),
        expected_nees=expected_nees(out.formal[:, :m, :m], total[:, :m, :m]),
        expected_nis=out.expected_nis,
        false_rejection=false_rejection(prepared.model.gate_squared, out.worst_ratio),
    )


def false_rejection(gate_squared: float, ratio: Floats) -> Floats:
    """Return the probability (n_epoch,) that the gate rejects a good measurement, of the epoch's most endangered row.

    A row's normalised innovation is normal with the expected square `ratio`; a matched filter has 1.
    """
    return chdtrc(1, gate_squared / np.maximum(ratio, 1e-300)) if np.isfinite(gate_squared) else np.zeros_like(ratio)
