"""What rounding leaves of a covariance in three forms of the update, and what each costs; behind the decision on them.

Run as ``python docs/design/covariance_forms.py``: prints two tables, takes a minute. The transitions, process noise
and Jacobian rows of a covariance analysis are replayed in extended precision (Joseph's form, the reference), and in
double and single precision in the symmetric form, in Joseph's form, and factorised as U D U' (Bierman's update,
Thornton's propagation by modified weighted Gram-Schmidt).
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from numba import njit

from lvnav_trade.campaign.reading.load import load
from lvnav_trade.campaign.syntax.card_lookup import campaign_file
from lvnav_trade.covariance.history import forward_tape
from lvnav_trade.kernels import transition
from lvnav_trade.kernels.covariance import predict, update_scalar
from lvnav_trade.simulation.preparation.prepare import PreparedCase, prepare

Floats = np.ndarray[Any, Any]
CASES = (
    ("imu/tactical_mems_matched", "filters/tight"),
    ("imu/navigation_matched", "filters/tight"),
    ("imu/navigation_matched", "filters/tight_extended"),
)


def prepared_case(imu: str, filter_: str, receiver: str = "receivers/l1_two_metre") -> PreparedCase:
    """Return the shipped ascent with an IMU and a filter."""
    sets = [f"base.imu={imu}", f"base.filter={filter_}", f"base.receiver={receiver}"]
    return prepare(load(campaign_file("campaigns/smoke.yaml"), sets).base)


def _phi(one: PreparedCase, w: int, sums: Floats, position: Floats) -> Floats:
    model, length_index = one.model, one.schedule.length_index[w]
    phi, blocks = np.eye(model.n_state), np.zeros((model.block_rows.size, 9))
    transition.fill(blocks, model.block_kinds, model.block_drivers, sums, *position, model.seconds[length_index])
    for b, (row, column) in enumerate(zip(model.block_rows, model.block_columns, strict=True)):
        factor = np.eye(model.n_state)
        factor[row : row + 3, column : column + 3] += blocks[b].reshape(3, 3)
        phi = factor @ phi
    phi = phi * model.decay[length_index][None, :]
    if model.clock >= 0:
        phi[model.clock] += model.seconds[length_index] * phi[model.clock + 1]
    return phi


def sequence(one: PreparedCase) -> tuple[Floats, list[tuple[Floats, Floats, list[tuple[Floats, float]]]]]:
    """Return P at the start, and for every window Phi, the variances of Q and the rows (h, R) at its end."""
    model, tape, schedule = one.model, forward_tape(one), one.schedule
    n = model.n_state
    steps = []
    for w in range(schedule.n_tick.size):
        length_index = schedule.length_index[w]
        phi = np.eye(n)
        noise = model.noise[length_index] if schedule.n_tick[w] else np.zeros(n)
        if schedule.n_tick[w]:
            phi = _phi(one, w, tape.sums[w], tape.position[w])
        rows = []
        for k in range(tape.first[w], tape.first[w + 1]):
            channel, h = tape.channel[k], np.zeros(n)
            h[model.column[channel, : model.n_entry[channel]]] = tape.h[k][
                model.entry[channel, : model.n_entry[channel]]
            ]
            rows.append((h, float(one.signals.variance[tape.epoch[k], channel])))
        steps.append((phi, noise, rows))
    return one.initial_state.P, steps


@njit
def symmetric(P, h, r):  # type: ignore[no-untyped-def]
    """Update P by P - K S K', one triangle mirrored."""
    n = P.shape[0]
    k = np.zeros_like(h)
    s = r
    for i in range(n):
        for j in range(n):
            k[i] += P[i, j] * h[j]
    for i in range(n):
        s += h[i] * k[i]
    for i in range(n):
        gain = k[i] / s
        for j in range(i, n):
            P[i, j] -= gain * k[j]
            P[j, i] = P[i, j]


@njit
def factorise(P, U, D):  # type: ignore[no-untyped-def]
    """Set U (unit upper triangular) and D to those of P = U D U'."""
    n = P.shape[0]
    for j in range(n - 1, -1, -1):
        for i in range(j, -1, -1):
            value = P[i, j]
            for k in range(j + 1, n):
                value -= U[i, k] * D[k] * U[j, k]
            if i == j:
                D[j], U[j, j] = value, 1.0
            else:
                U[i, j] = value / D[j] if D[j] != 0.0 else 0.0


@njit
def bierman(U, D, h, r):  # type: ignore[no-untyped-def]
    """Update U, D by a scalar measurement (Bierman 1977)."""
    n = D.size
    f, v, b = np.zeros_like(D), np.zeros_like(D), np.zeros_like(D)
    for j in range(n):
        f[j] = h[j]
        for i in range(j):
            f[j] += U[i, j] * h[i]
        v[j] = D[j] * f[j]
    alpha = r
    for j in range(n):
        before = alpha
        alpha += f[j] * v[j]
        D[j] *= before / alpha
        p = -f[j] / before
        for i in range(j):
            u = U[i, j]
            U[i, j] = u + b[i] * p
            b[i] += u * v[j]
        b[j] = v[j]


@njit
def thornton(U, D, phi, q):  # type: ignore[no-untyped-def]
    """Propagate U, D by Phi and the diagonal q by modified weighted Gram-Schmidt (Thornton 1976)."""
    n = D.size
    W, weight = np.zeros((n, 2 * n), U.dtype), np.zeros(2 * n, U.dtype)
    for i in range(n):
        for j in range(n):
            for k in range(j + 1):
                W[i, j] += phi[i, k] * U[k, j]
        W[i, n + i] = 1.0
        weight[i], weight[n + i] = D[i], q[i]
    for j in range(n - 1, -1, -1):
        total = W[j, 0] * weight[0] * W[j, 0]
        for k in range(1, 2 * n):
            total += W[j, k] * weight[k] * W[j, k]
        D[j], U[j, j] = total, 1.0
        for i in range(j):
            u = W[i, 0] * weight[0] * W[j, 0]
            for k in range(1, 2 * n):
                u += W[i, k] * weight[k] * W[j, k]
            u = u / total if total > 0.0 else 0.0 * u
            U[i, j] = u
            for k in range(2 * n):
                W[i, k] -= u * W[j, k]


def replay(start: Floats, steps: Any, form: str, kind: Any) -> tuple[Floats, bool]:
    """Return the sigmas after every window, and whether a variance was ever negative."""
    P, sigmas, broken = start.astype(kind), [], False
    n = P.shape[0]
    U, D = np.eye(n, dtype=kind), np.zeros(n, dtype=kind)
    if form == "U D U'":
        factorise(P, U, D)
    for phi, noise, rows in steps:
        F, q = phi.astype(kind), noise.astype(kind)
        half = (q / kind(2)).astype(kind)
        if form == "U D U'":
            # half of the noise before and half after, as the package adds it
            thornton(U, D, np.eye(n, dtype=kind), half)
            thornton(U, D, F, half)
        else:
            P = F @ (P + np.diag(half)) @ F.T + np.diag(half)
            P = ((P + P.T) / kind(2)).astype(kind)
        for h_, r_ in rows:
            h, r = h_.astype(kind), kind(r_)
            if form == "symmetric":
                symmetric(P, h, r)
            elif form == "Joseph":
                k = (P @ h) / (h @ P @ h + r)
                A = np.eye(n, dtype=kind) - np.outer(k, h)
                P = A @ P @ A.T + r * np.outer(k, k)
            else:
                bierman(U, D, h, r)
        variance = np.einsum("ij,j,ij->i", U, D, U) if form == "U D U'" else np.diag(P)
        broken |= bool((variance < 0.0).any())
        sigmas.append(np.sqrt(np.maximum(variance, 0.0)))
    return np.array(sigmas), broken


def cost(n: int) -> tuple[float, float, float, float, float]:
    """Return microseconds: update symmetric, Joseph, Bierman; propagation by blocks of three, Thornton."""
    rng = np.random.default_rng(1)
    P = np.eye(n) + 0.1 * np.ones((n, n))
    entries, columns = np.arange(10), np.r_[6, 7, 8, 0, 1, 2, 3, 4, 5, n - 2]
    h, x, K = rng.normal(size=13), np.zeros(n), np.zeros(n)
    rows, cols = np.array([6, 3, 3, 0, 6]), np.array([3, 0, 6, 9, 3])
    blocks, decay, noise = 1e-3 * rng.normal(size=(5, 9)), np.ones(n), np.full(n, 1e-9)
    U, D, dense, phi = np.eye(n), np.ones(n), np.zeros(n), np.eye(n) + 1e-3 * rng.normal(size=(n, n))
    dense[columns] = h[entries]

    def timed(call: Any) -> float:
        call()
        best = np.inf
        for _ in range(30):
            start = time.perf_counter()
            for _ in range(200):
                call()
            best = min(best, (time.perf_counter() - start) / 200)
        return 1e6 * best

    return (
        timed(lambda: update_scalar(P, x, K, h, entries, columns, 0.1, 1.0, np.inf, n, False)),
        timed(lambda: update_scalar(P, x, K, h, entries, columns, 0.1, 1.0, np.inf, n, True)),
        timed(lambda: bierman(U, D, dense, 1.0)),
        timed(lambda: predict(P, blocks, rows, cols, decay, noise, n - 2, 0.1)),
        timed(lambda: thornton(U, D, phi, noise)),
    )


def main() -> None:
    """Print what rounding leaves, and what each form costs."""
    for imu, filter_ in CASES:
        start, steps = sequence(prepared_case(imu, filter_))
        n_row = sum(len(rows) for _, _, rows in steps)
        exact, _ = replay(start, steps, "Joseph", np.longdouble)
        print(f"{imu}, {filter_}: {start.shape[0]} states, {len(steps)} windows, {n_row} rows")
        for kind in (np.float64, np.float32):
            for form in ("symmetric", "Joseph", "U D U'"):
                found, broken = replay(start, steps, form, kind)
                off = np.abs(found / np.where(exact > 0, exact, 1) - 1.0)[exact > 0].max()
                print(
                    f"  {kind.__name__:8} {form:10} worst sigma off by {off:.1e}", "negative variance" if broken else ""
                )
    for n in (17, 44):
        print(n, "states, microseconds:", *(f"{value:.2f}" for value in cost(n)))


if __name__ == "__main__":
    main()
