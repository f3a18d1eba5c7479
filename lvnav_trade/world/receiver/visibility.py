"""Satellites over a flight: where each was when it sent what the antenna receives, and whether it is tracked."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from lvnav_trade import frames
from lvnav_trade.kernels.clock import SPEED_OF_LIGHT
from lvnav_trade.kernels.earth import OMEGA
from lvnav_trade.line_of_sight import falling, look_angles, occluded, off_nadir, point_of, range_rate, sight
from lvnav_trade.records import Floats, Sky
from lvnav_trade.world.fault_cards import AntennaFailure, AnyFault
from lvnav_trade.world.faults import Mask, antennas_alive, lost
from lvnav_trade.world.flight.trajectory import Trajectory, motion
from lvnav_trade.world.receiver.receiver import ReceiverCard
from lvnav_trade.world.receiver.reception import Arrival, noise_of, receive
from lvnav_trade.world.sky.constellation import GM_GPS, Constellation
from lvnav_trade.world.sky.satellites import Satellites, satellites

# A signal that would pass lower over the ellipsoid than this counts as lost: below lie most of the weather, and bending
# of up to a degree that straight rays leave out. It matters only for masks below the horizontal.
GRAZING_HEIGHT = 10e3  # m
# Each round of the light-time equation gains a factor of c / v = 8e4: 80 m, 1 mm, 14 nm.
LIGHT_TIME_ROUNDS = 4


class Transmission(NamedTuple):
    """Signals received at the epochs: travel time (n_epoch, n_sat) s; satellites at transmission, frame i (..., 3)."""

    travel: Floats
    r_i: Floats
    v_i: Floats  # inertial velocity: derivative with respect to transmission time


class Heard(NamedTuple):
    """What is in the sky, and how it is received, before its noise: that depends on other numbers of the receiver.

    sky : The sky; its noise is NaN.
    cn0 : (n_epoch, n_sat) dB-Hz. C/N0, also of signals that are not heard; NaN where none is computed.
    """

    sky: Sky
    cn0: Floats


def sky(
    constellation: Constellation,
    receiver: ReceiverCard,
    trajectory: Trajectory,
    t_epoch: Floats,
    faults: Sequence[AnyFault] = (),
    antenna_alive: Mask | None = None,
) -> Sky:
    """Return all usable satellites at the times of reception t_epoch (n_epoch,), s since lift-off, rising, as seen from
    the true antenna; the same for all runs.

    Positions are those at transmission in frame i (no Earth-rotation term is left to apply), velocities with respect to
    reception time, azimuth and elevation at the antenna. antenna_alive (n_epoch, n_antenna) bool: which antennas work
    at the epoch and since the one before; None: as the faults say. InputError where the almanac is broken, or a fault's
    start cannot be resolved.
    """
    return with_noise(
        heard_in(constellation, receiver, trajectory, t_epoch, faults, antenna_alive), receiver, trajectory
    )


def with_noise(heard: Heard, receiver: ReceiverCard, trajectory: Trajectory) -> Sky:
    """Return the sky with the white noise of the receiver's measurements."""
    of_range, of_rate, of_phase = noise_of(receiver, trajectory, heard.sky.t, heard.cn0)
    return heard.sky._replace(range_sigma=of_range, rate_sigma=of_rate, phase_sigma=of_phase)


def heard_in(
    constellation: Constellation,
    receiver: ReceiverCard,
    trajectory: Trajectory,
    t_epoch: Floats,
    faults: Sequence[AnyFault] = (),
    antenna_alive: Mask | None = None,
) -> Heard:
    """Return the same without noise; parameters and errors as of `sky`."""
    above = satellites(constellation, trajectory.epoch)
    antenna_r, antenna_v = antenna(trajectory, receiver, t_epoch)
    sent = transmission(above, trajectory.theta0, t_epoch, antenna_r)
    seen = sight(sent.r_i - antenna_r[:, None, :], sent.v_i - antenna_v[:, None, :])
    received = 1.0 - range_rate(seen.direction, sent.v_i, antenna_v[:, None, :]) / SPEED_OF_LIGHT
    azimuth, elevation = look_angles(trajectory.theta0, t_epoch, antenna_r, seen.direction)
    lowest = mask(receiver, trajectory.theta0, t_epoch, antenna_r)
    visible = (elevation >= lowest) & ~occluded(antenna_r[:, None, :], sent.r_i, GRAZING_HEIGHT)
    faulty = np.asarray(lost(faults, trajectory.course, t_epoch, elevation, visible))
    pull = seen.acceleration(falling(sent.r_i, GM_GPS))  # few m/s^2, for loops that trail behind acceleration
    angle = off_nadir(sent.r_i, seen.direction)
    arrival = Arrival(t_epoch, above.names, seen.direction, seen.distance, angle, elevation, pull, visible, faulty)
    if antenna_alive is None and any(isinstance(fault, AntennaFailure) for fault in faults):
        antenna_alive = antennas_alive(faults, trajectory.course, t_epoch, len(receiver.antennas))
    received_as = receive(receiver, trajectory, arrival, antenna_alive, faults)._asdict()
    cn0 = received_as.pop("every_cn0")
    unknown = np.full(cn0.shape, np.nan)
    found = Sky(
        t=t_epoch,
        names=above.names,
        systems=above.systems,
        r_i=sent.r_i,
        v_i=sent.v_i * received[..., None],
        azimuth=azimuth,
        elevation=elevation,
        lever_arms=np.array(receiver.lever_arms),
        range_sigma=unknown,
        rate_sigma=unknown,
        phase_sigma=unknown,
        **received_as,
    )
    return Heard(found, cn0)


def mask(receiver: ReceiverCard, theta0: float, t: Floats, antenna_r: Floats) -> Floats | float:
    """Return the elevation (rad) below which the receiver does not look, (n_epoch, 1), or one number for all epochs.

    antenna_r (n_epoch, 3) m, frame i. A mask that sinks with height: Canepa and Servidia, section 6.3.1, where the
    shell is ten scale heights of the troposphere high.
    """
    shell = receiver.mask_height
    if shell is None:
        return receiver.mask
    height = frames.geodetic_from_ecef(frames.ecef_from_eci(antenna_r, frames.earth_angle(theta0, t)))[2]
    radius = np.linalg.norm(antenna_r, axis=-1) - height
    dip = -np.arccos(np.clip((radius + shell) / (radius + np.maximum(height, shell)), -1.0, 1.0))
    return np.asarray(np.where(height > shell, dip, receiver.mask * (1.0 - height / shell)))[:, None]


def antenna(trajectory: Trajectory, receiver: ReceiverCard, t: Floats) -> tuple[Floats, Floats]:
    """Return true position (m) and velocity (m/s) of the antenna in frame i, (n_epoch, 3) each, lever arm included."""
    at = motion(trajectory, t)
    return point_of(at, frames.matrices(at.q_b_i), np.array(receiver.lever_b))


def transmission(above: Satellites, theta0: float, t: Floats, antenna_r: Floats) -> Transmission:
    """Solve the light-time equation |r_sat(t - travel) - r_antenna(t)| = c travel for all epochs and satellites.

    theta0: Earth angle (rad) at the lift-off that t counts from; t (n_epoch,) s and antenna_r (n_epoch, 3) m, frame i:
    reception.
    """
    travel = np.full((t.size, len(above.names)), 0.075)
    for _ in range(LIGHT_TIME_ROUNDS):
        r_i, v_i = satellite_inertial(above, theta0, t[:, None] - travel)
        travel = np.linalg.norm(r_i - antenna_r[:, None, :], axis=-1) / SPEED_OF_LIGHT
    return Transmission(travel, r_i, v_i)


def satellite_inertial(above: Satellites, theta0: float, t: Floats) -> tuple[Floats, Floats]:
    """Return position and velocity of the satellites in frame i, (..., n_sat, 3), at times t (..., n_sat) in s."""
    r_e, v_e = above.ecef(t)
    theta = frames.earth_angle(theta0, t)
    turning = OMEGA * np.stack([-r_e[..., 1], r_e[..., 0], np.zeros_like(r_e[..., 0])], axis=-1)
    return frames.eci_from_ecef(r_e, theta), frames.eci_from_ecef(v_e + turning, theta)
