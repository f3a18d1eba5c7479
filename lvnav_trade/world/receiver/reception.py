"""Reception of the signals over a flight: best antenna, C/N0, noise, tracked satellites."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lvnav_trade.frames import matrices
from lvnav_trade.records import IDLE, TRACK, Bools, Floats, Ints, Transition
from lvnav_trade.world.fault_cards import AnyFault, Jamming
from lvnav_trade.world.faults import highest
from lvnav_trade.world.flight.trajectory import Trajectory, motion
from lvnav_trade.world.receiver.dynamics import factors
from lvnav_trade.world.receiver.interference import effective, jamming_density
from lvnav_trade.world.receiver.link import carrier_to_noise, gains, received_power
from lvnav_trade.world.receiver.loops import (
    LoopsCard,
    code_sigma,
    coherence_loss,
    holds,
    lag,
    phase_sigma,
    rate_sigma,
    shaking,
)
from lvnav_trade.world.receiver.receiver import ReceiverCard
from lvnav_trade.world.receiver.slips import continuous
from lvnav_trade.world.receiver.tracking import (
    DEAF,
    DYNAMICS,
    FAULT,
    HELD,
    HIDDEN,
    WEAK,
    Signals,
    TrackingCard,
    track,
)

LONGEST_STEP = 0.1  # s; channels, and what they hear, are looked at no less often
# No motion of the carrier matters that is over before a loop has answered it; this many samples per such time.
SAMPLES = 1.0


class Arrival(NamedTuple):
    """Signals that arrive at the receiver's lever arm.

    t : (n_epoch,) s since lift-off. Epochs.
    names : (n_sat,). Satellites.
    direction_i : (n_epoch, n_sat, 3). Unit vector to the satellite, frame i.
    distance : (n_epoch, n_sat) m. Distance to the satellite.
    off_nadir : (n_epoch, n_sat) rad. Angle from the satellite's nadir to the vehicle.
    elevation : (n_epoch, n_sat) rad. Elevation of the satellite.
    pull : (n_epoch, n_sat) m/s^2. Acceleration of the range without that of the antenna itself.
    expected : (n_epoch, n_sat). Whether it is above the mask and not behind the Earth.
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
    """Signals as the receiver processes them, without their noise; see records.Sky."""

    tracked: Bools  # (n_epoch, n_sat), whether it is measured
    antenna: Ints  # (n_epoch, n_sat), antenna that receives it best
    cn0: Floats  # (n_epoch, n_sat) dB-Hz, C/N0 in the tracking loops
    every_cn0: Floats  # (n_epoch, n_sat) dB-Hz, also of signals that are not heard; NaN where none is computed
    continuous: Bools  # (n_epoch, n_sat), whether the carrier was tracked since the epoch before
    state: NDArray[np.int8]  # (n_epoch, n_sat), state of the receiver's channel
    transitions: tuple[Transition, ...]  # state changes of the channels in order of time


class _Steps(NamedTuple):
    """Times between the epochs at which channels are looked at: t (n_step,); owner (n_step,) the epoch that ends the
    interval; each: steps per interval. Every epoch is a step.
    """

    t: Floats
    owner: Ints
    each: int


class _Heard(NamedTuple):
    """Signals at the steps, (n_step, n_sat) each: antenna, C/N0 (dB-Hz), and whether the loops hold, and would hold
    if the vehicle were at rest.
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
    """Return what the receiver makes of the signals; their noise is that of `noise_of`.

    antenna_alive (n_epoch, n_antenna) bool; it holds from the epoch before (excluded) to its own (included). None: all.
    faults: jammers among them lower C/N0.
    """
    n_epoch = arrival.t.size
    simple = not receiver.antennas and receiver.link is None and receiver.tracking is None
    if n_epoch == 0 or (simple and antenna_alive is None):
        return _plain(receiver, arrival)
    steps = _steps(arrival.t, receiver)
    heard = _hear(receiver, trajectory, arrival, steps, antenna_alive, faults)
    at = np.arange(n_epoch) * steps.each
    cn0 = heard.cn0[at]
    transitions: tuple[Transition, ...] = ()
    if receiver.tracking is None:  # then every step is an epoch
        tracked = highest(arrival.elevation, arrival.expected & ~arrival.faulty & heard.held[at], receiver.channels)
        state = np.where(tracked, TRACK, IDLE).astype(np.int8)
        held = tracked
    else:
        signals = _signals(receiver, receiver.tracking, arrival, steps, heard)
        states, transitions = track(receiver.tracking, receiver.channels, arrival.names, signals)
        state = states[at]
        # A channel that waits for its signal to come back is still in track, but has nothing to measure.
        tracked = (state == TRACK) & heard.held[at] & ~arrival.faulty
        held = (states == TRACK) & heard.held & ~arrival.faulty[steps.owner]
    shown = np.where(heard.heard[at] & (receiver.link is not None), cn0, np.nan)
    lock = continuous(receiver.cycle_slips, arrival.names, steps.t, steps.owner, held, heard.antenna, heard.cn0)
    return Reception(tracked, heard.antenna[at], shown, cn0, lock, state, transitions)


def _plain(receiver: ReceiverCard, arrival: Arrival) -> Reception:
    """Return the reception of a receiver that measures the highest satellites above its mask, whatever happens."""
    tracked = highest(arrival.elevation, arrival.expected & ~arrival.faulty, receiver.channels)
    antenna, state = np.zeros(tracked.shape, dtype=np.int64), np.where(tracked, TRACK, IDLE).astype(np.int8)
    unknown = np.full(tracked.shape, np.nan)
    lock = continuous(
        receiver.cycle_slips, arrival.names, arrival.t, np.arange(arrival.t.size), tracked, antenna, unknown
    )
    return Reception(tracked, antenna, unknown, unknown, lock, state, ())


def _steps(t: Floats, receiver: ReceiverCard) -> _Steps:
    """Divide the intervals between the epochs, all into as many steps; only channels need more than one."""
    longest = float(np.max(np.diff(t), initial=0.0))
    count = max(1, math.ceil(longest / LONGEST_STEP - 1e-6)) if receiver.tracking is not None else 1
    fine, owner = _divided(t, count)
    return _Steps(np.concatenate([t[:1], fine]), np.concatenate([[0], owner]), count)


def _divided(t: Floats, count: int) -> tuple[Floats, Ints]:
    """Return the ends of `count` equal parts of every interval of t, and the number of the later end of the interval.

    The last part ends at the epoch itself, to the bit.
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
) -> _Heard:
    at = motion(trajectory, steps.t)
    # a row vector times C_b_i: the components along the body's axes
    level = gains(receiver.antennas, arrival.direction_i[steps.owner] @ matrices(at.q_b_i))
    if antenna_alive is not None:
        level = np.where(antenna_alive[steps.owner][:, None, :], level, -np.inf)
    antenna = np.argmax(level, axis=-1)
    gain = np.take_along_axis(level, antenna[..., None], axis=-1)[..., 0]
    heard, link, loops = np.isfinite(gain), receiver.link, receiver.loops
    if link is None:
        return _Heard(antenna, gain, heard, heard, heard)
    carrier = received_power(link, arrival.distance, arrival.off_nadir)[steps.owner] + gain
    quiet = carrier_to_noise(link, carrier)
    if any(isinstance(fault, Jamming) for fault in faults):
        density = jamming_density(faults, link, receiver, trajectory, steps.t, at)
        quiet = effective(quiet, carrier, np.take_along_axis(density, antenna, axis=1))
    floor = -np.inf if receiver.tracking is None else receiver.tracking.track_above
    if loops is None:
        held = heard & (quiet >= floor)
        return _Heard(antenna, quiet, heard, held, held)
    still = np.zeros(quiet.shape)
    calm = heard & (quiet >= floor) & holds(loops, quiet, still, still + loops.jitter, still)
    acceleration, jerk = _dynamics(receiver, loops, trajectory, arrival, steps, antenna)
    trail = lag(loops, acceleration, jerk, link.wavelength)
    jitter = shaking(loops, np.linalg.norm(at.f_b, axis=-1))[:, None] + still
    cn0 = quiet - coherence_loss(loops, trail, jitter)
    held = heard & (cn0 >= floor) & holds(loops, cn0, trail, jitter, acceleration)
    return _Heard(antenna, cn0, heard, held, calm)


def _dynamics(
    receiver: ReceiverCard,
    loops: LoopsCard,
    trajectory: Trajectory,
    arrival: Arrival,
    steps: _Steps,
    antenna: Ints,
) -> tuple[Floats, Floats]:
    """Return the greatest acceleration (m/s^2) and jerk (m/s^3) of the range during each step, (n_step, n_sat) each.

    Means over the time in which the carrier loop answers: a jump of thrust is a jerk over that time, which is what the
    loop makes of it. Rotation counts through the lever arms of the antennas.
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
        # Without a span there is no motion: epochs that latency pushes before the start of the flight coincide.
        mean = np.divide(np.diff(v_i, axis=0), span, out=np.zeros((span.size, 3)), where=span > 0.0)
        change = np.divide(np.diff(mean, axis=0, prepend=mean[:1]), span, out=np.zeros_like(mean), where=span > 0.0)
        along = arrival.pull[1:, None, :] - mean.reshape(blocks) @ towards
        most = (
            np.abs(one).reshape(-1, part, shape[1]).max(axis=1) for one in (along, change.reshape(blocks) @ towards)
        )
        mine = which.ravel()[antenna] == number
        for whole, found in zip((acceleration, jerk), most, strict=True):
            np.copyto(whole[1:], found, where=mine[1:])
            np.copyto(whole[:1], found[:1], where=mine[:1])
    return acceleration, jerk


def _signals(receiver: ReceiverCard, tracking: TrackingCard, arrival: Arrival, steps: _Steps, heard: _Heard) -> Signals:
    """Return what the channels see; of several causes the one that hides the others is named."""
    expected, faulty = arrival.expected[steps.owner], arrival.faulty[steps.owner]
    causes = ((~expected, HIDDEN), (faulty, FAULT), (~heard.heard, DEAF), (heard.held, HELD), (~heard.calm, WEAK))
    cause = np.select([mask for mask, _ in causes], [code for _, code in causes], DYNAMICS).astype(np.int8)
    strong = (cause == HELD) & (receiver.link is None or heard.cn0 >= tracking.acquire_above)
    return Signals(steps.t, expected, cause, strong, arrival.elevation[steps.owner])


def noise_of(receiver: ReceiverCard, trajectory: Trajectory, t: Floats, cn0: Floats) -> tuple[Floats, Floats, Floats]:
    """Return the sigma of range (m), range rate (m/s) and carrier phase (m) at times t (n_epoch,) s, (n_epoch, n_sat)
    each: of the loops and of what the card adds, squares summed, grown by its tables and by a combination of two
    frequencies.
    """
    measurements = ("pseudorange", "range_rate", "carrier_phase")
    of_range, of_rate, of_phase = factors(receiver.noise_by, measurements, trajectory, t)
    code, rate, phase = _thermal(receiver, cn0)
    same = receiver.amplification * np.ones(cn0.shape)
    return code * (of_range * same), rate * (of_rate * same), phase * (of_phase * same)


def _thermal(receiver: ReceiverCard, cn0: Floats) -> tuple[Floats | float, Floats | float, Floats | float]:
    """Return the sigma of range, range rate and carrier phase at one frequency, whatever the flight does."""
    loops, link = receiver.loops, receiver.link
    stated = receiver.pseudorange_sigma, receiver.range_rate_sigma, receiver.carrier_phase_sigma
    if loops is None or link is None:
        return stated
    bounded = np.maximum(cn0, 0.0)  # what is fainter than any loop can hold is not measured: the tables stay finite
    code, rate = code_sigma(loops, bounded), rate_sigma(loops, bounded, link.wavelength)
    phase = phase_sigma(loops, bounded) * link.wavelength / (2.0 * math.pi)
    return np.hypot(stated[0], code), np.hypot(stated[1], rate), np.hypot(stated[2], phase)
