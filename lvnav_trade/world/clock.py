"""True receiver clock: bias and drift of a block of runs from standard normal draws."""

from __future__ import annotations

import numpy as np

from lvnav_trade.kernels.clock import clock_step
from lvnav_trade.records import Floats
from lvnav_trade.world.receiver.receiver import ClockCard


def walk(card: ClockCard, t: Floats, normals: Floats) -> tuple[Floats, Floats]:
    """Return true clock bias (m) and drift (m/s) at the times of `t`.

    Parameters
    ----------
    card
        The oscillator; its initial sigmas hold at the first time.
    t
        (n_time,) s, rising.
    normals
        (..., n_time, 2) independent standard normal draws; those of the first time give the initial bias and drift.

    Returns
    -------
    bias, drift
        (..., n_time) each: m and m/s; positive bias makes pseudoranges long.

    Notes
    -----
    The two-state model of Brown and Hwang, 4th ed., section 9.3, stepped exactly, so the steps may differ in length.
    """
    bias, drift = np.empty(normals.shape[:-1]), np.empty(normals.shape[:-1])
    bias[..., 0] = card.initial_bias * normals[..., 0, 0]
    drift[..., 0] = card.initial_drift * normals[..., 0, 1]
    for k, dt in enumerate(np.diff(t), start=1):
        a11, a21, a22 = clock_step(float(dt), card.h0, card.h_minus2)
        n1, n2 = normals[..., k, 0], normals[..., k, 1]
        bias[..., k] = bias[..., k - 1] + drift[..., k - 1] * dt + a11 * n1
        drift[..., k] = drift[..., k - 1] + a21 * n1 + a22 * n2
    return bias, drift
