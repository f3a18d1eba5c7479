"""Satellites over a flight: positions at signal transmission, directions from the antenna, and which are tracked."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from lvnav_trade.gnss.constellation import Constellation
from lvnav_trade.gnss.fault_cards import AntennaFailure, AnyFault
from lvnav_trade.gnss.faults import Mask, antennas_alive, satellite_outages
from lvnav_trade.gnss.kepler import GM_GPS
from lvnav_trade.gnss.receiver_cards import ReceiverCard
from lvnav_trade.gnss.reception import Arrival, noise_sigmas, receive
from lvnav_trade.gnss.satellites import Satellites, satellites
from lvnav_trade.kernels.clock import SPEED_OF_LIGHT
from lvnav_trade.kernels.earth import OMEGA
from lvnav_trade.quantities import frames
from lvnav_trade.quantities.line_of_sight import (
    is_occluded,
    look_angles,
    off_nadir_angle,
    point_mass_gravitation,
    point_motion,
    range_rate,
    sight,
)
from lvnav_trade.quantities.records import Floats, Sky
from lvnav_trade.trajectory.flight import Trajectory, motion

# A signal whose ray passes below this height over the ellipsoid counts as lost: straight rays ignore the weather there
# and the bending of up to a degree. The height matters only for masks below the horizontal.
GRAZING_HEIGHT = 10e3  # m
# Each iteration of the light-time equation reduces the error by c / v = 8e4: 80 m, 1 mm, 14 nm.
LIGHT_TIME_ROUNDS = 4


class Transmission(NamedTuple):
    """Transmission of the signals received at the epochs.

    travel : (n_epoch, n_sat) s. Travel time.
    r_i : (n_epoch, n_sat, 3) m. Satellite position at transmission, frame i.
    v_i : (n_epoch, n_sat, 3) m/s. Inertial velocity, the derivative with respect to transmission time.
    """

    travel: Floats
    r_i: Floats
    v_i: Floats


class ReceivedSatellites(NamedTuple):
    """Satellites and their reception before the noise is computed, which depends on other settings of the receiver.

    sky : Satellites; noise sigmas are NaN.
    cn0 : (n_epoch, n_sat) dB-Hz. C/N0, also of signals that are not received; NaN without a link.
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
    """Return the satellites seen from the true antenna, and which are tracked; the same for all runs.

    Parameters
    ----------
    constellation : card
    receiver : ReceiverCard
    trajectory : Trajectory
    t_epoch : (n_epoch,) s since lift-off
        Times of reception, rising.
    faults : sequence of fault cards
        Faults of the case.
    antenna_alive : (n_epoch, n_antenna) bool, optional
        Antennas that work at the epoch and since the epoch before it. None: all, except for the faults.

    Returns
    -------
    Sky
        Positions at transmission in frame i, which need no correction for Earth rotation; velocities with respect to
        reception time; azimuth and elevation at the antenna.

    Raises
    ------
    InputError
        The almanac or ephemerides cannot be used, or the start of a fault cannot be resolved.
    """
    return with_noise(
        receive_satellites(constellation, receiver, trajectory, t_epoch, faults, antenna_alive), receiver, trajectory
    )


def with_noise(reception: ReceivedSatellites, receiver: ReceiverCard, trajectory: Trajectory) -> Sky:
    """Return the satellites with the white-noise sigmas of the receiver's measurements.

    Parameters
    ----------
    reception : ReceivedSatellites
        As from `receive_satellites`.
    receiver : ReceiverCard
    trajectory : Trajectory
    """
    range_sigma, rate_sigma, phase_sigma = noise_sigmas(receiver, trajectory, reception.sky.t, reception.cn0)
    return reception.sky._replace(range_sigma=range_sigma, rate_sigma=rate_sigma, phase_sigma=phase_sigma)


def receive_satellites(
    constellation: Constellation,
    receiver: ReceiverCard,
    trajectory: Trajectory,
    t_epoch: Floats,
    faults: Sequence[AnyFault] = (),
    antenna_alive: Mask | None = None,
) -> ReceivedSatellites:
    """Return the satellites of `sky` without noise sigmas; parameters and errors as there."""
    orbits = satellites(constellation, trajectory.epoch)
    antenna_r, antenna_v = antenna_motion(trajectory, receiver, t_epoch)
    signals = transmission(orbits, trajectory.theta0, t_epoch, antenna_r)
    lines = sight(signals.r_i - antenna_r[:, None, :], signals.v_i - antenna_v[:, None, :])
    azimuth, elevation = look_angles(trajectory.theta0, t_epoch, antenna_r, lines.direction)
    lowest = mask_angle(receiver, trajectory.theta0, t_epoch, antenna_r)
    is_visible = (elevation >= lowest) & ~is_occluded(antenna_r[:, None, :], signals.r_i, GRAZING_HEIGHT)
    arrival = Arrival(
        t=t_epoch,
        names=orbits.names,
        direction_i=lines.direction,
        distance=lines.distance,
        off_nadir=off_nadir_angle(signals.r_i, lines.direction),
        elevation=elevation,
        # range acceleration without that of the antenna: a few m/s^2, for the lag of the tracking loops
        range_acceleration=lines.acceleration(point_mass_gravitation(signals.r_i, GM_GPS)),
        is_in_view=is_visible,
        is_faulty=np.asarray(satellite_outages(faults, trajectory.flight_profile, t_epoch, elevation, is_visible)),
    )
    if antenna_alive is None and any(isinstance(fault, AntennaFailure) for fault in faults):
        antenna_alive = antennas_alive(faults, trajectory.flight_profile, t_epoch, len(receiver.antennas))
    reception = receive(receiver, trajectory, arrival, antenna_alive, faults)._asdict()
    cn0 = reception.pop("all_cn0")
    no_sigma = np.full(cn0.shape, np.nan)
    # derivative of the time of transmission by the time of reception
    transmission_rate = 1.0 - range_rate(lines.direction, signals.v_i, antenna_v[:, None, :]) / SPEED_OF_LIGHT
    noiseless = Sky(
        t=t_epoch,
        names=orbits.names,
        systems=orbits.systems,
        r_i=signals.r_i,
        v_i=signals.v_i * transmission_rate[..., None],  # dr/dt_rx = dr/dt_tx dt_tx/dt_rx
        azimuth=azimuth,
        elevation=elevation,
        lever_arms=np.array(receiver.lever_arms),
        range_sigma=no_sigma,
        rate_sigma=no_sigma,
        phase_sigma=no_sigma,
        **reception,
    )
    return ReceivedSatellites(noiseless, cn0)


def mask_angle(receiver: ReceiverCard, theta0: float, t: Floats, antenna_r: Floats) -> Floats | float:
    """Return the elevation mask of the receiver in rad, (n_epoch, 1), or a single number for all epochs.

    With `mask_height` the mask sinks linearly to the horizontal at that height, and above it with the horizon of a
    shell of that height (Canepa and Servidia, section 6.3.1, with a shell of ten scale heights of the troposphere).

    Parameters
    ----------
    receiver : ReceiverCard
    theta0 : float
        Earth angle at lift-off (rad).
    t : (n_epoch,) s since lift-off
    antenna_r : (n_epoch, 3) m, frame i
        Antenna positions.
    """
    shell = receiver.mask_height
    if shell is None:
        return receiver.mask
    theta = frames.earth_angle(theta0, t)
    antenna_e = frames.ecef_from_eci(antenna_r, theta)
    height = frames.geodetic_from_ecef(antenna_e)[2]
    radius = np.linalg.norm(antenna_r, axis=-1) - height
    cosine = (radius + shell) / (radius + np.maximum(height, shell))
    dip = -np.arccos(np.clip(cosine, -1.0, 1.0))
    reduced_mask = receiver.mask * (1.0 - height / shell)
    is_above_shell = height > shell
    elevation_mask = np.where(is_above_shell, dip, reduced_mask)
    return np.asarray(elevation_mask)[:, None]


def antenna_motion(trajectory: Trajectory, receiver: ReceiverCard, t: Floats) -> tuple[Floats, Floats]:
    """Return true position (m) and velocity (m/s) of the antenna, (n_epoch, 3) each, frame i.

    Parameters
    ----------
    trajectory : Trajectory
    receiver : ReceiverCard
        Its `lever_b` is the vector from the IMU to the antenna (m, body axes).
    t : (n_epoch,) s since lift-off
    """
    state = motion(trajectory, t)
    C_b_i = frames.matrices(state.q_b_i)
    lever_b = np.array(receiver.lever_b)
    return point_motion(state, C_b_i, lever_b)


def transmission(orbits: Satellites, theta0: float, t: Floats, antenna_r: Floats) -> Transmission:
    """Solve the light-time equation |r_sat(t - travel) - r_antenna(t)| = c travel for all epochs and satellites.

    Parameters
    ----------
    orbits : Satellites
        Orbits of the satellites.
    theta0 : float
        Earth angle at lift-off (rad).
    t : (n_epoch,) s since lift-off
        Times of reception.
    antenna_r : (n_epoch, 3) m, frame i
        Antenna positions at reception.
    """
    travel = np.full((t.size, len(orbits.names)), 0.075)  # s, typical for a satellite at 22 000 km
    for _ in range(LIGHT_TIME_ROUNDS):
        transmission_time = t[:, None] - travel
        r_i, v_i = satellite_inertial(orbits, theta0, transmission_time)
        distance = np.linalg.norm(r_i - antenna_r[:, None, :], axis=-1)
        travel = distance / SPEED_OF_LIGHT
    return Transmission(travel, r_i, v_i)


def satellite_inertial(orbits: Satellites, theta0: float, t: Floats) -> tuple[Floats, Floats]:
    """Return position (m) and inertial velocity (m/s) of satellites, (..., n_sat, 3) each, frame i.

    Parameters
    ----------
    orbits : Satellites
        Orbits of the satellites.
    theta0 : float
        Earth angle at lift-off (rad).
    t : (..., n_sat) s since lift-off
    """
    r_e, v_e = orbits.ecef(t)
    theta = frames.earth_angle(theta0, t)
    x = r_e[..., 0]
    y = r_e[..., 1]
    # velocity of the rotating axes: OMEGA x r
    axes_velocity = OMEGA * np.stack([-y, x, np.zeros_like(x)], axis=-1)
    r_i = frames.eci_from_ecef(r_e, theta)
    v_i = frames.eci_from_ecef(v_e + axes_velocity, theta)
    return r_i, v_i
