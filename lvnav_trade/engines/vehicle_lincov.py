"""Linear covariance of a flight with an attitude reference: formal, true, by source, with rate and acceleration."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import config

from lvnav_trade.engines.lincov import expected_nees, false_rejection, nominal, turns
from lvnav_trade.engines.prepare import Prepared
from lvnav_trade.engines.sensing import profile_value
from lvnav_trade.engines.truth import TrueModel, initial_cross, source_names, start_sources, true_model
from lvnav_trade.engines.vehicle import ATTITUDE_NOISE, Vehicle
from lvnav_trade.engines.vehicle_carried import Covered, Desk, Parts, Spread
from lvnav_trade.engines.vehicle_cover import cover_vehicle
from lvnav_trade.engines.vehicle_flight import N_BESIDE
from lvnav_trade.kernels.lanes import aligned_zeros
from lvnav_trade.kernels.strapdown import N_SUM
from lvnav_trade.kernels.vector import WIDTH
from lvnav_trade.kernels.vehicle import N_SAMPLE
from lvnav_trade.records import CovHistory, Floats

ROWS = ("position solution noise", "velocity solution noise", ATTITUDE_NOISE)
"""Sources of the noise of an epoch's rows."""
WALKS = ("gyro random walk", "accelerometer random walk")
"""Sources of the noise of samples."""


def covariance(prepared: Prepared) -> CovHistory:
    """Return the filter's own and the true covariance of a case over its nominal flight, the true one by source."""
    vehicle = prepared.vehicle
    assert vehicle is not None
    names = source_names(prepared)
    true = true_model(prepared, names)
    parts = _parts(prepared, true, names)
    n, n_hist, n_epoch, n_source = prepared.layout.n_state, prepared.t_hist.size, prepared.t_epoch.size, len(names)
    out = Covered(
        np.zeros((n_hist, n, n)), np.zeros((n_hist, n, n)), np.zeros((n_hist, n)), np.zeros((n_hist, n_source, n, n)),
        np.zeros((n_hist, n_source, N_SAMPLE)), np.zeros(n_epoch, dtype=np.int64), np.zeros(n_epoch),
        np.zeros(n_epoch),
    )  # fmt: skip
    lanes = not config.DISABLE_JIT
    n_group = -(-n_source // WIDTH) if lanes else n_source
    cover_vehicle(
        out, _spread(prepared, vehicle, true, parts, lanes), _desk(prepared, names, parts.nav_rows.size, lanes),
        nominal(prepared), prepared.schedule, prepared.unit, prepared.signals, prepared.belief, vehicle, parts,
        prepared.reference, n_group, n_source,
    )  # fmt: skip
    return _history(prepared, vehicle, names, out)


def _grouped(array: Floats, lanes: bool) -> Floats:
    """Return values of sources (n_source, ...) as groups of eight lanes (n_group, ..., 8), the last one filled up."""
    if not lanes:
        return array
    n_group = -(-len(array) // WIDTH)
    full = aligned_zeros((n_group, *array.shape[1:], WIDTH))
    for source, values in enumerate(array):
        full[source // WIDTH, ..., source % WIDTH] = values
    return full


def _spread(prepared: Prepared, vehicle: Vehicle, true: TrueModel, parts: Parts, lanes: bool) -> Spread:
    n = prepared.layout.n_state
    cross, variance = initial_cross(prepared, true)
    start = np.concatenate([variance.ravel(), true.shared_start])
    mean, y = np.zeros(n), np.zeros((start.size, n))
    if vehicle.modelled:
        mean[vehicle.motion : vehicle.motion + 3] = vehicle.rate[0]
        mean[vehicle.motion + 3 : vehicle.motion + 6] = vehicle.force[0]
    for p in np.flatnonzero(parts.matched >= 0):
        y[p, parts.matched[p]] = start[p]  # the estimate starts at zero: Cov(e, c) = +Var(c)
    return Spread(prepared.start.P.copy(), mean, _grouped(start_sources(true, cross), lanes), y, start)


def _parts(prepared: Prepared, true: TrueModel, names: list[str]) -> Parts:
    n_block, n_shared, decay = true.sensor.size, true.shared_source.size, prepared.belief.decay
    axes = np.arange(3)
    on = np.repeat(true.profile < 0, 3)  # a profile is the same in every run: it moves the mean
    matched = np.concatenate([(true.matched[:, None] + axes * (true.matched[:, None] >= 0)).ravel(),
                              true.shared_matched])  # fmt: skip
    fade = np.hstack([np.repeat(true.fade, 3, axis=1), true.shared_fade])
    wander = np.hstack([np.repeat(true.wander, 3, axis=1) * on, true.shared_wander])
    shared = np.concatenate([np.full(3 * n_block, -1), np.arange(n_shared)])
    # followed: what the filter's state does not carry on exactly as the truth does
    alike = np.array([m >= 0 and np.array_equal(fade[:, p], decay[:, m]) for p, m in enumerate(matched)], dtype=bool)
    entering = np.array([s >= 0 and matched[p] < 0 for p, s in enumerate(shared)], dtype=bool)
    followed = (~alike & (matched >= 0)) | entering
    motion, bias = prepared.layout.motion, prepared.layout.parameters[0].offset
    samples = np.arange(N_SAMPLE)
    return Parts(
        source=np.concatenate([np.repeat(true.source, 3), true.shared_source]).astype(np.int64),
        matched=np.where(np.concatenate([on, np.ones(n_shared, dtype=bool)]), matched, -1).astype(np.int64),
        followed=followed & np.concatenate([on, np.ones(n_shared, dtype=bool)]),
        sample=np.concatenate([np.where(on, (3 * true.sensor[:, None] + axes).ravel(), -1), np.full(n_shared, -1)])
        .astype(np.int64),
        shared=shared.astype(np.int64),
        fade=fade,
        wander=wander,
        family=true.shared_family,
        row_source=np.array([names.index(name) for name in ROWS]),
        sample_rows=np.ones((N_SAMPLE, 2)),
        sample_columns=np.stack([max(motion, 0) + samples, bias + samples], axis=1),
        sample_entries=np.full(N_SAMPLE, 2),
        noise=np.ascontiguousarray(np.moveaxis(true.noise, 0, 1)),
        nav_rows=true.nav_rows,
        nav_columns=true.nav_columns,
        nav_kinds=true.nav_kinds,
        nav_drivers=true.nav_drivers,
    )  # fmt: skip


def _sample_noise(prepared: Prepared, names: list[str]) -> Floats:
    """Return the true variance (n_source, 6) of the noise of a sample, by source."""
    imu, noise = prepared.scenario.imu, np.zeros((len(names), N_SAMPLE))
    noise[names.index(WALKS[0]), :3] = imu.gyro.random_walk**2 * imu.rate
    noise[names.index(WALKS[1]), 3:] = imu.accel.random_walk**2 * imu.rate
    return noise


def _desk(prepared: Prepared, names: list[str], n_true: int, lanes: bool) -> Desk:
    n, belief = prepared.layout.n_state, prepared.belief
    n_block = max(1, belief.block_rows.size)
    end = (WIDTH,) if lanes else ()
    shapes: dict[str, tuple[int, ...]] = {
        "D": (n_block, 9), "D_true": (n_true, 9), "moved": (9, n),
        "K": (N_SAMPLE, n), "x": (n,), "z": (N_SAMPLE,), "weight": (N_SAMPLE,), "residual": (N_SAMPLE,),
        "gain": (N_SAMPLE, n), "work": (n,), "seen": (N_SAMPLE,),
        "moved_source": (9, n, *end), "Y": (N_SAMPLE, n, *end), "row_gain": (1, n), "sums": (N_SUM,),
        "increments": (int(prepared.schedule.n_tick.max()), 6), "still": (N_SAMPLE,),
        "expected": (N_SAMPLE, N_SAMPLE), "turned": (N_SAMPLE, N_SAMPLE), "sparse": (1, n), "one": (1,),
    }  # fmt: skip
    arrays: dict[str, Any] = {name: aligned_zeros(shape) for name, shape in shapes.items()}
    n_source = len(names)
    arrays["one"][0] = 1.0
    arrays["at"], arrays["n_at"] = np.zeros((1, n), dtype=np.int64), np.zeros(1, dtype=np.int64)
    arrays["S"] = _grouped(np.zeros((n_source, N_SAMPLE, N_SAMPLE)), lanes)
    arrays["sample_noise"] = _grouped(_sample_noise(prepared, names), lanes)
    arrays["row_noise"] = _grouped(np.zeros((n_source, 1)), lanes)
    return Desk(**arrays)


def _history(prepared: Prepared, vehicle: Vehicle, names: list[str], out: Covered) -> CovHistory:
    turn = turns(prepared)
    total = out.true + out.mean[:, :, None] * out.mean[:, None, :]
    formal = turn @ out.formal @ np.swapaxes(turn, 1, 2)
    by_source = np.einsum("hij,hsjk,hik->hsi", turn, out.sources, turn)
    true = turn @ out.true @ np.swapaxes(turn, 1, 2)
    mean = np.einsum("hij,hj->hi", turn, out.mean)
    beside, beside_mean, beside_formal = _beside(prepared, vehicle, names, out)
    budget = np.concatenate([by_source, beside], axis=2)
    m = prepared.layout.n_estimated
    true_variance = np.maximum(0.0, np.concatenate([np.diagonal(true, axis1=1, axis2=2), beside.sum(axis=1)], axis=1))
    formal_variance = np.concatenate([np.diagonal(formal, axis1=1, axis2=2), beside_formal], axis=1)
    return CovHistory(
        t=prepared.t_hist,
        formal=np.sqrt(formal_variance),
        true_sigma=np.sqrt(true_variance),
        mean=np.concatenate([mean, beside_mean], axis=1),
        sources=tuple(names),
        budget=budget,
        formal_cov=_bordered(formal, beside_formal),
        true_cov=_bordered(true, beside.sum(axis=1)),
        t_epoch=prepared.t_epoch,
        n_row=out.n_row.astype(np.int32),
        expected_nees=expected_nees(out.formal[:, :m, :m], total[:, :m, :m]),
        expected_nis=out.expected_nis,
        false_rejection=false_rejection(prepared.belief.gate_squared, out.worst_ratio),
    )


def _beside(prepared: Prepared, vehicle: Vehicle, names: list[str], out: Covered) -> tuple[Floats, Floats, Floats]:
    """Return variance by source (n_hist, n_source, 12), mean and formal variance (n_hist, 12) of the samples' errors,
    raw and corrected.

    Truth minus sample is minus bias and noise; corrected, minus the error of the bias's estimate and noise.
    """
    noise, n_hist = _sample_noise(prepared, names), prepared.t_hist.size
    bias = slice(vehicle.bias, vehicle.bias + N_SAMPLE)
    left = np.diagonal(out.sources[:, :, bias, bias], axis1=2, axis2=3)
    variance = np.concatenate([out.sample_spread + noise, left + noise], axis=2)
    mean, unit = np.zeros((n_hist, N_BESIDE)), prepared.unit
    for profile, sensor in enumerate(unit.profile_sensor.tolist()):
        for axis in range(3):
            mean[:, 3 * sensor + axis] -= [profile_value(unit, profile, axis, t) for t in prepared.t_hist]
    mean[:, N_SAMPLE:] = -out.mean[:, bias]
    believed = np.diagonal(out.formal[:, bias, bias], axis1=1, axis2=2) + vehicle.variance
    return variance, mean, np.concatenate([np.tile(vehicle.raw, (n_hist, 1)), believed], axis=1)


def _bordered(inner: Floats, diagonal: Floats) -> Floats:
    """Return matrices (n_hist, n + k, n + k) with `inner` (n_hist, n, n) and beside it `diagonal` (n_hist, k)."""
    n, k = inner.shape[1], diagonal.shape[1]
    full = np.zeros((len(inner), n + k, n + k))
    full[:, :n, :n] = inner
    full[:, range(n, n + k), range(n, n + k)] = diagonal
    return full
