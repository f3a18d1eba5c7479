"""Reception over a flight: best antenna, C/N0, noise by altitude, specific force and jerk, tracked satellites."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lvnav_trade.gnss.fault_cards import AnyFault, Jamming
from lvnav_trade.gnss.faults import highest
from lvnav_trade.gnss.interference import effective, jamming_density
from lvnav_trade.gnss.link import carrier_to_noise, gains, received_power
from lvnav_trade.gnss.loops import LoopsCard, code_sigma, coherence_loss, holds, lag, phase_sigma, rate_sigma, shaking
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
    continuous,
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
    at = motion(trajectory, t)
    height = geodetic_from_ecef(ecef_from_eci(at.r_i, earth_angle(trajectory.theta0, t)))[2]
    ends = [np.clip(t + shift, trajectory.start, trajectory.end) for shift in (-HALF_STEP, HALF_STEP)]
    before, after = (motion(trajectory, end) for end in ends)
    first, last = (np.einsum("nij,nj->ni", matrices(end.q_b_i), end.f_b) for end in (before, after))
    jerk = np.linalg.norm(last - first, axis=1) / (ends[1] - ends[0])
    return Dynamics(np.asarray(height), np.linalg.norm(at.f_b, axis=1), jerk)


def factors(
    tables: Sequence[NoiseFactor], measurements: Sequence[str], trajectory: Trajectory, t: Floats
) -> list[Floats | float]:
    """Return the factor (n, 1) on the sigma of each measurement at times t (n,) s; the number 1 without tables."""
    if not tables:
        return [1.0 for _ in measurements]
    at = dynamics_at(trajectory, t)
    return [noise_factor(tables, measurement, at)[:, None] for measurement in measurements]


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
    pull : (n_epoch, n_sat) m/s^2. Range acceleration without the contribution of the antenna.
    expected : (n_epoch, n_sat). Whether it is above the mask and not hidden by the Earth.
    faulty : (n_epoch, n_sat). Whether a fault removes it.
    """

    t: Floats
    names: tuple[str, ...]
    direction_i: Floats
    distance: Floats
    off_nadir: Floats
    elevation: Floats
    pull: Floats
    expected: Bools
    faulty: Bools


class Reception(NamedTuple):
    """Reception of the signals without noise; see records.Sky."""

    tracked: Bools  # (n_epoch, n_sat), whether the satellite is measured
    antenna: Ints  # (n_epoch, n_sat), antenna that receives it best
    cn0: Floats  # (n_epoch, n_sat) dB-Hz, C/N0 in the tracking loops
    every_cn0: Floats  # (n_epoch, n_sat) dB-Hz, also of signals that are not received; NaN without a link
    continuous: Bools  # (n_epoch, n_sat), whether the carrier was tracked since the previous epoch
    state: NDArray[np.int8]  # (n_epoch, n_sat), state of the receiver's channel
    transitions: tuple[ChannelTransition, ...]  # state changes of the channels in order of time


class _Steps(NamedTuple):
    """Time steps of the channels; every epoch is a step.

    t : (n_step,) s since lift-off.
    owner : (n_step,). Epoch at the end of the interval that the step lies in.
    each : Number of steps per interval.
    """

    t: Floats
    owner: Ints
    each: int


class _ReceivedSignals(NamedTuple):
    """Signals at the steps, (n_step, n_sat) each.

    antenna : Antenna that receives the satellite best.
    cn0 : dB-Hz. C/N0 in the tracking loops.
    heard : Whether an antenna receives the signal.
    held : Whether the loops keep lock.
    calm : Whether they would keep lock if the vehicle were at rest.
    """

    antenna: Ints
    cn0: Floats
    heard: Bools
    held: Bools
    calm: Bools


def receive(
    receiver: ReceiverCard,
    trajectory: Trajectory,
    arrival: Arrival,
    antenna_alive: Bools | None = None,
    faults: Sequence[AnyFault] = (),
) -> Reception:
    """Return the reception of the signals: antenna, C/N0, lock and tracked satellites. For the noise see `noise_of`.

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
        return _plain(receiver, arrival)
    steps = _steps(arrival.t, receiver)
    heard = _hear(receiver, trajectory, arrival, steps, antenna_alive, faults)
    at = np.arange(n_epoch) * steps.each
    cn0 = heard.cn0[at]
    transitions: tuple[ChannelTransition, ...] = ()
    if receiver.tracking is None:  # every step is an epoch
        tracked = highest(arrival.elevation, arrival.expected & ~arrival.faulty & heard.held[at], receiver.channels)
        state = np.where(tracked, TRACK, IDLE).astype(np.int8)
        held = tracked
    else:
        signals = _signals(receiver, receiver.tracking, arrival, steps, heard)
        states, transitions = track(receiver.tracking, receiver.channels, arrival.names, signals)
        state = states[at]
        # A channel that waits for its signal to return is still in state TRACK but measures nothing.
        tracked = (state == TRACK) & heard.held[at] & ~arrival.faulty
        held = (states == TRACK) & heard.held & ~arrival.faulty[steps.owner]
    shown = np.where(heard.heard[at] & (receiver.link is not None), cn0, np.nan)
    lock = continuous(receiver.cycle_slips, arrival.names, steps.t, steps.owner, held, heard.antenna, heard.cn0)
    return Reception(tracked, heard.antenna[at], shown, cn0, lock, state, transitions)


def _plain(receiver: ReceiverCard, arrival: Arrival) -> Reception:
    """Return the reception of a receiver that always measures the highest satellites above its mask."""
    tracked = highest(arrival.elevation, arrival.expected & ~arrival.faulty, receiver.channels)
    antenna, state = np.zeros(tracked.shape, dtype=np.int64), np.where(tracked, TRACK, IDLE).astype(np.int8)
    unknown = np.full(tracked.shape, np.nan)
    lock = continuous(
        receiver.cycle_slips, arrival.names, arrival.t, np.arange(arrival.t.size), tracked, antenna, unknown
    )
    return Reception(tracked, antenna, unknown, unknown, lock, state, ())


def _steps(t: Floats, receiver: ReceiverCard) -> _Steps:
    """Divide all intervals between epochs into the same number of steps; without channels that number is one."""
    longest = float(np.max(np.diff(t), initial=0.0))
    count = max(1, math.ceil(longest / LONGEST_STEP - 1e-6)) if receiver.tracking is not None else 1
    fine, owner = _divided(t, count)
    return _Steps(np.concatenate([t[:1], fine]), np.concatenate([[0], owner]), count)


def _divided(t: Floats, count: int) -> tuple[Floats, Ints]:
    """Return the ends of `count` equal parts of every interval of t, and the index of the end of the interval.

    The last part ends exactly at the epoch.
    """
    fine = t[:-1, None] + np.diff(t)[:, None] * (np.arange(1, count + 1) / count)
    fine[:, -1] = t[1:]
    return fine.ravel(), np.repeat(np.arange(1, t.size), count)


def _hear(
    receiver: ReceiverCard,
    trajectory: Trajectory,
    arrival: Arrival,
    steps: _Steps,
    antenna_alive: Bools | None,
    faults: Sequence[AnyFault],
) -> _ReceivedSignals:
    at = motion(trajectory, steps.t)
    # u_i' C_b_i: components of the direction in body axes
    level = gains(receiver.antennas, arrival.direction_i[steps.owner] @ matrices(at.q_b_i))
    if antenna_alive is not None:
        level = np.where(antenna_alive[steps.owner][:, None, :], level, -np.inf)
    antenna = np.argmax(level, axis=-1)
    gain = np.take_along_axis(level, antenna[..., None], axis=-1)[..., 0]
    heard, link, loops = np.isfinite(gain), receiver.link, receiver.loops
    if link is None:
        return _ReceivedSignals(antenna, gain, heard, heard, heard)
    carrier = received_power(link, arrival.distance, arrival.off_nadir)[steps.owner] + gain
    quiet = carrier_to_noise(link, carrier)
    if any(isinstance(fault, Jamming) for fault in faults):
        density = jamming_density(faults, link, receiver, trajectory, steps.t, at)
        quiet = effective(quiet, carrier, np.take_along_axis(density, antenna, axis=1))
    floor = -np.inf if receiver.tracking is None else receiver.tracking.track_above
    if loops is None:
        held = heard & (quiet >= floor)
        return _ReceivedSignals(antenna, quiet, heard, held, held)
    still = np.zeros(quiet.shape)
    calm = heard & (quiet >= floor) & holds(loops, quiet, still, still + loops.jitter, still)
    acceleration, jerk = _dynamics(receiver, loops, trajectory, arrival, steps, antenna)
    trail = lag(loops, acceleration, jerk, link.wavelength)
    jitter = shaking(loops, np.linalg.norm(at.f_b, axis=-1))[:, None] + still
    cn0 = quiet - coherence_loss(loops, trail, jitter)
    held = heard & (cn0 >= floor) & holds(loops, cn0, trail, jitter, acceleration)
    return _ReceivedSignals(antenna, cn0, heard, held, calm)


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
    shape = antenna.shape
    if arrival.t.size < 2:
        return np.abs(arrival.pull), np.zeros(shape)
    interval = float(np.max(np.diff(arrival.t))) / steps.each
    part = max(1, math.ceil(SAMPLES * interval * loops.natural_frequency - 1e-6))
    fine = np.concatenate([arrival.t[:1], _divided(arrival.t, steps.each * part)[0]])
    span = np.diff(fine)[:, None]
    at = motion(trajectory, fine)
    C_b_i = matrices(at.q_b_i)
    acceleration, jerk = np.zeros(shape), np.zeros(shape)
    towards = np.swapaxes(arrival.direction_i[1:], 1, 2)
    blocks = (arrival.t.size - 1, steps.each * part, 3)
    unique, which = np.unique(np.array(receiver.lever_arms), axis=0, return_inverse=True)
    for number, lever_b in enumerate(unique):
        v_i = at.v_i + np.einsum("nij,nj->ni", C_b_i, np.cross(at.w_ib_b, lever_b))
        # Epochs that latency moves before the start of the flight coincide: no motion over an interval of zero length.
        mean = np.divide(np.diff(v_i, axis=0), span, out=np.zeros((span.size, 3)), where=span > 0.0)
        change = np.divide(np.diff(mean, axis=0, prepend=mean[:1]), span, out=np.zeros_like(mean), where=span > 0.0)
        along = arrival.pull[1:, None, :] - mean.reshape(blocks) @ towards
        most = (
            np.abs(value).reshape(-1, part, shape[1]).max(axis=1) for value in (along, change.reshape(blocks) @ towards)
        )
        mine = which.ravel()[antenna] == number
        for whole, largest in zip((acceleration, jerk), most, strict=True):
            np.copyto(whole[1:], largest, where=mine[1:])
            np.copyto(whole[:1], largest[:1], where=mine[:1])
    return acceleration, jerk


def _signals(
    receiver: ReceiverCard, tracking: TrackingCard, arrival: Arrival, steps: _Steps, heard: _ReceivedSignals
) -> ChannelSignals:
    """Return the signals as the channels see them; of several causes of loss only the dominant cause is given."""
    expected, faulty = arrival.expected[steps.owner], arrival.faulty[steps.owner]
    causes = ((~expected, HIDDEN), (faulty, FAULT), (~heard.heard, DEAF), (heard.held, HELD), (~heard.calm, WEAK))
    cause = np.select([mask for mask, _ in causes], [code for _, code in causes], DYNAMICS).astype(np.int8)
    strong = (cause == HELD) & (receiver.link is None or heard.cn0 >= tracking.acquire_above)
    return ChannelSignals(steps.t, expected, cause, strong, arrival.elevation[steps.owner])


def noise_of(receiver: ReceiverCard, trajectory: Trajectory, t: Floats, cn0: Floats) -> tuple[Floats, Floats, Floats]:
    """Return the sigmas of range (m), range rate (m/s) and carrier phase (m), (n_epoch, n_sat) each.

    Each is the root sum of squares of loop noise and the sigma of the card, times the factors of the noise tables and
    of the combination of two frequencies.

    t : (n_epoch,) s since lift-off.
    cn0 : (n_epoch, n_sat) dB-Hz. C/N0, used with tracking loops only.
    """
    measurements = ("pseudorange", "range_rate", "carrier_phase")
    of_range, of_rate, of_phase = factors(receiver.noise_by, measurements, trajectory, t)
    code, rate, phase = _thermal(receiver, cn0)
    same = receiver.amplification * np.ones(cn0.shape)
    return code * (of_range * same), rate * (of_rate * same), phase * (of_phase * same)


def _thermal(receiver: ReceiverCard, cn0: Floats) -> tuple[Floats | float, Floats | float, Floats | float]:
    """Return the sigmas of range, range rate and carrier phase at one frequency, before the noise tables."""
    loops, link = receiver.loops, receiver.link
    stated = receiver.pseudorange_sigma, receiver.range_rate_sigma, receiver.carrier_phase_sigma
    if loops is None or link is None:
        return stated
    bounded = np.maximum(cn0, 0.0)  # no loop tracks weaker signals; the bound keeps their sigmas finite
    code, rate = code_sigma(loops, bounded), rate_sigma(loops, bounded, link.wavelength)
    phase = phase_sigma(loops, bounded) * link.wavelength / (2.0 * math.pi)
    return np.hypot(stated[0], code), np.hypot(stated[1], rate), np.hypot(stated[2], phase)
