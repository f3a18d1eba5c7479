"""Where a flight's time goes: each kernel alone, in nanoseconds a run, beside the operations that it must do."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from rich.console import Console
from rich.table import Table

from benchmarks import fma
from benchmarks.common import best, scenario
from lvnav_trade.kernels import processes, transition
from lvnav_trade.kernels.covariance import N_NAV_ERROR, predict, update_scalar
from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.lanes import aligned_zeros, view
from lvnav_trade.kernels.mechanisation import mechanise
from lvnav_trade.kernels.random import normals
from lvnav_trade.kernels.strapdown import J4, N_SUM, full_rate
from lvnav_trade.kernels.vector import WIDTH
from lvnav_trade.simulation.preparation.prepare import PreparedCase, prepare

REPEATS, TICKS = 2000, 20


class Kernel(NamedTuple):
    """A kernel's cost: what one call is, nanoseconds a call and run, floating-point operations a call and run."""

    name: str
    nanoseconds: float
    operations: float


@jit
def _predicts(P, D, rows, columns, decay, noise, repeats):
    for _ in range(repeats):
        predict(view(P), view(D), rows, columns, decay, noise, 15, 0.005)


@jit
def _updates(P, x, K, h, z, entries, columns, repeats):
    for k in range(repeats):
        update_scalar(view(P), view(x), view(K), view(h)[k % 16], entries, columns, view(z)[0], 1.0, 1e30, 17, False)


@jit
def _fills(D, kinds, drivers, sums, r, repeats):
    at = view(r)
    for _ in range(repeats):
        transition.fill(view(D), kinds, drivers, view(sums), at[0], at[1], at[2], 0.005)


@jit
def _mechanises(nav, sums, previous, increments, how, ticks, repeats):
    for _ in range(repeats):
        mechanise(view(nav), view(sums), view(previous), view(increments), ticks, 0.005, how, 0.0)


@jit
def _corrupts(increments, tables, remainder, run, unit, ticks, repeats):
    for _ in range(repeats):
        table = view(tables)
        processes.corrupt(
            view(increments),
            0,
            0,
            ticks,
            unit.dtheta,
            unit.dvel,
            table[0],
            table[1],
            unit.white,
            view(remainder),
            unit,
            np.uint64(1),
            np.uint64(2),
            view(run)[0],
        )


@jit
def _normals(run, out, repeats):
    lanes = view(out)
    for k in range(repeats):
        a, b, c, d = normals(np.uint64(1), np.uint64(2), np.uint64(3), view(run)[0], np.uint64(k), np.uint64(0))
        lanes[k, 0], lanes[k, 1], lanes[k, 2], lanes[k, 3] = a, b, c, d


def _time(name: str, function: Callable[[], Any], calls: int, operations: float) -> Kernel:
    return Kernel(name, best(function) / calls / WIDTH * 1e9, operations)


def predict_operations(rows: np.ndarray, columns: np.ndarray, n: int) -> float:
    """Count a covariance step: blocks on rows and on columns, velocity into position, the clock, the noise."""
    moves = int(np.sum((rows == transition.POS) & (columns == transition.VEL)))
    return (18 * (rows.size - moves) + 6 * moves) * (n + N_NAV_ERROR) + 4 * n + 4 * n


def aligned(array: np.ndarray) -> np.ndarray:
    """Return a copy that begins where a cache line does, as the arrays of a flight do."""
    found = aligned_zeros(array.shape, array.dtype.type)
    found[...] = array
    return found


def kernels(prepared_case: PreparedCase) -> list[Kernel]:
    """Return the cost of every kernel of a flight, for eight runs at once."""
    rng, model, n = np.random.default_rng(0), prepared_case.model, prepared_case.layout.n_state
    P = aligned(np.repeat(np.eye(n)[:, :, None], WIDTH, 2))
    D = aligned(rng.standard_normal((model.block_rows.size, 9, WIDTH)) * 1e-6)
    decay, noise = np.ones(n), np.full(n, 1e-12)
    h, z = aligned(rng.standard_normal((16, 10, WIDTH))), aligned(rng.standard_normal((1, WIDTH)))
    x, K = aligned_zeros((n, WIDTH)), aligned_zeros((n, WIDTH))
    entries, states = np.array([0, 1, 2, 6, 7, 8, 9]), np.array([6, 7, 8, 3, 4, 5, 16])
    nav = aligned_zeros((10, WIDTH))
    nav[0], nav[5], nav[7] = 1.0, 7e3, 6.7e6
    sums, previous, increments = (aligned_zeros((*size, WIDTH)) for size in ((N_SUM,), (6,), (TICKS, 6)))
    r, run = aligned(np.full((3, WIDTH), 4e6)), aligned(np.arange(WIDTH, dtype=np.uint64)[None])
    tables, remainder, drawn = (aligned_zeros((*size, WIDTH)) for size in ((2, processes.N_TABLE), (6,), (REPEATS, 4)))
    rows, columns = model.block_rows, model.block_columns
    kinds, drivers, unit = model.block_kinds, model.block_drivers, prepared_case.unit
    flights = REPEATS // TICKS
    return [
        _time("four normals", lambda: _normals(run, drawn, REPEATS), REPEATS, 110),
        _time(
            "unit, a tick (draws included)",
            lambda: _corrupts(increments, tables, remainder, run, unit, TICKS, flights),
            flights * TICKS,
            240,
        ),
        _time(
            "strapdown, a tick",
            lambda: _mechanises(nav, sums, previous, increments, full_rate(J4), TICKS, flights),
            flights * TICKS,
            260,
        ),
        _time("transition blocks", lambda: _fills(D, kinds, drivers, sums, r, REPEATS), REPEATS, 140),
        _time(
            "covariance step",
            lambda: _predicts(aligned(P), D, rows, columns, decay, noise, REPEATS),
            REPEATS,
            predict_operations(rows, columns, n),
        ),
        _time(
            "row",
            lambda: _updates(aligned(P), x, K, h, z, entries, states, REPEATS),
            REPEATS,
            n * 13 + 28 + n * (n + 1) + 2 * n,
        ),
    ]


def measure() -> dict[str, float]:
    """Print the kernels beside this core's peak; return the covariance's figures."""
    top = fma.peak()
    found = kernels(prepare(scenario()))
    table = Table(
        "kernel", "ns a run", "operations", "share of FMA peak", title=f"FMA peak {top / 1e9:.0f} GFLOP/s a core"
    )
    for kernel in found:
        share = kernel.operations / kernel.nanoseconds * 1e9 / top
        table.add_row(kernel.name, f"{kernel.nanoseconds:.1f}", f"{kernel.operations:.0f}", f"{share:.0%}")
    Console().print(table)
    step = next(kernel for kernel in found if kernel.name == "covariance step")
    row = next(kernel for kernel in found if kernel.name == "row")
    return {
        "covariance_step_ns_per_run": step.nanoseconds,
        "row_ns_per_run": row.nanoseconds,
        "covariance_share_of_fma_peak": step.operations / step.nanoseconds * 1e9 / top,
        "fma_peak_gflops": top / 1e9,
    }
