"""Phase centres of all antennas along a flight, an oracle for lever arms."""

from __future__ import annotations

import numpy as np

from lvnav_trade.gnss.receiver_cards import ReceiverCard
from lvnav_trade.quantities.frames import matrices
from lvnav_trade.quantities.records import Floats
from lvnav_trade.trajectory.flight import Trajectory
from lvnav_trade.trajectory.truth import motion


def antenna_states(trajectory: Trajectory, receiver: ReceiverCard, t: Floats) -> tuple[Floats, Floats]:
    """Return true position (m) and velocity (m/s) of the phase centres in frame i, (n_epoch, n_antenna, 3) each."""
    at = motion(trajectory, t)
    lever_arms_b = np.array(receiver.lever_arms)
    C_b_i = matrices(at.q_b_i)
    arms = np.einsum("nij,aj->nai", C_b_i, lever_arms_b)
    swing = np.einsum("nij,naj->nai", C_b_i, np.cross(at.w_ib_b[:, None, :], lever_arms_b))
    return at.r_i[:, None, :] + arms, at.v_i[:, None, :] + swing
