"""Backwards from a metric at an event: how much of its variance each source put in, and when.

For m = l' e at the event, lambda = l goes back through every update and window of the forward pass with the same
gains. A noise that entered with vector g and variance q contributes (lambda' g)^2 q, labelled with its source and
its time; the sum over times is the forward budget, the sum over sources tells when the error was made.
"""

from typing import NamedTuple

from lvnav_trade.engines.lincov.propagate import fill_inputs
from lvnav_trade.engines.lincov.receiver_error import clone_back, solution_back
from lvnav_trade.engines.lincov.samples import fill_partials, nominal_tick
from lvnav_trade.engines.lincov.successive import joint_back, renew_back
from lvnav_trade.engines.lincov.update import component_partial, measured_channel, n_entering
from lvnav_trade.filters.late import place_of_channel
from lvnav_trade.kernels import transition
from lvnav_trade.kernels.covariance import apply_phi_transposed
from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.vehicle import N_SAMPLE, advance_vector_transposed, fill_samples
from lvnav_trade.records import Floats


class Backward(NamedTuple):
    """State and outcome of a backward pass. e (n_metric, N) and c (n_metric, n_component) multipliers of states
    and components, updated; contribution (n_metric, n_source, n_bin) variance put in by each source in each time bin,
    set.
    """

    e: Floats
    c: Floats
    contribution: Floats


@jit
def _dot(a, b):
    """Return the sum of products over the length of `a`; `b` may be longer."""
    total = 0.0
    for i in range(a.shape[0]):
        total += a[i] * b[i]
    return total


@jit
def _update_back(back, gain, h, epoch, channel, time_bin, whitened, place, signals, true):
    """Go back through one update: what its noise put in, and the multipliers before it."""
    source = true.noise_source[channel]
    # what is in a decorrelated solution went in with the solution's own error
    is_in_states = whitened or source < 0
    variance = 0.0 if is_in_states else signals.sigma[epoch, measured_channel(signals, channel)] ** 2
    for m in range(back.e.shape[0]):
        through = _dot(gain, back.e[m])
        if variance > 0.0:
            back.contribution[m, source, time_bin] += through * through * variance
        for family in range(n_entering(signals, whitened)):
            c, partial = component_partial(h, signals, true, family, epoch, channel, whitened)
            if c >= 0:
                back.c[m, true.first_shared + c] -= through * partial
        row = true.differences.of[channel]
        if row >= 0:
            for c in range(true.first_shared):
                back.c[m, c] -= through * true.differences.reach[row, epoch, c]
        for k in range(true.n_entry[channel]):
            back.e[m, true.column[place, channel, k]] -= through * h[true.entry[place, channel, k]]


@jit
def _components_back(back, scratch, sums, true, units, model, length, first, n_tick, time_bin):
    """Go back through a window for the components: their driving noise, their decay, and what they put into states."""
    decay = true.decay[length]
    fill_inputs(scratch, true, units, sums, model.seconds[length], first, n_tick)
    for c in range(true.source.shape[0]):
        source, k, states = true.source[c], true.slot[c], (true.state_from[c], true.state_from[c + 1])
        g, lane = true.group[source], true.lane[source]
        factor, noise = true.factor[length, g, k, 0, lane], true.noise[length, g, k, 0, lane]
        echo = 1.0 if true.echo[length, g, k, 0, lane] > 0.0 else 0.0
        b = scratch.b[g, k, ..., lane]
        for m in range(back.e.shape[0]):
            through, entered = back.c[m, c], 0.0
            # the component and the filter's errors in it are driven by the same noise
            for p in range(states[0], states[1]):
                at = true.states[p]
                through += back.e[m, at]
                entered += (factor - decay[at]) * back.e[m, at]
            if states[0] == states[1] and true.moves[g, k]:
                entered = _dot(b, back.e[m])
                through -= echo * entered
            back.contribution[m, source, time_bin] += through * through * noise
            back.c[m, c] = factor * back.c[m, c] + entered


@jit
def _white_back(back, true, length, time_bin):
    """Add half of a window's white noise of every source (the other half enters at the window's other end)."""
    for source in range(true.group.shape[0]):
        white = true.white[length, true.group[source], ..., true.lane[source]]
        for i in range(back.e.shape[1]):
            if white[i] > 0.0:
                for m in range(back.e.shape[0]):
                    back.contribution[m, source, time_bin] += 0.5 * white[i] * back.e[m, i] * back.e[m, i]


@jit
def _start_back(back, true):
    """Add what every source holds at the start: initial errors, and components with what they put in states."""
    n = back.e.shape[1]
    for m in range(back.e.shape[0]):
        for source in range(true.initial.shape[0]):
            for i in range(n):
                for k in range(n):
                    back.contribution[m, source, 0] += back.e[m, i] * true.initial[source, i, k] * back.e[m, k]
        for c in range(true.source.shape[0]):
            through = back.c[m, c]
            for p in range(true.state_from[c], true.state_from[c + 1]):
                through += back.e[m, true.states[p]]
            back.contribution[m, true.source[c], 0] += through * through * true.start[c]


@jit
def _samples_back(back, scratch, tape, true, unit, units, vehicle, reference, tick, time_bin):
    """Go back through the propagation and the update of a tick whose samples are measurements."""
    nominal_tick(scratch.sums, reference, tick, unit.dt)
    fill_samples(scratch.h, vehicle.blocks, vehicle.rate[tick], vehicle.force[tick])
    fill_partials(scratch.a, true, units, vehicle, tick, unit.dt)
    for m in range(back.e.shape[0]):
        y = back.e[m]
        advance_vector_transposed(y, scratch.sums, unit.dt, vehicle.motion)
        for r in range(N_SAMPLE):
            scratch.y[r] = _dot(tape.sample_gain[tick, r], y)
        for source in range(true.group.shape[0]):
            for r in range(N_SAMPLE):
                through = scratch.y[r]
                back.contribution[m, source, time_bin] += through * through * true.sample_noise[source, r]
        for j in range(true.sensor.shape[0]):
            if true.sampled[j] and true.profile[j] < 0:
                first = true.first[j]
                source, k = true.source[first], true.slot[first]
                g, lane = true.group[source], true.lane[source]
                for axis in range(3):
                    for i in range(1 if units is None else 3):  # an axis of a unit enters the whole fused triad
                        r = 3 * true.sensor[j] + (axis + i) % 3
                        back.c[m, first + axis] -= scratch.y[r] * scratch.a[g, k + axis, r, lane]
        for r in range(N_SAMPLE):
            for k in range(vehicle.columns.shape[1]):
                y[vehicle.columns[r, k]] -= scratch.y[r] * scratch.h[r, k]


@jit
def _window_back(back, scratch, tape, w, true, units, model, schedule, time_bin):
    """Go back through the propagation of a window."""
    length = schedule.length[w]
    sums, at, seconds = tape.sums[w], tape.position[w], model.seconds[length]
    transition.fill(scratch.D, true.nav_kinds, true.nav_drivers, sums, at[0], at[1], at[2], seconds)
    _white_back(back, true, length, time_bin)
    _components_back(
        back, scratch, sums, true, units, model, length, schedule.first_tick[w], schedule.n_tick[w], time_bin
    )
    for m in range(back.e.shape[0]):
        apply_phi_transposed(
            back.e[m], scratch.D, true.nav_rows, true.nav_columns, true.decay[length], model.clock, seconds
        )
    _white_back(back, true, length, time_bin)


@jit
def go_back(
    back, scratch, tape, last_window, time_bins, schedule, unit, units, signals, true, model, chain, late, delayed,
    successive, vehicle, reference,
):  # fmt: skip
    """Carry the multipliers from the end of a window back to the start of the flight; `back` is filled.

    Parameters
    ----------
    back : Backward, with e set to the metrics' rows; scratch : BackwardScratch; tape : Tape of the forward pass
    last_window : the metric stands at its end; time_bins (n_window,) bin of each window
    schedule : Schedule; unit : Unit; units : Units, or None; signals : Signals; true : Components; model : FilterModel
    chain : Chain; late : Late; delayed : Delayed; successive : Successive; vehicle : VehicleModel; or None; reference :
    Reference
    """
    for w in range(last_window, -1, -1):
        time_bin = time_bins[w]
        if schedule.epoch[w] >= 0:
            joint_back(back, true, late, delayed, schedule.epoch[w])
        for row in range(tape.first[w + 1] - 1, tape.first[w] - 1, -1):
            epoch, channel = tape.epoch[row], tape.channel[row]
            whitened, place = chain is not None and channel < signals.n_receiver, 0
            if late is not None:
                place = place_of_channel(late, channel, epoch)
            _update_back(back, tape.gain[row], tape.h[row], epoch, channel, time_bin, whitened, place, signals, true)
        if chain is not None and schedule.epoch[w] >= 0:
            solution_back(back, scratch.y, chain, true, schedule.epoch[w], time_bin)
        if successive is not None and schedule.epoch[w] >= 0:
            renew_back(back, successive, model, schedule.epoch[w], time_bin)
            solution_back(back, scratch.y, successive, true, schedule.epoch[w], time_bin)
        if schedule.n_tick[w] == 0:
            continue
        clone_back(back, true, late, w)
        _window_back(back, scratch, tape, w, true, units, model, schedule, time_bin)
        if vehicle is not None:
            for tick in range(schedule.first_tick[w] + schedule.n_tick[w] - 1, schedule.first_tick[w] - 1, -1):
                _samples_back(back, scratch, tape, true, unit, units, vehicle, reference, tick, time_bin)
    _start_back(back, true)
