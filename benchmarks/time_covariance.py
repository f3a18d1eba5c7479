"""The covariance kernels alone: nanoseconds a step and run, and the share of this core's measured FMA peak."""

from __future__ import annotations

import numpy as np

from benchmarks.common import best
from lvnav_trade.kernels.covariance import absorb, predict
from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.lanes import WIDTH, like, view

STATES, STEPS, ROWS = 17, 2000, 16


@jit
def _steps(P, X, D, rows, columns, decay, noise, steps):
    for _ in range(steps):
        predict(view(P), view(X), view(D), rows, columns, decay, noise, 15, 0.005)


@jit
def _rows(P, x, K, h, z, entries, columns, steps):
    for k in range(steps):
        absorb(view(P), view(x), view(K), view(h)[k % 16], entries, columns, view(z)[0], 1.0, 1e30, 17, False)


@jit
def _multiply_add(x, rounds):
    """Twelve independent chains of fused multiply-adds on lanes: what the core can do at best."""
    v = view(x)
    a0, a1, a2, a3, a4, a5 = v[0], v[1], v[2], v[3], v[4], v[5]
    a6, a7, a8, a9, a10, a11 = v[6], v[7], v[8], v[9], v[10], v[11]
    m, c = like(a0, 0.999999), like(a0, 1e-6)
    for _ in range(rounds):
        a0, a1, a2, a3 = a0 * m + c, a1 * m + c, a2 * m + c, a3 * m + c
        a4, a5, a6, a7 = a4 * m + c, a5 * m + c, a6 * m + c, a7 * m + c
        a8, a9, a10, a11 = a8 * m + c, a9 * m + c, a10 * m + c, a11 * m + c
    v[0] = a0 + a1 + a2 + a3 + a4 + a5 + a6 + a7 + a8 + a9 + a10 + a11


def fma_peak() -> float:
    """Return this core's floating-point operations per second on dependent chains of fused multiply-adds."""
    x, rounds = np.ones((12, WIDTH)), 200_000
    return 2 * 12 * WIDTH * rounds / best(lambda: _multiply_add(x, rounds))


def _blocks() -> tuple[np.ndarray, np.ndarray]:
    pairs = [(0, 9), (3, 0), (3, 3), (3, 6), (3, 9), (3, 12), (6, 0), (6, 3), (6, 6), (6, 9), (6, 12)]
    rows, columns = (np.array(side, dtype=np.int64) for side in zip(*pairs, strict=True))
    return rows, columns


def operations(block_rows: np.ndarray) -> int:
    """Count the operations of one structured covariance step: rows of D P, then the upper part of (D P) D'."""
    forward = 18 * STATES * block_rows.size
    back = sum(18 * (int(row) + 3) for row in block_rows)
    clock, noise = 4 * STATES, 4 * STATES
    return forward + back + clock + noise


def measure() -> dict[str, float]:
    """Return nanoseconds of a step and of a row, each per run, and the step's share of the FMA peak."""
    rng = np.random.default_rng(0)
    rows, columns = _blocks()
    P = np.repeat(np.eye(STATES)[:, :, None], WIDTH, 2)
    X, D = np.zeros_like(P), rng.standard_normal((rows.size, 9, WIDTH)) * 1e-6
    decay, noise = np.ones(STATES), np.full(STATES, 1e-9)
    step = best(lambda: _steps(P.copy(), X, D, rows, columns, decay, noise, STEPS)) / STEPS
    h, z = rng.standard_normal((ROWS, 10, WIDTH)), rng.standard_normal((1, WIDTH))
    x, K = np.zeros((STATES, WIDTH)), np.zeros((STATES, WIDTH))
    entries, used = np.arange(7), np.array([3, 4, 5, 6, 7, 8, 16])
    row = best(lambda: _rows(P.copy(), x, K, h, z, entries, used, STEPS)) / STEPS
    return {
        "covariance_step_ns_per_run": step / WIDTH * 1e9,
        "row_ns_per_run": row / WIDTH * 1e9,
        "covariance_share_of_fma_peak": operations(rows) * WIDTH / step / fma_peak(),
    }
