"""Backwards from a metric at an event: how much of its variance each source put in, and when.

For m = l' e at the event, lambda = l goes back through every update and window of the forward pass with the same
gains. A noise that entered with vector g and variance q contributes (lambda' g)^2 q, labelled with its source and
its time; the sum over times is the forward budget, the sum over sources tells when the error was made.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from lvnav_trade.engines.cover import Tape, fill_inputs
from lvnav_trade.kernels import transition
from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.joint import apply_phi_transposed
from lvnav_trade.records import Floats


class Backward(NamedTuple):
    """State and outcome of a backward pass. e (n_metric, n) and c (n_metric, n_block, 3) multipliers, updated;
    contribution (n_metric, n_source, n_bin) variance put in by each source in each time bin, set.
    """

    e: Floats
    c: Floats
    contribution: Floats


class BackScratch(NamedTuple):
    """Work arrays: D (n_block, 9); y (n,); b, g (3, n); block (9,)."""

    D: Floats
    y: Floats
    b: Floats
    g: Floats
    block: Floats


@jit
def _dot(a, b):
    total = 0.0
    for i in range(a.shape[0]):
        total += a[i] * b[i]
    return total


@jit
def _back_row(back, gain, h, kind, time_bin, true, belief):
    """Go back through one row: what its noise put in, and the multiplier before it."""
    n = belief.n_entry[kind]
    for m in range(back.e.shape[0]):
        through = _dot(back.e[m], gain)
        back.contribution[m, true.row_source[kind], time_bin] += through * through * true.row_variance[kind]
        for k in range(n):
            back.e[m, belief.column[kind, k]] -= through * h[belief.entry[kind, k]]


@jit
def _back_noise(back, noise, time_bin):
    """Add half of a window's white noise of every source (the other half enters at the window's other end)."""
    for m in range(back.e.shape[0]):
        for s in range(noise.shape[0]):
            for i in range(noise.shape[1]):
                if noise[s, i] > 0.0:
                    back.contribution[m, s, time_bin] += 0.5 * noise[s, i] * back.e[m, i] * back.e[m, i]


@jit
def _back_parameters(back, scratch, sums, true, belief, length, time_bin):
    """Go back through a window for every true parameter: its driving noise's share, and its multiplier before."""
    seconds, decay = belief.seconds[length], belief.decay[length]
    for j in range(true.sensor.shape[0]):
        if true.ramp[j] >= 0:
            continue
        fade, wander = true.fade[length, j], true.wander[length, j]
        fill_inputs(scratch.b, scratch.g, scratch.block, j, true, sums, seconds, decay, fade)
        for axis in range(3):
            for m in range(back.e.shape[0]):
                if wander > 0.0:
                    through = _dot(back.e[m], scratch.g[axis]) + back.c[m, j, axis]
                    back.contribution[m, true.source[j], time_bin] += through * through * wander
                back.c[m, j, axis] = fade * back.c[m, j, axis] + _dot(back.e[m], scratch.b[axis])


@jit
def _back_start(back, true):
    """Add what every source holds at the start: initial errors, and parameters with what they put in the estimate's
    error.
    """
    n = back.e.shape[1]
    for m in range(back.e.shape[0]):
        for s in range(true.initial.shape[0]):
            for i in range(n):
                for k in range(n):
                    back.contribution[m, s, 0] += back.e[m, i] * true.initial[s, i, k] * back.e[m, k]
        for j in range(true.sensor.shape[0]):
            for axis in range(3):
                through = back.c[m, j, axis]
                if true.matched[j] >= 0:
                    through += back.e[m, true.matched[j] + axis]
                back.contribution[m, true.source[j], 0] += through * through * true.start[j]


@jit
def go_back(back, scratch, tape, last_window, time_bins, schedule, true, belief):
    """Carry the multipliers from the end of a window back to the start of the flight; `back` is filled.

    Parameters
    ----------
    back : Backward, with e set to the metrics' rows; scratch : BackScratch; tape : Tape of the forward pass
    last_window : the metric stands at its end; time_bins (n_window,) bin of each window
    schedule : Schedule; true : TrueModel; belief : Belief
    """
    n_metric = back.e.shape[0]
    for w in range(last_window, -1, -1):
        time_bin = time_bins[w]
        for row in range(tape.first_row[w + 1] - 1, tape.first_row[w] - 1, -1):
            _back_row(back, tape.gain[row], tape.h[row], tape.kind[row], time_bin, true, belief)
        if schedule.n_tick[w] == 0:
            continue
        length, sums, at = schedule.length[w], tape.sums[w], tape.position[w]
        seconds = belief.seconds[length]
        noise = true.noise[:, length]
        transition.fill(scratch.D, true.nav_kinds, true.nav_drivers, sums, at[0], at[1], at[2], seconds)
        _back_noise(back, noise, time_bin)
        _back_parameters(back, scratch, sums, true, belief, length, time_bin)
        for m in range(n_metric):
            apply_phi_transposed(
                back.e[m],
                scratch.y,
                scratch.D,
                true.nav_rows,
                true.nav_columns,
                belief.decay[length],
                belief.clock,
                seconds,
            )
        _back_noise(back, noise, time_bin)
    _back_start(back, true)


def new_tape(n_window: int, n_row: int, n: int) -> Tape:
    """Return an empty tape for a flight of n_window windows and n_row rows; n_row 0 keeps nothing."""
    windows = n_window if n_row else 0
    return Tape(
        np.zeros((windows, 21)), np.zeros((windows, 3)), np.zeros((n_row, n)), np.zeros((n_row, 10)),
        np.zeros(n_row, dtype=np.int64), np.zeros(windows + 1, dtype=np.int64), np.zeros(1, dtype=np.int64),
    )  # fmt: skip
