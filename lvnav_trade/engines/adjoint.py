"""Backwards from a metric at an event: how much of its variance each source put in, and when.

For m = l' e at the event, lambda = l goes back through every update and window of the forward pass with the same
gains. A noise that entered with vector g and variance q contributes (lambda' g)^2 q, labelled with its source and
its time; the sum over times is the forward budget, the sum over sources tells when the error was made.
"""

from __future__ import annotations

from typing import NamedTuple

from lvnav_trade.engines.absorbed import shared_partial
from lvnav_trade.engines.chained import go_back as go_back_chain
from lvnav_trade.engines.chained import unkeep
from lvnav_trade.engines.cover import fill_inputs
from lvnav_trade.kernels import transition
from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.joint import apply_phi_transposed
from lvnav_trade.records import Floats


class Backward(NamedTuple):
    """State and outcome of a backward pass. e (n_metric, n), c (n_metric, n_block, 3) and shared (n_metric,
    n_component) multipliers, updated; contribution (n_metric, n_source, n_bin) variance put in by each source in each
    time bin, set.
    """

    e: Floats
    c: Floats
    shared: Floats
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
def _back_row(back, gain, h, epoch, channel, time_bin, signals, true, belief):
    """Go back through one row: what its noise put in, and the multipliers before it."""
    n, source = true.n_entry[channel], true.row_source[belief.row_type[channel]]
    # what is in a judged solution went in with the solution's own error
    variance = 0.0 if belief.judged else signals.sigma[epoch, channel] ** 2
    shared = signals.shared.member
    n_family = 0 if belief.judged else shared.shape[0]
    for m in range(back.e.shape[0]):
        through = _dot(back.e[m], gain)
        back.contribution[m, source, time_bin] += through * through * variance
        for family in range(n_family):
            component = shared[family, channel]
            if component >= 0:
                back.shared[m, component] -= through * shared_partial(signals, true, family, epoch, channel)
        for k in range(n):
            back.e[m, true.column[channel, k]] -= through * h[true.entry[channel, k]]


@jit
def _back_shared(back, true, belief, length, time_bin):
    """Go back through a window for every shared error: its driving noise's share, and its multiplier before."""
    for k in range(true.shared_source.shape[0]):
        fade, wander, at = true.shared_fade[length, k], true.shared_wander[length, k], true.shared_matched[k]
        for m in range(back.e.shape[0]):
            in_e = back.e[m, at] if at >= 0 else 0.0
            if wander > 0.0:
                through = back.shared[m, k] + in_e
                back.contribution[m, true.shared_source[k], time_bin] += through * through * wander
            back.shared[m, k] *= fade
            if at >= 0:
                back.shared[m, k] += in_e * (fade - belief.decay[length, at])


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
    seconds, decay = belief.seconds[length], true.decay[length]
    for j in range(true.sensor.shape[0]):
        if true.profile[j] >= 0:
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
        for k in range(true.shared_source.shape[0]):
            at = true.shared_matched[k]
            through = back.shared[m, k] + (back.e[m, at] if at >= 0 else 0.0)
            back.contribution[m, true.shared_source[k], 0] += through * through * true.shared_start[k]


@jit
def go_back(back, scratch, tape, last_window, time_bins, schedule, signals, true, belief, chain, late):
    """Carry the multipliers from the end of a window back to the start of the flight; `back` is filled.

    Parameters
    ----------
    back : Backward, with e set to the metrics' rows; scratch : BackScratch; tape : Tape of the forward pass
    last_window : the metric stands at its end; time_bins (n_window,) bin of each window
    schedule : Schedule; signals : Signals; true : TrueModel; belief : Belief; chain : Chain, or None; late : Late, or
        None
    """
    n_metric = back.e.shape[0]
    for w in range(last_window, -1, -1):
        time_bin = time_bins[w]
        for row in range(tape.first_row[w + 1] - 1, tape.first_row[w] - 1, -1):
            epoch, channel = tape.epoch[row], tape.channel[row]
            _back_row(back, tape.gain[row], tape.h[row], epoch, channel, time_bin, signals, true, belief)
        if chain is not None and schedule.epoch[w] >= 0:
            go_back_chain(back, scratch.y, chain, true, schedule.epoch[w], time_bin)
        if schedule.n_tick[w] == 0:
            continue
        unkeep(back, true, late, w)
        length, sums, at = schedule.length[w], tape.sums[w], tape.position[w]
        seconds = belief.seconds[length]
        noise = true.noise[:, length]
        transition.fill(scratch.D, true.nav_kinds, true.nav_drivers, sums, at[0], at[1], at[2], seconds)
        _back_noise(back, noise, time_bin)
        _back_parameters(back, scratch, sums, true, belief, length, time_bin)
        _back_shared(back, true, belief, length, time_bin)
        for m in range(n_metric):
            apply_phi_transposed(
                back.e[m],
                scratch.D,
                true.nav_rows,
                true.nav_columns,
                true.decay[length],
                belief.clock,
                seconds,
            )
        _back_noise(back, noise, time_bin)
    _back_start(back, true)
