"""Reception over a flight: best antenna, C/N0, noise by altitude, specific force and jerk, tracked satellites."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lvnav_trade.gnss.fault_cards import AnyFault, Jamming
from lvnav_trade.gnss.faults import highest
from lvnav_trade.gnss.interference import cn0_under_jamming, jamming_density
from lvnav_trade.gnss.link import carrier_to_noise, gains, received_power
from lvnav_trade.gnss.loops import (
    LoopsCard,
    code_sigma,
    coherence_loss,
    keeps_lock,
    lag,
    oscillator_jitter,
    phase_sigma,
    rate_sigma,
)
from lvnav_trade.gnss.receiver_cards import ReceiverCard
from lvnav_trade.gnss.tracking import (
    DEAF,
    DYNAMICS,
    FAULT,
    HELD,
    HIDDEN,
    WEAK,
    ChannelSignals,
    TrackingCard,
    is_continuous,
    track,
)
from lvnav_trade.quantities.frames import earth_angle, ecef_from_eci, geodetic_from_ecef, matrices
from lvnav_trade.quantities.records import IDLE, TRACK, Bools, ChannelTransition, Floats, Ints
from lvnav_trade.quantities.shared_cards import Dynamics, NoiseFactor, noise_factor
from lvnav_trade.trajectory.flight import Trajectory, motion

HALF_STEP = 0.05  # s to either side of a time for the change of specific force


def dynamics_at(trajectory: Trajectory, t: Floats) -> Dynamics:
    """Return altitude, specific force and jerk at times t (n,) s since lift-off.

    Jerk is the change of specific force in frame i over 0.1 s, which covers jumps of thrust.
    """
    state = motion(trajectory, t)
    r_e = ecef_from_eci(state.r_i, earth_angle(trajectory.theta0, t))
    height = geodetic_from_ecef(r_e)[2]
    t_before = np.clip(t - HALF_STEP, trajectory.start, trajectory.end)
    t_after = np.clip(t + HALF_STEP, trajectory.start, trajectory.end)
    change = _specific_force_i(trajectory, t_after) - _specific_force_i(trajectory, t_before)
    jerk = np.linalg.norm(change, axis=1) / (t_after - t_before)
    return Dynamics(np.asarray(height), np.linalg.norm(state.f_b, axis=1), jerk)


def _specific_force_i(trajectory: Trajectory, t: Floats) -> Floats:
    """Return the specific force (n, 3) m/s^2, frame i, at times t (n,) s."""
    state = motion(trajectory, t)
    return np.asarray(np.einsum("nij,nj->ni", matrices(state.q_b_i), state.f_b))


def factors(
    tables: Sequence[NoiseFactor], measurements: Sequence[str], trajectory: Trajectory, t: Floats
) -> list[Floats | float]:
    """Return the factor (n, 1) on the sigma of each measurement at times t (n,) s; the number 1 without tables."""
    if not tables:
        return [1.0 for _ in measurements]
    dynamics = dynamics_at(trajectory, t)
    return [noise_factor(tables, measurement, dynamics)[:, None] for measurement in measurements]


LONGEST_STEP = 0.1  # s; longest step of the channels and their signals
# Samples of the motion per response time of the carrier loop, which averages faster motion.
SAMPLES = 1.0


class Arrival(NamedTuple):
    """Signals that arrive at the receiver's lever arm.

    t : (n_epoch,) s since lift-off. Epochs.
    names : (n_sat,). Satellites.
    direction_i : (n_epoch, n_sat, 3). Unit vector to the satellite, frame i.
    distance : (n_epoch, n_sat) m. Distance to the satellite.
    off_nadir : (n_epoch, n_sat) rad. Angle from the satellite's nadir to the vehicle.
    elevation : (n_epoch, n_sat) rad. Elevation of the satellite.
    range_acceleration : (n_epoch, n_sat) m/s^2. Range acceleration without the contribution of the antenna.
    is_in_view : (n_epoch, n_sat). Whether it is above the mask and not hidden by the Earth.
    is_faulty : (n_epoch, n_sat). Whether a fault removes it.
    """

    t: Floats
    names: tuple[str, ...]
    direction_i: Floats
    distance: Floats
    off_nadir: Floats
    elevation: Floats
    range_acceleration: Floats
    is_in_view: Bools
    is_faulty: Bools


class Reception(NamedTuple):
    """Reception of the signals without noise; see records.Sky."""

    is_tracked: Bools  # (n_epoch, n_sat), whether the satellite is measured
    antenna: Ints  # (n_epoch, n_sat), antenna that receives it best
    cn0: Floats  # (n_epoch, n_sat) dB-Hz, C/N0 in the tracking loops
    all_cn0: Floats  # (n_epoch, n_sat) dB-Hz, also of signals that are not received; NaN without a link
    continuous: Bools  # (n_epoch, n_sat), whether the carrier was tracked since the previous epoch
    state: NDArray[np.int8]  # (n_epoch, n_sat), state of the receiver's channel
    transitions: tuple[ChannelTransition, ...]  # state changes of the channels in order of time


class _Steps(NamedTuple):
    """Time steps of the channels; every epoch is a step.

    t : (n_step,) s since lift-off.
    owner : (n_step,). Epoch at the end of the interval that the step lies in.
    per_interval : Number of steps per interval.
    """

    t: Floats
    owner: Ints
    per_interval: int


class _ReceivedSignals(NamedTuple):
    """Signals at the steps, (n_step, n_sat) each.

    antenna : Antenna that receives the satellite best.
    cn0 : dB-Hz. C/N0 in the tracking loops.
    is_received : Whether an antenna receives the signal.
    is_locked : Whether the loops keep lock.
    is_locked_at_rest : Whether they would keep lock if the vehicle were at rest.
    """

    antenna: Ints
    cn0: Floats
    is_received: Bools
    is_locked: Bools
    is_locked_at_rest: Bools


def receive(
    receiver: ReceiverCard,
    trajectory: Trajectory,
    arrival: Arrival,
    antenna_alive: Bools | None = None,
    faults: Sequence[AnyFault] = (),
) -> Reception:
    """Return the reception of the signals: antenna, C/N0, lock and tracked satellites. Noise: see `noise_sigmas`.

    Parameters
    ----------
    receiver : ReceiverCard
    trajectory : Trajectory
    arrival : Arrival
        Signals at the lever arm of the receiver.
    antenna_alive : (n_epoch, n_antenna) bool, optional
        Working antennas, from the previous epoch (excluded) to the epoch (included). None: all.
    faults : sequence of fault cards
        Jammers among them lower C/N0.
    """
    n_epoch = arrival.t.size
    simple = not receiver.antennas and receiver.link is None and receiver.tracking is None
    if n_epoch == 0 or (simple and antenna_alive is None):
        return _simple_reception(receiver, arrival)
    steps = _steps(arrival.t, receiver)
    signals = _receive_signals(receiver, trajectory, arrival, steps, antenna_alive, faults)
    epoch_steps = np.arange(n_epoch) * steps.per_interval
    is_locked = signals.is_locked[epoch_steps]
    transitions: tuple[ChannelTransition, ...] = ()
    if receiver.tracking is None:  # every step is an epoch
        is_tracked = highest(arrival.elevation, arrival.is_in_view & ~arrival.is_faulty & is_locked, receiver.channels)
        state = np.where(is_tracked, TRACK, IDLE).astype(np.int8)
        tracked_at_steps = is_tracked
    else:
        channel_signals = _channel_signals(receiver, receiver.tracking, arrival, steps, signals)
        states, transitions = track(receiver.tracking, receiver.channels, arrival.names, channel_signals)
        state = states[epoch_steps]
        # A channel that waits for its signal to return is still in state TRACK but measures nothing.
        is_tracked = (state == TRACK) & is_locked & ~arrival.is_faulty
        tracked_at_steps = (states == TRACK) & signals.is_locked & ~arrival.is_faulty[steps.owner]
    cn0 = signals.cn0[epoch_steps]
    has_cn0 = signals.is_received[epoch_steps] & (receiver.link is not None)
    return Reception(
        is_tracked=is_tracked,
        antenna=signals.antenna[epoch_steps],
        cn0=np.where(has_cn0, cn0, np.nan),
        all_cn0=cn0,
        continuous=is_continuous(
            receiver.cycle_slips,
            arrival.names,
            steps.t,
            steps.owner,
            tracked_at_steps,
            signals.antenna,
            signals.cn0,
        ),
        state=state,
        transitions=transitions,
    )


def _simple_reception(receiver: ReceiverCard, arrival: Arrival) -> Reception:
    """Return the reception of a receiver that always measures the highest satellites above its mask."""
    is_tracked = highest(arrival.elevation, arrival.is_in_view & ~arrival.is_faulty, receiver.channels)
    antenna = np.zeros(is_tracked.shape, dtype=np.int64)
    no_cn0 = np.full(is_tracked.shape, np.nan)
    epochs = np.arange(arrival.t.size)
    return Reception(
        is_tracked=is_tracked,
        antenna=antenna,
        cn0=no_cn0,
        all_cn0=no_cn0,
        continuous=is_continuous(
            receiver.cycle_slips,
            arrival.names,
            arrival.t,
            epochs,
            is_tracked,
            antenna,
            no_cn0,
        ),
        state=np.where(is_tracked, TRACK, IDLE).astype(np.int8),
        transitions=(),
    )


def _steps(t: Floats, receiver: ReceiverCard) -> _Steps:
    """Divide all intervals between epochs into the same number of steps; without channels that number is one."""
    count = 1
    if receiver.tracking is not None:
        longest = float(np.max(np.diff(t), initial=0.0))
        count = max(1, math.ceil(longest / LONGEST_STEP - 1e-6))
    ends, owner = _divide(t, count)
    return _Steps(
        t=np.concatenate([t[:1], ends]),
        owner=np.concatenate([[0], owner]),
        per_interval=count,
    )


def _divide(t: Floats, count: int) -> tuple[Floats, Ints]:
    """Return the ends of `count` equal parts of every interval of t, and the index of the end of the interval.

    The last part ends exactly at the epoch.
    """
    fractions = np.arange(1, count + 1) / count
    ends = t[:-1, None] + np.diff(t)[:, None] * fractions
    ends[:, -1] = t[1:]
    return ends.ravel(), np.repeat(np.arange(1, t.size), count)


def _receive_signals(
    receiver: ReceiverCard,
    trajectory: Trajectory,
    arrival: Arrival,
    steps: _Steps,
    antenna_alive: Bools | None,
    faults: Sequence[AnyFault],
) -> _ReceivedSignals:
    """Return the signals of all satellites at the steps: best antenna, C/N0 and lock of the loops."""
    link, loops = receiver.link, receiver.loops
    state = motion(trajectory, steps.t)
    # u_i' C_b_i: components of the direction in body axes
    direction_b = arrival.direction_i[steps.owner] @ matrices(state.q_b_i)
    antenna_gains = gains(receiver.antennas, direction_b)
    if antenna_alive is not None:
        antenna_gains = np.where(antenna_alive[steps.owner][:, None, :], antenna_gains, -np.inf)
    antenna = np.argmax(antenna_gains, axis=-1)
    gain = np.take_along_axis(antenna_gains, antenna[..., None], axis=-1)[..., 0]
    is_received = np.isfinite(gain)
    if link is None:
        return _ReceivedSignals(antenna, gain, is_received, is_received, is_received)
    power = received_power(link, arrival.distance, arrival.off_nadir)[steps.owner] + gain
    cn0_at_rest = carrier_to_noise(link, power)
    if any(isinstance(fault, Jamming) for fault in faults):
        density = jamming_density(faults, link, receiver, trajectory, steps.t, state)
        cn0_at_rest = cn0_under_jamming(cn0_at_rest, power, np.take_along_axis(density, antenna, axis=1))
    floor = -np.inf if receiver.tracking is None else receiver.tracking.track_above
    is_strong_at_rest = is_received & (cn0_at_rest >= floor)
    if loops is None:
        return _ReceivedSignals(antenna, cn0_at_rest, is_received, is_strong_at_rest, is_strong_at_rest)
    zero = np.zeros(cn0_at_rest.shape)
    is_locked_at_rest = is_strong_at_rest & keeps_lock(loops, cn0_at_rest, zero, zero + loops.jitter, zero)
    acceleration, jerk = _dynamics(receiver, loops, trajectory, arrival, steps, antenna)
    loop_lag = lag(loops, acceleration, jerk, link.wavelength)
    jitter = oscillator_jitter(loops, np.linalg.norm(state.f_b, axis=-1))[:, None] + zero
    cn0 = cn0_at_rest - coherence_loss(loops, loop_lag, jitter)
    is_locked = is_received & (cn0 >= floor) & keeps_lock(loops, cn0, loop_lag, jitter, acceleration)
    return _ReceivedSignals(antenna, cn0, is_received, is_locked, is_locked_at_rest)


def _dynamics(
    receiver: ReceiverCard,
    loops: LoopsCard,
    trajectory: Trajectory,
    arrival: Arrival,
    steps: _Steps,
    antenna: Ints,
) -> tuple[Floats, Floats]:
    """Return the largest acceleration (m/s^2) and jerk (m/s^3) of the range during each step, (n_step, n_sat) each.

    They are means over the response time of the carrier loop, so that a jump of thrust becomes a jerk over that time,
    as in the loop. Rotation contributes through the lever arms of the antennas.
    """
    acceleration = np.zeros(antenna.shape)
    jerk = np.zeros(antenna.shape)
    if arrival.t.size < 2:
        return np.abs(arrival.range_acceleration), jerk
    longest_step = float(np.max(np.diff(arrival.t))) / steps.per_interval
    per_step = max(1, math.ceil(SAMPLES * longest_step * loops.natural_frequency - 1e-6))
    n_interval = arrival.t.size - 1
    per_interval = steps.per_interval * per_step
    ends, _ = _divide(arrival.t, per_interval)
    t = np.concatenate([arrival.t[:1], ends])
    span = np.diff(t)[:, None]
    state = motion(trajectory, t)
    C_b_i = matrices(state.q_b_i)
    line_of_sight = np.swapaxes(arrival.direction_i[1:], 1, 2)
    lever_arms, arm_of_antenna = np.unique(np.array(receiver.lever_arms), axis=0, return_inverse=True)
    arm = arm_of_antenna.ravel()[antenna]
    for number, lever_b in enumerate(lever_arms):
        v_i = state.v_i + np.einsum("nij,nj->ni", C_b_i, np.cross(state.w_ib_b, lever_b))
        mean_acceleration = _rate(np.diff(v_i, axis=0), span)
        acceleration_change = np.diff(mean_acceleration, axis=0, prepend=mean_acceleration[:1])
        mean_jerk = _rate(acceleration_change, span)
        along_line = mean_acceleration.reshape(n_interval, per_interval, 3) @ line_of_sight
        range_acceleration = arrival.range_acceleration[1:, None, :] - along_line
        range_jerk = mean_jerk.reshape(n_interval, per_interval, 3) @ line_of_sight
        _copy_largest(acceleration, range_acceleration, per_step, arm == number)
        _copy_largest(jerk, range_jerk, per_step, arm == number)
    return acceleration, jerk


def _rate(change: Floats, span: Floats) -> Floats:
    """Return changes (n, 3) over time spans (n, 1) s; zero over spans of zero length.

    Epochs that latency moves before the start of the flight coincide: no motion over an interval of zero length.
    """
    return np.divide(change, span, out=np.zeros_like(change), where=span > 0.0)


def _copy_largest(largest: Floats, values: Floats, per_step: int, is_selected: Bools) -> None:
    """Set the selected (n_step, n_sat) elements to the largest magnitude of the `per_step` values of each step.

    The first epoch, which no interval precedes, has the value of the first step.
    """
    step_largest = np.abs(values).reshape(-1, per_step, largest.shape[1]).max(axis=1)
    np.copyto(largest[1:], step_largest, where=is_selected[1:])
    np.copyto(largest[:1], step_largest[:1], where=is_selected[:1])


def _channel_signals(
    receiver: ReceiverCard, tracking: TrackingCard, arrival: Arrival, steps: _Steps, signals: _ReceivedSignals
) -> ChannelSignals:
    """Return the signals as the channels see them; of several causes of loss only the dominant cause is given."""
    is_in_view = arrival.is_in_view[steps.owner]
    # in order of precedence: the first condition that is true gives the cause
    conditions = [
        ~is_in_view,
        arrival.is_faulty[steps.owner],
        ~signals.is_received,
        signals.is_locked,
        ~signals.is_locked_at_rest,
    ]
    causes = [HIDDEN, FAULT, DEAF, HELD, WEAK]
    cause = np.select(conditions, causes, DYNAMICS).astype(np.int8)
    is_strong = (cause == HELD) & (receiver.link is None or signals.cn0 >= tracking.acquire_above)
    return ChannelSignals(
        t=steps.t,
        is_in_view=is_in_view,
        cause=cause,
        is_strong=is_strong,
        elevation=arrival.elevation[steps.owner],
    )


def noise_sigmas(
    receiver: ReceiverCard, trajectory: Trajectory, t: Floats, cn0: Floats
) -> tuple[Floats, Floats, Floats]:
    """Return the sigmas of range (m), range rate (m/s) and carrier phase (m), (n_epoch, n_sat) each.

    Each is the root sum of squares of loop noise and the sigma of the card, times the factors of the noise tables and
    of the combination of two frequencies.

    t : (n_epoch,) s since lift-off.
    cn0 : (n_epoch, n_sat) dB-Hz. C/N0, used with tracking loops only.
    """
    measurements = ("pseudorange", "range_rate", "carrier_phase")
    range_factor, rate_factor, phase_factor = factors(receiver.noise_by, measurements, trajectory, t)
    code, rate, phase = _thermal(receiver, cn0)
    amplification = receiver.amplification * np.ones(cn0.shape)
    return (
        code * (range_factor * amplification),
        rate * (rate_factor * amplification),
        phase * (phase_factor * amplification),
    )


def _thermal(receiver: ReceiverCard, cn0: Floats) -> tuple[Floats | float, Floats | float, Floats | float]:
    """Return the sigmas of range, range rate and carrier phase at one frequency, before the noise tables."""
    loops, link = receiver.loops, receiver.link
    card_sigmas = receiver.pseudorange_sigma, receiver.range_rate_sigma, receiver.carrier_phase_sigma
    if loops is None or link is None:
        return card_sigmas
    bounded_cn0 = np.maximum(cn0, 0.0)  # no loop tracks weaker signals; the bound keeps their sigmas finite
    code = code_sigma(loops, bounded_cn0)
    rate = rate_sigma(loops, bounded_cn0, link.wavelength)
    phase = phase_sigma(loops, bounded_cn0) * link.wavelength / (2.0 * math.pi)
    return np.hypot(card_sigmas[0], code), np.hypot(card_sigmas[1], rate), np.hypot(card_sigmas[2], phase)
