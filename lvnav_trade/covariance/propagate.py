"""Propagation of the joint covariance over a window of the nominal flight, source by source."""

from lvnav_trade.covariance.component_inputs import N_NAV, fill_inputs
from lvnav_trade.covariance.deterministic_errors import add_deviations, advance_profiles
from lvnav_trade.filter.ekf import predict_covariance
from lvnav_trade.kernels import transition
from lvnav_trade.kernels.covariance import apply_phi, enter, predict
from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.lanes import group
from lvnav_trade.kernels.mechanisation import mechanise
from lvnav_trade.kernels.strapdown import R, place
from lvnav_trade.kernels.transition import EVERY_WINDOW, linearise, linearised_sums


@jit
def nominal_window(nominal, reference, unit, first, n_tick, algorithm, sensed, linearised=EVERY_WINDOW):
    """Integrate the strapdown over a window from the true state, to get the integrals that the transition needs.

    Parameters
    ----------
    nominal : Nominal; its state, increments and integrals are set
    reference, unit : Reference, ImuTruth
    first, n_tick : first tick, number of ticks
    algorithm : Strapdown
    sensed : whether the increments are those that the IMU outputs (bandwidth), if the error of the strapdown algorithm
        is included; otherwise they are true increments
    linearised : code of `transition.linearise`
    """
    place(nominal.nav, reference, first)
    linearise(nominal.rates, nominal.nav, linearised)
    increments = nominal.increments
    for k in range(n_tick):
        tick = first + k
        for axis in range(3):
            angle = reference.dtheta[tick, axis]
            velocity = reference.dvel[tick, axis]
            if sensed and algorithm.counted:
                angle = unit.dtheta[tick, axis]
                velocity = unit.dvel[tick, axis]
            increments[k, axis] = angle
            increments[k, 3 + axis] = velocity
    n_step = n_tick // algorithm.subsamples
    step = unit.dt * algorithm.subsamples
    seconds = unit.dt * first
    mechanise(nominal.nav, nominal.sums, nominal.previous, increments, n_step, step, algorithm, seconds)


@jit
def _enter_over_window(P, y, b, variance, echo):
    """Add the effect of components c, one per lane, over a window: x += b c, before c decays.

    Parameters
    ----------
    P, y : (N, N) covariance of x, and (N,) Cov(x, c); both updated in place
    b, variance : (9,) sensitivity of attitude, velocity and position to c, and variance of c
    echo : variance of the driving noise of c that also enters the states, with the opposite sign of b
    """
    # P + b y' + y b' + (variance + echo) b b'; the last term is shared between the two loops over i and j
    n = P.shape[0]
    half = 0.5 * (variance + echo)
    for i in range(N_NAV):
        bi = b[i]
        for j in range(N_NAV):
            covariance = y[j] + half * b[j]
            added = bi * covariance
            P[i, j] += added
            P[j, i] += added
        for j in range(N_NAV, n):
            added = bi * y[j]
            P[i, j] += added
            P[j, i] += added
    for i in range(N_NAV):
        y[i] += b[i] * variance


@jit
def _advance_components(joint, scratch, true, length, g):
    """Add the effect of the components of a group over a window, then propagate the components themselves."""
    factors = group(true.factor[length], g)
    noises = group(true.noise[length], g)
    echoes = group(true.echo[length], g)
    variances = group(joint.variance, g)
    cross_covariances = group(joint.cross, g)
    b = group(scratch.b, g)
    P = group(joint.sources, g)
    for k in range(true.n_slot[g]):
        factor = factors[k, 0]
        echo = echoes[k, 0]
        variance = variances[k, 0]
        y = cross_covariances[k]
        if true.has_cross[g, k]:
            if true.moves[g, k]:
                _enter_over_window(P, y, b[k], variance, echo)
            for i in range(y.shape[0]):
                y[i] = factor * y[i]
            if true.moves[g, k]:
                # the new remainder enters the states with the sign opposite to that of the component
                for i in range(N_NAV):
                    y[i] -= echo * b[k, i]
        variances[k, 0] = factor * factor * variance + noises[k, 0]  # c+ = f c + w


@jit
def _enter_states(joint, true, b, decay, length):
    """Add to the error of modelled states the difference between true and modelled decay times the component.

    The error of such a state is component minus estimate, and the filter compensates its estimate by the same blocks,
    so propagating the error of the state covers all other effects. b (1,) is scratch.
    """
    for c in range(true.source.shape[0]):
        source = true.source[c]
        k = true.slot[c]
        for p in range(true.state_from[c], true.state_from[c + 1]):
            state = true.states[p]
            g = true.group[source]
            lane = true.lane[source]
            b[0] = true.factor[length, g, k, 0, lane] - decay[state]
            P = joint.sources[g, ..., lane]
            y = joint.cross[g, ..., lane]
            variance = joint.variance[g, k, 0, lane]
            enter(P, y[k], variance, b, state)


@jit
def _drive_states(joint, true, length):
    """Add the driving noise of components to the error of the states that model them."""
    for c in range(true.source.shape[0]):
        source = true.source[c]
        k = true.slot[c]
        first_pair = true.state_from[c]
        last_pair = true.state_from[c + 1]
        g = true.group[source]
        lane = true.lane[source]
        noise = true.noise[length, g, k, 0, lane]
        # all states that model the component get the same noise, so their errors are fully correlated by it
        for p in range(first_pair, last_pair):
            state = true.states[p]
            for q in range(first_pair, last_pair):
                joint.sources[g, state, true.states[q], lane] += noise
            if true.has_cross[g, k]:
                joint.cross[g, k, state, lane] += noise


@jit
def propagate_sources(joint, scratch, true, units, model, sums, schedule, w):
    """Propagate the true covariance by source and the mean over window w, with the transition in `scratch.D_true`.

    Parameters
    ----------
    joint : JointCovariance, updated in place
    scratch, true : Scratch, Components
    units : ImuArray; None for one IMU
    model, schedule : FilterModel, Schedule
    sums : (18,) integrals of the strapdown over the window
    w : window
    """
    length = schedule.length[w]
    first = schedule.first_tick[w]
    n_tick = schedule.n_tick[w]
    seconds = model.seconds[length]
    decay = true.decay[length]
    D = scratch.D_true
    rows = true.nav_rows
    columns = true.nav_columns
    clock = model.clock
    fill_inputs(scratch, true, units, sums, seconds, first, n_tick)
    for g in range(true.n_slot.shape[0]):
        P = group(joint.sources, g)
        white = group(true.white[length], g)
        predict(P, D, rows, columns, decay, white, clock, seconds)
        cross_covariances = group(joint.cross, g)
        for k in range(true.n_slot[g]):
            if true.has_cross[g, k]:
                apply_phi(cross_covariances[k], D, rows, columns, decay, clock, seconds)
    _enter_states(joint, true, scratch.shift[:1], decay, length)
    for g in range(true.n_slot.shape[0]):
        _advance_components(joint, scratch, true, length, g)
    _drive_states(joint, true, length)
    apply_phi(joint.mean, D, rows, columns, decay, clock, seconds)


@jit
def _propagate_formal(work, D, model, schedule, w):
    """Propagate the formal covariance over window w as `filter.ekf.predict_window` does; D is set to its blocks."""
    length = schedule.length[w]
    seconds = model.seconds[length]
    sums = work.held
    for i in range(work.sums.shape[0]):
        sums[i] = work.sums[i]
    linearised_sums(work.rates, sums, seconds, schedule.linearised[w])
    x = work.nav[R]
    y = work.nav[R + 1]
    z = work.nav[R + 2]
    transition.fill(D, model.block_kinds, model.block_drivers, sums, x, y, z, seconds)
    predict_covariance(work.P, D, sums, model, length, schedule.injection[w])


@jit
def propagate(work, case, joint, flight, units, w):
    """Propagate formal and true covariance over window w: the former by the filter model, the latter by the truth.

    If IMU samples are measurements, motion has already been propagated tick by tick; the remaining effects follow here.

    Parameters
    ----------
    work, case, joint, flight : as in `forward.forward`
    units : ImuArray; None for one IMU
    w : window
    """
    model = case.model
    schedule = case.schedule
    scratch = joint.scratch
    true = joint.true
    x = work.nav[R]
    y = work.nav[R + 1]
    z = work.nav[R + 2]
    _propagate_formal(work, scratch.D, model, schedule, w)
    seconds = model.seconds[schedule.length[w]]
    transition.fill(scratch.D_true, true.nav_kinds, true.nav_drivers, work.sums, x, y, z, seconds)
    propagate_sources(joint.state, scratch, true, units, model, work.sums, schedule, w)
    advance_profiles(joint, flight.unit, units, model, work.sums, schedule, w)
    add_deviations(work.nav, joint, flight, model, schedule, w)
