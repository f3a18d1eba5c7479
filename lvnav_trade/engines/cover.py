"""One pass over the nominal flight: the filter's covariance by its own model, the true one by source."""

from __future__ import annotations

from lvnav_trade.engines.absorbed import absorb_true
from lvnav_trade.engines.chained import advance, judged_rows, keep_error
from lvnav_trade.engines.sensing import profile_value
from lvnav_trade.engines.truth import REMAINDER
from lvnav_trade.filters.belief import INERTIAL, TIGHT
from lvnav_trade.filters.ekf import channel_of, fill_loose, fill_tight, place_antenna, rows_at
from lvnav_trade.filters.late import keep
from lvnav_trade.kernels import transition
from lvnav_trade.kernels.covariance import predict
from lvnav_trade.kernels.jit import inlined, jit
from lvnav_trade.kernels.joint import apply_phi, propagate_component
from lvnav_trade.kernels.strapdown import J4, R, gravity, mechanise, place
from lvnav_trade.kernels.transition import ATT, ATT_GYRO, GYRO, POS, VEL, VEL_ACCEL, VEL_GYRO, parameter_block
from lvnav_trade.observables import altitude
from lvnav_trade.world.gravity import GRAVITY


@jit
def fill_inputs(b, g, block, j, true, sums, seconds, decay, fade):
    """Set how the three components of block j and their driving noise enter e: b, g (3, n), minus what the filter's own
    estimate of the same thing takes off.
    """
    for axis in range(3):
        for i in range(b.shape[1]):
            b[axis, i], g[axis, i] = 0.0, 0.0
    sensor, driven_by, matched = true.sensor[j], true.driver[j], true.matched[j]
    at = ATT if sensor == GYRO else VEL
    if driven_by == GRAVITY:
        for axis in range(3):
            b[axis, VEL + axis], b[axis, POS + axis] = seconds, 0.5 * seconds * seconds
        return
    if driven_by == REMAINDER:
        if seconds > 0.0:
            for axis in range(3):
                for i in range(3):
                    turn = sums[3 * i + axis] / seconds
                    b[axis, at + i], g[axis, at + i] = turn, -turn
        return
    if matched >= 0:
        # the filter takes off its estimate with the same blocks, so only what the estimate misses remains: in e already
        for axis in range(3):
            b[axis, matched + axis] = fade - decay[matched + axis]
            g[axis, matched + axis] = 1.0
        return
    if seconds == 0.0:
        return
    first, last = (ATT_GYRO, VEL_GYRO) if sensor == GYRO else (VEL_ACCEL, VEL_ACCEL)
    for kind in range(first, last + 1):
        parameter_block(block, kind, driven_by, sums, seconds)
        for i in range(3):
            for axis in range(3):
                b[axis, at + i] = block[3 * i + axis]
        at = VEL
    for axis in range(3):
        for i in range(3):
            b[axis, POS + i] = 0.5 * seconds * b[axis, VEL + i]


@jit
def _advance_mean(mean, deviation, sums, seconds):
    """Add what is the same in every run: sensed minus true increments (bandwidth), and a gravity model that is not
    the truth's.
    """
    for i in range(3):
        turned, pushed = 0.0, 0.0
        for axis in range(3):
            turned += sums[3 * i + axis] * deviation[axis] / seconds
            pushed += sums[3 * i + axis] * deviation[3 + axis] / seconds
        mean[ATT + i] -= turned
        mean[VEL + i] += deviation[6 + i] * seconds - pushed
        mean[POS + i] += 0.5 * seconds * (deviation[6 + i] * seconds - pushed)


@jit
def _propagate_parameters(joint, scratch, sums, true, unit, belief, length, middle):
    """Let every true parameter act over a window, in its source's covariance or, for a profile, in the mean."""
    seconds, decay = belief.seconds[length], true.decay[length]
    for j in range(true.sensor.shape[0]):
        fade = true.fade[length, j]
        fill_inputs(scratch.b, scratch.g, scratch.block, j, true, sums, seconds, decay, fade)
        s, profile = true.source[j], true.profile[j]
        for axis in range(3):
            b, g = scratch.b[axis], scratch.g[axis]
            if profile >= 0:
                value = profile_value(unit, profile, axis, middle)
                change = value - joint.profile[profile, axis]
                joint.profile[profile, axis] = value
                # the value is the window's mean, so a change acts from the window's start
                apply_phi(g, scratch.D_true, true.nav_rows, true.nav_columns, decay, belief.clock, seconds)
                for i in range(b.shape[0]):
                    joint.mean[i] += b[i] * value + g[i] * change
            else:
                joint.variance[j, axis] = propagate_component(
                    joint.sources[s], joint.cross[j, axis], b, g, joint.variance[j, axis], fade,
                    true.wander[length, j], scratch.D_true, true.nav_rows, true.nav_columns, decay, belief.clock,
                    seconds,
                )  # fmt: skip


@jit
def _propagate_shared(joint, scratch, true, belief, length):
    """Let the errors that measurements share fade and wander over a window; in e they act where a state stands for
    them.
    """
    seconds, decay, n = belief.seconds[length], true.decay[length], joint.mean.shape[0]
    b, g = scratch.b[0], scratch.g[0]
    for i in range(n):
        b[i], g[i] = 0.0, 0.0
    for m in range(true.shared_source.shape[0]):
        matched, fade = true.shared_matched[m], true.shared_fade[length, m]
        if matched >= 0:
            b[matched], g[matched] = fade - decay[matched], 1.0
        joint.shared_variance[m] = propagate_component(
            joint.sources[true.shared_source[m]], joint.shared_cross[m], b, g, joint.shared_variance[m],
            fade, true.shared_wander[length, m], scratch.D_true, true.nav_rows, true.nav_columns, decay, belief.clock,
            seconds,
        )  # fmt: skip
        if matched >= 0:
            b[matched], g[matched] = 0.0, 0.0


@inlined
def _propagate(joint, scratch, nominal, true, unit, belief, length, first, n_tick, reference):
    """Propagate everything over one window: the filter's own covariance by its model, each source's by the truth's."""
    seconds, decay, sums, nav = belief.seconds[length], true.decay[length], nominal.sums, nominal.nav
    x, y, z = nav[R], nav[R + 1], nav[R + 2]
    transition.fill(scratch.D, belief.block_kinds, belief.block_drivers, sums, x, y, z, seconds)
    predict(
        joint.formal, scratch.D, belief.block_rows, belief.block_columns, belief.decay[length],
        belief.noise[length], belief.clock, seconds,
    )  # fmt: skip
    transition.fill(scratch.D_true, true.nav_kinds, true.nav_drivers, sums, x, y, z, seconds)
    rows, columns = true.nav_rows, true.nav_columns
    for i in range(joint.sources.shape[0]):
        noise = true.noise[i, length]
        predict(joint.sources[i], scratch.D_true, rows, columns, decay, noise, belief.clock, seconds)
    apply_phi(joint.mean, scratch.D_true, rows, columns, decay, belief.clock, seconds)
    _propagate_parameters(
        joint, scratch, sums, true, unit, belief, length, unit.start + unit.dt * (first + 0.5 * n_tick)
    )
    _propagate_shared(joint, scratch, true, belief, length)
    _set_deviation(scratch.deviation, unit, nav, belief, first, n_tick, reference)
    _advance_mean(joint.mean, scratch.deviation, sums, seconds)


@jit
def _set_deviation(deviation, unit, nav, belief, first, n_tick, reference):
    """Set what the window holds in every run: sensed minus true increments (6), error of the filter's gravity (3)."""
    for i in range(6):
        deviation[i] = 0.0
    for k in range(first, first + n_tick):
        for axis in range(3):
            deviation[axis] += unit.dtheta[k, axis] - reference.dtheta[k, axis]
            deviation[3 + axis] += unit.dvel[k, axis] - reference.dvel[k, axis]
    x, y, z = nav[R], nav[R + 1], nav[R + 2]
    tx, ty, tz = gravity(J4, x, y, z)
    ox, oy, oz = gravity(belief.gravity, x, y, z)
    deviation[6], deviation[7], deviation[8] = tx - ox, ty - oy, tz - oz


@jit
def _keep_window(tape, w, nominal):
    """Keep the sums of a window and the position that its blocks were filled at."""
    for i in range(nominal.sums.shape[0]):
        tape.sums[w, i] = nominal.sums[i]
    for i in range(3):
        tape.position[w, i] = nominal.nav[R + i]


@jit
def _turned(P, at, c0, c1, c2):
    a = P[at, at] * c0 * c0 + P[at + 1, at + 1] * c1 * c1 + P[at + 2, at + 2] * c2 * c2
    return a + 2.0 * (P[at, at + 1] * c0 * c1 + P[at, at + 2] * c0 * c2 + P[at + 1, at + 2] * c1 * c2)


@jit
def _write(out, hist, joint, axes_att, axes):
    sources, n = joint.sources, joint.formal.shape[0]
    for i in range(n):
        out.mean[hist, i] = joint.mean[i]
        for j in range(n):
            out.formal[hist, i, j] = joint.formal[i, j]
            total = 0.0
            for s in range(sources.shape[0]):
                total += sources[s, i, j]
            out.true[hist, i, j] = total
    for s in range(sources.shape[0]):
        for i in range(3):
            out.budget[hist, s, ATT + i] = _turned(sources[s], ATT, axes_att[i, 0], axes_att[i, 1], axes_att[i, 2])
            for at in (VEL, POS):
                out.budget[hist, s, at + i] = _turned(sources[s], at, axes[i, 0], axes[i, 1], axes[i, 2])
        for i in range(9, n):
            out.budget[hist, s, i] = sources[s, i, i]


@jit
def _fly_window(nominal, reference, first, n_tick, dt, kind):
    """Mechanise the ideal unit's increments over a window from the true state: the sums that the transition needs."""
    place(nominal.nav, reference, first)
    for k in range(n_tick):
        for axis in range(3):
            nominal.increments[k, axis] = reference.dtheta[first + k, axis]
            nominal.increments[k, 3 + axis] = reference.dvel[first + k, axis]
    mechanise(nominal.nav, nominal.sums, nominal.previous, nominal.increments, n_tick, dt, kind)


@jit
def _fill(nominal, signals, belief, epoch):
    """Fill the rows of an epoch on the nominal flight."""
    if belief.kind == TIGHT:
        for slot in range(signals.n_used[epoch]):
            s = signals.used[epoch, slot]
            nominal.ranges[slot, 0], nominal.ranges[slot, 1] = signals.range[epoch, s], signals.rate[epoch, s]
        fill_tight(nominal, belief, signals, epoch)
    else:
        for axis in range(3):
            nominal.solution[axis] = signals.position[epoch, axis]
            nominal.solution[3 + axis] = signals.velocity[epoch, axis]
        fill_loose(nominal, belief, signals, epoch)


@jit
def _fill_judged(nominal, formal, signals, belief, chain, late, epoch):
    """Fill the rows of a solution with a covariance of its own."""
    for i in range(6):
        nominal.solution[i] = chain.point[epoch, i]
    fill_loose(nominal, belief, signals, epoch)
    judged_rows(nominal, formal, chain, late, epoch)


@inlined
def _update(out, joint, scratch, tape, nominal, signals, true, belief, dt, chain, late, gains, epoch):
    """Absorb the rows that the filter would absorb at an epoch."""
    if belief.clock >= 0:
        joint.mean[belief.clock] += signals.clock_jump[epoch]
    if chain is not None:
        advance(joint, scratch.y, chain, true, epoch)
    n_row = rows_at(belief, signals, epoch)
    if chain is not None and not chain.solved[epoch]:
        n_row = 0
    if n_row == 0:
        return
    place_antenna(nominal, late, belief, dt)
    if chain is not None:
        _fill_judged(nominal, joint.formal, signals, belief, chain, late, epoch)
    else:
        _fill(nominal, signals, belief, epoch)
    for row in range(n_row):
        channel = channel_of(belief, signals, epoch, row)
        h, surprise = nominal.H[row], nominal.z[row]
        square = absorb_true(joint, scratch, tape, gains, h, surprise, epoch, channel, signals, true, belief)
        out.expected_nis[epoch] += square
        out.worst_ratio[epoch] = max(out.worst_ratio[epoch], square)
    out.n_row[epoch] = n_row


@inlined
def _update_height(out, joint, scratch, tape, altimeter, nominal, signals, true, belief, epoch):
    """Absorb what an altimeter (Altimeter, or None) measures at an epoch."""
    if altimeter is not None and altimeter.on[epoch]:
        h, channel = nominal.H[nominal.H.shape[0] - 1], belief.n_entry.shape[0] - 1
        surprise = altimeter.height[epoch] - altitude.row(h, nominal.nav)
        square = absorb_true(joint, scratch, tape, None, h, surprise, epoch, channel, signals, true, belief)
        out.expected_nis[epoch] += square
        out.worst_ratio[epoch] = max(out.worst_ratio[epoch], square)
        out.n_row[epoch] += 1


@inlined
def _keep(joint, nominal, true, belief, reference, tick, dt, late, window):
    """Keep the state and its error that the next late measurement will be met with."""
    if late is not None:
        place(nominal.nav, reference, tick)
        keep(nominal.past, nominal.nav, nominal.previous, late, window, dt, belief.gravity)
        keep_error(joint, true, late, window)


@jit
def cover(
    out, joint, scratch, tape, nominal, schedule, unit, signals, record, axes_att, belief, true, reference, chain, late,
    gains, altimeter,
):  # fmt: skip
    """Carry the filter's covariance and the true one, source by source, over the nominal flight; `out` is filled.

    Parameters
    ----------
    out : Cover, joint : Joint at the start, scratch : Scratch, tape : Tape, nominal : Nominal; all updated
    schedule : Schedule, unit : Unit, signals : Signals, record : Record, belief : Belief, true : TrueModel
    axes_att : (n_hist, 3, 3) from frame i to body axes at the history times
    reference : Reference, the true motion; chain : Chain, or None; late : Late, or None; gains : Gains, or None;
        altimeter : Altimeter, or None
    """
    for w in range(schedule.n_tick.shape[0]):
        first, n_tick = schedule.first_tick[w], schedule.n_tick[w]
        if n_tick > 0:
            _fly_window(nominal, reference, first, n_tick, unit.dt, belief.gravity)
            _propagate(joint, scratch, nominal, true, unit, belief, schedule.length[w], first, n_tick, reference)
            if tape.channel.shape[0] > 0:
                _keep_window(tape, w, nominal)
            _keep(joint, nominal, true, belief, reference, first + n_tick, unit.dt, late, w)
        epoch, hist = schedule.epoch[w], schedule.hist[w]
        if epoch >= 0 and belief.kind != INERTIAL:
            place(nominal.nav, reference, first + n_tick)
            _update(out, joint, scratch, tape, nominal, signals, true, belief, unit.dt, chain, late, gains, epoch)
            _update_height(out, joint, scratch, tape, altimeter, nominal, signals, true, belief, epoch)
        if tape.channel.shape[0] > 0:
            tape.first_row[w + 1] = tape.used[0]
        if hist >= 0:
            _write(out, hist, joint, axes_att[hist], record.axes[hist])
