"""Covariance of a filter at its start, from its filter model of the initial errors."""

import numpy as np

from lvnav_trade.filter.assumed import InitialModel
from lvnav_trade.filter.model import axis_squares, state_blocks
from lvnav_trade.kernels.transition import ATT, POS, VEL
from lvnav_trade.quantities.per_axis import axes
from lvnav_trade.quantities.records import Floats
from lvnav_trade.quantities.shared_cards import EnvelopeCard
from lvnav_trade.quantities.state_layout import StateLayout

# One-sigma (m) of the receiver's clock at an epoch before the filter starts: a difference with it has no weight.
UNKNOWN = 1e6
RELATIVE_BIASES = {"gyro_bias": "gyro_relative_bias", "accel_bias": "accel_relative_bias"}


def _clone_variances(layout: StateLayout, variance: Floats) -> Floats:
    """Return the initial variances of the clones, (n_clone,); `variance` (n_state,) are those of the states."""
    variances = variance[list(layout.cloned_states)]
    is_clock = [state == layout.clock for state in layout.cloned_states]
    variances[is_clock] = UNKNOWN**2
    return variances


def _add_correlations(P: Floats, layout: StateLayout) -> None:
    """Set the covariance of relative biases with the biases of the combined triad, axis by axis, in P."""
    biases = {RELATIVE_BIASES[block.name]: block for block in layout.parameters if block.name in RELATIVE_BIASES}
    for extra in layout.extras:
        if not extra.correlation or extra.name not in biases:
            continue
        bias = biases[extra.name]
        correlations = axes(extra.correlation)
        extra_sigmas = axes(extra.sigma)
        bias_sigmas = axes(bias.sigma)
        for i in range(3):
            covariance = correlations[i] * extra_sigmas[i] * bias_sigmas[i]
            P[extra.offset + i, bias.offset + i] = covariance
            P[bias.offset + i, extra.offset + i] = covariance


def initial_covariance(
    layout: StateLayout, initial: InitialModel, C_n_i: Floats, envelope: EnvelopeCard | None = None
) -> Floats:
    """Return the initial covariance of the filter, (n_state, n_state), SI squared.

    Parameters
    ----------
    layout
        States of the filter.
    initial
        One-sigma of the initial errors.
    C_n_i
        (3, 3). Rotation from the local frame (north, east, down) at the starting point to the inertial frame.
    envelope
        Motion envelope of a filter that models the vehicle; None otherwise.
    """
    clock = layout.clock
    motion = layout.motion
    variance = np.zeros(layout.n_state)
    variance[VEL : VEL + 3] = initial.velocity**2
    variance[POS : POS + 3] = initial.position**2
    for states, sigma, _ in state_blocks(layout):
        variance[states] = axis_squares(sigma)
    if clock >= 0:
        variance[clock] = initial.clock_bias**2
        variance[clock + 1] = 0.0 if layout.has_reduced_clock else initial.clock_drift**2
    if motion >= 0 and envelope is not None:
        variance[motion : motion + 3] = envelope.start_rate**2
        variance[motion + 3 : motion + 6] = envelope.start_acceleration**2
    if layout.cloned_states:
        clones = slice(layout.clone, layout.clone + len(layout.cloned_states))
        variance[clones] = _clone_variances(layout, variance)
    P = np.diag(variance)
    tilt_variance = initial.tilt**2
    heading_variance = initial.heading**2
    attitude_n = np.diag([tilt_variance, tilt_variance, heading_variance])
    P[ATT : ATT + 3, ATT : ATT + 3] = C_n_i @ attitude_n @ C_n_i.T
    _add_correlations(P, layout)
    return P
