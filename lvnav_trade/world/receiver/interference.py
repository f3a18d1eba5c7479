"""Interference in the receiver's band: noise of a jammer, false position of a spoofer."""

import math
from collections.abc import Sequence

import numpy as np

from lvnav_trade import frames
from lvnav_trade.kernels.earth import OMEGA
from lvnav_trade.line_of_sight import Sight, sight
from lvnav_trade.records import Floats, Motion
from lvnav_trade.world.fault_cards import AnyFault, Jamming, Spoofing
from lvnav_trade.world.faults import active
from lvnav_trade.world.flight.trajectory import Trajectory
from lvnav_trade.world.patterns import pattern_gain
from lvnav_trade.world.receiver.link import LinkCard, gains, path_loss
from lvnav_trade.world.receiver.loops import LoopsCard
from lvnav_trade.world.receiver.receiver import ReceiverCard


def jamming_density(
    faults: Sequence[AnyFault], link: LinkCard, receiver: ReceiverCard, trajectory: Trajectory, t: Floats, at: Motion
) -> Floats:
    """Return the noise density (W/Hz) that jammers are worth at the output of each antenna, (n, n_antenna).

    J / (Q R_c): the power J of the jammer there by free-space loss and the gains of both antennas, the chipping rate
    R_c, and the factor Q of its spectrum (Kaplan and Hegarty, Understanding GPS, 2nd ed., chapter 6). Nothing arrives
    below the horizon of the jammer. at: motion at the times t (n,) s.
    """
    found = np.zeros((t.size, max(1, len(receiver.antennas))))
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
        found += np.where(heard, power / (card.quality * rate), 0.0)
    return found


def _place(card: Jamming, theta0: float, t: Floats) -> Floats:
    """Return the place of a jammer (n, 3) m, frame i."""
    place = np.array(frames.ecef_from_geodetic(card.latitude, card.longitude, card.height))
    return frames.eci_from_ecef(np.tile(place, (t.size, 1)), frames.earth_angle(theta0, t))


def _towards(card: Jamming, theta0: float, t: Floats, r_i: Floats) -> tuple[Floats, Floats]:
    """Return the lines (n, 3) m, frame i, from a vehicle to a jammer, and whether its horizon is below the vehicle."""
    place = _place(card, theta0, t)
    down = frames.rotation_i_n(place, frames.earth_angle(theta0, t))[:, 2]
    line = place - r_i
    return line, np.sum(line * down, axis=1) > 0.0


def _off_boresight(card: Jamming, theta0: float, t: Floats, outward: Floats) -> Floats:
    """Return the angle (n,) rad between the boresight of a jammer and lines outward (n, 3), frame i."""
    level = math.cos(card.elevation)
    axis = np.array([level * math.cos(card.azimuth), level * math.sin(card.azimuth), -math.sin(card.elevation)])
    axes = frames.rotation_i_n(_place(card, theta0, t), frames.earth_angle(theta0, t))
    along = np.einsum("nij,nj,i->n", axes, outward, axis) / np.linalg.norm(outward, axis=1)
    return np.asarray(np.arccos(np.clip(along, -1.0, 1.0)))


def effective(cn0: Floats, carrier: Floats, density: Floats) -> Floats:
    """Return the effective C/N0 (dB-Hz) beside jammers: 1 / (C/N0)_e = 1 / (C/N0) + J / (C Q R_c).

    cn0 (dB-Hz) without them; carrier C (dBW) and density J / (Q R_c) (W/Hz) at the same antenna's output.
    """
    found, jammed = np.array(cn0), density > 0.0
    found[jammed] = -10.0 * np.log10(10.0 ** (-0.1 * cn0[jammed]) + density[jammed] * 10.0 ** (-0.1 * carrier[jammed]))
    return found


def feigned(faults: Sequence[AnyFault], trajectory: Trajectory, t: Floats, r_i: Floats, true: Sight) -> Floats:
    """Return what spoofers add to ranges (m) and range rates (m/s), (n_epoch, n_sat, 2), so that they are those of a
    place that moves away.

    r_i (n_epoch, 3) m of the antenna, frame i; true (n_epoch, n_sat) lines of sight from it. The place moves in axes
    north, east, down of the antenna, which turn with the Earth.
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
