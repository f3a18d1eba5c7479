"""Interference in the receiver's band: noise density of jammers, and range errors due to spoofers."""

import math
from collections.abc import Sequence

import numpy as np

from lvnav_trade.gnss.fault_cards import AnyFault, Jamming, Spoofing
from lvnav_trade.gnss.faults import active_intervals
from lvnav_trade.gnss.link import LinkCard, gains, path_loss, pattern_gain
from lvnav_trade.gnss.loops import LoopsCard
from lvnav_trade.gnss.receiver_cards import ReceiverCard
from lvnav_trade.kernels.earth import OMEGA
from lvnav_trade.quantities import frames
from lvnav_trade.quantities.line_of_sight import Sight, sight
from lvnav_trade.quantities.records import Bools, Floats, Motion
from lvnav_trade.trajectory.flight import Trajectory


def jamming_density(
    faults: Sequence[AnyFault], link: LinkCard, receiver: ReceiverCard, trajectory: Trajectory, t: Floats, state: Motion
) -> Floats:
    """Return the equivalent noise density (n, n_antenna) W/Hz of jammers at the output of each antenna.

    Parameters
    ----------
    faults : sequence of fault cards
    link : LinkCard
    receiver : ReceiverCard
    trajectory : Trajectory
    t : (n,) s since lift-off
        Times.
    state : Motion
        Motion of the vehicle at these times.

    Notes
    -----
    The density is J / (Q R_c): power J of the jammer from free-space loss and the gains of both antennas, chipping rate
    R_c, and factor Q of its spectrum (Kaplan and Hegarty, Understanding GPS, 2nd ed., chapter 6). A vehicle below the
    horizon of the jammer receives nothing.
    """
    n_antenna = max(1, len(receiver.antennas))
    total = np.zeros((t.size, n_antenna))
    if receiver.loops is None:
        code_rate = LoopsCard.model_fields["code_rate"].default
    else:
        code_rate = receiver.loops.code_rate
    for _, card, mask, *_ in active_intervals(faults, Jamming, trajectory.flight_profile, t):
        line, is_above_horizon = _jammer_line(card, trajectory.theta0, t, state.r_i)
        line_of_sight = sight(line, np.zeros_like(line))
        level = card.power - path_loss(link, line_of_sight.distance)
        if card.pattern is not None:
            off_boresight = _off_boresight(card, trajectory.theta0, t, -line)
            level = level + pattern_gain(card.pattern, off_boresight)
        C_b_i = frames.matrices(state.q_b_i)
        direction_b = np.einsum("nij,ni->nj", C_b_i, line_of_sight.direction)
        received_level = level[:, None] + gains(receiver.antennas, direction_b)
        power = 10.0 ** (0.1 * received_level)
        density = power / (card.quality * code_rate)
        is_received = mask & is_above_horizon
        total += np.where(is_received[:, None], density, 0.0)
    return total


def _jammer_position(card: Jamming, theta0: float, t: Floats) -> Floats:
    """Return the position of a jammer, (n, 3) m, frame i.

    Parameters
    ----------
    card : Jamming
    theta0 : float
        Earth angle at lift-off (rad).
    t : (n,) s since lift-off
    """
    r_e = np.array(frames.ecef_from_geodetic(card.latitude, card.longitude, card.height))
    theta = frames.earth_angle(theta0, t)
    repeated_r_e = np.tile(r_e, (t.size, 1))
    return frames.eci_from_ecef(repeated_r_e, theta)


def _jammer_line(card: Jamming, theta0: float, t: Floats, r_i: Floats) -> tuple[Floats, Bools]:
    """Return the lines from a vehicle to a jammer, and whether the vehicle is above its horizon.

    Parameters
    ----------
    card : Jamming
    theta0 : float
        Earth angle at lift-off (rad).
    t : (n,) s since lift-off
    r_i : (n, 3) m, frame i
        Position of the vehicle.

    Returns
    -------
    line : (n, 3) m, frame i
    is_above_horizon : (n,) bool
    """
    jammer_i = _jammer_position(card, theta0, t)
    theta = frames.earth_angle(theta0, t)
    down = frames.rotation_i_n(jammer_i, theta)[:, 2]
    line = jammer_i - r_i
    descent = np.sum(line * down, axis=1)
    return line, descent > 0.0


def _off_boresight(card: Jamming, theta0: float, t: Floats, outward: Floats) -> Floats:
    """Return the angle between the boresight of a jammer and the lines from it, (n,) rad.

    Parameters
    ----------
    card : Jamming
    theta0 : float
        Earth angle at lift-off (rad).
    t : (n,) s since lift-off
    outward : (n, 3), frame i
        Lines from the jammer, of any length.
    """
    horizontal = math.cos(card.elevation)
    north = horizontal * math.cos(card.azimuth)
    east = horizontal * math.sin(card.azimuth)
    down = -math.sin(card.elevation)
    boresight_n = np.array([north, east, down])
    jammer_i = _jammer_position(card, theta0, t)
    theta = frames.earth_angle(theta0, t)
    C_i_n = frames.rotation_i_n(jammer_i, theta)
    along_boresight = np.einsum("nij,nj,i->n", C_i_n, outward, boresight_n)
    length = np.linalg.norm(outward, axis=1)
    cosine = along_boresight / length
    return np.asarray(np.arccos(np.clip(cosine, -1.0, 1.0)))


def cn0_under_jamming(cn0: Floats, carrier: Floats, density: Floats) -> Floats:
    """Return the effective C/N0 (dB-Hz) under jamming: 1 / (C/N0)_e = 1 / (C/N0) + J / (C Q R_c).

    Parameters
    ----------
    cn0 : (...,) dB-Hz
        C/N0 without jammers.
    carrier : (...,) dBW
        Power C of the signal at the output of the antenna.
    density : (...,) W/Hz
        Density J / (Q R_c) of the jammers at the same antenna, as from `jamming_density`.
    """
    is_jammed = density > 0.0
    noise_to_carrier = 10.0 ** (-0.1 * cn0[is_jammed])
    inverse_carrier = 10.0 ** (-0.1 * carrier[is_jammed])
    jamming_to_carrier = density[is_jammed] * inverse_carrier
    total = noise_to_carrier + jamming_to_carrier
    effective_cn0 = np.array(cn0)
    effective_cn0[is_jammed] = -10.0 * np.log10(total)
    return effective_cn0


def spoofer_errors(faults: Sequence[AnyFault], trajectory: Trajectory, t: Floats, r_i: Floats, true: Sight) -> Floats:
    """Return the errors of ranges (m) and range rates (m/s) due to spoofers, (n_epoch, n_sat, 2).

    The measurements become those of a false position that moves away from the antenna in its north, east, down axes,
    which turn with the Earth.

    Parameters
    ----------
    faults : sequence of fault cards
    trajectory : Trajectory
    t : (n_epoch,) s since lift-off
    r_i : (n_epoch, 3) m, frame i
        True antenna positions.
    true : Sight, (n_epoch, n_sat)
        True lines of sight.
    """
    errors = np.zeros((*true.distance.shape, 2))
    for _, card, mask, start, _ in active_intervals(faults, Spoofing, trajectory.flight_profile, t):
        theta = frames.earth_angle(trajectory.theta0, t)
        # false position and velocity relative to the true position and velocity
        C_i_n = frames.rotation_i_n(r_i, theta)
        velocity_n = np.array(card.velocity)
        earth_velocity = np.einsum("nij,i->nj", C_i_n, velocity_n)
        time_from_start = t - start
        offset = earth_velocity * time_from_start[:, None]
        velocity = earth_velocity + np.cross([0.0, 0.0, OMEGA], offset)
        false_line = true.line - offset[:, None]
        false_line_rate = true.line_rate - velocity[:, None]
        false = sight(false_line, false_line_rate)
        range_error = false.distance - true.distance
        rate_error = false.rate - true.rate
        error = np.stack([range_error, rate_error], axis=2)
        errors += np.where(mask[:, None, None], error, 0.0)
    return errors
