"""Backwards from a metric at an event: how much of its variance each source put in, and when.

For m = l' e at the event, lambda = l goes back through every update and window of the forward pass with the same
gains. A noise that entered with vector g and variance q contributes (lambda' g)^2 q, labelled with its source and
its time; the sum over times is the forward budget, the sum over sources tells when the error was made.
"""

from __future__ import annotations

from typing import NamedTuple

from lvnav_trade.engines.lincov.propagate import N_NAV, input_matrix
from lvnav_trade.engines.lincov.receiver_error import clone_back, solution_back
from lvnav_trade.engines.lincov.samples import fill_partials, nominal_tick
from lvnav_trade.engines.lincov.update import known_partial, measured_channel, shared_partial
from lvnav_trade.kernels import transition
from lvnav_trade.kernels.covariance import apply_phi_transposed
from lvnav_trade.kernels.jit import inlined, jit
from lvnav_trade.kernels.vehicle import N_SAMPLE, advance_vector_transposed, fill_samples
from lvnav_trade.records import Floats


class Backward(NamedTuple):
    """State and outcome of a backward pass. e (n_metric, N) and c (n_metric, n_source, n_slot) multipliers of states
    and components, updated; contribution (n_metric, n_source, n_bin) variance put in by each source in each time bin,
    set.
    """

    e: Floats
    c: Floats
    contribution: Floats


class BackScratch(NamedTuple):
    """Work arrays: D (n_block, 9), y (N,), input (9, 3), block (9,), sums (18,), h (6, n_entry); a: SampleScratch."""

    D: Floats
    y: Floats
    input: Floats
    block: Floats
    sums: Floats
    h: Floats
    a: Floats


@jit
def _dot(a, b):
    total = 0.0
    for i in range(a.shape[0]):
        total += a[i] * b[i]
    return total


@jit
def _update_back(back, gain, h, epoch, channel, time_bin, mixed, ring, signals, true, model):
    """Go back through one update: what its noise put in, and the multipliers before it."""
    n, source = true.n_entry[channel], true.noise_source[channel]
    # what is in a decorrelated solution went in with the solution's own error
    variance = 0.0 if mixed else signals.sigma[epoch, measured_channel(signals, channel)] ** 2
    member = signals.shared.member
    for m in range(back.e.shape[0]):
        through = _dot(back.e[m], gain)
        if variance > 0.0:
            back.contribution[m, source, time_bin] += through * through * variance
        if not mixed:
            for family in range(member.shape[0]):
                c = member[family, measured_channel(signals, channel)]
                if c >= 0:
                    partial = shared_partial(signals, true, family, epoch, channel)
                    back.c[m, true.shared_source[c], true.shared_slot[c]] -= through * partial
        else:
            for c in range(true.shared_source.shape[0]):
                back.c[m, true.shared_source[c], true.shared_slot[c]] -= through * known_partial(h, signals, c)
        for k in range(n):
            back.e[m, true.column[ring, channel, k]] -= through * h[true.entry[ring, channel, k]]


@jit
def _drive_back(back, true, length, time_bin):
    """Go back through the driving noise of components and their decay, and through states that stand for them."""
    for m in range(back.e.shape[0]):
        for p in range(true.state_at.shape[0]):
            source, k, at = true.state_source[p], true.state_slot[p], true.state_at[p]
            g, lane = true.group[source], true.lane[source]
            noise = true.noise[length, g, k, 0, lane]
            # the component and the filter's error in it are driven by the same noise
            through = back.c[m, source, k] + back.e[m, at]
            back.contribution[m, source, time_bin] += through * through * noise
            factor = true.factor[length, g, k, 0, lane]
            back.c[m, source, k] = factor * back.c[m, source, k] + (factor - true.decay[length, at]) * back.e[m, at]


@jit
def _blocks_back(back, scratch, sums, true, model, length, time_bin):
    """Go back through a window for the components of the IMU and of gravity that no state stands for."""
    seconds = model.seconds[length]
    for j in range(true.sensor.shape[0]):
        if true.profile[j] >= 0 or true.matched[j] >= 0:
            continue
        source = true.source[j]
        g, lane = true.group[source], true.lane[source]
        if true.moving[j]:
            input_matrix(scratch.input, scratch.block, j, true, sums, seconds)
        for axis in range(3):
            k = true.slot[j, axis]
            factor, noise = true.factor[length, g, k, 0, lane], true.noise[length, g, k, 0, lane]
            echo = 1.0 if true.echo[length, g, k, 0, lane] > 0.0 else 0.0
            for m in range(back.e.shape[0]):
                entered = 0.0
                if true.moving[j]:
                    for i in range(N_NAV):
                        entered += back.e[m, i] * scratch.input[i, axis]
                if noise > 0.0:
                    through = back.c[m, source, k] - echo * entered
                    back.contribution[m, source, time_bin] += through * through * noise
                back.c[m, source, k] = factor * back.c[m, source, k] + entered


@jit
def _shared_back(back, true, length, time_bin):
    """Go back through a window for errors that measurements share and no state stands for."""
    for c in range(true.shared_source.shape[0]):
        if true.shared_matched[c] >= 0:
            continue
        source, k = true.shared_source[c], true.shared_slot[c]
        g, lane = true.group[source], true.lane[source]
        factor, noise = true.factor[length, g, k, 0, lane], true.noise[length, g, k, 0, lane]
        for m in range(back.e.shape[0]):
            through = back.c[m, source, k]
            back.contribution[m, source, time_bin] += through * through * noise
            back.c[m, source, k] = factor * through


@jit
def _white_back(back, true, length, time_bin):
    """Add half of a window's white noise of every source (the other half enters at the window's other end)."""
    for source in range(true.group.shape[0]):
        g, lane = true.group[source], true.lane[source]
        for i in range(back.e.shape[1]):
            noise = true.white[length, g, i, lane]
            if noise > 0.0:
                for m in range(back.e.shape[0]):
                    back.contribution[m, source, time_bin] += 0.5 * noise * back.e[m, i] * back.e[m, i]


@jit
def _start_back(back, true):
    """Add what every source holds at the start: initial errors, and components with what they put in states."""
    n = back.e.shape[1]
    for m in range(back.e.shape[0]):
        for p in range(true.state_at.shape[0]):
            back.c[m, true.state_source[p], true.state_slot[p]] += back.e[m, true.state_at[p]]
        for source in range(true.initial.shape[0]):
            for i in range(n):
                for k in range(n):
                    back.contribution[m, source, 0] += back.e[m, i] * true.initial[source, i, k] * back.e[m, k]
            for k in range(true.start.shape[1]):
                back.contribution[m, source, 0] += back.c[m, source, k] ** 2 * true.start[source, k]


@inlined
def _samples_back(back, scratch, tape, true, unit, vehicle, reference, tick, time_bin):
    """Go back through the propagation and the update of a tick whose samples are measurements."""
    nominal_tick(scratch.sums, reference, tick, unit.dt)
    fill_samples(scratch.h, vehicle.blocks, vehicle.rate[tick], vehicle.force[tick])
    fill_partials(scratch.a, true, vehicle, tick)
    n, n_slot = tape.sample_gain.shape[2], true.followed.shape[1]
    for m in range(back.e.shape[0]):
        y = back.e[m]
        advance_vector_transposed(y, scratch.sums, unit.dt, vehicle.motion)
        for r in range(N_SAMPLE):
            scratch.y[r] = 0.0
            for i in range(n):
                scratch.y[r] += y[i] * tape.sample_gain[tick, r, i]
        for source in range(true.group.shape[0]):
            for r in range(N_SAMPLE):
                through = scratch.y[r]
                back.contribution[m, source, time_bin] += through * through * true.sample_noise[source, r]
        for j in range(true.sensor.shape[0]):
            if true.sampled[j] and true.profile[j] < 0:
                source = true.source[j]
                g, lane = true.group[source], true.lane[source]
                for axis in range(3):
                    r, k = 3 * true.sensor[j] + axis, true.slot[j, axis]
                    partial = scratch.a[g * n_slot + k, r, 0, lane]
                    back.c[m, source, k] -= scratch.y[r] * partial
        for r in range(N_SAMPLE):
            for k in range(vehicle.columns.shape[1]):
                y[vehicle.columns[r, k]] -= scratch.y[r] * scratch.h[r, k]


@inlined
def _window_back(back, scratch, tape, w, true, model, length, time_bin):
    """Go back through the propagation of a window."""
    sums, at, seconds = tape.sums[w], tape.position[w], model.seconds[length]
    transition.fill(scratch.D, true.nav_kinds, true.nav_drivers, sums, at[0], at[1], at[2], seconds)
    _white_back(back, true, length, time_bin)
    _drive_back(back, true, length, time_bin)
    _blocks_back(back, scratch, sums, true, model, length, time_bin)
    _shared_back(back, true, length, time_bin)
    for m in range(back.e.shape[0]):
        apply_phi_transposed(
            back.e[m], scratch.D, true.nav_rows, true.nav_columns, true.decay[length], model.clock, seconds
        )
    _white_back(back, true, length, time_bin)


@jit
def go_back(
    back, scratch, tape, last_window, time_bins, schedule, unit, signals, true, model, chain, late, vehicle, reference
):
    """Carry the multipliers from the end of a window back to the start of the flight; `back` is filled.

    Parameters
    ----------
    back : Backward, with e set to the metrics' rows; scratch : BackScratch; tape : Tape of the forward pass
    last_window : the metric stands at its end; time_bins (n_window,) bin of each window
    schedule : Schedule; unit : Unit; signals : Signals; true : Components; model : FilterModel
    chain : Chain; late : Late; vehicle : VehicleModel; or None; reference : Reference
    """
    for w in range(last_window, -1, -1):
        time_bin = time_bins[w]
        for row in range(tape.first[w + 1] - 1, tape.first[w] - 1, -1):
            epoch, channel = tape.epoch[row], tape.channel[row]
            mixed, ring = chain is not None and channel < signals.n_receiver, 0
            if late is not None:
                ring = epoch % late.n_ring
            _update_back(back, tape.gain[row], tape.h[row], epoch, channel, time_bin, mixed, ring, signals, true, model)
        if chain is not None and schedule.epoch[w] >= 0:
            solution_back(back, scratch.y, chain, true, schedule.epoch[w], time_bin)
        if schedule.n_tick[w] == 0:
            continue
        clone_back(back, true, late, w)
        _window_back(back, scratch, tape, w, true, model, schedule.length[w], time_bin)
        if vehicle is not None:
            for tick in range(schedule.first_tick[w] + schedule.n_tick[w] - 1, schedule.first_tick[w] - 1, -1):
                _samples_back(back, scratch, tape, true, unit, vehicle, reference, tick, time_bin)
    _start_back(back, true)
