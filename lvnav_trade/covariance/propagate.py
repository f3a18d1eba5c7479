"""Propagation of the joint covariance over a window of the nominal flight, source by source."""

from lvnav_trade.covariance.component_inputs import N_NAV, fill_inputs
from lvnav_trade.covariance.deterministic_errors import add_deviations, advance_profiles
from lvnav_trade.filter.ekf import predict_covariance
from lvnav_trade.kernels import transition
from lvnav_trade.kernels.covariance import apply_phi, enter, predict
from lvnav_trade.kernels.jit import jit
from lvnav_trade.kernels.lanes import group
from lvnav_trade.kernels.mechanisation import mechanise
from lvnav_trade.kernels.strapdown import R, set_to_truth
from lvnav_trade.kernels.transition import EVERY_WINDOW, linearise, linearised_sums


@jit
def nominal_window(
    nominal, reference, unit, first, n_tick, algorithm, has_sensed_increments, linearisation_code=EVERY_WINDOW
):
    """Integrate the strapdown over a window from the true state, to get the integrals that the transition needs.

    Parameters
    ----------
    nominal : Nominal; its state, increments and integrals are set
    reference, unit : Reference, ImuTruth
    first, n_tick : first tick, number of ticks
    algorithm : Strapdown
    has_sensed_increments : whether the increments are those that the IMU outputs (bandwidth), if the error of the
        strapdown algorithm is included; otherwise they are true increments
    linearisation_code : code of `transition.linearise`
    """
    set_to_truth(nominal.nav, reference, first)
    linearise(nominal.rates, nominal.nav, linearisation_code)
    increments = nominal.increments
    for k in range(n_tick):
        tick = first + k
        for axis in range(3):
            angle = reference.dtheta[tick, axis]
            velocity = reference.dvel[tick, axis]
            if has_sensed_increments and algorithm.is_error_included:
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
            increase = bi * covariance
            P[i, j] += increase
            P[j, i] += increase
        for j in range(N_NAV, n):
            increase = bi * y[j]
            P[i, j] += increase
            P[j, i] += increase
    for i in range(N_NAV):
        y[i] += b[i] * variance


@jit
def _advance_components(state, scratch, components, length_index, g):
    """Add the effect of the components of a group over a window, then propagate the components themselves."""
    factors = group(components.component_decay[length_index], g)
    noises = group(components.noise[length_index], g)
    echoes = group(components.echo[length_index], g)
    variances = group(state.variance, g)
    cross_covariances = group(state.cross, g)
    b = group(scratch.b, g)
    P = group(state.sources, g)
    for k in range(components.n_slot[g]):
        factor = factors[k, 0]
        echo = echoes[k, 0]
        variance = variances[k, 0]
        y = cross_covariances[k]
        if components.has_cross[g, k]:
            if components.drives_motion[g, k]:
                _enter_over_window(P, y, b[k], variance, echo)
            for i in range(y.shape[0]):
                y[i] = factor * y[i]
            if components.drives_motion[g, k]:
                # the new remainder enters the states with the sign opposite to that of the component
                for i in range(N_NAV):
                    y[i] -= echo * b[k, i]
        variances[k, 0] = factor * factor * variance + noises[k, 0]  # c+ = f c + w


@jit
def _enter_states(state, components, b, decay, length_index):
    """Add to the error of modelled states the difference between true and modelled decay times the component.

    The error of such a state is component minus estimate, and the filter compensates its estimate by the same blocks,
    so propagating the error of the state covers all other effects. b (1,) is scratch.
    """
    for c in range(components.source.shape[0]):
        source = components.source[c]
        k = components.slot[c]
        for p in range(components.state_from[c], components.state_from[c + 1]):
            filter_state = components.states[p]
            g = components.group[source]
            lane = components.lane[source]
            b[0] = components.component_decay[length_index, g, k, 0, lane] - decay[filter_state]
            P = state.sources[g, ..., lane]
            y = state.cross[g, ..., lane]
            variance = state.variance[g, k, 0, lane]
            enter(P, y[k], variance, b, filter_state)


@jit
def _drive_states(state, components, length_index):
    """Add the driving noise of components to the error of the states that model them."""
    for c in range(components.source.shape[0]):
        source = components.source[c]
        k = components.slot[c]
        first_pair = components.state_from[c]
        last_pair = components.state_from[c + 1]
        g = components.group[source]
        lane = components.lane[source]
        noise = components.noise[length_index, g, k, 0, lane]
        # all states that model the component get the same noise, so their errors are fully correlated by it
        for p in range(first_pair, last_pair):
            filter_state = components.states[p]
            for q in range(first_pair, last_pair):
                state.sources[g, filter_state, components.states[q], lane] += noise
            if components.has_cross[g, k]:
                state.cross[g, k, filter_state, lane] += noise


@jit
def propagate_sources(state, scratch, components, units, model, sums, schedule, w):
    """Propagate the true covariance by source and the mean over window w, with the transition in `scratch.D_true`.

    Parameters
    ----------
    state : JointCovariance, updated in place
    scratch, components : Scratch, Components
    units : ImuArray; None for one IMU
    model, schedule : FilterModel, Schedule
    sums : (18,) integrals of the strapdown over the window
    w : window
    """
    length_index = schedule.length_index[w]
    first = schedule.first_tick[w]
    n_tick = schedule.n_tick[w]
    seconds = model.seconds[length_index]
    decay = components.state_decay[length_index]
    D = scratch.D_true
    rows = components.nav_rows
    columns = components.nav_columns
    clock = model.clock
    fill_inputs(scratch, components, units, sums, seconds, first, n_tick)
    for g in range(components.n_slot.shape[0]):
        P = group(state.sources, g)
        white = group(components.white_variance[length_index], g)
        predict(P, D, rows, columns, decay, white, clock, seconds)
        cross_covariances = group(state.cross, g)
        for k in range(components.n_slot[g]):
            if components.has_cross[g, k]:
                apply_phi(cross_covariances[k], D, rows, columns, decay, clock, seconds)
    _enter_states(state, components, scratch.state_effect[:1], decay, length_index)
    for g in range(components.n_slot.shape[0]):
        _advance_components(state, scratch, components, length_index, g)
    _drive_states(state, components, length_index)
    apply_phi(state.mean, D, rows, columns, decay, clock, seconds)


@jit
def _propagate_formal(work, D, model, schedule, w):
    """Propagate the formal covariance over window w as `filter.ekf.predict_window` does; D is set to its blocks."""
    length_index = schedule.length_index[w]
    seconds = model.seconds[length_index]
    sums = work.filter_sums
    for i in range(work.sums.shape[0]):
        sums[i] = work.sums[i]
    linearised_sums(work.rates, sums, seconds, schedule.linearisation[w])
    x = work.nav[R]
    y = work.nav[R + 1]
    z = work.nav[R + 2]
    transition.fill(D, model.block_kinds, model.block_drivers, sums, x, y, z, seconds)
    predict_covariance(work.P, D, sums, model, length_index, schedule.injection[w])


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
    components = joint.components
    x = work.nav[R]
    y = work.nav[R + 1]
    z = work.nav[R + 2]
    _propagate_formal(work, scratch.D, model, schedule, w)
    seconds = model.seconds[schedule.length_index[w]]
    transition.fill(scratch.D_true, components.nav_kinds, components.nav_drivers, work.sums, x, y, z, seconds)
    propagate_sources(joint.state, scratch, components, units, model, work.sums, schedule, w)
    advance_profiles(joint, flight.unit, units, model, work.sums, schedule, w)
    add_deviations(work.nav, joint, flight, model, schedule, w)
