"""Interference in the receiver's band: noise density of jammers, and range errors due to spoofers."""

import math
from collections.abc import Sequence

import numpy as np

from lvnav_trade.gnss.fault_cards import AnyFault, Jamming, Spoofing
from lvnav_trade.gnss.faults import active
from lvnav_trade.gnss.link import LinkCard, gains, path_loss, pattern_gain
from lvnav_trade.gnss.loops import LoopsCard
from lvnav_trade.gnss.receiver_cards import ReceiverCard
from lvnav_trade.kernels.earth import OMEGA
from lvnav_trade.quantities import frames
from lvnav_trade.quantities.line_of_sight import Sight, sight
from lvnav_trade.quantities.records import Floats, Motion
from lvnav_trade.trajectory.flight import Trajectory


def jamming_density(
    faults: Sequence[AnyFault], link: LinkCard, receiver: ReceiverCard, trajectory: Trajectory, t: Floats, at: Motion
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
    at : Motion
        Motion of the vehicle at these times.

    Notes
    -----
    The density is J / (Q R_c): power J of the jammer from free-space loss and the gains of both antennas, chipping rate
    R_c, and factor Q of its spectrum (Kaplan and Hegarty, Understanding GPS, 2nd ed., chapter 6). A vehicle below the
    horizon of the jammer receives nothing.
    """
    total = np.zeros((t.size, max(1, len(receiver.antennas))))
    rate = LoopsCard.model_fields["code_rate"].default if receiver.loops is None else receiver.loops.code_rate
    for _, card, within, *_ in active(faults, Jamming, trajectory.course, t):
        line, up = _towards(card, trajectory.theta0, t, at.r_i)
        seen = sight(line, np.zeros_like(line))
        level = card.power - path_loss(link, seen.distance)
        if card.pattern is not None:
            level = level + pattern_gain(card.pattern, _off_boresight(card, trajectory.theta0, t, -line))
        direction_b = np.einsum("nij,ni->nj", frames.matrices(at.q_b_i), seen.direction)
        heard = (within & up)[:, None]
        power = 10.0 ** (0.1 * (level[:, None] + gains(receiver.antennas, direction_b)))
        total += np.where(heard, power / (card.quality * rate), 0.0)
    return total


def _place(card: Jamming, theta0: float, t: Floats) -> Floats:
    """Return the position of a jammer (n, 3) m, frame i, at times t (n,) s."""
    place = np.array(frames.ecef_from_geodetic(card.latitude, card.longitude, card.height))
    return frames.eci_from_ecef(np.tile(place, (t.size, 1)), frames.earth_angle(theta0, t))


def _towards(card: Jamming, theta0: float, t: Floats, r_i: Floats) -> tuple[Floats, Floats]:
    """Return the lines (n, 3) m, frame i, from a vehicle to a jammer, and whether the vehicle is above its horizon."""
    place = _place(card, theta0, t)
    down = frames.rotation_i_n(place, frames.earth_angle(theta0, t))[:, 2]
    line = place - r_i
    return line, np.sum(line * down, axis=1) > 0.0


def _off_boresight(card: Jamming, theta0: float, t: Floats, outward: Floats) -> Floats:
    """Return the angle (n,) rad between the boresight of a jammer and the lines `outward` (n, 3) from it, frame i."""
    level = math.cos(card.elevation)
    axis = np.array([level * math.cos(card.azimuth), level * math.sin(card.azimuth), -math.sin(card.elevation)])
    axes = frames.rotation_i_n(_place(card, theta0, t), frames.earth_angle(theta0, t))
    along = np.einsum("nij,nj,i->n", axes, outward, axis) / np.linalg.norm(outward, axis=1)
    return np.asarray(np.arccos(np.clip(along, -1.0, 1.0)))


def effective(cn0: Floats, carrier: Floats, density: Floats) -> Floats:
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
    result, jammed = np.array(cn0), density > 0.0
    result[jammed] = -10.0 * np.log10(10.0 ** (-0.1 * cn0[jammed]) + density[jammed] * 10.0 ** (-0.1 * carrier[jammed]))
    return result


def feigned(faults: Sequence[AnyFault], trajectory: Trajectory, t: Floats, r_i: Floats, true: Sight) -> Floats:
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
    added = np.zeros((*true.distance.shape, 2))
    for _, card, within, start, _ in active(faults, Spoofing, trajectory.course, t):
        theta = frames.earth_angle(trajectory.theta0, t)
        velocity = np.einsum("nij,i->nj", frames.rotation_i_n(r_i, theta), np.array(card.velocity))
        offset = velocity * (t - start)[:, None]
        moving = velocity + np.cross([0.0, 0.0, OMEGA], offset)
        false = sight(true.line - offset[:, None], true.moving - moving[:, None])
        of_both = np.stack([false.distance - true.distance, false.rate - true.rate], axis=2)
        added += np.where(within[:, None, None], of_both, 0.0)
    return added
